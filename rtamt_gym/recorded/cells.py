"""Numbers and times in the cells of a text."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.recorded.dates import DateOrder, RawTimes, read_dates, times_of_texts
from rtamt_gym.recorded.recording import Floats, Wanted

__all__ = [
    "GROUP_MARKS",
    "NOT_KNOWN",
    "TRUTH",
    "NumberColumns",
    "cells_in",
    "floats_in",
    "grouped_in",
    "is_number",
    "times_in",
]

NOT_KNOWN: Final = frozenset(
    [
        *("nan", "+nan", "-nan", "na", "n/a", "#n/a", "#na", "<na>", "null", "none", "nil"),
        *("-", "--", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind"),
        *("nan(ind)", "-nan(ind)", "nan(snan)", "-nan(snan)"),
    ]
)
"""The words, in lower case, that tools write where they have no number."""

TRUTH: Final = {"true": 1.0, "false": 0.0}
"""The numbers of truth values, which are written in any case."""

GROUP_MARKS: Final = " '\u2019\u00a0\u2009\u202f"
"""The marks between groups of three digits that are no decimal marks anywhere."""

_OTHER: Final = {".": ",", ",": "."}

_PLAIN: Final = {
    mark: re.compile(
        rf"[+-]?(?:\d+(?:{re.escape(mark)}\d*)?|{re.escape(mark)}\d+)(?:[eE][+-]?\d+)?", re.ASCII
    )
    for mark in _OTHER
}

_GROUPED: Final = {
    mark: re.compile(
        rf"[+-]?[1-9]\d{{0,2}}(?P<group>[{re.escape(other + GROUP_MARKS)}])\d{{3}}"
        rf"(?:(?P=group)\d{{3}})*(?:{re.escape(mark)}\d*)?",
        re.ASCII,
    )
    for mark, other in _OTHER.items()
}


def is_number(cell: str, decimal: str) -> bool:
    """Return whether a cell without blanks around it is a number under a decimal mark.

    Example:
        >>> is_number("1.250", "."), is_number("1.250", ","), is_number("3,5", ".")
        (True, True, False)
    """
    return bool(_PLAIN[decimal].fullmatch(cell) or _GROUPED[decimal].fullmatch(cell))


def grouped_in(cells: Sequence[str], decimal: str) -> str | None:
    """Return the first cell whose digits stand in groups under a decimal mark, or None.

    Example:
        >>> grouped_in(["1", "12.000"], ","), grouped_in(["1", "12.000"], ".")
        ('12.000', None)
    """
    together = "".join(cells)
    if not any(mark in together for mark in _OTHER[decimal] + GROUP_MARKS):
        return None
    return next((c.strip() for c in cells if _GROUPED[decimal].fullmatch(c.strip())), None)


def floats_in(
    cells: Sequence[str], decimal: str = ".", *, gaps: bool = False, nan: bool = False
) -> Floats | None:
    """Return the numbers in cells, nan for an empty one; None if a cell is not a number.

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
    together = "".join(cells)
    read = None
    if decimal == ".":
        read = read_floats(cells)
    elif "." not in together:
        read = read_floats([cell.replace(",", ".") for cell in cells])
    if read is not None:
        numbers = np.array(read)
        return None if not (gaps and nan) and np.isnan(numbers).any() else numbers
    single = [_number(cell.strip(), decimal, gaps=gaps, nan=nan) for cell in cells]
    return None if None in single else np.array(single, np.float64)


def _number(cell: str, decimal: str, *, gaps: bool, nan: bool) -> float | None:
    if not cell or cell.lower() in NOT_KNOWN:
        return math.nan if gaps and (nan or not cell) else None
    if cell.lower() in TRUTH:
        return TRUTH[cell.lower()]
    grouped = _GROUPED[decimal].fullmatch(cell)
    if grouped is not None:
        cell = cell.replace(grouped["group"], "")
    if decimal == "," and "." in cell:
        return None
    read = read_floats([cell.replace(decimal, ".")])
    return None if read is None else read[0]


