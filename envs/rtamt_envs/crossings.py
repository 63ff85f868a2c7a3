"""The first crossing of a level by a polynomial, for the guards of hybrid models.

numba stores compiled code until the file of its function changes: after a change here, touch the
files of the models that use it.
"""

from __future__ import annotations

from rtamt_envs.compiled import compiled
from rtamt_envs.scenario import Floats

_FINEST = 2.0**-30  # beside an extremum, intervals this short differ from their ends by rounding


@compiled
def _at(polynomial: Floats, length: int, at: float) -> tuple[float, float]:
    """Return the value of a polynomial and its slope."""
    value, slope = 0.0, 0.0
    for power in range(length - 1, -1, -1):
        slope = slope * at + value
        value = value * at + float(polynomial[power])
    return value, slope


@compiled
def _root(
    polynomial: Floats,
    length: int,
    level: float,
    low: float,
    at_low: float,
    high: float,
    at_high: float,
) -> float:
    """Return where a polynomial crosses a level, on a monotone interval with a crossing."""
    rising = at_high > level
    estimate = low + (high - low) * (level - at_low) / (at_high - at_low)
    for _ in range(100):
        value, slope = _at(polynomial, length, estimate)
        if (value > level) == rising:
            high = estimate
        else:
            low = estimate
        better = estimate - (value - level) / slope if slope != 0.0 else estimate
        if better == estimate:
            break
        if not low < better < high:
            better = 0.5 * (low + high)
            if not low < better < high:
                break
        estimate = better
    return estimate


@compiled
def first_crossing(polynomial: Floats, length: int, level: float, sign: float) -> float:
    """Return the first argument from 0 to 1 at which a polynomial reaches a level.

    A bound of the curvature shows where a crossing is possible, so none is missed, not even a
    touch. Newton's method within a bracket then finds it up to rounding.

    Args:
        polynomial: The coefficients, lowest power first.
        length: The number of coefficients that count.
        level: The level.
        sign: 1 to reach the level from above, -1 from below.

    Returns:
        The argument; 0 if the polynomial starts there or beyond, 2 if it does not reach the level.
    """
    bend = 0.0  # the maximum curvature
    for power in range(2, length):
        bend += power * (power - 1) * abs(float(polynomial[power]))
    low, width = 0.0, 1.0
    at_low = float(polynomial[0])
    if sign * (at_low - level) <= 0.0:
        return 0.0
    while low < 1.0:
        high = min(low + width, 1.0)
        at_high, slope = _at(polynomial, length, high)
        if min(sign * (at_low - level), sign * (at_high - level)) > bend * width * width / 8.0:
            low, at_low = high, at_high  # between its ends it is that much beyond its chord at most
            width *= 2.0
        elif abs(slope) > bend * width:  # monotone
            if sign * (at_high - level) <= 0.0:
                return _root(polynomial, length, level, low, at_low, high, at_high)
            low, at_low = high, at_high
        elif width > _FINEST:
            width *= 0.5
        elif sign * (at_high - level) <= 0.0:
            return high
        else:
            low, at_low = high, at_high
    return 2.0
