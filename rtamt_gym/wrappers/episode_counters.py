"""Wrappers inside a monitor that count episodes, and the statistics that they report.

Stable-Baselines3's ``Monitor`` and Gymnasium's ``RecordEpisodeStatistics`` write
``info["episode"]`` when the environment inside them ends an episode. If a wrapper around them ends
it, readers of these statistics wait forever (``evaluate_policy``) or miss the episode
(``ep_info_buffer``). Therefore the monitor repeats the last step for them, with the flags that the
learner sees. They count the rewards of the environment; a reward wrapper replaces the return by its
own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from rtamt_gym.judging.infos import key_mask
from rtamt_gym.signals.columns import Entries, Floats


class EpisodeCounters:
    """The wrappers inside a monitor that count episodes."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._counters: list[tuple[Any, _Kind]] = []
        while isinstance(env, gym.Wrapper):
            kind = _kind_of(env)
            if kind is not None:
                self._counters.insert(0, (env, kind))  # the innermost first, as in a step
            env = env.env

    def close(self, terminated: bool, truncated: bool, info: dict[str, Any]) -> None:  # noqa: FBT001 - as Gymnasium has them
        """Count an episode that the environment itself has not ended; add its statistics."""
        for counter, kind in self._counters:
            inside = counter.env
            counter.env = _LastStep(kind.forget(counter), terminated, truncated, info)
            try:
                *_, last = counter.step(None)
            finally:
                counter.env = inside
            info.update(last)

    def put_return(self, info: dict[str, Any], paid: float) -> None:
        """Replace the return of the last episode, in its info and in the counters."""
        episode = _statistics(info)
        if episode is None:
            return
        info["episode"] = _with_return(episode, np.float64(paid))
        for counter, kind in self._counters:
            returns = getattr(counter, kind.returns)
            if returns:  # a queue may be of length 0
                returns[-1] = paid


def put_returns(infos: dict[str, Any], paid: Floats, ended: Entries) -> None:
    """Replace the returns of the environments that ended in their last infos."""
    episode = _statistics(infos)
    if episode is None:
        return
    num = len(ended)
    counted = ended & key_mask(infos, "episode", num) & key_mask(episode, "r", num)
    returns = np.array(episode["r"], np.float64)
    returns[counted] = paid[counted]
    infos["episode"] = statistics = _with_return(episode, returns)
    if "_r" in episode:
        statistics.setdefault("_r_env", episode["_r"])


def counts_episodes(wrapper: object) -> bool:
    """Return whether a wrapper counts episodes and changes nothing else."""
    return _kind_of(wrapper) is not None and type(wrapper).__name__ in _KINDS


def _statistics(infos: dict[str, Any]) -> dict[str, Any] | None:
    episode = infos.get("episode")
    return episode if isinstance(episode, dict) and "r" in episode else None


def _with_return(episode: dict[str, Any], paid: Any) -> dict[str, Any]:
    # A copy: the wrapper that made the statistics may keep them.
    return {**episode, "r": paid, "r_env": episode.get("r_env", episode["r"])}


class _LastStep:
    """An environment with a step that repeats the last step with other flags."""

    def __init__(self, *result: Any) -> None:
        self._result = result

    def step(self, _action: object) -> tuple[Any, ...]:
        return None, *self._result


def _forget_in_monitor(monitor: Any) -> float:
    monitor.total_steps -= 1
    reward: float = monitor.rewards.pop()
    return reward


def _forget_in_statistics(statistics: gym.wrappers.RecordEpisodeStatistics[Any, Any]) -> float:
    statistics.episode_lengths -= 1
    return 0.0  # the reward is in the sum already


class _Kind(NamedTuple):
    """A class of wrappers that count episodes.

    It is known by its ``attributes``; ``returns`` is the attribute with the returns of episodes.
    ``forget`` removes the last step from the counts, and returns its reward for the repetition.
    """

    attributes: tuple[str, ...]
    returns: str
    forget: Callable[[Any], float]


_KINDS = {
    "Monitor": _Kind(
        ("rewards", "total_steps", "episode_returns"), "episode_returns", _forget_in_monitor
    ),
    "RecordEpisodeStatistics": _Kind(
        ("episode_lengths", "return_queue"), "return_queue", _forget_in_statistics
    ),
}
"""The kinds by the name of the class or of a base class."""


def _kind_of(wrapper: object) -> _Kind | None:
    names = (base.__name__ for base in type(wrapper).__mro__)
    kind = next((_KINDS[name] for name in names if name in _KINDS), None)
    known = kind is not None and all(hasattr(wrapper, name) for name in kind.attributes)
    return kind if known else None
