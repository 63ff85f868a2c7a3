"""Runs of environments: their options, their ends and failures."""

from __future__ import annotations

import inspect
import json
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from leaving import LEAVING, Leaving, leaving_policy

from rtamt_gym.__main__ import main
from rtamt_gym.reports.write import report_of

Output = pytest.CaptureFixture[str]


class Falls(gym.Env[Any, Any]):
    """x rises to 3, where the environment ends the episode."""

    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = spaces.Discrete(1)
    control_timestep = 0.1

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.x = 0.0
        return np.array([self.x]), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ARG002
        self.x += 1.0
        if self.x == 2:
            warnings.warn("the ground is wet", stacklevel=1)
        return np.array([self.x]), 0.0, self.x == 3, False, {}


RUN = ["run", "RtamtFalls-v0", "--signal", "x=obs[0]", "--policy", "zero"]
INVARIANT = ["--spec", "always(x < 9)"]
NOTE = """
note: the environment ended an episode while a specification was open, which
counts as satisfied. --at-termination sets what its end means: complete for
this, failure for a fall or a crash, cut where the episode could have gone on.
"""


def verdict(capsys: Output, *arguments: str) -> str:
    assert main([*RUN, *arguments]) == 0
    row: str = capsys.readouterr().out.splitlines()[3]
    return next(word for word in row.split() if word.endswith("ED"))


pytestmark = pytest.mark.filterwarnings("ignore:the ground is wet")


@pytest.mark.parametrize(
    ("end", "invariant", "goal", "window"),
    [
        ("complete", "SATISFIED", "VIOLATED", "SATISFIED"),
        ("cut", "SATISFIED", "VIOLATED", "UNDECIDED"),
        ("failure", "VIOLATED", "VIOLATED", "VIOLATED"),
    ],
)
def test_the_end_of_an_environment_is_read_as_asked(
    end: str, invariant: str, goal: str, window: str, capsys: Output
) -> None:
    ends = ["--at-termination", end]
    assert verdict(capsys, *INVARIANT, *ends) == invariant
    assert verdict(capsys, "--spec", "eventually(x > 9)", *ends) == goal
    assert verdict(capsys, "--spec", "always[0:1](x < 9)", *ends) == window


@pytest.mark.parametrize(
    ("end", "invariant", "goal", "window"),
    [
        ("complete", "SATISFIED", "VIOLATED", "SATISFIED"),
        ("cut", "SATISFIED", "VIOLATED", "UNDECIDED"),
        ("open", "UNDECIDED", "UNDECIDED", "UNDECIDED"),
    ],
)
def test_a_time_limit_is_read_as_asked(
    end: str, invariant: str, goal: str, window: str, capsys: Output
) -> None:
    ends = ["--max-steps", "2", "--at-truncation", end]
    assert verdict(capsys, *INVARIANT, *ends) == invariant
    assert verdict(capsys, "--spec", "eventually(x > 9)", *ends) == goal
    assert verdict(capsys, "--spec", "always[0:1](x < 9)", *ends) == window
    if end == "cut":
        assert verdict(capsys, *INVARIANT, "--max-steps", "2") == invariant
        assert verdict(capsys, "--spec", "always[0:1](x < 9)", "--max-steps", "2") == window


def test_an_end_that_satisfies_is_noted_once_if_nobody_has_said_what_it_means(
    capsys: Output,
) -> None:
    assert main([*RUN, *INVARIANT, "--episodes", "3"]) == 0
    out, err = capsys.readouterr()
    assert (out.count("SATISFIED"), err) == (3, "")
    assert out.endswith(NOTE)
    assert out.count("note:") == 1
    for arguments in (
        [*INVARIANT, "--at-termination", "complete"],
        [*INVARIANT, "--max-steps", "2"],
        ["--spec", "eventually(x > 9)"],
        ["--spec", "always(x < 2)"],
    ):
        assert main([*RUN, *arguments]) == 0
        assert "note:" not in capsys.readouterr().out


