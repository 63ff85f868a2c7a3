"""Columns of Arrow as arrays of NumPy.

The conversions of pyarrow import pandas wherever it is installed, which takes longer than to read
a million rows; the protocol of DLPack imports nothing.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rtamt_gym.recorded.dates import RawTimes
from rtamt_gym.recorded.recording import Floats

__all__ = ["cells_of", "floats_of", "is_number", "is_time", "raw_times_of"]

_NUMBERS = (
    pa.types.is_integer,
    pa.types.is_floating,
    pa.types.is_boolean,
    pa.types.is_decimal,
    pa.types.is_null,
)


def is_number(kind: pa.DataType) -> bool:
    """Whether a type is one of numbers, or of cells that are all empty."""
    return any(is_kind(kind) for is_kind in _NUMBERS)


def is_time(kind: pa.DataType) -> bool:
    """Whether a type is one of dates or of durations."""
    return bool(pa.types.is_timestamp(kind) or pa.types.is_date(kind) or pa.types.is_duration(kind))


def floats_of(column: pa.ChunkedArray) -> Floats:
    """The numbers of a column; nan where a cell is empty."""
    if not pa.types.is_float64(column.type):
        column = column.cast(pa.float64(), safe=False)
    if column.null_count:
        column = column.fill_null(pa.scalar(np.nan, pa.float64()))
    return _array(column)


def cells_of(column: pa.ChunkedArray) -> NDArray[Any]:
    """The cells of a column as they are: numbers, with nan in an empty cell, dates, or texts."""
    kind = column.type
    if pa.types.is_boolean(kind) and not column.null_count:
        return np.array(column.to_pylist(), bool)
    if is_time(kind) and not column.null_count:
        times = raw_times_of(column)
        if times is not None:
            return times
    if pa.types.is_integer(kind) and not column.null_count:
        return np.array(column.to_pylist())
    if is_number(kind):
        return floats_of(column)
    cells = ["" if cell is None else str(cell).strip() for cell in column.to_pylist()]
    return np.array(cells or [""])[: len(cells)]


def raw_times_of(column: pa.ChunkedArray) -> RawTimes | None:
    """The numbers, dates or durations of a column without empty cells.

    None if 64 bits cannot count them, dates and durations in nanoseconds.
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
    whole = column.combine_chunks()
    if not len(whole):
        return np.zeros(0, np.int64 if pa.types.is_integer(whole.type) else np.float64)
    return cast("NDArray[Any]", np.from_dlpack(whole))
