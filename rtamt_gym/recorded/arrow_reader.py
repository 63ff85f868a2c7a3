"""Reads recorded traces by pyarrow: Parquet, Feather, and JSON with an object in each line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.json
import pyarrow.parquet as pq

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.arrays import check_gaps, times_of
from rtamt_gym.recorded.arrow_columns import floats_of, is_number, is_time, raw_times_of
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.foreign import refusing
from rtamt_gym.recorded.recording import Floats, Recording, RowNumbers, Rows, Wanted
from rtamt_gym.recorded.times import RawTimes

__all__ = ["ArrowRecording", "open_file"]


@contextmanager
def open_file(path: str, _columns: Columns) -> Iterator[Recording]:
    """Opens a file of the format that its extension says.

    Raises:
        InputError: If it is not in this format.
        OSError: If there is no such file.
    """
    Path(path).stat()  # pyarrow's error for a missing file has no strerror
    match Path(path).suffix.lower():
        case ".parquet":
            with refusing(path, "a Parquet file"):
                file = pq.ParquetFile(path)
            with file:
                fields = _fields(file.schema_arrow)
                own = b"rtamt.run" in (file.schema_arrow.metadata or {})

                def load(wanted: list[str]) -> pa.Table:
                    with refusing(path, "a whole Parquet file"):
                        return file.read(columns=wanted)

                yield ArrowRecording(fields, load, path, "s" if own else "")
        case ".feather" | ".arrow":
            with refusing(path, "a Feather file"):
                table = pa.feather.read_table(path, memory_map=False)
                # Arrow trusts what the file says of its own buffers, and would read beyond them.
                table.validate(full=True)
            yield of_table(table, path)
        case _:
            with refusing(path, "one JSON object in each line"):
                table = pa.json.read_json(path)
            yield of_table(table, path)


def of_table(table: pa.Table, source: str) -> ArrowRecording:
    """The columns of a table in memory."""
    flat = _flat(table)
    return ArrowRecording(list(flat.schema), flat.select, source)


def _fields(fields: Iterable[pa.Field]) -> list[pa.Field]:
    """The fields; a structure is replaced by its own fields, at any depth."""
    flat = []
    for field in fields:
        flat += _fields(field.flatten()) if pa.types.is_struct(field.type) else [field]
    return flat


def _flat(table: pa.Table) -> pa.Table:
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    return table


class ArrowRecording:
    """The columns of a table; a field of a structure is a column with a dotted name.

    Args:
        fields: The names and the types of the columns.
        load: Gives the table of some of them.
        source: Name of the file, for messages.
        unit: The unit of the times, if the file says it: a saved `Run` has seconds.
    """

    def __init__(
        self,
        fields: Sequence[pa.Field],
        load: Callable[[list[str]], pa.Table],
        source: str,
        unit: str = "",
    ) -> None:
        self.source = shown(source)
        self.names: Sequence[str] = [shown(field.name) for field in fields]
        self._own = {shown(field.name): field.name for field in fields}
        self.dates: Sequence[str] = [
            shown(field.name)
            for field in fields
            if pa.types.is_timestamp(field.type) or pa.types.is_date(field.type)
        ]
        self._load, self._unit = load, unit

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns; nan counts as an empty cell."""
        time = wanted.time
        names = dict.fromkeys([*wanted.numbers, *wanted.texts, *([] if time is None else [time])])
        own = [self._own[name] for name in list(names) or list(self.names[:1])]
        table = _flat(self._load(own))
        table = table.rename_columns(list(map(shown, table.column_names)))

        where = RowNumbers(self.source)
        numbers = {name: self._numbers(table[name], name) for name in wanted.numbers}
        for name, values in numbers.items():
            absent = table[name].is_null().to_pylist() if table[name].null_count else ()
            check_gaps(values, wanted, name, where, absent)
        texts = {name: self._texts(table[name], name, where) for name in wanted.texts}
        times = None
        if time is not None:
            column = table[time]
            if column.null_count:
                row = column.is_valid().to_pylist().index(False)
                raise InputError(f"{where(row)}, column '{time}': expected a number, got none")
            times = self._times(column, time)
        return Rows(numbers, texts, table.num_rows, where, self.source, times, unit=self._unit)

    def _numbers(self, column: pa.ChunkedArray, name: str) -> Floats:
        if not is_number(column.type):
            raise InputError(f"{self.source}, column '{name}': expected numbers, got {column.type}")
        return floats_of(column)

    def _times(self, column: pa.ChunkedArray, name: str) -> RawTimes:
        kind, where = column.type, f"{self.source}, column '{name}'"
        if is_number(kind) or is_time(kind):
            times = raw_times_of(column)
            if times is None:
                counted = "64 bits of nanoseconds" if is_time(kind) else "64 bits with a sign"
                msg = f"{where}: expected times that {counted} can count, got {kind} beyond them"
                raise InputError(f"{msg}; write seconds since the begin")
            return times
        return times_of(np.array(column.to_pylist()), where)

    def _texts(
        self, column: pa.ChunkedArray, name: str, where: Callable[[int], str]
    ) -> Sequence[str]:
        texts: list[str] = column.to_pylist()
        for row, text in enumerate(texts):
            if not isinstance(text, str):
                raise InputError(f"{where(row)}, column '{name}': expected a name, got {text!r}")
        return texts
