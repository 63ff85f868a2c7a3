"""Environments that have a monitor: what it monitors, and the samples that it reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from rtamt import InputError
from rtamt_gym.wrappers.monitor import StlMonitor

__all__ = ["DEFAULTS", "Tap", "monitor_of", "with_own_monitor"]

DEFAULTS: Final[Mapping[str, Any]] = {
    "view": "episode",
    "nan": "raise",
    "semantics": "standard",
    "at_truncation": "cut",
}
"""The options that are not None where nobody gives them."""


def monitor_of(env: Any) -> StlMonitor[Any, Any] | None:  # noqa: ANN401 - any system
    """The monitor of an environment, which may have wrappers around it; None if there is none."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, StlMonitor):
            return env
        env = env.env
    return None


def with_own_monitor(
    monitor: Any,  # noqa: ANN401 - of one environment, or of many
    specs: Any,  # noqa: ANN401
    options: Mapping[str, Any],
) -> tuple[Any, dict[str, Any]]:
    """Specifications and options of `rtamt_gym.simulate`; without specifications the monitor's.

    Args:
        monitor: The monitor of the environment, or None.
        specs: The specifications that are given, or None.
        options: The options that are given.

    Raises:
        InputError: If an option is given that the monitor has of its own.
    """
    if monitor is None or specs is not None:
        return specs, {**options}
    own = dict(monitor.judging)
    for name, value in options.items():
        if name in own and value not in (DEFAULTS.get(name), own[name]):
            raise InputError(
                f"{name}= comes from the monitor of the environment, which has {own[name]!r}, got "
                f"{value!r}; leave it out, or give specifications with it"
            )
    return own.pop("specs"), {**options, **own}


class Tap(gym.Wrapper[Any, Any, Any, Any]):
    """Stands between a monitor and its environment, and keeps what the monitor is shown.

    Attributes:
        seen: Observation, action, reward and info of the last step; at a reset action and reward
            are None.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.seen: tuple[Any, Any, Any, Any] = None, None, None, {}

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
        obs, info = self.env.reset(**options)
        self.seen = obs, None, None, info
        return obs, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:  # noqa: ANN401
        result = self.env.step(action)
        self.seen = result[0], action, result[1], result[4]
        return result

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # as Gymnasium's wrappers do
        """That of the environment: wrappers around this one keep theirs."""
        return self.env.spec
