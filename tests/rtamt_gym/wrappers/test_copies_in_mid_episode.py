"""A copy in mid-episode continues only if its environment has the state of the original."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import restored
from gymnasium import spaces
from gymnasium.utils import EzPickle
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import TimeLimit, TransformReward
from parallel_environments import Crew
from road_environments import RoadEnv
from vector_environments import difference

from rtamt import StateError
from rtamt_gym import ParallelStlMonitor, StlMonitor, StlReward, VectorStlMonitor, VectorStlReward

Copy = Callable[[Any], Any]

SPEC, SIGNALS = "eventually[0:2](x > 5)", {"x": "obs[0]"}

COPIES: dict[str, Copy] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
    "twice": lambda env: pickle.loads(pickle.dumps(copy.deepcopy(env))),
}

copies = pytest.mark.parametrize("copied", COPIES.values(), ids=COPIES)


class Counter(gym.Env[Any, Any]):
    """Observes its number of steps."""

    observation_space = spaces.Box(0.0, np.inf, (1,), np.float64)
    action_space = spaces.Discrete(1)
    control_timestep = 0.25
    count = 0

    def reset(self, **_: Any) -> Any:
        self.count = 0
        return np.zeros(1), {}

    def step(self, _: Any) -> Any:
        self.count += 1
        return np.full(1, float(self.count)), 0.0, False, self.count == 20, {}


class Rebuilt(Counter, EzPickle):
    """Is copied by its constructor, like environments of MuJoCo and Box2D."""

    def __init__(self) -> None:
        EzPickle.__init__(self)


class Carried(Rebuilt):
    """Copies its state too."""

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "count": self.count}

    def __setstate__(self, d: dict[str, Any]) -> None:
        super().__setstate__(d)
        self.count = d["count"]


class Road(RoadEnv):
    """Is copied by its constructor without `EzPickle`; its physics steps show that."""

    def __reduce__(self) -> Any:
        return type(self), (5,)


class Holds(gym.Env[Any, Any]):
    """Steps an environment with other actions."""

    observation_space, action_space = Counter.observation_space, spaces.Discrete(3)
    control_timestep = 0.25

    def __init__(self) -> None:
        self.inside = Rebuilt()

    def reset(self, **_: Any) -> Any:
        return self.inside.reset()

    def step(self, action: Any) -> Any:
        return self.inside.step(action)


class RebuiltCrew(Crew, EzPickle):
    """Agents that are copied by their constructor."""

    def __init__(self) -> None:
        EzPickle.__init__(self)
        super().__init__({"a": [float(i) for i in range(20)]}, tau=0.25)


def reacher() -> gym.Env[Any, Any]:
    return gym.make("Reacher-v5")


def wrapped() -> gym.Env[Any, Any]:
    return TransformReward(TimeLimit(Rebuilt(), 50), float)


def monitored(make: Callable[[], Any]) -> Any:
    return StlMonitor(make(), SPEC, SIGNALS, on_violation="report")


def rewarded() -> Any:
    return StlReward(Rebuilt(), SPEC, SIGNALS, mode="add")


def many() -> Any:
    return VectorStlMonitor(SyncVectorEnv([Counter, wrapped]), SPEC, SIGNALS)


def many_rewarded() -> Any:
    return VectorStlReward(SyncVectorEnv([Rebuilt] * 2), SPEC, SIGNALS, mode="add")


def agents() -> Any:
    return ParallelStlMonitor(RebuiltCrew(), SPEC, {"x": "a: obs[0]"})


def act(env: Any) -> Any:
    """Make a step with an action without effect."""
    if isinstance(env, ParallelStlMonitor):
        return env.step({"a": np.zeros(1)})
    space = env.action_space
    return env.step(0 if isinstance(space, spaces.Discrete) else np.zeros(space.shape, space.dtype))


LOST: dict[str, Callable[[], Any]] = {
    "environment": lambda: monitored(Rebuilt),
    "wrapped": lambda: monitored(wrapped),
    "holds": lambda: monitored(Holds),
    "mujoco": lambda: monitored(reacher),
    "clock": lambda: monitored(lambda: Road(5)),
    "reward": rewarded,
    "vector": many,
    "vector reward": many_rewarded,
    "agents": agents,
}


@copies
@pytest.mark.parametrize("make", LOST.values(), ids=LOST)
def test_copy_that_lost_its_episode_needs_a_reset(make: Callable[[], Any], copied: Copy) -> None:
    env = make()
    env.reset(seed=1)
    for _ in range(3):
        act(env)
    twin = copied(env)
    for _ in range(2):
        with pytest.raises(StateError, match="this is a copy in mid-episode, and copying"):
            act(twin)
    shown = twin.reset(seed=2)
    fresh = make()
    assert difference(shown, fresh.reset(seed=2)) == ""
    for _ in range(3):
        assert difference(act(twin), act(fresh)) == ""
    act(env)  # the original continues


@copies
@pytest.mark.parametrize(
    "make", [Counter, Carried, lambda: RoadEnv(5)], ids=["plain", "carried", "road"]
)
def test_copy_with_its_state_goes_on(make: Callable[[], Any], copied: Copy) -> None:
    env = monitored(make)
    env.reset(seed=1)
    for _ in range(3):
        act(env)
    twin = copied(env)
    for _ in range(3):
        assert difference(act(twin), act(env)) == ""


@copies
def test_copy_between_episodes_has_the_usual_error(copied: Copy) -> None:
    env = monitored(Rebuilt)
    with pytest.raises(StateError, match=r"got step\(\) before reset\(\) or after the end"):
        act(copied(env))
    env.reset()
    while not act(env)[3]:
        pass
    with pytest.raises(StateError, match=r"got step\(\) before reset\(\) or after the end"):
        act(copied(env))


@copies
def test_restored_copy_goes_on(copied: Copy) -> None:
    def entries() -> Any:
        return VectorStlMonitor(SyncVectorEnv([reacher] * 2), SPEC, SIGNALS)

    for env in (monitored(reacher), entries()):
        inside = [env] if isinstance(env, StlMonitor) else env.env.unwrapped.envs
        env.reset(seed=1)
        with pytest.raises(StateError, match="restore the state of the simulation with its time"):
            act(copied(env))
        for _ in range(3):
            act(env)
        twin = copied(env)
        others = [twin] if isinstance(env, StlMonitor) else twin.env.unwrapped.envs
        restored(others[0], inside[0])
        if len(others) > 1:
            with pytest.raises(StateError, match="this is a copy in mid-episode"):
                act(twin)
            restored(others[1], inside[1])
        for _ in range(3):
            assert difference(act(twin), act(env)) == ""


def test_lost_episode_is_not_recorded() -> None:
    env = monitored(Rebuilt)
    env.reset()
    act(env)
    twin = copy.deepcopy(env)
    twin.reset()
    twin.close()
    assert len(twin.stl_episodes) == 0
