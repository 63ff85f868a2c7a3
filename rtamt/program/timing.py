"""Periods and the bounds of intervals as exact numbers of samples."""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Literal, cast, get_args

import numpy as np

from rtamt.errors import (
    Advice,
    Argument,
    InputError,
    InputTypeError,
    Message,
    RtamtError,
    SpecificationError,
    alternatives,
    brief,
    is_one_of,
)
from rtamt.language.interval import UNITS, Interval, decimal_text, exact, is_decimal
from rtamt.language.operators import Bounds

MAX_WINDOW = 2**31
"""The largest bound in samples."""

Period = str | float | Fraction | np.floating
"""Seconds as a number, or text with a unit: ``0.1``, ``"100ms"``."""

Align = Literal["outward", "inward", "nearest"]
"""How a bound between two samples is rounded, whatever the operator and polarity.

``"outward"`` is the floor of the begin and the ceiling of the end, ``"inward"`` the reverse,
``"nearest"`` the nearest sample, or of two the one that widens the window.
"""

_TOLERANCE = Fraction(1, 10**12)
_GREATEST = 10**300  # of a period and of its inverse
_DOUBLE = np.dtype(np.float64).itemsize


def as_period(period: Period | None, what: str = "period") -> Fraction | None:
    """Return the period in seconds, exactly; None stays None.

    A float means the simplest fraction within a relative 1e-12 of it, so that ``1 / 15`` and
    ``0.1`` are exact; a numpy float of less precision, the simplest fraction within that precision.

    Example:
        >>> as_period("100ms"), as_period(0.1), as_period(1 / 15)
        (Fraction(1, 10), Fraction(1, 10), Fraction(1, 15))
    """
    if period is None:
        return None
    if isinstance(period, str):
        digits = period.strip().rstrip("abcdefghijklmnopqrstuvwxyz")
        unit = period.strip()[len(digits) :] or "s"
        try:
            value = exact(digits, f"a {what}") * UNITS[unit]
        except (SpecificationError, KeyError):
            raise _no_period(period, what) from None
    elif isinstance(period, numbers.Rational) and not isinstance(period, bool | np.timedelta64):
        value = Fraction(int(period.numerator), int(period.denominator))  # may be NumPy integers
    elif isinstance(period, numbers.Real) and not isinstance(period, bool | np.timedelta64):
        if not math.isfinite(period):
            raise _no_period(period, what)
        near, within = Fraction(float(period)), _TOLERANCE
        if isinstance(period, np.floating) and period.itemsize < _DOUBLE:
            within = Fraction(float(np.finfo(type(period)).eps))
        value = near if near <= 0 else simplest(near * (1 - within), near * (1 + within))
    else:
        msg = f'expected a {what} in seconds or as text such as "100ms", got {brief(period)}'
        raise InputTypeError(msg)
    top, bottom = value.numerator, value.denominator  # integers: fractions compare slowly
    if not (bottom <= top * _GREATEST and top <= bottom * _GREATEST):
        raise _no_period(period, what)
    return value


def _no_period(period: object, what: str) -> SpecificationError:
    text = period if isinstance(period, str) else ""
    rate = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(k?)hz\s*", text, re.IGNORECASE)
    hint = ""
    if rate and (hertz := float(rate[1]) * (1000 if rate[2] else 1)):
        hint = f"; {hertz:g} Hz is a {what} of {1000 / hertz:g}ms"
    return SpecificationError(
        f'expected a {what} from 1e-300 to 1e300 s, or text such as "100ms", got '
        f"{brief(period)}{hint}"
    )


def simplest(low: Fraction, high: Fraction) -> Fraction:
    """Return the fraction with the smallest denominator in [low, high], by continued fractions."""
    steps = math.ceil(low)
    if steps <= high:
        return Fraction(steps)
    remainder = steps - 1
    return remainder + 1 / simplest(1 / (high - remainder), 1 / (low - remainder))


def as_align(align: object) -> Align | None:
    """Return the way to round bounds, checked; None refuses bounds that do not fit."""
    if align is None:
        return None
    known = get_args(Align)
    if not is_one_of(align, known):
        msg = f"expected align=None, {alternatives(known)}, got {brief(align)}"
        raise InputError(msg)
    return cast("Align", align)


def seconds_text(value: Fraction) -> str:
    """Return decimal text if there is one; otherwise, a quotient."""
    try:
        return decimal_text(value)
    except SpecificationError:
        return str(value)


