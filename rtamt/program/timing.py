"""Periods and the bounds of intervals as exact numbers of samples."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable
from fractions import Fraction

import numpy as np

from rtamt.errors import InputTypeError, RtamtError, SpecificationError
from rtamt.language.interval import UNITS, Interval, decimal_text
from rtamt.language.table import Bounds

__all__ = ["MAX_WINDOW", "Period", "as_period", "samples", "seconds_text"]

MAX_WINDOW = 2**31
"""The greatest bound in samples."""

Period = str | float | Fraction | np.floating
"""Seconds as a number, or text with a unit: ``0.1``, ``"100ms"``."""

_TOLERANCE = Fraction(1, 10**12)
_DOUBLE = np.dtype(np.float64).itemsize


def as_period(period: Period | None) -> Fraction | None:
    """The period in seconds, exactly; None stays None.

    A float is taken for the simplest fraction within a relative 1e-12 of it, so that ``1 / 15`` and
    ``0.1`` are exact; a numpy float of less precision, for the simplest within that precision.

    Raises:
        SpecificationError: If it is not a positive, finite time.
        InputTypeError: If it is neither a number nor text.

    Example:
        >>> as_period("100ms"), as_period(0.1), as_period(1 / 15)
        (Fraction(1, 10), Fraction(1, 10), Fraction(1, 15))
    """
    if period is None:
        return None
    wrong = SpecificationError(
        f'expected a period greater than 0, in seconds or as text such as "100ms", got {period!r}'
    )
    if isinstance(period, str):
        digits = period.strip().rstrip("abcdefghijklmnopqrstuvwxyz")
        unit = period.strip()[len(digits) :] or "s"
        try:
            value = Fraction(digits.strip()) * UNITS[unit]
        except (ValueError, KeyError, ZeroDivisionError):
            raise wrong from None
    elif isinstance(period, numbers.Rational) and not isinstance(period, bool):
        value = Fraction(period)
    elif isinstance(period, numbers.Real) and not isinstance(period, bool):
        if not math.isfinite(period) or period <= 0:
            raise wrong
        near, within = Fraction(float(period)), _TOLERANCE
        if isinstance(period, np.floating) and period.itemsize < _DOUBLE:
            within = Fraction(float(np.finfo(type(period)).eps))
        value = _simplest(near * (1 - within), near * (1 + within))
    else:
        msg = f'expected a period in seconds or as text such as "100ms", got {period!r}'
        raise InputTypeError(msg)
    if value <= 0:
        raise wrong
    return value


def _simplest(low: Fraction, high: Fraction) -> Fraction:
    """The fraction of least denominator in [low, high], by continued fractions."""
    whole = math.ceil(low)
    if whole <= high:
        return Fraction(whole)
    rest = whole - 1
    return rest + 1 / _simplest(1 / (high - rest), 1 / (low - rest))


def seconds_text(value: Fraction) -> str:
    """Decimal text if there is one, else a quotient."""
    try:
        return decimal_text(value)
    except SpecificationError:
        return str(value)


def samples(
    interval: Interval | None,
    period: Fraction | None,
    unit: str,
    error: Callable[[str, str], RtamtError],
) -> Bounds:
    """The bounds of an interval in whole samples.

    Args:
        interval: The interval; None is [0, inf).
        period: Seconds between samples, or None: bounds without unit are samples.
        unit: The unit of bounds that name none.
        error: Makes an error from a reason and a hint; it adds the place in the text.

    Raises:
        SpecificationError: From ``error``, on a unit without a period, a bound that is no multiple
            of the period, or one beyond `MAX_WINDOW` samples.
    """
    if interval is None:
        return 0, None
    if period is None and interval.unit is not None:
        raise error(
            f"{interval} has a unit, but no period is known",
            "give period= in seconds or as text such as '100ms', or write bounds in samples",
        )
    unit = interval.unit or unit
    step = Fraction(1) if period is None else period / UNITS[unit]

    def count(bound: Fraction) -> int:
        steps = bound / step
        if steps.denominator == 1 and steps <= MAX_WINDOW:
            return int(steps)
        text = decimal_text(bound) if period is None else f"{decimal_text(bound)} {unit}"
        if steps > MAX_WINDOW:
            raise error(
                f"bound {text} is {math.ceil(steps)} samples; the limit is {MAX_WINDOW}",
                "write a smaller bound or a longer period",
            )
        low, high = (n * step for n in (math.floor(steps), math.ceil(steps)))
        if period is None:
            raise error(
                f"bound {text} is not a whole number of samples",
                f"use {low} or {high}, or give period= for bounds in time",
            )
        finer = Fraction(
            math.gcd(bound.numerator * step.denominator, step.numerator * bound.denominator),
            bound.denominator * step.denominator,
        )
        raise error(
            f"bound {text} is not a multiple of the period "
            f"{seconds_text(period)} s ({float(steps):g} steps)",
            f"use {seconds_text(low)} {unit} or {seconds_text(high)} {unit}, "
            # Not another period=: one that is not that of the data gives wrong bounds silently.
            f"or take samples {seconds_text(finer * UNITS[unit])} s apart",
        )

    begin = count(interval.begin)
    return begin, None if interval.end is None else count(interval.end)
