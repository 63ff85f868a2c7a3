"""Signals over dense time: events, and the reader of those that a caller hands in.

Both back-ends use the reader: the machine in Python for all events, the one in C++ for the argument
forms that it does not read itself and for every error.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NoReturn, overload

import numpy as np
from numpy.typing import ArrayLike

from rtamt.errors import InputError, InputTypeError, StateError
from rtamt.inputs.messages import Messages
from rtamt.inputs.samples import (
    Floats,
    array_of_numbers,
    kind_of,
    line_of_numbers,
    listed,
    number,
    refuse_term,
    unknown_variable,
)
from rtamt.program.program import Program

__all__ = ["Column", "EventReader", "Events", "EventsLike"]

Column = tuple[Floats, Floats]
"""Times and values of one variable's events."""


class Events(Sequence[tuple[float, float]]):
    """A signal over dense time: each value lasts until the time of the next one.

    It is a sequence of (time, value), equal to any other sequence of the same pairs. The last event
    is the end of the signal.

    Args:
        times: n finite numbers that increase.
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

    __slots__ = ("_times", "_values")

    def __init__(self, times: ArrayLike, values: ArrayLike) -> None:
        self._times = _closed(times, "times")
        self._values = _closed(values, "values")
        if len(self._times) != len(self._values):
            raise InputError(
                f"expected as many values as times, got {len(self._values)} and {len(self._times)}"
            )
        _check(self._times, self._values, "", -math.inf)

    @property
    def times(self) -> Floats:
        """The times of the events, as a read-only array."""
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
            return Events(self.times[index], self.values[index])
        return float(self.times[index]), float(self.values[index])

    def __iter__(self) -> Iterator[tuple[float, float]]:
        return iter(zip(self.times.tolist(), self.values.tolist(), strict=True))

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

    def __reduce__(self) -> tuple[type[Events], Column]:
        return Events, (self.times, self.values)

    def __repr__(self) -> str:
        times, values = (reprlib.repr(a.tolist()) for a in (self.times, self.values))
        return f"Events({times}, {values})"


EventsLike = Events | ArrayLike | Iterable[Sequence[object]]
"""Events as a sequence of (time, value), as an array of shape (n, 2), or as `Events`."""


class EventReader:
    """Reads the events of a program's variables.

    Args:
        program: The events of its variables are read; its terms are named in errors.
    """

    __slots__ = ("_messages", "program", "variables")

    def __init__(self, program: Program) -> None:
        self.program = program
        self.variables = program.variables
        self._messages = Messages(program.specification, program.variables)

    def given(
        self, events: Sequence[Mapping[str, EventsLike]], named: Mapping[str, EventsLike]
    ) -> Mapping[str, EventsLike]:
        """The events of ``update(*events, **named)``: one mapping, or events by keyword.

        Raises:
            InputError: On both, or on several positional arguments.
        """
        if len(events) == 1 and not named:
            return events[0]
        if not events:
            return named
        raise InputError(
            "expected events as one mapping or by name, as in update(x=[(0.0, 1.5)]), got "
            f"{len(events)} by position and {len(named)} by name"
        )

    def read(self, events: Mapping[str, EventsLike], last: Sequence[float]) -> list[Column]:
        """The new events of every variable, in the order of the variables.

        Args:
            events: The new events by variable; a variable that is absent has none.
            last: Time of every variable's last event; -inf where there was none.

        Raises:
            InputError: On an unknown variable, times that do not increase, a nan, a wrong shape.
            InputTypeError: On events that are not a mapping, or values that are not real numbers.
        """
        named = self._named(events)
        for name in named:
            if name not in self.variables:
                raise unknown_variable(name, self.variables, self._messages)
        return [
            _column(named[name], name, after) if name in named else _NONE
            for name, after in zip(self.variables, last, strict=True)
        ]

    def whole(self, events: Mapping[str, EventsLike]) -> list[Column]:
        """All events of every variable, in the order of the variables; other names are ignored.

        It raises the errors of `read`, and an InputError on a variable without events.
        """
        named = self._named(events)
        columns = []
        for name in self.variables:
            column = _column(named[name], name, -math.inf) if name in named else _NONE
            if not len(column[0]):
                known = listed(self.variables)
                raise InputError(f"expected events of every variable, got none of '{name}'{known}")
            columns.append(column)
        return columns

    def refuse(self, values: Sequence[float], time: float) -> NoReturn:
        """Raise the error that names the first term which is nan at a time."""
        refuse_term(self.program, values, f"time {time!r}")

    def refuse_end(self, first: Sequence[float], last: Sequence[float]) -> NoReturn:
        """Raise the error of a trace that ends although at no time all variables were known.

        Args:
            first: Time of every variable's first event; inf where there was none.
            last: Time of every variable's last event; -inf where there was none.

        Raises:
            StateError: If a variable has no event yet.
            InputError: If there is no time at which all variables are known.
        """
        latest, earliest = max(first), min(last)
        ends = self.variables[list(last).index(earliest)]
        if math.isinf(earliest):
            raise StateError(
                f"finish() needs an event of every variable, got none of '{ends}' since reset"
            )
        begins = self.variables[list(first).index(latest)]
        raise InputError(
            f"expected signals that overlap in time, got '{ends}', which ends at {earliest!r}, "
            f"and '{begins}', which begins at {latest!r}"
        )

    def refuse_update(self) -> NoReturn:
        """Raise the error that refuses events after the end."""
        raise StateError("the trace is finished; call reset() before the next update")

    def _named(self, events: object) -> Mapping[str, object]:
        """The events by variable, with those of the fields in place of those of their messages."""
        if not isinstance(events, Mapping):
            raise InputTypeError(
                "expected a mapping of variables to events, as in {'x': [(0.0, 1.5)]}, "
                f"got {kind_of(events)}"
            )
        messages = self._messages.names & events.keys()
        if not messages:
            return events
        return self._messages.spread(
            {n: _messages(e, n) if n in messages else e for n, e in events.items()},
            lambda field, pairs: [(time, field.of(m, time, "time")) for time, m in pairs],
        )


def _closed(numbers: ArrayLike, name: str) -> Floats:
    """A read-only copy."""
    array = line_of_numbers(numbers, f"the {name} of events").copy()
    array.flags.writeable = False
    return array


_NOTHING = np.empty(0)
_NONE: Column = (_NOTHING, _NOTHING)


def _column(given: object, name: str, after: float) -> Column:
    """The events of a variable, all of which come after a time."""
    if isinstance(given, Events):
        times, values = given.times, given.values
    else:
        table = _table(given, name)
        times, values = (np.ascontiguousarray(column) for column in table.T)
    _check(times, values, f" of '{name}'", after)
    return times, values


def _table(given: object, name: str) -> Floats:
    """The events of a variable as an array of shape (n, 2)."""
    forms = (
        f"events of '{name}' as a sequence of (time, value), an array of shape (n, 2) or "
        "Events(times, values)"
    )
    if isinstance(given, np.ndarray):
        table = array_of_numbers(given, f"the events of '{name}'")
        if not table.size:
            return np.empty((0, 2))
    else:
        events = _listed(given, forms)
        try:
            table = np.array(events)
        except (ValueError, TypeError):  # pairs and others
            table = _NOTHING
        if table.dtype.kind not in "biuf" or table.ndim != 2:
            pairs = [_floats(event, i, name) for i, event in enumerate(events)]
            return np.array(pairs, np.float64).reshape(-1, 2)
    if table.ndim != 2 or table.shape[1] != 2:
        raise InputError(f"expected {forms}, got shape {table.shape}")
    return table.astype(np.float64, copy=False)


def _messages(given: object, name: str) -> list[list[object]]:
    """The events of a message, as pairs of time and message."""
    events = _listed(given, f"events of '{name}' as a sequence of (time, message)")
    return [_pair(event, "message", i, name) for i, event in enumerate(events)]


def _listed(given: object, forms: str) -> list[object]:
    # An object with keys iterates over the keys, or over values without times (a pandas column).
    if isinstance(given, str | bytes) or hasattr(given, "keys") or not isinstance(given, Iterable):
        raise InputTypeError(f"expected {forms}, got {kind_of(given)}")
    return list(given)


def _pair(event: object, what: str, i: int, name: str) -> list[object]:
    if isinstance(event, Sequence | np.ndarray) and not isinstance(event, str | bytes):
        parts = [] if isinstance(event, np.ndarray) and not event.ndim else list(event)
        if len(parts) == 2:
            return parts
    raise InputError(f"expected (time, {what}) as event {i} of '{name}', got {kind_of(event)}")


def _floats(event: object, i: int, name: str) -> list[float]:
    floats = []
    for what, part in zip(("time", "value"), _pair(event, "value", i, name), strict=True):
        read = number(part)
        if read is None:
            raise InputTypeError(
                f"expected a number as the {what} of event {i} of '{name}', got {kind_of(part)}"
            )
        floats.append(read)
    return floats


def _check(times: Floats, values: Floats, name: str, after: float) -> None:
    """Refuse times that are not finite or do not increase, and values that are nan.

    The InputError names the first such event.
    """
    finite = np.isfinite(times)
    if not finite.all():
        i = int(np.argmin(finite))
        raise InputError(f"expected a finite time at event {i}{name}, got {times[i].item()!r}")
    before = np.concatenate([[after], times[:-1]])
    late = times > before
    if not late.all():
        i = int(np.argmin(late))
        raise InputError(
            f"expected a time after {before[i].item()!r} at event {i}{name}, "
            f"got {times[i].item()!r}"
        )
    missing = np.isnan(values)
    if missing.any():
        i = int(np.argmax(missing))
        raise InputError(
            f"event {i}{name}, at time {times[i].item()!r}, is nan; "
            "leave it out: a value lasts until the next event"
        )
