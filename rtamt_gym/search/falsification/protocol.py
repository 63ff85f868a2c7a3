"""What an optimizer is: a function that asks for the values of points until the search is over."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Evaluate", "Floats", "Optimizer"]

Floats = NDArray[np.float64]


class Evaluate(Protocol):
    """Runs simulations; what an optimizer is called with.

    Attributes:
        groups: The coordinates of each input: a signal has one for every control point, a parameter
            one.
    """

    groups: Sequence[slice]

    def __call__(self, points: ArrayLike, level: float = math.inf) -> Floats:
        """Runs a simulation for each point; it ends the search where that is over.

        Args:
            points: Points of the unit cube, shape (k, dimension), any number of them. They run side
                by side where the system has lanes.
            level: The value above which the optimizer has no use for a number: a run that is
                certain to stay above it may be stopped, and gets what it is certain to stay above.

        Returns:
            k numbers to minimize; negative where the requirement is violated.
        """


Optimizer = Callable[[Evaluate, int, np.random.Generator], object]
"""Called with `Evaluate`, the dimension and a generator of random numbers; what it returns is not
read."""
