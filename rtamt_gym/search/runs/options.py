"""What a runner is given: its system, and the longest duration of a run."""

from __future__ import annotations

import math
from collections.abc import Iterator

from gymnasium.vector import VectorEnv

from rtamt import InputTypeError, Period
from rtamt_gym.judging.reading import seconds_of
from rtamt_gym.simulation.systems import Environment, System

__all__ = ["check_system", "duration_of"]


def check_system(system: object) -> None:
    """Refuses a system that is not the same a second time, or that is many."""
    if isinstance(system, Iterator) or type(system).__name__ == "StepMonitor":
        raise InputTypeError(
            "expected a system that starts anew for each case, such as the id of an environment, "
            f"a pair (model, data) or a function, got {system!r}"
        )
    if isinstance(system, VectorEnv):
        raise InputTypeError(
            f"expected one environment, or its id, got {system}; lanes are made of it where it has "
            "them"
        )
    if isinstance(system, str) and system.endswith(".fmu"):
        raise InputTypeError(
            f"expected a system to run, got the name of a file; write Fmus({system!r})"
        )


def duration_of(ran: System, duration: float | None, period: Period | None) -> float | None:
    """The longest duration of a run: that which is given, or the time limit of an environment."""
    if duration is not None:
        return None if duration == math.inf else duration
    if not isinstance(ran, Environment) or ran.limit is None:
        return None
    step = seconds_of(ran.period if period is None else period)
    return None if step is None else float(step * ran.limit)
