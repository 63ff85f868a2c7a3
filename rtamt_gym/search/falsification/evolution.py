"""`Climb`: one run of CMA-ES from a start, by the package ``cma``."""

from __future__ import annotations

import math
import warnings
from typing import Any, Final

import numpy as np

from rtamt_gym.search.falsification.protocol import Floats

__all__ = ["Climb", "population_of"]

_STALL: Final = 12
"""The generations without a better value after which a climb is over."""

_BETTER: Final = 1e-3
"""How much better a value must be, as a share of the best so far."""


def population_of(dimension: int) -> int:
    """The usual number of points in a generation: ``4 + 3 log(dimension)``."""
    return 4 + int(3 * math.log(max(dimension, 2)))


class Climb:
    """One run of CMA-ES from a start; its points are in the unit cube.

    A point that leaves the cube is moved to the nearest in it, and counts with the value of that.
    Extremes of inputs, where many violations are, are so reached at once.

    Attributes:
        over: Whether it has converged, or found nothing better for twelve generations.
        level: The median of the last generation, or infinite: the next one is made of the better
            half, and a point above the median is not likely to be in it.

    Args:
        start: The mean of the first generation.
        rng: Where the seed comes from.
        sigma: The standard deviation of the first generation.
        population: The points of a generation.
    """

    def __init__(
        self, start: Floats, rng: np.random.Generator, *, sigma: float, population: int
    ) -> None:
        import cma

        # The package draws from NumPy's global generator, which is the caller's.
        own = np.random.RandomState(int(rng.integers(1, 2**31)))
        options = {
            "seed": math.nan,
            "randn": own.randn,
            "verbose": -9,
            "verb_log": 0,
            "tolfun": 1e-3,
            "popsize": population,
        }
        self.over = False
        self.level = math.inf
        self._dimension = len(start)
        self._best = math.inf
        self._stalled = 0
        self._asked: list[Any] = []
        # The package refuses one dimension; a second, which nothing reads, does not harm.
        mean = np.resize(start, max(len(start), 2))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._strategy: Any = cma.CMAEvolutionStrategy(mean, sigma, options)

    def ask(self) -> Floats:
        """The points of the next generation, shape (points, dimension)."""
        self._asked = self._strategy.ask()
        return np.array(self._asked)[:, : self._dimension].clip(0.0, 1.0)

    def tell(self, values: Floats) -> None:
        """Take the values of the points that `ask` has given."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of flat values, which end the climb
            self._strategy.tell(self._asked, values.tolist())
            ended = bool(self._strategy.stop())
        least = float(values.min())
        if least < self._best - _BETTER * abs(self._best) or not math.isfinite(self._best):
            self._best = least
            self._stalled = 0
        else:
            self._stalled += 1
        self.over = ended or self._stalled >= _STALL
        self.level = float(np.median(values))
