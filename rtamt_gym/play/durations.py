"""The number of steps at which the duration of a run ends it."""

from __future__ import annotations

import math
from fractions import Fraction

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_number
from rtamt_gym.checks.numbers import exact


def step_limit(
    duration: float | None, period: Fraction | None, system: str, *, endless: bool = False
) -> int | None:
    """Return the number of steps at which ``duration`` ends a run; None without an end.

    Args:
        duration: Seconds, ``math.inf`` or None.
        period: Seconds between samples; None if it is not known.
        system: The name of the system, for errors.
        endless: Whether the system may never end by itself.

    Raises:
        InputError: If an endless system has no duration; if the duration could count seconds or
            steps, since the period is not known; if it is shorter than a step.

    Example:
        >>> step_limit(0.3, Fraction(1, 10), "tank"), step_limit(None, None, "tank")
        (3, None)
    """
    if duration is None:
        if endless:
            raise InputError(
                f"{system} does not end by itself; give ",
                Argument("duration"),
                " in seconds, or ",
                Argument("duration", "inf", words="duration=math.inf"),
                " to run until it is stopped",
            )
        return None
    if duration == math.inf:
        return None
    duration = check_number("duration", duration)
    if period is None:
        raise InputError(
            Argument("duration", duration),
            f" can mean {duration:g} s or {duration:g} steps, since {system} does not say how long "
            "a step lasts; give ",
            Argument("period"),
            " in seconds, or ",
            Argument("period", 1),
            " if the duration, and every bound, counts steps",
        )
    steps = int(exact(duration) / period)  # a float may lie a little below a number of periods
    if steps == 0:
        number = f"{float(period):g}"
        in_milliseconds = (
            (", or ", Argument("period", f"{number}ms"), f" if a step lasts {number} ms")
            if period >= 1
            else ()
        )
        raise InputError(
            Argument("duration", duration),
            f" is shorter than a step of {number} s, so no step would be evaluated; give at least ",
            Argument("duration", float(period)),
            *in_milliseconds,
        )
    return steps
