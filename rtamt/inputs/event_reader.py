"""Reads the events of callers.

Both back-ends use it: the Python machine for all events, the C++ machine for rare argument forms
and for every error.
"""

from __future__ import annotations

import copy
import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Final, NoReturn

import numpy as np

from rtamt.errors import Argument, InputError, InputTypeError, Message, StateError, brief, no_such
from rtamt.inputs.arrays import Floats, array_of_numbers, kind_of, number
from rtamt.inputs.between import UncertainValue
from rtamt.inputs.clock import EXACT, Clock, Ticks, Times, shown
from rtamt.inputs.events import (
    Events,
    EventsLike,
    Given,
    GivenLike,
    are_dates,
    as_ends,
    check_times,
    check_values,
    not_after,
)
from rtamt.inputs.messages import Messages
from rtamt.inputs.samples import (
    NanPolicy,
    check_near,
    ends_of,
    listed,
    refuse_term,
    unknown_variable,
)
from rtamt.program.dense_lowering import MAX_TICKS, DenseProgram, duration_text

NO_DENSE_BOUNDS: Final = (
    "rtamt.dense.EpisodeMonitor and rtamt.dense.judge give bounds; others give one number a time"
)
"""Why other monitors refuse uncertain events."""

TimedColumn = tuple[Ticks, Floats]
"""Times in ticks and values of one variable's events: numbers, or pairs as in `Given`."""
Dated = bool | None
"""Whether times are `numpy.datetime64`; None before the first event."""


