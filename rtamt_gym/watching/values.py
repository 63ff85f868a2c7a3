"""Numbers and times in the cells of a stream, by the rules for files.

A file decides its decimal mark when it has been read. A stream must decide it at once: the first
cell with one reading decides, and a cell with two readings before it is an error.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import Any, NamedTuple

import numpy as np

import rtamt
from rtamt import InputError
from rtamt.columns import may_tell_objects, own_times
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.recorded.cells import (
    NOT_KNOWN,
    OTHER_MARK,
    TextCells,
    floats_in,
    is_number,
    read_dates,
    times_in,
)
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.names import (
    TimeColumn,
    are_long,
    check_near,
    check_recorded,
    find_times,
    misspellings,
    misspelt_value,
    needed_columns,
    recorded_variables,
    take_default,
)
from rtamt_gym.recorded.recording import Floats, RawTimes, Recording
from rtamt_gym.recorded.roles import has_time_bounds, names_totals
from rtamt_gym.recorded.text_numbers import COMMA_NOTE, ColumnMarks, grouped_note, stated_mark_note
from rtamt_gym.recorded.times import join_times
from rtamt_gym.watching.clock import StreamDates
from rtamt_gym.watching.groups import GroupNames
from rtamt_gym.watching.one_trace import Guard, GuardedColumn, totals_fault
from rtamt_gym.watching.rows import ColumnCells, RowBlock, RowFault, cell_text


class Numbered(NamedTuple):
    """The numbers of a block.

    Attributes:
        values: A row for each line, a column for each variable; nan where a cell is empty.
        times: The raw times; None without a column of times.
        groups: The group of each line; None without groups.
    """

    values: Floats
    times: RawTimes | None
    groups: Sequence[str] | None


class _Head(Recording):
    """The first row of a stream, for the rules that choose columns."""

    def __init__(self, source: str, names: Sequence[str], block: RowBlock) -> None:
        first = {name: cell_text(cells[0]) for name, cells in block.columns.items()}
        self.source, self.names = source, names
        self.dates = [name for name, cell in first.items() if read_dates([cell]) is not None]
        self.days = [name for name in self.dates if len(first[name].strip()) <= len("2024-10-10 ")]
        self.texts = [
            name
            for name, cell in first.items()
            if name not in self.dates and cell.strip() and not _is_number(cell)
        ]
        self.blank = [name for name, cell in first.items() if not cell.strip()]


class StreamColumns:
    """The columns of a stream, and the step from cells to numbers.

    Args:
        source: The name of the stream, for messages.
        specs: The requirements by name.
        columns: How columns are read, with the defaults of the requirements.
        by: The columns that name groups.
        dense: Whether rows are events.
        period: Whether the period is stated, so that times are left aside.
    """

    def __init__(
        self,
        source: str,
        specs: dict[str, rtamt.Specification],
        columns: Columns,
        *,
        by: Sequence[str],
        dense: bool,
        period: bool,
    ) -> None:
        self._source, self._specs, self._columns, self._by = source, specs, columns, by
        self._dense, self._period = dense, period
        self._mark = columns.decimal
        self._grouped = ""
        """The first cell whose digits stand in groups."""
        self.variables = list(dict.fromkeys(v for spec in specs.values() for v in spec.variables))
        self.there: list[str] = []
        """The variables that have a column."""
        self.time: TimeColumn | None = None
        self.notes: list[str] = []
        self._groups = GroupNames(by)
        self._marks: dict[str, ColumnMarks] = {}
        self._read: set[str] = set()
        self._guarded: dict[str, GuardedColumn] = {}
        self._unread: Sequence[str] = ()
        self._guards: dict[str | None, list[Guard]] = {}
        self._near: dict[tuple[str, str], bool] = {}
        """Columns of variables and others of nearly their names; whether a row has both."""
        self._timed = self._uneven = False
        self._dates = StreamDates()
        self.needed: set[str] = set()
        """The columns of variables, times and groups."""

    def choose(self, names: Sequence[str], block: RowBlock, *, totals: bool = False) -> list[str]:
        """Find the columns to read, by the names and the first row; return their names."""
        columns, variables = self._columns, self.variables
        head = _Head(self._source, names, block)
        read = self._read = {columns.column(name) for name in variables}
        if are_long(names, variables):
            raise InputError(
                f"{self._source}: expected a column for each variable, got rows of one variable "
                "each. Write a column for each, or evaluate the recording with rtamt monitor."
            )
        for spec in self._specs.values():
            check_recorded(self._source, names, spec.variables, columns)
        timed = any(map(has_time_bounds, self._specs.values()))
        self.time = find_times(head, columns, read=read, needed=timed and not self._period)
        if self.time is None and self._dense:
            raise InputError(
                f"{self._source}: expected a column of times for --dense, got none. Give --time "
                "COLUMN."
            )
        if self.time is None and timed and not self._period:
            raise InputError(
                f"{self._source}: expected a column of times for the time bounds, got none. Give "
                "--time COLUMN, or --period SECONDS, or --period 1 to count samples."
            )
        check_near(self._source, names, variables, columns)
        self.there = recorded_variables(names, variables, columns)
        if columns.decimal is not None:
            self._marks = {columns.column(name): ColumnMarks() for name in self.there}
        needed = needed_columns(head, self.there, columns)
        for name in variables:
            if name not in self.there:
                why = "the column is missing"
                self.notes.append(take_default(self._source, name, columns, why))
        times = [] if self.time is None else self.time.columns
        self._groups.check(self._source, names, times)
        self._check_clocks(names)
        used = self.needed = {*needed, *times, *self._by}
        self._timed = self.time is not None
        self._uneven = self._timed and (self._dense or self._period)
        unread = [name for name in names if name not in used]
        self._near = dict.fromkeys(misspellings(columns, self.there, unread), False)
        if not columns.one_trace:
            self._choose_guarded(head, unread, totals=totals and not self._by)
        near = [name for _, name in self._near]
        return [*dict.fromkeys([*needed, *times, *self._by, *self._guarded, *near])]

    def _choose_guarded(self, head: _Head, unread: Sequence[str], *, totals: bool) -> None:
        """Choose the columns that may show several traces, or a row of totals."""
        texts = [*head.texts, *head.blank] if totals else []
        self._unread = unread if totals else []
        for name in dict.fromkeys(unread):
            first = name == head.names[0]
            may_tell = may_tell_objects(name, self._read, timed=self._timed, first=first)
            if may_tell or name in texts or (self._uneven and name not in head.dates):
                self._guarded[name] = GuardedColumn(
                    *(name, self._read, name in head.texts, self._timed, first, self._uneven),
                    totals=name in texts,
                )

    def _check_clocks(self, names: Sequence[str]) -> None:
        """Check that no variable has a column of times of its own."""
        if self._columns.time is not None or (self.time is not None and self.time.part is not None):
            return
        owned = {name: own_times(name, names) for name in names if name in self._read}
        clocks = {own: name for name, own in owned.items() if own not in (None, *self._read)}
        main = next(iter(clocks), None) if self.time is None else self.time.name
        for own, name in clocks.items():
            if own != main:
                raise InputError(
                    f"{self._source}: expected one column of times, but '{name}' may have its own, "
                    f"'{own}', next to '{main}'. Give --time {shlex.quote(str(main))} if each row "
                    "is one instant, or evaluate the recording with rtamt monitor."
                )

    def take_field(self, name: str, value: object) -> tuple[str, bool]:
        """Take a field that the first line of a stream does not have.

        Args:
            name: Its name.
            value: Its first value.

        Returns:
            Its fault, or an empty text; whether further blocks have its column.
        """
        columns = self._columns
        for variable in self.variables:
            column = columns.column(variable)
            if variable in self.there:
                continue
            fault = ""
            if name == column:
                fault = "Write all fields in the first line."
            elif variable not in columns.defaults and misspellings(columns, [variable], [name]):
                fault = (
                    f"Write '{column}' in the first line, or give --default {variable} if '{name}' "
                    "is another signal."
                )
            if fault:
                absent = f"'{column}' is not in the first line, so its variable has its "
                return f"got '{name}', but {absent}default. {fault}", False
        near = misspellings(columns, self.there, [name])
        self._near |= dict.fromkeys(near, False)
        texts = isinstance(value, str) and not _is_number(value)
        guarded = not columns.one_trace and (
            self._uneven or may_tell_objects(name, self._read, timed=self._timed)
        )
        if guarded:
            column_guards = self._guarded[name] = GuardedColumn(
                *(name, self._read, texts), timed=True, first=False, uneven=self._uneven
            )
            for guards in self._guards.values():
                guards.extend(column_guards.guards())
        return "", bool(near) or guarded

    def mark_notes(self) -> list[str]:
        """Return the notes on the decimal mark, as files have them."""
        stated, mark = self._columns.decimal is not None, self._mark or "."
        notes = [COMMA_NOTE] * (not stated and mark == ",")
        notes += [grouped_note(self._grouped, mark)] if self._grouped else []
        cells = {name: marks.grouped(mark) for name, marks in self._marks.items()}
        return notes + [stated_mark_note(name, cell, mark) for name, cell in cells.items() if cell]

    def _look_for_marks(self, block: RowBlock) -> None:
        """Look for evidence that a stated mark separates groups of digits."""
        for name, marks in [*self._marks.items()]:
            cells = [cell for cell in block.columns[name] if isinstance(cell, str)]
            marks.add(TextCells(cells), 0, brief=True)
            if marks.evidence or marks.digits:
                del self._marks[name]

    def numbers(self, block: RowBlock) -> Numbered:
        """Return the numbers of a block."""
        mark = self._mark
        try:
            return self._numbers(block)
        except (InputError, RowFault):
            self._mark = mark
            return self._one_by_one(block)

    def check_one_trace(
        self, group: str | None, block: RowBlock, times: RawTimes | None, begin: int, end: int
    ) -> None:
        """Check that rows of a group belong to one object or episode; rows must come once each."""
        if not self._guarded:
            return
        guards = self._guards.get(group)
        if guards is None:
            guards = self._guards[group] = [
                guard for column in self._guarded.values() for guard in column.guards()
            ]
        faults = []
        for guard in guards:
            try:
                here = None if times is None else times[begin:end]
                guard.check(block.columns[guard.name][begin:end], here)
            except RowFault as fault:
                faults.append(fault)
        if faults:
            first = min(faults, key=lambda fault: fault.row)
            first.row += begin
            raise first

    @property
    def guarded(self) -> bool:
        """Whether columns may show that a trace has ended."""
        return bool(self._guarded)

    def group_at(self, block: RowBlock, row: int) -> str | None:
        """Return the group of a bad row; None without groups, or if its cell is not a name."""
        return self._groups.at(block, row)

    def totals_in(self, cells: Mapping[str, str]) -> str:
        """Return the fault of a last row of totals in a column of numbers; empty without one."""
        for name in self._unread:
            text = cells.get(name, "").strip()
            guard = self._guarded.get(name)
            if names_totals(text) and not (guard is not None and guard.totals):
                return totals_fault(name, text)
        return ""

    def group_of_totals(self, group: str) -> str:
        """Return the fault of a last row, alone in a group with the name of a row of totals."""
        parts = [part.rpartition("=")[2] for part in group.split(",")]
        if self._columns.one_trace or not any(map(names_totals, parts)):
            return ""
        return (
            f"expected rows of a trace, but {group!r} in '{', '.join(self._by)}' names a row of "
            "totals. Remove it, or give --one-trace if it is a trace."
        )

    def end_trace(self, group: str | None, *, early: bool = False, beyond: int = 0) -> str:
        """Return the fault that the rows of a trace show; empty if they were one trace."""
        guards = self._guards.pop(group, ())
        faults = (guard.finish(early=early, beyond=beyond) for guard in guards)
        return next(filter(None, faults), "")

    def _one_by_one(self, block: RowBlock) -> Numbered:
        """Raise the fault of the first bad row."""
        mark = self._mark
        for row in range(len(block.lines)):
            one = block.part(row, row + 1)
            try:
                self._numbers(one)
            except RowFault as fault:
                self._mark = mark
                raise RowFault(row, fault.reason, skippable=fault.skippable) from None
            except InputError as error:
                self._mark = mark
                raise RowFault(row, str(error)) from None
        self._mark = mark
        return self._numbers(block)

    def _numbers(self, block: RowBlock) -> Numbered:
        count = len(block.lines)
        columns = self._columns
        names = [columns.column(name) for name in self.there]
        times = [] if self.time is None else self.time.columns
        kinds = {
            name: frozenset(map(type, block.columns[name])) for name in dict.fromkeys(names + times)
        }
        if self._mark is None:
            self._decide(block, [name for name, types in kinds.items() if str in types])
        gaps, nan = columns.missing != "raise" or self._dense, columns.missing != "raise"
        read: dict[str, Floats] = {}
        for name in names:
            if name not in read:
                cells = block.columns[name]
                read[name] = self._floats(cells, kinds[name], name, gaps=gaps, nan=nan)
        values = np.empty((count, len(self.variables)))
        for index, name in enumerate(self.variables):
            column = columns.column(name)
            values[:, index] = read[column] if name in self.there else columns.starts[name]
        self._check_spelling(block, read)
        groups = self._groups.of(block) if self._by else None
        numbered = Numbered(values, self._times(block), groups)
        if self._marks:
            self._look_for_marks(block)
        return numbered

    def _check_spelling(self, block: RowBlock, read: Mapping[str, Floats]) -> None:
        """Check that a row without a value of a variable does not have it under a misspelt name."""
        for (column, name), both in self._near.items():
            if both or name not in block.columns:
                continue
            empty = np.isnan(read[column])
            others = np.array([bool(cell_text(cell).strip()) for cell in block.columns[name]])
            lost, together = empty & others, ~empty & others
            first = int(lost.argmax()) if lost.any() else len(lost)
            if together[:first].any():
                self._near[column, name] = True
            elif lost.any():
                raise RowFault(first, misspelt_value(column, name))

    def _decide(self, block: RowBlock, names: Sequence[str]) -> None:
        """Find the decimal mark in texts, in the order of rows."""
        texts = [block.columns[name] for name in names if _may_have_mark(block.columns[name])]
        if not texts:
            return
        for row, cells in enumerate(zip(*texts, strict=True)):
            marks: dict[str, str] = {}
            unclear = ""
            for raw in cells:
                cell = raw.strip() if isinstance(raw, str) else ""
                if ("." not in cell and "," not in cell) or cell.lower() in NOT_KNOWN:
                    continue
                readings = [mark for mark in OTHER_MARK if is_number(cell, mark)]
                if len(readings) == 1:
                    marks.setdefault(readings[0], cell)
                elif readings:
                    unclear = unclear or cell
            if len(marks) == 2:
                first, second = marks.values()
                raise RowFault(
                    row,
                    f"expected one decimal mark, got {first!r} and {second!r}; give --decimal . or "
                    "--decimal ,",
                )
            if marks:
                (self._mark,) = marks
                return
            if unclear:
                point, comma = (floats_in([unclear], mark) for mark in OTHER_MARK)
                both = [f"{read[0]:.15g}" for read in (point, comma) if read is not None]
                raise RowFault(
                    row,
                    f"expected numbers that can be read in one way, got {unclear!r}; give "
                    f"--decimal . to read it as {both[0]}, or --decimal , to read it as {both[1]}",
                    skippable=False,
                )

    def _floats(
        self, cells: ColumnCells, kinds: AbstractSet[type], name: str, *, gaps: bool, nan: bool
    ) -> Floats:
        mark = self._mark or "."
        if kinds <= {str}:
            read = None if mark == "," else read_floats(cells)
            values = None if read is None else np.array(read)
            if values is None or np.isnan(values).any():
                values = self._of_texts(cells, mark, gaps=gaps, nan=nan)
        elif kinds <= {float, int}:
            values = _floats_of(cells)
        else:
            values = self._mixed(cells, mark, gaps=gaps, nan=nan)
        if values is None:
            raise self._not_a_number(cells, name, mark, gaps=gaps, nan=nan)
        return values

    def _of_texts(self, cells: Sequence[str], mark: str, *, gaps: bool, nan: bool) -> Floats | None:
        """Return the numbers of texts; None if a text is not a number."""
        read = TextCells(cells).numbers(mark, gaps=gaps, nan=nan)
        if read is None:
            return None
        self._grouped = self._grouped or read.grouped
        return read.values

    def _mixed(self, cells: ColumnCells, mark: str, *, gaps: bool, nan: bool) -> Floats | None:
        """Return the numbers in values of JSON, which may be null, truth values or texts."""
        values = np.empty(len(cells))
        for row, cell in enumerate(cells):
            if cell is None:
                cell = ""  # noqa: PLW2901 - an empty cell
            if isinstance(cell, str):
                one = self._of_texts([cell], mark, gaps=gaps, nan=nan)
                if one is None:
                    return None
                values[row] = one[0]
            elif isinstance(cell, bool | int | float):
                values[row] = float(cell)
            else:
                return None
        return values

    def _not_a_number(
        self, cells: ColumnCells, name: str, mark: str, *, gaps: bool, nan: bool
    ) -> RowFault:
        for row, cell in enumerate(cells):  # noqa: B007 - the first wrong row
            if self._mixed([cell], mark, gaps=gaps, nan=nan) is None:
                break
        text = cell_text(cell)
        advice = ""
        if not text.strip() or text.strip().lower() in NOT_KNOWN:
            hold = "" if self._dense else "--missing hold or "
            advice = f"; give {hold}--missing unknown"
            advice = "; give --missing drop to read nan as no event" if self._dense else advice
        return RowFault(row, f"column '{name}': expected a number, got {text!r}{advice}")

    def _times(self, block: RowBlock) -> RawTimes | None:
        if self.time is None:
            return None
        order, mark = self._columns.date_order, self._mark or "."
        cells = block.columns[self.time.name]
        part = self.time.part
        self._dates.check_kind(self.time.name, cells)
        if part is not None and part.unit:
            parts = block.columns[part.column]
            return join_times(_raw_times(cells, mark), _raw_times(parts, mark), part.unit, str)
        days = None if part is None else list(map(cell_text, block.columns[part.column]))
        if order is None:
            order = self._dates.order(self.time.name, cells, days)
        # Dates are read next to the first one, which shows their form and whether they have a zone.
        first, dated = self._dates.first, self._dates.dated
        if first is not None and dated:
            cells = [first[0], *cells]
            days = None if days is None else [first[1], *days]
        times = _raw_times(cells, mark, days=days, order=order)
        if first is None and len(times):
            self._dates.first = cells[0], "" if days is None else days[0]
            self._dates.dated = times.dtype.kind in "mM"
        elif not dated and times.dtype.kind in "mM":
            raise InputError(
                f"column '{self.time.name}': expected a number, as in the first row, got "
                f"{cells[0]!r}"
            )
        return times[1:] if first is not None and dated else times

    def unit_of_parts(self) -> str:
        """Return the unit of times of two columns; empty if there is one column."""
        return "ns" if self.time is not None and self.time.part and self.time.part.unit else ""


def _raw_times(
    cells: ColumnCells,
    mark: str,
    days: Sequence[str] | None = None,
    order: Any = None,  # noqa: ANN401
) -> RawTimes:
    """Return times of texts or of numbers of JSON."""
    kinds = set(map(type, cells))
    if kinds == {str}:
        # Cells without a point may be integers of 64 bits.
        points = days is None and mark == "." and all("." in cell for cell in cells)
        if points and (read := read_floats(cells)) is not None:
            return np.array(read)
        times, _ = times_in(TextCells(cells), mark, _row_of, days, order)
        return times
    if kinds == {int}:
        try:
            return np.array(cells, np.int64)
        except OverflowError:
            raise InputError(f"expected times of 64 bits, got {cells[0]}") from None
    if kinds <= {int, float}:
        return _floats_of(cells)
    wrong = next(cell for cell in cells if type(cell) not in (int, float))
    raise InputError(f"expected a time, got {cell_text(wrong)!r}")


def _may_have_mark(cells: ColumnCells) -> bool:
    together = "".join(cell for cell in cells if isinstance(cell, str))
    return "." in together or "," in together


def _floats_of(cells: ColumnCells) -> Floats:
    try:
        return np.array(cells, np.float64)
    except OverflowError:
        raise InputError("expected numbers that a double can hold") from None


def _row_of(row: int) -> str:
    del row
    return "column of times"


def _is_number(cell: str) -> bool:
    return any(is_number(cell.strip(), mark) for mark in OTHER_MARK)


def without_place(error: InputError) -> str:
    """Return the text of an error without the line, which the caller adds."""
    text = str(error)
    _, comma, remainder = text.partition(", line ")
    _, colon, fault = remainder.partition(": ")
    return fault if comma and colon else text
