"""A clip that hides the robustness that observe= appends is warned of, in all wrappers."""

from __future__ import annotations

import functools
import warnings
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from replay import Replay
from vector_environments import MODES, sync

from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward

SPECS = {"near": "always(x < 10)", "far": "eventually(x > 3)"}
X = {"x": "obs[0]"}
VALUES = [0.5, 1.0, 8.5, 9.5, 2.0, 0.0]
"""Robustness of near: 9.5, 9, 1.5, 0.5, 0.5, 0.5; of far: -2.5, -2, 5.5, 6.5, 6.5, 6.5."""

SAYS = (
    "clip=1 flattens what observe='state' appends: at 60 of 60 samples of the first episodes the "
    "robustness of 'far' was outside of [-1, 1], where the observation is the same; it ranged from "
    "-2.5 to 6.5; take a clip= about that range, such as clip=6.5"
)
WATCHES: dict[str, Any] = {
    "period": 1,
    "observe": "state",
    "on_violation": "report",
    "at_termination": "complete",
}


def play(env: Any, episodes: int) -> list[str]:  # noqa: ANN401
    """The warnings of so many episodes."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(episodes):
            env.reset()
            for _ in VALUES[1:]:
                env.step(np.zeros(1))
    return [str(each.message) for each in caught]


def test_a_monitor_warns_once_at_the_end_of_the_tenth_episode() -> None:
    env = StlMonitor(Replay(VALUES), SPECS, X, **WATCHES)
    assert play(env, 9) == []
    assert play(env, 1) == [SAYS]
    assert play(env, 30) == []


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"clip": 6.5}, []),
        ({"clip": 5.5}, []),  # at 30 of 60: not at most
        ({"observe": None}, []),
        ({"observe": "obligations", "clip": 2.25}, ["clip=2.25 flattens what observe='obligat"]),
    ],
)
def test_half_of_the_samples_is_not_most(options: dict[str, Any], says: list[str]) -> None:
    env = StlMonitor(Replay(VALUES), SPECS, X, **{**WATCHES, **options})
    said = play(env, 12)
    assert len(said) == len(says)
    assert all(each.startswith(begin) for each, begin in zip(said, says, strict=True))


def test_a_reward_says_it_of_what_it_shows_unless_it_says_it_of_what_it_pays() -> None:
    env = StlReward(Replay(VALUES), SPECS, X, mode="terminal", clip=1.0, **WATCHES)
    assert play(env, 12) == [SAYS]
    env = StlReward(Replay(VALUES), {"far": SPECS["far"]}, X, mode="add", clip=1.0, **WATCHES)
    (said,) = play(env, 12)
    assert said.startswith("clip=1 flattens the reward")
    weighed = StlReward(
        Replay(VALUES), SPECS, X, mode="terminal", weights={"near": 0.1, "far": 0.1}, **WATCHES
    )
    assert play(weighed, 12) == []


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize(
    "kind", [VectorStlMonitor, functools.partial(VectorStlReward, mode="terminal")]
)
def test_many_environments_count_together(mode: AutoresetMode, kind: Any) -> None:  # noqa: ANN401
    envs = kind(sync([functools.partial(Replay, VALUES)] * 2, mode), SPECS, X, **WATCHES)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        envs.reset()
        for _ in range(60):
            _, _, terminated, truncated, _ = envs.step(np.zeros((2, 1)))
            ended = terminated | truncated
            if mode is AutoresetMode.DISABLED and ended.any():
                envs.reset(options={"reset_mask": ended})
    (said,) = [str(each.message) for each in caught]
    assert said == SAYS
