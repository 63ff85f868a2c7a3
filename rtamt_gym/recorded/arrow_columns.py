"""Columns of Arrow as arrays of NumPy, and texts that pyarrow has split.

The conversions of pyarrow import pandas if it is installed, which takes longer than reading a
million rows. The DLPack protocol imports nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv

from rtamt_gym.recorded.cells import NOT_KNOWN, TRUTH, CellNumbers, TextCells, read_dates
from rtamt_gym.recorded.columns import DateOrder
from rtamt_gym.recorded.recording import Floats, RawTimes

_NUMBERS = (
    pa.types.is_integer,
    pa.types.is_floating,
    pa.types.is_boolean,
    pa.types.is_decimal,
    pa.types.is_null,
)


def is_number(kind: pa.DataType) -> bool:
    """Return whether a type holds numbers, or only empty cells."""
    return any(is_kind(kind) for is_kind in _NUMBERS)


def is_time(kind: pa.DataType) -> bool:
    """Return whether a type holds dates or durations."""
    return bool(pa.types.is_timestamp(kind) or pa.types.is_date(kind) or pa.types.is_duration(kind))


def floats_of(column: pa.ChunkedArray) -> Floats:
    """Return the numbers of a column; nan where a cell is empty."""
    if not pa.types.is_float64(column.type):
        column = column.cast(pa.float64(), safe=False)
    if column.null_count:
        column = column.fill_null(pa.scalar(np.nan, pa.float64()))
    return _array(column)


def values_of(column: pa.ChunkedArray) -> NDArray[Any]:
    """Return cells without conversion: numbers with nan in an empty cell, dates, or texts."""
    kind = column.type
    if pa.types.is_boolean(kind) and not column.null_count:
        return np.array(column.to_pylist(), bool)
    if is_time(kind) and not column.null_count:
        times = raw_times_of(column)
        if times is not None:
            return times
    if pa.types.is_integer(kind) and not column.null_count:
        integers = raw_times_of(column)
        return np.array(column.to_pylist()) if integers is None else integers
    if is_number(kind):
        return floats_of(column)
    cells = ["" if cell is None else str(cell).strip() for cell in column.to_pylist()]
    return np.array(cells or [""])[: len(cells)]


def raw_times_of(column: pa.ChunkedArray) -> RawTimes | None:
    """Return the numbers, dates or durations of a column without empty cells.

    Return None if 64 bits cannot hold them; dates and durations are in nanoseconds.
    """
    kind = column.type
    try:
        if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
            dates = column.cast(pa.timestamp("ns", getattr(kind, "tz", None)))
            return _array(dates.cast(pa.int64())).view("M8[ns]")
        if pa.types.is_duration(kind):
            return _array(column.cast(pa.duration("ns")).cast(pa.int64())).view("m8[ns]")
        if pa.types.is_integer(kind):
            return _array(column.cast(pa.int64()))
    except pa.ArrowInvalid:
        return None
    return floats_of(column)


def _array(column: pa.ChunkedArray) -> NDArray[Any]:
    array = column.combine_chunks()
    if not len(array):
        return np.zeros(0, np.int64 if pa.types.is_integer(array.type) else np.float64)
    return cast("NDArray[Any]", np.from_dlpack(array))


def split_text(
    path: str, separator: str, width: int, above: int, places: Collection[int]
) -> list[TextCells] | None:
    """Return the columns at some places of a text as pyarrow splits it; None if it does not.

    The rows have a width, and lines above the first of them.
    """
    names = list(map(str, range(width)))
    try:
        table = csv.read_csv(
            path,
            csv.ReadOptions(column_names=names, skip_rows=above),
            csv.ParseOptions(delimiter=separator),
            csv.ConvertOptions(
                column_types=dict.fromkeys(names, pa.string()),
                include_columns=list(map(str, places)),
                strings_can_be_null=False,
            ),
        )
    except (pa.ArrowException, OSError):
        return None
    return [ArrowCells(column) for column in table.columns]


class ArrowCells(TextCells):
    """The texts of a column of Arrow; pyarrow converts plain texts."""

    def __init__(self, column: pa.ChunkedArray) -> None:
        self._column = column

    @cached_property
    def _texts(self) -> Sequence[str]:  # type: ignore[override]
        return cast("list[str]", self._column.to_pylist())

    def __getitem__(self, place: Any) -> Any:  # noqa: ANN401 - as in `TextCells`
        if "_texts" not in vars(self) and isinstance(place, slice):
            begin, end, _ = place.indices(len(self))
            return self._column.slice(begin, end - begin).to_pylist()
        return self._texts[place]

    def __len__(self) -> int:
        return len(self._column)

    def __iter__(self) -> Iterator[str]:
        return iter(self._texts)

    def _parts(self) -> Iterator[bytes]:
        """Yield the bytes of all cells in parts, and free each part after use."""
        for part in self._column.chunks:
            data = part.buffers()[2]
            if data is not None:
                yield data.to_pybytes()

    def has(self, character: str) -> bool:
        """Return whether a character of ASCII occurs in a cell."""
        return any(character.encode() in part for part in self._parts())

    def selected(self, rows: NDArray[np.bool_]) -> TextCells:
        """Return the cells of some rows."""
        return ArrowCells(self._column.take(pa.array(np.nonzero(rows)[0])))

    def numbers(self, decimal: str, *, gaps: bool = False, nan: bool = False) -> CellNumbers | None:
        """Return the numbers; None if a cell is not a number."""
        with suppress(pa.ArrowInvalid):
            values = self._plain_floats(self._column, decimal)
            if values is not None and not np.isnan(values).any():
                return CellNumbers(values)
        cells = pc.utf8_lower(pc.utf8_trim_whitespace(self._column))
        words = ["", *(NOT_KNOWN if nan else ())] if gaps else []
        empty = pc.is_in(cells, value_set=pa.array(words, pa.string()))
        plain = pc.if_else(empty, pa.scalar(None, pa.string()), cells)
        for word, value in TRUTH.items():
            plain = pc.if_else(pc.equal(cells, word), f"{value:g}", plain)
        with suppress(pa.ArrowInvalid):
            values = self._plain_floats(plain, decimal)
            if values is not None and np.isnan(values).sum() == pc.sum(empty).as_py():
                return CellNumbers(values)
        return super().numbers(decimal, gaps=gaps, nan=nan)

    def _plain_floats(self, cells: pa.ChunkedArray, decimal: str) -> Floats | None:
        if decimal == ",":
            if self.has("."):
                return None
            cells = pc.replace_substring(cells, ",", ".")
        return floats_of(cells.cast(pa.float64()))

    def integers(self) -> NDArray[np.int64] | None:
        """Return the cells as integers of 64 bits; None if one is not."""
        if any(part.translate(None, b"0123456789- ") for part in self._parts()):
            return None
        with suppress(pa.ArrowInvalid):
            return raw_times_of(pc.utf8_trim_whitespace(self._column).cast(pa.int64()))
        return super().integers()

    def dates(self, order: DateOrder | None = None) -> RawTimes | None:
        """Return dates, times of day or durations; None if a cell is not such a time."""
        if read_dates(self[:1], order) is not None:
            for zone in (None, "UTC"):
                with suppress(pa.ArrowInvalid):
                    return raw_times_of(self._column.cast(pa.timestamp("ns", zone)))
        return super().dates(order)
