"""Reads long CSV files by pyarrow, and leaves what that does not read to others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc

from rtamt_gym.recorded.arrow_columns import floats_of, is_number, is_time, raw_times_of
from rtamt_gym.recorded.recording import Floats, Wanted
from rtamt_gym.recorded.times import RawTimes

__all__ = ["CsvColumns", "Text", "read_text"]


@dataclass(frozen=True, slots=True)
class Text:
    """A file of text, and how it is read.

    Attributes:
        path: The file, which may be compressed.
        names: The names of its columns.
        header: The line with the names, from 1.
        separator: The character between cells.
        decimal: The decimal mark.
    """

    path: str
    names: Sequence[str]
    header: int
    separator: str
    decimal: str


@dataclass(frozen=True, slots=True)
class CsvColumns:
    """The wanted columns of a text, as in `Rows`."""

    numbers: Mapping[str, Floats]
    texts: Mapping[str, Sequence[str]]
    count: int
    times: RawTimes | None


def read_text(text: Text, wanted: Wanted) -> CsvColumns | None:
    """Reads the wanted columns; None if a cell is wrong, or is one that pyarrow does not read."""
    table = _table(text, wanted)
    if table is None:
        return None
    numbers = {}
    for name in wanted.numbers:
        if not is_number(table[name].type):  # the column of times, which is read as it looks
            return None
        values = floats_of(table[name])
        absent = int(np.isnan(values).sum())
        allowed = len(values) if wanted.nan else table[name].null_count
        if absent > (allowed if name in wanted.gaps else 0):
            return None
        numbers[name] = values
    times = None
    if wanted.time is not None and (times := _times(table[wanted.time])) is None:
        return None
    texts = {name: [cell.strip() for cell in table[name].to_pylist()] for name in wanted.texts}
    return CsvColumns(numbers, texts, table.num_rows, times)


def _table(text: Text, wanted: Wanted) -> pa.Table | None:
    """The wanted columns; times have the type that they look like. None if a cell is wrong."""
    time = [] if wanted.time is None else [wanted.time]
    names = list(dict.fromkeys([*wanted.numbers, *wanted.texts, *time])) or text.names[:1]
    # Names in the file may have blanks around them, or come twice.
    places = [str(text.names.index(name)) for name in names]
    types = dict.fromkeys(wanted.numbers, pa.float64()) | dict.fromkeys(wanted.texts, pa.string())
    try:
        table = pc.read_csv(
            text.path,
            pc.ReadOptions(
                column_names=list(map(str, range(len(text.names)))),
                skip_rows=text.header,
            ),
            pc.ParseOptions(delimiter=text.separator),
            pc.ConvertOptions(
                column_types={
                    place: types[name]
                    for place, name in zip(places, names, strict=True)
                    if name in types and name not in time
                },
                include_columns=places,
                null_values=[""],
                decimal_point=text.decimal,
            ),
        )
    except (pa.ArrowException, OSError):
        return None
    return table.rename_columns(names)


def _times(column: pa.ChunkedArray) -> RawTimes | None:
    kind = column.type
    if column.null_count or not (is_number(kind) or is_time(kind)):
        return None
    times = raw_times_of(column)
    if times is None or (times.dtype.kind == "f" and np.isnan(times).any()):
        return None
    return times
