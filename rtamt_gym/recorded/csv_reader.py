"""Reads text with cells separated by commas, semicolons, tabs or blanks.

pyarrow splits long plain files if it is installed, and the `csv` module splits all others: it
reports lines, and reads runs of blanks. `TextNumbers` turns the cells of both into numbers.
"""

from __future__ import annotations

import codecs
import gzip
import io
import itertools
import os
import re
import stat
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO, Final, TextIO, cast

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.columns import unit_of_times
from rtamt.errors import shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.cells import TextCells, floats_in, read_dates, times_in, values_in
from rtamt_gym.recorded.columns import UNITS, Columns
from rtamt_gym.recorded.progress import progress
from rtamt_gym.recorded.recording import RawTimes, Recording, RowFilter, Rows, Wanted
from rtamt_gym.recorded.text_layout import TOP, TextLayout, layout_of, names_line, rows_of
from rtamt_gym.recorded.text_numbers import TextNumbers
from rtamt_gym.recorded.times import join_times

_BLOCK = 1 << 14
"""Rows in a block."""

_LINE = 1 << 26
"""The most characters of a line."""

_FEW = 100
"""Rows that show which columns hold dates and texts."""

_DAY = 12
"""Characters of the longest date without a time of day."""

_LONG = 1 << 20
"""Bytes from which on a file is worth the import of pyarrow."""

_TAIL = 1 << 16
"""Bytes at the end of a file that hold its last line."""

