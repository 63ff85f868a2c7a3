"""Traces of many groups of a table at once, as `read_ruled` returns the trace of each.

A group is plain if its samples are certain to be read without an error: all values are there, times
increase in even steps, and no other column separates objects within it. All other groups, and all
groups under the options that `GroupTraces` lists, are read one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import RtamtError
from rtamt.columns import may_tell_objects, own_times, unit_of_times
from rtamt.errors import shown
from rtamt.internal import TraceRows, may_separate
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.group_axes import GroupAxes, GroupRows
from rtamt_gym.recorded.groups import GroupRecording, GroupTable
from rtamt_gym.recorded.names import (
    check_near,
    check_recorded,
    needed_columns,
    recorded_variables,
    starts_of,
    with_columns,
)
from rtamt_gym.recorded.recording import Floats, Rows, Wanted, selection_notes
from rtamt_gym.recorded.roles import RowTable, has_time_bounds
from rtamt_gym.recorded.ruled import IF_EVENTS, check_bounds
from rtamt_gym.recorded.sample_rows import wanted_samples, wanted_times
from rtamt_gym.recorded.times import TimeColumn, find_times
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.tables import number

Booleans = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class _Layout:
    """The common columns and times of all groups of a table.

    Attributes:
        columns: The column options, with the annotations of the specifications.
        time: The columns of times; None without them.
        rows: The values and times of all groups.
        column_of: The column of each variable.
        cells: The columns that may separate objects by their names.
        texts: The unread columns of texts.
    """

    columns: Columns
    time: TimeColumn | None
    rows: Rows
    column_of: Mapping[str, str]
    cells: Mapping[str, NDArray[Any]]
    texts: Mapping[str, NDArray[Any]]


class GroupTraces:
    """The traces of groups of a table.

    Args:
        table: The table.
        specs: The requirements.
        reading: The evaluation options.
        columns: How the columns of each group are read.
        more: The traces of more requirements, to read their common columns once.
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
        self._table, self._specs, self._reading = table, specs, reading
        self._period = reading.seconds
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
        table, specs, period = self._table, self._specs, self._period
        columns = with_columns(specs, columns)
        columns = replace(columns, starts=starts_of(specs, columns))
        recording = GroupRecording(table.source, table, np.zeros(0, np.intp), columns.decimal)
        for spec in specs.values():
            check_recorded(table.source, table.names, spec.variables, columns)
        variables = list(dict.fromkeys(v for spec in specs.values() for v in spec.variables))
        read = {columns.column(name) for name in variables}
        bounded = any(map(has_time_bounds, specs.values()))
        needed = period is None and (bounded or columns.time_unit is not None)
        time = find_times(recording, columns, read=read, needed=needed)
        if time is None and columns.time_unit is not None:
            return None
        check_near(table.source, table.names, variables, columns)
        if recorded_variables(table.names, variables, columns) != variables:
            return None  # some variables have defaults
        numbers = needed_columns(recording, variables, columns, IF_EVENTS)
        rules = RowTable(recording, columns, read, time)
        if self._has_clocks(columns, time, read):
            return None
        if time is None and bounded and period is None:
            named = any(unit_of_times(name) is not None for name in read)
            if rules.unread or named or table.above:
                return None  # a column may be times
        rows = self._rows(numbers, time, columns)
        if rows is None or rows.step is not None or rows.sparse:
            return None
        first, timed = table.names[0], rows.times is not None
        if (time is not None) != timed or (rows.times is not None and rows.times.dtype.kind == "b"):
            return None
        names = [] if columns.one_trace else rules.unread
        near = [n for n in names if may_tell_objects(n, read, timed=timed, first=n == first)]
        texts = [n for n in names if n in table.texts and n not in near and timed]
        cell_tables = [self._cells(part, rows.count, columns) for part in (near, texts)]
        if None in cell_tables:
            return None
        cells, others = (part or {} for part in cell_tables)
        column_of = {name: columns.column(name) for name in variables}
        return _Layout(columns, time, rows, column_of, cells, others)

    def _rows(
        self, numbers: Sequence[str], time: TimeColumn | None, columns: Columns
    ) -> Rows | None:
        """Return the values and times of all groups; None if they cannot be read together."""
        plain = {*numbers, *(() if time is None else time.columns)}.isdisjoint(self._table.texts)
        more = None if self._more is None else self._more._layout  # noqa: SLF001 - of this class
        if plain and more is not None and more.time == time and {*numbers} <= {*more.rows.numbers}:
            return more.rows
        wanted = wanted_samples(numbers, time, columns, IF_EVENTS)
        rows = self._table.read(wanted)
        if rows is None and plain:
            # An empty cell of one group leaves the others plain.
            rows = self._table.read(replace(wanted, gaps=numbers, nan=True))
        return rows

    def _has_clocks(self, columns: Columns, time: TimeColumn | None, read: set[str]) -> bool:
        """Return whether variables have their own columns of times."""
        if columns.time is not None or (time is not None and time.part is not None):
            return False
        clocks = {own_times(name, self._table.names) for name in self._table.names if name in read}
        clocks -= {None}
        main = next(iter(clocks), None) if time is None else time.name
        return main is not None and bool(clocks - {main})

    def _cells(
        self, names: Sequence[str], count: int, columns: Columns
    ) -> dict[str, NDArray[Any]] | None:
        """Return columns without conversion; None if they cannot be read."""
        if not names:
            return {}
        rows = self._table.read(Wanted((), cells=names, where=columns.where))
        if rows is None:
            return None
        return {name: values for name, values in rows.cells.items() if len(values) == count}

    def block(self, names: Sequence[str], places: Sequence[NDArray[np.intp]]) -> GroupBlock | None:
        """Return the traces of some groups; None to read groups one by one.

        Args:
            names: The names of the traces.
            places: The rows of each group.
        """
        layout = self._layout
        if layout is None:
            return None
        lengths = np.array([len(part) for part in places], np.int64)
        rows = GroupRows(np.cumsum(lengths) - lengths, lengths)
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
            self._layout.time is not None or self._period is not None
        )

    @property
    def stated(self) -> Fraction | None:
        """The stated period."""
        return self._period

    @property
    def table(self) -> GroupTable:
        """The table."""
        return self._table

    @property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """The declared ranges of variables."""
        return {n: ends for spec in self._specs.values() for n, ends in spec.ranges.items()}


