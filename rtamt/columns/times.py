"""Times by the values of a column."""

from __future__ import annotations

import math
import re
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt.columns.names import (
    ABSCISSAS,
    CLOCKS,
    HINTS,
    INDEX,
    NANOSECONDS,
    QUANTITIES,
    UNIT_OF,
    calendar_unit,
    read_name,
    unit_of_times,
    word_set,
)

_FINEST, _COARSEST = 5e-5, 100.0
"""The shortest and the longest usual step of a plausible unit, in seconds."""

_FIRST_DATE, _LAST_DATE, _LONGEST = 9.4e8, 4.2e9, 1e8
"""Seconds since 1970 in the years 2000 and 2100, and the longest time since a start."""

_FEW = 4
"""The minimum number of values for a decision without a name; one less with exactly even steps."""


def median(values: NDArray[Any]) -> float:
    """Return the median of doubles, as NumPy does, which is slow for a few."""
    n = len(values)
    if not 0 < n <= _SHORT:
        return float(np.median(values))
    ordered = np.sort(values)
    if math.isnan(ordered[-1]):  # nan comes last
        return math.nan
    middle = n // 2
    return float(ordered[middle] if n % 2 else (ordered[middle - 1] + ordered[middle]) / 2)


_SHORT = 10_000
"""The values up to which sorting is faster."""


def plausible_units(values: NDArray[Any]) -> list[str]:
    """Return the units in which times would have a plausible usual step, the likeliest first.

    Plausible steps are 50 µs to 100 s long; fractions below 1 are fractions of seconds. Times count
    from a start, or from 1970; units that give dates of this century exclude others.

    Example:
        >>> plausible_units(np.array([0.0, 0.01])), plausible_units(np.array([0, 10, 20]))
        (['s'], ['s', 'ms'])
    """
    with np.errstate(over="ignore"):
        step = median(np.abs(np.diff(values).astype(np.float64)))
    most = float(np.abs(values.astype(np.float64)).max())
    parts = values.dtype.kind == "f" and bool((values % 1).any())
    dates, durations = [], []
    for unit in ("s", "ms", "us", "ns"):
        scale = NANOSECONDS[unit] / 1e9
        if not _FINEST <= step * scale <= _COARSEST or (parts and unit in ("us", "ns")):
            continue
        if parts and step < 1 and unit == "ms":
            continue
        if _FIRST_DATE <= most * scale <= _LAST_DATE:
            dates.append(unit)
        elif most * scale <= _LONGEST:
            durations.append(unit)
    return dates or durations


def looks_like_times(column: str, values: NDArray[Any], *, first: bool) -> bool:
    """Return whether a column is probably a column of times, by its name and its values.

    A name such as ``hour`` or ``day`` needs numbers that change. A name with a word such as
    ``clock`` or with a unit of time needs values that rise, or fall. Any other name needs values
    that rise in nearly even steps and, after the first column, dates since 1970 or steps that are
    even up to rounding. The first column may fall, too. Counters and other quantities are not
    times unless their name has a word such as ``time``. Numbers 0, 1, 2 and so on count rows.

    Example:
        >>> steady = np.arange(6) * 0.25
        >>> [looks_like_times(name, steady, first=True) for name in ("clk", "A", "odometer")]
        [True, True, False]
    """
    if values.dtype.kind not in "iuf" or len(values) < 2:
        return False
    if not np.isfinite(values.astype(np.float64)).all():
        return False
    if calendar_unit(column) is not None and (values != values[0]).any():
        return True
    name = read_name(column)
    unit = None if name.unit is None else UNIT_OF.get(name.unit.lower())
    hinted = bool(HINTS & {*name.words}) or unit is not None
    with np.errstate(over="ignore"):
        steps = np.diff(values).astype(np.float64)
    if (hinted or first) and (steps < 0).all():  # the newest first
        values, steps = values[::-1], -steps[::-1]
    dated = hinted and dates_of_numbers(values) is not None
    if not (steps > 0).all() or ((steps == 1).all() and not dated):
        return False
    if name.words in ABSCISSAS or unit_of_times(column) is not None:
        return True
    quantity = bool(QUANTITIES & {*name.words}) or (name.unit is not None and unit is None)
    if INDEX.fullmatch(column):
        first, quantity = True, not (values % 1).any()
    if hinted and (dated or not quantity):
        return True
    if quantity and not hinted:
        return False
    clock = unit is not None or bool(CLOCKS & {*name.words})
    whole = clock or not quantity
    return _ticks(values, steps, rough=clock or (first and whole), whole=whole)


