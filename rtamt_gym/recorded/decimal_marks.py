"""The decimal mark of a file of text, from the evidence in the cells of its columns.

A cell such as ``1.250`` is 1.25 with a decimal point, and 1250 with a decimal comma and points
between groups of three digits. A cell such as ``0.125``, ``3,5``, ``1.000.000`` or ``1.000,5`` can
be read in one way only, and decides for all columns. A point without evidence is a decimal point,
unless the column looks like whole numbers in groups. Anything else is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from rtamt import InputError
from rtamt_gym.recorded.cells import NOT_KNOWN, NumberColumns, floats_in, is_number

__all__ = ["ColumnMarks", "FileMarks", "convert", "notes_on"]

_OTHER: Final = {".": ",", ",": "."}

_NAMES: Final = {".": "decimal point", ",": "decimal comma"}

_WHOLE: Final = re.compile(r"[+-]?(\d+)", re.ASCII)
_EXPONENT: Final = re.compile(r"[+-]?\d+[eE][+-]?\d+", re.ASCII)

_BY_OPTION: Final = "; --decimal . or --decimal , states the mark of the columns that are read"

_BYTE: Final = r"(?:25[0-5]|2[0-4]\d|1\d\d|[1-9]?\d)"
_ADDRESS: Final = re.compile(rf"{_BYTE}(?:\.{_BYTE}){{3}}", re.ASCII)
"""An address of the internet, which may look like a number with three groups."""


class MarkedCell(NamedTuple):
    """A cell, by the number of its row."""

    row: int
    text: str


@dataclass(slots=True)
class ColumnMarks:
    """The evidence for a decimal mark in one column.

    Attributes:
        certain: For each mark, the first cell that can be read with this decimal mark only.
        open: For each mark, the longest cell with it that both decimal marks explain.
        text: Whether a cell with a mark is not a number under either decimal mark.
        ungrouped: The first cell without a mark that a writer of groups would have divided.
        whole: The most digits of a cell without a mark.
        padded: Whether an open cell ends in 0, as no shortest decimal number does.

    Example:
        >>> marks = ColumnMarks()
        >>> marks.add(["1.250", "0.5"], 0)
        >>> marks.evidence, marks.is_open
        ({'.': MarkedCell(row=1, text='0.5')}, False)
    """

    certain: dict[str, MarkedCell] = field(default_factory=dict)
    open: dict[str, MarkedCell] = field(default_factory=dict)
    text: bool = False
    ungrouped: MarkedCell | None = None
    whole: int = 0
    padded: bool = False

    @property
    def evidence(self) -> Mapping[str, MarkedCell]:
        """The cell that decides for each mark; both if the mark changes within the column."""
        if self.ungrouped is None or self.certain or len(self.open) != 1:
            return self.certain
        return dict.fromkeys(self.open, self.ungrouped)

    @property
    def is_open(self) -> bool:
        """Whether the column has marks, and both decimal marks explain all of it."""
        return bool(self.open) and not self.evidence

    def all_groups(self, decimal: str) -> bool:
        """Return whether each number has three digits after the mark, as groups of digits have."""
        return self.is_open and decimal in self.open and not self.whole and len(self.open) == 1

    @property
    def like_thousands(self) -> bool:
        """Whether an open column looks like whole numbers in groups rather than decimal numbers.

        No number of three decimals has more digits, and whole numbers without a mark are written
        next to groups of three digits, not next to numbers with three decimals.
        """
        if "." not in self.open:
            return False
        leading = len(self.open["."].text.lstrip("+-").partition(".")[0])
        return leading > 1 or self.whole == 3 or (self.whole > 0 and self.padded)

    def add(self, cells: Sequence[str], row: int) -> None:
        """Add the evidence of further cells.

        Args:
            cells: The cells.
            row: The row of the first one.
        """
        together = "".join(cells)
        there = [mark for mark in _OTHER if mark in together]
        if not there:
            self._add_unmarked(cells, row, exponents="e" in together or "E" in together)
            return
        if self.certain.keys() >= {*there}:
            return
        for at, padded in enumerate(cells, row):
            cell = padded.strip()
            if "." in cell or "," in cell:
                self._add_marked(MarkedCell(at, cell))
            elif self.ungrouped is None:
                self._add_whole(MarkedCell(at, cell))

    def _add_unmarked(self, cells: Sequence[str], row: int, *, exponents: bool) -> None:
        if self.certain or self.ungrouped is not None:
            return
        wholes = map(_WHOLE.fullmatch, map(str.strip, {*cells}))  # most whole numbers come again
        self.whole = max(self.whole, max((len(w[1]) for w in wholes if w is not None), default=0))
        if self.whole > 4 or exponents:
            for at, cell in enumerate(cells, row):
                self._add_whole(MarkedCell(at, cell.strip()))

    def _add_whole(self, cell: MarkedCell) -> None:
        whole = _WHOLE.fullmatch(cell.text)
        digits = 0 if whole is None else len(whole[1])
        self.whole = max(self.whole, digits)
        if digits > 4 or _EXPONENT.fullmatch(cell.text):
            self.ungrouped = self.ungrouped or cell

    def _add_marked(self, cell: MarkedCell) -> None:
        if cell.text.lower() in NOT_KNOWN:
            return
        marks = [mark for mark in _OTHER if is_number(cell.text, mark)]
        if not marks or _ADDRESS.fullmatch(cell.text):
            self.text = True
        elif len(marks) == 1:
            self.certain.setdefault(marks[0], cell)
        else:
            mark = "." if "." in cell.text else ","
            if len(cell.text) > len(self.open.get(mark, MarkedCell(0, "")).text):
                self.open[mark] = cell
            self.padded |= mark == "." and cell.text.endswith("0")


class FileMarks:
    """The decimal mark of a file, from the evidence in its columns of text.

    Args:
        names: The columns of text.
        read: The columns that are read as numbers or times.
        option: The decimal mark that is stated; None to recognise it.
        source: Name of the file, for messages.
        where: Returns file and place of a row, for messages.
    """

    def __init__(
        self,
        names: Iterable[str],
        read: Collection[str],
        option: str | None,
        source: str,
        where: Callable[[int], str],
    ) -> None:
        self._columns = {name: ColumnMarks() for name in (names if option is None else read)}
        self._read, self.option = read, option
        self._source, self._where = source, where

    def add(self, cells: Mapping[str, Sequence[str]], row: int) -> None:
        """Add the cells of further rows, the first of which has a number."""
        for name, marks in self._columns.items():
            marks.add(cells[name], row)

    @property
    def known(self) -> bool:
        """Whether the option, or a column that is read, decides whatever follows."""
        return self.option is not None or any(self._columns[name].evidence for name in self._read)

    def decimal(self) -> str:
        """Return the decimal mark, ``.`` or ``,``.

        Raises:
            InputError: If there is evidence for both marks, or if a column that is read can be
                read in two ways.
        """
        if self.option is not None:
            return self.option
        own = {name: self._columns[name] for name in self._read}
        found = _evidence(own)
        if len(found) == 2:
            raise _two_marks(found, "", self._source, self._where)
        unclear = {name: marks for name, marks in own.items() if marks.is_open}
        if not unclear:
            return "," if "," in found else "."
        numeric = {name: marks for name, marks in self._columns.items() if not marks.text}
        found = {**_evidence(numeric), **found}
        decisive = next(iter(found), None)
        found = {**_evidence(self._columns), **found}  # texts raise doubts, and decide nothing
        if len(found) == 2:
            raise _two_marks(found, _BY_OPTION, self._source, self._where)
        if decisive is not None:
            return decisive
        commas = "," in found or any("," in marks.open for marks in self._columns.values())
        for name, marks in unclear.items():
            if commas or marks.like_thousands:
                longest = max(marks.open.values(), key=lambda cell: len(cell.text))
                raise _two_readings(name, longest, self._where)
        return "."

    def notes(self, decimal: str, grouped: str) -> list[str]:
        """Return the notes on how numbers were read.

        Args:
            decimal: The decimal mark.
            grouped: A cell that was read and whose digits stand in groups; empty without one.
        """
        found = {
            name: marks.open[decimal].text
            for name, marks in self._columns.items()
            if self.option is not None and marks.all_groups(decimal)
        }
        return notes_on(self.option, decimal, grouped, found)


def convert(
    numbers: NumberColumns,
    marks: FileMarks,
    where: Callable[[int], str],
    plain: Callable[[str], str] = str,
) -> str:
    """Convert cells to numbers, and return the decimal mark of the file.

    Args:
        numbers: The cells that were not converted before.
        marks: The evidence up to these cells.
        where: Returns file and place of a row of these cells.
        plain: Returns a cell as it is shown.

    Raises:
        InputError: As `FileMarks.decimal`, or if a cell is not a number.
    """
    decimal = marks.decimal()
    wrong = numbers.convert(decimal)
    if wrong is not None:
        row, name, cell, advice = wrong
        if marks.option is not None and any(is_number(cell.strip(), mark) for mark in _OTHER):
            advice = "; leave out --decimal to recognise the decimal mark from the whole file"
        raise InputError(
            f"{where(row)}, column '{name}': expected a number, got {plain(cell)!r}{advice}"
        )
    return decimal


def _evidence(columns: Mapping[str, ColumnMarks]) -> dict[str, tuple[str, MarkedCell]]:
    """Return the first cell with evidence for each mark, with the name of its column."""
    found: dict[str, tuple[str, MarkedCell]] = {}
    for name, marks in columns.items():
        for mark, cell in marks.evidence.items():
            if mark not in found or cell.row < found[mark][1].row:
                found[mark] = name, cell
    return found


def _two_marks(
    found: Mapping[str, tuple[str, MarkedCell]], hint: str, source: str, where: Callable[[int], str]
) -> InputError:
    both = [
        f"{cell.text!r} with a {_NAMES[mark]} ({where(cell.row).removeprefix(f'{source}, ')}, "
        f"column '{name}')"
        for mark, (name, cell) in sorted(found.items(), key=lambda item: item[1][1].row)
    ]
    return InputError(
        f"{source}: expected one decimal mark in the file, got {' and '.join(both)}{hint}"
    )


def _two_readings(name: str, cell: MarkedCell, where: Callable[[int], str]) -> InputError:
    point, comma = (_read(cell.text, mark) for mark in _OTHER)
    return InputError(
        f"{where(cell.row)}, column '{name}': expected numbers that can be read in one way, got "
        f"{cell.text!r}; give --decimal . to read it as {point}, or --decimal , to read it as "
        f"{comma}"
    )


def _read(cell: str, decimal: str) -> str:
    read = floats_in([cell], decimal)
    return cell if read is None else f"{read[0]:.15g}"


def notes_on(
    option: str | None, decimal: str, grouped: str, thousands: Mapping[str, str]
) -> list[str]:
    """Return the notes on how numbers were read.

    Args:
        option: The decimal mark that is stated, if it is.
        decimal: The decimal mark.
        grouped: A cell whose digits stand in groups; empty without one.
        thousands: A cell of each column whose numbers all have three digits after the stated mark.
    """
    notes = ["numbers are read with a decimal comma"] if option is None and decimal == "," else []
    if grouped:
        read = _read(grouped, decimal)
        notes.append(f"marks between groups of three digits are left out: '{grouped}' is {read}")
    return notes + [
        f"--decimal {decimal} reads '{cell}' as {_read(cell, decimal)}: every number of '{name}' "
        "has three digits after the mark, as numbers in groups of three digits have"
        for name, cell in thousands.items()
    ]