class GroupBlock:
    """The traces of some groups.

    Args:
        traces: The traces of the table.
        layout: The common columns and times of all groups.
        names: The names of the traces.
        places: The rows of each group in the table.
        rows: The rows of each group in the columns.
        chosen: The rows of the table in the columns.

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
        if layout.time is not None and layout.rows.times is not None:
            self._measure(layout.rows.times[chosen], layout.time)
        self._leave_separated(chosen)
        self.too_short &= self.plain
        self.plain &= ~self.too_short
        self._constants = self._constant_values()

    def _measure(self, raw: NDArray[Any], time: TimeColumn) -> None:
        """Find the periods and the gaps of the groups."""
        layout, rows, stated = self._layout, self.rows, self._traces.stated
        axes = GroupAxes(raw, rows, time.name, layout.rows.unit, layout.columns)
        self._axes = axes
        self.plain &= axes.plain
        if stated is not None:
            self.plain &= axes.near(float(stated))
            as_stated = layout.columns.missing == "raise"
            self._gaps = axes.gaps(float(stated) if as_stated else None)
            return
        if (rows.lengths == 2).any():
            wanted = wanted_times(Wanted(()), time, layout.columns)
            step = self._traces.table.usual_step(wanted)
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
        layout, table, columns = self._layout, self._traces.table, self._layout.columns
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
            self._place(self._places[i]),
            None,
            IF_EVENTS,
            [*dict.fromkeys(notes)],
            gap=gap,
        )

    @cached_property
    def _doubtful(self) -> Booleans:
        return np.zeros(0, bool) if self._axes is None else self._axes.doubtful

    def _place(self, places: NDArray[np.intp]) -> Callable[[int], str]:
        where = self._layout.rows.where
        return lambda row: where(int(places[row]))
