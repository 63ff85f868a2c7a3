"""Numbers, shares and times in the form of the page, and a selection of samples of long series."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

T = TypeVar("T")

_MINUS = "\N{MINUS SIGN}"
_INFINITY = "\N{INFINITY}"

ROOM: Final = 60_000
"""The maximum count of numbers in all episodes of a report, about 500 kB as text."""

MOST: Final = 600
"""The maximum number of samples that are shown of an episode."""

FEWEST: Final = 60
"""The minimum number of samples that are shown of a longer episode."""


def points_of(room: int, episodes: int, series: int) -> int:
    """Return the number of samples that are shown of an episode: an equal share of the room.

    Example:
        >>> points_of(60_000, 10, 8), points_of(60_000, 2, 8), points_of(60_000, 100, 40)
        (600, 600, 60)
    """
    return min(MOST, max(FEWEST, room // max(1, episodes * series)))


def shown(series: Iterable[Floats], count: int, keep: Iterable[int], most: int) -> NDArray[np.intp]:
    """Return the samples of a long episode that are shown, increasing.

    All samples are shown if there are at most ``most``. Otherwise the result has the first and the
    last sample, the samples to keep, and the minimum and maximum of each series. It also has two
    samples from each of about ``most / 2`` equal parts: the first, and the sample where a series is
    farthest from the line between the ends of the part. The series take turns, part by part.

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
    columns = [np.nan_to_num(item, nan=0.0) for item in series]
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
    """Return the place that is farthest from the line between the ends."""
    finite = np.clip(column, -1e300, 1e300)
    line = np.linspace(finite[0], finite[-1], len(finite))
    return int(np.abs(finite - line).argmax())


def evenly(ordered: Sequence[float], most: int) -> tuple[float, ...]:
    """Return the numbers at evenly spaced ranks, including the first and the last.

    Example:
        >>> evenly([1.0, 2.0, 3.0, 4.0, 5.0], 3)
        (1.0, 3.0, 5.0)
    """
    return rounded(spaced(ordered, most))


def spaced(ordered: Sequence[T], most: int) -> tuple[T, ...]:
    """Return the items at evenly spaced ranks, including the first and the last."""
    if len(ordered) <= most:
        return tuple(ordered)
    places = np.linspace(0, len(ordered) - 1, most).round().astype(int)
    return tuple(ordered[int(position)] for position in places)


def rounded(values: Iterable[float]) -> tuple[float, ...]:
    """Return numbers rounded to six digits."""
    return tuple(map(six, values))


def six(value: float) -> float:
    """Return the nearest number of six digits; zeros lose their sign, which the verdict shows.

    Example:
        >>> six(1.23456789), six(-0.0), six(float("-inf"))
        (1.23457, 0.0, -inf)
    """
    value = float(value)
    return float(f"{value:.6g}") + 0.0 if math.isfinite(value) else value


def number(value: float | None, digits: int = 4) -> str:
    """Return a number in a few digits, with a true minus sign; empty for None.

    Example:
        >>> number(-0.25), number(math.inf), number(12345.6), number(None)
        ('−0.25', '∞', '12350', '')
    """  # noqa: RUF002 - the minus sign is meant
    if value is None:
        return ""
    if math.isinf(value):
        return _MINUS + _INFINITY if value < 0 else _INFINITY
    text = f"{value:.{digits}g}"
    if "e+" in text:
        text = f"{float(text):.0f}" if abs(value) < 1e9 else text
    return text.replace("-", _MINUS)


def aligned(values: Sequence[float | None]) -> list[str]:
    """Return the numbers of a column with the same number of decimals, so that their points align.

    A number that these decimals would change by more than a twentieth has its own digits.

    Example:
        >>> aligned([-0.25, 3.0, 0.0, 1e-6, math.inf, None])
        ['−0.25', '3.00', '0.00', '1e−06', '∞', '']
    """  # noqa: RUF002 - the minus sign is meant
    sizes = [abs(value) for value in values if value is not None and math.isfinite(value)]
    largest = max(sizes, default=0.0)
    if largest >= 1e6 or (largest and largest < 1e-4):
        return [number(value) for value in values]
    decimals = min(max(3 - math.floor(math.log10(largest)), 0), 6) if largest else 0
    written = [f"{size:.{decimals}f}" for size in sizes]
    while decimals and all(text.endswith("0") for text in written):
        written, decimals = [text[:-1] for text in written], decimals - 1
    return [_fixed(value, decimals) for value in values]


def _fixed(value: float | None, decimals: int) -> str:
    if value is None or not math.isfinite(value):
        return number(value)
    text = f"{value:.{decimals}f}"
    if abs(float(text) - value) > 0.05 * abs(value):
        return number(value, 2)
    return text.replace("-", _MINUS)


def percent(share: float) -> str:
    """Return a share as a percentage, in full percents except near 0 and 1.

    Example:
        >>> percent(0.85), percent(0.9965), percent(1), percent(0.0004)
        ('85', '99.7', '100', '0.04')
    """
    value = 100 * share
    if value in {0.0, 100.0}:
        return f"{value:.0f}"
    if 1 <= abs(value) <= 99:
        return f"{value:.0f}".replace("-", _MINUS)
    far = 100 - abs(value) if abs(value) > 99 else abs(value)
    decimals = min(max(1, -math.floor(math.log10(far))), 6) if far else 0
    return f"{value:.{decimals}f}".rstrip("0").rstrip(".").replace("-", _MINUS)


def time(value: float | None, unit: str) -> str:
    """Return a time with its unit.

    Example:
        >>> time(1.5, "s"), time(3, "steps"), time(None, "s")
        ('1.5 s', 'step 3', '')
    """
    if value is None:
        return ""
    return f"{number(value)} s" if unit == "s" else f"step {number(value)}"
