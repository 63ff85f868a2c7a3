"""Tables with rows of several objects: one trace for each value of the ``--by`` columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.columns import median, unit_of_times
from rtamt.errors import nearest, no_such, shown
from rtamt.internal import groups_of
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.arrays import ArrayRecording
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import TracePart, file_of, group_name, group_names, part_of
from rtamt_gym.recorded.readers import FORMATS, format_of, open_recording
from rtamt_gym.recorded.recording import (
    Floats,
    RawTimes,
    Recording,
    RowFilter,
    Rows,
    Wanted,
    cell_texts,
    check_one_writing,
    places_of,
)
from rtamt_gym.recorded.roles import names_totals
from rtamt_gym.recorded.times import (
    raw_steps,
)
from rtamt_gym.tables import counted

Booleans = NDArray[np.bool_]

_Keys = tuple[str, ...]
_Cells = tuple[dict[str, NDArray[Any]], Callable[[int], str]]

_MOST_TABLES = 2
"""The maximum number of tables in memory."""


@dataclass(frozen=True, slots=True)
class GroupRows:
    """Neighbouring rows that belong to one group each.

    Attributes:
        begins: The first row of each group.
        lengths: The number of rows, one or more.
    """

    begins: NDArray[np.int64]
    lengths: NDArray[np.int64]

    @staticmethod
    def of(lengths: NDArray[np.int64]) -> GroupRows:
        """Return the rows of groups that follow each other."""
        return GroupRows(np.cumsum(lengths) - lengths, lengths)

    def least(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the minimum of each group."""
        return np.minimum.reduceat(values, self.begins)

    def greatest(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the maximum of each group."""
        return np.maximum.reduceat(values, self.begins)

    def any(self, marks: Booleans) -> Booleans:
        """Return whether each group has a mark."""
        return np.logical_or.reduceat(marks, self.begins)

    def repeated(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the value of its group for each row."""
        return np.repeat(values, self.lengths)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """The number of each row in its group."""
        return np.asarray(np.arange(int(self.lengths.sum())) - self.repeated(self.begins))

    def medians(self, values: Floats) -> Floats:
        """Return the median of each group, as `median` does."""
        result = np.empty(len(self.lengths))
        for n in np.unique(self.lengths).tolist():
            (chosen,) = np.nonzero(self.lengths == n)
            if n > 10_000 or len(chosen) == 1:
                for i in chosen.tolist():
                    result[i] = median(values[self.begins[i] : self.begins[i] + n])
                continue
            ordered = np.sort(values[self.begins[chosen][:, None] + np.arange(n)], axis=1)
            middle = n // 2
            result[chosen] = ordered[:, middle]
            if not n % 2:
                result[chosen] = (ordered[:, middle - 1] + ordered[:, middle]) / 2
        return result


class GroupTable:
    """A table of several objects, which is read once for all of them.

    Attributes:
        rows: The rows of each group, by the texts of its keys, in the order of first rows.
        values: The keys of each group with their types.
        names: The names of the columns.
        where: The required text of the columns that select rows.
        blank_rows: The number of rows without an object, which are in no group.
    """

    def __init__(self, file: str, columns: Columns, span: tuple[int, int] | None = None) -> None:
        self._file, self._columns, self._span = file, columns, span
        self._plain, self.where = replace(columns, by=()), columns.where
        self._whole: dict[str, Rows | None] = {}
        self._read_cells: dict[tuple[str, ...], _Cells] = {}
        self._traces: dict[str, _Keys] = {}
        self._steps: dict[str, float | None] = {}
        self._selected: dict[tuple[tuple[str, str], ...], dict[_Keys, list[bool]]] = {}
        self.blank_rows = 0
        with self._opened() as recording:
            self.source = recording.source
            self.names, self.dates, self.days = recording.names, recording.dates, recording.days
            self.texts, self.blank, self.above = recording.texts, recording.blank, recording.above
            for name in columns.by:
                if name not in self.names:
                    raise InputError(f"{self.source}: {no_such('column', name, self.names)}")
            as_text = self._as_text = format_of(file) is FORMATS[0]
            keys = Wanted(
                [],
                texts=columns.by if as_text else (),
                cells=() if as_text else columns.by,
                where=columns.where,
            )
            rows = recording.read(keys)
        if not rows.count:
            raise InputError(f"{self.source}: expected at least one row, got none")
        self._group(
            rows, {n: np.array(rows.texts[n]) if as_text else rows.cells[n] for n in columns.by}
        )

    def _opened(self) -> AbstractContextManager[Recording]:
        """Open the file, or the rows of the span."""
        if self._span is None:
            return open_recording(self._file, self._plain)
        from rtamt_gym.recorded.arrow_reader import open_parquet

        return open_parquet(self._file, self._plain, self._span)

    def _group(self, rows: Rows, cells: Mapping[str, NDArray[Any]]) -> None:
        """Find the rows of each group; equal texts of keys are one group."""
        absent = self._without_object(rows.count, cells)
        (there,) = np.nonzero(~absent)
        self.blank_rows = rows.count - len(there)
        if not len(there):
            raise InputError(f"{self.source}: expected a row with an object, got none")
        cells = {name: column[there] for name, column in cells.items()}
        _check_keys(rows, there, cells)
        groups = groups_of(cells, self._columns.by)
        order = there if groups.order is None else there[groups.order]
        texts = zip(*(cell_texts(column) for column in groups.keys.values()), strict=True)
        typed = zip(*(column.tolist() for column in groups.keys.values()), strict=True)
        self.rows: dict[_Keys, NDArray[np.intp]] = {}
        self.values: dict[_Keys, dict[str, object]] = {}
        for key, values, begin, count in zip(
            texts, typed, groups.begins.tolist(), groups.lengths.tolist(), strict=True
        ):
            part = order[begin : begin + count]
            before = self.rows.get(key)
            self.rows[key] = part if before is None else np.sort(np.concatenate([before, part]))
            self.values.setdefault(key, dict(zip(self._columns.by, values, strict=True)))
        self._check_totals(rows)
        for i, name in enumerate(self._columns.by):
            check_one_writing(self.source, name, dict.fromkeys(keys[i] for keys in self.rows))

    def _check_totals(self, rows: Rows) -> None:
        """Check that a last row that is alone in its group does not name totals."""
        if self._columns.one_trace or len(self.rows) == 1:
            return
        key, part = next(reversed(self.rows.items()))
        if len(part) == 1 and part[0] == rows.count - 1 and any(map(names_totals, key)):
            raise InputError(
                f"{rows.where(rows.count - 1)}: expected rows of a trace, but {', '.join(key)!r} "
                f"in '{', '.join(self._columns.by)}' names a row of totals. Remove it, or give "
                "--one-trace if it is a trace."
            )

    def _without_object(self, count: int, cells: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
        """Return the rows in which all cells are empty except times.

        SUMO writes such a row for a step without vehicles.
        """
        blank = np.ones(count, bool)
        for column in cells.values():
            blank &= _empty(column)
        if not blank.any():
            return blank
        names = [n for n in self.names if n not in cells and unit_of_times(n) is None]
        for column in self.cells(names)[0].values():
            blank &= _empty(column)
        return blank

    def traces(self, chosen: Mapping[str, str]) -> Mapping[str, _Keys]:
        """Return the keys of each group by the name of its trace."""
        if not self._traces:
            self._traces = group_names(file_of(self._file), self._columns.by, self.values, chosen)
        return self._traces

    @property
    def blank_notes(self) -> list[str]:
        """The note on rows without an object; empty without such rows."""
        count = self.blank_rows
        return [f"{counted(count, 'row')} of the file without an object in no group"] * bool(count)

    def read(self, wanted: Wanted) -> Rows | None:
        """Return columns of all groups; None if a cell of any group is an error."""
        key = repr(wanted)
        if key not in self._whole:
            self._whole[key] = None
            with suppress(InputError), self._opened() as recording:
                self._whole[key] = recording.read(wanted)
        return self._whole[key]

    def usual_step(self, wanted: Wanted) -> float | None:
        """Return the smallest usual distance of times in groups of three rows or more, or None."""
        if self._span is not None:
            return _index(self._file, self._columns).usual_step(wanted)
        return self.own_step(wanted)

    def own_step(self, wanted: Wanted) -> float | None:
        """Return the usual step of the table, or of the part of the file that it holds."""
        wanted = replace(wanted, numbers=(), gaps=(), texts=(), cells=())
        key = repr(wanted)
        if key not in self._steps:
            rows = self.read(wanted)
            self._steps[key] = None if rows is None else self._usual_step(rows.times)
        return self._steps[key]

    def _usual_step(self, times: RawTimes | None) -> float | None:
        places = [part for part in self.rows.values() if len(part) > 2]
        if times is None or not places:
            return None
        lengths = np.array([len(part) for part in places], np.int64)
        inner = np.ones(int(lengths.sum()), bool)
        inner[np.cumsum(lengths) - 1] = False
        steps = np.append(raw_steps(times[np.concatenate(places)]), 0.0)[inner]
        rows = GroupRows.of(lengths - 1)
        medians = rows.medians(steps)[rows.least(steps) > 0]
        return float(medians.min()) if len(medians) else None

    def selected(self, where: Mapping[str, str]) -> Mapping[_Keys, list[bool]]:
        """Return whether each row of each group, also those left out, has these texts."""
        chosen = tuple(where.items())
        if chosen not in self._selected:
            with self._opened() as recording:
                if self._as_text:
                    texts = recording.read(Wanted([], texts=self._columns.by)).texts
                else:
                    cells = recording.read(Wanted([], cells=self._columns.by)).cells
                    texts = {name: cell_texts(column) for name, column in cells.items()}
                marks = recording.selected(where).tolist()
            marked = self._selected[chosen] = {}
            keys = zip(*(texts[name] for name in self._columns.by), strict=True)
            for key, mark in zip(keys, marks, strict=True):
                marked.setdefault(key, []).append(mark)
        return self._selected[chosen]

    def cells(self, names: Sequence[str]) -> _Cells:
        """Return columns without conversion, and a function to the place of a row."""
        names = tuple(dict.fromkeys(names))
        if names not in self._read_cells:
            wanted = Wanted([], cells=names, where=self._columns.where)
            with self._opened() as recording:
                rows = recording.read(wanted)
            cells = {name: rows.cells[name] for name in names if name in rows.cells}
            self._read_cells[names] = cells, rows.where
        return self._read_cells[names]


def _check_keys(rows: Rows, places: NDArray[np.intp], cells: Mapping[str, NDArray[Any]]) -> None:
    """Check that no cell of the key columns is empty in some rows."""
    for name, column in cells.items():
        if np.any(empty := _empty(column)):
            raise InputError(
                f"{rows.where(int(places[np.argmax(empty)]))}, column '{name}': expected a value "
                "of this --by column, got an empty cell"
            )


def _empty(column: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which cells are empty."""
    return np.asarray(np.isnan(column) if column.dtype.kind == "f" else column == "", bool)


class GroupRecording(Recording):
    """The rows of one group of a table."""

    def __init__(self, source: str, table: GroupTable, keys: _Keys, decimal: str | None) -> None:
        self._source, self._table, self._keys, self._decimal = source, table, keys, decimal
        self._rows = table.rows[keys]
        self.source = shown(source)
        self.names, self.dates, self.days = table.names, table.dates, table.days
        self.texts, self.blank, self.above = table.texts, table.blank, table.above

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns; an error in the rows of another group does not matter."""
        rows = self._read(wanted)
        notes = self._table.blank_notes
        return replace(rows, notes=[*rows.notes, *notes]) if notes else rows

    def usual_step(self, wanted: Wanted) -> float | None:
        """Return the usual distance of times in other groups, if this one has two rows only."""
        return self._table.usual_step(wanted) if len(self._rows) == 2 else None

    def selected(self, where: Mapping[str, str]) -> NDArray[np.bool_]:
        """Return whether each row of the group, also those that are left out, has these texts."""
        return np.array(self._table.selected(where)[self._keys])

    def _read(self, wanted: Wanted) -> Rows:
        more = {n: text for n, text in wanted.where.items() if n not in self._table.where}
        every = None if more else self._table.read(wanted)
        if every is None:
            return self._read_alone(replace(wanted, where=more))
        rows = self._rows
        return replace(
            every,
            numbers={name: column[rows] for name, column in every.numbers.items()},
            texts={name: [texts[row] for row in rows] for name, texts in every.texts.items()},
            count=len(rows),
            where=places_of(every.where, rows),
            source=self.source,
            times=None if every.times is None else every.times[rows],
            invalid={name: wrong[rows] for name, wrong in every.invalid.items()},
            cells={name: column[rows] for name, column in every.cells.items()},
        )

    def _read_alone(self, wanted: Wanted) -> Rows:
        """Read the columns of this group from the cells of the table."""
        cells, place = self._table.cells(wanted.names)
        rows = self._rows
        recording = ArrayRecording(
            self._source,
            {name: column[rows] for name, column in cells.items()},
            decimal=self._decimal,
            where=places_of(place, rows),
        )
        return recording.read(wanted)


_tables: dict[tuple[object, ...], GroupTable] = {}
_indices: dict[tuple[object, ...], SortedGroups] = {}


def _table(file: str, columns: Columns, span: tuple[int, int] | None = None) -> GroupTable:
    """Return a table, from memory if the file is the same as before."""
    columns, key = _key(file, columns)
    key = *key, span
    if key not in _tables:
        while len(_tables) >= _MOST_TABLES:
            del _tables[next(iter(_tables))]
        _tables[key] = GroupTable(file, columns, span)
    return _tables[key]


def _index(file: str, columns: Columns) -> SortedGroups:
    """Return the groups of a sorted file, from memory if the file is the same as before."""
    columns, key = _key(file, columns)
    if key not in _indices:
        _indices.clear()
        _indices[key] = SortedGroups(file, columns)
    return _indices[key]


def _key(file: str, columns: Columns) -> tuple[Columns, tuple[object, ...]]:
    """Return the options that a table depends on, and the key of the table in memory."""
    columns = replace(columns, starts={}, defaults=())
    stat = Path(file_of(file)).stat()
    return columns, (file, stat.st_size, stat.st_mtime_ns, repr(columns))


def groups_in(path: str, columns: Columns) -> dict[str, Mapping[str, object]]:
    """Return the names of the traces in a table, with the values of their keys."""
    row = format_of(path)
    if path == "-":
        raise InputError("expected a file for --by, got - for standard input")
    if not row.table or (row.several and not row.choice):
        raise InputError(f"{shown(path)}: expected a file of one table for --by, got {row.name}")
    outer = part_of(path)
    if (outer is not None) != row.choice:  # a group by its name, or a file with several tables
        return {path: {}}
    chosen = {} if outer is None else outer.values
    if (own := next((name for name in columns.by if name in chosen), None)) is not None:
        raise InputError(
            f"{shown(path)}: expected --by with another column than '{own}', which selects "
            f"a table of the file. Give the column another name, such as in a view."
        )
    columns = replace(
        columns, where={name: text for name, text in columns.where.items() if name not in chosen}
    )
    if columns.sorted and ".parquet" not in row.extensions:
        raise InputError(f"{shown(path)}: expected a Parquet file for --sorted, got {row.name}")
    opened: Callable[[str, Columns], GroupTable | SortedGroups] = (
        _index if columns.sorted else _table
    )
    try:
        table = opened(path, _for_table(columns, columns.by))
    except (InputError, ImportError, OSError, UnicodeDecodeError):
        return {path: {}}
    selected = {columns.by.index(n): text for n, text in columns.where.items() if n in columns.by}
    names: dict[str, Mapping[str, object]] = {
        name: {**chosen, **table.values[keys]}
        for name, keys in table.traces(chosen).items()
        if all(keys[index] == text for index, text in selected.items())
    }
    if not names:
        for index, text in selected.items():
            known = [*dict.fromkeys(keys[index] for keys in table.values)]
            if text not in known:
                raise InputError(
                    f"{shown(path)}: no row with {text!r} in the column '{columns.by[index]}', "
                    f"which --where names; its values are {listed(known, text)}"
                    f"{nearest(text, known)}"
                )
        texts = " and ".join(f"{name}={text}" for name, text in columns.where.items())
        raise InputError(f"{shown(path)}: no row with {texts}, which --where selects")
    return names


def _for_table(columns: Columns, by: Sequence[str]) -> Columns:
    """Return the options of a table, without the selection by keys."""
    where = {name: text for name, text in columns.where.items() if name not in by}
    return replace(columns, where=where, by=(*by,))


def _find(part: TracePart, columns: Columns) -> tuple[GroupTable, _Keys, dict[str, str]]:
    """Return the table of a group, its keys, and the keys that choose the table in its file."""
    file, values, chosen = part.file, dict(part.values), {}
    if format_of(file).choice:  # the first key is the table
        chosen = {part.key: values.pop(part.key)}
        file = group_name(file, chosen)
    keys, columns = tuple(values.values()), _for_table(columns, [*values])
    span = None
    if columns.sorted:
        index = _index(file, columns)
        span = index.spans.get(keys)
        if span is None:
            raise _no_group(part.file, keys, [*values], [*index.values])
    return _table(file, columns, span), keys, chosen


def _no_group(path: str, keys: _Keys, by: Sequence[str], known: Sequence[_Keys]) -> InputError:
    """Return the error about a group that a table does not have."""
    texts = [", ".join(key) for key in known]
    return InputError(
        f"{shown(path)}: no row with {', '.join(keys)} in {', '.join(by)}; the values are "
        f"{listed(texts, ', '.join(keys))}"
    )


def groups_by_table(
    paths: Sequence[str], columns: Columns
) -> Iterator[tuple[GroupTable, dict[int, NDArray[np.intp]]]]:
    """Yield each table with the rows of its groups, by the index of their traces in a list.

    Traces that are not groups, and unreadable tables, are omitted.
    """
    remaining = dict(zip(paths, range(len(paths)), strict=True))
    while remaining:
        path = next(iter(remaining))
        part = part_of(path)
        table, traces = None, dict[str, _Keys]({path: ()})
        if part is not None:
            with suppress(InputError, ImportError, OSError, UnicodeDecodeError):
                own = {n: text for n, text in columns.where.items() if n not in part.values}
                by = tuple(part.values)
                table, _, chosen = _find(part, replace(columns, where=own, by=by))
                traces = {path: (), **table.traces(chosen)}
        places = {remaining.pop(name): keys for name, keys in traces.items() if name in remaining}
        if table is not None:
            yield table, {i: table.rows[keys] for i, keys in places.items() if keys in table.rows}


@contextmanager
def open_group(path: str, columns: Columns) -> Iterator[Recording]:
    """Open a group of a table by the name of its trace."""
    part = part_of(path)
    if part is None:
        if not columns.by:
            raise InputError(f"{shown(path)}: expected the name of a group")
        kind = SortedGroups if columns.sorted else GroupTable
        kind(path, _for_table(columns, columns.by))  # raises its error
        raise InputError(f"{shown(path)}: expected a file that can be read, and it changed")
    table, keys, _ = _find(part, columns)
    if keys not in table.rows:
        raise _no_group(path, keys, [*part.values][-len(keys) :], [*table.rows])
    yield GroupRecording(path, table, keys, columns.decimal)


PART_ROWS: Final = 1 << 20
"""The rows after which a part of a file ends with its group."""


class SortedGroups:
    """The places of the groups in a Parquet file.

    Attributes:
        values: The keys of each group with their types, by the texts of the keys, in order.
        spans: The rows of the part that holds each group.
    """

    def __init__(self, file: str, columns: Columns) -> None:
        self._file, self._columns, self._by = file, columns, tuple(columns.by)
        self.values: dict[tuple[str, ...], dict[str, object]] = {}
        self._begins: dict[tuple[str, ...], int] = {}
        self._last: tuple[str, ...] | None = None
        self._end = 0
        self._steps: dict[str, float | None] = {}
        with open_recording(file, columns) as recording:
            self._source, names = recording.source, recording.names
        for name in self._by:
            if name not in names:
                raise InputError(f"{self._source}: {no_such('column', name, names)}")
        selection = RowFilter(columns.where, names, self._source)
        from rtamt_gym.recorded.arrow_reader import parquet_batches

        wanted = [*dict.fromkeys([*self._by, *columns.where])]
        for first, rows in parquet_batches(file, columns, wanted, PART_ROWS):
            for name in wanted:
                if name not in rows.cells:
                    raise InputError(f"{self._source}: expected numbers or texts in '{name}'")
            chosen = np.arange(rows.count)
            if columns.where:
                texts = {name: cell_texts(rows.cells[name]) for name in columns.where}
                (chosen,) = np.nonzero(selection.mask(texts))
            self._add(first, rows, chosen)
        if columns.where:
            selection.check()
        if not self.values:
            raise InputError(f"{self._source}: expected at least one row, got none")
        for i, name in enumerate(self._by):
            check_one_writing(self._source, name, dict.fromkeys(key[i] for key in self.values))
        self.spans = self._parts()

    def _add(self, first: int, rows: Rows, chosen: NDArray[np.intp]) -> None:
        """Add the selected rows of a part of the file."""
        if not len(chosen):
            return
        cells = [rows.cells[name][chosen] for name in self._by]
        _check_keys(rows, chosen, dict(zip(self._by, cells, strict=True)))
        starts = np.append(0, np.flatnonzero(_changes(cells)) + 1)
        texts = zip(*(cell_texts(column[starts]) for column in cells), strict=True)
        typed = zip(*(column[starts].tolist() for column in cells), strict=True)
        for key, values, start in zip(texts, typed, chosen[starts].tolist(), strict=True):
            if key == self._last:
                continue
            if key in self.values:
                group = ", ".join(map("=".join, zip(self._by, key, strict=True)))
                raise InputError(
                    f"{rows.where(start)}: expected the rows of {group} to follow each other, as "
                    f"--sorted states, got one after other groups. Sort the file by "
                    f"{', '.join(self._by)}, or leave --sorted out to read it into memory."
                )
            self.values[key] = dict(zip(self._by, values, strict=True))
            self._begins[key], self._last = first + start, key
        self._end = first + int(chosen[-1]) + 1

    def _parts(self) -> dict[tuple[str, ...], tuple[int, int]]:
        """Return the rows of the part that holds each group."""
        spans: dict[tuple[str, ...], tuple[int, int]] = {}
        keys = [*self._begins]
        ends = [*list(self._begins.values())[1:], self._end]
        part: list[tuple[str, ...]] = []
        for key, end in zip(keys, ends, strict=True):
            part.append(key)
            begin = self._begins[part[0]]
            if end - begin >= PART_ROWS or key is keys[-1]:
                spans |= dict.fromkeys(part, (begin, end))
                part = []
        return spans

    def traces(self, chosen: Mapping[str, str]) -> Mapping[str, tuple[str, ...]]:
        """Return the keys of each group by the name of its trace."""
        return group_names(file_of(self._file), self._by, self.values, chosen)

    def usual_step(self, wanted: Wanted) -> float | None:
        """Return the smallest usual distance of times in the groups of all parts, or None."""
        key = repr((wanted.time, wanted.part, wanted.where, wanted.date_order))
        if key not in self._steps:
            spans = dict.fromkeys(self.spans.values())
            steps = [GroupTable(self._file, self._columns, s).own_step(wanted) for s in spans]
            self._steps[key] = min((step for step in steps if step is not None), default=None)
        return self._steps[key]


def _changes(cells: Sequence[NDArray[Any]]) -> NDArray[np.bool_]:
    """Return whether each row after the first differs from the row before."""
    changes = np.zeros(len(cells[0]) - 1, bool)
    for column in cells:
        changes |= column[1:] != column[:-1]
    return changes
