"""Files of recorded values: columns of numbers and names below a line of names.

Comma-separated text is read in blocks of rows, each column of a block at once; where a block holds
what is no number, its rows are looked through for the first of them. Parquet files need pyarrow.
"""

from __future__ import annotations

import csv
import itertools
import math
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, Protocol, TextIO

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.recorded.progress import progress

__all__ = ["CsvFile", "Recording", "Rows", "open_recording"]

Floats = NDArray[np.float64]

_BLOCK = 1 << 14
"""Rows that are looked at together."""


@dataclass(frozen=True, slots=True)
class Rows:
    """The wanted columns of a recording.

    Attributes:
        numbers: By name; nan where a cell is empty, if it may be.
        texts: By name.
        lines: Where each row stands in the file, from 1.
        unit: What ``lines`` counts: lines of a text, or rows.
        source: Name of the file, for messages.
    """

    numbers: dict[str, Floats]
    texts: Mapping[str, Sequence[str]]
    lines: Sequence[int]
    unit: str
    source: str

    def where(self, row: int) -> str:
        """File and line of a row, for messages."""
        return f"{self.source}, {self.unit} {self.lines[row]}"


class Recording(Protocol):
    """A file whose columns have names.

    Attributes:
        source: Name of the file, for messages.
        names: Names of the columns, in order; one may stand twice.
    """

    source: str
    names: Sequence[str]

    def read(
        self,
        numbers: Sequence[str],
        texts: Sequence[str] = (),
        gaps: Collection[str] = (),
        empty: str = "",
    ) -> Rows:
        """The rows of the file; other columns are not looked at.

        Args:
            numbers: Columns of numbers.
            texts: Columns of names.
            gaps: Columns of numbers of which cells may be empty.
            empty: What to do about an empty cell elsewhere, for the message.

        Raises:
            InputError: On a line with too few or too many values, or a value that is no number;
                nan is none. Says where.
        """


@contextmanager
def open_recording(path: str) -> Iterator[Recording]:
    """The recording in a file: Parquet by its ending ``.parquet``, else CSV; ``-`` is stdin.

    Raises:
        OSError: If there is no such file.
        ModuleNotFoundError: Without pyarrow, for a Parquet file.
    """
    if path == "-":
        yield CsvFile(sys.stdin, "stdin")
    elif path.endswith(".parquet"):
        from rtamt_gym.recorded.parquet import ParquetRecording

        yield ParquetRecording(path)
    else:
        with (
            Path(path).open(encoding="utf-8-sig", newline="") as file,
            progress(f"reading {path}", Path(path).stat().st_size, "B") as advance,
        ):
            yield CsvFile(_counted(file, advance), path)


def _counted(file: TextIO, advance: Callable[[int], None]) -> Iterator[str]:
    before = 0
    while block := list(itertools.islice(file, _BLOCK)):
        yield from block
        at = file.buffer.tell()
        advance(at - before)
        before = at


class CsvFile:
    """Comma-separated values below a line of names.

    Args:
        lines: The lines of the file.
        source: Name of the file, for messages.

    Raises:
        InputError: If there is no line of names.

    Example:
        >>> rows = CsvFile(["time,x", "0,5", "0.5,4"], "trace.csv").read(["x"])
        >>> rows.numbers["x"].tolist(), rows.where(1)
        ([5.0, 4.0], 'trace.csv, line 3')
    """

    def __init__(self, lines: Iterable[str], source: str) -> None:
        self.source = source
        self._rows = self._rows_of(lines)
        _, names = next(self._rows, (1, []))
        self.names: Sequence[str] = [name.strip() for name in names]
        if not self.names:
            raise InputError(
                f"{source}: expected a first line with the names of the columns, got none"
            )

    def read(
        self,
        numbers: Sequence[str],
        texts: Sequence[str] = (),
        gaps: Collection[str] = (),
        empty: str = "",
    ) -> Rows:
        """The rows of the file, as `Recording` says."""
        parts: dict[str, list[Floats]] = {name: [np.zeros(0)] for name in numbers}
        words: dict[str, list[str]] = {name: [] for name in texts}
        lines: list[int] = []
        while block := list(itertools.islice(self._rows, _BLOCK)):
            places, rows = zip(*block, strict=True)
            if set(map(len, rows)) != {len(self.names)}:
                self._refuse(block, numbers, gaps, empty)
            cells = dict(zip(self.names, zip(*rows, strict=True), strict=False))
            for name in numbers:
                column = _floats(cells[name], gaps=name in gaps)
                if column is None:
                    self._refuse(block, numbers, gaps, empty)
                parts[name].append(column)
            for name in texts:
                words[name] += map(str.strip, cells[name])
            lines += places
        columns = {name: np.concatenate(part) for name, part in parts.items()}
        return Rows(columns, words, lines, "line", self.source)

    def _rows_of(self, lines: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
        """The rows that are not empty, with the numbers of their lines."""
        reader = csv.reader(lines, skipinitialspace=True)
        try:
            for row in reader:
                if row:
                    yield reader.line_num, row
        except UnicodeDecodeError:
            raise InputError(f"{self.source}: expected UTF-8 text") from None
        except csv.Error as error:
            raise InputError(f"{self.source}, line {reader.line_num}: {error}") from None

    def _refuse(
        self,
        block: Sequence[tuple[int, list[str]]],
        numbers: Sequence[str],
        gaps: Collection[str],
        empty: str,
    ) -> NoReturn:
        """The error of the first row that is none."""
        for line, row in block:
            if len(row) != len(self.names):
                raise InputError(
                    f"{self.source}, line {line}: expected {len(self.names)} values "
                    f"({', '.join(self.names)}), got {len(row)}"
                )
            for name in numbers:
                cell = row[self.names.index(name)]
                if _floats([cell], gaps=name in gaps) is None:
                    raise InputError(
                        f"{self.source}, line {line}, column '{name}': "
                        f"expected a number, got {cell!r}{'' if cell.strip() else empty}"
                    )
        msg = "every row is one"
        raise AssertionError(msg)


def _floats(cells: Sequence[str], *, gaps: bool) -> Floats | None:
    """The numbers in cells; None if one holds none."""
    try:
        numbers = np.array(list(map(float, cells)))
    except ValueError:
        if not gaps or all(map(str.strip, cells)):
            return None
        present = np.array([bool(cell.strip()) for cell in cells])
        some = _floats([cell for cell in cells if cell.strip()], gaps=False)
        if some is None:
            return None
        numbers = np.full(len(cells), math.nan)
        numbers[present] = some
        return numbers
    return None if np.isnan(numbers).any() else numbers
