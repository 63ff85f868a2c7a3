"""Points of the unit cube: how optimizers evaluate them, and useful orders of points.

`Evaluate` and `Optimizer` are the protocol of optimizers, which docs/falsification.md describes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, cycle, islice, product
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Evaluate",
    "Floats",
    "Optimizer",
    "Pieces",
    "extremes",
    "quasi_random",
    "spread",
    "take",
]


Floats = NDArray[np.float64]


class Evaluate(Protocol):
    """Run simulations for an optimizer; the first argument of its call.

    Attributes:
        groups: The coordinates of each input: a signal has one for every control point, a parameter
            one.
    """

    groups: Sequence[slice]

    def __call__(self, points: ArrayLike, level: float = math.inf) -> Floats:
        """Run a simulation for each point; the call does not return once the search is over.

        Args:
            points: Any number of points of the unit cube, shape (k, dimension). They run side by
                side if the system has environments.
            level: A value above which exact numbers do not matter: a run that certainly stays above
                it may be stopped, and returns a lower bound of its value.

        Returns:
            k numbers to minimize; a number is negative if the point violates a requirement.
        """


Optimizer = Callable[[Evaluate, int, np.random.Generator], object]
"""A function that is called with `Evaluate`, the dimension and a random generator; its result is
ignored."""

_CHUNK = 16
"""The points that a sequence returns at a time: a power of two keeps it balanced."""

_PIECES = (1, 2, 3)
"""The smallest numbers of pieces of an input."""


def take(points: Iterator[Floats], count: int, dimension: int) -> Floats:
    """Return the next `count` points, or all that are left, shape (points, dimension)."""
    return np.array(list(islice(points, count))).reshape(-1, dimension)


class Pieces:
    """Inputs of a few pieces, each with one value over neighbouring coordinates.

    Attributes:
        dimension: The number of pieces of all inputs together.

    Args:
        groups: The coordinates of each input.
        count: The pieces of an input, or its number of coordinates if that is smaller.
    """

    def __init__(self, groups: Sequence[slice], count: int) -> None:
        pieces, begin = [], 0
        for size in map(_size, groups):
            own = min(size, count)
            pieces.append(begin + np.arange(size) * own // size)
            begin += own
        self.dimension = begin
        self._piece = np.concatenate(pieces)  # of each coordinate

    def stretched(self, values: Floats) -> Floats:
        """Return points from values of their pieces, shape (points, pieces)."""
        return values[:, self._piece]


def extremes(groups: Sequence[slice]) -> Iterator[Floats]:
    """Yield all points with inputs constant at an end of their range, each once.

    The first points are all inputs low and all inputs high. Then come corners in which any two
    inputs have all four combinations equally often, and then the remaining corners. With up to 15
    inputs, the first 16 corners contain every combination of any two inputs.
    """
    sizes = [_size(group) for group in groups]
    count = len(groups)
    seen = set()
    first = [(0.0,) * count, (1.0,) * count]
    for corner in chain(first, _balanced(count), product((0.0, 1.0), repeat=count)):
        if corner not in seen:
            seen.add(corner)
            yield np.repeat(corner, sizes)


def spread(groups: Sequence[slice], rng: np.random.Generator) -> Iterator[Floats]:
    """Yield quasi-random points without end, some with inputs that move much, some with few moves.

    Every second point uses all control points, with values of the arcsine distribution, which
    prefers the ends of the range. Every fourth point has half as many pieces, and every fourth has
    one, two or three pieces in turn: such an input keeps a value over neighbouring control points.
    Uniform points over all control points hardly ever keep an input high or low for long.
    """
    most = max(map(_size, groups))
    half = (most + 1) // 2
    few = [count for count in _PIECES if count < half] or [half]
    shapes = {count: Pieces(groups, count) for count in (most, half, *few)}
    sequences = {count: quasi_random(shape.dimension, rng) for count, shape in shapes.items()}
    for least in cycle(few):
        for count in (most, half, most, least):
            values = next(sequences[count])[None]
            if count == most > 1:
                values = np.sin(values * (np.pi / 2)) ** 2
            yield shapes[count].stretched(values)[0]


def quasi_random(dimension: int, rng: np.random.Generator) -> Iterator[Floats]:
    """Yield points of a scrambled Sobol sequence; uniform points if the dimension is too large."""
    from scipy.stats import qmc

    # A Sobol sequence is limited to MAXDIM dimensions and 2**30 points.
    if dimension <= qmc.Sobol.MAXDIM:
        sequence = qmc.Sobol(dimension, seed=rng)
        for _ in range(2**30 // _CHUNK):
            yield from sequence.random(_CHUNK)
    while True:
        yield rng.random(dimension)


def _size(group: slice) -> int:
    return int(group.stop - group.start)


def _balanced(count: int) -> Iterator[tuple[float, ...]]:
    """Yield corners among which any two inputs have all four combinations equally often.

    They are the rows of a Hadamard matrix without its constant column, shuffled.
    """
    from scipy.linalg import hadamard

    rows = hadamard(1 << count.bit_length())[:, 1 : count + 1]
    for row in np.random.default_rng(0).permutation(rows):
        yield tuple((row > 0).astype(float).tolist())
