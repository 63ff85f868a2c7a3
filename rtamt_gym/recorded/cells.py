"""Numbers and times in the texts of cells, from any splitter."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain, compress
from typing import Any, Final, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.recorded.dates import DateOrder, RawTimes, read_dates, times_of_texts
from rtamt_gym.recorded.recording import Floats

NOT_KNOWN: Final = frozenset(
    [
        *("nan", "+nan", "-nan", "na", "n/a", "#n/a", "#na", "<na>", "null", "none", "nil"),
        *("-", "--", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind"),
        *("nan(ind)", "-nan(ind)", "nan(snan)", "-nan(snan)"),
    ]
)
"""Words, in lower case, that tools write for a missing number."""

TRUTH: Final = {"true": 1.0, "false": 0.0}
"""The numbers of truth values, which are written in any case."""

OTHER_MARK: Final = {".": ",", ",": "."}
"""Both decimal marks, each with the other one."""

_GROUP_MARKS: Final = " '\u2019\u00a0\u2009\u202f"
"""Marks between groups of three digits that are not decimal marks anywhere."""

_PLAIN: Final = {
    mark: re.compile(
        rf"[+-]?(?:\d+(?:{re.escape(mark)}\d*)?|{re.escape(mark)}\d+)(?:[eE][+-]?\d+)?", re.ASCII
    )
    for mark in OTHER_MARK
}

_GROUPED: Final = {
    mark: re.compile(
        rf"[+-]?[1-9]\d{{0,2}}(?P<group>[{re.escape(other + _GROUP_MARKS)}])\d{{3}}"
        rf"(?:(?P=group)\d{{3}})*(?:{re.escape(mark)}\d*)?",
        re.ASCII,
    )
    for mark, other in OTHER_MARK.items()
}

_EXACT: Final = 2.0**53
"""Integers below are exact as doubles."""


class CellNumbers(NamedTuple):
    """The numbers of a column, and the first cell with digits in groups, or an empty text."""

    values: Floats
    grouped: str = ""


class TextCells(Sequence[str]):
    """The texts of a column, or of a block of its rows."""

    def __init__(self, texts: Sequence[str]) -> None:
        self._texts = texts

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[str]: ...
    def __getitem__(self, place: int | slice) -> str | Sequence[str]:
        """Return one or several texts."""
        return self._texts[place]

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self._texts)

    def __iter__(self) -> Iterator[str]:
        """Iterate over the texts."""
        return iter(self._texts)

    @cached_property
    def _together(self) -> str:
        return "".join(self._texts)

    def has(self, character: str) -> bool:
        """Return whether a character of ASCII occurs in a cell."""
        return character in self._together

    def selected(self, rows: NDArray[np.bool_]) -> TextCells:
        """Return the cells of some rows."""
        return TextCells([*compress(self, rows)])

    @staticmethod
    def joined(blocks: Sequence[TextCells]) -> TextCells:
        """Return the cells of all blocks."""
        return blocks[0] if len(blocks) == 1 else TextCells([*chain.from_iterable(blocks)])

    def numbers(self, decimal: str, *, gaps: bool = False, nan: bool = False) -> CellNumbers | None:
        """Return the numbers, as `floats_in` does; None if a cell is not a number."""
        return _numbers_in(self._texts, decimal, gaps=gaps, nan=nan)

    def integers(self) -> NDArray[np.int64] | None:
        """Return the cells as 64-bit integers; None if a cell is not an integer."""
        if set(self._together) <= set("0123456789- ") and all(map(str.strip, self)):
            try:
                return np.array(list(map(int, self)), np.int64)
            except (ValueError, OverflowError):
                pass
        return None

    def dates(self, order: DateOrder | None = None) -> RawTimes | None:
        """Return dates, times of day or durations; None if a cell is not such a time."""
        return times_of_texts(self._texts, None, order)


def is_number(cell: str, decimal: str) -> bool:
    """Return whether a cell without blanks around it is a number under a decimal mark.

    Example:
        >>> is_number("1.250", "."), is_number("1.250", ","), is_number("3,5", ".")
        (True, True, False)
    """
    return bool(_PLAIN[decimal].fullmatch(cell) or _GROUPED[decimal].fullmatch(cell))


def floats_in(
    cells: Sequence[str], decimal: str = ".", *, gaps: bool = False, nan: bool = False
) -> Floats | None:
    """Return the numbers in cells, nan for an empty cell; None if a cell is not a number.

    Args:
        cells: The texts. ``True`` and ``False`` are 1 and 0, in any case.
        decimal: The decimal mark. The other mark, a blank or an apostrophe may divide digits into
            groups of three.
        gaps: Whether cells may be empty.
        nan: Whether ``nan``, ``N/A``, ``null`` and the like count as empty cells.

    Example:
        >>> floats_in(["1,5", " 2"], ","), floats_in(["1.5"], ","), floats_in(["nan"])
        (array([1.5, 2. ]), None, None)
        >>> floats_in(["1", "", "N/A"], gaps=True, nan=True), floats_in(["1", "N/A"], gaps=True)
        (array([ 1., nan, nan]), None)
        >>> floats_in(["True", "1,250", "1 000.5"])
        array([1.0000e+00, 1.2500e+03, 1.0005e+03])
    """
    numbers = _numbers_in(cells, decimal, gaps=gaps, nan=nan)
    return None if numbers is None else numbers.values


def _numbers_in(cells: Sequence[str], decimal: str, *, gaps: bool, nan: bool) -> CellNumbers | None:
    read = None
    if decimal == ".":
        read = read_floats(cells)
    elif "." not in "".join(cells):
        read = read_floats([cell.replace(",", ".") for cell in cells])
    if read is not None:
        values = np.array(read, np.float64)
        return None if not (gaps and nan) and np.isnan(values).any() else CellNumbers(values)
    values, grouped = np.empty(len(cells)), ""
    for index, text in enumerate(cells):
        cell = text.strip()
        groups = _GROUPED[decimal].fullmatch(cell)
        if groups is not None:
            grouped = grouped or cell
            cell = cell.replace(groups["group"], "")
        number = _number(cell, decimal, gaps=gaps, nan=nan)
        if number is None:
            return None
        values[index] = number
    return CellNumbers(values, grouped)


def _number(cell: str, decimal: str, *, gaps: bool, nan: bool) -> float | None:
    word = cell.lower()
    if not cell or word in NOT_KNOWN:
        return math.nan if gaps and (nan or not cell) else None
    if word in TRUTH:
        return TRUTH[word]
    if decimal == "," and "." in cell:
        return None
    read = read_floats([cell.replace(decimal, ".")])
    return None if read is None else read[0]


def values_in(cells: TextCells, decimal: str) -> NDArray[Any]:
    """Return integers, doubles with nan in empty cells, or texts, as the cells look.

    Example:
        >>> [
        ...     values_in(TextCells(texts), ".").tolist()
        ...     for texts in (["1", "2"], ["1.5", ""], ["a"])
        ... ]
        [[1, 2], [1.5, nan], ['a']]
    """
    numbers = cells.numbers(decimal, gaps=True, nan=True)
    if numbers is None:
        return np.array([cell.strip() for cell in cells] or [""])[: len(cells)]
    values = numbers.values
    integers = values.astype(np.int64) if np.isfinite(values).all() else values
    return integers if (np.abs(values) < _EXACT).all() and (integers == values).all() else values


def times_in(
    cells: TextCells,
    decimal: str,
    where: Callable[[int], str],
    days: Iterable[str] | None = None,
    order: DateOrder | None = None,
) -> tuple[RawTimes, str]:
    """Return times, and the first cell with digits in groups, or an empty text.

    The times are integers, doubles, dates as ``datetime64[ns]``, or times of day.

    Args:
        cells: The texts.
        decimal: The decimal mark.
        where: Returns the place of a cell, for messages.
        days: The dates of times of day; None without a column of dates.
        order: The order of day and month in ambiguous dates.

    Example:
        >>> times_in(TextCells(["1700000000000000001"]), ".", str)
        (array([1700000000000000001]), '')
        >>> times_in(TextCells(["0,5"]), ",", str)
        (array([0.5]), '')
    """
    integers = cells.integers()
    if integers is not None:
        return integers, ""
    numbers = None if floats_in(cells[:1], decimal) is None else cells.numbers(decimal)
    if numbers is not None:
        return numbers.values, numbers.grouped
    try:
        dates = cells.dates(order) if days is None else times_of_texts(cells, [*days], order)
    except InputError as error:
        raise InputError(f"{where(0)}: {error}") from None
    if dates is not None:
        return dates, ""
    expected = "a number"
    if read_dates(cells[:1]) is not None:
        expected = "a date like the first"
        wrong = next(i for i in range(len(cells)) if read_dates([cells[0], cells[i]]) is None)
    else:
        wrong = next(i for i, cell in enumerate(cells) if floats_in([cell], decimal) is None)
    raise InputError(f"{where(wrong)}: expected {expected}, got {cells[wrong]!r}")