_LATIN = "the text is not UTF-8 and is read as Latin-1"


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open a CSV file, with a progress bar while it is read; ``-`` is stdin."""
    if path == "-":
        raw = getattr(sys.stdin, "buffer", None)
        stdin = sys.stdin if raw is None else _text_of(raw)
        yield CsvRecording(list(_bounded(stdin, "stdin")), "stdin", columns)
        return
    with _lines_of(path) as (lines, encoding):
        if isinstance(lines, list):
            yield CsvRecording(lines, path, columns)
            return
        if not Path(path).is_file():  # a pipe cannot be read again
            yield CsvRecording(list(lines), path, columns)
            return
        plain = encoding != "utf-16" and Path(path).stat().st_size >= _LONG
        yield CsvRecording(lines, path, columns, fast=plain and find_spec("pyarrow") is not None)


@contextmanager
def _lines_of(path: str) -> Iterator[tuple[Iterable[str], str]]:
    """Open a file of text, which may be compressed, and yield its lines and its encoding.

    The lines of a short file are a list, and are read at once.
    """
    with Path(path).open("rb") as raw:
        status = os.fstat(raw.fileno())
        try:
            opened = cast("BinaryIO", gzip.GzipFile(fileobj=raw)) if path.endswith(".gz") else raw
            plain = opened is raw and stat.S_ISREG(status.st_mode)
            with _text_of(opened) as file:
                short = plain and status.st_size < min(_LONG, _LINE)
                if short and file.encoding != "utf-16":
                    yield file.readlines(), file.encoding
                    return
                with progress(f"reading {shown(path)}", status.st_size, "B") as advance:
                    yield _counted(file, raw, advance, path), file.encoding
        except (gzip.BadGzipFile, EOFError, zlib.error):
            raise InputError(f"{shown(path)}: expected a complete gzip file") from None


def _text_of(raw: BinaryIO) -> TextIO:
    """Return bytes as text: UTF-16 after its mark; otherwise UTF-8 with surrogates for others."""
    begin = cast("io.BufferedReader", raw).peek(2)[:2]
    if begin in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return io.TextIOWrapper(raw, encoding="utf-16", newline="")
    return io.TextIOWrapper(raw, encoding="utf-8-sig", errors="surrogateescape", newline="")


def _bounded(file: TextIO, path: str) -> Iterator[str]:
    """Yield lines; an endless line is an error before it fills the memory."""
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
            offset = raw.tell()
            advance(offset - before)
            before = offset


class CsvRecording(Recording):
    """Separated values below a line with the names of the columns."""

    def __init__(
        self,
        lines: Iterable[str],
        source: str,
        columns: Columns | None = None,
        *,
        fast: bool = False,
    ) -> None:
        self._columns = columns = columns or Columns()
        self._file, self.source, self._fast = source, shown(source), fast
        self._lines = lines if isinstance(lines, Sequence) else None
        self._was_read = False
        below = iter(lines)
        skipped = list(itertools.islice(below, columns.skip))
        self._skipped, self._top = len(skipped), list(itertools.islice(below, TOP))
        layout = layout_of(self._top, columns.separator)
        if not layout.names:
            raise InputError(
                f"{self.source}: expected a first line with the names of the columns, got none"
            )
        self.separator, self._width = layout.separator, layout.width
        names = list(map(self._plain, layout.names))
        self.names = list(map(shown, names))
        self._notes = []
        if "".join(self._top[: layout.at]).strip():
            self._notes.append(skip_note(len(skipped), layout.at))
        if names != layout.names:
            self._notes.append(_LATIN)
        self.above = _settings([*skipped, *self._top[: layout.at]])
        rows = self._rows_from(layout, below)
        self.header, _ = next(rows)
        """The line of the names, from 1."""
        self.last_above, self._units = self.header, dict[str, str]()
        """The last line above the rows of values: of the names, or of the units."""
        if layout.units is not None:
            self._units = dict(zip(self.names, layout.units, strict=True))
            self.last_above, _ = next(rows)
            self._notes.append(units_note(self.last_above, layout.units))
        first = list(itertools.islice(rows, _FEW))
        self.rows = itertools.chain(first, rows)
        """The rows of values that are not empty, with their lines."""
        cells = [*zip(self.names, first[0][1], strict=False)] if first else []
        self.dates = [name for name, cell in cells if read_dates([cell]) is not None]
        self.days = [n for n, cell in cells if n in self.dates and len(cell.strip()) <= _DAY]
        self.texts = [n for n, cell in cells if n not in self.dates and _is_text(cell)]
        self.blank = [
            name
            for i, (name, _) in enumerate(cells)
            if not any(row[i].strip() for _, row in first if i < len(row))
        ]

    def _rows_from(
        self, layout: TextLayout, below: Iterable[str]
    ) -> Iterator[tuple[int, list[str]]]:
        """Return the rows from the line of the names on, with their lines."""
        before = self._skipped + layout.at
        if layout.rows is None:
            head = [names_line(self._top[layout.at]), *self._top[layout.at + 1 :]]
            lines = itertools.chain(head, below)
            return rows_of(lines, self.separator, before, self.source, layout.width)
        parsed = [(before + line, row) for line, row in layout.rows] if before else layout.rows
        end = self._skipped + len(self._top)
        more = rows_of(below, self.separator, end, self.source, layout.width)
        return itertools.chain(parsed, more)

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns; an empty cell that is allowed becomes nan."""
        if wanted.time is not None and self.names.count(wanted.time) > 1:
            raise InputError(
                f"{self.source}, line {self.header}: expected one column '{wanted.time}', got two"
            )
        if self._was_read:
            with self._reopened() as recording:
                return recording.read(wanted)
        self._was_read = True
        unit = self._unit_of(wanted.time)
        rows = self._read_fast(wanted) or self._rows(wanted, None)
        return replace(rows, unit=rows.unit or unit)

    def _read_fast(self, wanted: Wanted) -> Rows | None:
        """Return the wanted columns by pyarrow; None if the `csv` module must look closer."""
        RowFilter(wanted.where, self.names, self.source)
        table = self._split_by_pyarrow(wanted.names or self.names[:1])
        try:
            return None if table is None else self._rows(wanted, table)
        except InputError:  # the csv module may read the cell, or reports its line
            return None

    def lines_above(self, name: str) -> int | None:
        """Return the number of lines above the first line that has a name as a cell, or None."""
        for index, line in enumerate(self._top):
            cells = line.strip().split(self.separator if self.separator != " " else None)
            if name in (cell.strip().strip('"') for cell in cells):
                return self._skipped + index
        return None

    def selected(self, where: Mapping[str, str]) -> NDArray[np.bool_]:
        """Return whether each row has these texts, by the texts of the file."""
        texts = self.read(Wanted((), texts=[*where])).texts
        return RowFilter(where, self.names, self.source).mask(texts)

    def last_texts(self) -> Mapping[str, str]:
        """Return the cells of the last line by their columns; empty if it cannot be read alone."""
        lines: Sequence[str] = self._lines or ()
        if self._lines is None and not self._file.endswith(".gz"):
            with Path(self._file).open("rb") as raw:
                raw.seek(max(0, raw.seek(0, os.SEEK_END) - _TAIL))
                lines = raw.read().decode("utf-8", "surrogateescape").splitlines()[1:]
        line = next(filter(str.strip, reversed(lines)), "")
        row = next((cells for _, cells in rows_of([line], self.separator)), [])
        return dict(zip(self.names, map(str.strip, row), strict=False))

    @contextmanager
    def _reopened(self) -> Iterator[CsvRecording]:
        if self._lines is not None:
            yield CsvRecording(self._lines, self._file, self._columns)
            return
        with _lines_of(self._file) as (lines, _):
            yield CsvRecording(lines, self._file, self._columns, fast=self._fast)

    def _unit_of(self, time: str | None) -> str:
        """Return the unit of the times in the row of units, or an empty text."""
        where = f"{self.source}, line {self.last_above}"
        return unit_below(where, time, self._units, self._columns)

    def _rows(self, wanted: Wanted, table: Mapping[str, TextCells] | None) -> Rows:
        """Return the wanted columns."""
        lines: list[int] = []
        selected_rows: list[int] = []
        count = all_rows = 0

        def where(row: int) -> str:
            return where_any(selected_rows[row] if wanted.where else row)

        def where_any(row: int) -> str:
            if table is None:
                return f"{self.source}, line {lines[row]}"
            with self._reopened() as recording:  # pyarrow does not count lines
                line, _ = next(itertools.islice(recording.rows, row, None))
            return f"{self.source}, line {line}"

        option, selection = self._columns.decimal, RowFilter(wanted.where, self.names, self.source)
        step = TextNumbers(self.names, wanted, option, self.source, where, where_any, self._plain)
        others = replace(wanted, numbers=(), where={}).names
        parts: dict[str, list[TextCells]] = {name: [] for name in others}
        for cells in self._blocks(lines) if table is None else [table]:
            size, selected = len(next(iter(cells.values()))), None
            if wanted.where:
                selected = selection.mask(cells)
                selected_rows += (np.nonzero(selected)[0] + all_rows).tolist()
            step.add(cells, selected, complete=table is not None)
            for name, blocks in parts.items():
                column = cells[name]
                blocks.append(column if selected is None else column.selected(selected))
            count += size if selected is None else int(selected.sum())
            all_rows += size
        if wanted.where and all_rows:
            selection.check()
        numbers = step.finish(None if table is None else self._other_columns(table))
        columns = {name: TextCells.joined(blocks) for name, blocks in parts.items() if blocks}
        raw_times, unit = self._times(step, columns, wanted, where) if count else (None, "")
        notes = [*self._notes, *step.notes]
        texts = {name: [*map(str.strip, columns.get(name, ()))] for name in wanted.texts}
        decoded = {name: [*map(self._plain, column)] for name, column in texts.items()}
        if decoded != texts and _LATIN not in notes:
            notes.append(_LATIN)
        empty = TextCells(())
        values = {n: values_in(columns.get(n, empty), step.decimal) for n in wanted.cells}
        return Rows(
            numbers,
            decoded,
            count,
            where,
            self.source,
            raw_times,
            notes,
            unit=unit,
            cells=values,
        )

    def _times(
        self,
        step: TextNumbers,
        cells: Mapping[str, TextCells],
        wanted: Wanted,
        where: Callable[[int], str],
    ) -> tuple[RawTimes | None, str]:
        """Return the times, and their unit if it is certain."""
        time, part = wanted.time, wanted.part
        if time is None:
            return None, ""
        if part is None or not part.unit:
            return step.times(cells[time], None if part is None else cells[part.column]), ""
        parts, _ = times_in(cells[part.column], step.decimal, where)
        return join_times(step.times(cells[time]), parts, part.unit, where), "ns"

    def _split_by_pyarrow(self, names: Sequence[str]) -> Mapping[str, TextCells] | None:
        """Return some columns; None if pyarrow does not split the file as the `csv` module does."""
        if not self._fast or self.separator == " ":  # pyarrow splits at every blank of a run
            return None
        from rtamt_gym.recorded.arrow_columns import split_text

        place_of = {name: index for index, name in enumerate(self.names)}
        places = [*map(place_of.__getitem__, names), *range(len(self.names), self._width)]
        columns = split_text(self._file, self.separator, self._width, self.last_above, places)
        if columns is None or any("".join(beyond).strip() for beyond in columns[len(names) :]):
            return None
        if any(column.has('"') for column in columns):  # a quote after a blank is not one here
            return None
        if not self._has_row_a_line(len(columns[0])):
            return None
        return dict(zip(names, columns, strict=False))

    def _has_row_a_line(self, rows: int) -> bool:
        """Return whether no quoted cell below the names can span several lines."""
        lines, quoted, end = 0, False, b"\n"
        with Path(self._file).open("rb") as raw:
            opened = gzip.GzipFile(fileobj=raw) if self._file.endswith(".gz") else raw
            for _ in range(self.last_above):
                opened.readline()
            while block := opened.read(_LONG):
                quoted = quoted or b'"' in block
                lines, end = lines + block.count(b"\n"), block[-1:]
        return not quoted or lines + (end != b"\n") == rows

    def _other_columns(
        self, table: Mapping[str, TextCells]
    ) -> Callable[[], Mapping[str, TextCells]]:
        others = [name for name in dict.fromkeys(self.names) if name not in table]
        return lambda: (others and self._split_by_pyarrow(others)) or {}

    def _blocks(self, lines: list[int]) -> Iterator[Mapping[str, TextCells]]:
        """Yield the cells of blocks of rows, and append the line of each row."""
        while block := list(itertools.islice(self.rows, _BLOCK)):
            rows = [*map(itemgetter(1), block)]
            columns = list(zip(*rows, strict=False))
            beyond = columns[len(self.names) :]
            if {*map(len, rows)} != {self._width} or "".join(map("".join, beyond)).strip():
                raise self._width_error(block)
            lines += map(itemgetter(0), block)
            yield dict(zip(self.names, map(TextCells, columns), strict=False))

    def _width_error(self, block: Sequence[tuple[int, list[str]]]) -> InputError:
        n = len(self.names)
        line, row = next(
            (line, row)
            for line, row in block
            if len(row) != self._width or "".join(row[n:]).strip()
        )
        above = line - 1 == self.last_above and len(row) > n
        hint = "; give --skip N if the names are below the first N lines" if above else ""
        return InputError(
            f"{self.source}, line {line}: expected {n} values ({listed(self.names)}), "
            f"got {len(row)}{hint}"
        )

    def _plain(self, text: str) -> str:
        """Return a text as Latin-1 if its bytes were not UTF-8."""
        if not any("\udc80" <= character <= "\udcff" for character in text):
            return text
        latin = text.encode("utf-8", "surrogateescape").decode("latin-1")
        if not latin.isprintable():
            raise InputError(f"{self.source}: expected text in UTF-8, UTF-16 or Latin-1")
        return latin


