"""Attributes of a monitor that its machine writes, so that reading one costs no call.

They are slots of the monitor's class. Users see read-only descriptors; the machine has the writing
ones and a weak reference to the monitor, because its ``update`` method may outlive the monitor.
"""

from __future__ import annotations

import inspect
import weakref
from collections.abc import Sequence
from math import copysign
from types import MemberDescriptorType

import numpy as np
from numpy.typing import NDArray


class Readout:
    """Updates the slots robustness, lower, upper and verdict while the monitor lives."""

    def __init__(
        self, monitor: object, slots: Sequence[MemberDescriptorType], verdicts: Sequence[object]
    ) -> None:
        self._monitor = weakref.ref(monitor)
        self._slots = tuple(slots)
        self._verdicts = tuple(verdicts)

    def show(self, robustness: float, lower: float, upper: float) -> None:
        monitor = self._monitor()
        if monitor is not None:
            verdict = self._verdicts[1 + verdict_of(lower, upper)]
            for slot, value in zip(self._slots, (robustness, lower, upper, verdict), strict=True):
                slot.__set__(monitor, value)


def verdict_of(lower: float, upper: float) -> int:
    """Return -1 if the bounds show a violation, 1 if they show satisfaction, or 0."""
    return -1 if copysign(1.0, upper) < 0.0 else int(copysign(1.0, lower) > 0.0)


def verdicts_of(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.int8]:
    """Return the result of `verdict_of` for each batch entry."""
    return np.subtract(~np.signbit(lower), np.signbit(upper), dtype=np.int8)


def moved(robustness: float, lower: float, upper: float) -> float:
    """Return the robustness, or the nearest bound, with -0.0 below 0.0."""
    return max(lower, min(robustness, upper, key=_order), key=_order)


def _order(value: float) -> tuple[float, float]:
    return value, copysign(1.0, value)


def read_only(slot: MemberDescriptorType) -> object:
    """Return a read-only descriptor of a slot of a class."""
    return property(slot.__get__, doc=inspect.getdoc(slot))
