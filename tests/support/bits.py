"""Doubles bit by bit: 0.0 is not -0.0, and nan is nan."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Doubles = Sequence[float] | NDArray[np.float64]


def bits(values: Doubles) -> list[int]:
    """Return the bits of doubles as integers; every nan has the same bits."""
    doubles = np.array(values, dtype=np.float64)
    doubles[np.isnan(doubles)] = np.nan
    found: list[int] = doubles.view(np.int64).tolist()
    return found


def identical(x: Doubles, y: Doubles) -> bool:
    """Return whether doubles are equal bit by bit."""
    return bits(x) == bits(y)
