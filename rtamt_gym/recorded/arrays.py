"""Recordings with arrays as columns: archives of NumPy, files of MATLAB, and other formats."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.cells import times_of_texts
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import refusing
from rtamt_gym.recorded.recording import (
    Floats,
    RawTimes,
    Recording,
    RowFilter,
    RowNumbers,
    Rows,
    Wanted,
    cell_texts,
    places_of,
)
from rtamt_gym.recorded.text_numbers import numbers_in_texts
from rtamt_gym.recorded.times import join_times

_ARCHIVE: Final = "an archive of numpy.savez, whose arrays are numbers"


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open an archive of `numpy.savez`, or a file of MATLAB if its name ends in ``.mat``."""
    load = _load_mat if path.lower().endswith(".mat") else _load_npz
    yield ArrayRecording(path, dict(load(path)), decimal=columns.decimal)


def _load_npz(path: str) -> Iterator[tuple[str, NDArray[Any]]]:
    # Open the file here, because NumPy does not close a file that it cannot read.
    with Path(path).open("rb") as file, refusing(path, _ARCHIVE):
        archive = np.load(file, allow_pickle=False)
        if isinstance(archive, np.ndarray):
            raise InputError(f"{shown(path)}: expected {_ARCHIVE}")
        with archive:
            yield from _columns_in({name: archive[name] for name in archive.files})


def _load_mat(path: str) -> Iterator[tuple[str, NDArray[Any]]]:
    from scipy.io import loadmat

    with Path(path).open("rb") as file, refusing(path, "a whole MATLAB file"):
        try:
            data: dict[str, Any] = loadmat(file, simplify_cells=True)
        except NotImplementedError:
            raise InputError(
                f"{shown(path)}: expected a MATLAB file of version 7 or before, got 7.3; "
                "save it with save(..., '-v7')"
            ) from None
        yield from _columns_in({n: value for n, value in data.items() if not n.startswith("__")})


