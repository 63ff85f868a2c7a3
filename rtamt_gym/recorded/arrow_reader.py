"""Reads recorded traces by pyarrow: Parquet, Feather, and JSON with an object in each line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.feather
import pyarrow.json
import pyarrow.parquet as pq
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.arrays import check_gaps, times_of
from rtamt_gym.recorded.arrow_columns import cells_of, floats_of, is_number, is_time, raw_times_of
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.dates import RawTimes
from rtamt_gym.recorded.foreign import refusing
from rtamt_gym.recorded.recording import Floats, Recording, RowNumbers, Rows, Wanted
from rtamt_gym.recorded.selection import RowFilter, cell_texts
from rtamt_gym.recorded.text_numbers import numbers_in_texts

__all__ = ["ArrowRecording", "open_file"]


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
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

                lists = [field.name for field in fields if _is_list(field.type)]
                lengths = {}
                if lists and file.metadata.num_rows:
                    with refusing(path, "a whole Parquet file"):
                        batch = next(file.iter_batches(1, columns=lists))
                    lengths = _lengths(_flat(pa.Table.from_batches([batch])))
                yield ArrowRecording(
                    fields, load, path, "s" if own else "", lengths, columns.decimal
                )
        case ".feather" | ".arrow":
            with refusing(path, "a Feather file"):
                table = pa.feather.read_table(path, memory_map=False)
                # Arrow trusts what the file says of its own buffers, and would read beyond them.
                table.validate(full=True)
            yield of_table(table, path, columns.decimal)
        case _:
            with refusing(path, "one JSON object in each line"):
                table = pa.json.read_json(path)
            yield of_table(table, path, columns.decimal)


def of_table(table: pa.Table, source: str, decimal: str | None = None) -> ArrowRecording:
    """The columns of a table in memory."""
    flat = _flat(table)
    return ArrowRecording(list(flat.schema), flat.select, source, "", _lengths(flat), decimal)


def _is_text(kind: pa.DataType) -> bool:
    """Return whether a type is one of texts, also where they are stored by number."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


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


_LONGEST_LIST = 1000
"""The most elements of a list that are columns."""


def _is_list(kind: pa.DataType) -> bool:
    """Whether the elements of a list are columns."""
    lists = pa.types.is_list(kind) or pa.types.is_large_list(kind)
    return bool((lists or pa.types.is_fixed_size_list(kind)) and is_number(kind.value_type))


def _is_scalar(kind: pa.DataType) -> bool:
    """Whether a cell is a number, a date or a text, and not a list or an image."""
    texts = pa.types.is_string(kind) or pa.types.is_large_string(kind)
    other = pa.types.is_dictionary(kind) or pa.types.is_time(kind)
    return bool(is_number(kind) or is_time(kind) or texts or other)


def _lengths(table: pa.Table) -> dict[str, int]:
    """The number of elements in the first cell of each column of lists of numbers."""
    lengths = {}
    for field in table.schema:
        if _is_list(field.type) and table.num_rows:
            first = table[field.name][0].as_py() or ()
            if 0 < len(first) <= _LONGEST_LIST:
                lengths[field.name] = len(first)
    return lengths