def samples(
    interval: Interval | None,
    period: Fraction | None,
    unit: str,
    error: Callable[[str, str], RtamtError],
    align: Align | None = None,
) -> Bounds:
    """Return the bounds of an interval in whole samples."""
    if interval is None:
        return 0, None
    if period is None and interval.unit is not None:
        raise error(
            f"{interval} has a unit, but no period is known",
            Message(
                "give ",
                Argument("period"),
                " in seconds or as text such as '100ms', or write bounds in samples",
            ),
        )
    unit = interval.unit or unit
    step = _step(period, unit)

    def count(bound: Fraction, rounded: Callable[[Fraction], int] | None) -> int:
        steps = bound / step
        if rounded is not None and steps <= MAX_WINDOW:
            return rounded(steps)
        if steps.denominator == 1 and steps <= MAX_WINDOW:
            return int(steps)
        text = decimal_text(bound) if period is None else f"{decimal_text(bound)} {unit}"
        if steps > MAX_WINDOW:
            raise error(
                f"bound {text} is {math.ceil(steps)} samples; the limit is {MAX_WINDOW}",
                "write a smaller bound or a longer period",
            )
        raise _misfit(bound, text, step, None if period is None else unit, error)

    rounds_begin, rounds_end = _ROUNDINGS[align] if align is not None else (None, None)
    begin = count(interval.begin, rounds_begin)
    end = None if interval.end is None else count(interval.end, rounds_end)
    if end is not None and end < begin:
        raise error(
            Message(
                Argument("align", "inward"), f" leaves no sample of {interval}: none lies in it"
            ),
            Message(
                "write a wider interval, take samples closer together, or use ",
                Argument("align", "outward"),
                " or 'nearest'",
            ),
        )
    return begin, end


def alignment(
    interval: Interval | None, period: Fraction | None, unit: str, bounds: Bounds
) -> str | None:
    """Return a text such as ``[0:0.25] is samples 0 to 3, [0:0.3s]``; None if it fits exactly."""
    if interval is None:
        return None
    unit = interval.unit or unit
    step = _step(period, unit)
    begin, end = bounds[0] * step, None if bounds[1] is None else bounds[1] * step
    if (begin, end) == (interval.begin, interval.end):
        return None
    first, last = bounds[0], "inf" if bounds[1] is None else bounds[1]
    became = f"{interval} is samples {first} to {last}"
    if period is None:
        return became
    times = (seconds_text(begin), "inf" if end is None else seconds_text(end))
    return f"{became}, {times[0]} to {times[1]} {unit}"


def _step(period: Fraction | None, unit: str) -> Fraction:
    """Return the time between samples, in the unit of the bounds."""
    return Fraction(1) if period is None else period / UNITS[unit]


_ROUND = Advice(", or let ", Argument("align"), " round it")


def _misfit(
    bound: Fraction,
    text: str,
    step: Fraction,
    unit: str | None,
    error: Callable[[str, str], RtamtError],
) -> RtamtError:
    """Return the error about a bound that is not a whole number of samples."""
    steps = bound / step
    low, high = (n * step for n in (math.floor(steps), math.ceil(steps)))
    if unit is None:
        return error(
            f"bound {text} is not a whole number of samples",
            Message(
                f"use {low} or {high}",
                Advice(", give ", Argument("period"), " for bounds in time"),
                _ROUND,
            ),
        )
    finer = Fraction(
        math.gcd(bound.numerator * step.denominator, step.numerator * bound.denominator),
        bound.denominator * step.denominator,
    )
    return error(
        f"bound {text} is not a multiple of the period "
        f"{seconds_text(step * UNITS[unit])} s ({float(steps):g} steps)",
        Message(
            f"use {_writable(low, unit)} or {_writable(high, unit)}, "
            # Not another period=: where the data has a different one, bounds are silently wrong.
            f"take samples {seconds_text(finer * UNITS[unit])} s apart",
            _ROUND,
        ),
    )


def _writable(time: Fraction, unit: str) -> str:
    """Return a time with its unit; in seconds if no decimal number of minutes or hours is exact."""
    if not is_decimal(time) and is_decimal(time * UNITS[unit]):
        time, unit = time * UNITS[unit], "s"
    return f"{seconds_text(time)} {unit}"


def _nearest_below(steps: Fraction) -> int:
    """Return the nearest whole number, the smaller at equal distance."""
    return math.ceil(steps - Fraction(1, 2))


def _nearest_above(steps: Fraction) -> int:
    """Return the nearest whole number, the larger at equal distance."""
    return math.floor(steps + Fraction(1, 2))


# How the begin and the end of an interval are rounded.
_ROUNDINGS: Mapping[Align, tuple[Callable[[Fraction], int], Callable[[Fraction], int]]] = {
    "outward": (math.floor, math.ceil),
    "inward": (math.ceil, math.floor),
    "nearest": (_nearest_below, _nearest_above),
}
