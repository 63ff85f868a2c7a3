"""Environments that have a monitor, and what it monitors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.reading import Reading, refuse_other
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.monitor import StlMonitor

__all__ = ["monitor_of", "with_own_monitor"]


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
