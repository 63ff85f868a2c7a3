"""Traces of many groups of a table at once, as `read_ruled` returns the trace of each.

A group is plain if its samples are certain to be read without an error: all values are there, times
increase in even steps, and no other column separates objects within it. All other groups, and all
groups under the options that `GroupTraces` lists, are read one by one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import RtamtError
from rtamt.columns import calendar_unit, may_tell_objects, unit_of_times
from rtamt.errors import shown
from rtamt.internal import TraceRows, may_separate
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import NEAR, UNITS, Columns
from rtamt_gym.recorded.groups import Booleans, GroupRecording, GroupRows, GroupTable
from rtamt_gym.recorded.names import (
    TimeColumn,
    check_recorded,
    starts_of,
    with_columns,
)
from rtamt_gym.recorded.recording import Floats, Rows, Wanted, places_of, selection_notes
from rtamt_gym.recorded.roles import RowTable, counts_rows, has_time_bounds
from rtamt_gym.recorded.times import HOLE, TimeAxis, in_seconds, same_as_before, simple, stated_unit
from rtamt_gym.recorded.trace import PERIODS, Trace
from rtamt_gym.recorded.trace_files import IF_EVENTS, check_bounds, wanted_samples
from rtamt_gym.results.extent import Gap
from rtamt_gym.tables import number


@dataclass(frozen=True, slots=True)
class _Layout:
    """The common columns and times of all groups of a table.

    Attributes:
        roles: The columns, with the annotations of the specifications.
        rows: The values and times of all groups.
        column_of: The column of each variable.
        cells: The columns that may separate objects by their names.
        texts: The unread columns of texts.
    """

    roles: RowTable
    rows: Rows
    column_of: Mapping[str, str]
    cells: Mapping[str, NDArray[Any]]
    texts: Mapping[str, NDArray[Any]]


class GroupTraces:
    """The traces of groups of a table.

    Attributes:
        table: The table.
        stated: The stated period; None to use the times.
        timed: Whether a requirement has time bounds.
        ranges: The declared ranges of variables.
    """

    def __init__(
        self,
        table: GroupTable,
        specs: Mapping[str, rtamt.Specification],
        reading: EvaluationOptions,
        columns: Columns,
        more: GroupTraces | None = None,
    ) -> None:
        self._more = more
        self.table, self._specs, self._reading = table, specs, reading
        self.stated = reading.seconds
        self.ranges = {n: ends for spec in specs.values() for n, ends in spec.ranges.items()}
        self.timed = any(spec.timed for spec in specs.values())
        self._doubts: dict[Fraction, bool] = {}
        self._layout: _Layout | None = None
        singly = columns.wide or columns.long or columns.jitter is not None
        if not (singly or columns.max_gap is not None or reading.dense):
            try:
                self._layout = self._common(columns)
            except RtamtError:  # every group reports the error
                self._layout = None

    @property
    def usable(self) -> bool:
        """Whether any group may be plain."""
        return self._layout is not None

    def _common(self, columns: Columns) -> _Layout | None:
        """Return the common columns and times of the groups; None to read groups one by one."""
        table, specs, period = self.table, self._specs, self.stated
        columns = with_columns(specs, columns)
        columns = replace(columns, starts=starts_of(specs, columns))
        recording = GroupRecording(table.source, table, next(iter(table.rows)), columns.decimal)
        for spec in specs.values():
            check_recorded(table.source, table.names, spec.variables, columns)
        variables = list(dict.fromkeys(v for spec in specs.values() for v in spec.variables))
        bounded = any(map(has_time_bounds, specs.values()))
        needed = period is None and (bounded or columns.time_unit is not None)
        roles = RowTable.of(recording, variables, columns, needed=needed)
        read, time = roles.read, roles.time
        if time is None and columns.time_unit is not None:
            return None
        there, numbers = roles.assign(variables, IF_EVENTS)
        if there != variables or roles.clocks:  # some variables have defaults, or own times
            return None
        if time is None and columns.where and any(map(counts_rows, specs.values())):
            # rows may be left out between counted rows
            return None
        if time is None and bounded and period is None:
            named = any(unit_of_times(name) is not None for name in read)
            if roles.unread or named or table.above:
                return None  # a column may be times
        rows = self._rows(numbers, roles)
        if rows is None or rows.step is not None or rows.sparse:
            return None
        first, timed = table.names[0], rows.times is not None
        if (time is not None) != timed or (rows.times is not None and rows.times.dtype.kind == "b"):
            return None
        names = [] if columns.one_trace else roles.unread
        near = [n for n in names if may_tell_objects(n, read, timed=timed, first=n == first)]
        texts = [n for n in names if n in table.texts and n not in near and timed]
        cell_tables = [self._cells(part, rows.count, columns) for part in (near, texts)]
        if None in cell_tables:
            return None
        cells, others = (part or {} for part in cell_tables)
        column_of = {name: columns.column(name) for name in variables}
        return _Layout(roles, rows, column_of, cells, others)

    def _rows(self, numbers: Sequence[str], roles: RowTable) -> Rows | None:
        """Return the values and times of all groups; None if they cannot be read together."""
        time, columns = roles.time, roles.columns
        plain = {*numbers, *(() if time is None else time.columns)}.isdisjoint(self.table.texts)
        more = None if self._more is None else self._more._layout  # noqa: SLF001 - of this class
        same = more is not None and more.roles.time == time
        if more is not None and plain and same and {*numbers} <= {*more.rows.numbers}:
            return more.rows
        wanted = roles.with_times(wanted_samples(numbers, columns, IF_EVENTS))
        rows = self.table.read(wanted)
        if rows is None and plain:
            # An empty cell of one group leaves the others plain.
            rows = self.table.read(replace(wanted, gaps=numbers, nan=True))
        return rows

    def _cells(
        self, names: Sequence[str], count: int, columns: Columns
    ) -> dict[str, NDArray[Any]] | None:
        """Return columns without conversion; None if they cannot be read."""
        if not names:
            return {}
        rows = self.table.read(Wanted((), cells=names, where=columns.where))
        if rows is None:
            return None
        return {name: values for name, values in rows.cells.items() if len(values) == count}

    def block(self, names: Sequence[str], places: Sequence[NDArray[np.intp]]) -> GroupBlock | None:
        """Return the traces of some groups; None to read groups one by one."""
        layout = self._layout
        if layout is None:
            return None
        lengths = np.array([len(part) for part in places], np.int64)
        rows = GroupRows.of(lengths)
        order = np.concatenate(places)
        span = slice(int(order[0]), int(order[-1]) + 1)
        # Avoid a copy if the rows are neighbours.
        chosen: Any = order
        if span.stop - span.start == len(order) and bool((np.diff(order) == 1).all()):
            chosen = span
        return GroupBlock(self, layout, names, places, rows, chosen)

    def has_doubtful_bounds(self, period: Fraction) -> bool:
        """Return whether a bound does not fit a period with a doubtful unit."""
        if period not in self._doubts:
            self._doubts[period] = False
            try:
                check_bounds(self._specs, self._reading.having(period=period), "doubt")
            except RtamtError:
                self._doubts[period] = True
        return self._doubts[period]

    @property
    def measured(self) -> bool:
        """Whether traces have lengths: there are times, or a stated period."""
        return self._layout is not None and (
            self._layout.roles.time is not None or self.stated is not None
        )


class GroupBlock:
    """The traces of some groups.

    Attributes:
        values: The values of each variable, group after group.
        rows: The rows of each group in them.
        plain: Whether the trace of each group can be read here.
        too_short: Whether each group has one row, no period, and bounds that need one.
        periods: The period of each plain group.
    """

    def __init__(
        self,
        traces: GroupTraces,
        layout: _Layout,
        names: Sequence[str],
        places: Sequence[NDArray[np.intp]],
        rows: GroupRows,
        chosen: Any,  # noqa: ANN401 - a slice or an array
    ) -> None:
        self._traces, self._layout, self._names, self._places = traces, layout, names, places
        self.rows, count, stated = rows, len(rows.lengths), traces.stated
        numbers = {c: layout.rows.numbers[c][chosen] for c in layout.column_of.values()}
        self.values: dict[str, Floats] = {v: numbers[c] for v, c in layout.column_of.items()}
        self.plain = np.ones(count, bool)
        for values in numbers.values():
            self.plain &= ~rows.any(np.isnan(values))
        for wrong in layout.rows.invalid.values():
            self.plain &= ~rows.any(wrong[chosen])
        for name, (low, high) in traces.ranges.items():
            if name in self.values:
                values = self.values[name]
                self.plain &= ~rows.any((values < low) | (values > high))
        self._axes: GroupAxes | None = None
        self.periods: list[Fraction | None] = [stated] * count
        self._gaps: list[Any] = [None] * count
        self.too_short = np.zeros(count, bool)
        if layout.roles.time is not None and layout.rows.times is not None:
            self._measure(layout.rows.times[chosen], layout.roles.time)
        self._leave_separated(chosen)
        self.too_short &= self.plain
        self.plain &= ~self.too_short
        self._constants = self._constant_values()

    def _measure(self, raw: NDArray[Any], time: TimeColumn) -> None:
        """Find the periods and the gaps of the groups."""
        layout, rows, stated = self._layout, self.rows, self._traces.stated
        axes = GroupAxes(raw, rows, time.name, layout.rows.unit, layout.roles.columns)
        self._axes = axes
        self.plain &= axes.plain
        if stated is not None:
            self.plain &= axes.near(float(stated))
            as_stated = layout.roles.columns.missing == "raise"
            self._gaps = axes.gaps(float(stated) if as_stated else None)
            return
        if (rows.lengths == 2).any():
            step = self._traces.table.usual_step(layout.roles.with_times(Wanted(())))
            if step is not None:
                self.plain &= ~axes.far_apart(step)
        self.periods, self._gaps = axes.periods(), axes.gaps(None)
        known = np.array([period is not None for period in self.periods])
        self.plain &= known | (rows.lengths == 1)
        if self._traces.timed:
            self.too_short = rows.lengths == 1
        for i in np.flatnonzero(self.plain & axes.doubtful).tolist():
            period = self.periods[i]
            if period is not None and axes.axis(i).unit_doubt:
                self.plain[i] = not self._traces.has_doubtful_bounds(period)

    def _leave_separated(self, chosen: Any) -> None:  # noqa: ANN401 - a slice or an array
        """Leave out groups in which other columns may separate objects."""
        rows = TraceRows(None, self.rows.begins, self.rows.lengths)
        for name, cells in self._layout.cells.items():
            self.plain &= ~may_separate(name, cells[chosen], rows)
        if self._axes is not None and (uneven := self._axes.uneven & self.plain).any():
            for name, cells in self._layout.texts.items():
                self.plain &= ~(uneven & may_separate(name, cells[chosen], rows))

    def _constant_values(self) -> dict[str, list[float | None]]:
        """Return the only value of each variable in each group of several rows, or None."""
        constants = {}
        for name, values in self.values.items():
            least, most = self.rows.least(values), self.rows.greatest(values)
            same = (least == most) & (self.rows.lengths > 1)
            if same.any():
                firsts = values[self.rows.begins].tolist()
                constants[name] = [
                    first if one else None for first, one in zip(firsts, same.tolist(), strict=True)
                ]
        return constants

    def columns(self, variables: Sequence[str], i: int) -> tuple[dict[str, Floats], int]:
        """Return the values of some variables in a group, and their number."""
        begin, n = int(self.rows.begins[i]), int(self.rows.lengths[i])
        return {name: self.values[name][begin : begin + n] for name in variables}, n

    def joined(
        self, variables: Sequence[str], chosen: Sequence[int]
    ) -> tuple[dict[str, Floats], NDArray[np.int64]]:
        """Return the values of some variables in some groups, and the lengths of these groups."""
        if len(chosen) == len(self.rows.lengths):
            return {name: self.values[name] for name in variables}, self.rows.lengths
        marks = np.zeros(len(self.rows.lengths), bool)
        marks[chosen] = True
        rows = self.rows.repeated(marks)
        return {name: self.values[name][rows] for name in variables}, self.rows.lengths[marks]

    def trace(self, i: int) -> Trace:
        """Return the trace of a plain group."""
        layout, table, columns = self._layout, self._traces.table, self._layout.roles.columns
        begin, n = int(self.rows.begins[i]), int(self.rows.lengths[i])
        axis = None if self._axes is None else self._axes.axis(i)
        gap = self._gaps[i]
        notes = [*layout.rows.notes, *table.blank_notes, *selection_notes(n, columns.where)]
        if self._traces.stated is None and axis is not None:
            notes += [note] if self._doubtful[i] and (note := axis.unit_note) else []
            if gap is not None and gap.long and columns.missing != "unknown":
                notes.append(gap.note)
        constant = [
            f"{name} ({number(value)})"
            for name, values in self._constants.items()
            if (value := values[i]) is not None
        ]
        if constant:
            notes.append(f"constant over the whole trace: {', '.join(constant)}")
        return Trace(
            shown(self._names[i]),
            {name: values[begin : begin + n] for name, values in self.values.items()},
            n,
            axis,
            places_of(layout.rows.where, self._places[i]),
            None,
            IF_EVENTS,
            [*dict.fromkeys(notes)],
            gap=gap,
        )

    @cached_property
    def _doubtful(self) -> Booleans:
        return np.zeros(0, bool) if self._axes is None else self._axes.doubtful


_SINCE_START, _DAYS, _CLOCKS = 1e7, 3e4, 60.0
"""Numbers below these are not dates such as 20240501, days of dates, and times of day."""

_SINCE_1970 = 3e8, 1e11
"""Numbers between these are seconds since 1970, if steps are short enough."""

_STEPS = 1e-4, 990.0
"""Steps between these are neither days nor another unit than seconds."""

_TRIED = 64
"""The periods that are compared with all groups."""


class GroupAxes:
    """The times of groups.

    Attributes:
        plain: Whether the times of each group increase, and are certainly not dates, days or times
            of day. Other attributes are meaningless for groups that are not plain.
        since: Seconds since the first time of the group, for each row.
        uneven: Whether steps differ by more than about a tenth.
    """

    def __init__(
        self, raw: NDArray[Any], rows: GroupRows, column: str, unit: str, columns: Columns
    ) -> None:
        self._rows, self._column, kind = rows, column, raw.dtype.kind
        if kind == "f":
            raw = raw.astype(np.float64)
        wrong = np.isnat(raw) if kind in "mM" else ~np.isfinite(raw)
        self.plain = ~rows.any(wrong)
        raw = np.where(wrong, raw.dtype.type(0), raw) if wrong.any() else raw
        inner = np.ones(len(raw), bool)
        inner[rows.begins] = False
        self._inner = inner
        rises = np.ones(len(raw), bool)
        rises[1:] = raw[1:] > raw[:-1]
        self.plain &= ~rows.any(~rises & inner)
        stated = "s" if kind in "mM" else stated_unit(column, unit, columns)
        self._certain, self._decided = bool(stated), ""
        if kind in "mM":
            integers = raw.astype(f"{kind}8[ns]").astype(np.int64)
            self.since = (integers - rows.repeated(integers[rows.begins])) / 1e9
            first = integers[rows.begins] / 1e9
            self._starts = np.zeros(len(first)) if kind == "M" else first
            self._precisions, self._unit, exact_times = np.full(len(first), 1e-9), 1, integers
        else:
            named = stated or calendar_unit(column) or ""
            self.plain &= named == "" or named in UNITS
            self._certain = bool(named)
            self._unit = UNITS.get(named or "s", UNITS["s"])
            with np.errstate(over="ignore"):
                self.since = in_seconds(raw - rows.repeated(raw[rows.begins]), self._unit)
            most = rows.greatest(np.abs(raw)).astype(np.float64)
            ulps = np.spacing(most) if kind == "f" else np.zeros(len(most))
            ends = np.spacing(rows.greatest(np.abs(self.since)))
            self._precisions = np.maximum(ulps * self._unit / 1e9, ends)
            self._starts = in_seconds(raw[rows.begins], self._unit)
            exact_times = raw
        self.plain &= ~rows.any(~np.isfinite(self.since))
        with np.errstate(over="ignore", invalid="ignore"):
            same = np.append(False, same_as_before(self.since))
            self._all_steps = np.diff(self.since, prepend=self.since[:1])
        self.plain &= ~rows.any((same | ~(self._all_steps > 0)) & inner)
        (self._many,) = np.nonzero(rows.lengths > 1)
        lengths = rows.lengths[self._many] - 1
        self._steps = GroupRows.of(lengths)
        self.steps = self._all_steps[inner]
        self._exact = self._exact_steps(exact_times, kind)
        self.usual = self._usual()
        self.uneven = self._spread_steps(0.0999)
        if not stated:
            self._leave_doubtful(raw)

    def _exact_steps(self, exact_times: NDArray[Any], kind: str) -> list[int | None]:
        """Return the distance of whole numbers of each group with steps, if it is the same."""
        if kind == "f" or not len(self._many):
            return [None] * len(self._many)
        steps = np.diff(exact_times.astype(np.int64), prepend=exact_times[:1].astype(np.int64))[
            self._inner
        ]
        least, most = self._steps.least(steps), self._steps.greatest(steps)
        return [a if a == b else None for a, b in zip(least.tolist(), most.tolist(), strict=True)]

    def _usual(self) -> Floats:
        """Return the usual step of each group; 0 for a group of one row."""
        usual = np.zeros(len(self._rows.lengths))
        if len(self._many):
            medians = self._steps.medians(self.steps)
            for i, step in enumerate(self._exact):
                if step is not None:
                    medians[i] = float(self._fraction(step))
            usual[self._many] = medians
        return usual

    def _fraction(self, step: int) -> Fraction:
        return Fraction(step * self._unit, UNITS["s"])

    def _spread_steps(self, part: float) -> Booleans:
        """Return whether the steps of each group differ by more than a part of the usual step."""
        spread = np.zeros(len(self._rows.lengths), bool)
        if len(self._many):
            least, most = self._steps.least(self.steps), self._steps.greatest(self.steps)
            with np.errstate(invalid="ignore", over="ignore"):
                spread[self._many] = ~(most - least <= part * self.usual[self._many])
        return spread

    def _leave_doubtful(self, raw: NDArray[Any]) -> None:
        """Leave out groups whose times may be dates, days, times of day or in another unit."""
        most = self._rows.greatest(np.abs(raw)).astype(np.float64)
        low = self._rows.least(raw).astype(np.float64)
        many = self._rows.lengths > 1
        steps = np.where(many, self.usual * UNITS["s"] / self._unit, 1.0)
        dated = (low >= _SINCE_1970[0]) & (most < _SINCE_1970[1])
        self.plain &= (most < _SINCE_START) | dated
        if raw.dtype.kind == "f":
            self.plain &= ~many | (((low < _DAYS) | dated) & (steps >= _STEPS[0]))
        self.plain &= ~(self._spread_steps(0.0099) & (most >= _CLOCKS) & ~dated)
        self.plain &= ~many | (steps < _STEPS[1])

    def axis(self, i: int) -> TimeAxis:
        """Return the times of a group, as `TimeAxis.of` does."""
        begin, n = int(self._rows.begins[i]), int(self._rows.lengths[i])
        exact = self._exact_of.get(i)
        return TimeAxis(
            self._column,
            self.since[begin : begin + n],
            float(self._starts[i]),
            float(self._precisions[i]),
            self._certain,
            None if exact is None else self._fraction(exact),
            self._decided,
            unit=self._unit,
        )

    @cached_property
    def _exact_of(self) -> dict[int, int]:
        pairs = zip(self._many.tolist(), self._exact, strict=True)
        return {place: step for place, step in pairs if step is not None}

    def far_apart(self, step: float) -> Booleans:
        """Return which groups have two rows only, farther apart than the steps of other groups."""
        most = HOLE * step * self._unit / UNITS["s"]
        return np.asarray((self._rows.lengths == 2) & (self.usual >= most))

    @property
    def doubtful(self) -> Booleans:
        """Whether `TimeAxis.unit_note` of each group may have a text."""
        result = np.zeros(len(self._rows.lengths), bool)
        if not self._certain and len(self._many):
            result[self._many] = self._steps.least(self.steps) >= 1
        return result

    def gaps(self, usual: float | None) -> list[Gap | None]:
        """Return the longest gap of each group."""
        gaps: list[Gap | None] = [None] * len(self._rows.lengths)
        if not len(self._many):
            return gaps
        most = self._steps.greatest(self.steps)
        (longest,) = np.nonzero(self.steps == self._steps.repeated(most))
        first = longest[np.searchsorted(longest, self._steps.begins)]
        # The steps of a group lack one row of each group up to it with several rows.
        before = self._rows.begins[self._many] + first - self._steps.begins
        begins = self.since[before] + self._starts[self._many]
        usuals = self.usual[self._many] if usual is None else np.full(len(most), usual)
        rows = zip(
            *(self._many.tolist(), most.tolist(), begins.tolist(), usuals.tolist()), strict=True
        )
        for place, seconds, begin, step in rows:
            gaps[place] = Gap(seconds, begin, step)
        return gaps

    def near(self, period: float) -> Booleans:
        """Return whether all steps of each group are a stated period; also for one row."""
        result = np.ones(len(self._rows.lengths), bool)
        if len(self._many):
            least, most = self._steps.least(self.steps), self._steps.greatest(self.steps)
            room = NEAR * period
            result[self._many] = (period - least <= room) & (most - period <= room)
        return result

    def periods(self) -> list[Fraction | None]:
        """Return the period of each group; None for one row or uneven times."""
        periods: list[Fraction | None] = [None] * len(self._rows.lengths)
        many = self._many[self.plain[self._many]]
        exact = self._exact_of
        usual = self.usual
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            last = self.since[self._rows.begins + self._rows.lengths - 1]
            slopes = last / np.maximum(self._rows.lengths - 1, 1)
            evenly = [*exact]
            slopes[evenly] = usual[evenly]
            off = self.since - self._rows.numbers * self._rows.repeated(slopes)
            spreads = self._rows.greatest(off) - self._rows.least(off)
            room = 2 * self._precisions
            even = spreads <= 2 * NEAR * slopes + room
            even &= (usual >= PERIODS[0]) & (usual <= PERIODS[1])
            blurs = np.maximum(
                1e-9 * slopes, (room + 2 * spreads) / np.maximum(self._rows.lengths - 1, 1)
            )
        many = many[even[many]]
        left = []
        for place in many.tolist():
            if place in exact:
                periods[place] = self._fraction(exact[place])
            else:
                left.append(place)
        pending = np.array(left, np.intp)
        for _ in range(_TRIED):
            if not len(pending):
                return periods
            period = simple(float(slopes[pending[0]]), float(blurs[pending[0]]))
            same = _are_simplest(period, slopes[pending], blurs[pending])
            same[0] = True
            for place in pending[same].tolist():
                periods[place] = period
            pending = pending[~same]
        for place in pending.tolist():
            periods[place] = simple(float(slopes[place]), float(blurs[place]))
        return periods


def _are_simplest(period: Fraction, values: Floats, blurs: Floats) -> Booleans:
    """Return for which values `simple` certainly returns this period.

    Two fractions with denominators up to D are at least 1 / D**2 apart. So a period with such a
    denominator is unique if it is nearer than half of this distance.
    """
    power = max(1, len(str(period.denominator - 1)))
    if power > 7:  # floats are too coarse
        return np.zeros(len(values), bool)
    room = 0.49 / 10.0 ** (2 * power)
    return np.asarray((np.abs(values - float(period)) <= 0.999 * blurs) & (blurs <= room))
