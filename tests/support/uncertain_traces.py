"""Traces with unknown or uncertain values, and traces that they allow."""

from __future__ import annotations

import functools
import math
import random

from hypothesis import strategies as st
from interval_oracle import inside, order
from strategies import QUARTERS, VARIABLES, Draw, Trace

from rtamt import UncertainValue

Uncertain = dict[str, list[float | UncertainValue]]

UNKNOWN = UncertainValue(-math.inf, math.inf)


@functools.cache
@st.composite
def uncertain_traces(draw: Draw, least: int = 1, most: int = 10, share: float = 0.25) -> Uncertain:
    """Values of every variable at ``least`` to ``most`` samples."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    n = draw(st.integers(least, most))
    return {name: [some_value(rng, share) for _ in range(n)] for name in VARIABLES}


def some_value(rng: random.Random, share: float) -> float | UncertainValue:
    """A number, or with this probability an interval, half of them unbounded."""
    if rng.random() >= share:
        return rng.choice(QUARTERS)
    if rng.random() < 0.5:
        return UNKNOWN
    lower, upper = sorted(rng.choices(QUARTERS, k=2), key=order)
    return UncertainValue(lower, upper)


def one_of(trace: Uncertain, rng: random.Random) -> Trace:
    """A trace of finite numbers that an uncertain trace allows."""
    return {
        name: [
            max(-1e3, min(1e3, inside(value, rng))) if value is UNKNOWN else inside(value, rng)
            for value in column
        ]
        for name, column in trace.items()
    }
