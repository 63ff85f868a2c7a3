"""Attributes of a monitor that its machine writes, so that reading one costs no call.

They are slots of the monitor's class. Users see descriptors that only read; the machine has those
that write, and a weak reference to the monitor: ``update`` is a method of the machine, which may
outlive the monitor.
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
    """Keeps slots of a monitor at robustness, lower, upper and verdict while the monitor lives."""

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
    """-1 if the bounds say that the specification is violated, 1 if satisfied, else 0."""
    return -1 if copysign(1.0, upper) < 0.0 else int(copysign(1.0, lower) > 0.0)


def verdicts_of(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.int8]:
    """What `verdict_of` gives, for each lane."""
    return np.subtract(~np.signbit(lower), np.signbit(upper), dtype=np.int8)


def moved(robustness: float, lower: float, upper: float) -> float:
    """Return the robustness, or the bound that is nearest to it, -0.0 below 0.0."""
    return max(lower, min(robustness, upper, key=_order), key=_order)


def _order(value: float) -> tuple[float, float]:
    return value, copysign(1.0, value)


def read_only(slot: MemberDescriptorType) -> object:
    """Return a descriptor that reads a slot of a class, and does not write it."""
    return property(slot.__get__, doc=inspect.getdoc(slot))
