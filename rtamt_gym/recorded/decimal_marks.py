"""The decimal mark of a file of text, from the evidence in the cells of its columns.

A cell such as ``1.250`` is 1.25 with a decimal point, and 1250 with a decimal comma and points
between groups of three digits. A cell such as ``0.125``, ``3,5``, ``1.000.000`` or ``1.000,5`` can
be read in one way only, and decides for all columns. A point without evidence is a decimal point,
unless the column looks like whole numbers in groups. Anything else is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from rtamt import InputError
from rtamt_gym.recorded.cells import NOT_KNOWN, floats_in, is_number

__all__ = ["ColumnMarks", "decimal_of", "groups_note", "thousands_note"]

_OTHER: Final = {".": ",", ",": "."}

_NAMES: Final = {".": "decimal point", ",": "decimal comma"}

_WHOLE: Final = re.compile(r"[+-]?(\d+)", re.ASCII)
_EXPONENT: Final = re.compile(r"[+-]?\d+[eE][+-]?\d+", re.ASCII)

_BY_OPTION: Final = "; --decimal . or --decimal , states the mark of the columns that are read"

_BYTE: Final = r"(?:25[0-5]|2[0-4]\d|1\d\d|[1-9]?\d)"
_ADDRESS: Final = re.compile(rf"{_BYTE}(?:\.{_BYTE}){{3}}", re.ASCII)
"""An address of the internet, which may look like a number with three groups."""


class Cell(NamedTuple):
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
        ({'.': Cell(row=1, text='0.5')}, False)
    """

    certain: dict[str, Cell] = field(default_factory=dict)
    open: dict[str, Cell] = field(default_factory=dict)
    text: bool = False
    ungrouped: Cell | None = None
    whole: int = 0
    padded: bool = False

    @property
    def evidence(self) -> Mapping[str, Cell]:
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
                self._add_marked(Cell(at, cell))
            elif self.ungrouped is None:
                self._add_whole(Cell(at, cell))

    def _add_unmarked(self, cells: Sequence[str], row: int, *, exponents: bool) -> None:
        if self.certain or self.ungrouped is not None:
            return
        wholes = map(_WHOLE.fullmatch, map(str.strip, {*cells}))  # most whole numbers come again
        self.whole = max(self.whole, max((len(w[1]) for w in wholes if w is not None), default=0))
        if self.whole > 4 or exponents:
            for at, cell in enumerate(cells, row):
                self._add_whole(Cell(at, cell.strip()))

    def _add_whole(self, cell: Cell) -> None:
        whole = _WHOLE.fullmatch(cell.text)
        digits = 0 if whole is None else len(whole[1])
        self.whole = max(self.whole, digits)
        if digits > 4 or _EXPONENT.fullmatch(cell.text):
            self.ungrouped = self.ungrouped or cell

    def _add_marked(self, cell: Cell) -> None:
        if cell.text.lower() in NOT_KNOWN:
            return
        marks = [mark for mark in _OTHER if is_number(cell.text, mark)]
        if not marks or _ADDRESS.fullmatch(cell.text):
            self.text = True
        elif len(marks) == 1:
            self.certain.setdefault(marks[0], cell)
        else:
            mark = "." if "." in cell.text else ","
            if len(cell.text) > len(self.open.get(mark, Cell(0, "")).text):
                self.open[mark] = cell
            self.padded |= mark == "." and cell.text.endswith("0")


def decimal_of(
    columns: Mapping[str, ColumnMarks],
    read: Collection[str],
    source: str,
    where: Callable[[int], str],
) -> str:
    """Return the decimal mark of a file, ``.`` or ``,``.

    Args:
        columns: The evidence in all columns of text.
        read: The names of the columns that are read as numbers or times.
        source: Name of the file, for messages.
        where: Returns file and place of a row, for messages.

    Raises:
        InputError: If there is evidence for both marks, or if a column that is read can be read in
            two ways.
    """
    own = {name: marks for name, marks in columns.items() if name in read}
    others = {name: marks for name, marks in columns.items() if name not in read}
    found = _evidence(own)
    if len(found) == 2:
        raise _two_marks(found, "", source, where)
    unclear = {name: marks for name, marks in own.items() if marks.is_open}
    if not unclear:
        return "," if "," in found else "."
    numeric = {name: marks for name, marks in others.items() if not marks.text}
    for name, cell in _evidence(numeric).items():
        found.setdefault(name, cell)
    decisive = next(iter(found), None)
    for name, cell in _evidence(others).items():  # texts raise doubts, and decide nothing
        found.setdefault(name, cell)
    if len(found) == 2:
        raise _two_marks(found, _BY_OPTION, source, where)
    if decisive is not None:
        return decisive
    commas = "," in found or any("," in marks.open for marks in columns.values())
    for name, marks in unclear.items():
        if commas or marks.like_thousands:
            cell = max(marks.open.values(), key=lambda cell: len(cell.text))
            raise _two_readings(name, cell, where)
    return "."


def _evidence(columns: Mapping[str, ColumnMarks]) -> dict[str, tuple[str, Cell]]:
    """Return the first cell with evidence for each mark, with the name of its column."""
    found: dict[str, tuple[str, Cell]] = {}
    for name, marks in columns.items():
        for mark, cell in marks.evidence.items():
            if mark not in found or cell.row < found[mark][1].row:
                found[mark] = name, cell
    return found


def _two_marks(
    found: Mapping[str, tuple[str, Cell]], hint: str, source: str, where: Callable[[int], str]
) -> InputError:
    both = [
        f"{cell.text!r} with a {_NAMES[mark]} ({where(cell.row).removeprefix(f'{source}, ')}, "
        f"column '{name}')"
        for mark, (name, cell) in sorted(found.items(), key=lambda item: item[1][1].row)
    ]
    return InputError(
        f"{source}: expected one decimal mark in the file, got {' and '.join(both)}{hint}"
    )


def _two_readings(name: str, cell: Cell, where: Callable[[int], str]) -> InputError:
    point, comma = (_read(cell.text, mark) for mark in _OTHER)
    return InputError(
        f"{where(cell.row)}, column '{name}': expected numbers that can be read in one way, got "
        f"{cell.text!r}; give --decimal . to read it as {point}, or --decimal , to read it as "
        f"{comma}"
    )


def _read(cell: str, decimal: str) -> str:
    read = floats_in([cell], decimal)
    return cell if read is None else f"{read[0]:.15g}"


def groups_note(cell: str, decimal: str) -> str:
    """Return the note on a cell whose digits stand in groups."""
    return f"marks between groups of three digits are left out: '{cell}' is {_read(cell, decimal)}"


def thousands_note(name: str, cell: str, decimal: str) -> str:
    """Return the note on a column whose numbers may be groups, which the option reads otherwise."""
    return (
        f"--decimal {decimal} reads '{cell}' as {_read(cell, decimal)}: every number of '{name}' "
        "has three digits after the mark, as numbers in groups of three digits have"
    )