class EventReader:
    """Reads the events of a program's variables, and counts their times in ticks.

    More than ``max_gap`` ticks between neighbouring events of a variable are a gap. With ``bounds``
    the monitor returns bounds, and values may be uncertain.

    Attributes:
        unknown: Whether it may return uncertain values.
    """

    __slots__ = (
        "_messages",
        "bounds",
        "clock",
        "max_gap",
        "nan",
        "program",
        "unknown",
        "variables",
    )

    def __init__(
        self,
        dense: DenseProgram,
        nan: NanPolicy = "raise",
        max_gap: int | None = None,
        *,
        bounds: bool = False,
    ) -> None:
        program = dense.program
        self.nan: NanPolicy = nan
        self.max_gap = max_gap
        self.bounds = bounds
        self.unknown = nan == "unknown" or max_gap is not None
        self.clock = Clock(dense)
        self.program = program
        self.variables = program.variables
        self._messages = Messages(program.specification, program.variables)

    def with_clock(self, clock: Clock) -> EventReader:
        """Return the same reader with another clock of the same ticks."""
        reader = copy.copy(self)
        reader.clock = clock
        return reader

    def of(self, dense: DenseProgram) -> EventReader:
        """Return a reader for another program, with the same options."""
        reader = EventReader(dense, self.nan, self.max_gap, bounds=self.bounds)
        reader.unknown = self.unknown
        return reader

    def given(
        self, events: Sequence[Mapping[str, EventsLike]], named: Mapping[str, EventsLike]
    ) -> Mapping[str, EventsLike]:
        """Return the events of ``update(*events, **named)``: one mapping, or events by keyword."""
        if len(events) == 1 and not named:
            return events[0]
        if not events:
            return named
        raise InputError(
            "expected events as one mapping or by name, as in update(x=[(0.0, 1.5)]), got "
            f"{len(events)} by position and {len(named)} by name"
        )

    def read(
        self,
        events: Mapping[str, EventsLike],
        last: Sequence[float],
        dated: Dated,
        heard: Sequence[bool] = (),
    ) -> tuple[list[TimedColumn], Dated]:
        """Return the new events of every variable, in the order of the variables.

        ``last`` has the tick of every variable's last event, -inf without one, and ``heard``
        whether that event was its own, not its default. The second result states whether the times
        are dates.
        """
        named = self._named(events)
        for name in named:
            if name not in self.variables:
                raise unknown_variable(name, self.variables, self._messages)
        columns = [_read(named[v], v) if v in named else _NONE for v in self.variables]
        return self.counted(columns, last, dated, heard)

    def whole(self, events: Mapping[str, EventsLike]) -> list[Given]:
        """Return all events of every variable, as they were passed; other names are ignored.

        A variable with a default has it from the first event of all to its own first one.
        `counted` counts the times, and refuses wrong signals.
        """
        named = self._named(events)
        columns = {v: _read(named[v], v) if v in named else _NONE for v in self.variables}
        defaults = self.program.specification.defaults
        absent = {v: value for v, value in defaults.items() if v in columns and v not in named}
        check_near("signal", absent, named.keys() - columns.keys() - self._messages.names)
        times = [column.times for column in columns.values() if len(column.times)]
        for name, column in columns.items():
            if not len(column.times) and not (times and name in defaults):
                if events and name not in named:
                    raise InputError(no_such("signal", name, events))
                known = listed(self.variables)
                raise InputError(f"expected events of every variable, got none of '{name}'{known}")
        if self.bounds and any(column.values.ndim > 1 for column in columns.values()):
            self.unknown = True
        return [
            _started(column, defaults[name], times) if name in defaults else column
            for name, column in columns.items()
        ]

    def held(self, given: Sequence[Given], until: object) -> list[Given]:
        """Append an event at a time to each variable that ends before it.

        The event has the last value of the variable, or is unknown if it comes more than
        ``max_gap`` after the last event. A declared default lasts for any time.
        """
        columns, dated = self.counted(given)
        lasts = [int(ticks[-1]) for ticks, _ in columns]
        if isinstance(until, str) and until == "latest":
            end = max(lasts)
            time = given[lasts.index(end)].times[-1]
        else:
            time = _until(until, dated=bool(dated))
            end = int(self.clock.ticks(_line_of(time), " (until)")[0])
        if end < min(lasts):
            name = self.variables[lasts.index(min(lasts))]
            raise InputError(
                f"expected until= at {shown(self.time(min(lasts), dated))} or later, where "
                f"'{name}' has its last event, got {shown(time)}; leave out the events after it to "
                "end the trace earlier"
            )
        return [
            column if end <= last else self._held(column, time, end - last)
            for column, last in zip(given, lasts, strict=True)
        ]

    def _held(self, column: Given, time: object, ticks: int) -> Given:
        """Return the events of a variable, with one more some ticks after the last."""
        times, values, declared = column
        own = len(times) > declared
        value = values[-1:]
        if own and self.max_gap is not None and ticks > max(self.max_gap, 1):
            values = values if values.ndim > 1 else np.column_stack([values, values])
            value = np.array([[-np.inf, np.inf]])
        return Given(
            _with_time(times, time),
            np.concatenate([values, value]),
            declared if own else declared + 1,
        )

    def early_end(self, given: Sequence[Given]) -> str:
        """Describe a variable that ends the trace before others do; empty if none does."""
        columns, dated = self.counted(given)
        lasts = [int(ticks[-1]) for ticks, _ in columns]
        end = min(lasts)
        later = sum(len(ticks) - int(ticks.searchsorted(end, "right")) for ticks, _ in columns)
        if not later:
            return ""
        name = self.variables[lasts.index(end)]
        events = "1 later event" if later == 1 else f"{later} later events"
        return (
            f"the trace ends at time {_brief_time(self.time(end, dated))} with the last event of "
            f"'{name}' and leaves out {events}; until=\"latest\" holds its value"
        )

    def counted(
        self,
        given: Sequence[GivenLike],
        last: Sequence[float] | None = None,
        dated: Dated = None,
        heard: Sequence[bool] = (),
    ) -> tuple[list[TimedColumn], Dated]:
        """Return the events of every variable with times in ticks, as `read`; by default, all.

        A gap starts with an unknown event one tick after the previous event.
        """
        columns = []
        last = [-math.inf] * len(given) if last is None else last
        own = heard or [False] * len(last)
        for name, events, after, heard_before in zip(self.variables, given, last, own, strict=True):
            times, values, declared = Given(*events)
            of_name = f" of '{name}'"
            if len(times):
                dates = are_dates(times)
                if dated not in (None, dates):
                    _refuse_kind(times[0], 0, of_name)
                dated = dates
            check_times(times, of_name)
            ticks = self.clock.ticks(times, of_name)
            self._check_order(times, ticks, of_name, after)
            column = ticks, self._values(times, values, of_name)
            if self.max_gap is not None and len(ticks):
                before = int(after) if heard_before else None
                column = _with_holes(column, self.max_gap, before, declared)
            columns.append(column)
        return columns, dated

    def _values(self, times: Times, values: Floats, of_name: str) -> Floats:
        """Return the values after the nan policy, or refuse them."""
        if self.nan == "unknown":
            ends = values if values.ndim > 1 else values[:, None]
            missing = np.isnan(ends)
            if missing.any():
                return as_ends(
                    np.where(missing, -np.inf, ends)[:, 0], np.where(missing, np.inf, ends)[:, -1]
                )
        known: Message = Message() if self.bounds else Message(NO_DENSE_BOUNDS)
        if self.bounds and not self.unknown:
            known = Message("pass ", Argument("nan", "unknown"), " to take it")
        check_values(times, values, of_name, known, bounds=self.bounds)
        return values

    def _check_order(self, times: Times, ticks: Ticks, of_name: str, after: float) -> None:
        if not len(ticks):
            return
        late = ticks[1:] > ticks[:-1]
        if ticks[0] > after and late.all():
            return
        i = 0 if not ticks[0] > after else int(np.argmin(late)) + 1
        before = self.clock.time(int(after), dated=are_dates(times)) if i == 0 else times[i - 1]
        error = not_after(before, times[i], i, of_name)
        raise InputError(error, self.clock.same_tick(_item(before), _item(times[i])))

    def time(self, tick: float, dated: Dated) -> float:
        """Return the time of a tick; inf and -inf stay as they are."""
        return tick if math.isinf(tick) else self.clock.time(int(tick), dated=bool(dated))

    def times(self, ticks: Ticks, dated: Dated) -> Floats:
        """Return the times of ticks."""
        return self.clock.times(ticks, dated=bool(dated))

    def refuse(
        self, values: Sequence[float | UncertainValue], place: tuple[float, Dated]
    ) -> NoReturn:
        """Raise the error about the first term which is nan; the place is a tick and `Dated`."""
        refuse_term(self.program, values, f"time {shown(self.time(*place))}")

    def refuse_end(self, first: Sequence[float], last: Sequence[float], dated: Dated) -> NoReturn:
        """Raise the error of a trace that ends with no time at which all variables are known."""
        defaults = self.program.specification.defaults
        spans = list(zip(self.variables, first, last, strict=True))
        awaited = [span for span in spans if not (span[0] in defaults and math.isinf(span[2]))]
        ends, _, earliest = min(awaited or spans, key=lambda span: span[2])
        if math.isinf(earliest):
            raise StateError(
                f"finish() needs an event of every variable, got none of '{ends}' since reset"
            )
        others = [span for span in spans if span[0] not in defaults]
        begins, latest, _ = max(others, key=lambda span: span[1])
        raise InputError(
            f"expected signals that overlap in time, got '{ends}', which ends at "
            f"{shown(self.time(earliest, dated))}, and '{begins}', which begins at "
            f"{shown(self.time(latest, dated))}"
        )

    def refuse_length(self, length: int) -> NoReturn:
        """Raise the error of a trace with too many ticks, with the bounds of the formula."""
        resolution = coarser = self.clock.resolution
        while length * resolution >= MAX_TICKS * coarser:
            coarser *= 10
        raise InputError(
            "expected a trace that lasts less than 2**62 ticks of "
            f"{duration_text(resolution)} with the bounds of the formula, got {length}; "
            f"resolution={duration_text(coarser)!r} would do"
        )

    def refuse_update(self) -> NoReturn:
        """Raise the error about events after the end."""
        raise StateError("the trace is finished; call reset() before the next update")

    def _named(self, events: object) -> Mapping[str, object]:
        """Return the events by variable; events of a message become events of its fields."""
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


