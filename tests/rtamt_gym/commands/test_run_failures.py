"""`rtamt run`: an episode that fails does not lose the others."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from leaving import LEAVING, Leaving, leaving_policy

from rtamt_gym.__main__ import main
from rtamt_gym.reports.write import report_of

Output = pytest.CaptureFixture[str]
RUN = ["run", "RtamtLeaves-v0", "--signal", "y=obs[0]", "--at-termination", "complete"]
SPEC = ["--spec", "low = always(y < 2)"]
SPECS = [*SPEC, "--spec", "never = always(y > 5 implies eventually(y < 9))"]
NO_END = "which is no end of a simulation; let it return, or raise an error"


class Breaks(Leaving):
    """Episodes of odd seeds fail at the second step, each with an error of its own."""

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401
        self._seed = seed
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> Any:  # noqa: ANN401, ARG002
        self._steps += 1
        if self._odd and self._steps == 2:
            raise ValueError(f"diverged, {self._seed}: {'far ' * 80}")
        return np.array([float(self._odd)]), 0.0, self._steps == 3, False, {}


@pytest.fixture(autouse=True)
def _environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    gym.register("RtamtLeaves-v0", lambda **given: Leaving(given["where"]))
    gym.register("RtamtBreaks-v0", lambda **_: Breaks())
    yield
    del gym.registry["RtamtLeaves-v0"], gym.registry["RtamtBreaks-v0"]


@pytest.mark.parametrize("where", LEAVING)
def test_the_table_has_the_others_and_the_first_error_stands_below(
    where: str, capsys: Output
) -> None:
    policy = ["--policy", "leaving:leaving_policy" if where == "policy" else "zero"]
    episodes = [*policy, "--env-kwarg", f"where={where}", "--seed", "1", "--episodes", "4"]
    assert main([*RUN, *SPEC, *episodes]) == 2
    out, err = capsys.readouterr()
    assert err == ""
    culprit = "RtamtLeaves-v0 called sys.exit(0)"
    if where == "policy":
        line = inspect.getsourcelines(leaving_policy)[1] + 3
        culprit = f"the policy leaving:leaving_policy called sys.exit() (leaving.py, line {line})"
    head, below = out.split("\n2 of 4 episodes failed; the first, seed 1:\n")
    assert " ".join(below.split()) == f"InputError: {culprit}, {NO_END}"
    assert [line.split() for line in head.splitlines()[3:] if line] == [
        ["1", "-", "-", "low", "-", "ERROR", "-"],
        ["2", "3", "-", "low", "+2", "SATISFIED", "-"],
        ["3", "-", "-", "low", "-", "ERROR", "-"],
        ["4", "3", "-", "low", "+2", "SATISFIED", "-"],
    ]


def test_an_error_is_cut_to_three_lines_and_others_are_counted(capsys: Output) -> None:
    breaks = [RUN[0], "RtamtBreaks-v0", *RUN[2:], *SPECS, "--policy", "zero", "--episodes", "5"]
    assert main([*breaks, "--require-asked"]) == 2  # and not 3
    out = capsys.readouterr().out
    below = out.split("\n2 of 5 episodes failed; the first, seed 1:\n")[1].splitlines()
    assert below[0].startswith("  ValueError: diverged, 1: far far")
    assert below[2].endswith("...")
    assert below[3:5] == ["  and 1 other error", ""]
    assert below[5:] == ["never asked: never was put to the test in 0 of 3 episodes"]
    assert max(map(len, out.splitlines())) <= 80
    rows = [line.split() for line in out.splitlines() if "ERROR" in line]
    assert rows == [
        ["2", "-", "-", "low", "-", "ERROR", "-", "-"],
        ["never", "-", "ERROR", "-", "-"],
        ["4", "-", "-", "low", "-", "ERROR", "-", "-"],
        ["never", "-", "ERROR", "-", "-"],
    ]


def test_files_have_all_episodes_and_the_error_of_those_that_failed(capsys: Output) -> None:
    breaks = [RUN[0], "RtamtBreaks-v0", *RUN[2:], *SPECS, "--policy", "zero", "--seed", "1"]
    files = ["--json", "o.json", "--plot", "o.png"]
    assert main([*breaks, "--episodes", "3", *files]) == 2
    assert "outcomes: o.json\npicture of episode 2: o.png\n" in capsys.readouterr().out
    kept = json.loads(Path("o.json").read_text())
    assert [trial["ended"] for trial in kept["trials"]] == ["error", "terminated", "error"]
    assert [trial["seed"] for trial in kept["trials"]] == [1, 2, 3]
    errors = [trial.get("error", "")[:23] for trial in kept["trials"]]
    assert errors == ["ValueError: diverged, 1", "", "ValueError: diverged, 3"]
    low = kept["results"]["low"]
    assert (low["episodes"], low["satisfied"], low["failed"]) == (3, 1, 2)
    (section,) = report_of("o.json").sections
    counts = section.requirements[0].counts
    assert (counts.satisfied, counts.failed) == (1, 2)


def test_if_all_fail_the_error_of_the_first_is_raised(capsys: Output) -> None:
    odd = ["--policy", "zero", "--env-kwarg", "where=step", "--seed", "1", "--json", "o.json"]
    assert main([*RUN, *SPEC, *odd]) == 2
    told = f"rtamt: error: RtamtLeaves-v0 called sys.exit(0), {NO_END}\n"
    assert capsys.readouterr() == ("", told)
    assert not Path("o.json").exists()
