"""What every reader of recorded traces gives: named columns of numbers and text."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rtamt_gym.recorded.dates import DateOrder

__all__ = ["Floats", "Recording", "RowNumbers", "Rows", "TimePart", "Wanted"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TimePart:
    """A second column of times.

    Attributes:
        column: Its name.
        unit: The unit of the part of a second in it; empty if it holds dates, and the first column
            times of day.
    """

    column: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Wanted:
    """The columns to read from a recording.

    Attributes:
        numbers: Names of the columns of numbers.
        texts: Names of the columns of text.
        gaps: Columns of numbers in which cells may be empty.
        nan: Whether ``nan`` counts as an empty cell there.
        empty: Advice for the error about an empty cell in any other column of numbers.
        time: Name of the column of times, or None; it may be among the numbers too.
        ends: Whether there are rows at the first and the last time of the whole file, also where
            columns come at their own pace and these times are of columns that are not read.
        part: The second column of times, or None.
        date_order: The order of day and month in dates where it is not certain.
        cells: Names of the columns that are read as they are, so that no cell is an error.
        where: The text that each of some columns has in the rows to read; other rows are left out
            before anything else.
    """

    numbers: Sequence[str]
    texts: Sequence[str] = ()
    gaps: Collection[str] = ()
    nan: bool = False
    empty: str = ""
    time: str | None = None
    ends: bool = False
    part: TimePart | None = None
    date_order: DateOrder | None = None
    cells: Sequence[str] = ()
    where: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Rows:
    """The wanted columns of a recording.

    Attributes:
        numbers: Values of each column of numbers; nan where a cell is empty.
        texts: Values of each column of text.
        count: The number of rows.
        where: File and line of a row, for messages.
        source: Name of the file, for messages.
        times: The column of times as doubles, integers, ``datetime64[ns]`` or ``timedelta64[ns]``;
            None if there is none.
        notes: What was read otherwise than it is written, in sentences to print.
        unit: The unit of the times, where the format of the file says it; else empty.
        sparse: Whether columns come at their own pace, so that a cell is empty where none came.
        invalid: Of columns of numbers the cells that hold no number though there is a record, such
            as samples that a measurement marks as not valid: nan, where others are empty.
    """

    numbers: Mapping[str, Floats]
    texts: Mapping[str, Sequence[str]]
    count: int
    where: Callable[[int], str]
    source: str
    times: NDArray[Any] | None = None
    notes: Sequence[str] = ()
    unit: str = ""
    sparse: bool = False
    invalid: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    cells: Mapping[str, NDArray[Any]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RowNumbers:
    """Says where a row of a file without lines stands; another process can hand it over.

    Attributes:
        source: Name of the file.
        rows: The row of the file for each row that was read; None: all rows were read.

    Example:
        >>> RowNumbers("trace.npz")(0)
        'trace.npz, row 1'
    """

    source: str
    rows: NDArray[np.intp] | None = None

    def __call__(self, row: int) -> str:
        """The file and the number of the row, from 1."""
        return f"{self.source}, row {(row if self.rows is None else int(self.rows[row])) + 1}"


class Recording(Protocol):
    """An open file with named columns.

    Attributes:
        source: Name of the file, for messages.
        names: Names of the columns in order; a name may occur twice.
        dates: Names of the columns that hold dates.
    """

    source: str
    names: Sequence[str]
    dates: Sequence[str]

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted columns and leaves the others unread; it may be called again.

        Raises:
            InputError: If a row has too few or too many values, or if a cell of a column of
                numbers holds text or nan. The message says where.
        """