def _columns_in(data: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield vectors as columns, also of shape (1, n) or (n, 1), and fields with dotted names.

    A single number is a column only if the file has no vectors.
    """
    for name, value in data.items():
        dotted = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _columns_in(value, f"{dotted}.")
            continue
        array = np.asarray(value)
        if array.dtype.kind == "O" and all(isinstance(cell, str) for cell in array.flat):
            array = array.astype(str)
        if array.dtype.names:
            fields = {field: array[field] for field in array.dtype.names}
            yield from _columns_in(fields, f"{dotted}.")
        elif (
            array.dtype.kind in "biufmMUT" and array.size and array.size == max(array.shape or (1,))
        ):
            yield dotted, array.reshape(-1)


class ArrayRecording(Recording):
    """Named arrays of one length; nan counts as an empty cell.

    Args:
        source: Name of the file, for messages.
        arrays: The columns; a read checks their lengths.
        invalid: The cells of columns that are nan because their record has no number.
        decimal: The decimal mark of numbers that are text; None to recognise it.
        empty: The empty cells of columns, if the format distinguishes them from nan; for messages.
        where: Returns the place of a row, for messages; None: the number of the row.
    """

    def __init__(
        self,
        source: str,
        arrays: Mapping[str, NDArray[Any]],
        invalid: Mapping[str, NDArray[np.bool_]] | None = None,
        decimal: str | None = None,
        empty: Mapping[str, NDArray[np.bool_]] | None = None,
        where: Callable[[int], str] | None = None,
    ) -> None:
        self._where = where or RowNumbers(shown(source))
        self.source = shown(source)
        self._arrays = arrays = {shown(name): array for name, array in arrays.items()}
        self.names: Sequence[str] = list(arrays)
        self.dates = [name for name, array in arrays.items() if array.dtype.kind == "M"]
        self.texts = [name for name, array in arrays.items() if array.dtype.kind in "UT"]
        self._decimal, self._empty = decimal, empty or {}
        self._invalid = {shown(name): wrong for name, wrong in (invalid or {}).items()}

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns."""
        names = replace(wanted, cells=()).names
        selection = RowFilter(wanted.where, self.names, self.source)
        columns = {name: self._arrays[name] for name in names}
        lengths = {len(column) for column in columns.values()}
        if len(lengths) > 1:
            lengths_text = ", ".join(f"{name}: {len(column)}" for name, column in columns.items())
            raise InputError(f"{self.source}: expected columns of one length, got {lengths_text}")
        count = lengths.pop() if lengths else max(map(len, self._arrays.values()), default=0)
        cells = {name: self._arrays[name] for name in wanted.cells}
        invalid, empty, where = self._invalid, self._empty, self._where
        selected: NDArray[np.bool_] | None = None
        if wanted.where:
            selected = selection.mask({name: cell_texts(columns[name]) for name in wanted.where})
            selection.check()
            columns = {name: column[selected] for name, column in columns.items()}
            cells = {n: column[selected] for n, column in cells.items() if len(column) == count}
            invalid = {name: wrong[selected] for name, wrong in invalid.items()}
            empty = {name: none[selected] for name, none in empty.items()}
            (rows,) = np.nonzero(selected)
            count, where = len(rows), places_of(self._where, rows)
        written, times, notes = self._numbers_in_texts(wanted, names, where, selected)
        numbers = dict(written)
        for name in wanted.numbers:
            if name not in written:
                numbers[name] = self._numbers(name, columns[name])
                if not (name in invalid and invalid[name].any()):  # the reader reports these
                    none = empty.get(name, np.zeros(count, bool))
                    _check_gaps(name, numbers[name], none, wanted, where)
        for name in wanted.texts:
            if name in empty and empty[name].any():
                row = int(empty[name].argmax())
                raise InputError(f"{where(row)}, column '{name}': expected a name, got None")
        unit = ""
        if wanted.time is not None and times is None:
            if wanted.time in empty and empty[wanted.time].any():
                row = int(empty[wanted.time].argmax())
                position = f"{where(row)}, column '{wanted.time}'"
                raise InputError(f"{position}: expected a number, got none")
            part = None if wanted.part is None else columns[wanted.part.column]
            times, unit = _times_of(columns[wanted.time], wanted, self.source, where, part)
        return Rows(
            {name: numbers[name] for name in wanted.numbers},
            {name: [str(text) for text in columns[name]] for name in wanted.texts},
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
        selected: NDArray[np.bool_] | None,
    ) -> tuple[Mapping[str, Floats], RawTimes | None, list[str]]:
        """Return numbers and times from texts; all texts are evidence for the decimal mark."""
        if not {*names} & {*self.texts}:
            return {}, None, []
        count = len(self._arrays[names[0]])
        arrays = {n: self._arrays[n] for n in self.texts if len(self._arrays[n]) == count}
        texts = {name: [*map(str, array.tolist())] for name, array in arrays.items()}
        if wanted.part is not None:
            wanted = replace(wanted, time=None)  # dates and times of day, or parts of seconds
        return numbers_in_texts(texts, wanted, self._decimal, self.source, where, selected)

    def _numbers(self, name: str, values: NDArray[Any]) -> Floats:
        if values.dtype.kind not in "biuf":
            raise InputError(
                f"{self.source}, column '{name}': expected numbers, got {values.dtype}"
            )
        return np.ascontiguousarray(values, np.float64)


def _check_gaps(
    name: str,
    values: Floats,
    empty: NDArray[np.bool_],
    wanted: Wanted,
    where: Callable[[int], str],
) -> None:
    """Raise InputError for nan in a column that must not have empty cells."""
    absent = np.isnan(values)
    if name not in wanted.gaps and absent.any():
        row = int(absent.argmax())
        got = "none" if empty[row] else "nan"
        raise InputError(
            f"{where(row)}, column '{name}': expected a number, got {got}{wanted.empty}"
        )


def _times_of(
    values: NDArray[Any],
    wanted: Wanted,
    source: str,
    where: Callable[[int], str],
    part: NDArray[Any] | None,
) -> tuple[RawTimes, str]:
    """Return a column of times or the dates in its texts, and the unit if it is certain."""
    kind, column = values.dtype.kind, f"{source}, column '{wanted.time}'"
    if part is not None and wanted.part is not None and wanted.part.unit:
        if kind not in "iuf" or part.dtype.kind not in "iuf":
            raise InputError(f"{column}: expected numbers, got {values.dtype}")
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
        raise InputError(f"{column}: expected numbers or dates, got {values.dtype}")
    return values.astype(np.int64) if kind in "iu" else values, ""


def at_instants(
    instants: NDArray[Any], channels: Mapping[str, tuple[NDArray[Any], NDArray[Any]]]
) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[np.bool_]]]:
    """Return channels with different times as columns over common instants.

    Returns:
        The columns, nan where a channel has no record; and marks of records without a number.
    """
    arrays: dict[str, NDArray[Any]] = {}
    invalid = {}
    for name, (times, values) in channels.items():
        if values.dtype.kind not in "biuf":
            arrays[name] = values
            continue
        places = np.searchsorted(instants, times, side="right") - 1
        arrays[name] = np.full(len(instants), np.nan)
        arrays[name][places] = values
        invalid[name] = np.zeros(len(instants), bool)
        invalid[name][places] = np.isnan(arrays[name][places])
    return arrays, invalid


def check_records(rows: Rows, wanted: Wanted) -> None:
    """Check that a wanted column of times has a record in each row.

    A column of another group may have records at other times.
    """
    times, time = rows.times, wanted.time
    if time is None or times is None or times.dtype.kind != "f":
        return
    absent = np.isnan(times) & ~rows.invalid.get(time, np.zeros(rows.count, bool))
    if absent.any():
        row = int(absent.argmax())
        others = [f"'{name}'" for name, values in rows.numbers.items() if not np.isnan(values[row])]
        raise InputError(
            f"{rows.source}: '{time}' has no record at the times of "
            f"{' and '.join(others) or 'other columns'}; leave --time out"
        )
