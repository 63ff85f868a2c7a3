"""`rtamt run`: how the ends of episodes are read, and the note where nobody has said it."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]


class Falls(gym.Env[Any, Any]):
    """x goes up to 3, where the environment ends the episode."""

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
counts as satisfied. --at-termination says what its end means: complete for
this, failure for a fall or a crash, cut where the episode could have gone on.
"""


@pytest.fixture(autouse=True)
def _environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    gym.register("RtamtFalls-v0", lambda **_: Falls(), max_episode_steps=50)
    yield
    del gym.registry["RtamtFalls-v0"]


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
