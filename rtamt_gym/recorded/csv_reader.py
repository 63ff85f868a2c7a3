"""Reads recorded traces from text whose cells are separated by commas, semicolons or tabs.

A long file is read by pyarrow where that is installed. What it does not read as it stands, and
what is short, is read here: the rows of a block are converted together, column by column, and if a
block holds a cell that is not a number, its rows are searched for the first such cell, and the
error names its line.
"""

from __future__ import annotations

import csv
import gzip
import io
import itertools
import re
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import BinaryIO, TextIO, cast

import numpy as np

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.cells import DECIMAL_COMMA, DECIMAL_POINT, floats_in, times_in
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.progress import progress
from rtamt_gym.recorded.recording import Floats, Recording, Rows, Wanted
from rtamt_gym.recorded.times import read_dates

__all__ = ["CsvRecording", "lines_of", "open_file"]

_BLOCK = 1 << 14
"""Rows in a block."""

_LINE = 1 << 26
"""The most characters of a line."""

_LONG = 1 << 20
"""Bytes from which on a file is worth the import of pyarrow."""

_SEPARATORS = ",;\t|"
"""The separators that are recognised; of two equally frequent ones the first is taken."""


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Opens a CSV file, with a progress bar while it is read; ``-`` is stdin.

    Raises:
        InputError: If its name says that it is compressed, and it is not.
        OSError: If there is no such file.
    """
    if path == "-":
        yield CsvRecording(_bounded(sys.stdin, "stdin"), "stdin", columns)
        return
    with lines_of(path) as lines:
        long = Path(path).stat().st_size >= _LONG and find_spec("pyarrow")
        yield CsvRecording(lines, path, columns, path if long else None)


@contextmanager
def lines_of(path: str) -> Iterator[Iterator[str]]:
    """Opens a file of text, compressed if its name ends in ``.gz``, and shows how far it is read.

    Raises:
        InputError: If it is not compressed as its name says.
        OSError: If there is no such file.
    """
    with (
        Path(path).open("rb") as raw,
        _text_of(raw, path) as file,
        progress(f"reading {shown(path)}", Path(path).stat().st_size, "B") as advance,
    ):
        try:
            yield _counted(file, raw, advance, path)
        except (gzip.BadGzipFile, EOFError, zlib.error):
            raise InputError(f"{shown(path)}: expected a whole file compressed by gzip") from None


def _text_of(raw: BinaryIO, path: str) -> TextIO:
    opened = cast("BinaryIO", gzip.GzipFile(fileobj=raw)) if path.endswith(".gz") else raw
    return io.TextIOWrapper(opened, encoding="utf-8-sig", newline="")


def _bounded(file: TextIO, path: str) -> Iterator[str]:
    """The lines of a text; one that has no end is refused before it fills the memory."""
    for line in iter(partial(file.readline, _LINE + 1), ""):
        if len(line) > _LINE:
            raise InputError(f"{shown(path)}: expected lines of at most {_LINE} characters")
        yield line


def _counted(
    file: TextIO, raw: BinaryIO, advance: Callable[[int], None], path: str
) -> Iterator[str]:
    before = 0
    lines = _bounded(file, path)
    while block := list(itertools.islice(lines, _BLOCK)):
        yield from block
        if raw.seekable():
            at = raw.tell()
            advance(at - before)
            before = at


class CsvRecording:
    """Separated values below a line with the names of the columns.

    Args:
        lines: The lines of the file.
        source: Name of the file, for messages.
        columns: The separator and the decimal mark, if they are not to be recognised.
        path: The file with these lines, if pyarrow is to read it.

    Raises:
        InputError: If there is no line of names.
        UnicodeDecodeError: If the lines are not UTF-8 text, here or while reading.

    Example:
        >>> recording = CsvRecording(["time;x", "0;5", "0,5;4,25"], "trace.csv")
        >>> rows = recording.read(Wanted(["x"], time="time"))
        >>> rows.numbers["x"].tolist(), rows.times.tolist(), rows.where(1)
        ([5.0, 4.25], [0.0, 0.5], 'trace.csv, line 3')
    """

    def __init__(
        self,
        lines: Iterable[str],
        source: str,
        columns: Columns | None = None,
        path: str | None = None,
    ) -> None:
        columns = columns or Columns()
        self.source = source = shown(source)
        self._columns, self._path = columns, path
        given = iter(lines)
        blank: list[str] = []
        first = next(given, "")
        while first and not first.strip():
            blank.append(first)
            first = next(given, "")
        self.separator = columns.separator or _separator_of(first)
        """The character between cells."""
        rows = self._rows_of(itertools.chain(blank, [first], given))
        self.header, names = next(rows, (1, []))
        """The line of the names, from 1."""
        self.names: Sequence[str] = [shown(name.strip()) for name in names]
        if not self.names:
            raise InputError(
                f"{source}: expected a first line with the names of the columns, got none"
            )
        begin = list(itertools.islice(rows, 100))
        self.rows = itertools.chain(begin, rows)
        """The rows below the names that are not empty, with their lines."""
        self.decimal = columns.decimal or self._decimal_of([row for _, row in begin])
        """The decimal mark."""
        cells = begin[0][1] if begin else []
        self.dates: Sequence[str] = [
            name
            for name, cell in zip(self.names, cells, strict=False)
            if read_dates([cell]) is not None
        ]

    @property
    def notes(self) -> list[str]:
        """What was recognised that might have been meant otherwise."""
        if self._columns.decimal is None and self.decimal == ",":
            return ["numbers are read with a decimal comma"]
        return []

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns; nan in a cell is an error, an empty cell becomes nan."""
        if wanted.time is not None and self.names.count(wanted.time) > 1:
            raise InputError(
                f"{self.source}, line {self.header}: expected one column '{wanted.time}', got two"
            )
        return self._read_fast(wanted) or self._read_blocks(wanted)

    def _read_fast(self, wanted: Wanted) -> Rows | None:
        path = self._path
        if path is None:
            return None
        from rtamt_gym.recorded.arrow_csv import Text, read_text

        text = Text(path, self.names, self.header, self.separator, self.decimal)
        read = read_text(text, wanted)

        def where(row: int) -> str:  # the file is read once more
            with lines_of(path) as lines:
                rows = CsvRecording(lines, self.source, self._columns).rows
                line, _ = next(itertools.islice(rows, row, None))
            return f"{self.source}, line {line}"

        if read is None:
            return None
        return Rows(
            read.numbers, read.texts, read.count, where, self.source, read.times, self.notes
        )

    def _read_blocks(self, wanted: Wanted) -> Rows:
        parts: dict[str, list[Floats]] = {name: [np.zeros(0)] for name in wanted.numbers}
        texts: dict[str, list[str]] = {name: [] for name in wanted.texts}
        times: list[str] = []
        lines: list[int] = []
        while block := list(itertools.islice(self.rows, _BLOCK)):
            places, rows = zip(*block, strict=True)
            if set(map(len, rows)) != {len(self.names)}:
                raise next(self._errors(block, wanted))
            cells = dict(zip(self.names, zip(*rows, strict=True), strict=False))
            for name in wanted.numbers:
                column = self._floats(cells[name], name, wanted)
                if column is None:
                    raise next(self._errors(block, wanted))
                parts[name].append(column)
            for name in wanted.texts:
                texts[name] += map(str.strip, cells[name])
            if wanted.time is not None:
                times += cells[wanted.time]
            lines += places
        numbers = {name: np.concatenate(part) for name, part in parts.items()}

        def where(row: int) -> str:
            return f"{self.source}, line {lines[row]}"

        raw = None
        if wanted.time is not None and lines:
            raw = times_in(times, self.decimal, lambda i: f"{where(i)}, column '{wanted.time}'")
        return Rows(numbers, texts, len(lines), where, self.source, raw, self.notes)

    def _floats(self, cells: Sequence[str], name: str, wanted: Wanted) -> Floats | None:
        return floats_in(cells, self.decimal, gaps=name in wanted.gaps, nan=wanted.nan)

    def _rows_of(self, lines: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
        """The rows that are not empty, with their line numbers."""
        reader = csv.reader(lines, delimiter=self.separator, skipinitialspace=True)
        try:
            for row in reader:
                if row:
                    yield reader.line_num, row
        except csv.Error as error:
            said, _, _ = str(error).partition(" - ")  # what follows is advice for programmers
            raise InputError(f"{self.source}, line {reader.line_num}: {said}") from None

    def _decimal_of(self, rows: Iterable[Sequence[str]]) -> str:
        """The decimal mark that the cells of some rows use; a point if they use both."""
        if self.separator == ",":
            return "."
        cells = {cell.strip() for row in rows for cell in row}
        commas = any(map(DECIMAL_COMMA.fullmatch, cells))
        return "," if commas and not any(map(DECIMAL_POINT.fullmatch, cells)) else "."

    def _errors(
        self, block: Sequence[tuple[int, list[str]]], wanted: Wanted
    ) -> Iterator[InputError]:
        """The errors of the rows in the block that cannot be read."""
        for line, row in block:
            if len(row) != len(self.names):
                yield InputError(
                    f"{self.source}, line {line}: expected {len(self.names)} values "
                    f"({listed(self.names)}), got {len(row)}"
                )
            for name in wanted.numbers:
                cell = row[self.names.index(name)]
                if self._floats([cell], name, wanted) is None:
                    yield InputError(
                        f"{self.source}, line {line}, column '{name}': expected a number, "
                        f"got {cell!r}{self._advice(cell.strip(), wanted)}"
                    )

    def _advice(self, cell: str, wanted: Wanted) -> str:
        if not cell or cell.lower() == "nan":
            return wanted.empty
        if self.decimal == "." and DECIMAL_COMMA.fullmatch(cell):
            return "; give --decimal , for a decimal comma"
        if self.decimal == "," and DECIMAL_POINT.fullmatch(cell):
            return "; give --decimal . for a decimal point"
        return ""


def _separator_of(line: str) -> str:
    """The most frequent separator in a line of names, outside quotes."""
    bare = re.sub(r'"[^"]*"', "", line)
    return max(_SEPARATORS, key=bare.count)
