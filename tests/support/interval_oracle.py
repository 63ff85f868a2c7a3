"""The values that interval arithmetic must contain: at points inside the intervals.

It uses no rules. The points are the ends, their neighbours, the places at which some function
turns, jumps or ends, and others between them.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterable, Iterator, Sequence

from strategies import QUARTERS

from rtamt import UncertainValue

INF = math.inf
TURNS = (0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 2.0, -2.0, 3.0, 5e-324, -5e-324, 1e308, -1e308)
NUMBERS = (*TURNS, *QUARTERS[2:], 700.0, -745.2, 1e-300, 710.0, INF, -INF)

Ends = tuple[float, float]


def order(x: float) -> tuple[float, float]:
    """Sort numbers, with -0.0 below 0.0."""
    return x, math.copysign(1.0, x)


def contains(ends: Ends, x: float) -> bool:
    return order(ends[0]) <= order(x) <= order(ends[1])


def points(ends: Ends, rng: random.Random, count: int = 4) -> list[float]:
    """Return numbers between two ends."""
    lower, upper = ends
    near = (math.nextafter(lower, INF), math.nextafter(upper, -INF))
    low, high = max(lower, -1e9), min(upper, 1e9)
    between = [rng.uniform(low, high) for _ in range(count)] if low < high else []
    whole = [float(math.floor(x)) for x in between]
    found = [x for x in (*near, *TURNS, *between, *whole) if contains(ends, x)]
    return [lower, upper, *found]


def values(
    function: Callable[..., float], operands: Sequence[Ends], rng: random.Random
) -> Iterator[float]:
    """Return the values of a function at points inside the intervals, if it is defined there."""
    for at in itertools.product(*(points(ends, rng) for ends in operands)):
        value = function(*at)
        if not math.isnan(value):
            yield value


def some_ends(rng: random.Random, numbers: Sequence[float] = NUMBERS) -> Ends:
    """Two ends in order, sometimes equal."""
    x, y = (rng.choice(numbers) for _ in range(2))
    y = x if rng.random() < 0.15 else y
    lower, upper = sorted((x, y), key=order)
    return lower, upper


def inside(value: float | UncertainValue, rng: random.Random) -> float:
    """A number inside bounds."""
    if not isinstance(value, UncertainValue):
        return value
    assert isinstance(value.lower, float)
    assert isinstance(value.upper, float)
    return rng.choice(points((value.lower, value.upper), rng, 2))


def hull(found: Iterable[float]) -> Ends:
    kept = list(found)
    return min(kept, key=order), max(kept, key=order)
