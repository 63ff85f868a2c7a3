"""Times of a recording: their column, the times in seconds, and one record for each instant."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.columns import (
    are_clock_numbers,
    are_days,
    calendar_unit,
    dates_of_numbers,
    has_plain_time_name,
    hinted_unit,
    median,
    name_words,
    plausible_units,
    split_times,
    unit_of_times,
)
from rtamt.errors import nearest
from rtamt_gym.checks.names import listed, listing
from rtamt_gym.recorded.columns import UNITS, Columns, SameTime
from rtamt_gym.recorded.dates import RawTimes
from rtamt_gym.recorded.recording import Floats, Recording, Rows, TimePart
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


class TimeColumn(NamedTuple):
    """The columns of times.

    Attributes:
        name: The column.
        part: A second column, with parts of seconds or dates; None without such a column.
    """

    name: str
    part: TimePart | None = None

    @property
    def columns(self) -> list[str]:
        """The names of the columns."""
        return [self.name] if self.part is None else [self.name, self.part.column]

    @property
    def label(self) -> str:
        """The columns as ``--time`` names them."""
        return "+".join(self.columns)


_CLOCK_NAMES = {"time", "zeit", "uhrzeit", "heure", "hora", "ora", "tijd", "utctime", "localtime"}
_DATE_NAMES = {"date", "datum", "fecha", "utcdate", "localdate"}
_SHORT_NAMES = {"s", "ns", "us", "ms"}
"""Last words of names that may as well be units of other quantities."""


def find_times(
    recording: Recording, columns: Columns, *, read: Collection[str] = (), needed: bool = True
) -> TimeColumn | None:
    """Return the column of times that an option or a known name selects, or None.

    A column ``time`` has priority. Other plain names come before seconds with a column of
    nanoseconds, dates, less usual names and fields such as ``header.stamp``. A column of dates
    completes a column ``time`` that holds times of day.

    Args:
        recording: The file.
        columns: How its columns are read.
        read: The columns that specifications read. A column of these with a less usual name does
            not count as times.
        needed: Whether times are needed. If so, several columns with less usual names are an error;
            otherwise, the result is None.
    """
    column = _found(recording, columns, read, needed=needed)
    if column is not None and column.part is not None and column.part.unit and columns.time_unit:
        raise InputError(
            f"{recording.source}: expected --time-unit for one column of times, got the columns "
            f"{listing(column.columns)} with their units in their names"
        )
    return column


def _found(
    recording: Recording, columns: Columns, read: Collection[str], *, needed: bool
) -> TimeColumn | None:
    names = [*dict.fromkeys(recording.names)]
    if columns.time is not None:
        return _named(recording, columns.time)
    blank = recording.blank
    if TIME in names:
        return _with_date(TIME, recording)
    plain = [name for name in names if has_plain_time_name(name) and name not in blank]
    if plain:
        return _with_date(_only(recording, [TimeColumn(name) for name in plain]).name, recording)
    pairs = _second_pairs(names)
    dates = [name for name in recording.dates if name not in blank]
    known = [n for n in names if unit_of_times(n) is not None and n not in (*read, *blank)]
    if len(both := [name for name in dates if name in known]) == 1:
        return TimeColumn(both[0])
    if len(dates) == 1 and dates[0] in recording.days and len(known) == 1:
        return _with_date(known[0], recording)
    if dates:
        return _only(recording, [TimeColumn(name) for name in dates])
    fields = {name: re.split(r"[./]", name)[-1] for name in names if name not in blank}
    usual = [n for n, last in fields.items() if last != "t" and has_plain_time_name(last)]
    candidates = pairs or [TimeColumn(name) for name in known]
    if not candidates and usual:
        return _only(recording, [TimeColumn(name) for name in usual])
    candidates = candidates or [
        TimeColumn(name)
        for name, last in fields.items()
        if name not in read and last not in (name, "t") and unit_of_times(last) is not None
    ]
    if not candidates or (len(candidates) > 1 and not needed):
        return None
    one = _only(recording, candidates)
    return one if one.part else _with_date(one.name, recording)


def _named(recording: Recording, name: str) -> TimeColumn:
    """Return the column that ``--time`` names, or the two columns, as in ``secs+nsecs``."""
    names = [*dict.fromkeys(recording.names)]
    if name in names:
        return TimeColumn(name)
    first, plus, second = name.partition("+")
    if plus and {first, second} <= {*names}:
        units = {part: unit for _, part, unit in split_times([first, second])}
        return TimeColumn(first, TimePart(second, units.get(second, "")))
    raise InputError(
        f"{recording.source}: no column '{name}', which --time names; the columns "
        f"are {listed(names, name)}{nearest(name, names)}"
    )


def _only(recording: Recording, candidates: Sequence[TimeColumn]) -> TimeColumn:
    if len(candidates) > 1:
        labels = [candidate.label for candidate in candidates]
        raise InputError(
            f"{recording.source}: expected one column of times, got {listing(labels)}; choose one "
            f"with --time {labels[0]!r}"
        )
    return candidates[0]


def _with_date(name: str, recording: Recording) -> TimeColumn:
    """Return a column of times, with the only column of dates if it may hold times of day."""
    dates = [n for n in recording.names if "".join(name_words(n)) in _DATE_NAMES]
    if "".join(name_words(name)) in _CLOCK_NAMES and len(dates) == 1 and dates[0] != name:
        return TimeColumn(name, TimePart(dates[0]))
    return TimeColumn(name)


def _second_pairs(names: Sequence[str]) -> list[TimeColumn]:
    """Return the columns of seconds that have a column of nanoseconds or other parts of seconds."""
    return [
        TimeColumn(name, TimePart(part, unit))
        for name, part, unit in split_times(names)
        if not _SHORT_NAMES & {name_words(name)[-1], name_words(part)[-1]}
    ]


def join_times(times: RawTimes, part: RawTimes, unit: str, where: Callable[[int], str]) -> RawTimes:
    """Return seconds with parts of seconds as whole nanoseconds.

    Args:
        times: Whole seconds.
        part: The parts.
        unit: The unit of the parts.
        where: Returns the place of a row, for messages.
    """
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
            if not {*name_words(column)} & _DATE_NAMES:
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
        """Check that times do not decrease; times may repeat.

        Args:
            where: Returns the place of a row, for messages.
            rows: The rows that count; None: all do.
            subject: The owner of the times, such as `` of 'x'``.
        """
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

        Args:
            length: The length of the whole trace in seconds; the times may be only its first times.
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
    """Return the unit of times that an option, the format or the name of the column states.

    Args:
        column: The name of the column.
        unit: The unit that the format states; empty if it states none.
        columns: The options of columns.
    """
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

    Example:
        >>> same_as_before(np.array([0.3, 0.1 + 0.2, 0.4])).tolist()
        [True, False]
    """
    before, after = times[:-1], times[1:]
    if times.dtype.kind != "f":
        return np.asarray(before == after, np.bool_)
    largest = np.maximum(np.abs(before), np.abs(after))
    ulp = np.where(largest < _TINY, 0.0, np.spacing(largest))
    return np.asarray(np.abs(after - before) <= ulp, np.bool_)