_SETTING: Final = re.compile(
    r"[\W\d]*(?P<name>[^\W\d][\w \[\]()./-]*?)\s*[:=,;\t]\s*"
    r"\"?(?P<number>[\d.,]*\d(?:[eE][+-]?\d+)?)[\s\",;]*(?P<unit>[^\W\d]*)[\s\",;]*"
)


def _settings(lines: Iterable[str]) -> Mapping[str, float]:
    """Return the numbers in lines such as ``# Sample Interval [s]: 0.01`` by their names."""
    settings = {}
    for line in lines:
        match = _SETTING.fullmatch(line.strip())
        number = None if match is None else floats_in([match["number"].replace(",", ".")])
        if match is not None and number is not None:
            unit = f" [{match['unit']}]" if match["unit"].lower() not in ("", "hz") else ""
            settings[f"{match['name']}{unit}"] = float(number[0])
    return settings


def _is_text(cell: str) -> bool:
    return bool(cell.strip()) and floats_in([cell], gaps=True, nan=True) is None


def skip_note(before: int, lines: int) -> str:
    """Return the note on lines before the names, after lines that an option skips."""
    first, last = before + 1, before + lines
    phrase = f"line {first} is" if lines == 1 else f"lines {first} to {last} are"
    return f"{phrase} skipped: the names of the columns are in line {last + 1}"


def unit_below(where: str, time: str | None, units: Mapping[str, str], columns: Columns) -> str:
    """Return the unit of the times in a row of units, or an empty text."""
    below = units.get(time, "") if time is not None else ""
    if time is None or columns.time_unit is not None or below in ("", "-"):
        return ""
    unit, named = unit_of_times(f"t [{below}]"), unit_of_times(time)
    if unit is None or unit not in UNITS or named not in (None, "", unit):
        also = f", and {named!r} in its name" if named else ""
        raise InputError(
            f"{where}, column '{time}': expected one unit of "
            f"time, got {below!r}{also}; give the unit with --time-unit ({', '.join(UNITS)})"
        )
    return unit


def units_note(line: int, units: Sequence[str]) -> str:
    """Return the note on a row of units."""
    return f"line {line} is a row of units: {', '.join(units)}"
