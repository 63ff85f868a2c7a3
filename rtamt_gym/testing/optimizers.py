"""The contract of an optimizer."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike

from rtamt_gym.search.falsification.optimizers import OptimizerLike, find_optimizer
from rtamt_gym.search.falsification.protocol import Floats, Optimizer
from rtamt_gym.search.falsification.search import SearchOver
from rtamt_gym.testing.claims import claim

__all__ = ["check_optimizer"]

_DIMENSIONS = (1, 2, 7)


class _Recorded:
    """Stands for the simulations of a search; it keeps the points that are asked for."""

    def __init__(self, height: Callable[[Floats], Floats], dimension: int, budget: int) -> None:
        half = max(1, dimension // 2)
        self.groups: Sequence[slice] = [slice(0, half)] + [slice(half, dimension)] * (
            half < dimension
        )
        self.points: list[Floats] = []
        self.over = False
        self._height = height
        self._dimension = dimension
        self._left = budget

    def __call__(self, points: ArrayLike, level: float = math.inf) -> Floats:
        claim(not self.over, "expected no more points after the search is over, got some")
        claim(not math.isnan(level), "expected a number as level, got nan")
        asked = np.asarray(points, np.float64)
        claim(
            asked.ndim == 2 and asked.shape[1] == self._dimension,
            f"expected points of shape (k, {self._dimension}), got shape {asked.shape}",
        )
        inside = bool(np.all((asked >= 0.0) & (asked <= 1.0)))
        claim(inside, f"expected points of the unit cube, got {asked[:3]}")
        asked = asked[: self._left]
        self.points.append(asked.copy())
        self._left -= len(asked)
        if not self._left:
            self.over = True
            raise SearchOver
        return self._height(asked)


def check_optimizer(optimizer: OptimizerLike, *, budget: int = 200) -> None:
    """Checks that `falsify` can search with an optimizer.

    It asks for points of the unit cube, in spaces of one dimension and of several, whatever their
    values are; it lets the end of the search through; all its chance comes from the generator that
    it is given, so that the same seed asks for the same points.

    Args:
        optimizer: The optimizer, or its name.
        budget: The points after which a search is over.

    Raises:
        AssertionError: If the contract is not kept.

    Example:
        >>> def uniform(evaluate, dimension, rng):
        ...     while True:
        ...         evaluate(rng.random((8, dimension)))
        >>> check_optimizer(uniform)
    """
    found = find_optimizer(optimizer)
    for dimension in _DIMENSIONS:
        for height in (_slope, _flat, _never):
            before = _drawn()
            points = _asked(found, height, dimension, budget)
            again = _asked(found, height, dimension, budget)
            claim(len(points) > 0, f"expected a point in {dimension} dimensions, got none")
            claim(
                np.array_equal(points, again),
                "expected the same points from the same seed; draw from rng alone",
            )
            claim(_drawn() == before, "expected numbers from rng, got NumPy's global")


def _asked(optimizer: Optimizer, height: Callable[[Floats], Floats], n: int, budget: int) -> Floats:
    evaluate = _Recorded(height, n, budget)
    ended = False
    with suppress(SearchOver):
        optimizer(evaluate, n, np.random.default_rng(3))
        ended = True
    claim(
        not (ended and evaluate.over),
        "expected the end of the search to leave the optimizer, got it swallowed; "
        "catch Exception, not BaseException",
    )
    return np.concatenate([*evaluate.points, np.empty((0, n))])


def _drawn() -> str:
    """The state of NumPy's global generator, which is nobody's to draw from."""
    state = np.random.get_state(legacy=False)["state"]  # noqa: NPY002 - careless ones use it
    return f"{state['pos']} {state['key'].tobytes().hex()}"


def _slope(points: Floats) -> Floats:
    return np.asarray(points.sum(axis=1) + 1.0)


def _flat(points: Floats) -> Floats:
    return np.ones(len(points))


def _never(points: Floats) -> Floats:
    """A requirement whose robustness has no bound, as of a Boolean reading."""
    return np.full(len(points), math.inf)