def check_rising(times: Floats, subject: str) -> None:
    """Raise InputError if times decrease.

    Args:
        times: The times in the order of the file.
        subject: The file and the signal, for messages.
    """
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
    seconds: Floats | None = None,
) -> tuple[NDArray[np.intp], str]:
    """Keep one record of a signal for each instant.

    Args:
        times: The times of the records, shape (n,), which do not decrease.
        values: The values, shape (n,); nan stands for a record without a number.
        choice: Which record counts if records of one instant differ; None: such records are an
            error.
        subject: The file and the signal, for messages.
        seconds: The times in seconds, shape (n,); None: the times are seconds.

    Returns:
        The indices of the records to keep, and a note on omitted records that differ; empty without
        such records.

    Example:
        >>> times, values = np.array([0.0, 1.0, 1.0]), np.array([5.0, 3.0, 3.0])
        >>> one_record(times, values, None, "log.mf4, 'a'")
        (array([0, 1]), '')
        >>> one_record(times, np.array([5.0, 3.0, -3.0]), "last", "log.mf4, 'a'")
        (array([0, 2]), "log.mf4, 'a': the last of 2 different records at 1 s counts")
    """
    same = same_as_before(times)
    if not same.any():
        return np.arange(len(times)), ""
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
        return np.nonzero(starts)[0], ""
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
    note = (
        f"the {choice} of {count} different records at {_text(instants[position])} s{more} counts"
    )
    return np.nonzero(starts if choice == "first" else ends)[0], f"{subject}: {note}"


def common_instants(columns: list[Floats]) -> Floats:
    """Return all times of several signals, with one time for each instant, in order."""
    times = np.unique(np.concatenate([*columns, np.zeros(0)]))
    return times[np.append(True, ~same_as_before(times))] if len(times) else times


def _text(seconds: float) -> str:
    return f"{seconds:.9g}"
