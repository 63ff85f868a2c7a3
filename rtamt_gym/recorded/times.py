"""Times of a recording: in seconds, as a grid with a period, and one record for each instant."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.columns import (
    are_clock_numbers,
    are_days,
    calendar_unit,
    dates_of_numbers,
    hinted_unit,
    median,
    name_words,
    plausible_units,
    unit_of_times,
)
from rtamt_gym.recorded.columns import NEAR, UNITS, Columns, SameTime
from rtamt_gym.recorded.recording import Floats, RawTimes, Rows
from rtamt_gym.tables import counted, number

TIME = "time"
"""The column with the time of a sample or an event that is taken where several have times."""

_FEW = 100

_UNEVEN, _MOSTLY = 0.2, 0.9
"""The part of the usual step by which the given part of all steps of a regular log may differ."""

_ABSURD_STEP, _ABSURD_TIME = 1e3, 1e11
"""Seconds between samples, and since 1970 or a start, from which on a number of unknown unit is no
number of seconds: samples of 1 kHz in ns are 10^6 apart, a date in ms is above 10^12."""

_COARSE, _LONG_AFTER = 10.0, (1e7, 3e8)
"""Whole numbers that are so far apart are no seconds months after a start and before any date."""


DATE_NAMES = {"date", "datum", "fecha", "utcdate", "localdate"}


def join_times(times: RawTimes, part: RawTimes, unit: str, where: Callable[[int], str]) -> RawTimes:
    """Return seconds with parts of seconds as whole nanoseconds."""
    seconds = times.astype(np.int64)
    parts = part.astype(np.int64)
    most = UNITS["s"] // UNITS[unit]
    wrong = (seconds != times) | (parts != part) | (parts < 0) | (parts >= most)
    if wrong.any():
        index = int(wrong.argmax())
        raise InputError(
            f"{where(index)}: expected whole seconds and from 0 to {most - 1} {unit}, got "
            f"{times[index]} and {part[index]}; name one column of times with --time"
        )
    return seconds * UNITS["s"] + parts * UNITS[unit]


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """Times in seconds.

    Attributes:
        column: The name of the column.
        since: Seconds since the first time, exact for integers and dates before they are rounded.
        start: The first time in seconds; 0 for dates, because their origin is not a time of the
            trace.
        precision: The largest rounding error of a time, in seconds.
        certain: Whether an option, the format or a name states the unit.
        step: The distance of samples that the format states. Otherwise, the distance of neighbours
            if all are equal and the times are whole numbers.
        decided: The unit that a name and the usual step decided together; empty if they did not.
        readings: The units in which the usual step would be plausible, if none is certain and
            seconds are not.
        absurd: Whether the unit is not certain, and the times can hardly be seconds.
        unit: The nanoseconds in a unit of the column; 1 for dates.
    """

    column: str
    since: Floats
    start: float
    precision: float
    certain: bool
    step: Fraction | None = None
    decided: str = ""
    readings: Sequence[str] = ()
    absurd: bool = False
    unit: int = 1

    @staticmethod
    def of(rows: Rows, column: str, columns: Columns) -> TimeAxis:
        """Return the times of the rows of a recording."""
        raw = rows.times
        assert raw is not None, "the column was read"  # noqa: S101 - for mypy
        if raw.dtype.kind == "f":
            raw = raw.astype(np.float64)
        wrong = np.isnat(raw) if raw.dtype.kind in "mM" else ~np.isfinite(raw)
        if wrong.any():
            index = int(wrong.argmax())
            raise InputError(
                f"{rows.where(index)}, column '{column}': expected a finite number, got "
                f"{raw[index]}"
            )
        unit_name, decided = stated_unit(column, rows.unit, columns), ""
        if not unit_name and (dates := dates_of_numbers(raw)) is not None:
            if not {*name_words(column)} & DATE_NAMES:
                shown = dates[0].astype("datetime64[s]")
                raise InputError(
                    f"{rows.where(0)}, column '{column}': {int(raw[0])} may be a date without "
                    f"marks or a number of seconds. Write dates as {shown}, or give --time-unit s."
                )
            raw = dates
        if not unit_name:
            _check_no_clock(raw, f"{rows.where(0)}, column '{column}'")
        if raw.dtype.kind in "mM":
            nanoseconds = raw.astype(f"{raw.dtype.kind}8[ns]").astype(np.int64)
            start = 0.0 if raw.dtype.kind == "M" else float(nanoseconds[0] / 1e9)
            step = _step(nanoseconds, 1)
            return TimeAxis(
                column, (nanoseconds - nanoseconds[0]) / 1e9, start, 1e-9, certain=True, step=step
            )
        unit_name = unit_name or calendar_unit(column) or ""
        if unit_name and unit_name not in UNITS:
            raise InputError(
                f"{rows.source}, column '{column}': expected a unit of time, got {unit_name!r}; "
                f"give the unit with --time-unit ({', '.join(UNITS)})"
            )
        readings: Sequence[str] = ()
        absurd = not unit_name and len(raw) > 1 and _absurd(raw)
        if absurd:
            readings = plausible_units(raw)
            if column == "%time" and raw.dtype.kind != "f" and "ns" in readings:
                unit_name = decided = "ns"  # rostopic writes nanoseconds
        unit = UNITS[unit_name or "s"]
        with np.errstate(over="ignore"):  # `check_distances` refuses these times
            since = in_seconds(raw - raw[0], unit)
        most = float(np.abs(raw).max())
        ulp = math.ulp(most) if raw.dtype.kind == "f" else 0.0
        start = float(in_seconds(raw[:1], unit)[0])
        precision = max(ulp * unit / 1e9, math.ulp(float(np.abs(since).max())))
        step = rows.step if columns.time_unit in (None, rows.unit or "s") else None
        step = step or (None if raw.dtype.kind == "f" else _step(raw, unit))
        certain = bool(unit_name)
        return TimeAxis(
            column, since, start, precision, certain, step, decided, readings, absurd, unit
        )

    @property
    def seconds(self) -> Floats:
        """The times in seconds."""
        return self.start + self.since

    def check_distances(self, rows: Rows) -> None:
        """Check that each time has a finite distance to the first."""
        far = ~np.isfinite(self.since)
        if far.any():
            raw, index = rows.times, int(far.argmax())
            assert raw is not None, "the column was read"  # noqa: S101 - for mypy
            raise InputError(
                f"{rows.where(index)}, column '{self.column}': expected times at finite distances, "
                f"got {raw[index]} after {raw[0]}; --period reads samples and ignores the column"
            )

    def check_unit(self, where: str) -> None:
        """Check that times of an unstated unit can be seconds."""
        if self.certain or not self.absurd or len(self.since) < 2:
            return
        usual = median(np.abs(np.diff(self.since)))
        most = max(abs(self.start), abs(self.start + float(self.since[-1])))
        got = f"{usual:.6g} s apart"
        if most >= _ABSURD_TIME and usual < _ABSURD_STEP:
            got = f"{most:.6g} s, a time after the year 5000"
        readings = [f"{usual * UNITS[unit] / UNITS['s']:.6g} s as {unit}" for unit in self.readings]
        read = f" ({' or '.join(readings)})" if readings else ""
        raise InputError(
            f"{where}: expected times in seconds in the column '{self.column}', got {got}{read}; "
            "give the unit with --time-unit, such as ns, ms or s"
        )

    def check_order(
        self,
        where: Callable[[int], str],
        rows: NDArray[np.intp] | None = None,
        subject: str = "",
    ) -> None:
        """Check that times, or the times of some rows, do not decrease; times may repeat."""
        since = self.since if rows is None else self.since[rows]
        with np.errstate(over="ignore"):
            back = np.diff(since) < 0
            if back.any():
                back &= ~same_as_before(since)
        if not back.any():
            return
        rows = np.arange(len(self.since)) if rows is None else rows
        index = int(back.argmax())
        position = f"{where(int(rows[index + 1]))}: expected times{subject} that increase"
        late, before = self.text(int(rows[index + 1])), self.text(int(rows[index]))
        if newest_first(since):
            raise InputError(
                f"{position}, got the newest first, {before} before {late}. Sort the rows by "
                f"'{self.column}', the oldest first."
            )
        raise InputError(
            f"{position}, got {late} after {before}. Sort the rows by '{self.column}', or cut the "
            "file where a recording starts again."
        )

    @property
    def unit_note(self) -> str:
        """The note of `note_of_unit` on these times."""
        return self.note_of_unit(float(self.since[-1]))

    @property
    def unit_doubt(self) -> str:
        """The reason to doubt the unit of a period from these times; empty without a doubt."""
        note = "" if self.decided else self.unit_note
        return note and f"{note}; if seconds, --time-unit s"

    def note_of_unit(self, length: float) -> str:
        """Return a note on a unit that was decided, or on times that may be milliseconds.

        Times of an unstated unit may be milliseconds if they are at least 1 apart, and are whole
        numbers or have nearly even steps. The text is empty if there is nothing to note.
        """
        if self.decided:
            usual = median(np.abs(np.diff(self.since)))
            return (
                f"the times in the column '{self.column}' count as {self.decided}, a sample every "
                f"{usual:.6g} s; --time-unit states another unit"
            )
        if self.certain or len(self.since) < 2:
            return ""
        if not (np.diff(self.since[:_FEW]) >= 1).all():  # a few times usually decide
            return ""
        steps = np.diff(self.since)
        if not (steps >= 1).all():
            return ""
        usual = median(steps)
        even = float((np.abs(steps - usual) <= _UNEVEN * usual).mean()) >= _MOSTLY
        if (steps % 1).any() and not ((usual % 1) and even):
            return ""
        return (
            f"the times have no unit and count as seconds, {number(length)} s in all: if these are "
            "milliseconds, --time-unit ms"
        )

    def text(self, at: int) -> str:
        """Return the time of a row in seconds, since the first row if the time is long."""
        if abs(self.start) < 1e6:
            return f"{self.start + self.since[at]:.15g}"
        return f"{self.since[at]:.15g} s since the first"


def stated_unit(column: str, unit: str, columns: Columns) -> str:
    """Return the unit of times that an option, the format or the name of the column states."""
    named = unit_of_times(column) or unit_of_times(re.split(r"[./]", column)[-1])
    return columns.time_unit or unit or named or hinted_unit(column) or ""


def rises(times: NDArray[Any]) -> bool:
    """Return whether the times increase."""
    return bool((times[1:] > times[:-1]).all())


def newest_first(since: Floats) -> bool:
    """Return whether times decrease from the first row to the last."""
    later, before = since[1:], since[:-1]
    return len(later) > 0 and bool((later <= before).all() and (later < before).any())


def _check_no_clock(raw: RawTimes, place: str) -> None:
    """Raise InputError if numbers may be days or times of day instead of seconds."""
    for phrase, doubtful, advice in (
        (
            "a date, as the number of days in spreadsheets and MATLAB,",
            are_days(raw),
            "dates as texts",
        ),
        ("a time of day without marks", are_clock_numbers(raw), "times of day as 12:00:00"),
    ):
        if doubtful:
            raise InputError(
                f"{place}: {raw[0]:.15g} may be {phrase} or a number of seconds. Write {advice}, "
                "or give --time-unit s."
            )


def _absurd(raw: RawTimes) -> bool:
    """Return whether numbers can hardly be seconds."""
    numbers = raw.astype(np.float64)
    with np.errstate(over="ignore"):
        usual = median(np.abs(np.diff(numbers)))
    most = float(np.abs(numbers).max())
    if usual >= _ABSURD_STEP or most >= _ABSURD_TIME:
        return True
    begin, end = _LONG_AFTER
    return raw.dtype.kind in "iu" and usual >= _COARSE and begin <= most < end


def _step(integers: NDArray[Any], unit: int) -> Fraction | None:
    """Return the distance of whole numbers of a unit in seconds, if it is the same everywhere."""
    if len(integers) < 2:
        return None
    first = int(integers[1]) - int(integers[0])
    return Fraction(first * unit, UNITS["s"]) if (np.diff(integers) == first).all() else None


def raw_steps(times: RawTimes) -> Floats:
    """Return the distances of times in the unit of their column, in nanoseconds for dates."""
    kind = times.dtype.kind
    if kind in "mM":
        times = times.astype(f"{kind}8[ns]").astype(np.int64)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.diff(times).astype(np.float64)


def in_seconds(raw: RawTimes, unit: int) -> Floats:
    """Return numbers of a unit in seconds, rounded once."""
    second = UNITS["s"]
    floats: Floats = raw.astype(np.float64)
    return floats * (unit // second) if unit >= second else floats / (second // unit)


@lru_cache(maxsize=1024)  # traces of one clock repeat the values
def simple(value: float, blur: float) -> Fraction:
    """Return a fraction with a small denominator within ``blur`` of a value."""
    near = Fraction(value)
    for power in range(1, 12):
        simple_ = near.limit_denominator(10**power)
        if abs(simple_ - near) <= blur:
            return simple_
    return near


_ROUNDED = 3
"""From so many instants on with different records, most times may be rounded."""


_TINY = float(np.finfo(np.float64).tiny)


def same_as_before(times: NDArray[Any]) -> NDArray[np.bool_]:
    """Return, for each time after the first, whether it is the same instant as the previous time.

    Integers and dates are one instant if they are equal. Floating-point times are one instant if
    they differ by at most one unit in the last place, as in clocks that count k * 0.01.
    """
    before, after = times[:-1], times[1:]
    if times.dtype.kind != "f":
        return np.asarray(before == after, np.bool_)
    largest = np.maximum(np.abs(before), np.abs(after))
    ulp = np.where(largest < _TINY, 0.0, np.spacing(largest))
    return np.asarray(np.abs(after - before) <= ulp, np.bool_)


def check_rising(times: Floats, subject: str) -> None:
    """Raise InputError if times decrease."""
    back = (np.diff(times) < 0) & ~same_as_before(times)
    if back.any():
        index = int(back.argmax())
        raise InputError(
            f"{subject}: expected times that increase, got {_text(times[index + 1])} s after "
            f"{_text(times[index])} s"
        )


def one_record(
    times: NDArray[Any],
    values: NDArray[Any],
    choice: SameTime | None,
    subject: str,
    notes: list[str],
    seconds: Floats | None = None,
) -> NDArray[np.intp]:
    """Return the indices of one record of a signal for each instant.

    A note on omitted records that differ is appended. Times are seconds unless these are given.
    """
    same = same_as_before(times)
    if not same.any():
        return np.arange(len(times))
    before, after = values[:-1], values[1:]
    unequal = before != after
    if values.dtype.kind == "f":
        unequal &= ~(np.isnan(before) & np.isnan(after))
    starts = np.append(True, ~same)
    group = np.cumsum(starts) - 1
    differing = np.unique(group[1:][same & unequal])
    instants = times if seconds is None else seconds
    ends = np.append(~same, True)
    if not len(differing):
        return np.nonzero(starts)[0]
    (first,) = np.nonzero(starts)
    position = int(first[differing[0]])
    count = int((group == differing[0]).sum())
    if choice is None:
        change = position + int((same & unequal)[position:].argmax())
        more = f" (and at {counted(len(differing) - 1, 'more time')})" * (len(differing) > 1)
        advice = "; choose with --same-time first or --same-time last"
        if len(differing) >= _ROUNDED and 2 * len(differing) > len(first):
            advice = ", as if times were rounded. Write times that tell the records apart."
        raise InputError(
            f"{subject}: expected one value at {_text(instants[position])} s, got "
            f"{number(values[change])} and {number(values[change + 1])}{more}{advice}"
        )
    more = f" and at {counted(len(differing) - 1, 'more time')}" * (len(differing) > 1)
    notes.append(
        f"{subject}: the {choice} of {count} different records at {_text(instants[position])} s"
        f"{more} counts"
    )
    return np.nonzero(starts if choice == "first" else ends)[0]


def common_instants(columns: list[Floats]) -> Floats:
    """Return all times of several signals, with one time for each instant, in order."""
    times = np.unique(np.concatenate([*columns, np.zeros(0)]))
    return times[np.append(True, ~same_as_before(times))] if len(times) else times


def _text(seconds: float) -> str:
    return f"{seconds:.9g}"


_DRIFT = 0.01
"""The part by which every step may differ from the usual one, however far a slow clock drifts."""

_FINEST, _MANY = 100, 1_000_000
"""The most samples for each row that resampling makes, and how many it makes of any trace."""

HOLE = 1.75
"""A step of so many usual ones and more is one over samples that are not there."""


class Grid:
    """Even distances that fit the times of two or more samples."""

    def __init__(self, times: TimeAxis, jitter: float | None) -> None:
        self.jitter = NEAR if jitter is None else jitter
        since = times.since
        with np.errstate(over="ignore"):  # callers refuse infinite steps
            self.steps = np.diff(since)
        self._exact = times.step
        self.usual = median(self.steps) if times.step is None else float(times.step)
        """The distance that the format states, or the median of the distances."""
        self._precision = 2 * times.precision
        self._since = since
        self.slope = self.usual if self._exact else float(since[-1]) / (len(since) - 1)
        """The distance of the grid's points."""
        if self._exact is None and self.rises and np.isfinite(self.slope) and not self.even:
            self.slope = self._nearest_slope()
            del self.even  # it depends on the slope

    def _nearest_slope(self) -> float:
        """Return the step of the grid that is nearest to the samples.

        The spread of the distances is a convex function of the step, so a search finds its minimum.
        """
        room = 2 * self.jitter / len(self.steps) + 1e-12
        low, high = self.slope * (1 - room), self.slope * (1 + room)
        for _ in range(40):
            third = (high - low) / 3
            if self._spread(low + third) <= self._spread(high - third):
                high -= third
            else:
                low += third
        return (low + high) / 2

    def _spread(self, slope: float) -> float:
        """Return the spread of the distances from the samples to a grid with this step."""
        with np.errstate(over="ignore", invalid="ignore"):
            off = self._since - np.arange(len(self._since)) * slope
            return float(off.max() - off.min())

    @cached_property
    def rises(self) -> bool:
        """Whether the times increase."""
        return bool((self.steps > 0).all())

    @cached_property
    def even(self) -> bool:
        """Whether the samples count as on the grid."""
        if not (self.rises and np.isfinite(self.slope)):
            return False
        near = self._spread(self.slope) <= 2 * self.jitter * self.slope + self._precision
        drifts = np.abs(self.steps - self.usual) <= _DRIFT * self.usual + self._precision
        return near or bool(drifts.all())

    @property
    def even_between_holes(self) -> bool:
        """Whether the samples are even, apart from steps over missing samples."""
        if not self.rises or not np.isfinite(self.slope):
            return False
        off = np.abs(self.steps - self.usual)
        near = off <= 2 * self.jitter * self.usual + self._precision
        return bool((near | (self.steps >= HOLE * self.usual)).all())

    @property
    def fitted(self) -> Fraction:
        """The distance of samples between holes, as simple as their rounding allows."""
        if self._exact is not None:
            return self._exact
        steps = self.steps[self.steps < HOLE * self.usual]
        blur = (self._precision + float(steps.max() - steps.min())) / len(steps)
        slope = float(steps.mean())
        return simple(slope, max(1e-9 * slope, blur))

    @property
    def odd(self) -> int:
        """The index of the first step that two samples near the grid do not explain.

        Without such a step, the index of the step that is farthest from the usual step.
        """
        if self.usual <= 0:
            return int((self.steps <= 0).argmax())
        away = np.abs(self.steps - self.usual)
        away[self.steps <= 0] = np.inf
        odd = away > 2 * self.jitter * self.usual
        return int(odd.argmax() if odd.any() else away.argmax())

    @property
    def period(self) -> Fraction:
        """The distance, exact or as simple as the rounding of the times and their jitter allow."""
        if self._exact is not None:
            return self._exact
        blur = (self._precision + 2 * self._spread(self.slope)) / len(self.steps)
        return simple(self.slope, max(1e-9 * self.slope, blur))


