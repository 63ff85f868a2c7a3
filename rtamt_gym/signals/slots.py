"""Signals that are one number of an array which a simulation keeps up to date."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtamt_gym.signals.signals import Number

__all__ = ["MovingRead", "SlotRead"]


@dataclass(frozen=True, slots=True)
class SlotRead:
    """Reads an element of an array; who knows it reads the array without a call.

    Attributes:
        array: The array, of one dimension. It is held, and no ``memoryview`` of it: Python before
            3.11.8 crashes when its collector clears one that something else still reads.
        index: The index of the element, 0 or more.
    """

    array: NDArray[np.float64]
    index: int

    def __call__(self, *_: object) -> float:
        """Reads the element."""
        return float(self.array.item(self.index))


class MovingRead:
    """Reads a number of a simulation, also if that builds its arrays anew.

    Attributes:
        home: Gives what holds the arrays now.

    Args:
        home: As above.
        bind: Makes the function that reads the number from what holds the arrays now.
    """

    def __init__(self, home: Callable[[], object], bind: Callable[[], Number]) -> None:
        self.home = home
        self._bind = bind
        self._bound, self._read = home(), bind()

    def now(self) -> Number:
        """What reads the number from the arrays that there are now."""
        if self.home() is not self._bound:
            self._bound, self._read = self.home(), self._bind()
        return self._read

    def __call__(self, *_: object) -> float:
        """Reads the number."""
        return self.now()()
