"""Recordings in Parquet files, as data frames are saved."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.recorded.recordings import Rows

__all__ = ["ParquetRecording"]


class ParquetRecording:
    """A Parquet file; the fields of a structure are columns with dotted names.

    Args:
        path: Of the file.

    Raises:
        InputError: If it is no Parquet file.
        OSError: If there is none.
    """

    def __init__(self, path: str) -> None:
        self.source = path
        Path(path).stat()  # an error of a usual form, where there is no such file
        try:
            self._file = pq.ParquetFile(path)
        except pa.ArrowInvalid:
            raise InputError(f"{path}: expected a Parquet file") from None
        schema = self._file.schema
        self.names: Sequence[str] = [schema.column(i).path for i in range(len(schema))]

    def read(
        self,
        numbers: Sequence[str],
        texts: Sequence[str] = (),
        gaps: Collection[str] = (),
        empty: str = "",
    ) -> Rows:
        """The rows of the file, as `Recording` says; a nan is an empty cell."""
        table = self._file.read(columns=[*numbers, *texts])
        while any(pa.types.is_struct(field.type) for field in table.schema):
            table = table.flatten()
        columns = {name: self._numbers(table[name], name) for name in numbers}
        for name, values in columns.items():
            absent = np.isnan(values)
            if absent.any() and name not in gaps:
                row = int(absent.argmax())
                got = "nan" if table[name][row].is_valid else f"none{empty}"
                raise InputError(
                    f"{self.source}, row {row + 1}, column '{name}': expected a number, got {got}"
                )
        words = {name: self._texts(table[name], name) for name in texts}
        return Rows(columns, words, range(1, table.num_rows + 1), "row", self.source)

    def _numbers(self, column: pa.ChunkedArray, name: str) -> NDArray[np.float64]:
        try:
            values: NDArray[np.float64] = column.cast(pa.float64(), safe=False).to_numpy()
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            raise InputError(
                f"{self.source}, column '{name}': expected numbers, got {column.type}"
            ) from None
        return values

    def _texts(self, column: pa.ChunkedArray, name: str) -> Sequence[str]:
        words: list[str] = column.to_pylist()
        for row, word in enumerate(words):
            if not isinstance(word, str):
                raise InputError(
                    f"{self.source}, row {row + 1}, column '{name}': expected a name, got {word!r}"
                )
        return words
