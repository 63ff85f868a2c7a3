"""Wrappers that count episodes inside of a monitor: their books when the monitor ends one.

Stable-Baselines3's ``Monitor`` and Gymnasium's ``RecordEpisodeStatistics`` write
``info["episode"]`` when the environment inside of them ends an episode. They do not see that a
wrapper around them ends it, and then those who read the books wait for ever (``evaluate_policy``)
or miss the episode (``ep_info_buffer``). So they are shown the last step once more, with the flags
that the learner sees.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym

__all__ = ["Books"]


class Books:
    """The wrappers inside of an environment that count episodes.

    Args:
        env: The environment, with its wrappers.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._keepers: list[tuple[Any, Any]] = []
        while isinstance(env, gym.Wrapper):
            attributes, forget = _KEEPERS.get(type(env).__name__, ((), None))
            if forget is not None and all(hasattr(env, name) for name in attributes):
                self._keepers.insert(0, (env, forget))  # the innermost first, as in a step
            env = env.env

    def close(self, terminated: bool, truncated: bool, info: dict[str, Any]) -> None:  # noqa: FBT001 - as Gymnasium has them
        """Completes the books of an episode that the environment itself has not ended.

        Adds what they say, ``"episode"``, to the info.
        """
        for keeper, forget in self._keepers:
            inside = keeper.env
            keeper.env = _LastStep(forget(keeper), terminated, truncated, info)
            try:
                *_, said = keeper.step(None)
            finally:
                keeper.env = inside
            info.update(said)


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


_KEEPERS: dict[str, tuple[tuple[str, ...], Callable[[Any], float]]] = {
    "Monitor": (("rewards", "total_steps"), _forget_in_monitor),
    "RecordEpisodeStatistics": (("episode_lengths",), _forget_in_statistics),
}
"""By the name of its class, the attributes of a wrapper that counts, and what forgets a step."""
