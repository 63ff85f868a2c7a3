"""Rows of text: cells between separators, below a line of names."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.cells import floats_in
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.csv_reader import skip_note, units_note
from rtamt_gym.recorded.text_layout import TOP, layout_of, may_be_units
from rtamt_gym.watching.rows import BadLine, RowBlock

_MARKS = b"\xff\xfe", b"\xfe\xff"


class TextRows:
    """Divides lines of text into cells, as `rtamt_gym.recorded.csv_reader` does.

    Args:
        columns: The separator, and the lines to skip.
        source: The name of the stream, for messages.
    """

    def __init__(self, columns: Columns, source: str) -> None:
        self._columns, self._source = columns, source
        self._skip = columns.skip
        self._top: list[str] = []
        self._top_line = 0
        self._wanted: list[tuple[str, int]] = []
        self.names: list[str] = []
        self.header = 0
        """The number of the line of names."""
        self.units: dict[str, str] = {}
        """The cells of the row of units by column; empty without one."""
        self.units_line = 0
        self._last = ""
        self.notes: list[str] = []
        """The notes on the lines above the rows."""

    def rows(self, lines: list[bytes], first: int) -> Iterator[RowBlock | BadLine]:
        """Yield the rows in lines, of which the first has a number."""
        if first == 1 and lines:
            if lines[0][:2] in _MARKS:
                raise InputError(f"{self._source}: expected text in UTF-8, got UTF-16")
            lines[0] = lines[0].removeprefix(b"\xef\xbb\xbf")
        if self._skip:
            skipped = min(self._skip, len(lines))
            self._skip -= skipped
            lines, first = lines[skipped:], first + skipped
        if not lines:
            return
        text = b"\n".join(lines).decode("utf-8", "surrogateescape").replace("\r", "")
        texts = text.split("\n")
        if not self.names:
            texts, first = self._below_names(texts, first)
        # Few blocks of values contain a name.
        if texts and max(self.names, key=len) in text:
            yield from self._without_names(texts, first)
        elif texts:
            yield from self._divided(texts, first)

    def _without_names(self, texts: list[str], first: int) -> Iterator[RowBlock | BadLine]:
        """Yield the rows in lines, of which some may have the names of the columns again."""
        begin = 0
        for at, text in enumerate(texts):
            fault = self._fault_of_names(text, first + at)
            if fault is None:
                continue
            if begin < at:
                yield from self._divided(texts[begin:at], first + begin)
            yield fault
            begin = at + 1
        if begin < len(texts):
            yield from self._divided(texts[begin:], first + begin)

    def _fault_of_names(self, text: str, line: int) -> BadLine | None:
        """Return the fault of a line with the names of the columns again; None for another line."""
        cells = [shown(cell.strip()) for cell in self._row(text) or []]
        names = [*map(str.strip, self.names)]
        known = sum(cell in names for cell in cells)
        if 2 * known <= len(cells) or any(floats_in([cell]) is not None for cell in cells):
            return None
        if cells == names:
            return BadLine(line, "expected values, got the names of the columns again")
        return BadLine(
            line,
            f"expected values, got other names of columns than in line {self.header}: "
            f"{listed(cells)}. Cut the stream there.",
            skippable=False,
        )

    def last_cells(self) -> dict[str, str]:
        """Return the cells of the last row by column."""
        return dict(zip(self.names, self._row(self._last) or [], strict=False))

    def choose(self, names: Sequence[str]) -> None:
        """Set the columns of all further blocks."""
        position = {name: index for index, name in reversed([*enumerate(self.names)])}
        self._wanted = [(name, position[name]) for name in names]

    def finish(self) -> None:
        """Raise InputError if the names of the columns never came."""
        if not self.names:
            layout = layout_of(self._top, self._columns.separator)
            if not layout.names:
                raise InputError(
                    f"{self._source}: expected a first line with the names of the columns, got none"
                )
            self.names = list(map(shown, layout.names))

    def _below_names(self, texts: list[str], first: int) -> tuple[list[str], int]:
        """Find the line of names, for which the first row is needed; return the lines below it."""
        if not self._top:
            self._top_line = first
        self._top += texts
        full = [at for at, text in enumerate(self._top) if text.strip()]
        for at in full[1:]:
            layout = layout_of(self._top[: at + 1], self._columns.separator)
            if layout.names and layout.at < at:
                rows = [row for row in full if layout.at < row <= at]
                if len(rows) == 1 and may_be_units(self._top[at], layout.separator):
                    continue  # the next row shows it
                self.names = list(map(shown, layout.names))
                self._separator, self._width = layout.separator, layout.width
                self.header = self._top_line + layout.at
                if "".join(self._top[: layout.at]).strip():
                    self.notes.append(skip_note(self._top_line - 1, layout.at))
                begin = layout.at + 1
                if layout.units is not None:
                    row = rows[0]
                    self.units_line = self._top_line + row
                    self.units = dict(zip(self.names, layout.units, strict=False))
                    self.notes.append(units_note(self.units_line, layout.units))
                    begin = row + 1
                below, line = self._top[begin:], self._top_line + begin
                self._top = []
                self.choose(self.names)
                return below, line
            if at > TOP:
                raise InputError(
                    f"{self._source}: expected the names of the columns above the first row; give "
                    "--skip N if they are below the first N lines"
                )
        return [], first

    def _divided(self, texts: list[str], first: int) -> Iterator[RowBlock | BadLine]:
        self._last = next(filter(str.strip, reversed(texts)), self._last)
        separator, width = self._separator, self._width
        plain = separator != " " and width == len(self.names)
        if plain and not any('"' in text for text in texts):
            count = width - 1
            if all(text.count(separator) == count for text in texts) and (width > 1 or all(texts)):
                yield self._block(texts, range(first, first + len(texts)))
                return
        good: list[list[str]] = []
        lines: list[int] = []
        for line, text in enumerate(texts, first):
            row = self._row(text)
            if row is None:
                continue
            if len(row) != width or "".join(row[len(self.names) :]).strip():
                if good:
                    yield self._transposed(good, lines)
                    good, lines = [], []
                names = listed(self.names)
                yield BadLine(line, f"expected {len(self.names)} values ({names}), got {len(row)}")
                continue
            good.append(row)
            lines.append(line)
        if good:
            yield self._transposed(good, lines)

    def _block(self, texts: list[str], lines: range) -> RowBlock:
        """Return lines that have as many separators as the line of names, without quotes."""
        cells = self._separator.join(texts).split(self._separator)
        width = self._width
        return RowBlock(lines, {name: cells[at::width] for name, at in self._wanted})

    def _transposed(self, rows: list[list[str]], lines: list[int]) -> RowBlock:
        return RowBlock(lines, {name: [row[at] for row in rows] for name, at in self._wanted})

    def _row(self, text: str) -> list[str] | None:
        """Return the cells of a line; None for an empty line."""
        if not text:
            return None
        if self._separator == " ":
            return text.split() or None
        if text.count('"') % 2:  # a quoted cell of several lines is no row
            return []
        try:
            return next(csv.reader([text], delimiter=self._separator, skipinitialspace=True), None)
        except csv.Error:
            return []
