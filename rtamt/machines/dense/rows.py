"""The terms of a formula over the regions of a trace, from waiting events."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar, Generic, NamedTuple, NoReturn, TypeVar

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.inputs.clock import Ticks
from rtamt.inputs.event_reader import Dated, EventReader, TimedColumn
from rtamt.inputs.events import EventsLike, Given, not_known
from rtamt.inputs.samples import in_between
from rtamt.machines.dense.runs import Positions
from rtamt.machines.state import Retiring, StateFields
from rtamt.machines.terms import FindRanges
from rtamt.program.placement import variants_of
from rtamt.program.program import Program


class DeclaredValues:
    """The values of variables before their first events, and the resulting trace.

    Nothing waits for a variable with a declared value: the trace starts with the last first event
    of the others, and ends with the earliest last event of all that have one. If all variables have
    declared values, it starts with the first event of all.
    """

    __slots__ = ("_free", "before")

    def __init__(self, variables: Sequence[str], defaults: Mapping[str, float]) -> None:
        self.before = [defaults.get(name, math.nan) for name in variables]
        """The value of each variable before its first event; nan if none is declared."""
        self._free = [name in defaults for name in variables]

    def extended(
        self, first: Sequence[float], last: Sequence[float], columns: Sequence[TimedColumn]
    ) -> tuple[list[float], list[float], float, float]:
        """Return first and last ticks of variables after new events, and of the trace."""
        times = [ticks for ticks, _ in columns]
        begins = [min((old, *t[:1].tolist())) for old, t in zip(first, times, strict=True)]
        ends = [max((old, *t[-1:].tolist())) for old, t in zip(last, times, strict=True)]
        return begins, ends, self.begin(begins), self.end(ends)

    def begin(self, first: Sequence[float]) -> float:
        """Return the start of the trace."""
        awaited = [tick for tick, free in zip(first, self._free, strict=True) if not free]
        return max(awaited) if awaited else min(first)

    def end(self, last: Sequence[float]) -> float:
        """Return the last known tick."""
        ends = zip(last, self._free, strict=True)
        return min(
            (tick for tick, free in ends if not (free and math.isinf(tick))), default=-math.inf
        )

    def after(self, first: Sequence[float], last: Sequence[float]) -> list[float]:
        """Return the ticks after which the next events of each variable must come.

        A variable with only its declared value has it at all known ticks.
        """
        end = self.end(last)
        known = end if self.begin(first) <= end else -math.inf
        silent = [free and math.isinf(tick) for tick, free in zip(last, self._free, strict=True)]
        return [known if still else tick for tick, still in zip(last, silent, strict=True)]


def declared_of(program: Program) -> DeclaredValues:
    """Return the declared values of the variables of a program."""
    return DeclaredValues(program.variables, program.specification.defaults)


class Waiting(StateFields):
    """Events of a variable, and its value before them.

    They stay in their original arrays: the cost of a call depends on the new events and the events
    that it reads, not on the waiting events of a variable that runs ahead.
    """

    __slots__ = ("_before", "_chunks", "_declared")
    STATE = ("_chunks", "_before")

    def __init__(self, before: float = math.nan) -> None:
        self._declared = before
        self.reset()

    def reset(self) -> None:
        self._chunks: deque[TimedColumn] = deque()
        self._before: float | tuple[float, ...] = self._declared

    def extend(self, new: TimedColumn) -> None:
        """Add a copy of new events."""
        ticks, values = new
        if len(ticks):
            self._chunks.append((ticks.copy(), values.copy()))

    def retract(self, new: TimedColumn) -> None:
        """Remove the events that came last."""
        if len(new[0]):
            self._chunks.pop()

    def upto(self, last: int) -> TimedColumn:
        """Return the events up to a tick, with the previous value before their values."""
        times: list[Ticks] = []
        values: list[Floats] = [np.array([self._before])]
        for chunk in self._chunks:
            first, after = _divided(chunk, last)
            times.append(first[0])
            values.append(first[1])
            if len(after[0]):
                break
        ticks = times[0] if len(times) == 1 else np.concatenate([*times, _NO_TICKS])
        return ticks, _concatenated(values)

    def drop(self, last: int) -> None:
        """Forget the events up to a tick, except for the last value."""
        while self._chunks:
            first, after = _divided(self._chunks[0], last)
            if len(first[1]):
                value = first[1][-1].tolist()
                self._before = tuple(value) if isinstance(value, list) else value
            if len(after[0]):
                self._chunks[0] = after
                return
            self._chunks.popleft()


_Rows = TypeVar("_Rows")


class EventMachine(Retiring, StateFields, Generic[_Rows]):
    """The base of the Python machines on events, in chunks of any size."""

    STATE: ClassVar[tuple[str, ...]] = ("finished", "_dated", "_first", "_last", "_waiting")
    reader: EventReader
    finished: bool
    _dated: Dated
    _first: list[float]
    _last: list[float]

    def __init__(self, program: Program, reader: EventReader) -> None:
        self.reader = reader
        self._declared = declared_of(program)
        self._waiting = [Waiting(value) for value in self._declared.before]

    def _read(
        self, events: Sequence[Mapping[str, EventsLike]], named: Mapping[str, EventsLike]
    ) -> tuple[list[TimedColumn], Dated]:
        """Return the new events of an update, or refuse them."""
        if self.finished:
            self.reader.refuse_update()
        given = self.reader.given(events, named)
        after = self._declared.after(self._first, self._last)
        heard = [math.isfinite(tick) for tick in self._last]
        counted = self.reader.read(given, after, self._dated, heard)
        self.require_current()
        if self.finished:  # reading a value may run code of the caller
            self.reader.refuse_update()
        return counted

    def _extend(
        self, columns: Sequence[TimedColumn], dated: Dated
    ) -> tuple[float, float, list[_Rows]]:
        """Take new events; return begin and end of the trace, and the terms at its new ticks."""
        first, last, begin, end = self._declared.extended(self._first, self._last, columns)
        rows: list[_Rows] = []
        for waiting, column in zip(self._waiting, columns, strict=True):
            waiting.extend(column)
        if begin <= end:
            try:
                rows = self._rows(int(begin), int(end), dated)
            except BaseException:
                for waiting, column in zip(self._waiting, columns, strict=True):
                    waiting.retract(column)
                raise
        if not math.isinf(end):
            for waiting in self._waiting:
                waiting.drop(int(end))
        self._first, self._last, self._dated = first, last, dated
        return begin, end, rows

    def _rows(self, begin: int, end: int, dated: Dated) -> list[_Rows]:
        """Return the terms at all new ticks; changes nothing."""
        raise NotImplementedError

    def reset(self) -> None:
        width = len(self.reader.variables)
        self.finished = False
        self._dated = None
        self._first, self._last = [math.inf] * width, [-math.inf] * width
        for waiting in self._waiting:
            waiting.reset()


def _concatenated(values: Sequence[Floats]) -> Floats:
    """Return values one after the other: pairs of ends, if some are."""
    if any(column.ndim > 1 for column in values):
        values = [v if v.ndim > 1 else np.column_stack([v, v]) for v in values]
    return np.concatenate(values)


_NO_TICKS: Ticks = np.empty(0, np.int64)
_NO_EVENTS: TimedColumn = _NO_TICKS, np.empty(0)


def _divided(events: TimedColumn, last: int) -> tuple[TimedColumn, TimedColumn]:
    """Return the events up to a tick, and those after it."""
    ticks, values = events
    if ticks[-1] <= last:
        return events, _NO_EVENTS
    read = int(ticks.searchsorted(last, "right"))
    return (ticks[:read], values[:read]), (ticks[read:], values[read:])


def together(waiting: Sequence[Waiting], begin: int, last: int) -> tuple[Ticks, list[Floats]]:
    """Return the ticks from begin to last at which a variable has an event, and all values there.

    All variables have values at ``begin``: numbers, or pairs of ends.
    """
    signals = [variable.upto(last) for variable in waiting]
    ticks = signals[0][0]
    for i, (other, values) in enumerate(signals[1:], 1):
        if np.array_equal(ticks, other):
            signals[i] = ticks, values  # the same array, which `values_at` sees without a look
        else:
            both = np.concatenate([ticks, other])
            both.sort(kind="stable")  # two lines that are sorted, in linear time
            ticks = both[np.append(True, both[1:] != both[:-1])]
    if len(ticks) and ticks[0] < begin:
        ticks = ticks[ticks.searchsorted(begin) :]
    return ticks, [values_at(ticks, signal) for signal in signals]


def values_at(ticks: Ticks, signal: TimedColumn) -> Floats:
    """Return the values at ticks of a signal from `Waiting.upto`."""
    steps, values = signal
    if steps is ticks or (len(steps) == len(ticks) and np.array_equal(steps, ticks)):
        return values[1:]
    return values[steps.searchsorted(ticks, "right")]


class RegionRows(NamedTuple):
    """The terms from some positions on: for each its value from a position to the next."""

    positions: Positions
    terms: Sequence[Floats]

    def between(self, begin: int, end: int) -> RegionRows:
        """Return the rows after a position, up to another one."""
        first, after = self.positions.searchsorted((begin, end), "right")
        if after - first == len(self.positions):
            return self
        return RegionRows(self.positions[first:after], [a[first:after] for a in self.terms])


class TraceValues(NamedTuple):
    """The values of all variables at the ticks of events, each numbers or pairs of ends."""

    begin: int
    last: int
    ticks: Ticks
    values: Sequence[Floats]
    dated: Dated


def values_between(
    counted: tuple[Sequence[TimedColumn], Dated], trace: tuple[int, int]
) -> TraceValues:
    """Return the values of a whole trace between two ticks, from counted events."""
    columns, dated = counted
    begin, last = trace
    events = [Waiting() for _ in columns]
    for waiting, column in zip(events, columns, strict=True):
        waiting.extend(column)
    ticks, values = together(events, begin, last)
    if not len(ticks) or ticks[0] > begin:  # the trace begins with an event of another variable
        ticks = np.concatenate([[begin], ticks])
        values = [values_at(ticks, waiting.upto(last)) for waiting in events]
    return TraceValues(begin, last, ticks, values, dated)


class _Refusal(NamedTuple):
    """Raises the errors of terms at the ticks of a trace."""

    reader: EventReader
    trace: TraceValues

    def refuse_between(
        self, lower: Iterable[float], upper: Iterable[float], sample: int
    ) -> NoReturn:
        values = [in_between(*ends) for ends in zip(lower, upper, strict=True)]
        self.reader.refuse(values, (int(self.trace.ticks[sample]), self.trace.dated))


def rows_of(
    program: Program, trace: TraceValues, reader: EventReader, find: FindRanges
) -> list[RegionRows]:
    """Return the smallest terms of the variants of a program over a trace.

    With uncertain values the largest terms of the last variant follow.
    """
    lower = [v if v.ndim == 1 else np.ascontiguousarray(v[:, 0]) for v in trace.values]
    upper = [v if v.ndim == 1 else np.ascontiguousarray(v[:, 1]) for v in trace.values]
    refusal, n = _Refusal(reader, trace), len(trace.ticks)
    programs = variants_of(program)
    bounds = [find(p, refusal, range(p.terms), lower, upper, n) for p in programs]
    tables = [least for least, _ in bounds]
    if any(not_known(values).any() for values in trace.values):
        tables.append(bounds[-1][1])
    positions = 2 * (trace.ticks - trace.begin)
    return [RegionRows(positions, table) for table in tables]


def unknown_of(given: Sequence[Given], reader: EventReader) -> tuple[str, ...]:
    """Return the variables with unknown values in a whole trace."""
    if reader.max_gap is None and not any(
        values.ndim > 1 or np.isnan(values).any() for _, values, _ in given
    ):
        return ()
    columns, _ = reader.counted(given)
    begin = max(int(ticks[0]) for ticks, _ in columns)
    last = min(int(ticks[-1]) for ticks, _ in columns)
    names = []
    for name, (ticks, values) in zip(reader.variables, columns, strict=True):
        first, after = ticks.searchsorted((begin, last), "right")
        if not_known(values[first - 1 : after]).any():
            names.append(name)
    return tuple(names)