_NOTHING = np.empty(0)
_NONE = Given(_NOTHING, _NOTHING)


def checked_nan(nan: object) -> NanPolicy:
    """Return the policy for a nan among events."""
    if nan == "raise":
        return "raise"
    if nan == "unknown":
        return "unknown"
    hold = "; leave events without a value out: a value lasts until the next event"
    raise InputError(
        f"expected nan='raise' or nan='unknown', got {brief(nan)}{hold if nan == 'hold' else ''}"
    )


def _until(until: object, *, dated: bool) -> object:
    """Return the end of the last values, as a time of the same kind as the events."""
    if isinstance(until, str):
        raise InputError(f"expected until= as a time or 'latest', got {brief(until)}")
    if isinstance(until, np.datetime64):
        time: object = until
        fine = dated and not np.isnat(until)
    else:
        if isinstance(until, bool | np.bool_) or number(until) is None:
            raise InputTypeError(f"expected until= as a time or 'latest', got {kind_of(until)}")
        time = _time(until, 0, "until")
        fine = not dated and math.isfinite(time)  # type: ignore[arg-type]  # it is a number
    if not fine:
        wanted = "a datetime64, like the times of the events" if dated else "a finite number"
        raise InputError(f"expected until= as {wanted}, got {shown(until)}")
    return time


