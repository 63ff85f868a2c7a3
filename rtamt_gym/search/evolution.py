"""A climb: one run of CMA-ES from a start, by the package ``cma``."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from rtamt_gym.search.protocol import Evaluate, Floats

__all__ = ["climb"]


def climb(
    evaluate: Evaluate,
    start: Floats,
    rng: np.random.Generator,
    *,
    sigma: float,
    population: int | None = None,
) -> int:
    """Runs CMA-ES from a start until it has converged; returns how many points it has evaluated.

    A point that leaves the unit cube is moved to the nearest in it, and counts with the value of
    that. Extremes of inputs, where many violations are, are so reached at once.

    Args:
        evaluate: What runs the simulations.
        start: The mean of the first generation.
        rng: Where the seed comes from.
        sigma: The standard deviation of the first generation.
        population: The points of a generation; None: ``4 + 3 log(dimension)``.
    """
    import cma

    dimension = len(start)
    padded = max(dimension, 2)  # the package refuses one dimension; a second that nothing reads
    options = {
        "seed": int(rng.integers(1, 2**31)),
        "verbose": -9,
        "verb_log": 0,
        "tolfun": 1e-3,
        "popsize": population or 4 + int(3 * math.log(padded)),
    }
    count = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of flat values, which end the climb
        strategy: Any = cma.CMAEvolutionStrategy(np.resize(start, padded), sigma, options)
    while not strategy.stop():
        asked = np.array(strategy.ask())
        values = evaluate(asked[:, :dimension].clip(0.0, 1.0))
        count += len(values)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            strategy.tell(list(asked), values.tolist())
    return count
