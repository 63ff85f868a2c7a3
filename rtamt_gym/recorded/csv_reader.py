"""Reads recorded traces from text whose cells are separated by commas, semicolons, tabs or blanks.

A long file is read by pyarrow where that is installed. What it does not read as it stands, and
what is short, is read here: the rows of a block are converted together, column by column, and if a
block holds a cell that is not a number, its rows are searched for the first such cell, and the
error names its line. Cells stay text until a cell that is read decides the decimal mark.
"""

from __future__ import annotations

import codecs
import gzip
import io
import itertools
import re
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

from rtamt import InputError, unit_of_times
from rtamt.errors import shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.cells import NumberColumns, cells_in, floats_in, times_in
from rtamt_gym.recorded.columns import UNITS, Columns
from rtamt_gym.recorded.dates import RawTimes, read_dates
from rtamt_gym.recorded.decimal_marks import ColumnMarks, FileMarks, convert, notes_on
from rtamt_gym.recorded.progress import progress
from rtamt_gym.recorded.recording import Recording, Rows, Wanted
from rtamt_gym.recorded.selection import RowFilter
from rtamt_gym.recorded.text_layout import TOP, layout_of, names_line, rows_of
from rtamt_gym.recorded.times import join_times

__all__ = ["CsvRecording", "lines_of", "open_file"]

_BLOCK = 1 << 14
"""Rows in a block."""

_LINE = 1 << 26
"""The most characters of a line."""

_FEW = 100
"""Rows that show which decimal mark pyarrow is to try."""

_DAY = 12
"""Characters of the longest date without a time of day."""

_LONG = 1 << 20
"""Bytes from which on a file is worth the import of pyarrow."""


