"""Environments that have a monitor: what it monitors, and the samples that it reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.reading import Reading, refuse_other
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.monitor import StlMonitor

__all__ = ["Tap", "monitor_of", "with_own_monitor"]


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
    signals: Mapping[str, SignalLike] | None,
    reading: Reading,
) -> tuple[Any, Mapping[str, SignalLike] | None, Reading]:
    """What `rtamt_gym.simulate` judges and how; without specifications what the monitor does.

    Args:
        monitor: The monitor of the environment, or None.
        specs: The specifications that are given, or None.
        signals: The signals that are given, or None.
        reading: The options that are given.

    Raises:
        InputError: If something else is given than the monitor has.
    """
    if monitor is None or specs is not None:
        return specs, signals, reading
    own: Judging = monitor.judging
    whose, way_out = (
        "the monitor of the environment",
        "leave it out, or give specifications with it",
    )
    if signals is not None and signals != own.signals:
        refuse_other("signals", own.signals, signals, whose, way_out)
    return own.specs, own.signals, reading.over(own.reading, whose, way_out)


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
        """The spec of the environment, without this wrapper: outer wrappers add theirs to it."""
        return self.env.spec
