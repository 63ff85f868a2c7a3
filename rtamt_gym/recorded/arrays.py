"""Recordings whose columns are arrays: formats of numbers, where no cell is text."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.dates import RawTimes, times_of_texts
from rtamt_gym.recorded.recording import Floats, RowNumbers, Rows, Wanted
from rtamt_gym.recorded.selection import RowFilter, cell_texts
from rtamt_gym.recorded.text_numbers import numbers_in_texts
from rtamt_gym.recorded.times import join_times

__all__ = ["ArrayRecording", "check_gaps", "columns_in", "times_of"]


_TEXTS = "UT"
"""The kinds of arrays of text."""


class ArrayRecording:
    """Named arrays of one length; nan counts as an empty cell.

    Args:
        source: Name of the file, for messages.
        arrays: The columns, whose lengths are compared where they are read.
        invalid: The cells of columns that are nan though there is a record; the reader says so.
        decimal: The decimal mark of numbers that are text; None to recognise it.
    """

    def __init__(
        self,
        source: str,
        arrays: Mapping[str, NDArray[Any]],
        invalid: Mapping[str, NDArray[np.bool_]] | None = None,
        decimal: str | None = None,
    ) -> None:
        self.source = shown(source)
        arrays = {shown(name): array for name, array in arrays.items()}
        self.names: Sequence[str] = list(arrays)
        self.dates: Sequence[str] = [n for n, array in arrays.items() if array.dtype.kind == "M"]
        self.texts = [n for n, array in arrays.items() if array.dtype.kind in _TEXTS]
        """The columns of texts."""
        self._arrays, self._decimal = arrays, decimal
        self._invalid = {shown(name): wrong for name, wrong in (invalid or {}).items()}

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns."""
        names = [*wanted.numbers, *wanted.texts, *([] if wanted.time is None else [wanted.time])]
        names += [*wanted.where, *([] if wanted.part is None else [wanted.part.column])]
        chosen = RowFilter(wanted.where, self.names, self.source)
        columns = {name: self._arrays[name] for name in names}
        lengths = {len(column) for column in columns.values()}
        if len(lengths) > 1:
            each = ", ".join(f"{name}: {len(column)}" for name, column in columns.items())
            raise InputError(f"{self.source}: expected columns of one length, got {each}")
        count = lengths.pop() if lengths else max(map(len, self._arrays.values()), default=0)
        cells = {name: self._arrays[name] for name in wanted.cells}
        invalid, where = self._invalid, RowNumbers(self.source)
        chosen_rows: Sequence[int] | None = None
        if wanted.where:
            kept = chosen.mask({name: cell_texts(columns[name]) for name in wanted.where})
            chosen.check()
            columns = {name: column[kept] for name, column in columns.items()}
            cells = {n: column[kept] for n, column in cells.items() if len(column) == count}
            invalid = {name: wrong[kept] for name, wrong in invalid.items()}
            (rows,) = np.nonzero(kept)
            count, where = len(rows), RowNumbers(self.source, rows)
            chosen_rows = rows.tolist()

        written, times, notes = self._numbers_in_texts(wanted, names, where, chosen_rows)
        numbers = {n: self._numbers(n, columns[n]) for n in wanted.numbers if n not in written}
        for name, values in numbers.items():
            if not (name in invalid and invalid[name].any()):  # that has its own error
                check_gaps(values, wanted, name, where)
        texts = {name: [str(text) for text in columns[name]] for name in wanted.texts}
        unit = ""
        if wanted.time is not None and times is None:
            part = None if wanted.part is None else columns[wanted.part.column]
            times, unit = times_of(columns[wanted.time], wanted, self.source, where, part)
        numbers = {name: (numbers | written)[name] for name in wanted.numbers}
        return Rows(
            numbers,
            texts,
            count,
            where,
            self.source,
            times,
            notes,
            unit=unit,
            invalid=invalid,
            cells=cells,
        )

    def _numbers_in_texts(
        self,
        wanted: Wanted,
        names: Sequence[str],
        where: Callable[[int], str],
        rows: Sequence[int] | None,
    ) -> tuple[dict[str, Floats], RawTimes | None, list[str]]:
        """Return the numbers and times that are text; the evidence is in all columns of text."""
        if all(self._arrays[name].dtype.kind not in _TEXTS for name in names):
            return {}, None, []
        count = len(self._arrays[names[0]])
        texts = {
            name: [*map(str, array.tolist())]
            for name, array in self._arrays.items()
            if array.dtype.kind in _TEXTS and len(array) == count
        }
        if wanted.part is not None:
            wanted = replace(wanted, time=None)  # dates and times of day, or parts of seconds
        return numbers_in_texts(texts, wanted, self._decimal, self.source, where, rows)

    def _numbers(self, name: str, values: NDArray[Any]) -> Floats:
        if values.dtype.kind not in "biuf":
            raise InputError(
                f"{self.source}, column '{name}': expected numbers, got {values.dtype}"
            )
        return np.ascontiguousarray(values, np.float64)


