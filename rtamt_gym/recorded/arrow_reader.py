"""Reads recorded traces by pyarrow: Parquet, Feather, and JSON with an object in each line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.feather
import pyarrow.json
import pyarrow.parquet as pq

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.arrays import ArrayRecording
from rtamt_gym.recorded.arrow_columns import is_number, is_time, raw_times_of, values_of
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import refusing
from rtamt_gym.recorded.recording import Recording, RowFilter, RowNumbers, Rows, Wanted

_LONGEST_LIST = 1000
"""The most elements of a list that are columns."""


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open a file of the format that its extension names."""
    Path(path).stat()  # pyarrow's error for a missing file has no strerror
    match Path(path).suffix.lower():
        case ".parquet":
            with open_parquet(path, columns) as recording:
                yield recording
            return
        case ".feather" | ".arrow":
            with refusing(path, "a Feather file"):
                table = pa.feather.read_table(path, memory_map=False)
                # Arrow trusts the buffer sizes in the file, and could read beyond the file.
                table.validate(full=True)
        case _:
            with refusing(path, "one JSON object in each line"):
                table = pa.json.read_json(path)
    flat = _flat(table)
    yield ArrowRecording(list(flat.schema), flat.select, path, "", _lengths(flat), columns.decimal)


@contextmanager
def open_parquet(
    path: str, columns: Columns, span: tuple[int, int] | None = None
) -> Iterator[ArrowRecording]:
    """Open a Parquet file, or some of its rows."""
    Path(path).stat()  # pyarrow's error for a missing file has no strerror
    with refusing(path, "a Parquet file"):
        file = pq.ParquetFile(path)
    with file:
        fields = _fields(file.schema_arrow)
        own = b"rtamt.run" in (file.schema_arrow.metadata or {})

        def load(wanted: list[str]) -> pa.Table:
            with refusing(path, "a whole Parquet file"):
                if span is None:
                    return file.read(columns=wanted)
                return _rows_of(file, wanted, span)

        lists = [field.name for field in fields if is_list(field.type)]
        lengths = {}
        if lists and file.metadata.num_rows:
            with refusing(path, "a whole Parquet file"):
                batch = next(file.iter_batches(1, columns=lists))
            lengths = _lengths(_flat(pa.Table.from_batches([batch])))
        unit = "s" if own else ""  # a saved `Run` has seconds
        first = 0 if span is None else span[0]
        yield ArrowRecording(fields, load, path, unit, lengths, columns.decimal, first)


def _rows_of(file: pq.ParquetFile, wanted: list[str], span: tuple[int, int]) -> pa.Table:
    """Read some rows of a file, from the row groups that hold them."""
    meta, (begin, end) = file.metadata, span
    ends = np.cumsum([meta.row_group(i).num_rows for i in range(meta.num_row_groups)])
    first, last = (int(np.searchsorted(ends, row, "right")) for row in (begin, end - 1))
    before = int(ends[first - 1]) if first else 0
    table = file.read_row_groups([*range(first, last + 1)], columns=wanted)
    return table.slice(begin - before, end - begin)


def parquet_batches(
    path: str, columns: Columns, names: Sequence[str], size: int
) -> Iterator[tuple[int, Rows]]:
    """Yield cells of some columns in parts, each with the number of its first row."""
    with open_parquet(path, columns) as recording, refusing(path, "a whole Parquet file"):
        fields, first = recording.fields_of(names), 0
        with pq.ParquetFile(path) as file:
            for batch in file.iter_batches(size, columns=fields):
                yield (
                    first,
                    recording.part(pa.Table.from_batches([batch]), first).read(
                        Wanted([], cells=names)
                    ),
                )
                first += batch.num_rows


def _fields(fields: Iterable[pa.Field]) -> list[pa.Field]:
    """Return the fields; a structure is replaced by its own fields, at any depth."""
    flat = []
    for field in fields:
        flat += _fields(field.flatten()) if pa.types.is_struct(field.type) else [field]
    return flat


def _flat(table: pa.Table) -> pa.Table:
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    return table