_LATIN = "the text is not UTF-8 and is read as Latin-1"


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Opens a CSV file, with a progress bar while it is read; ``-`` is stdin.

    Raises:
        InputError: If its name says that it is compressed, and it is not.
        OSError: If there is no such file.
    """
    if path == "-":
        raw = getattr(sys.stdin, "buffer", None)
        stdin = sys.stdin if raw is None else _text_of(raw)
        yield CsvRecording(list(_bounded(stdin, "stdin")), "stdin", columns)
        return
    with lines_of(path) as lines:
        if not Path(path).is_file():  # a pipe, which cannot be read again
            yield CsvRecording(list(lines), path, columns)
            return
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
        progress(f"reading {shown(path)}", Path(path).stat().st_size, "B") as advance,
    ):
        try:
            opened = cast("BinaryIO", gzip.GzipFile(fileobj=raw)) if path.endswith(".gz") else raw
            with _text_of(opened) as file:
                yield _counted(file, raw, advance, path)
        except (gzip.BadGzipFile, EOFError, zlib.error):
            raise InputError(f"{shown(path)}: expected a whole file compressed by gzip") from None


def _text_of(raw: BinaryIO) -> TextIO:
    """Return bytes as text: UTF-16 after its mark, else UTF-8; other bytes become surrogates."""
    begin = cast("io.BufferedReader", raw).peek(2)[:2]
    if begin in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return io.TextIOWrapper(raw, encoding="utf-16", newline="")
    return io.TextIOWrapper(raw, encoding="utf-8-sig", errors="surrogateescape", newline="")


def _plain(text: str, source: str) -> str:
    """Return a text whose bytes were not UTF-8 as Latin-1."""
    if not any("\udc80" <= character <= "\udcff" for character in text):
        return text
    latin = text.encode("utf-8", "surrogateescape").decode("latin-1")
    if not latin.isprintable():
        raise InputError(f"{source}: expected text in UTF-8, UTF-16 or Latin-1")
    return latin


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
        lines: The lines of the file; unless they are a sequence, they are read from the file again
            when columns are read a second time.
        source: Name of the file, for messages.
        columns: The separator, the decimal mark and the lines to skip, if they are not to be
            recognised.
        path: The file with these lines, if pyarrow is to read it.

    Raises:
        InputError: If there is no line of names.

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
        self._columns = columns = columns or Columns()
        self._file, self.source = source, shown(source)
        source = self.source
        self._lines = lines if isinstance(lines, Sequence) else None
        self._was_read = False
        given = iter(lines)
        skipped = list(itertools.islice(given, columns.skip))
        top = list(itertools.islice(given, TOP))
        layout = layout_of(top, columns.separator)
        self.separator = layout.separator
        """The character between cells."""
        if not layout.names:
            raise InputError(
                f"{source}: expected a first line with the names of the columns, got none"
            )
        self.names: Sequence[str] = [shown(_plain(name, source)) for name in layout.names]
        self._width = layout.width
        self._notes: list[str] = []
        if top[: layout.at] and "".join(top[: layout.at]).strip():
            self._notes.append(_skip_note(len(skipped), layout.at))
        if any(name != shown(own) for name, own in zip(self.names, layout.names, strict=True)):
            self._notes.append(_LATIN)
        self._top, self._skipped = top, len(skipped)
        self.above = _settings([*skipped, *top[: layout.at]])
        """The numbers in the lines above the names, by the text before them."""
        rows = self._rows_of(top, layout.at, given, len(skipped))
        self.header, _ = next(rows)
        """The line of the names, from 1."""
        self._above, self._units = self.header, dict[str, str]()
        if layout.units is not None:
            self._units = dict(zip(self.names, layout.units, strict=True))
            self._above, _ = next(rows)
            self._notes.append(f"line {self._above} is a row of units: {', '.join(layout.units)}")
        self._begin = list(itertools.islice(rows, _FEW))
        self.rows = itertools.chain(self._begin, rows)
        """The rows of values that are not empty, with their lines."""
        cells = [*zip(self.names, self._begin[0][1], strict=False)] if self._begin else []
        self.dates: Sequence[str] = [n for n, cell in cells if read_dates([cell]) is not None]
        self.days = [n for n, cell in cells if n in self.dates and len(cell.strip()) <= _DAY]
        """The columns of dates without a time of day."""
        self.texts = [n for n, cell in cells if n not in self.dates and _is_text(cell)]
        """The columns whose first cell is a text."""
        self.blank = [
            name
            for i, (name, _) in enumerate(cells)
            if not any(row[i].strip() for _, row in self._begin if i < len(row))
        ]
        """The columns without a value in the first rows."""
        # Runs of blanks are one separator here, and several for pyarrow.
        self._path = None if self.separator == " " else path
        self._long = path

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns; an empty cell that is allowed becomes nan.

        Raises:
            InputError: If a row or a cell is wrong, if the decimal mark is not certain, or if the
                row of units has a unit of the times that is not known.
        """
        if wanted.time is not None and self.names.count(wanted.time) > 1:
            raise InputError(
                f"{self.source}, line {self.header}: expected one column '{wanted.time}', got two"
            )
        if self._was_read:
            return self._read_again(wanted)
        self._was_read = True
        unit = self._unit_of(wanted.time)
        read = self._read_fast(wanted) or self._read_blocks(wanted)
        return replace(read, unit=read.unit or unit)

    def lines_above(self, name: str) -> int | None:
        """Return how many lines stand above the first line with a name as a cell; None without."""
        for at, line in enumerate(self._top):
            cells = line.strip().split(self.separator if self.separator != " " else None)
            if name in (cell.strip().strip('"') for cell in cells):
                return self._skipped + at
        return None

    def _read_again(self, wanted: Wanted) -> Rows:
        if self._lines is not None:
            return CsvRecording(self._lines, self._file, self._columns).read(wanted)
        with lines_of(self._file) as lines:
            return CsvRecording(lines, self._file, self._columns, self._long).read(wanted)

    def _unit_of(self, time: str | None) -> str:
        """Return the unit of the times in the row of units; empty if there is none."""
        below = self._units.get(time, "") if time is not None else ""
        if time is None or self._columns.time_unit is not None or below in ("", "-"):
            return ""
        unit, named = unit_of_times(f"t [{below}]"), unit_of_times(time)
        if unit is None or unit not in UNITS or named not in (None, "", unit):
            also = f", and {named!r} in its name" if named else ""
            raise InputError(
                f"{self.source}, line {self._above}, column '{time}': expected one unit of time, "
                f"got {below!r}{also}; say the unit with --time-unit ({', '.join(UNITS)})"
            )
        return unit

    def _read_fast(self, wanted: Wanted) -> Rows | None:
        path = self._path
        if path is None:
            return None
        from rtamt_gym.recorded.arrow_csv import Text, read_text

        mark = self._likely_mark()
        text = Text(path, self.names, self._width, self._above, self.separator, mark, self.dates)
        chosen = RowFilter(wanted.where, self.names, self.source)
        read = read_text(text, wanted, chosen, certain=self._columns.decimal is not None)
        if read is None:
            return None
        kept = read.rows

        def where(row: int) -> str:  # the file is read once more
            with lines_of(path) as lines:
                rows = CsvRecording(lines, self.source, self._columns).rows
                at = row if kept is None else int(kept[row])
                line, _ = next(itertools.islice(rows, at, None))
            return f"{self.source}, line {line}"

        notes = self._notes + notes_on(self._columns.decimal, read.decimal, "", read.thousands)
        return Rows(
            read.numbers,
            read.texts,
            read.count,
            where,
            self.source,
            read.times,
            notes,
            cells=read.cells,
        )

    def _likely_mark(self) -> str:
        """Return the decimal mark of the first rows; a point if they do not show it."""
        if self._columns.decimal is not None:
            return self._columns.decimal
        marks = ColumnMarks()
        for _, row in self._begin:
            marks.add(row, 0)
        return "," if "," in marks.certain and "." not in marks.certain else "."

    def _read_blocks(self, wanted: Wanted) -> Rows:
        time = [] if wanted.time is None else [wanted.time]
        part = [] if wanted.part is None else [wanted.part.column]
        named = (*wanted.texts, *wanted.cells, *time, *part)
        columns: dict[str, list[str]] = {name: [] for name in named}
        lines: list[int] = []
        every: list[int] = []

        def where(row: int) -> str:
            return f"{self.source}, line {lines[row]}"

        def where_of_all(row: int) -> str:
            return f"{self.source}, line {every[row]}"

        def plain(text: str) -> str:
            return _plain(text, self.source)

        read = dict.fromkeys([*wanted.numbers, *time])
        marks = FileMarks(self.names, read, self._columns.decimal, self.source, where_of_all)
        numbers = NumberColumns(wanted)
        for places, cells in self._blocks(wanted, marks, every):
            numbers.add(cells, len(lines))
            lines += places
            for name, column in columns.items():
                column.extend(cells[name])
            if marks.known:
                convert(numbers, marks, where, plain)
        decimal = convert(numbers, marks, where, plain)
        times, unit = self._times(columns, decimal, wanted, where) if lines else (None, "")
        if time:
            numbers.look_for_groups(columns[time[0]], decimal)
        notes = [*self._notes, *marks.notes(decimal, numbers.grouped)]
        texts = {name: [*map(str.strip, columns[name])] for name in wanted.texts}
        decoded = {name: [*map(plain, column)] for name, column in texts.items()}
        if decoded != texts and _LATIN not in notes:
            notes.append(_LATIN)
        cells_as_read = {name: cells_in(columns[name], decimal) for name in wanted.cells}
        return Rows(
            numbers.arrays,
            decoded,
            len(lines),
            where,
            self.source,
            times,
            notes,
            unit=unit,
            cells=cells_as_read,
        )

    def _blocks(
        self, wanted: Wanted, marks: FileMarks, every: list[int]
    ) -> Iterator[tuple[Sequence[int], Mapping[str, Sequence[str]]]]:
        """Yield the lines and the cells of the rows that are selected, in blocks.

        Args:
            wanted: The rows.
            marks: The evidence of decimal marks, to which the cells of all rows are added.
            every: A list to which the lines of all rows are added.

        Raises:
            InputError: If no row is selected.
        """
        chosen = RowFilter(wanted.where, self.names, self.source)
        while block := list(itertools.islice(self.rows, _BLOCK)):
            cells = self._cells_of(block)
            marks.add(cells, len(every))
            places = [line for line, _ in block]
            every += places
            if wanted.where:
                kept = chosen.mask(cells)
                cells = {name: [*itertools.compress(each, kept)] for name, each in cells.items()}
                places = [*itertools.compress(places, kept)]
            if places:
                yield places, cells
        if wanted.where and every:
            chosen.check()

    def _times(
        self,
        texts: Mapping[str, Sequence[str]],
        decimal: str,
        wanted: Wanted,
        where: Callable[[int], str],
    ) -> tuple[RawTimes | None, str]:
        """Return the times, and their unit if it is certain."""
        time, part = wanted.time, wanted.part
        if time is None:
            return None, ""

        def place(row: int) -> str:
            return f"{where(row)}, column '{time}'"

        if part is None or not part.unit:
            days = None if part is None else texts[part.column]
            return times_in(texts[time], decimal, place, days, self._columns.date_order), ""
        seconds = times_in(texts[time], decimal, place)
        parts = times_in(texts[part.column], decimal, where)
        return join_times(seconds, parts, part.unit, where), "ns"

    def _cells_of(self, block: Sequence[tuple[int, list[str]]]) -> Mapping[str, Sequence[str]]:
        """Return the cells of some rows by column."""
        rows = [*map(itemgetter(1), block)]
        columns = list(zip(*rows, strict=False))
        beyond = columns[len(self.names) :]
        if {*map(len, rows)} != {self._width} or "".join(map("".join, beyond)).strip():
            raise next(self._width_errors(block))
        return dict(zip(self.names, columns, strict=False))

    def _width_errors(self, block: Sequence[tuple[int, list[str]]]) -> Iterator[InputError]:
        n = len(self.names)
        for line, row in block:
            if len(row) != self._width or "".join(row[n:]).strip():
                above = line - 1 == self._above and len(row) > n
                hint = "; give --skip N if the names are below the first N lines" if above else ""
                yield InputError(
                    f"{self.source}, line {line}: expected {n} values ({listed(self.names)}), "
                    f"got {len(row)}{hint}"
                )

    def _rows_of(
        self, top: Sequence[str], at: int, below: Iterable[str], skipped: int
    ) -> Iterator[tuple[int, list[str]]]:
        """Yield the line of the names and the rows below it, with their line numbers."""
        lines = itertools.chain([names_line(top[at])], top[at + 1 :], below)
        return rows_of(lines, self.separator, skipped + at, self.source)


