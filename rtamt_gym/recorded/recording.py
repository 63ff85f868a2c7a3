"""The result of readers of recorded traces: named columns of the rows that ``--where`` selects."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import nearest, shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.columns import DateOrder
from rtamt_gym.tables import counted

Floats = NDArray[np.float64]

RawTimes = NDArray[Any]
"""Times as a file holds them: doubles, integers, dates (``datetime64[ns]``) or durations."""


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
        nan: Whether ``nan`` counts as an empty cell in the columns of ``gaps``.
        empty: Advice for the error about an empty cell in any other column of numbers.
        time: Name of the column of times, or None; it may be among the numbers too.
        ends: Whether the rows include the first and the last time of the whole file, even if only
            columns that are not read have these times.
        part: The second column of times, or None.
        date_order: The order of day and month in ambiguous dates.
        cells: Names of the columns to read without conversion, so that no cell is an error.
        where: The required text of some columns; rows with another text are omitted first.
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

    @property
    def names(self) -> list[str]:
        """The names of all of these columns, each once."""
        times = [] if self.time is None else [self.time]
        times += [] if self.part is None else [self.part.column]
        return [*dict.fromkeys([*self.numbers, *self.texts, *times, *self.where, *self.cells])]


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
            None without a column of times.
        notes: Sentences to print about changes that the reader made.
        unit: The unit of the times if the format states it; otherwise, empty.
        sparse: Whether columns have different times, so that a cell is empty at the times of other
            columns.
        invalid: The cells of columns of numbers that have a record without a number, such as
            samples that a measurement marks as invalid. Their value is nan.
        cells: The columns that are read without conversion.
        step: The distance of samples in seconds if the format states it; otherwise, None. Times
            that are farther apart are a gap.
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
    step: Fraction | None = None


@dataclass(frozen=True, slots=True)
class RowNumbers:
    """A function from a row to its place in a file without lines; it can be pickled.

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
        """Return the file and the number of the row, from 1."""
        return f"{self.source}, row {(row if self.rows is None else int(self.rows[row])) + 1}"


def places_of(where: Callable[[int], str], rows: NDArray[np.intp]) -> Callable[[int], str]:
    """Return the place of each of some rows; a function that can be pickled stays one."""
    if isinstance(where, RowNumbers):
        return RowNumbers(where.source, rows if where.rows is None else where.rows[rows])
    return lambda row: where(int(rows[row]))


class Recording:
    """An open file with named columns.

    Attributes:
        source: Name of the file, for messages.
        names: Names of the columns in order; a name may occur twice.
        dates: Names of the columns that hold dates.
        days: Names of the columns of dates without a time of day.
        texts: Names of the columns of texts.
        blank: Names of the columns without a value in the first rows.
        above: The numbers in the lines above the names, by the text before them.
    """

    source: str
    names: Sequence[str]
    dates: Sequence[str] = ()
    days: Collection[str] = ()
    texts: Collection[str] = ()
    blank: Collection[str] = ()
    above: Mapping[str, float] = MappingProxyType({})

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns; it may be called again."""
        raise NotImplementedError

    def lines_above(self, name: str) -> int | None:
        """Return the number of lines above the first line that has a name as a cell, or None."""
        del name
        return None

    def usual_step(self, wanted: Wanted) -> float | None:
        """Return the usual distance of times, to detect a gap between two rows; None if unknown.

        Args:
            wanted: The columns of times.

        Returns:
            The distance in the unit of the column, in nanoseconds for dates.
        """
        del wanted
        return None

    def selected(self, where: Mapping[str, str]) -> NDArray[np.bool_]:
        """Return whether each row of the trace has these texts, like the rows of ``--where``."""
        texts = {n: cell_texts(c) for n, c in self.read(Wanted((), cells=[*where])).cells.items()}
        return RowFilter(where, self.names, self.source).mask(texts)

    def last_texts(self) -> Mapping[str, str]:
        """Return the cells of the last row of a text by their columns; empty if unknown."""
        return {}


class RowFilter:
    """A filter for rows with the texts that ``--where`` states."""

    def __init__(self, where: Mapping[str, str], names: Sequence[str], source: str) -> None:
        for name in where:
            if name not in names:
                raise InputError(
                    f"{source}: no column '{name}', which --where names; the columns are "
                    f"{listed(names, name)}{nearest(name, names)}"
                )
        self._where, self._source = where, source
        self._values: dict[str, dict[str, None]] = {name: {} for name in where}
        self._kept = 0

    def mask(self, cells: Mapping[str, Sequence[str]]) -> NDArray[np.bool_]:
        """Return whether each row is selected, and count the selected rows."""
        columns = {name: [text.strip() for text in cells[name]] for name in self._where}
        selected = np.ones(len(next(iter(columns.values()))), bool)
        for name, texts in columns.items():
            self._values[name] |= dict.fromkeys(texts)
            selected &= np.fromiter((text == self._where[name] for text in texts), bool, len(texts))
        self._kept += int(selected.sum())
        return selected

    def check(self) -> None:
        """Check that a row was selected, and that no other text may mean the same object."""
        for name, value in self._where.items():
            check_one_writing(self._source, name, self._values[name], value)
        if self._kept:
            return
        for name, value in self._where.items():
            values = [shown(text) for text in self._values[name]]
            if values and value not in self._values[name]:
                raise InputError(
                    f"{self._source}: no row with {value!r} in the column '{name}', which --where "
                    f"names; its values are {listed(values, value)}{nearest(value, values)}"
                )
        rows = " and ".join(f"{name}={value}" for name, value in self._where.items())
        raise InputError(f"{self._source}: no row with {rows}, which --where selects")


def check_one_writing(
    source: str, column: str, texts: Collection[str], value: str | None = None
) -> None:
    """Check that no whole number, or one value, is written in two ways, such as 7 and 7.0."""
    for text in texts:
        whole = _WHOLE.fullmatch(text)
        if whole is None or whole["number"] not in texts:
            continue
        if value is None or value in (text, whole["number"]):
            raise InputError(
                f"{source}: the column '{column}' has '{whole['number']}' and '{text}', which may "
                "be one object or two. Write the number in one way."
            )


def whole_number(text: str) -> str:
    """Return a whole number without a point, and other texts as they are."""
    whole = _WHOLE.fullmatch(text)
    return text if whole is None else whole["number"]


_WHOLE: Final = re.compile(r"(?P<number>-?\d+)\.0*")


def cell_texts(values: NDArray[Any]) -> list[str]:
    """Return the texts of cells that are not texts in the file: 1 and 1.0 are ``1``."""
    return [_text(value) for value in values.tolist()]


def _text(value: object) -> str:
    if value is None or value != value:  # noqa: PLR0124 - nan
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value)


def selection_notes(count: int, where: Mapping[str, str]) -> list[str]:
    """Return a note about the rows that were selected; an empty list if all were read."""
    if not where:
        return []
    texts = " and ".join(f"{name}={value}" for name, value in where.items())
    return [f"--where {texts} selects {counted(count, 'row')}"]
