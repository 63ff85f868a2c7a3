"""Numbers in texts, and the decimal mark of a file.

A cell such as ``1.250`` is 1.25 with a decimal point, and 1250 with a decimal comma and points
between groups of three digits. A cell such as ``0.125``, ``3,5``, ``1.000.000`` or ``1.000,5`` has
one reading only, and decides for all columns. A point without evidence is a decimal point, unless
the column looks like integers in groups. Any other file is an error.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.recorded.cells import (
    NOT_KNOWN,
    OTHER_MARK,
    TextCells,
    floats_in,
    is_number,
    times_in,
)
from rtamt_gym.recorded.recording import Floats, RawTimes, RowNumbers, Wanted

_NAMES: Final = {".": "decimal point", ",": "decimal comma"}

_INTEGER: Final = re.compile(r"[+-]?(\d+)", re.ASCII)
_EXPONENT: Final = re.compile(r"[+-]?\d+[eE][+-]?\d+", re.ASCII)

_BY_OPTION: Final = "; --decimal . or --decimal , states the mark of the columns that are read"

_BYTE: Final = r"(?:25[0-5]|2[0-4]\d|1\d\d|[1-9]?\d)"
_ADDRESS: Final = re.compile(rf"{_BYTE}(?:\.{_BYTE}){{3}}", re.ASCII)
"""An internet address, which may look like a number with three groups."""


_FEW: Final = 128
"""Cells after which a column that is read is searched no further once it has shown its mark."""

_TWO_POINTS: Final = re.compile(r"\.[^\n]*\.")


class MarkedCell(NamedTuple):
    """A cell, by the number of its row."""

    row: int
    text: str


@dataclass(slots=True)
class ColumnMarks:
    """The evidence for a decimal mark in one column.

    Attributes:
        certain: For each mark, the first cell that is a number with this decimal mark only.
        open: For each mark, the longest cell with it that is a number with both decimal marks.
        text: Whether a cell with a mark is not a number under either decimal mark.
        ungrouped: The first cell without a mark that a writer of groups would have divided.
        digits: The maximum number of digits in a cell without a mark.
        padded: Whether an open cell ends in 0, as no shortest decimal number does.
    """

    certain: dict[str, MarkedCell] = field(default_factory=dict)
    open: dict[str, MarkedCell] = field(default_factory=dict)
    text: bool = False
    ungrouped: MarkedCell | None = None
    digits: int = 0
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

    def grouped(self, decimal: str) -> str:
        """Return the longest cell if all numbers have three digits after the mark, or ``""``."""
        all_groups = self.is_open and decimal in self.open and not self.digits
        return self.open[decimal].text if all_groups and len(self.open) == 1 else ""

    @property
    def like_thousands(self) -> bool:
        """Whether an open column looks like integers in groups rather than decimal numbers.

        No number of three decimals has more digits, and integers without a mark are written next
        to groups of three digits, not next to numbers with three decimals.
        """
        if "." not in self.open:
            return False
        leading = len(self.open["."].text.lstrip("+-").partition(".")[0])
        return leading > 1 or self.digits == 3 or (self.digits > 0 and self.padded)

    def add(self, cells: TextCells, row: int, *, brief: bool) -> None:
        """Add the evidence of further cells.

        A brief search stops when each mark that occurs is certain, and misses cells that are not
        numbers.
        """
        present = {mark for mark in OTHER_MARK if cells.has(mark)}
        if not present:
            self._add_unmarked(cells, row)
            return
        step = _FEW if brief else len(cells)
        for begin in range(0, len(cells), step):
            if self.certain.keys() >= present:
                return
            part = cells[begin : begin + step]
            # With points only, a cell with two of them may decide for the comma; others may not.
            settled = brief and present == {"."} and not _TWO_POINTS.search("\n".join(part))
            for index, padded in enumerate(part, row + begin):
                if settled and self.certain:
                    break
                cell = padded.strip()
                if "." in cell or "," in cell:
                    self._add_marked(MarkedCell(index, cell))
                elif self.ungrouped is None:
                    self._add_integer(MarkedCell(index, cell))

    def _add_unmarked(self, cells: TextCells, row: int) -> None:
        if self.certain or self.ungrouped is not None:
            return
        matches = map(_INTEGER.fullmatch, map(str.strip, {*cells}))  # most integers repeat
        self.digits = max(
            self.digits, max((len(m[1]) for m in matches if m is not None), default=0)
        )
        if self.digits > 4 or cells.has("e") or cells.has("E"):
            for index, cell in enumerate(cells, row):
                self._add_integer(MarkedCell(index, cell.strip()))

    def _add_integer(self, cell: MarkedCell) -> None:
        match = _INTEGER.fullmatch(cell.text)
        digits = 0 if match is None else len(match[1])
        self.digits = max(self.digits, digits)
        if digits > 4 or _EXPONENT.fullmatch(cell.text):
            self.ungrouped = self.ungrouped or cell

    def _add_marked(self, cell: MarkedCell) -> None:
        if cell.text.lower() in NOT_KNOWN:
            return
        marks = [mark for mark in OTHER_MARK if is_number(cell.text, mark)]
        if not marks or _ADDRESS.fullmatch(cell.text):
            self.text = True
        elif len(marks) == 1:
            self.certain.setdefault(marks[0], cell)
        else:
            mark = "." if "." in cell.text else ","
            if len(cell.text) > len(self.open.get(mark, MarkedCell(0, "")).text):
                self.open[mark] = cell
            self.padded |= mark == "." and cell.text.endswith("0")


class TextNumbers:
    """The numbers and times in columns of text, read in blocks of rows.

    Cells stay texts until a cell decides the decimal mark, or the last block is read.
    """

    def __init__(
        self,
        names: Iterable[str],
        wanted: Wanted,
        option: str | None,
        source: str,
        where: Callable[[int], str],
        where_any: Callable[[int], str],
        plain: Callable[[str], str] = str,
    ) -> None:
        self._wanted, self._option, self._source = wanted, option, source
        self._where, self._where_any, self._plain = where, where_any, plain
        time = [] if wanted.time is None else [wanted.time]
        self._read = dict.fromkeys([*wanted.numbers, *time])
        self._searched: Collection[str] = self._read
        self._marks = {name: ColumnMarks() for name in (*names, *self._read)}
        self._pending: list[Mapping[str, TextCells]] = []
        self._rows = self._converted = 0
        self._numbers: dict[str, list[Floats]] = {name: [] for name in wanted.numbers}
        self._grouped = ""
        self.decimal = "." if option is None else option
        """The decimal mark, once `finish` has decided it."""

    def add(
        self,
        cells: Mapping[str, TextCells],
        selected: NDArray[np.bool_] | None = None,
        *,
        complete: bool = False,
    ) -> None:
        """Add the cells of further rows; complete cells are all rows of the file."""
        time = self._wanted.time
        if not self._rows and time is not None and not _holds_numbers(cells[time][:1]):
            self._searched = [name for name in self._read if name != time]  # it holds dates
        self._look(self._searched, cells, complete=complete)
        if self._option is None:
            others = self._marks.keys() - self._read.keys()
            self._look(others, cells, complete=complete)
        self._rows += len(next(iter(cells.values()), ()))
        own = {name: cells[name] for name in self._wanted.numbers}
        if selected is not None:
            own = {name: column.selected(selected) for name, column in own.items()}
        self._pending.append(own)
        if self._option is not None or any(self._marks[name].evidence for name in self._read):
            self._convert(self._decide(None))

    def _look(
        self, names: Collection[str], cells: Mapping[str, TextCells], *, complete: bool
    ) -> None:
        """Add the evidence of some columns."""
        for name in names:
            column = cells.get(name)
            if column is None or (complete and not (column.has(".") or column.has(","))):
                continue
            self._marks[name].add(column, self._rows, brief=name in self._read)

    def finish(
        self, others: Callable[[], Mapping[str, TextCells]] | None = None
    ) -> Mapping[str, Floats]:
        """Return the numbers of each column, after the last block."""
        self.decimal = self._decide(others)
        self._convert(self.decimal)
        return {
            name: parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0), *parts])
            for name, parts in self._numbers.items()
        }

    def times(self, cells: TextCells, days: TextCells | None = None) -> RawTimes:
        """Return the times in the cells of the column of times that are read."""

        def place(row: int) -> str:
            return f"{self._where(row)}, column '{self._wanted.time}'"

        times, grouped = times_in(cells, self.decimal, place, days, self._wanted.date_order)
        self._grouped = self._grouped or grouped
        return times

    def _convert(self, decimal: str) -> None:
        for cells in self._pending:
            for name, column in cells.items():
                numbers = column.numbers(decimal, **self._gaps(name))
                if numbers is None:
                    raise self._wrong_cell(cells, decimal)
                self._numbers[name].append(numbers.values)
                self._grouped = self._grouped or numbers.grouped
            self._converted += len(next(iter(cells.values()), ()))
        self._pending.clear()

    def _gaps(self, name: str) -> dict[str, bool]:
        return {"gaps": name in self._wanted.gaps, "nan": self._wanted.nan}

    def _wrong_cell(self, cells: Mapping[str, TextCells], decimal: str) -> InputError:
        row, name, cell = next(
            (row, name, cell)
            for row, texts in enumerate(zip(*cells.values(), strict=True), self._converted)
            for name, cell in zip(cells, texts, strict=True)
            if floats_in([cell], decimal, **self._gaps(name)) is None
        )
        word = cell.strip().lower()
        advice = self._wanted.empty if not word or word in NOT_KNOWN else ""
        if word in {"on", "off", "yes", "no", "open", "closed"}:
            advice = "; write 1 and 0, or true and false"
        if self._option is not None and any(is_number(cell.strip(), mark) for mark in OTHER_MARK):
            advice = "; leave out --decimal to recognise the decimal mark from the whole file"
        return InputError(
            f"{self._where(row)}, column '{name}': expected a number, got "
            f"{self._plain(cell)!r}{advice}"
        )

    def _decide(self, others: Callable[[], Mapping[str, TextCells]] | None) -> str:
        """Return the decimal mark."""
        if self._option is not None:
            return self._option
        own = {name: self._marks[name] for name in self._read}
        evidence = _evidence(own)
        if len(evidence) == 2:
            raise self._two_marks(evidence, "")
        unclear = {name: marks for name, marks in own.items() if marks.is_open}
        if not unclear:
            return next(iter(evidence), ".")
        if others is not None:
            self._rows = 0
            cells = others()
            self._look(cells, cells, complete=True)
        numeric = {name: marks for name, marks in self._marks.items() if not marks.text}
        evidence = {**_evidence(numeric), **evidence}
        decisive = next(iter(evidence), None)
        evidence = {**_evidence(self._marks), **evidence}  # texts do not decide the mark
        if len(evidence) == 2:
            raise self._two_marks(evidence, _BY_OPTION)
        if decisive is not None:
            return decisive
        commas = "," in evidence or any("," in marks.open for marks in self._marks.values())
        for name, marks in unclear.items():
            if commas or marks.like_thousands:
                longest = max(marks.open.values(), key=lambda cell: len(cell.text))
                raise self._two_readings(name, longest)
        return "."

    def _two_marks(self, evidence: Mapping[str, tuple[str, MarkedCell]], hint: str) -> InputError:
        both = [
            f"{cell.text!r} with a {_NAMES[mark]} "
            f"({self._where_any(cell.row).removeprefix(f'{self._source}, ')}, column '{name}')"
            for mark, (name, cell) in sorted(evidence.items(), key=lambda item: item[1][1].row)
        ]
        return InputError(
            f"{self._source}: expected one decimal mark in the file, got {' and '.join(both)}{hint}"
        )

    def _two_readings(self, name: str, cell: MarkedCell) -> InputError:
        point, comma = (_read(cell.text, mark) for mark in OTHER_MARK)
        return InputError(
            f"{self._where_any(cell.row)}, column '{name}': expected numbers that can be read in "
            f"one way, got {cell.text!r}; give --decimal . to read it as {point}, or --decimal , "
            f"to read it as {comma}"
        )

    @property
    def notes(self) -> list[str]:
        """Notes on how numbers were read."""
        decimal, notes = self.decimal, []
        if self._option is None and decimal == ",":
            notes.append(COMMA_NOTE)
        if self._grouped:
            notes.append(grouped_note(self._grouped, decimal))
        groups = {name: self._marks[name].grouped(decimal) for name in self._read}
        return notes + [
            stated_mark_note(name, cell, decimal)
            for name, cell in groups.items()
            if cell and self._option is not None
        ]


COMMA_NOTE: Final = "numbers are read with a decimal comma"


def grouped_note(cell: str, decimal: str) -> str:
    """Return the note on a cell with digits in groups of three."""
    return f"marks between groups of three digits are left out: '{cell}' is {_read(cell, decimal)}"


def stated_mark_note(name: str, cell: str, decimal: str) -> str:
    """Return the note that a stated mark may as well stand between groups of three digits."""
    return (
        f"--decimal {decimal} reads '{cell}' as {_read(cell, decimal)}: every number of "
        f"'{name}' has three digits after the mark, as numbers in groups of three digits have"
    )


def _evidence(columns: Mapping[str, ColumnMarks]) -> dict[str, tuple[str, MarkedCell]]:
    """Return the first cell with evidence for each mark, with the name of its column."""
    evidence: dict[str, tuple[str, MarkedCell]] = {}
    for name, marks in columns.items():
        for mark, cell in marks.evidence.items():
            if mark not in evidence or cell.row < evidence[mark][1].row:
                evidence[mark] = name, cell
    return evidence


def _read(cell: str, decimal: str) -> str:
    read = floats_in([cell], decimal)
    return cell if read is None else f"{read[0]:.15g}"


def numbers_in_texts(
    texts: Mapping[str, Sequence[str]],
    wanted: Wanted,
    option: str | None,
    source: str,
    where: Callable[[int], str],
    selected: NDArray[np.bool_] | None = None,
) -> tuple[Mapping[str, Floats], RawTimes | None, list[str]]:
    """Return the numbers and times in columns of text of a table of another format, and notes."""
    cells = {name: TextCells(column) for name, column in texts.items()}
    numbers = [name for name in wanted.numbers if name in texts]
    time = wanted.time
    if time is not None and not (time in texts and _holds_numbers(texts[time])):
        time = None
    if not numbers and time is None:
        return {}, None, []
    wanted = Wanted(numbers, gaps=wanted.gaps, nan=wanted.nan, empty=wanted.empty, time=time)
    step = TextNumbers(texts, wanted, option, source, where, RowNumbers(source))
    step.add(cells, selected, complete=True)
    values = step.finish()
    times = None
    if time is not None:
        column = cells[time]
        times = step.times(column if selected is None else column.selected(selected))
    return values, times, step.notes


def _holds_numbers(texts: Sequence[str]) -> bool:
    """Return whether the first text that is not empty is a number under some decimal mark."""
    first = next(filter(None, map(str.strip, texts)), "")
    return any(is_number(first, mark) for mark in OTHER_MARK)
