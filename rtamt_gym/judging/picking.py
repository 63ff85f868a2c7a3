"""What a panel does with a sample: which values its monitors take, and who else sees it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter

__all__ = ["pick", "picked", "together"]

_See = Callable[[Sequence[float]], None]
"""Sees the values of a sample."""


def picked(
    indices: Sequence[int],
) -> tuple[int, Callable[[Sequence[float]], tuple[float, ...]] | None]:
    """The index, if it is one; else the function that takes the elements at all of them."""
    if len(indices) == 1:
        return indices[0], None
    return -1, itemgetter(*indices) if indices else lambda _: ()


def pick(columns: list[int]) -> slice | list[int]:
    """The columns that a monitor of many environments reads; neighbours as a slice, not copied."""
    if columns and columns == list(range(columns[0], columns[-1] + 1)):
        return slice(columns[0], columns[-1] + 1)
    return columns


def together(first: _See | None, second: _See | None) -> _See | None:
    """The function that calls both; the one that there is, or None without any."""
    if first is None or second is None:
        return first or second

    def see(values: Sequence[float]) -> None:
        first(values)
        second(values)

    return see
