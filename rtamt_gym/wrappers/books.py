"""Wrappers that count episodes inside of a monitor: their books when the monitor ends one.

Stable-Baselines3's ``Monitor`` and Gymnasium's ``RecordEpisodeStatistics`` write
``info["episode"]`` when the environment inside of them ends an episode. They do not see that a
wrapper around them ends it, and then those who read the books wait for ever (``evaluate_policy``)
or miss the episode (``ep_info_buffer``). So they are shown the last step once more, with the flags
that the learner sees.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym

__all__ = ["Books", "counts_episodes"]


class Books:
    """The wrappers inside of an environment that count episodes.

    Args:
        env: The environment, with its wrappers.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._keepers: list[tuple[Any, _Kind]] = []
        while isinstance(env, gym.Wrapper):
            kind = _kind_of(env)
            if kind is not None:
                self._keepers.insert(0, (env, kind))  # the innermost first, as in a step
            env = env.env

    def close(self, terminated: bool, truncated: bool, info: dict[str, Any]) -> None:  # noqa: FBT001 - as Gymnasium has them
        """Completes the books of an episode that the environment itself has not ended.

        Adds what they say, ``"episode"``, to the info.
        """
        for keeper, kind in self._keepers:
            inside = keeper.env
            keeper.env = _LastStep(kind.forget(keeper), terminated, truncated, info)
            try:
                *_, said = keeper.step(None)
            finally:
                keeper.env = inside
            info.update(said)

    def pay(self, paid: float) -> None:
        """Corrects the return of the last episode in the books: what the learner was paid."""
        for keeper, kind in self._keepers:
            returns = getattr(keeper, kind.returns)
            if returns:  # a queue may be of length 0
                returns[-1] = paid


def counts_episodes(wrapper: object) -> bool:
    """Return whether a wrapper counts episodes and changes nothing else."""
    kind = _kind_of(wrapper)
    return kind is not None and type(wrapper).__name__ in _KINDS


def _kind_of(wrapper: object) -> _Kind | None:
    names = (each.__name__ for each in type(wrapper).__mro__)
    kind = next((_KINDS[name] for name in names if name in _KINDS), None)
    known = kind is not None and all(hasattr(wrapper, name) for name in kind.attributes)
    return kind if known else None


class _LastStep:
    """An environment whose step gives what the last step gave, with other flags."""

    def __init__(self, *result: Any) -> None:  # noqa: ANN401 - what step gives
        self._result = result

    def step(self, _action: object) -> tuple[Any, ...]:
        return None, *self._result


def _forget_in_monitor(monitor: Any) -> float:  # noqa: ANN401 - Stable-Baselines3 is not imported
    """Takes the last step out of the books of a ``Monitor``; returns its reward."""
    monitor.total_steps -= 1
    reward: float = monitor.rewards.pop()
    return reward


def _forget_in_statistics(statistics: gym.wrappers.RecordEpisodeStatistics[Any, Any]) -> float:
    """Takes the last step out of the statistics, but for its reward, which is in the sum."""
    statistics.episode_lengths -= 1
    return 0.0


class _Kind(NamedTuple):
    """A class of wrappers that count.

    Attributes:
        attributes: The names of attributes by which it is known.
        returns: The name of the sequence of the returns of episodes.
        forget: Takes the last step out of the books; returns the reward to be shown once more.
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
"""By the name of the class, or of one that it derives from."""
