"""The layout of a text with cells: lines before the names, the separator, a row of units."""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Final

from rtamt import InputError
from rtamt_gym.recorded.cells import TRUTH, is_number, read_dates

TOP: Final = 200
"""The lines in which the names are searched, and from which the layout is recognised."""

_SEPARATORS: Final = ",;\t|"
"""The separators that are recognised; of two equally frequent ones the first is taken."""

_STATED: Final = re.compile(r'"?sep=(?P<mark>[^"])"?[,;\t\s]*', re.IGNORECASE)
"""A first line that states the separator, as spreadsheets read it."""

_COMMENT: Final = re.compile(r"\s*(?:#|%|//)\s*")

_UNITS: Final = frozenset(
    [
        *("s", "sec", "ms", "us", "µs", "μs", "ns", "min", "h", "hz", "khz"),
        *("m", "mm", "cm", "km", "m/s", "km/h", "mph", "m/s2", "m/s^2", "m/s²"),
        *("rad", "deg", "°", "rad/s", "deg/s", "°/s", "rpm", "1/min", "1/s"),
        *("v", "mv", "a", "ma", "w", "kw", "n", "nm", "kg", "g", "%"),
        *("degc", "°c", "c", "k", "pa", "kpa", "mbar", "bar", "l/min"),
    ]
)
"""Common units in lower case, of which a row of units has one at least."""


@dataclass(frozen=True, slots=True)
class TextLayout:
    """Where the names of the columns are in a text, and how its lines are divided.

    Attributes:
        at: The index of the line with the names.
        separator: The character between cells; a blank stands for runs of blanks.
        names: The names of the columns.
        width: The cells of each row; cells beyond the names are empty.
        units: The cells of the row of units below the names; None without such a row.
        rows: The rows from the line of names, as `rows_of` yields them; None if a quote may
            continue beyond the lines.
    """

    at: int
    separator: str
    names: list[str]
    width: int
    units: list[str] | None
    rows: Sequence[tuple[int, list[str]]] | None = field(default=None, repr=False)


def layout_of(lines: Sequence[str], separator: str | None) -> TextLayout:
    """Return the layout of a text.

    Lines before the names are left out only if they cannot hold the names: they are comments, or
    they have another number of cells than the rows, and a later line fits all rows below it.
    """
    full = [row for row, line in enumerate(lines) if line.strip()]
    if not full:
        return TextLayout(0, separator or ",", [], 0, None)
    stated = _STATED.fullmatch(lines[full[0]])
    if stated is not None and len(full) > 1:
        del full[0]
        separator = separator or stated["mark"]
    first = full[0]
    for row, below in itertools.pairwise(full):
        if not _COMMENT.match(lines[row]) or _names_of(lines, row, below, separator):
            break
        first = below
    table = _Candidate.below(lines, first, separator)
    if table.fits and (table.rows or first == full[-1]):  # a quote may span all rows
        return table.layout
    for row in full[full.index(first) :]:
        other = _Candidate.below(lines, row, separator)
        if other.certain:
            return other.layout
        if len(other.layout.names) > 1 and _is_value(other.layout.names[0]):
            break  # this line is a row of a table
    return table.layout


_END: Final = "\0end"
"""A line after the last one, which a quote that is not closed takes into its cell."""