def test_a_warning_of_the_environment_is_no_note(capsys: Output) -> None:
    with pytest.warns(UserWarning, match="the ground is wet"):
        main([*RUN, *INVARIANT, "--at-termination", "complete"])
    assert "note:" not in capsys.readouterr().out


def test_the_outcomes_hold_how_the_ends_were_read(capsys: Output) -> None:
    ends = ["--at-termination", "failure", "--at-truncation", "open", "--json", "o.json"]
    assert main([*RUN, *INVARIANT, *ends]) == 0
    capsys.readouterr()
    outcomes = json.loads(Path("o.json").read_text())
    ends = [outcomes["reading"][each] for each in ("at_termination", "at_truncation")]
    assert ends == ["failure", "open"]
    (episode,) = outcomes["trials"]
    assert (episode["ended"], episode["violated_by"]) == ("terminated", "spec")
    assert episode["outcomes"]["spec"] == {
        "robustness": 6.0,
        "lower": "-inf",
        "upper": -0.0,
        "verdict": "VIOLATED",
        "decided_at": None,
        "ended_at": {"sample": 3, "seconds": 0.3},
        "by_end": True,
        "asked": [],
    }


def test_another_reading_is_refused(capsys: Output) -> None:
    assert main([*RUN, *INVARIANT, "--at-truncation", "failure"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: argument --at-truncation: invalid choice: 'failure' "
        "(choose from 'complete', 'cut', 'open'); see rtamt run --help\n"
    )


RUN_FAILURES = ["run", "RtamtLeaves-v0", "--signal", "y=obs[0]", "--at-termination", "complete"]
SPEC = ["--spec", "low = always(y < 2)"]
NEVER = ["--spec", "never = always(y > 5 implies eventually(y < 9))"]
BREAKS = ["run", "RtamtBreaks-v0", *RUN_FAILURES[2:], *SPEC, *NEVER, "--policy", "zero"]
NO_END = "which does not end a simulation; return, or raise an error"


class Breaks(Leaving):
    """An environment whose episodes of odd seeds fail at the second step with different errors."""

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401
        self._seed = seed
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> Any:  # noqa: ANN401, ARG002
        self._steps += 1
        if self._odd and self._steps == 2:
            raise ValueError(f"diverged, {self._seed}: {'far ' * 80}")
        return np.array([float(self._odd)]), 0.0, self._steps == 3, False, {}


@pytest.mark.parametrize("where", LEAVING)
def test_the_table_has_the_others_and_the_first_error_stands_below(
    where: str, capsys: Output
) -> None:
    policy = ["--policy", "leaving:leaving_policy" if where == "policy" else "zero"]
    episodes = [*policy, "--env-kwarg", f"where={where}", "--seed", "1", "--episodes", "4"]
    assert main([*RUN_FAILURES, *SPEC, *episodes]) == 2
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
    assert main([*BREAKS, "--episodes", "5", "--require-triggered"]) == 2  # and not 3
    out = capsys.readouterr().out
    below = out.split("\n2 of 5 episodes failed; the first, seed 1:\n")[1].splitlines()
    assert below[0].startswith("  ValueError: diverged, 1: far far")
    assert below[2].endswith("...")
    assert below[3:5] == ["  and 1 other error", ""]
    assert below[5:] == ["never triggered: never in 0 of 3 episodes"]
    assert max(map(len, out.splitlines())) <= 80
    rows = [line.split() for line in out.splitlines() if "ERROR" in line]
    assert rows == [
        ["2", "-", "-", "low", "-", "ERROR", "-", "-"],
        ["never", "-", "ERROR", "-", "-"],
        ["4", "-", "-", "low", "-", "ERROR", "-", "-"],
        ["never", "-", "ERROR", "-", "-"],
    ]


def test_files_have_all_episodes_and_the_error_of_those_that_failed(capsys: Output) -> None:
    files = ["--json", "o.json", "--plot", "o.png"]
    assert main([*BREAKS, "--seed", "1", "--episodes", "3", *files]) == 2
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
    assert (counts["satisfied"], counts["failed"]) == (1, 2)


def test_if_all_fail_the_error_of_the_first_is_raised(capsys: Output) -> None:
    odd = ["--policy", "zero", "--env-kwarg", "where=step", "--seed", "1", "--json", "o.json"]
    assert main([*RUN_FAILURES, *SPEC, *odd]) == 2
    told = f"rtamt: error: RtamtLeaves-v0 called sys.exit(0), {NO_END}\n"
    assert capsys.readouterr() == ("", told)
    assert not Path("o.json").exists()


class Given(gym.Env[Any, Any]):
    """An environment that keeps its arguments."""

    options: dict[str, Any]
    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = spaces.Discrete(2)
    control_timestep = 0.1

    def __init__(self, **options: Any) -> None:  # noqa: ANN401
        Given.options = options
        if "refused" in options:
            raise RuntimeError("the road has no lanes")
        if "unknown" in options:
            raise TypeError("no such argument: unknown")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.x = 0.0
        return np.array([self.x]), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.x += action
        return np.array([self.x]), 0.0, False, False, {}


RUN_OPTIONS = ["run", "RtamtGiven-v0", "--spec", "always(x < 2)", "--signal", "x=obs[0]"]


@pytest.fixture(autouse=True)
def _environments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """An empty working directory, the environments, and modules that the next test forgets."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    gym.register("RtamtFalls-v0", lambda **_: Falls(), max_episode_steps=50)
    gym.register("RtamtLeaves-v0", lambda **given: Leaving(given["where"]))
    gym.register("RtamtBreaks-v0", lambda **_: Breaks())
    gym.register("RtamtGiven-v0", Given, max_episode_steps=5)
    yield
    for name in ("Falls", "Leaves", "Breaks", "Given"):
        del gym.registry[f"Rtamt{name}-v0"]
    for module in [name for name in sys.modules if name.startswith("rtamt_")]:
        if Path(sys.modules[module].__file__ or "").is_relative_to(tmp_path):
            del sys.modules[module]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2", 2),
        ("-0.5", -0.5),
        ("true", True),
        ("True", True),
        ("False", False),
        ("None", None),
        ("null", None),
        ('{"duration": 20, "lanes": [1, 2]}', {"duration": 20, "lanes": [1, 2]}),
        ('"2"', "2"),
        ("rgb_array", "rgb_array"),
        ("./hopper.xml", "./hopper.xml"),
        ("a=b", "a=b"),
        (" padded ", "padded"),
    ],
)
def test_an_argument_of_the_environment_is_json_or_text(
    text: str, value: object, capsys: Output
) -> None:
    assert main([*RUN_OPTIONS, "--env-kwarg", f"key={text}", "--env-kwarg", "other=1"]) == 0
    capsys.readouterr()
    assert Given.options == {"key": value, "other": 1}
    assert type(Given.options["key"]) is type(value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["key"], "--env-kwarg: expected KEY=VALUE, such as frame_skip=2, got 'key'"),
        (["key="], "--env-kwarg: expected KEY=VALUE, such as frame_skip=2, got 'key='"),
        (["2=3"], "--env-kwarg: expected KEY=VALUE, such as frame_skip=2, got '2=3'"),
        (["a=1", "a=2"], "--env-kwarg: expected one 'a', got two"),
        (
            ["config={'a': 1}"],
            (
                "--env-kwarg: expected JSON, such as '{\"duration\": 20}', got \"{'a': 1}\": "
                "Expecting property name enclosed in double quotes: line 1 column 2 (char 1)"
            ),
        ),
        (
            ["refused=1"],
            "cannot make RtamtGiven-v0 with refused=1: RuntimeError: the road has no lanes",
        ),
        (
            ["unknown='a'"],
            (
                "cannot make RtamtGiven-v0 with unknown=\"'a'\": TypeError: no such argument: "
                "unknown"
            ),
        ),
    ],
)
def test_an_argument_that_cannot_be_read_or_is_not_taken_is_refused(
    arguments: list[str], message: str, capsys: Output
) -> None:
    options = [word for argument in arguments for word in ("--env-kwarg", argument)]
    assert main([*RUN_OPTIONS, *options]) == 2
    assert capsys.readouterr() == ("", f"rtamt: error: {message}\n")


def test_a_function_of_the_working_directory_drives_every_episode(capsys: Output) -> None:
    Path("rtamt_pilot.py").write_text("def act(obs):\n    return int(obs[0] < 1)\n")
    arguments = [*RUN_OPTIONS, "--policy", "rtamt_pilot:act", "--episodes", "2", "--json", "o.json"]
    assert main(arguments) == 0
    capsys.readouterr()
    episodes = json.loads(Path("o.json").read_text())["trials"]
    assert [(e["steps"], e["outcomes"]["spec"]["robustness"]) for e in episodes] == [(5, 1.0)] * 2


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (
            "randm",
            (
                "--policy: expected random, zero, baseline, sb3:FILE.zip or module:function, "
                "got 'randm'"
            ),
        ),
        ("rtamt_absent:act", "cannot find the module 'rtamt_absent'"),
        ("rtamt_pilot:acct", "the module rtamt_pilot has no 'acct'; did you mean 'act'?"),
        (
            "rtamt_pilot:act",
            (
                "the policy rtamt_pilot:act raised IndexError: index 7 is out of bounds for axis 0 "
                "with size 1 (rtamt_pilot.py, line 2)"
            ),
        ),
        ("sb3:absent.zip", "cannot open absent.zip: No such file or directory"),
        ("sb3:text.zip", "text.zip is not a model of Stable-Baselines3"),
    ],
)
def test_a_policy_that_fails_is_one_message(policy: str, message: str, capsys: Output) -> None:
    Path("rtamt_pilot.py").write_text("def act(obs):\n    return obs[7]\n")
    Path("text.zip").write_text("a model")
    assert main([*RUN_OPTIONS, "--policy", policy]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"rtamt: error: {message}")
    assert len(err.splitlines()) == 1


def test_substeps_sees_what_whole_steps_do_not(capsys: Output) -> None:
    Path("rtamt_pilot.py").write_text("def act(obs):\n    return [3.0]\n")
    arguments = ["run", "InvertedPendulum-v5", "--spec", "always(v < 1)", "--signal", "v=qvel[0]"]
    rows = []
    for more in ([], ["--substeps"]):
        assert main([*arguments, "--policy", "rtamt_pilot:act", *more]) == 0
        rows.append(capsys.readouterr().out.splitlines()[3].split())
    # The steps of the environment take 0.04 s, those of its simulation 0.02 s.
    assert rows[0][1:4] == ["2", "0.08", "s"]
    assert rows[1][1:4] == ["3", "0.06", "s"]


def test_substeps_of_an_environment_without_them_are_refused(capsys: Output) -> None:
    assert main([*RUN_OPTIONS, "--substeps"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: --substeps needs a MujocoEnv of Gymnasium or an environment of highway-env, "
        "got <Given<RtamtGiven-v0>>; leave it out\n"
    )


def test_a_signal_that_is_nan_is_refused_without_advice_that_is_not_there(capsys: Output) -> None:
    Path("rtamt_pilot.py").write_text("def act(obs):\n    return [float('nan')]\n")
    arguments = ["run", "Pendulum-v1", "--spec", "always(v < 99)", "--signal", "v=obs[2]"]
    assert main([*arguments, "--policy", "rtamt_pilot:act"]) == 2
    assert capsys.readouterr().err == "rtamt: error: variable 'v' is nan at sample 1\n"
