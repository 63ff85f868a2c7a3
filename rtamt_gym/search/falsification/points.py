"""Points of the unit cube in orders that serve a search: extremes first, and few pieces first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, cycle, islice, product

import numpy as np

from rtamt_gym.search.falsification.protocol import Floats

__all__ = ["Pieces", "extremes", "quasi_random", "spread", "take"]

_CHUNK = 16
"""Points that a sequence makes at a time: a power of two, as its balance needs."""

_PIECES = (1, 2, 3)
"""The least numbers of pieces that inputs have."""


def take(points: Iterator[Floats], count: int, dimension: int) -> Floats:
    """The next points, fewer where there are no more: an array of shape (points, dimension)."""
    return np.array(list(islice(points, count))).reshape(-1, dimension)


class Pieces:
    """Return points with inputs of a few pieces: each has one value over neighbouring coordinates.

    Attributes:
        dimension: The number of pieces of all inputs together.

    Args:
        groups: The coordinates of each input.
        count: The pieces of an input; one with fewer coordinates has those.
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
        """Points from values of their pieces, shape (points, pieces)."""
        return values[:, self._piece]


def extremes(groups: Sequence[slice]) -> Iterator[Floats]:
    """Return all points with inputs constant at an end of their range, each once.

    All inputs low and all high come first, then corners among which every two inputs have all four
    combinations equally often, then the rest. With up to 15 inputs, the first 16 corners hold every
    combination of every two.
    """
    sizes = [_size(group) for group in groups]
    count = len(groups)
    seen = set()
    first = [(0.0,) * count, (1.0,) * count]
    for corner in chain(first, _balanced(count), _all(count)):
        if corner not in seen:
            seen.add(corner)
            yield np.repeat(corner, sizes)


def spread(groups: Sequence[slice], rng: np.random.Generator) -> Iterator[Floats]:
    """Quasi-random points without end, of inputs that move much and of inputs that move little.

    Every second point has all control points; their values have the arcsine distribution, which
    prefers the ends of the range. Every fourth has half as many pieces, and every fourth one, two
    or three in turn: an input of few pieces keeps a value over several neighbouring control points.
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

    # A sequence has no more dimensions, and no more points.
    if dimension <= qmc.Sobol.MAXDIM:
        sequence = qmc.Sobol(dimension, seed=rng)
        for _ in range(2**30 // _CHUNK):
            yield from sequence.random(_CHUNK)
    while True:
        yield rng.random(dimension)


def _size(group: slice) -> int:
    return int(group.stop - group.start)


def _balanced(count: int) -> Iterator[tuple[float, ...]]:
    """Corners among which every two inputs have all four combinations equally often.

    They are the rows of a Hadamard matrix without its constant column, in a mixed order.
    """
    from scipy.linalg import hadamard

    rows = hadamard(1 << count.bit_length())[:, 1 : count + 1]
    for row in np.random.default_rng(0).permutation(rows):
        yield tuple((row > 0).astype(float).tolist())


def _all(count: int) -> Iterator[tuple[float, ...]]:
    return product((0.0, 1.0), repeat=count)