@dataclass(frozen=True, slots=True)
class Resampled:
    """Samples on a grid, each with the values of the last row at or before it.

    Attributes:
        rows: The row of each sample.
        period: Seconds between the samples.
        held: Whether each sample is later than its row by more than the jitter.
        off: The number of rows that lay off the grid.
        gap: The longest distance of two rows, in seconds.
        at: The row before that distance.
    """

    rows: NDArray[np.intp]
    period: Fraction
    held: NDArray[np.bool_]
    off: int
    gap: float
    at: int


def resampled(times: TimeAxis, grid: Grid) -> Resampled | None:
    """Resample by holding values, every usual step from the first row to the last.

    A row that is later than a sample by no more than the jitter counts as on it. Return None if
    there would be more than a hundred samples for every row, and more than a million.
    """
    fits = grid.even_between_holes
    period = grid.fitted if fits else simple(grid.usual, 0.01 * grid.usual)
    near = grid.jitter * grid.usual
    count = int((float(times.since[-1]) + near) / period) + 1
    if count > max(_FINEST * len(times.since), _MANY):
        return None
    samples = np.arange(count) * period.numerator / period.denominator
    rows = np.searchsorted(times.since, samples + near, side="right") - 1
    places = times.since / float(period)
    off = int((np.abs(places - np.rint(places)) > grid.jitter + 1e-9).sum())
    index = int(grid.steps.argmax())
    held = samples - times.since[rows] > near
    return Resampled(rows, period, held, off, float(grid.steps[index]), index)