class NumberColumns:
    """The wanted columns of numbers, whose cells stay text until the decimal mark is known.

    Args:
        wanted: The wanted columns.
    """

    def __init__(self, wanted: Wanted) -> None:
        self.grouped = ""
        """The first cell whose digits stand in groups."""
        self._wanted = wanted
        self._held: list[tuple[int, dict[str, Sequence[str]]]] = []
        self._parts: dict[str, list[Floats]] = {name: [np.zeros(0)] for name in wanted.numbers}

    @property
    def arrays(self) -> dict[str, Floats]:
        """The numbers of each column."""
        return {name: np.concatenate(parts) for name, parts in self._parts.items()}

    def add(self, cells: Mapping[str, Sequence[str]], row: int) -> None:
        """Add the cells of further rows, the first of which has a number."""
        self._held.append((row, {name: cells[name] for name in self._wanted.numbers}))

    def convert(self, decimal: str) -> tuple[int, str, str, str] | None:
        """Convert all cells to numbers.

        Returns:
            The first wrong cell: its row, its column, its text, and advice; None without one.
        """
        for row, cells in self._held:
            for name, column in cells.items():
                part = self._floats(column, name, decimal)
                if part is None:
                    return self._wrong(row, cells, decimal)
                self._parts[name].append(part)
                self.look_for_groups(column, decimal)
        self._held.clear()
        return None

    def look_for_groups(self, cells: Sequence[str], decimal: str) -> None:
        """Keep the first cell whose digits stand in groups."""
        self.grouped = self.grouped or grouped_in(cells, decimal) or ""

    def _floats(self, cells: Sequence[str], name: str, decimal: str) -> Floats | None:
        gaps = name in self._wanted.gaps
        return floats_in(cells, decimal, gaps=gaps, nan=self._wanted.nan)

    def _wrong(
        self, row: int, cells: Mapping[str, Sequence[str]], decimal: str
    ) -> tuple[int, str, str, str]:
        at, name, cell = next(
            (at, name, cell)
            for at, values in enumerate(zip(*cells.values(), strict=True), row)
            for name, cell in zip(cells, values, strict=True)
            if self._floats([cell], name, decimal) is None
        )
        text = cell.strip().lower()
        return at, name, cell, self._wanted.empty if not text or text in NOT_KNOWN else ""


def cells_in(cells: Sequence[str], decimal: str) -> NDArray[Any]:
    """Return cells as they look: integers, doubles with nan in empty cells, or texts.

    Args:
        cells: The texts.
        decimal: The decimal mark.

    Example:
        >>> cells_in(["1", "2"], "."), cells_in(["1,5", ""], ","), cells_in(["a", "1"], ".")
        (array([1, 2]), array([1.5, nan]), array(['a', '1'], dtype='<U1'))
    """
    numbers = floats_in(cells, decimal, gaps=True, nan=True)
    if numbers is None:
        return np.array([cell.strip() for cell in cells] or [""])[: len(cells)]
    whole = numbers.astype(np.int64) if np.isfinite(numbers).all() else numbers
    return whole if (np.abs(numbers) < _EXACT).all() and (whole == numbers).all() else numbers


_EXACT: Final = 2.0**53
"""Whole numbers below are exact as doubles."""


def times_in(
    cells: Sequence[str],
    decimal: str,
    where: Callable[[int], str],
    days: Sequence[str] | None = None,
    order: DateOrder | None = None,
) -> RawTimes:
    """Return the times in cells: integers, doubles, dates as ``datetime64[ns]``, or times of day.

    Args:
        cells: The texts.
        decimal: The decimal mark.
        where: Returns the place of a cell, for messages.
        days: The dates of times of day; None: there are none.
        order: The order of day and month where it is not certain.

    Raises:
        InputError: If a cell is neither a number nor a date as the first one is.

    Example:
        >>> times_in(["1700000000000000001"], ".", str), times_in(["0,5"], ",", str)
        (array([1700000000000000001]), array([0.5]))
    """
    if set("".join(cells)) <= set("0123456789- ") and all(map(str.strip, cells)):
        try:
            return np.array(list(map(int, cells)), np.int64)
        except (ValueError, OverflowError):
            pass
    numbers = floats_in(cells, decimal)
    if numbers is not None:
        return numbers
    try:
        dates = times_of_texts(cells, days, order)
    except InputError as error:
        raise InputError(f"{where(0)}: {error}") from None
    if dates is not None:
        return dates
    expected = "a number"
    if read_dates(cells[:1]) is not None:
        expected = "a date like the first"
        wrong = next(i for i in range(len(cells)) if read_dates([cells[0], cells[i]]) is None)
    else:
        wrong = next(i for i, cell in enumerate(cells) if floats_in([cell], decimal) is None)
    raise InputError(f"{where(wrong)}: expected {expected}, got {cells[wrong]!r}")