def _line_of(time: object) -> Times:
    """Return one time as an array that keeps it exact."""
    if isinstance(time, np.datetime64):
        return np.array([time])
    line: Times = np.empty(1, object)
    line[0] = time
    return line


def _with_time(times: Times, time: object) -> Times:
    """Return times with another one after them, none of them rounded."""
    if times.dtype.kind == "M" or isinstance(time, np.datetime64):
        return np.append(times, _line_of(time))
    if times.dtype.kind == "f" and isinstance(time, float):
        return np.append(times, time)
    line: Times = np.empty(len(times) + 1, object)
    line[:-1] = times.tolist()
    line[-1] = _item(time)
    return line


def _brief_time(time: object) -> str:
    """Return a time as the text of a judgement shows it: 4, not 4.0."""
    return str(time) if isinstance(time, np.datetime64) else f"{time:.15g}"


def _with_holes(column: TimedColumn, most: int, before: int | None, declared: int) -> TimedColumn:
    """Return the events of a variable with unknown events in its gaps.

    ``before`` is the tick of the previous event. The first ``declared`` events are defaults, which
    leave no gap.
    """
    ticks, values = column
    gaps = np.diff(ticks, prepend=ticks[0] if before is None else before)
    places = np.flatnonzero(gaps > max(most, 1))
    places = places[places >= declared + (declared > 0)]
    if not len(places):
        return column
    ends = values if values.ndim > 1 else np.column_stack([values, values])
    return (
        np.insert(ticks, places, ticks[places] - gaps[places] + 1),
        np.insert(ends, places, [-np.inf, np.inf], axis=0),
    )


def _started(column: Given, default: float, given: Sequence[Times]) -> Given:
    """Return the events of a variable with its default before its first event."""
    times, values, _ = column
    same_kind = [line for line in given if are_dates(line) == are_dates(given[0])]
    first, last = min(line[0] for line in same_kind), max(line[-1] for line in same_kind)
    if not len(times):
        ends = [first] if first == last else [first, last]
        return Given(np.array(ends), np.full(len(ends), default), len(ends))
    if are_dates(times) != are_dates(given[0]) or not first < times[0]:
        return column
    before = np.full((1, *values.shape[1:]), default)
    return Given(np.append(np.array([first]), times), np.concatenate([before, values]), 1)


