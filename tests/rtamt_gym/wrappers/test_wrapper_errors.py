"""Errors of the wrappers: ``errors.txt`` has the calls and the exact texts."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from catalogue import check, entries
from gymnasium import spaces
from gymnasium.envs.mujoco.inverted_pendulum_v5 import InvertedPendulumEnv
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeLimit
from painted import Painted
from parallel_environments import Crew
from replay import Replay, X
from vector_environments import ANGLE, native, sync

from rtamt_gym import (
    CostEnv,
    ParallelStlMonitor,
    RobustnessOverlay,
    StlMonitor,
    StlReward,
    VectorStlMonitor,
    VectorStlReward,
)
from rtamt_gym.shaping import Shaping
from rtamt_gym.wrappers import batched

SPEC = "always(x > 1)"


class Timeless(gym.Env[Any, Any]):
    """Does not say its period."""

    observation_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
    action_space = spaces.Discrete(2)

    def __str__(self) -> str:
        return "<Timeless>"


class Named(Crew):
    """A crew whose name is in messages."""

    def __str__(self) -> str:
        return "crew_v0"


class Turns(Named):
    """Agents that take turns, as in the other API of PettingZoo."""

    def agent_iter(self) -> None: ...


class Agents:
    """Not an environment of Gymnasium."""

    possible_agents = ("first", "second")

    def __repr__(self) -> str:
        return "<Agents>"


class OwnLoop(InvertedPendulumEnv):
    """Steps its simulation in a function that it has overridden."""

    def _step_mujoco_simulation(self, ctrl: Any, n_frames: int) -> None:
        self.data.ctrl[:] = ctrl
        mujoco.mj_step(self.model, self.data, nstep=n_frames)


def one(env: Any = None, specs: Any = SPEC, signals: Any = X, **options: Any) -> Any:
    return StlMonitor(env or Replay([3, 3]), specs, signals, **options)


def timeless(specs: Any = SPEC, signals: Any = X, **options: Any) -> Any:
    return StlMonitor(Timeless(), specs, signals, **options)


def replays(*infos: dict[str, Any]) -> Any:
    """Environments that reset in the step after their last, with these infos."""

    def make(info: dict[str, Any]) -> Replay:
        env = Replay([3, 3, 3])
        env.info = info
        return env

    return sync([functools.partial(make, info) for info in infos], AutoresetMode.NEXT_STEP)


def many(env: Any = None, specs: Any = SPEC, signals: Any = X, **options: Any) -> Any:
    return VectorStlMonitor(env or replays({}), specs, signals, **options)


def poles(specs: Any = "always(theta < 1)", signals: Any = ANGLE, **options: Any) -> Any:
    return VectorStlMonitor(native(2), specs, signals, **options)


def read_of_many(signal: Any, *infos: dict[str, Any]) -> None:
    """Read a signal from the info of a reset, and of a step."""
    envs = many(replays(*infos), "always(x < 9)", {"x": (signal, 0.0)})
    envs.reset()
    envs.step(np.zeros((2, 1)))


CREW = {"lead": [5.0, 5.0], "wing_0": [1.0, 2.0]}
GAP = {"x": "lead: obs[0]", "y": "wing_0: obs[0]"}


def crew(
    env: Any = None, specs: Any = "always(x - y > 1)", signals: Any = GAP, **options: Any
) -> Any:
    return ParallelStlMonitor(env or Named(CREW), specs, signals, **options)


def substeps(env: Any, signal: Any) -> Any:
    made = gym.make(env) if isinstance(env, str) else env()
    return StlMonitor(made, "always(x < 1)", {"x": signal}, substeps=True)


def reward(env: Any = None, **options: Any) -> Any:
    return StlReward(env or Replay([1]), **{"mode": "add", **options})


def vector_reward(env: Any = None, **options: Any) -> Any:
    return VectorStlReward(env or native(2), **{"mode": "add", **options})


def rewarded(**options: Any) -> Any:
    return StlReward(Replay([1]), SPEC, X, mode="add", **options)


def shaping(**options: Any) -> Any:
    return Shaping.of(["upright", "slow"], **{"mode": "add", **options})


WORDS: dict[str, Any] = {"a": "terminate", "b": "truncate", "c": "report"}
THREE = {"a": "always(x > 0)", "b": "always(x > 1)", "c": "always(x != 2)"}


def words_of_one(words: Any) -> Any:
    return one(None, THREE, on_violation=words)


def words_of_many(words: Any) -> Any:
    return many(sync([lambda: Replay([3.0])], AutoresetMode.DISABLED), THREE, on_violation=words)


def words_of_crew(words: Any) -> Any:
    return crew(Crew({"one": [3.0]}), THREE, {"x": "one: obs[0]"}, on_violation=words)


PAIR = {"req": "obs[0]", "gnt": "obs[0]"}
GRANTED = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
PAIRS = {"granted": GRANTED, "asked": "eventually(req >= 4)"}


def overlay(env: Any = None, **options: Any) -> Any:
    monitored = StlMonitor(env or Painted([3.0, 2.0]), SPEC, X, period=0.5)
    return RobustnessOverlay(monitored, **options)


NAMES = {
    **{name: value for name, value in globals().items() if not name.startswith("_")},
    **{item.__name__: item for item in (CostEnv, TimeLimit, batched)},
    "inf": math.inf,
    "nan": math.nan,
}


@pytest.mark.parametrize(
    ("call", "said"), entries(Path(__file__).with_name("errors.txt")), ids=lambda text: text[:60]
)
def test_errors_of_wrappers(call: str, said: str) -> None:
    check(call, said, **NAMES)
