"""Copies of a monitored environment in mid-episode, whose simulation may start from the beginning.

`gymnasium.utils.EzPickle` copies an environment by calling its constructor again, because the state
of MuJoCo, Box2D or Atari is outside Python. A monitor is copied with its samples, so it would go on
with an episode that its environment has lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
from gymnasium.utils import EzPickle
from gymnasium.vector import SyncVectorEnv, VectorEnv

from rtamt_gym.signals.simulation_time import clock_of

__all__ = ["clock_times", "is_rebuilt", "is_restored"]


def clock_times(env: Any) -> list[float]:  # noqa: ANN401 - an environment, of whatever form
    """Return the times of the simulations in an environment that have one."""
    clocks = [clock_of(level) for level in _levels(env)]
    return [clock.read() for clock in clocks if clock is not None]


def is_rebuilt(env: Any, times: list[float]) -> bool:  # noqa: ANN401 - an environment, of whatever form
    """Whether a copy of an environment has not the state of its original.

    Args:
        env: The copy.
        times: The `clock_times` of the original.
    """
    return any(map(_starts_again, _levels(env))) or clock_times(env) != times


def is_restored(env: Any, times: list[float]) -> bool:  # noqa: ANN401 - an environment, of whatever form
    """Whether a copy that was rebuilt has got the state of its original since, as its clocks show.

    Args:
        env: The copy.
        times: The `clock_times` of the original; a time of 0 shows nothing.
    """
    rebuilt = [level for level in _levels(env) if _starts_again(level)]
    have_clocks = all(clock_of(level) is not None for level in rebuilt)
    return have_clocks and all(times) and clock_times(env) == times


def _starts_again(level: Any) -> bool:  # noqa: ANN401
    """Whether copying calls the constructor again."""
    return getattr(type(level), "__setstate__", None) is EzPickle.__setstate__


def _levels(env: Any, seen: set[int] | None = None) -> Iterator[Any]:  # noqa: ANN401
    """Yield an environment, its wrappers, and the environments that they hold."""
    seen = set() if seen is None else seen
    if id(env) in seen:
        return
    seen.add(id(env))
    yield env
    held: dict[str, Any] = getattr(env, "__dict__", {})
    inside = [
        value
        for name, value in held.items()
        # Environments of PettingZoo have no common base.
        if isinstance(value, gym.Env | VectorEnv) or name in {"env", "aec_env"}
    ]
    if isinstance(env, SyncVectorEnv):
        inside += env.envs
    for each in inside:
        yield from _levels(each, seen)
