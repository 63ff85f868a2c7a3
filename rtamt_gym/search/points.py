"""Points of the unit cube in orders that serve a search: extremes first, and few pieces first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice, product

import numpy as np

from rtamt_gym.search.protocol import Floats

__all__ = ["extremes", "few_pieces", "quasi_random", "take"]

_CHUNK = 16
"""Points that a sequence makes at a time: a power of two, as its balance needs."""

_PIECES = (1, 2, 3)
"""Numbers of pieces that inputs have before they have all of theirs."""


def take(points: Iterator[Floats], count: int, dimension: int) -> Floats:
    """The next points, fewer where there are no more: an array of shape (points, dimension)."""
    return np.array(list(islice(points, count))).reshape(-1, dimension)


def extremes(groups: Sequence[slice]) -> Iterator[Floats]:
    """All points whose inputs are constant at an end of their range, each once.

    All inputs low and all high come first, then the others in an order of low discrepancy: the
    first few of many hold every pair of inputs in every combination about equally often.
    """
    sizes = [_size(each) for each in groups]
    count = len(groups)
    seen = set()
    first = [(0.0,) * count, (1.0,) * count]
    for corner in (*first, *islice(_rounded(count), 64 * count), *_all(count)):
        if corner not in seen:
            seen.add(corner)
            yield np.repeat(corner, sizes)


def few_pieces(groups: Sequence[slice], rng: np.random.Generator) -> Iterator[Floats]:
    """Quasi-random points without end, in turn with inputs of one, two, three and all pieces.

    An input of few pieces keeps a value over several neighbouring control points. Uniform points
    over all control points hardly ever keep an input high or low for long, which most violations
    need.
    """
    sizes = np.array([_size(each) for each in groups])
    shapes = {tuple(np.minimum(sizes, pieces)) for pieces in _PIECES} | {tuple(sizes)}
    sequences = [(shape, quasi_random(sum(shape), rng)) for shape in sorted(shapes)]
    while True:
        for shape, sequence in sequences:
            values = np.split(next(sequence), np.cumsum(shape)[:-1])
            stretched = [
                each[np.arange(size) * len(each) // size]
                for each, size in zip(values, sizes, strict=True)
            ]
            yield np.concatenate(stretched)


def quasi_random(dimension: int, rng: np.random.Generator) -> Iterator[Floats]:
    """Points of a scrambled Sobol sequence without end; uniform ones where there is none."""
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


def _rounded(count: int) -> Iterator[tuple[float, ...]]:
    """Corners next to the points of a Sobol sequence."""
    from scipy.stats import qmc

    if count > qmc.Sobol.MAXDIM:
        return
    sequence = qmc.Sobol(count, scramble=False)
    while True:
        for point in sequence.random(_CHUNK):
            yield tuple(np.floor(2.0 * point).tolist())


def _all(count: int) -> Iterator[tuple[float, ...]]:
    return product((0.0, 1.0), repeat=count)