def rows_of(
    lines: Iterable[str], separator: str, before: int = 0, source: str = "text", width: int = 0
) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows that are not empty, with the number of their last line.

    If their width is stated, the lines go to the end of the text, and quotes that may hide rows are
    an error.
    """
    if separator == " ":
        lines = (line.strip() for line in lines)
    if width:
        lines = itertools.chain(lines, [_END])
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    last = before
    try:
        for row in reader:
            line = before + reader.line_num
            if width and (line > last + 1 or row == [_END]):
                if row == [_END]:
                    return
                _check_quotes(row, separator, f"{source}, line", last + 1, line, width)
            if row:
                yield line, row
            last = line
    except csv.Error as error:
        reason, _, _ = str(error).partition(" - ")  # the rest is advice for programmers
        raise InputError(f"{source}, line {last + 1}: {reason}") from None


def _check_quotes(
    row: Sequence[str], separator: str, where: str, first: int, last: int, width: int
) -> None:
    """Check that a row of several lines cannot be several rows."""
    if row[-1].endswith(_END):
        raise InputError(
            f"{where} {first}: expected the end of a quoted cell, got the end of the file. Close "
            "the quote, or remove it."
        )
    lines = separator.join(row).splitlines()
    rows = all(line.count(separator) + 1 == width for line in lines if line)
    if width == len(row) > 1 and (rows or separator == " "):  # line breaks are blanks there
        raise InputError(
            f"{where}s {first} to {last}: expected a row on each line, got a quoted cell over "
            "lines that may be rows. Remove the quotes, or the line breaks in the cell."
        )


def _names_of(lines: Sequence[str], at: int, below: int, separator: str | None) -> bool:
    """Return whether a comment holds the names of the columns of the line below it."""
    if _COMMENT.match(lines[below]):
        return False
    table = _Candidate.below(lines, at, separator)
    if not table.rows or len(table.rows[0]) != table.layout.width:
        return False
    if "" in table.layout.names:  # another kind of line, as in annotated files
        return False
    if any(map(_is_value, table.rows[0])):
        return True
    return table.layout.width > 1 and not _Candidate.below(lines, below, separator).certain


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A possible line of names, and the rows below it.

    Attributes:
        layout: The layout with this line of names.
        rows: The first rows.
    """

    layout: TextLayout
    rows: list[list[str]]

    @classmethod
    def below(cls, lines: Sequence[str], at: int, separator: str | None) -> _Candidate:
        head = names_line(lines[at])
        if separator is None:
            separator = _separator_of(head, next(filter(str.strip, lines[at + 1 :]), ""))
        texts = [head, *lines[at + 1 :]]
        numbered: list[tuple[int, list[str]]] = []
        complete = not any('"' in text for text in texts)
        try:
            numbered.extend(rows_of(texts, separator))
        except InputError:  # the reader reports it
            complete = False
        rows = [*map(itemgetter(1), numbered)]
        names, rows = [name.strip() for name in rows[0]] if rows else [], rows[1:]
        if len(lines) >= TOP and len(rows) > 1:
            del rows[-1]  # the last row may be cut
        named = len(names)
        while named and not names[named - 1]:
            named -= 1
        width = len(rows[0]) if rows else len(names)
        longer = max(map(len, rows), default=0) > named
        beyond = [cell for row in rows for cell in row[named:]] if longer else []
        if not named or width < named or any(map(str.strip, beyond)):
            named = width = len(names)
        units, parsed = _units_in(rows, named), numbered if complete else None
        return cls(TextLayout(at, separator, names[:named], width, units, parsed), rows)

    @property
    def fits(self) -> bool:
        """Whether all rows have as many cells as there are names."""
        return {*map(len, self.rows)} <= {self.layout.width}

    @property
    def certain(self) -> bool:
        """Whether the line can only be the line of the names."""
        names, values = self.layout.names, self.rows[0 if self.layout.units is None else 1 :]
        return (
            self.fits
            and len(names) > 1
            and all(names)
            and not any(map(_is_value, names))
            and bool(values)
            and any(map(_is_value, values[0]))
        )


def names_line(line: str) -> str:
    """Return a line of names without the mark of a comment and a blank before it."""
    return re.sub(r"^\s*(?:#|%|//)\s+", "", line)


def _separator_of(head: str, below: str) -> str:
    """Return the most frequent separator in a line of names, outside quotes.

    A line without separators is divided at blanks if the row below then has as many cells.
    """
    bare = re.sub(r'"[^"]*"', "", head)
    best = max(_SEPARATORS, key=bare.count)
    if best in bare:
        return best
    cells = [next((len(row) for _, row in rows_of([line], " ")), 0) for line in (head, below)]
    return " " if cells[0] == cells[1] > 1 else best


def _units_in(rows: Sequence[Sequence[str]], columns: int) -> list[str] | None:
    """Return the first row if it can only be a row of units.

    It has a common unit in a column of values, and no number, date or truth value.
    """
    if len(rows) < 2 or len(rows[0]) < columns or any(map(_is_value, rows[0])):
        return None
    units = [cell.strip().strip("[]()").strip() for cell in rows[0][:columns]]
    for unit, *cells in zip(units, *rows[1:], strict=False):
        if unit.lower() in _UNITS and any(map(_is_value, cells)):
            return units
    return None


def may_be_units(line: str, separator: str) -> bool:
    """Return whether a line below the names may be a row of units, which the next row shows."""
    cells = next((row for _, row in rows_of([line], separator)), [])
    units = {cell.strip().strip("[]()").strip().lower() for cell in cells}
    return not any(map(_is_value, cells)) and not units.isdisjoint(_UNITS)


def _is_value(cell: str) -> bool:
    """Return whether a cell is a number, a date or a truth value."""
    cell = cell.strip()
    return (
        cell.lower() in TRUTH
        or is_number(cell, ".")
        or is_number(cell, ",")
        or read_dates([cell]) is not None
    )
