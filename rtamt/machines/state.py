"""Snapshots of the Python machines by field names, and the attributes that machines write.

A machine writes slots of its monitor, so that reading one costs no call. Users see read-only
descriptors; the machine has the writing ones and a weak reference to the monitor, because its
``update`` method may outlive the monitor.
"""

from __future__ import annotations

import inspect
import weakref
from collections import deque
from collections.abc import Sequence
from math import copysign
from types import MemberDescriptorType
from typing import Any, ClassVar, NoReturn

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import StateError


def refuse_stale() -> NoReturn:
    """Raise the error about an update of a machine whose monitor has another one."""
    msg = (
        "this update belongs to a monitor whose __init__ has run again since; read the "
        "monitor's update again"
    )
    raise StateError(msg)


class Retiring:
    """A machine whose monitor may replace it while somebody still holds its update."""

    __slots__ = ()
    reader: Any

    def retire(self) -> None:
        """Refuse each further update."""
        self.reader = _Retired()

    def require_current(self) -> None:
        """Refuse an update if reading its values has run `retire`."""
        if isinstance(self.reader, _Retired):
            refuse_stale()


class _Retired:
    def __getattr__(self, name: str) -> NoReturn:
        refuse_stale()


class StateFields:
    """An object with its state in the fields that its class names.

    A field is a number, a tuple or array that never changes in place, another object with a state,
    or a list or deque of these; objects, lists and deques may be nested one deep. Snapshots share
    no list with the object, and `restore` keeps the objects in fields.

    Attributes:
        STATE: Names of the fields that change between calls; ``reset`` sets their first values.
    """

    __slots__ = ()
    STATE: ClassVar[tuple[str, ...]]

    def reset(self) -> None:
        raise NotImplementedError

    def state(self) -> list[Any]:
        return [_copied(getattr(self, name)) for name in self.STATE]

    def restore(self, state: list[Any]) -> None:
        for name, saved in zip(self.STATE, state, strict=True):
            value = getattr(self, name) if type(saved) is list else None
            if isinstance(value, StateFields):
                value.restore(saved)
            elif value and hasattr(value[0], "restore"):
                for part, part_state in zip(value, saved, strict=True):
                    part.restore(part_state)
            else:
                setattr(self, name, _copied(saved))


def _copied(value: Any) -> Any:  # noqa: ANN401 - whatever a field holds
    if isinstance(value, list | deque):
        if value and (hasattr(value[0], "restore") or isinstance(value[0], list | deque)):
            return [_copied(part) for part in value]
        return value.copy()
    return value.state() if hasattr(value, "restore") else value


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
