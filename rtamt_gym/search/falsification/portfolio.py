"""The default optimizer: corners, then quasi-random points, then CMA-ES from the best of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from rtamt_gym.search.falsification.evolution import Climb
from rtamt_gym.search.falsification.points import extremes, quasi_random, spread, take
from rtamt_gym.search.falsification.protocol import Evaluate, Floats

__all__ = ["portfolio"]

_CORNERS: Final = 16
"""The most corners that are run."""

_POINTS: Final = 24
"""The quasi-random points before the first climb."""

_POPULATION: Final = 12
"""The points of a generation."""

_SIGMA: Final = 0.45
"""The standard deviation of the first generation of a climb."""

_EVERY: Final = 6
"""The generations after which as many quasi-random points follow as one generation has."""

_FLAT: Final = 8
"""Before a climb on values that are flat, quasi-random points for so many generations."""

_STARTS: Final = 4
"""A quasi-random point is of use if it is among so many best that no climb has begun at."""


def portfolio(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """Corners, then quasi-random points, then CMA-ES with restarts from the best of these.

    All inputs constant at the ends of their ranges come first, 16 such points at most. Then come 24
    quasi-random points, see `spread`. CMA-ES climbs from the best of them, with 12 points in a
    generation; after every sixth generation come 12 more quasi-random points. When a climb has
    converged or made no progress in 12 generations, the next starts at the best unused point. If a
    quarter of the points share the minimum, up to 96 more points, even in the whole space, come
    before a climb: such plateaus occur with requirements about events, such as shifts of gears,
    which inputs with large movements cause.
    """
    corners = take(extremes(evaluate.groups), _CORNERS, dimension)
    starts = _Starts(spread(evaluate.groups, rng), dimension)
    starts.evaluate(evaluate, corners, _POINTS)
    even = quasi_random(dimension, rng)
    generations = 0
    while True:
        for _ in range(_FLAT):
            if starts.flat:
                starts.evaluate(evaluate, take(even, _POPULATION, dimension), 0)
        climb = Climb(starts.take(), rng, sigma=_SIGMA, population=_POPULATION)
        while not climb.over:
            climb.tell(evaluate(climb.ask(), climb.level))
            generations += 1
            if generations % _EVERY == 0:
                starts.evaluate(evaluate, np.empty((0, dimension)), _POPULATION)


class _Starts:
    """Points with their values; climbs begin at the best, each at another."""

    def __init__(self, spread: Iterator[Floats], dimension: int) -> None:
        self._spread = spread
        self._dimension = dimension
        self._points = np.empty((0, dimension))
        self._values = np.empty(0)

    def evaluate(self, evaluate: Evaluate, points: Floats, count: int) -> None:
        """Evaluate points, and further ones of the sequence."""
        more = np.concatenate([points, take(self._spread, count, self._dimension)])
        best = np.sort(self._values)[:_STARTS]
        values = evaluate(more, best[-1] if len(best) == _STARTS else math.inf)
        self._points = np.concatenate([self._points, more])
        self._values = np.concatenate([self._values, values])

    @property
    def flat(self) -> bool:
        """Return whether a quarter of the points share the minimum: then it gives no direction."""
        least = np.count_nonzero(self._values == self._values.min())
        return bool(4 * least >= len(self._values))

    def take(self) -> Floats:
        """The best point, which is taken out."""
        index = int(self._values.argmin())
        self._values[index] = math.inf
        point: Floats = self._points[index]
        return point
