"""Numbers and times in the cells of a text."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence

import numpy as np

from rtamt import InputError
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import RawTimes, read_dates

__all__ = ["DECIMAL_COMMA", "DECIMAL_POINT", "floats_in", "times_in"]

DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
DECIMAL_POINT = re.compile(r"[+-]?\d*\.\d+(?:[eE][+-]?\d+)?", re.ASCII)


def floats_in(
    cells: Sequence[str], decimal: str = ".", *, gaps: bool = False, nan: bool = False
) -> Floats | None:
    """The numbers in cells, nan for one that is empty; None if a cell is wrong.

    Args:
        cells: The texts.
        decimal: The decimal mark.
        gaps: Whether cells may be empty.
        nan: Whether ``nan`` counts as an empty cell.

    Example:
        >>> floats_in(["1,5", " 2"], ","), floats_in(["1.5"], ","), floats_in(["nan"])
        (array([1.5, 2. ]), None, None)
        >>> floats_in(["1", "", "nan"], gaps=True, nan=True), floats_in(["1", "nan"], gaps=True)
        (array([ 1., nan, nan]), None)
    """
    if decimal != ".":
        together = "".join(cells)
        if "." in together:
            return None
        cells = [cell.replace(decimal, ".") for cell in cells] if decimal in together else cells
    read = read_floats(cells)
    if read is None:
        if not gaps or all(map(str.strip, cells)):
            return None
        present = np.array([bool(cell.strip()) for cell in cells])
        some = floats_in([cell for cell in cells if cell.strip()], gaps=gaps, nan=nan)
        if some is None:
            return None
        numbers = np.full(len(cells), math.nan)
        numbers[present] = some
        return numbers
    numbers = np.array(read)
    return None if not (gaps and nan) and np.isnan(numbers).any() else numbers


def times_in(cells: Sequence[str], decimal: str, where: Callable[[int], str]) -> RawTimes:
    """The times in cells: integers, doubles, or dates of ISO 8601 as ``datetime64[ns]``.

    Args:
        cells: The texts.
        decimal: The decimal mark.
        where: Says where a cell stands, for messages.

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
    dates = read_dates(cells)
    if dates is not None:
        return dates
    expected = "a number"
    if read_dates(cells[:1]) is not None:
        expected = "a date like the first"
        wrong = next(i for i in range(len(cells)) if read_dates([cells[0], cells[i]]) is None)
    else:
        wrong = next(i for i, cell in enumerate(cells) if floats_in([cell], decimal) is None)
    raise InputError(f"{where(wrong)}: expected {expected}, got {cells[wrong]!r}")
