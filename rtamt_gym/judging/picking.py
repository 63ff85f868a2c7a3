"""What a panel does with a sample: which values its monitors take, and who else sees it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

from rtamt_gym.signals.signals import ElementRead, Read

__all__ = ["pick", "picked", "split", "together"]

_See = Callable[[Sequence[float]], None]
"""Sees the values of a sample."""


def split(reads: Sequence[Read]) -> tuple[list[tuple[int, Any]], list[tuple[int, Read]]]:
    """The places of what reads an element of the observation, and of all else."""
    numbered = list(enumerate(reads))
    elements = [(place, read.index) for place, read in numbered if isinstance(read, ElementRead)]
    return elements, [
        (place, read) for place, read in numbered if not isinstance(read, ElementRead)
    ]


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
