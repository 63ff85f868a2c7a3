"""Ctrl-C ends an evaluation with its complete episodes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from rtamt_gym import evaluate_policy
from rtamt_gym.__main__ import main
from rtamt_gym.results import Evaluation

Output = pytest.CaptureFixture[str]
STEPS = 5
MODULE = """\
import gymnasium as gym
import numpy as np


class Own(gym.Env):
    metadata = {"render_modes": []}
    observation_space = gym.spaces.Box(-1, 1, (1,))
    action_space = gym.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), 0.0, False, False, {}


gym.register("Own-v0", "own_environment:Own", max_episode_steps=5)
calls = 0


def pressed(observation):
    global calls
    calls += 1
    if calls > 5 * 3 + 2:
        calls = 0
        raise KeyboardInterrupt
    return 0


def at_once(observation):
    raise KeyboardInterrupt
"""
WORDS = ["own_environment:Own-v0", "--spec", "near = always(abs(x) < 1)", "--signal", "x=obs[0]"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with a module of an environment and policies."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_environment.py").write_text(MODULE)
    return tmp_path


def evaluate(*more: str, policy: str = "pressed") -> int:
    policy = f"own_environment:{policy}"
    return main(["evaluate", *WORDS, "--policy", policy, "--period", "0.1", *more])


def test_it_prints_and_saves_the_episodes_that_are_over(capsys: Output, folder: Path) -> None:
    assert evaluate("--episodes", "40", "--save", "result.json") == 130
    said = capsys.readouterr().out.splitlines()
    assert said[1:3] == ["interrupted after 3 of 40 episodes", "3 episodes, seeds 0 to 2"]
    assert "not counted: at most 1 unfinished episode" in said
    assert json.loads((folder / "result.json").read_text())["interrupted"] == 40
    found = Evaluation.load(folder / "result.json")
    assert (found.interrupted, len(found.record)) == (40, 3)


def test_a_target_is_undecided_then_and_the_code_says_what_ended_it(capsys: Output) -> None:
    assert evaluate("--episodes", "40", "--target", "0.5") == 130
    assert "near: undecided after 3" in capsys.readouterr().out


def test_before_an_episode_is_over_nothing_is_known(capsys: Output) -> None:
    assert evaluate(policy="at_once") == 130
    out, said = capsys.readouterr()
    assert (out, said.splitlines()[-1]) == ("", "interrupted before an episode was over")


def test_the_error_has_the_evaluation() -> None:
    calls = iter(range(1, 1000))

    def policy(_: Any) -> int:  # noqa: ANN401
        if next(calls) > 2 * STEPS + 1:
            raise KeyboardInterrupt
        return 0

    env = gym.make("CartPole-v1", max_episode_steps=STEPS)
    with pytest.raises(KeyboardInterrupt) as pressed:
        evaluate_policy(
            policy, env, "always(abs(x) < 9)", {"x": "obs[0]"}, episodes=9, at_termination="cut"
        )
    found: Any = pressed.value
    assert [row.seed for row in found.evaluation.record] == [0, 1]
    assert found.evaluation.interrupted == 9
    assert np.isfinite(found.evaluation.returns).all()


@pytest.mark.parametrize(
    ("command", "more"),
    [
        ("run", ["--episodes", "1"]),
        ("sweep", ["--vary", "env.mass=1:2", "--samples", "1"]),
    ],
)
def test_commands_find_an_environment_in_the_working_directory(
    command: str, more: list[str], capsys: Output
) -> None:
    words = WORDS if command == "run" else [w.replace("--spec", "--requirement") for w in WORDS]
    main([command, *words, "--period", "0.1", *more])
    assert "No module" not in capsys.readouterr().err


def test_a_module_that_is_not_there_is_named(capsys: Output) -> None:
    assert main(["run", "no_such_module:Own-v0", "--spec", "always(x > 0)"]) == 2
    assert "cannot find the module 'no_such_module'" in capsys.readouterr().err
