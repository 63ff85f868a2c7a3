"""The protocol of optimizers: functions that request values of points until the search ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Evaluate", "Floats", "Optimizer"]

Floats = NDArray[np.float64]


class Evaluate(Protocol):
    """Run simulations for an optimizer; the first argument of its call.

    Attributes:
        groups: The coordinates of each input: a signal has one for every control point, a parameter
            one.
    """

    groups: Sequence[slice]

    def __call__(self, points: ArrayLike, level: float = math.inf) -> Floats:
        """Run a simulation for each point; it ends the search where that is over.

        Args:
            points: Points of the unit cube, shape (k, dimension), any number of them. They run side
                by side where the system has environments.
            level: A value above which exact numbers do not matter: a run that certainly stays above
                it may be stopped, and returns a lower bound of its value.

        Returns:
            k numbers to minimize; negative where the requirement is violated.
        """


Optimizer = Callable[[Evaluate, int, np.random.Generator], object]
"""Called with `Evaluate`, the dimension and a generator of random numbers; what it returns is not
read."""
