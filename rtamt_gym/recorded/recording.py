"""What every reader of recorded traces gives: named columns of numbers and text."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Floats", "Recording", "Rows", "Wanted"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Wanted:
    """The columns to read from a recording.

    Attributes:
        numbers: Names of the columns of numbers.
        texts: Names of the columns of text.
        gaps: Columns of numbers in which cells may be empty.
        empty: Advice for the error about an empty cell in any other column of numbers.
    """

    numbers: Sequence[str]
    texts: Sequence[str] = ()
    gaps: Collection[str] = ()
    empty: str = ""


@dataclass(frozen=True, slots=True)
class Rows:
    """The wanted columns of a recording.

    Attributes:
        numbers: Values of each column of numbers; nan where a cell is empty.
        texts: Values of each column of text.
        lines: Position of each row in the file, from 1.
        unit: What ``lines`` counts: ``"line"`` or ``"row"``.
        source: Name of the file, for messages.
    """

    numbers: Mapping[str, Floats]
    texts: Mapping[str, Sequence[str]]
    lines: Sequence[int]
    unit: str
    source: str

    def where(self, row: int) -> str:
        """File and line of a row, for messages."""
        return f"{self.source}, {self.unit} {self.lines[row]}"


class Recording(Protocol):
    """An open file with named columns.

    Attributes:
        source: Name of the file, for messages.
        names: Names of the columns in order; a name may occur twice.
    """

    source: str
    names: Sequence[str]

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns and leaves the others unread.

        Raises:
            InputError: If a row has too few or too many values, or if a cell of a column of
                numbers holds text or nan. The message says where.
        """
