"""Long series for a page: which samples are shown, and numbers of six digits."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["FEWEST", "MOST", "ROOM", "evenly", "points_of", "rounded", "shown", "six", "spaced"]

Floats = NDArray[np.float64]

T = TypeVar("T")

ROOM: Final = 60_000
"""The numbers of all episodes of a report together, about 500 kB as text."""

MOST: Final = 600
"""The most samples that are shown of an episode."""

FEWEST: Final = 60
"""The samples that are shown of an episode at least, if it has so many."""


def points_of(room: int, episodes: int, series: int) -> int:
    """How many samples of an episode are shown: an equal share of the room for numbers.

    Example:
        >>> points_of(60_000, 10, 8), points_of(60_000, 2, 8), points_of(60_000, 100, 40)
        (600, 600, 60)
    """
    return min(MOST, max(FEWEST, room // max(1, episodes * series)))


def shown(series: Iterable[Floats], count: int, keep: Iterable[int], most: int) -> NDArray[np.intp]:
    """The samples of a long episode that are shown, increasing.

    All are shown if there are no more than ``most``. Else the first and the last, those to keep,
    where each series is least and where it is greatest are shown; and from each of about
    ``most / 2`` equal parts two samples: the first, and the one at which a series is farthest from
    the line between the ends of the part. The series take turns, part by part.

    Args:
        series: Series of one length.
        count: The number of samples in each.
        keep: Samples that must be shown.
        most: How many samples are shown, but for those that must be.

    Example:
        >>> import numpy as np
        >>> wave = np.zeros(1000)
        >>> wave[[317, 611]] = 1.0, -1.0
        >>> places = shown([wave], 1000, [500], 10)
        >>> [place in places for place in (0, 317, 500, 611, 999)], len(places)
        ([True, True, True, True, True], 9)
    """
    if count <= most:
        return np.arange(count, dtype=np.intp)
    columns = [np.nan_to_num(each, nan=0.0) for each in series]
    places = {0, count - 1, *keep}
    for column in columns:
        places |= {int(column.argmin()), int(column.argmax())}
    bounds = np.linspace(0, count, max(2, most // 2) + 1).astype(int)
    for part, (begin, end) in enumerate(itertools.pairwise(bounds)):
        places.add(int(begin))
        if columns and end - begin > 2:
            column = columns[part % len(columns)][begin:end]
            places.add(int(begin) + _farthest(column))
    return np.array(sorted(places), dtype=np.intp)


def _farthest(column: Floats) -> int:
    """The place that is farthest from the line between the ends."""
    finite = np.clip(column, -1e300, 1e300)
    line = np.linspace(finite[0], finite[-1], len(finite))
    return int(np.abs(finite - line).argmax())


def evenly(ordered: Sequence[float], most: int) -> tuple[float, ...]:
    """The numbers of evenly spaced ranks, the first and the last among them.

    Example:
        >>> evenly([1.0, 2.0, 3.0, 4.0, 5.0], 3)
        (1.0, 3.0, 5.0)
    """
    return rounded(spaced(ordered, most))


def spaced(ordered: Sequence[T], most: int) -> tuple[T, ...]:
    """What stands at evenly spaced ranks, the first and the last among it."""
    if len(ordered) <= most:
        return tuple(ordered)
    places = np.linspace(0, len(ordered) - 1, most).round().astype(int)
    return tuple(ordered[int(place)] for place in places)


def rounded(values: Iterable[float]) -> tuple[float, ...]:
    """Numbers of six digits."""
    return tuple(map(six, values))


def six(value: float) -> float:
    """The number of six digits that is nearest; zeros have no sign, as the verdict has it.

    Example:
        >>> six(1.23456789), six(-0.0), six(float("-inf"))
        (1.23457, 0.0, -inf)
    """
    number = float(value)
    return float(f"{number:.6g}") + 0.0 if math.isfinite(number) else number
