"""Points of the unit cube: how optimizers evaluate them, useful orders, and what they cover.

`Evaluate` and `Optimizer` are the protocol of optimizers, which docs/falsification.md describes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, cycle, islice, product
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt_gym.tables import counted

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
    one, two or three pieces in turn, because uniform points over all control points hardly ever
    keep an input high or low for long.
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


class Effects(NamedTuple):
    """The inputs that did not change the robustness.

    Attributes:
        without: The names of the inputs.
        simulations: The number of simulations that showed this.
    """

    without: tuple[str, ...] = ()
    simulations: int = 0

    def __str__(self) -> str:
        runs = counted(self.simulations, "further simulation")
        return (
            f"no effect on the robustness: {', '.join(self.without)} (each alone at the other end "
            f"of its range, {runs})"
        )


def inputs_without_effect(
    groups: Mapping[str, slice],
    bases: Sequence[Floats],
    run: Callable[[int, Sequence[Floats]], Sequence[object]],
) -> Effects:
    """Return the inputs that do not change the result of a simulation at any base point.

    Each input is moved alone, to the farther end of its range. An input that changes the result at
    one base point is not moved at the next. ``run`` gets the index of a base point, and its points.

    Example:
        >>> low, high = np.zeros(2), np.ones(2)
        >>> groups = {"inflow": slice(0, 1), "spare": slice(1, 2)}
        >>> inputs_without_effect(groups, [low, high], lambda _, points: [p[0] for p in points])
        Effects(without=('spare',), simulations=5)
    """
    left, count = list(groups), 0
    for index, base in enumerate(bases):
        if not left:
            break
        points = [base.copy() for _ in range(len(left) + 1)]
        for name, point in zip(left, points[1:], strict=True):
            group = groups[name]
            point[group] = 0.0 if float(np.mean(base[group])) > 0.5 else 1.0
        first, *others = run(index, points)
        count += len(points)
        left = [name for name, other in zip(left, others, strict=True) if other == first]
    return Effects(tuple(left), count)


_PROBES: Final = 512
"""The points whose distances are measured: a power of two keeps a Sobol sequence balanced."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """How much of a space simulations cover. It guarantees nothing about the points between them.

    Attributes:
        simulations: The number of judged simulations; simulations that an error ended do not count.
        columns: The number of columns of the space.
        gap: The widest part of a column's range without a simulation, as a share of the range; the
            maximum over all columns, which are examined separately.
        distance: The median distance of evenly spread cases to the nearest simulation: the largest
            difference in a column, as a share of its range. All columns count together: with many
            columns it is large after any affordable number of simulations.
    """

    simulations: int
    columns: int
    gap: float
    distance: float

    def __str__(self) -> str:
        simulations = "simulation" if self.simulations == 1 else "simulations"
        one = self.columns == 1
        return (
            f"{self.simulations} {simulations} in {self.columns} {'column' if one else 'columns'}: "
            f"largest untested part of any range: {100 * self.gap:.0f} %; half of all possible "
            f"inputs are {100 * self.distance:.0f} % of a range or more from every simulated input"
        )


def coverage_of(points: Floats) -> Coverage:
    """Return how much of the unit cube the points cover, an array of shape (points, dimension).

    Without points, the gap and the distance are 1.
    """
    count, dimension = points.shape
    ends = np.zeros((1, dimension)), np.ones((1, dimension))
    gap = np.diff(np.sort(np.concatenate([*ends, points]), axis=0), axis=0).max()
    probes = take(quasi_random(dimension, np.random.default_rng(0)), _PROBES, dimension)
    distances = [float(np.abs(points - probe).max(axis=1).min(initial=1.0)) for probe in probes]
    return Coverage(count, dimension, float(gap), float(np.median(distances)))