def is_text(kind: pa.DataType) -> bool:
    """Return whether a type holds texts, including dictionary-encoded texts."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def is_list(kind: pa.DataType) -> bool:
    """Return whether the elements of a list are columns."""
    lists = pa.types.is_list(kind) or pa.types.is_large_list(kind)
    return bool((lists or pa.types.is_fixed_size_list(kind)) and is_number(kind.value_type))


def is_scalar(kind: pa.DataType) -> bool:
    """Return whether a cell is a number, a date or a text, and not a list or an image."""
    other = pa.types.is_dictionary(kind) or pa.types.is_time(kind)
    return bool(is_number(kind) or is_time(kind) or is_text(kind) or other)


def _lengths(table: pa.Table) -> dict[str, int]:
    """Return the number of elements in the first cell of each column of lists of numbers."""
    lengths = {}
    for field in table.schema:
        if is_list(field.type) and table.num_rows:
            first = table[field.name][0].as_py() or ()
            if 0 < len(first) <= _LONGEST_LIST:
                lengths[field.name] = len(first)
    return lengths


class ArrowRecording(Recording):
    """The columns of a table; a field of a structure is a column with a dotted name.

    An element of a list of numbers is a column too, as in ``observation.state[0]``.
    """

    def __init__(
        self,
        fields: Sequence[pa.Field],
        load: Callable[[list[str]], pa.Table],
        source: str,
        unit: str,
        lengths: Mapping[str, int],
        decimal: str | None,
        first: int = 0,
    ) -> None:
        self._path, self.source, self._lengths = source, shown(source), lengths
        self._fields, self._first = fields, first
        self._load, self._unit, self._decimal = load, unit, decimal
        # The field of each column, its type, and the element of a list.
        self._places: dict[str, tuple[str, pa.DataType, int | None]] = {}
        names = []
        for field in fields:
            elements = range(lengths[field.name]) if field.name in lengths else [None]
            for i in elements:
                name = shown(field.name if i is None else f"{field.name}[{i}]")
                kind = field.type if i is None else field.type.value_type
                names.append(name)
                self._places[name] = field.name, kind, i
        kinds = [(name, self._places[name][1]) for name in names]
        self.names: Sequence[str] = names
        self.dates = [n for n, kind in kinds if pa.types.is_timestamp(kind) or _is_day(kind)]
        self.days = [name for name, kind in kinds if _is_day(kind)]
        self.texts = [name for name, kind in kinds if is_text(kind)]

    def fields_of(self, names: Sequence[str]) -> list[str]:
        """Return the fields that hold columns."""
        return [*dict.fromkeys(self._places[name][0] for name in names)]

    def part(self, table: pa.Table, first: int) -> ArrowRecording:
        """Return the recording of some rows that were read."""
        flat = _flat(table)
        return ArrowRecording(
            *(self._fields, flat.select, self._path, self._unit, self._lengths, self._decimal),
            first,
        )

    def _where(self, row: int) -> str:
        return RowNumbers(self.source)(row + self._first)

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns; nan counts as an empty cell."""
        RowFilter(wanted.where, self.names, self.source)
        cells = [name for name in wanted.cells if is_scalar(self._places[name][1])]
        wanted = replace(wanted, cells=cells)
        times = [] if wanted.time is None else [wanted.time]
        names = wanted.names or [*self.names[:1]]
        if {*wanted.numbers, *times} & {*self.texts}:  # all texts are evidence of the decimal mark
            names += [name for name in self.texts if name not in names]
        table = self._table(names)
        for name in wanted.numbers:
            kind = table[name].type
            if not (is_number(kind) or is_text(kind)):
                raise InputError(f"{self.source}, column '{name}': expected numbers, got {kind}")
        for name in wanted.texts:
            if len(table[name]) and not is_text(table[name].type):
                position = self._where(0)
                value = table[name][0].as_py()
                raise InputError(f"{position}, column '{name}': expected a name, got {value!r}")
        for name in times if wanted.part is None else ():
            self._check_countable(name, table[name])
        arrays = {name: values_of(column) for name, column in table.items()}
        empty = {
            name: np.array(column.is_null().to_pylist(), bool)
            for name, column in table.items()
            if column.null_count
        }
        where = self._where if self._first else None
        recording = ArrayRecording(self._path, arrays, None, self._decimal, empty, where)
        rows = recording.read(wanted)
        return replace(rows, unit=rows.unit or self._unit)

    def _check_countable(self, name: str, column: pa.ChunkedArray) -> None:
        kind = column.type
        if pa.types.is_floating(kind):
            return
        if (is_number(kind) or is_time(kind)) and raw_times_of(column.drop_null()) is None:
            counted = "64 bits of nanoseconds" if is_time(kind) else "64 bits with a sign"
            raise InputError(
                f"{self.source}, column '{name}': expected times that {counted} can count, got "
                f"{kind} beyond them; write seconds since the begin"
            )

    def _table(self, names: Sequence[str]) -> dict[str, pa.ChunkedArray]:
        """Return some columns by their displayed names."""
        fields = [self._places[name][0] for name in names]
        table = _flat(self._load(list(dict.fromkeys(fields))))
        return {name: self._element(table[f], name) for name, f in zip(names, fields, strict=True)}

    def _element(self, column: pa.ChunkedArray, name: str) -> pa.ChunkedArray:
        field, _, index = self._places[name]
        if index is None:
            return column
        lengths = pc.list_value_length(column)
        short = pc.fill_null(pc.less_equal(lengths, index), fill_value=False)
        if pc.any(short).as_py():
            row = short.to_pylist().index(True)
            raise InputError(
                f"{self._where(row)}, column '{field}': expected a list of "
                f"{self._lengths[field]}, as in the first row, got {lengths[row].as_py()}"
            )
        return pc.list_element(column, index)


def _is_day(kind: pa.DataType) -> bool:
    return bool(pa.types.is_date(kind))