def _ticks(values: NDArray[Any], steps: NDArray[np.float64], *, rough: bool, whole: bool) -> bool:
    """Return whether values rise in nearly even steps.

    Unless ``rough``, they are dates or the steps are even up to rounding. Unless ``whole``, numbers
    without fractions are not times either.
    """
    usual = median(steps)
    off = np.abs(steps - usual)
    exact = rough and bool((off <= 1e-6 * usual).all())
    if len(values) < _FEW - exact or float((off <= 0.2 * usual).mean()) < 0.9:
        return False
    most = float(values[-1])
    dates = any(
        _FIRST_DATE <= most * NANOSECONDS[unit] / 1e9 <= _LAST_DATE
        for unit in plausible_units(values)
    )
    fractions = bool((values % 1).any())
    even = bool((off <= (0.02 * usual if fractions else max(0.02 * usual, 1))).all())
    return rough or dates or (even and (whole or fractions))


_PERIODS = word_set(
    "dt deltat tsample sampletime samplingtime sampleperiod samplingperiod sampleinterval "
    "samplinginterval timestep stepsize deltax xincrement xincr xinc horizontalinterval abtastzeit"
)
_RATES = word_set(
    "fs fps samplerate samplingrate samplefrequency samplingfrequency samplefreq samplingfreq "
    "framerate abtastrate abtastfrequenz"
)


def stated_period(name: str, value: float, *, single: bool) -> Fraction | None:
    """Return the seconds between samples that a constant states by its name; None for others.

    Example:
        >>> stated_period("dt", 0.1, single=False), stated_period("Fs [kHz]", 2.0, single=True)
        (Fraction(1, 10), Fraction(1, 2000))
    """
    if not 0 < value < math.inf:
        return None
    words, inside = read_name(name)
    joined, exact = "".join(words), Fraction(repr(float(value)))
    if joined in _RATES:
        return 1 / (exact * (1000 if (inside or "").lower() == "khz" else 1))
    unit = UNIT_OF.get((inside or "s").lower())
    if len(words) > 1 and UNIT_OF.get(words[-1]) and "".join(words[:-1]) in _PERIODS:
        joined, unit = "".join(words[:-1]), UNIT_OF[words[-1]]
    if unit is None or not (joined in _PERIODS or (single and joined in ("ts", "period"))):
        return None
    return exact * NANOSECONDS[unit] / NANOSECONDS["s"]


_SERIAL_DAYS = ((3e4, 8e4), (7.2e5, 7.7e5), (2.44e6, 2.49e6))
"""Days of dates from 1982 on, as spreadsheets, MATLAB and astronomers count them."""

_DAY = 86400
_PARTS_OF_DAY = (0.01, 0.1, 0.5, 1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200)