_SETTING: Final = re.compile(
    r"[\W\d]*(?P<name>[^\W\d][\w \[\]()./-]*?)\s*[:=,;\t]\s*"
    r"\"?(?P<number>[\d.,]*\d(?:[eE][+-]?\d+)?)[\s\",;]*(?P<unit>[^\W\d]*)[\s\",;]*"
)


def _settings(lines: Iterable[str]) -> Mapping[str, float]:
    """Return the numbers in lines such as ``# Sample Interval [s]: 0.01`` by their names."""
    settings = {}
    for line in lines:
        found = _SETTING.fullmatch(line.strip())
        number = None if found is None else floats_in([found["number"].replace(",", ".")])
        if found is not None and number is not None:
            unit = f" [{found['unit']}]" if found["unit"].lower() not in ("", "hz") else ""
            settings[f"{found['name']}{unit}"] = float(number[0])
    return settings


def _is_text(cell: str) -> bool:
    return bool(cell.strip()) and floats_in([cell], gaps=True, nan=True) is None


def _skip_note(before: int, lines: int) -> str:
    """Return the note on lines before the names, of which some are skipped by an option."""
    first, last = before + 1, before + lines
    what = f"line {first} is" if lines == 1 else f"lines {first} to {last} are"
    return f"{what} skipped: the names of the columns are in line {last + 1}"
