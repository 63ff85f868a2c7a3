"""Groups of rows of a table: one trace for each value of some columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError, InputTypeError, no_such
from rtamt.inputs.arrays import kind_of
from rtamt.inputs.frames import named_columns

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
