"""Reads recorded traces from Parquet files, the format in which data frames are saved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rtamt import InputError
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Floats, Rows, Wanted

__all__ = ["ParquetRecording", "open_file"]


@contextmanager
def open_file(path: str, _columns: Columns) -> Iterator[ParquetRecording]:
    """Opens a Parquet file.

    Raises:
        InputError: If it is not a Parquet file.
        OSError: If there is no such file.
    """
    Path(path).stat()  # pyarrow's error for a missing file has no strerror
    try:
        file = pq.ParquetFile(path)
    except pa.ArrowInvalid:
        raise InputError(f"{path}: expected a Parquet file") from None
    with file:
        yield ParquetRecording(file, path)


class ParquetRecording:
    """The columns of a Parquet file; a field of a structure is a column with a dotted name.

    Args:
        file: The open file.
        source: Its name, for messages.
    """

    def __init__(self, file: pq.ParquetFile, source: str) -> None:
        self.source = source
        self._file = file
        schema = file.schema
        self.names: Sequence[str] = [schema.column(i).path for i in range(len(schema))]

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns; nan counts as an empty cell."""
        table = self._file.read(columns=[*wanted.numbers, *wanted.texts])
        while any(pa.types.is_struct(field.type) for field in table.schema):
            table = table.flatten()
        numbers = {name: self._numbers(table[name], name) for name in wanted.numbers}
        for name, values in numbers.items():
            absent = np.isnan(values)
            if absent.any() and name not in wanted.gaps:
                row = int(absent.argmax())
                got = "nan" if table[name][row].is_valid else f"none{wanted.empty}"
                raise InputError(
                    f"{self.source}, row {row + 1}, column '{name}': expected a number, got {got}"
                )
        texts = {name: self._texts(table[name], name) for name in wanted.texts}
        return Rows(numbers, texts, range(1, table.num_rows + 1), "row", self.source)

    def _numbers(self, column: pa.ChunkedArray, name: str) -> Floats:
        try:
            values: Floats = column.cast(pa.float64(), safe=False).to_numpy()
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            raise InputError(
                f"{self.source}, column '{name}': expected numbers, got {column.type}"
            ) from None
        return values

    def _texts(self, column: pa.ChunkedArray, name: str) -> Sequence[str]:
        texts: list[str] = column.to_pylist()
        for row, text in enumerate(texts):
            if not isinstance(text, str):
                raise InputError(
                    f"{self.source}, row {row + 1}, column '{name}': expected a name, got {text!r}"
                )
        return texts
