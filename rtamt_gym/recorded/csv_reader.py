"""Reads recorded traces from comma-separated text.

The rows of a block are converted together, column by column. If a block holds a cell that is not a
number, its rows are searched for the first such cell, and the error names its line.
"""

from __future__ import annotations

import csv
import itertools
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn, TextIO

import numpy as np

from rtamt import InputError
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.progress import progress
from rtamt_gym.recorded.recording import Floats, Rows, Wanted

__all__ = ["CsvRecording", "open_file"]

_BLOCK = 1 << 14
"""Rows in a block."""


@contextmanager
def open_file(path: str, _columns: Columns) -> Iterator[CsvRecording]:
    """Opens a CSV file, with a progress bar while it is read; ``-`` is stdin.

    Raises:
        OSError: If there is no such file.
    """
    if path == "-":
        yield CsvRecording(sys.stdin, "stdin")
        return
    with (
        Path(path).open(encoding="utf-8-sig", newline="") as file,
        progress(f"reading {path}", Path(path).stat().st_size, "B") as advance,
    ):
        yield CsvRecording(_counted(file, advance), path)


def _counted(file: TextIO, advance: Callable[[int], None]) -> Iterator[str]:
    before = 0
    while block := list(itertools.islice(file, _BLOCK)):
        yield from block
        at = file.buffer.tell()
        advance(at - before)
        before = at


class CsvRecording:
    """Comma-separated values below a line with the names of the columns.

    Args:
        lines: The lines of the file.
        source: Name of the file, for messages.

    Raises:
        InputError: If there is no line of names.
        UnicodeDecodeError: If the lines are not UTF-8 text, here or while reading.

    Example:
        >>> recording = CsvRecording(["time,x", "0,5", "0.5,4"], "trace.csv")
        >>> rows = recording.read(Wanted(["x"]))
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

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns; nan in a cell is an error, an empty cell becomes nan."""
        parts: dict[str, list[Floats]] = {name: [np.zeros(0)] for name in wanted.numbers}
        texts: dict[str, list[str]] = {name: [] for name in wanted.texts}
        lines: list[int] = []
        while block := list(itertools.islice(self._rows, _BLOCK)):
            places, rows = zip(*block, strict=True)
            if set(map(len, rows)) != {len(self.names)}:
                self._refuse(block, wanted)
            cells = dict(zip(self.names, zip(*rows, strict=True), strict=False))
            for name in wanted.numbers:
                column = _floats(cells[name], gaps=name in wanted.gaps)
                if column is None:
                    self._refuse(block, wanted)
                parts[name].append(column)
            for name in wanted.texts:
                texts[name] += map(str.strip, cells[name])
            lines += places
        numbers = {name: np.concatenate(part) for name, part in parts.items()}
        return Rows(numbers, texts, lines, "line", self.source)

    def _rows_of(self, lines: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
        """The rows that are not empty, with their line numbers."""
        reader = csv.reader(lines, skipinitialspace=True)
        try:
            for row in reader:
                if row:
                    yield reader.line_num, row
        except csv.Error as error:
            raise InputError(f"{self.source}, line {reader.line_num}: {error}") from None

    def _refuse(self, block: Sequence[tuple[int, list[str]]], wanted: Wanted) -> NoReturn:
        """Raises the error of the first row in the block that cannot be read."""
        for line, row in block:
            if len(row) != len(self.names):
                raise InputError(
                    f"{self.source}, line {line}: expected {len(self.names)} values "
                    f"({', '.join(self.names)}), got {len(row)}"
                )
            for name in wanted.numbers:
                cell = row[self.names.index(name)]
                if _floats([cell], gaps=name in wanted.gaps) is None:
                    raise InputError(
                        f"{self.source}, line {line}, column '{name}': expected a number, "
                        f"got {cell!r}{'' if cell.strip() else wanted.empty}"
                    )
        msg = "every row can be read"
        raise AssertionError(msg)


def _floats(cells: Sequence[str], *, gaps: bool) -> Floats | None:
    """The numbers in cells, nan for an empty cell if gaps are allowed; None if a cell is wrong."""
    read = read_floats(cells)
    if read is None:
        if not gaps or all(map(str.strip, cells)):
            return None
        present = np.array([bool(cell.strip()) for cell in cells])
        some = _floats([cell for cell in cells if cell.strip()], gaps=False)
        if some is None:
            return None
        numbers = np.full(len(cells), math.nan)
        numbers[present] = some
        return numbers
    numbers = np.array(read)
    return None if np.isnan(numbers).any() else numbers