def are_days(values: NDArray[Any]) -> bool:
    """Return whether numbers are probably days and parts of days, and hardly seconds.

    Their usual step is a usual number of seconds in days, and not a short decimal number of
    seconds. It is too short for seconds, or the numbers have the size of dates.

    Example:
        >>> are_days(45413.5 + np.arange(5) / 86400), are_days(45413.5 + np.arange(5) / 100)
        (True, False)
    """
    if values.dtype.kind != "f" or len(values) < 2 or not np.isfinite(values).all():
        return False
    low, high = float(values.min()), float(values.max())
    dates = any(begin <= low <= high <= end for begin, end in _SERIAL_DAYS)
    step = median(np.abs(np.diff(values))) if -_LONGEST < low <= high < _LONGEST else 0.0
    if step <= 0 or (step >= _FINEST and not dates):
        return False
    if step < _FINEST and dates:
        return True
    usual = min(_PARTS_OF_DAY, key=lambda seconds: abs(seconds - step * _DAY))
    if abs(usual - step * _DAY) > 0.01 * usual:
        return False
    digits = step / 10.0 ** math.floor(math.log10(step)) * 100
    return abs(digits - round(digits)) > 0.02


_DATE = re.compile(
    r"\d{1,4}[-./]\d{1,2}[-./]\d{1,4}([T, ]+\d{1,2}:\d\d.*)?|\d{1,2}:\d\d(:\d\d.*)?", re.ASCII
)


def is_date(text: str) -> bool:
    """Return whether a text looks like a date or a time of day in digits.

    Example:
        >>> is_date("2024-05-01T12:00Z"), is_date("12:00:01.5"), is_date("1.5")
        (True, True, False)
    """
    return _DATE.fullmatch(text.strip()) is not None


def dates_of_numbers(values: NDArray[Any]) -> NDArray[Any] | None:
    """Return the dates in numbers such as 20240501 or 20240501123000; None for others.

    Example:
        >>> dates_of_numbers(np.array([20240430, 20240501])).astype("datetime64[D]").tolist()
        [datetime.date(2024, 4, 30), datetime.date(2024, 5, 1)]
    """
    if values.dtype.kind not in "iuf" or not len(values):
        return None
    if values.dtype.kind == "f" and not (np.isfinite(values) & (values % 1 == 0)).all():
        return None
    low, high = float(values.min()), float(values.max())
    for digits in (8, 12, 14):
        scale = 10 ** (digits - 8)
        if not 19500101 * scale <= low <= high < 21010101 * scale:
            continue
        days, clock = np.divmod(values.astype(np.int64), scale)
        clock = clock * 10 ** (14 - digits)
        month, day = days // 100 % 100, days % 100
        hour, minute, second = clock // 10000, clock // 100 % 100, clock % 100
        if not ((month > 0) & (month < 13) & (hour < 24) & (minute < 60) & (second < 60)).all():
            return None
        months = ((days // 10000 - 1970) * 12 + month - 1).astype("datetime64[M]")
        dates = months.astype("datetime64[D]") + (day - 1)
        if (day < 1).any() or (dates.astype("datetime64[M]") != months).any():
            return None
        seconds = (hour * 3600 + minute * 60 + second).astype("timedelta64[s]")
        return np.asarray(dates.astype("datetime64[ns]") + seconds)
    return None


def are_clock_numbers(values: NDArray[Any]) -> bool:
    """Return whether numbers such as 115945 or 1159 are probably times of day without marks.

    Their steps are even as hours, minutes and seconds, and uneven as numbers.

    Example:
        >>> are_clock_numbers(np.array([115930, 115945, 120000])), are_clock_numbers(np.arange(90))
        (True, False)
    """
    if values.dtype.kind not in "iuf" or len(values) < 3:
        return False
    numbers = values.astype(np.float64)
    if not (np.isfinite(numbers).all() and (numbers >= 0).all() and (numbers < 240000).all()):
        return False
    steps = np.diff(numbers)
    if (steps <= 0).any() or float(np.ptp(steps)) <= 0.02 * float(steps.min()):
        return False
    remainder, low = np.divmod(numbers, 100)
    hours, middle = np.divmod(remainder, 100)
    clocks = [3600 * hours + 60 * middle + low] if (middle < 60).all() else []
    if (remainder < 24).all():
        clocks.append(60 * remainder + low)
    return any(
        (low < 60).all() and float(np.ptp(gaps)) <= 0.02 * float(gaps.min())
        for gaps in map(np.diff, clocks)
    )
