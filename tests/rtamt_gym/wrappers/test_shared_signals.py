"""One mapping of signals serves monitors that each read a part of it."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from rtamt_gym import StlMonitor, VectorStlMonitor, relabel, simulate
from rtamt_gym.__main__ import main

SIGNALS: dict[str, Any] = {
    "x": "obs[0]",
    "angle": "obs[2]",
    "goal": "obs['goal'][7]",  # of another environment
    "late": ("info['late']", None),
}


def test_names_that_no_specification_reads_are_for_others() -> None:
    for text, names in (("always(x < 1)", ("x",)), ("always(angle < 1)", ("angle",))):
        env = StlMonitor(gym.make("CartPole-v1"), text, SIGNALS)
        env.reset(seed=1)
        assert env.signal_names == names
        envs = VectorStlMonitor(gym.make_vec("CartPole-v1", 2), text, SIGNALS)
        assert envs.reset(seed=1)[1]["robustness"].shape == (2,)
    episode = {
        "observations": np.zeros((3, 4)),
        "actions": np.zeros((2, 1)),
        "rewards": [1.0, 2.0],
        "terminations": [False, False],
        "truncations": [False, True],
    }
    (result,) = relabel([episode], "always(x < 1)", SIGNALS)
    assert result.satisfied


def test_what_is_simulated_is_recorded_too() -> None:
    signals = {"x": "obs[0]", "angle": "obs[2]"}
    run = simulate(gym.make("CartPole-v1"), "always(x < 1)", signals, policy=lambda _: 0, seed=1)
    assert set(run.signals) == {"x", "angle"}


def test_run_says_which_are_unused(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", "CartPole-v1", "--policy", "zero", "--spec", "always(x < 9)"]
    main([*arguments, "--signal", "x=obs[0]", "--signal", "w=obs[3]", "--signal", "v=obs[1]"])
    assert "\nsignals that no specification reads: 'w', 'v'\n" in capsys.readouterr().out
    main([*arguments, "--signal", "x=obs[0]"])
    assert "signals that no specification reads" not in capsys.readouterr().out
