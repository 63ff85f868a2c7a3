"""Signals over dense time: events."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Literal, NamedTuple, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import Advice, Argument, InputError, Message
from rtamt.inputs.arrays import Floats, line_of_numbers
from rtamt.inputs.between import UncertainValue, identical
from rtamt.inputs.clock import Times, shown


class Given(NamedTuple):
    """Events of one variable as the caller passed them.

    Attributes:
        times: The times.
        values: n numbers or, if not all are known, n pairs of smallest and largest ones.
        declared: How many of the first events are the variable's declared default.
    """

    times: Times
    values: Floats
    declared: int = 0


GivenLike = Given | tuple[Times, Floats]


class Events(Sequence[tuple[float, Any]]):
    """A signal over dense time: each value lasts until the time of the next one.

    It is a sequence of (time, value), equal to any other sequence of the same pairs; an uncertain
    value is an `UncertainValue`. The last event is the end of the signal.

    Args:
        times: n finite numbers, or n `numpy.datetime64`, that increase.
        values: n numbers, or an `UncertainValue` of arrays for uncertain values; +-inf is legal.
            ``nan="unknown"`` takes a nan; other policies refuse it.

    Raises:
        InputError: If times do not increase, or the arrays have different lengths.
        InputTypeError: If values are not real numbers.

    Example:
        >>> from rtamt.dense import Events
        >>> speed = Events([0, 1.5, 4], [10, 12, 11])
        >>> speed[1], len(speed), speed == [(0, 10), (1.5, 12), (4, 11)]
        ((1.5, 12.0), 3, True)
        >>> speed.values
        array([10., 12., 11.])
    """

    __slots__ = ("_given", "_times", "_values")

    def __init__(self, times: ArrayLike, values: ArrayLike | UncertainValue) -> None:
        self._hold(_line_of_times(times), _line_of_values(values))
        if len(self._given) != len(self._values):
            raise InputError(
                f"expected as many values as times, got {len(self._values)} and {len(self._given)}"
            )
        check_times(self._given, "")
        late = self._given[1:] > self._given[:-1]
        if not late.all():
            i = int(np.argmin(late))
            raise not_after(self._given[i], self._given[i + 1], i + 1, "")

    @classmethod
    def unchecked(cls, times: Times, values: Floats) -> Self:
        """Return the events of arrays that nobody else changes.

        The times of a result increase, but neighbouring times may be equal as doubles.
        """
        events = cls.__new__(cls)
        cls._hold(events, times, values)
        return events

    def _hold(self, times: Times, values: Floats) -> None:
        self._given, self._values = _locked(times), _locked(values)
        self._times = _as_doubles(self._given)

    @property
    def given(self) -> Given:
        """Times and values as they were passed: integers are exact, whatever their size."""
        return Given(self._given, self._values)

    @property
    def times(self) -> Floats:
        """The times of the events, as a read-only array of numbers or dates."""
        return self._times

    @property
    def values(self) -> Floats:
        """The values of the events, as a read-only array; the smallest of uncertain ones."""
        return self._values if self._values.ndim == 1 else self._values[:, 0]

    @property
    def upper(self) -> Floats:
        """The largest values of the events; `values` if all are known."""
        return self._values if self._values.ndim == 1 else self._values[:, 1]

    def __len__(self) -> int:
        return len(self.times)

    @overload
    def __getitem__(self, index: int) -> tuple[float, Any]: ...
    @overload
    def __getitem__(self, index: slice) -> Events: ...
    def __getitem__(self, index: int | slice) -> tuple[float, Any] | Events:
        if isinstance(index, slice):
            if (index.step or 1) < 0:
                return Events(self._given[index], self._values[index])
            return self.unchecked(self._given[index], self._values[index])
        time = self.times[index]
        return time if are_dates(self.times) else float(time), _value(self._values[index].tolist())

    def __iter__(self) -> Iterator[tuple[float, Any]]:
        times = self.times if are_dates(self.times) else self.times.tolist()
        return iter(zip(times, map(_value, self._values.tolist()), strict=True))

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Events):
            return np.array_equal(self.times, other.times) and all(
                np.array_equal(mine, theirs, equal_nan=True)
                for mine, theirs in ((self.values, other.values), (self.upper, other.upper))
            )
        if isinstance(other, str | bytes) or not isinstance(other, Sequence | np.ndarray):
            return NotImplemented
        return len(self) == len(other) and all(
            isinstance(pair, Sequence | np.ndarray) and mine == tuple(pair)
            for mine, pair in zip(self, other, strict=True)
        )

    __hash__ = None  # type: ignore[assignment] # lists without a hash may be equal

    def __reduce__(self) -> tuple[Callable[[Times, Floats], Events], tuple[Times, Floats]]:
        return self.unchecked, (self._given, self._values)

    def __repr__(self) -> str:
        times = (self.times[:7].astype(str) if are_dates(self.times) else self.times).tolist()
        values = _brief.repr(self.values.tolist())
        if self._values.ndim > 1:
            values = f"UncertainValue({values}, {_brief.repr(self.upper.tolist())})"
        return f"Events({_brief.repr(times)}, {values})"


_brief = reprlib.Repr()
_brief.maxstring = 40  # a date to the attosecond has 38 characters


EventsLike = Events | ArrayLike | Iterable[Sequence[object]]
"""Events as a sequence of (time, value), an array of shape (n, 2), or `rtamt.dense.Events`."""

Until = float | np.datetime64 | Literal["latest"]
"""The time up to which the last values hold; ``"latest"``: the time of the last event of all."""


def _line_of_times(times: ArrayLike) -> Times:
    """Return a copy of numbers or dates in one dimension; integers stay integers."""
    if are_dates(array := np.asarray(times)) and array.ndim == 1:
        return array.copy()
    line = line_of_numbers(times, "the times of events")
    return np.array(times) if array.dtype.kind in "iu" else line.copy()


def _line_of_values(values: object) -> Floats:
    """Return a copy of numbers in one dimension, or of pairs of ends."""
    if isinstance(values, UncertainValue):
        lower, upper = (
            line_of_numbers(end, "the values of events") for end in (values.lower, values.upper)
        )
        return as_ends(lower, upper)
    return line_of_numbers(values, "the values of events").copy()


def as_ends(lower: Floats, upper: Floats) -> Floats:
    """Return the values between two arrays: one column if all are known."""
    return lower.copy() if identical(lower, upper) else np.column_stack([lower, upper])


def not_known(values: Floats) -> NDArray[np.bool_]:
    """Return which values are uncertain: their ends differ in a bit."""
    if values.ndim == 1:
        return np.zeros(len(values), np.bool_)
    bits = np.ascontiguousarray(values).view(np.int64)
    differ: NDArray[np.bool_] = bits[:, 0] != bits[:, 1]
    return differ


def _value(ends: float | list[float]) -> float | UncertainValue:
    """Return the value of an event from a number or two ends."""
    if not isinstance(ends, list):
        return ends
    lower, upper = ends
    same = not lower < upper and math.copysign(1.0, lower) == math.copysign(1.0, upper)
    return lower if same else UncertainValue(lower, upper)


def _locked(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


def are_dates(times: Times) -> bool:
    """Return whether times are `numpy.datetime64`."""
    return times.dtype.kind == "M"


def _as_doubles(times: Times) -> Times:
    """Return numbers as doubles, and dates as they are."""
    return times if times.dtype.kind in "Mf" else _locked(times.astype(np.float64))


def check_times(times: Times, of_name: str) -> None:
    """Check that times are finite."""
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
    """Return the error about a time that is not after the previous one."""
    return InputError(
        f"expected a time after {shown(before)} at event {i}{of_name}, got {shown(time)}"
    )


def check_values(
    times: Times, values: Floats, of_name: str, known: Message, *, bounds: bool
) -> None:
    """Check that no value is nan and, with a reason ``known``, that every value is known.

    ``bounds`` adds the advice that a nan may be an unknown value.
    """
    missing = np.isnan(values if values.ndim == 1 else values[:, 0])
    if missing.any():
        i = int(np.argmax(missing))
        out = "; leave it out: a value lasts until the next event"
        advice = Advice(", or pass ", Argument("nan", "unknown")) if bounds else Message()
        raise InputError(f"event {i}{of_name}, at time {shown(times[i])}, is nan{out}", advice)
    if known and values.ndim > 1:
        i = int(np.argmax(not_known(values)))
        raise InputError(
            f"expected a value that is known at event {i}{of_name}, got "
            f"{_value(values[i].tolist())!r}; ",
            known,
        )