class ArrowRecording:
    """The columns of a table; a field of a structure is a column with a dotted name.

    An element of a list of numbers is a column too, as in ``observation.state[0]``.

    Args:
        fields: The names and the types of the columns.
        load: Gives the table of some of them.
        source: Name of the file, for messages.
        unit: The unit of the times, if the file says it: a saved `Run` has seconds.
        lists: The number of elements of columns of lists.
        decimal: The decimal mark of numbers that are text; None to recognise it.
    """

    def __init__(
        self,
        fields: Sequence[pa.Field],
        load: Callable[[list[str]], pa.Table],
        source: str,
        unit: str = "",
        lists: Mapping[str, int] | None = None,
        decimal: str | None = None,
    ) -> None:
        self.source = shown(source)
        lists = lists or {}
        self._elements = {
            shown(f"{name}[{i}]"): (name, i) for name, n in lists.items() for i in range(n)
        }
        self._lengths = lists
        self._own = {shown(field.name): field.name for field in fields}
        self.names: Sequence[str] = [
            shown(name)
            for field in fields
            for name in (
                [f"{field.name}[{i}]" for i in range(lists[field.name])]
                if field.name in lists
                else [field.name]
            )
        ]
        self.dates: Sequence[str] = [
            shown(field.name)
            for field in fields
            if pa.types.is_timestamp(field.type) or pa.types.is_date(field.type)
        ]
        self.days = [shown(field.name) for field in fields if pa.types.is_date(field.type)]
        """The columns of dates without a time of day."""
        self._scalars = {shown(field.name) for field in fields if _is_scalar(field.type)}
        self._load, self._unit, self._decimal = load, unit, decimal
        self._texts_of = [field.name for field in fields if _is_text(field.type)]
        self.texts = [*map(shown, self._texts_of)]
        """The columns of texts."""

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns; nan counts as an empty cell."""
        time, part = wanted.time, wanted.part
        chosen = RowFilter(wanted.where, self.names, self.source)
        plain = [n for n in wanted.cells if n in self._scalars or n in self._elements]
        named = [*wanted.numbers, *wanted.texts, *plain, *wanted.where]
        named += [*([] if time is None else [time]), *([] if part is None else [part.column])]
        table = self._table(list(dict.fromkeys(named)) or list(self.names[:1]))
        where = RowNumbers(self.source)
        chosen_rows: Sequence[int] | None = None
        if wanted.where:
            kept = chosen.mask({n: cell_texts(cells_of(table[n])) for n in wanted.where})
            chosen.check()
            (rows,) = np.nonzero(kept)
            table = table.take(pa.array(rows))
            where, chosen_rows = RowNumbers(self.source, rows), rows.tolist()
        written, times, notes = self._numbers_in_texts(wanted, table, where, chosen_rows)
        numbers = {
            name: self._numbers(table[name], name) for name in wanted.numbers if name not in written
        }
        for name, values in numbers.items():
            absent = table[name].is_null().to_pylist() if table[name].null_count else ()
            check_gaps(values, wanted, name, where, absent)
        texts = {name: self._texts(table[name], name, where) for name in wanted.texts}
        unit = self._unit
        if time is not None and times is None:
            column = table[time]
            if column.null_count:
                row = column.is_valid().to_pylist().index(False)
                raise InputError(f"{where(row)}, column '{time}': expected a number, got none")
            second = None if part is None else cells_of(table[part.column])
            times, joined = self._times(column, wanted, where, second)
            unit = joined or unit
        cells = {name: cells_of(table[name]) for name in plain}
        numbers = {name: (numbers | written)[name] for name in wanted.numbers}
        return Rows(
            numbers, texts, table.num_rows, where, self.source, times, notes, unit, cells=cells
        )

    def _table(self, names: Sequence[str]) -> pa.Table:
        """Some columns by their shown names, elements of lists among them."""
        own = [self._elements.get(name, (self._own.get(name, ""), 0))[0] for name in names]
        table = _flat(self._load(list(dict.fromkeys(own))))
        columns = {}
        for name, each in zip(names, own, strict=True):
            column = table[each]
            if name in self._elements:
                column = self._element(column, name)
            columns[name] = column
        return pa.table(columns)

    def _element(self, column: pa.ChunkedArray, name: str) -> pa.ChunkedArray:
        own, index = self._elements[name]
        lengths = pc.list_value_length(column)
        short = pc.fill_null(pc.less_equal(lengths, index), fill_value=False)
        if pc.any(short).as_py():
            row = short.to_pylist().index(True)
            raise InputError(
                f"{self.source}, row {row + 1}, column '{own}': expected a list of "
                f"{self._lengths[own]}, as in the first row, got {lengths[row].as_py()}"
            )
        return pc.list_element(column, index)

    def _numbers_in_texts(
        self,
        wanted: Wanted,
        table: pa.Table,
        where: Callable[[int], str],
        rows: Sequence[int] | None,
    ) -> tuple[dict[str, Floats], RawTimes | None, list[str]]:
        """Return the numbers and times that are text; the evidence is in all columns of text."""
        read = [*wanted.numbers, *([] if wanted.time is None else [wanted.time])]
        if not any(_is_text(table[name].type) for name in read):
            return {}, None, []
        if wanted.part is not None:
            wanted = replace(wanted, time=None)  # dates and times of day, or parts of seconds
        all_texts = _flat(self._load(self._texts_of))
        columns = {
            shown(name): [cell or "" for cell in all_texts[name].cast(pa.string()).to_pylist()]
            for name in self._texts_of
        }
        return numbers_in_texts(columns, wanted, self._decimal, self.source, where, rows)

    def _numbers(self, column: pa.ChunkedArray, name: str) -> Floats:
        if not is_number(column.type):
            raise InputError(f"{self.source}, column '{name}': expected numbers, got {column.type}")
        return floats_of(column)

    def _times(
        self,
        column: pa.ChunkedArray,
        wanted: Wanted,
        place: Callable[[int], str],
        second: NDArray[Any] | None,
    ) -> tuple[RawTimes, str]:
        kind, where = column.type, f"{self.source}, column '{wanted.time}'"
        parts = wanted.part is not None and bool(wanted.part.unit)
        if (is_number(kind) or is_time(kind)) and not parts:
            times = raw_times_of(column)
            if times is None:
                counted = "64 bits of nanoseconds" if is_time(kind) else "64 bits with a sign"
                msg = f"{where}: expected times that {counted} can count, got {kind} beyond them"
                raise InputError(f"{msg}; write seconds since the begin")
            return times, ""
        return times_of(cells_of(column), wanted, self.source, place, second)

    def _texts(
        self, column: pa.ChunkedArray, name: str, where: Callable[[int], str]
    ) -> Sequence[str]:
        texts: list[str] = column.to_pylist()
        for row, text in enumerate(texts):
            if not isinstance(text, str):
                raise InputError(f"{where(row)}, column '{name}': expected a name, got {text!r}")
        return texts