def check_gaps(
    values: Floats,
    wanted: Wanted,
    name: str,
    where: Callable[[int], str],
    none: Sequence[bool] = (),
) -> None:
    """Checks that a column of numbers has no nan, unless its cells may be empty.

    Args:
        values: The column.
        wanted: The columns to read.
        name: The name of the column.
        where: Says where a row stands.
        none: Whether the cell of each row is empty, if one is, for messages.

    Raises:
        InputError: If it has one.
    """
    absent = np.isnan(values)
    if name not in wanted.gaps and absent.any():
        row = int(absent.argmax())
        got = "none" if len(none) and none[row] else "nan"
        raise InputError(
            f"{where(row)}, column '{name}': expected a number, got {got}{wanted.empty}"
        )


def times_of(
    values: NDArray[Any],
    wanted: Wanted,
    source: str,
    where: Callable[[int], str],
    part: NDArray[Any] | None = None,
) -> tuple[RawTimes, str]:
    """Return a column of times as it is, or the dates in its texts; and the unit if it is certain.

    Args:
        values: The column.
        wanted: The columns to read.
        source: The name of the file, for messages.
        where: Returns the place of a row, for messages.
        part: The second column of times, or None.

    Raises:
        InputError: If they are not times.
    """
    kind, what = values.dtype.kind, f"{source}, column '{wanted.time}'"
    if part is not None and wanted.part is not None and wanted.part.unit:
        if kind not in "iuf" or part.dtype.kind not in "iuf":
            raise InputError(f"{what}: expected numbers, got {values.dtype}")
        return join_times(values, part, wanted.part.unit, where), "ns"
    if kind in "OSUT":
        texts = [str(text) for text in values.tolist()]
        days = None if part is None else [str(day).split("T")[0] for day in part.tolist()]
        if part is not None and part.dtype.kind == "M":
            days = [str(day) for day in part.astype("M8[D]")]
        times = times_of_texts(texts, days, wanted.date_order)
        if times is not None:
            return times, ""
    if kind not in "iufmM":
        raise InputError(f"{what}: expected numbers or dates, got {values.dtype}")
    return values.astype(np.int64) if kind in "iu" else values, ""


def columns_in(data: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """The columns among named values: vectors, also of shape (1, n) or (n, 1).

    A structure gives its fields with dotted names. A single number is no column, unless there are
    no vectors.
    """
    for name, value in data.items():
        dotted = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from columns_in(value, f"{dotted}.")
            continue
        array = np.asarray(value)
        if array.dtype.kind == "O" and all(isinstance(cell, str) for cell in array.flat):
            array = array.astype(str)
        if array.dtype.names:
            fields = {field: array[field] for field in array.dtype.names}
            yield from columns_in(fields, f"{dotted}.")
        elif (
            array.dtype.kind in "biufmMUT" and array.size and array.size == max(array.shape or (1,))
        ):
            yield dotted, array.reshape(-1)
