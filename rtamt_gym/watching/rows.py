"""Rows of a stream: blocks of good lines, bad lines, and the lines of blocks of bytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

from rtamt import InputError

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


class RowReader(Protocol):
    """Divides lines into cells."""

    names: list[str]
    """The names of the columns; empty until they are known."""

    def rows(self, lines: list[bytes], first: int) -> Iterator[RowBlock | BadLine]:
        """Yield the rows in lines; ``first`` is the number of the first line."""

    def choose(self, names: Sequence[str]) -> None:
        """Set the columns of all further blocks; until then they have all columns."""


class Lines:
    """Divides blocks of bytes of any size into lines."""

    def __init__(self, source: str) -> None:
        self._source, self._rest, self._scanned = source, bytearray(), 0

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
