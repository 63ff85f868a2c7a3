"""Signals over dense time: events."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError
from rtamt.inputs.arrays import Floats, line_of_numbers
from rtamt.inputs.clock import Times, shown

__all__ = [
    "Events",
    "EventsLike",
    "Given",
    "are_dates",
    "check_times",
    "check_values",
    "not_after",
]

Given = tuple[Times, Floats]
"""Times as they were given and values of one variable's events."""


class Events(Sequence[tuple[float, float]]):
    """A signal over dense time: each value lasts until the time of the next one.

    It is a sequence of (time, value), equal to any other sequence of the same pairs. The last event
    is the end of the signal.

    Args:
        times: n finite numbers, or n `numpy.datetime64`, that increase.
        values: n numbers; +-inf is legal.

    Raises:
        InputError: On times that do not increase, a nan, or arrays of different length.
        InputTypeError: On values that are not real numbers.

    Example:
        >>> speed = Events([0, 1.5, 4], [10, 12, 11])
        >>> speed[1], len(speed), speed == [(0, 10), (1.5, 12), (4, 11)]
        ((1.5, 12.0), 3, True)
        >>> speed.values
        array([10., 12., 11.])
    """

    __slots__ = ("_given", "_times", "_values")

    def __init__(self, times: ArrayLike, values: ArrayLike) -> None:
        self._hold(_line_of_times(times), line_of_numbers(values, "the values of events").copy())
        if len(self._given) != len(self._values):
            raise InputError(
                f"expected as many values as times, got {len(self._values)} and {len(self._given)}"
            )
        check_times(self._given, "")
        late = self._given[1:] > self._given[:-1]
        if not late.all():
            i = int(np.argmin(late))
            raise not_after(self._given[i], self._given[i + 1], i + 1, "")
        check_values(self._given, self._values, "")

    @classmethod
    def unchecked(cls, times: Times, values: Floats) -> Self:
        """The events of arrays that nobody else changes.

        The times of a result increase, but doubles may not tell neighbouring ones apart.
        """
        events = cls.__new__(cls)
        cls._hold(events, times, values)
        return events

    def _hold(self, times: Times, values: Floats) -> None:
        self._given, self._values = _locked(times), _locked(values)
        self._times = _as_doubles(self._given)

    @property
    def given(self) -> Given:
        """Times and values as they were given: integers are exact, whatever their size."""
        return self._given, self._values

    @property
    def times(self) -> Floats:
        """The times of the events, as a read-only array; of dates if dates were given."""
        return self._times

    @property
    def values(self) -> Floats:
        """The values of the events, as a read-only array."""
        return self._values

    def __len__(self) -> int:
        return len(self.times)

    @overload
    def __getitem__(self, index: int) -> tuple[float, float]: ...
    @overload
    def __getitem__(self, index: slice) -> Events: ...
    def __getitem__(self, index: int | slice) -> tuple[float, float] | Events:
        if isinstance(index, slice):
            made = Events if (index.step or 1) < 0 else self.unchecked
            return made(self._given[index], self.values[index])
        time = self.times[index]
        return time if are_dates(self.times) else float(time), float(self.values[index])

    def __iter__(self) -> Iterator[tuple[float, float]]:
        times = self.times if are_dates(self.times) else self.times.tolist()
        return iter(zip(times, self.values.tolist(), strict=True))

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Events):
            pairs = (self.times, other.times), (self.values, other.values)
            return all(np.array_equal(mine, its) for mine, its in pairs)
        if isinstance(other, str | bytes) or not isinstance(other, Sequence | np.ndarray):
            return NotImplemented
        return len(self) == len(other) and all(
            isinstance(pair, Sequence | np.ndarray) and mine == tuple(pair)
            for mine, pair in zip(self, other, strict=True)
        )

    __hash__ = None  # type: ignore[assignment] # lists, which have no hash, may be equal

    def __reduce__(self) -> tuple[Callable[[Times, Floats], Events], Given]:
        return self.unchecked, self.given

    def __repr__(self) -> str:
        times = (self.times[:7].astype(str) if are_dates(self.times) else self.times).tolist()
        return f"Events({_brief.repr(times)}, {_brief.repr(self.values.tolist())})"


_brief = reprlib.Repr()
_brief.maxstring = 40  # a date to the attosecond has 38 characters


EventsLike = Events | ArrayLike | Iterable[Sequence[object]]
"""Events as a sequence of (time, value), as an array of shape (n, 2), or as `Events`."""


def _line_of_times(times: ArrayLike) -> Times:
    """A copy of numbers or dates in one dimension; integers stay integers."""
    if are_dates(array := np.asarray(times)) and array.ndim == 1:
        return array.copy()
    line = line_of_numbers(times, "the times of events")
    return np.array(times) if array.dtype.kind in "iu" else line.copy()


def _locked(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


def are_dates(times: Times) -> bool:
    """Whether times are `numpy.datetime64`."""
    return times.dtype.kind == "M"


def _as_doubles(times: Times) -> Times:
    """Dates stay what they are."""
    return times if times.dtype.kind in "Mf" else _locked(times.astype(np.float64))


def check_times(times: Times, of_name: str) -> None:
    """Refuse times that are not finite."""
    if times.dtype.kind not in "fMO":
        return
    finite = (
        np.array([math.isfinite(t) for t in times])
        if times.dtype.kind == "O"
        else np.isfinite(times)
    )
    if not finite.all():
        i = int(np.argmin(finite))
        raise InputError(f"expected a finite time at event {i}{of_name}, got {shown(times[i])}")


def not_after(before: object, time: object, i: int, of_name: str) -> InputError:
    """The error that refuses a time which does not come after the one before it."""
    return InputError(
        f"expected a time after {shown(before)} at event {i}{of_name}, got {shown(time)}"
    )


def check_values(times: Times, values: Floats, of_name: str) -> None:
    """Refuse values that are nan."""
    missing = np.isnan(values)
    if missing.any():
        i = int(np.argmax(missing))
        raise InputError(
            f"event {i}{of_name}, at time {shown(times[i])}, is nan; "
            "leave it out: a value lasts until the next event"
        )
