"""Refusals of the traces in a data frame, as `check_roles` refuses a frame of the same rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

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
from rtamt.errors import InputError
from rtamt.inputs.frames import cells_and_times, check_roles, is_dated, names_of
from rtamt.inputs.groups import RowPlaces

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

    def have(self, marks: Booleans) -> Booleans:
        """Return which traces have a mark after their first row.

        Args:
            marks: A mark for each row in the order of the traces but the very first.
        """
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
    """Yield the number and the error of each trace that `check_roles` refuses.

    Args:
        data: The values; only frames are checked.
        variables: The variables of the formula.
        rows: The rows of the traces.
        timed: Whether the formula has bounds and there is no period.
    """
    names = names_of(data)
    if names is None or not len(rows.lengths):
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
