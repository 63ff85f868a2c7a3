"""The default optimizer: corners, then quasi-random points, then CMA-ES from the best of them."""

from __future__ import annotations

from typing import Final

import numpy as np

from rtamt_gym.search.evolution import climb
from rtamt_gym.search.points import extremes, few_pieces, take
from rtamt_gym.search.protocol import Evaluate

__all__ = ["portfolio"]

_CORNERS: Final = 16
"""The most corners that are run."""

_POINTS: Final = 32
"""The quasi-random points before the first climb."""

_SHARE: Final = 4
"""After a climb, one quasi-random point for so many points of the climb."""


def portfolio(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """Corners, then quasi-random points, then CMA-ES with restarts from the best of these.

    All inputs constant at the ends of their ranges come first, 16 such points at most. Then come 32
    quasi-random points of one, two, three and all pieces in turn. CMA-ES climbs from the best of
    them; when a climb has converged, further quasi-random points follow, a quarter of what the
    climb took, and the next climb begins at the best point that none has begun at.
    """
    corners = take(extremes(evaluate.groups), _CORNERS, dimension)
    spread = few_pieces(evaluate.groups, rng)
    points = np.concatenate([corners, take(spread, _POINTS, dimension)])
    values = evaluate(points)
    begun = np.zeros(len(points), np.bool_)
    while True:
        best = int(np.where(begun, np.inf, values).argmin())
        begun[best] = True
        count = climb(evaluate, points[best], rng, sigma=0.3, population=8)
        more = take(spread, count // _SHARE + 1, dimension)
        points = np.concatenate([points, more])
        values = np.concatenate([values, evaluate(more)])
        begun = np.concatenate([begun, np.zeros(len(more), np.bool_)])