def _read(events: object, name: str) -> Given:
    """Return the events of a variable, as arrays of times and values."""
    if isinstance(events, Events):
        return events.given
    forms = (
        f"events of '{name}' as a sequence of (time, value), an array of shape (n, 2) or "
        "Events(times, values)"
    )
    if isinstance(events, np.ndarray):
        table = array_of_numbers(events, f"the events of '{name}'")
        if not table.size:
            return _NONE
        times: Times = events if type(events) is np.ndarray and events.dtype.kind in "iu" else table
    else:
        pairs = _listed(events, forms)
        try:
            table = np.array(pairs)
        except (ValueError, TypeError, OverflowError):  # pairs and others
            table = _NOTHING
        if table.dtype.kind not in "biuf" or table.ndim != 2:
            return _pairs(pairs, name)
        if table.shape[1] == 2 and np.any(np.abs(table[:, 0]) >= EXACT):
            # numpy rounds large integers next to doubles.
            return _pairs(pairs, name)
        times = table
    if table.ndim != 2 or table.shape[1] != 2:
        raise InputError(f"expected {forms}, got shape {table.shape}")
    values = table[:, 1].astype(np.float64, copy=False)
    return Given(np.ascontiguousarray(times[:, 0]), np.ascontiguousarray(values))


def _pairs(events: Sequence[object], name: str) -> Given:
    """Return the events of a variable one by one, with times of any kind."""
    times, values = [], []
    for i, event in enumerate(events):
        time, value = _pair(event, "value", i, name)
        times.append(_time(time, i, name))
        values.append(_ends(value, i, name))
    dates = [isinstance(time, np.datetime64) for time in times]
    if any(dates) and not all(dates):
        i = dates.index(not dates[0])
        _refuse_kind(times[i], i, f" of '{name}'")
    line: Times = np.array(times) if any(dates) else np.empty(len(times), object)
    if not any(dates):
        line[:] = times
        if all(type(time) is float for time in times):
            line = line.astype(np.float64)
    ends = np.array(values, np.float64).reshape(len(values), 2)
    return Given(line, as_ends(*ends.T.copy()))


def _refuse_kind(time: object, i: int, of_name: str) -> NoReturn:
    """Raise the error about a date among numbers as times, or a number among dates."""
    dated = isinstance(time, np.datetime64)
    raise InputError(
        f"expected {'a number' if dated else 'datetime64'} as the time of event {i}{of_name}, "
        f"as before, got {'datetime64 ' if dated else ''}{shown(time)}"
    )


def _messages(events: object, name: str) -> list[list[object]]:
    """Return the events of a message, as pairs of time and message."""
    events = _listed(events, f"events of '{name}' as a sequence of (time, message)")
    return [_pair(event, "message", i, name) for i, event in enumerate(events)]


def _listed(argument: object, forms: str) -> list[object]:
    # An object with keys iterates over the keys, or over values without times (a pandas column).
    if (
        isinstance(argument, str | bytes)
        or hasattr(argument, "keys")
        or not isinstance(argument, Iterable)
    ):
        raise InputTypeError(f"expected {forms}, got {kind_of(argument)}")
    return list(argument)


def _pair(event: object, what: str, i: int, name: str) -> list[object]:
    if isinstance(event, Sequence | np.ndarray) and not isinstance(event, str | bytes):
        parts = [] if isinstance(event, np.ndarray) and not event.ndim else list(event)
        if len(parts) == 2:
            return parts
    raise InputError(f"expected (time, {what}) as event {i} of '{name}', got {kind_of(event)}")


def _time(part: object, i: int, name: str) -> object:
    """Return a date, a rational number or a float."""
    if isinstance(part, np.datetime64):
        return part
    if isinstance(part, np.integer):
        return int(part)
    if isinstance(part, numbers.Rational):
        return Fraction(part)
    return _number(part, "time", i, name)


def _ends(part: object, i: int, name: str) -> tuple[float, float]:
    """Return the smallest and the largest possible value."""
    if isinstance(part, UncertainValue) and isinstance(part.lower, float):
        return ends_of(part)
    return (_number(part, "value", i, name),) * 2


def _number(part: object, what: str, i: int, name: str) -> float:
    read = number(part)
    if read is None:
        raise InputTypeError(
            f"expected a number as the {what} of event {i} of '{name}', got {kind_of(part)}"
        )
    return read


def _item(time: object) -> object:
    """Return a Python number, or a date."""
    return time.item() if isinstance(time, np.floating | np.integer) else time
