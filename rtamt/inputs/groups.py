"""Traces in one table: groups of rows by key columns, their periods, and refusals of traces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from rtamt.columns import (
    calendar_unit,
    dates_of_numbers,
    flagged_row,
    is_date,
    may_tell_objects,
    split_times,
    stated_period,
    unit_of_times,
)
from rtamt.errors import InputError, InputTypeError, no_such
from rtamt.inputs.arrays import kind_of, line_of_numbers
from rtamt.inputs.frames import cells_and_times, check_roles, is_dated, named_columns, names_of
from rtamt.language.interval import UNITS
from rtamt.program.timing import simplest

RowPlaces = NDArray[np.int64]


class Groups(NamedTuple):
    """The groups of a table, in the order of their first rows.

    Attributes:
        keys: The value of each key column in each group.
        order: The rows of all groups, one group after another, in the order of the table; None if
            the rows are in this order.
        begins: The place in this order at which each group begins.
        lengths: The number of rows of each group.
    """

    keys: Mapping[str, NDArray[Any]]
    order: NDArray[np.intp] | None
    begins: RowPlaces
    lengths: RowPlaces


def table_of(data: object) -> Mapping[str, Any]:
    """Return a data frame or a mapping of columns as columns by name."""
    table = named_columns(data)
    if not (isinstance(table, Mapping) or hasattr(table, "keys")):
        raise InputTypeError(
            f"expected a data frame or a mapping of columns for by=, got {kind_of(data)}"
        )
    return cast("Mapping[str, Any]", table)


def groups_of(table: Mapping[str, Any], by: Sequence[str]) -> Groups:
    """Return the groups of the rows that have the same values in some columns."""
    for name in by:
        if name not in table.keys():  # noqa: SIM118 - a data frame
            raise InputError(no_such("column", name, table.keys()))
    columns = {name: _cells(table[name], name) for name in by}
    sizes = {len(column) for column in columns.values()}
    if len(sizes) > 1:
        raise InputError(f"expected key columns of one length, got {sorted(sizes)}")
    rows = sizes.pop()
    if not rows:
        none = np.zeros(0, np.int64)
        return Groups(columns, None, none, none)
    changes = np.zeros(rows - 1, bool)
    for column in columns.values():
        changes |= column[1:] != column[:-1]
    starts = np.concatenate([[0], np.flatnonzero(changes) + 1])
    ends = np.append(starts[1:], rows)
    # Most tables are sorted by object: then each run of equal keys is a group.
    codes = _codes([column[starts] for column in columns.values()])
    count = int(codes.max()) + 1
    if count == len(starts):
        keys = {name: column[starts] for name, column in columns.items()}
        return Groups(keys, None, starts.astype(np.int64), (ends - starts).astype(np.int64))
    first = np.full(count, len(starts))
    np.minimum.at(first, codes, np.arange(len(starts)))
    keys = {name: column[starts[first]] for name, column in columns.items()}
    of_rows = np.repeat(codes, ends - starts)
    order = np.argsort(of_rows, kind="stable")
    lengths = np.bincount(of_rows, minlength=count).astype(np.int64)
    begins = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64)
    return Groups(keys, order, begins, lengths)


def _codes(columns: Sequence[NDArray[Any]]) -> NDArray[np.intp]:
    """Return a number for each row, from 0 in the order of first rows; equal for equal rows."""
    numbered = [_numbered(column) for column in columns]
    codes = numbered[0]
    for other in numbered[1:]:
        codes = _numbered(codes * (int(other.max()) + 1) + other)
    return codes


def _numbered(cells: NDArray[Any]) -> NDArray[np.intp]:
    if cells.dtype.kind == "O":  # cells may be of several types
        known: dict[object, int] = {}
        return np.array([known.setdefault(cell, len(known)) for cell in cells.tolist()], np.intp)
    _, first, inverse = np.unique(cells, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


def _cells(column: Any, name: str) -> NDArray[Any]:  # noqa: ANN401 - of any library
    """Return the cells of a key column, none of which is empty."""
    cells = np.asarray(column)
    if cells.ndim != 1:
        raise InputError(f"expected a 1-D key column '{name}', got shape {cells.shape}")
    if cells.dtype.kind == "O":
        empty = np.array([cell is None or cell != cell for cell in cells.tolist()], bool)  # noqa: PLR0124
    elif cells.dtype.kind in "fmM":
        empty = np.isnan(cells) if cells.dtype.kind == "f" else np.isnat(cells)
    else:
        return cells
    if empty.any():
        raise InputError(
            f"expected a value of the key column '{name}' in every row, got none in row "
            f"{int(empty.argmax()) + 1}; drop these rows or fill them"
        )
    return cells


Booleans = NDArray[np.bool_]


class TraceRows(NamedTuple):
    """The rows of each trace in a table.

    Attributes:
        order: The rows of all traces, one trace after another; None for the order of the table.
        begins: The place in this order at which each trace begins.
        lengths: The number of rows of each trace.
    """

    order: NDArray[np.intp] | None
    begins: RowPlaces
    lengths: RowPlaces

    def sorted(self, cells: NDArray[Any]) -> NDArray[Any]:
        """Return the cells of a column in the order of the traces."""
        return cells if self.order is None else cells[self.order]

    def steps(self, times: NDArray[Any]) -> NDArray[Any]:
        """Return the distances of successive times within traces."""
        steps, ends = np.diff(self.sorted(times)), self.begins[self.begins > 0] - 1
        return np.delete(steps, ends[ends < len(steps)])

    def have(self, marks: Booleans) -> Booleans:
        """Return which traces have a mark after their first row; the very first row has no mark."""
        counts = np.concatenate([[0, 0], np.cumsum(marks)])
        ends = self.begins + self.lengths
        return np.asarray(counts[ends] > counts[np.minimum(self.begins + 1, ends)])


def refusals(
    data: Any,  # noqa: ANN401 - of any library
    variables: Sequence[str],
    rows: TraceRows,
    *,
    timed: bool,
) -> Iterator[tuple[int, InputError]]:
    """Yield the number and the error of each trace that `check_roles` refuses."""
    names = names_of(data)
    if names is None:
        if len(rows.lengths):
            check_roles(data, variables, timed=timed)
        return
    if not len(rows.lengths):
        return
    ignored = [name for name in names if str(name) not in variables]
    first = str(names[0])
    suspects = _may_mix_objects(data, ignored, variables, rows, first)
    if timed:
        suspects |= _may_hold_times(data, ignored, rows)
    for i in np.flatnonzero(suspects & (rows.lengths > 0)).tolist():
        places = slice(int(rows.begins[i]), int(rows.begins[i] + rows.lengths[i]))
        if rows.order is None:
            part = _taken(data, np.arange(places.start, places.stop))
        else:
            part = _taken(data, rows.order[places])
        try:
            check_roles(part, variables, timed=timed)
        except InputError as error:
            yield i, error


def _taken(frame: Any, places: NDArray[np.intp]) -> Any:  # noqa: ANN401 - of any library
    """Return some rows of a frame."""
    if hasattr(frame, "iloc"):
        return frame.iloc[places]
    return frame.take(places) if hasattr(frame, "take") else frame[places]


def _may_mix_objects(
    frame: Any,  # noqa: ANN401 - of any library
    ignored: Sequence[Any],
    variables: Sequence[str],
    rows: TraceRows,
    first: str,
) -> Booleans:
    """Return which traces may have rows of several objects; the others cannot."""
    cells, instants = cells_and_times(frame, ignored)
    suspects = np.zeros(len(rows.lengths), bool)
    if instants is not None:
        times = rows.sorted(instants)
        suspects |= rows.have(~(times[1:] > times[:-1]))
    for name, column in cells.items():
        if may_tell_objects(name, variables, timed=instants is not None, first=name == first):
            suspects |= may_separate(name, rows.sorted(np.asarray(column)), rows)
    return suspects


def may_separate(name: str, cells: NDArray[Any], rows: TraceRows) -> Booleans:
    """Return which traces have values of a column that may separate objects or episodes.

    Values that never change do not, nor numbers that rise in every row, nor a flag that is set up
    to the last row.
    """
    flag = flagged_row(name)
    if cells.dtype.kind not in "biuf":
        texts = np.array([*map(str, cells.tolist())])
        return np.ones(len(rows.lengths), bool) if flag else rows.have(texts[1:] != texts[:-1])
    falls = rows.have(~(cells[1:] >= cells[:-1]))
    if flag == "first":
        return falls | rows.have(cells[1:] != 0)
    if flag == "last":
        return falls
    rises, repeats = rows.have(cells[1:] > cells[:-1]), rows.have(cells[1:] == cells[:-1])
    return falls | (rises & repeats)


def _may_hold_times(
    frame: Any,  # noqa: ANN401 - of any library
    ignored: Sequence[Any],
    rows: TraceRows,
) -> Booleans:
    """Return which traces may have a column or an index of times; the others cannot."""
    every = np.ones(len(rows.lengths), bool)
    if split_times([*map(str, ignored)]):
        return every
    columns = [(str(name), frame[name]) for name in ignored]
    index: Any = getattr(frame, "index", None)
    if index is not None:
        columns.append((str(index.name or ""), index))
    suspects = ~every
    for name, column in columns:
        stated = stated_period(name, 1.0, single=False) is not None
        if unit_of_times(name) is not None or calendar_unit(name) is not None or stated:
            return every
        cells = np.asarray(column)
        if cells.dtype.kind in "OUT" and any(map(is_date, {*map(str, cells.tolist())})):
            return every
        if is_dated(column):
            return every
        if cells.dtype.kind in "iuf":
            suspects |= _may_rise_as_times(rows.sorted(cells), rows)
    return suspects


def _may_rise_as_times(cells: NDArray[Any], rows: TraceRows) -> Booleans:
    """Return which traces have numbers that rise, or fall, in every row, and do not count rows."""
    up, down = cells[1:] > cells[:-1], cells[1:] < cells[:-1]
    monotone = ~rows.have(~up) | ~rows.have(~down)
    counts = ~rows.have(np.abs(cells[1:] - cells[:-1]) != 1)
    if dates_of_numbers(cells) is not None:
        counts[:] = False
    return np.asarray(monotone & ~counts & (rows.lengths > 1))


_NEAR = Fraction(1, 20)
"""The part of the period by which a sample may lie off the even times."""

_HOLE = 1.75
"""From so many steps of other groups on, two rows may have a gap between them."""


def seconds_of(table: Mapping[str, Any], name: str) -> NDArray[np.float64]:
    """Return a column of times as seconds from the earliest one."""
    if name not in table.keys():  # noqa: SIM118 - a data frame
        raise InputError(no_such("column", name, table.keys()))
    column = np.asarray(table[name])
    if column.dtype.kind in "mM":
        if np.isnat(column).any():
            row = int(np.isnat(column).argmax())
            raise InputError(f"expected a time '{name}' in every row, got none in row {row + 1}")
        ticks = column.astype(f"{column.dtype.kind}8[ns]").astype(np.int64)
        since: NDArray[np.float64] = (ticks - (ticks.min() if len(ticks) else 0)) / 1e9
        return since
    unit = unit_of_times(name) or "s"
    if unit not in UNITS:
        raise InputError(
            f"expected a column of times in {', '.join(UNITS)}, got '{name}' in {unit}; rename it"
        )
    times = line_of_numbers(table[name], f"the times '{name}'")
    if not np.isfinite(times).all():
        row = int((~np.isfinite(times)).argmax())
        raise InputError(
            f"expected a finite time '{name}' in every row, got {times[row]} in row {row + 1}"
        )
    return times * float(UNITS[unit])


def periods_of(
    times: NDArray[np.float64], groups: Groups, *, even: bool
) -> list[Fraction | InputError | None]:
    """Return the period of each group; an error for times that do not increase evenly.

    ``times`` are seconds in the order of the groups. A group of one row has None, and so has every
    group unless ``even``, because distances of times do not matter then.
    """
    begins, lengths = groups.begins, groups.lengths
    last = times[begins + lengths - 1]
    spans = last - times[begins]
    steps = np.divide(spans, lengths - 1, out=np.zeros(len(spans)), where=lengths > 1)
    rises = np.ones(len(times), bool)
    rises[1:] = times[1:] > times[:-1]
    rises[begins] = True
    ordered = np.logical_and.reduceat(rises, begins)
    within = np.arange(len(times)) - np.repeat(begins, lengths)
    ideal = np.repeat(times[begins], lengths) + within * np.repeat(steps, lengths)
    off = np.maximum.reduceat(np.abs(times - ideal), begins)
    blur = 4 * np.spacing(np.maximum(np.abs(last), np.abs(times[begins])))
    even_groups = (lengths > 2) & ordered & (off <= float(_NEAR) * steps + blur)
    least = float(steps[even_groups].min()) if even_groups.any() else np.inf
    rows: list[Fraction | InputError | None] = []
    known: dict[tuple[float, float], Fraction] = {}
    for i, (step, count) in enumerate(zip(steps.tolist(), lengths.tolist(), strict=True)):
        if not ordered[i]:
            begin = int(begins[i])
            row = int((~rises[begin : begin + count]).argmax())
            earlier, later = times[begin + row - 1 : begin + row + 1]
            rows.append(
                InputError(
                    f"expected times that increase, got {later:.12g} s after {earlier:.12g} s; "
                    "sort the rows by time"
                )
            )
        elif count == 1 or not even:
            rows.append(None)
        elif off[i] > _NEAR * Fraction(step) + Fraction(blur[i]):
            rows.append(
                InputError(
                    f"expected times at even distances, got samples up to {off[i]:.3g} s off a "
                    f"step of {step:.6g} s; resample the rows, or pass period= in place of time="
                )
            )
        elif count == 2 and step >= _HOLE * least:
            rows.append(
                InputError(
                    f"expected a step of {least:.6g} s as in other groups, got two rows "
                    f"{step:.6g} s apart, which may be a step or a gap; leave the group out, or "
                    "judge it alone"
                )
            )
        else:
            # A thousandth of what the samples may be off: neighbouring groups agree.
            near = max(step * 1e-9, blur[i] / (count - 1), off[i] / (count - 1))
            key = step, near
            if key not in known:
                known[key] = simplest(
                    Fraction(step) - Fraction(near), Fraction(step) + Fraction(near)
                )
            rows.append(known[key])
    return rows
