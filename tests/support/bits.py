"""Doubles bit by bit: 0.0 is not -0.0, and nan is nan."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Doubles = Sequence[float] | NDArray[np.float64]


def bits(values: Doubles) -> list[int]:
    """The bits of doubles as integers; those of every nan are the same."""
    doubles = np.array(values, dtype=np.float64)
    doubles[np.isnan(doubles)] = np.nan
    found: list[int] = doubles.view(np.int64).tolist()
    return found


def identical(x: Doubles, y: Doubles) -> bool:
    """Whether doubles are the same bit for bit."""
    return bits(x) == bits(y)
