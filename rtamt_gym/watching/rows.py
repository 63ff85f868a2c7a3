"""Rows of a stream, from text or JSON: blocks of good lines, and bad lines."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final, NoReturn

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.cells import floats_in
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.csv_reader import skip_note, units_note
from rtamt_gym.recorded.text_layout import TOP, layout_of, may_be_units

_LINE: Final = 1 << 26
"""The maximum number of bytes of a line."""

ColumnCells = Sequence[Any]
"""The cells of a column: texts, or values of JSON."""


@dataclass(frozen=True, slots=True)
class RowBlock:
    """Neighbouring good lines.

    Attributes:
        lines: The number of each line, from 1.
        columns: The cells of the columns that are read.
    """

    lines: Sequence[int]
    columns: Mapping[str, ColumnCells]

    def part(self, begin: int, end: int) -> RowBlock:
        """Return some of the rows."""
        columns = {name: cells[begin:end] for name, cells in self.columns.items()}
        return RowBlock(self.lines[begin:end], columns)


@dataclass(frozen=True, slots=True)
class BadLine:
    """A line that is not a row.

    Attributes:
        line: Its number, from 1.
        reason: The fault.
        skippable: Whether ``--skip-bad`` may leave it out.
    """

    line: int
    reason: str
    skippable: bool = True


class Lines:
    """Divides blocks of bytes of any size into lines."""

    def __init__(self, source: str) -> None:
        self._source, self._rest = source, bytearray()

    def add(self, block: bytes) -> list[bytes]:
        """Return the lines that a block completes."""
        end = block.rfind(b"\n")
        if end < 0:
            self._rest += block
            if len(self._rest) > _LINE:
                raise InputError(f"{self._source}: expected lines of at most {_LINE} bytes")
            return []
        lines = (bytes(self._rest) + block[:end]).split(b"\n")
        self._rest[:] = block[end + 1 :]
        return lines

    def finish(self) -> list[bytes]:
        """Return the last line, if it has no end."""
        return [bytes(self._rest)] if self._rest else []


class RowFault(Exception):  # noqa: N818 - the fault of a line, which `StreamWatch` reports or leaves out
    """A row that cannot be read or judged; all rows before it in its block can.

    Attributes:
        row: Its place in the block.
        reason: The fault.
        skippable: Whether ``--skip-bad`` may leave it out.
    """

    def __init__(self, row: int, reason: str, *, skippable: bool = True) -> None:
        super().__init__(reason)
        self.row, self.reason, self.skippable = row, reason, skippable


def cell_text(cell: object) -> str:
    """Return the text of a cell; an empty text for no value."""
    if cell is None:
        return ""
    if isinstance(cell, str):
        return cell
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return str(cell)


_MARKS = b"\xff\xfe", b"\xfe\xff"

_OPEN_CELL = (
    "expected the end of a quoted cell in its line, so the next lines may be rows or parts of the "
    "cell. Write each row in one line, or evaluate the recording with rtamt monitor."
)


class RowReader:
    """Divides lines into cells.

    Attributes:
        names: The names of the columns; empty until they are known.
        units: The cells of the row of units by column; empty without one.
        units_line: The number of its line.
        notes: The notes on the lines above the rows.
        totals: Whether the last row may be a row of totals, as in tables of text.
    """

    totals = False

    def __init__(self, source: str) -> None:
        self._source = source
        self.names: list[str] = []
        self.units: dict[str, str] = {}
        self.units_line = 0
        self.notes: list[str] = []

    def rows(self, lines: list[bytes], first: int) -> Iterator[RowBlock | BadLine]:
        """Yield the rows in lines; ``first`` is the number of the first line."""
        raise NotImplementedError

    def choose(
        self, names: Sequence[str], needed: Collection[str], take_field: TakeField | None
    ) -> None:
        """Set the columns of all further blocks; until then they have all columns.

        Args:
            names: The columns.
            needed: The columns of variables, times and groups.
            take_field: Takes the first field of a name that the first line does not have.
        """
        raise NotImplementedError

    def finish(self) -> None:
        """Raise InputError if the names of the columns never came."""
        raise NotImplementedError

    def last_cells(self) -> dict[str, str]:
        """Return the cells of the last row of a text by column."""
        return {}


TakeField = Callable[[str, object], tuple[str, bool]]
"""Takes a new field and its value; returns its fault, or if further blocks have its column."""


class TextRows(RowReader):
    """Divides lines of text into cells, as `rtamt_gym.recorded.csv_reader` does."""

    totals = True

    def __init__(self, columns: Columns, source: str) -> None:
        super().__init__(source)
        self._columns = columns
        self._skip = columns.skip
        self._top: list[str] = []
        self._top_line = 0
        self._wanted: list[tuple[str, int]] = []
        self._header = 0
        """The number of the line of names."""
        self._last = ""

    def rows(self, lines: list[bytes], first: int) -> Iterator[RowBlock | BadLine]:
        """Yield the rows in lines."""
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
        cells = [shown(cell.strip()) for cell in self._cells(text)]
        names = [*map(str.strip, self.names)]
        known = sum(cell in names for cell in cells)
        if 2 * known <= len(cells) or any(floats_in([cell]) is not None for cell in cells):
            return None
        if cells == names:
            return BadLine(line, "expected values, got the names of the columns again")
        return BadLine(
            line,
            f"expected values, got other names of columns than in line {self._header}: "
            f"{listed(cells)}. Cut the stream there.",
            skippable=False,
        )

    def last_cells(self) -> dict[str, str]:
        """Return the cells of the last row by column."""
        return dict(zip(self.names, self._cells(self._last), strict=False))

    def choose(
        self,
        names: Sequence[str],
        needed: Collection[str] = (),
        take_field: TakeField | None = None,
    ) -> None:
        """Set the columns of all further blocks."""
        del needed, take_field
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
                self._header = self._top_line + layout.at
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
            if isinstance(row, str):
                if good:
                    yield self._transposed(good, lines)
                    good, lines = [], []
                yield BadLine(line, row, skippable=row != _OPEN_CELL)
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

    def _cells(self, text: str) -> list[str]:
        """Return the cells of a line; no cells if it is empty or has a fault."""
        row = self._row(text)
        return row if isinstance(row, list) else []

    def _row(self, text: str) -> list[str] | str | None:
        """Return the cells of a line, or its fault; None for an empty line."""
        if not text:
            return None
        if self._separator == " ":
            return text.split() or None
        reader = csv.reader([text, ""], delimiter=self._separator, skipinitialspace=True)
        try:
            row = next(reader)
        except csv.Error as error:
            reason = f"expected a row, got an error: {error}"
            return _OPEN_CELL if text.count('"') % 2 else reason
        return _OPEN_CELL if reader.line_num > 1 else row


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is not strict JSON")


def _loader() -> Callable[[bytes], Any]:
    """Return the parser: orjson if it is installed, otherwise the json of Python."""
    try:
        import orjson
    except ModuleNotFoundError:
        decoder = json.JSONDecoder(parse_constant=_refuse_constant)

        def load(line: bytes) -> Any:  # noqa: ANN401 - what a line holds
            return decoder.decode(line.decode("utf-8"))

        return load
    loads: Callable[[bytes], Any] = orjson.loads
    return loads


class JsonRows(RowReader):
    """Divides lines of JSON into cells; nested fields have dotted names."""

    def __init__(self, source: str) -> None:
        super().__init__(source)
        self._load = _loader()
        self._wanted: list[str] = []
        self._plain = False
        self._known: set[str] = set()
        self._needed: Collection[str] = ()
        self._take_field: TakeField | None = None

    def choose(
        self, names: Sequence[str], needed: Collection[str], take_field: TakeField | None
    ) -> None:
        """Set the columns of all further blocks."""
        self._wanted, self._needed, self._take_field = [*names], {*needed}, take_field

    def finish(self) -> None:
        """Raise InputError if no line came."""
        if not self.names:
            raise InputError(f"{self._source}: expected one JSON object in each line, got none")

    def rows(self, lines: list[bytes], first: int) -> Iterator[RowBlock | BadLine]:
        """Yield the rows of the lines."""
        if first == 1 and lines:
            lines[0] = lines[0].removeprefix(b"\xef\xbb\xbf")
        if self._plain and (block := self._fast(lines, first)) is not None:
            yield block
            return
        good: list[Mapping[str, Any]] = []
        numbers: list[int] = []
        for line, text in enumerate(lines, first):
            if not text.strip():
                continue
            row = self._row(text)
            if isinstance(row, str):
                if good:
                    yield self._block(good, numbers)
                    good, numbers = [], []
                yield BadLine(line, row)
                continue
            good.append(row)
            numbers.append(line)
            if not self.names:  # the next lines are read by its names
                self._start(row, text)
                yield self._block(good, numbers)
                good, numbers = [], []
        if good:
            yield self._block(good, numbers)

    def _start(self, row: Mapping[str, Any], text: bytes) -> None:
        self.names = [*row]
        self._known = {*row}
        self._wanted = self._wanted or self.names
        self._plain = [*self._load(text)] == self.names  # nothing is nested

    def _fast(self, lines: list[bytes], first: int) -> RowBlock | None:
        """Return lines of plain objects that have all columns; None if one may be another."""
        try:
            if len(self._wanted) < 2:  # then a getter returns no tuple
                return None
            # Nothing but an object has members with names.
            objects = list(map(self._load, lines))
            rows = list(map(itemgetter(*self._wanted), objects))
            if not set().union(*objects) <= self._known:
                return None
            if _may_repeat(b"\n".join(lines), sum(map(len, objects))):
                return None
            columns = dict(zip(self._wanted, zip(*rows, strict=True), strict=True))
        except (ValueError, KeyError, TypeError, RecursionError):
            return None
        return RowBlock(range(first, first + len(lines)), columns)

    def _row(self, text: bytes) -> Mapping[str, Any] | str:
        """Return the fields of a line, or its fault."""
        try:
            row = self._load(text)
        except (ValueError, RecursionError) as error:
            reason, _, _ = str(error).partition(":")
            return f"expected one JSON object, got an error: {shown(reason)}"
        if not isinstance(row, dict):
            return f"expected one JSON object, got {type(row).__name__}"
        if _may_repeat(text, _names_in(row)) and (name := _repeated(text)) is not None:
            return f"expected one value of each field, got two of '{shown(name)}'"
        lists: dict[str, int] = {}
        fields = list(_fields(row, "", lists))
        row = dict(fields)
        if len(row) < len(fields):
            name = next(name for name, count in Counter(n for n, _ in fields).items() if count > 1)
            return f"expected one value of each field, got two of '{name}'"
        for name in self._needed:
            if name not in row and (fault := _other_kind(name, row, lists)):
                return fault
        return self._fault_of_fields(row) or row

    def _fault_of_fields(self, row: Mapping[str, Any]) -> str:
        """Take the fields that no line before had; return their fault, or an empty text."""
        if self._take_field is None:
            return ""
        for name in row:
            if name in self._known:
                continue
            fault, wanted = self._take_field(name, row[name])
            if fault:
                return fault
            self._known.add(name)
            if wanted:
                self._wanted.append(name)
        return ""

    def _block(self, rows: list[Mapping[str, Any]], lines: list[int]) -> RowBlock:
        columns = {name: [row.get(name) for row in rows] for name in self._wanted}
        return RowBlock(lines, columns)


def _may_repeat(text: bytes, names: int) -> bool:
    """Return whether objects may have fields of one name, of which the parser keeps the last."""
    if text.count(b":") == names:  # each name has one, also a repeated one
        return False
    return text.count(b'":') != names or any(gap in text for gap in (b'" ', b'"\t', b'"\r'))


def _names_in(value: object) -> int:
    """Return the number of names in a value of JSON."""
    if isinstance(value, dict):
        return len(value) + sum(map(_names_in, value.values()))
    return sum(map(_names_in, value)) if isinstance(value, list) else 0


def _repeated(text: bytes) -> str | None:
    """Return a name that an object has twice; None without one."""
    repeated: list[str] = []

    def check(pairs: list[tuple[str, object]]) -> None:
        counts = Counter(name for name, _ in pairs)
        repeated.extend(name for name, count in counts.items() if count > 1)

    json.loads(text, object_pairs_hook=check)
    return repeated[0] if repeated else None


def _fields(
    value: Mapping[str, Any], prefix: str, lists: dict[str, int]
) -> Iterator[tuple[str, Any]]:
    """Yield the fields of an object: those of objects in it have dotted names.

    Args:
        value: The object.
        prefix: The text before their names.
        lists: Receives the lengths of lists; -1 for an object.
    """
    for key, field in value.items():
        name = f"{prefix}{key}"
        if isinstance(field, dict):
            lists[shown(name)] = -1
            yield from _fields(field, f"{name}.", lists)
        elif isinstance(field, list):
            lists[shown(name)] = len(field)
            for index, element in enumerate(field):
                if not isinstance(element, dict | list):
                    yield f"{name}[{index}]", element
        else:
            yield shown(name), field


def _other_kind(name: str, row: Mapping[str, Any], lists: Mapping[str, int]) -> str:
    """Return the fault of a line that has something else in place of a field; empty without one."""
    if name in lists:
        return f"column '{name}': expected a number, got {_container(lists[name])}"
    for place, mark in enumerate(name):
        outer = name[:place]
        if mark == "." and (row.get(outer) is not None or lists.get(outer, -1) >= 0):
            kind = _container(lists[outer]) if outer in lists else repr(row[outer])
            return f"column '{name}': expected an object in '{outer}', got {kind}"
        if mark == "[" and (row.get(outer) is not None or outer in lists):
            kind = _container(lists[outer]) if outer in lists else repr(row[outer])
            return f"column '{name}': expected a list with this element, got {kind}"
    return ""


def _container(length: int) -> str:
    return "an object" if length < 0 else f"a list of {length}"
