"""Recordings whose columns are arrays: formats of numbers, where no cell is text."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.recording import Floats, RowNumbers, Rows, Wanted
from rtamt_gym.recorded.times import RawTimes, read_dates

__all__ = ["ArrayRecording", "check_gaps", "columns_in", "times_of"]


class ArrayRecording:
    """Named arrays of one length; nan counts as an empty cell.

    Args:
        source: Name of the file, for messages.
        arrays: The columns, whose lengths are compared where they are read.
        invalid: The cells of columns that are nan though there is a record; the reader says so.
    """

    def __init__(
        self,
        source: str,
        arrays: Mapping[str, NDArray[Any]],
        invalid: Mapping[str, NDArray[np.bool_]] | None = None,
    ) -> None:
        self.source = shown(source)
        arrays = {shown(name): array for name, array in arrays.items()}
        self.names: Sequence[str] = list(arrays)
        self.dates: Sequence[str] = [n for n, array in arrays.items() if array.dtype.kind == "M"]
        self._arrays = arrays
        self._invalid = {shown(name): wrong for name, wrong in (invalid or {}).items()}

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns."""
        names = [*wanted.numbers, *wanted.texts, *([] if wanted.time is None else [wanted.time])]
        columns = {name: self._arrays[name] for name in names}
        lengths = {len(column) for column in columns.values()}
        if len(lengths) > 1:
            each = ", ".join(f"{name}: {len(column)}" for name, column in columns.items())
            raise InputError(f"{self.source}: expected columns of one length, got {each}")
        if not lengths:
            lengths = {max(map(len, self._arrays.values()), default=0)}

        where = RowNumbers(self.source)
        numbers = {name: self._numbers(name) for name in wanted.numbers}
        for name, values in numbers.items():
            if not (name in self._invalid and self._invalid[name].any()):  # that has its own error
                check_gaps(values, wanted, name, where)
        texts = {name: [str(text) for text in columns[name]] for name in wanted.texts}
        times = None
        if wanted.time is not None:
            times = times_of(columns[wanted.time], f"{self.source}, column '{wanted.time}'")
        count = lengths.pop()
        return Rows(numbers, texts, count, where, self.source, times, invalid=self._invalid)

    def _numbers(self, name: str) -> Floats:
        values = self._arrays[name]
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


def times_of(values: NDArray[Any], where: str) -> RawTimes:
    """A column of times as it is, or the dates in its texts.

    Raises:
        InputError: If they are no times.
    """
    kind = values.dtype.kind
    if kind in "OSUT":
        dates = read_dates([str(text) for text in values.tolist()])
        if dates is not None:
            return dates
    if kind not in "iufmM":
        raise InputError(f"{where}: expected numbers or dates, got {values.dtype}")
    return values.astype(np.int64) if kind in "iu" else values


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
        if array.dtype.names:
            fields = {field: array[field] for field in array.dtype.names}
            yield from columns_in(fields, f"{dotted}.")
        elif (
            array.dtype.kind in "biufmMUT" and array.size and array.size == max(array.shape or (1,))
        ):
            yield dotted, array.reshape(-1)
