"""Times of a stream: dates, seconds since the first row, the grid of samples, distances."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.recorded.cells import read_dates
from rtamt_gym.recorded.columns import NEAR, Columns, DateOrder
from rtamt_gym.recorded.recording import Floats, RawTimes, Rows
from rtamt_gym.recorded.times import TimeAxis, in_seconds
from rtamt_gym.recorded.trace import AsideTimes, Trace
from rtamt_gym.watching.rows import ColumnCells, RowFault

DRIFT = 0.01
"""The maximum difference of a step from the period, as a part of it, for clocks that drift."""


@dataclass(frozen=True, slots=True)
class ClockRules:
    """How the times of a stream are read.

    Attributes:
        source: The name of the stream, for messages.
        column: The column of times.
        columns: How columns are read.
        unit: The unit of times of two columns; empty for one column.
    """

    source: str
    column: str
    columns: Columns
    unit: str = ""

    def axis(self, raw: RawTimes, lines: Sequence[int]) -> TimeAxis:
        """Return the times of the first rows of a trace."""

        def where(row: int) -> str:
            return f"{self.source}, line {lines[row]}"

        rows = Rows({}, {}, len(raw), where, self.source, raw, unit=self.unit)
        axis = TimeAxis.of(rows, self.column, self.columns)
        if raw.dtype.kind not in "mM" and axis.unit == 1 and axis.start == 0.0 != float(raw[0]):
            raise InputError(
                f"{where(0)}, column '{self.column}': expected dates with marks, such as "
                f"2024-05-01, got {raw[0]}"
            )
        axis.check_distances(rows)
        axis.check_unit(self.source)
        return axis


def plain_times(raw: RawTimes) -> RawTimes:
    """Return dates and durations as integers of nanoseconds, and other times as they are."""
    if raw.dtype.kind in "mM":
        return raw.astype(f"{raw.dtype.kind}8[ns]").astype(np.int64)
    return raw


class StreamClock:
    """The times of one trace.

    Args:
        rules: How times are read.
        raw: The first time, or the first two.
        lines: Their lines.
    """

    def __init__(self, rules: ClockRules, raw: RawTimes, lines: Sequence[int]) -> None:
        axis = rules.axis(raw, lines)
        self.start, self._unit, self._dated = axis.start, axis.unit, raw.dtype.kind
        self._first = plain_times(raw[:1])[0]
        self._float = raw.dtype.kind == "f"
        self._axis = axis

    def since(self, raw: RawTimes) -> Floats:
        """Return seconds since the first row."""
        if (raw.dtype.kind in "mM") != (self._dated in "mM"):
            raise InputError("expected times like the first, got numbers and dates")
        self._float = self._float or raw.dtype.kind == "f"
        return in_seconds(plain_times(raw) - self._first, self._unit)

    def precision(self, raw: RawTimes, since: Floats) -> Floats:
        """Return by how much each time may be off because it was rounded."""
        precision = np.spacing(np.abs(since))
        if raw.dtype.kind == "f":
            precision = np.maximum(precision, np.spacing(np.abs(raw)) * (self._unit / 1e9))
        return precision

    @property
    def unit_doubt(self) -> str:
        """Why a period from the first two rows may be in another unit; empty without a doubt."""
        return self._axis.unit_doubt

    @property
    def certain(self) -> bool:
        """Whether the unit of the times is stated, or they are dates."""
        return self._axis.certain and not self._axis.decided

    def unit_note(self, raw: RawTimes, length: float) -> str:
        """Return the note on the unit of times; empty without one."""
        return replace(self._axis, since=self.since(raw)).note_of_unit(length)

    def period(self, source: str, lines: Sequence[int], *, timed: bool) -> Fraction:
        """Return the distance of the first two rows."""
        trace = Trace(source, {}, 2, self._axis, lambda row: f"{source}, line {lines[row]}")
        period = trace.period(timed=timed)
        assert period is not None, "there are two rows"  # noqa: S101 - for mypy
        return period


def on_grid(
    since: Floats, last: float, sample: int, period: float, precision: Floats, *, counted: bool
) -> NDArray[np.bool_]:
    """Return whether rows are the next samples of an even grid.

    Args:
        since: Their times since the first row.
        last: The time of the row before.
        sample: The number of the first row.
        period: The period in seconds.
        precision: By how much a time may be off.
        counted: Whether bounds count samples, so that a drift may not add up to half a period.
    """
    off = np.abs(since - np.arange(sample, sample + len(since)) * period)
    steps = np.abs(np.diff(since, prepend=last) - period)
    near = (off <= NEAR * period + 2 * precision) & (steps < period / 2)
    drifts = steps <= DRIFT * period + 4 * precision
    if counted:
        drifts &= off < period / 2
    return np.asarray(near | drifts)


_NO_ORDER: Final = re.compile(r"\d{1,2}([/-])\d{1,2}\1\d{4}", re.ASCII)
"""The start of a date with the day or the month first."""


class StreamDates:
    """The first date of a stream, and the order of day and month that the rows so far show.

    All rows of a file can decide the order. A stream refuses the first row if its distance to the
    first date depends on the order, regardless of the number of rows that arrive together.

    Attributes:
        first: The first cell of times, and its day if it is a time of day; None before it.
        dated: Whether it is a date, a time of day or a duration, not a number.

    Example:
        >>> StreamDates().order("time", ["13/04/2024", "01/05/2024"], None)
        'dmy'
        >>> StreamDates().order("time", ["2024-05-01"], None)
    """

    def __init__(self) -> None:
        self.first: tuple[Any, str] | None = None
        self.dated = False
        self._begin: str | None = None
        self._order: DateOrder | None = None
        self._sure = False
        self._texts: bool | None = None

    def check_kind(self, column: str, cells: ColumnCells) -> None:
        """Check that times in JSON are all texts or all numbers, as in the first row."""
        if self._texts is not None and {*map(type, cells)} <= (
            {str} if self._texts else {int, float}
        ):
            return
        for row, cell in enumerate(cells):
            if not isinstance(cell, str | int | float) or isinstance(cell, bool):
                return  # not a time
            texts = isinstance(cell, str)
            if self._texts is None:
                self._texts = texts
            elif texts != self._texts:
                expected, kind = ("a text", "a number") if self._texts else ("a number", "a text")
                raise RowFault(
                    row,
                    f"column '{column}': expected {expected}, as in the first row, got {cell!r}, "
                    f"{kind}",
                )

    def order(
        self, column: str, cells: ColumnCells, days: Sequence[str] | None
    ) -> DateOrder | None:
        """Return the order of day and month; None if it does not matter for the rows so far."""
        for row, cell in enumerate(cells if days is None else days):
            if self._sure:
                break
            text = cell.strip() if isinstance(cell, str) else ""
            if not _NO_ORDER.match(text):
                self._sure = self._begin is None  # the first row has another form
                break
            self._take(column, row, text.split()[0].rstrip(","))
        return self._order

    def _take(self, column: str, row: int, text: str) -> None:
        """Compare the day of a row with the first day."""
        date = _NO_ORDER.match(text)
        day = text if date is None else date[0]
        begin = self._begin or day
        orders: tuple[DateOrder, DateOrder] = ("dmy", "mdy")
        readings = {order: read_dates([begin, day], order) for order in orders}
        possible = {order: dates for order, dates in readings.items() if dates is not None}
        self._begin = begin
        if len(possible) == 1:
            (self._order,) = possible
            self._sure = True
        elif len({int((dates[1] - dates[0]).astype(int)) for dates in possible.values()}) > 1:
            raise RowFault(
                row,
                f"column '{column}': the date {day!r} may have the day or the month first; give "
                "--date-order dmy or --date-order mdy",
                skippable=False,
            )


_DISTANCES: Final = 10_000
"""The maximum number of different distances for the median."""


class StepCounter:
    """The distances of the rows of a trace, for the note on a stated period.

    Example:
        >>> steps = StepCounter("stdin")
        >>> steps.add(np.array([0.0, 0.1, 0.2, 6.6]), range(2, 6))
        >>> times = steps.times()
        >>> round(times.usual, 9), round(times.largest, 9), times.place
        (0.1, 6.4, 'stdin, line 4')
    """

    def __init__(self, source: str) -> None:
        self.source = source
        self._counts = Counter[float]()
        self._last: float | None = None
        self._line = self._largest_line = self._lost = 0
        self._smallest, self._largest = np.inf, -np.inf

    def lose(self) -> None:
        """Note that a row is missing, so the next distance spans two steps."""
        self._lost += 1

    def add(self, since: Floats, lines: Sequence[int]) -> None:
        """Add the times of rows."""
        before = since[0] if self._last is None else self._last
        steps = np.diff(since, prepend=before)
        steps[0] /= self._lost + 1
        at = [self._line, *lines[:-1]]
        if self._last is None:
            steps, at = steps[1:], at[1:]
        self._last, self._line, self._lost = float(since[-1]), lines[-1], 0
        if not len(steps):
            return
        place = int(steps.argmax())
        if steps[place] > self._largest:
            self._largest, self._largest_line = float(steps[place]), at[place]
        self._smallest = min(self._smallest, float(steps.min()))
        if len(self._counts) < _DISTANCES:
            self._counts.update(np.round(steps, 9).tolist())

    def times(self) -> AsideTimes | None:
        """Return the distances so far; None before the second row."""
        if self._last is None or not self._counts:
            return None
        place = f"{self.source}, line {self._largest_line}"
        steps = np.array(sorted(self._counts))
        counts = np.cumsum([self._counts[step] for step in steps.tolist()])
        middle = np.array([(counts[-1] - 1) // 2, counts[-1] // 2])
        usual = float(steps[np.searchsorted(counts, middle, side="right")].mean())
        return AsideTimes(usual, self._smallest, self._largest, place, self._last)
