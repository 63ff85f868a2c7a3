"""The machine over dense time in Python: the definition that the C++ machine is tested against."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.event_reader import Dated, EventReader, TimedColumn
from rtamt.inputs.events import EventsLike, GivenLike
from rtamt.machines.dense.declared import declared_of
from rtamt.machines.dense.streams import (
    Breakpoint,
    Joint,
    MapNode,
    StepStream,
    StreamNode,
    just_after,
)
from rtamt.machines.dense.windows import SuffixNode, WindowNode
from rtamt.machines.state import Retiring, StateFields
from rtamt.machines.terms import Registers, Terms
from rtamt.program.algebra import FOLDS
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.instructions import Map, Window

__all__ = ["PythonDenseMachine"]


class PythonDenseMachine(Retiring, StateFields):
    """Runs a program on events, in chunks of any size, each variable at its own pace.

    The trace begins with the latest of the variables' first events, and is known up to the earliest
    of their last events. Terms are computed wherever a variable has an event; then each register of
    a formula goes as far as its operands are known. The terms at the last known time wait: if no
    event follows, that time is the end of the trace, an instant; if one does, a step begins there.

    Args:
        dense: The program.
        reader: Turns arguments into events, and refuses them.
        observed: Registers whose values `values` lists.
    """

    STATE = ("finished", "_dated", "_first", "_last", "_begin", "_end", "_waits", "_parts")
    reader: EventReader
    finished: bool
    _dated: Dated
    _first: list[float]
    _last: list[float]
    _begin: float
    _end: float
    _waits: tuple[float, Registers] | None

    def __init__(self, dense: DenseProgram, reader: EventReader, observed: Sequence[int]) -> None:
        program = dense.program
        self.reader = reader
        self._observed = tuple(observed)
        self._result = program.result
        self._known = program.terms
        self._terms = Terms(program, reader.refuse)
        self._streams = [StepStream() for _ in program.instructions]
        self._nodes = [self._node(dense, r) for r in range(self._known, len(self._streams))]
        self._declared = declared_of(program)
        self._inputs = Joint(len(program.variables), self._declared.before)
        self._parts = [self._inputs, *self._streams, *self._nodes]
        self.reset()

    def _node(self, dense: DenseProgram, register: int) -> StreamNode:
        out = self._streams[register]
        match dense.program.formula(register):
            case Map(function, args):
                return MapNode(function, [self._streams[a] for a in args], out)
            case Window(name, lo, hi, args):
                streams = [self._streams[a] for a in args]
                begin = -math.inf if lo is None else lo
                if hi is None:
                    return SuffixNode(FOLDS[name], begin, streams, out)
                return WindowNode(FOLDS[name], begin, hi, streams, out)
            case _ as never:
                assert_never(never)

    @property
    def settled(self) -> float:
        tick = self._end if self.finished else self._streams[self._result].frontier
        return self.reader.time(tick, self._dated)

    @property
    def values(self) -> list[float]:
        return [self._streams[r].value for r in self._observed]

    def update(
        self, *events: Mapping[str, EventsLike], **named: EventsLike
    ) -> list[tuple[float, float]]:
        if self.finished:
            self.reader.refuse_update()
        given = self.reader.given(events, named)
        after = self._declared.after(self._first, self._last)
        columns, dated = self.reader.read(given, after, self._dated)
        self.require_current()
        if self.finished:  # by what a value runs when it is read
            self.reader.refuse_update()
        return self._with_times(self._take(columns, dated))

    def _with_times(self, steps: Sequence[Breakpoint]) -> list[tuple[float, float]]:
        return [(self.reader.time(tick, self._dated), value) for tick, value in steps]

    def _take(self, columns: Sequence[TimedColumn], dated: Dated) -> list[Breakpoint]:
        times = [t for t, _ in columns]
        first = [min((old, *t[:1].tolist())) for old, t in zip(self._first, times, strict=True)]
        last = [max((old, *t[-1:].tolist())) for old, t in zip(self._last, times, strict=True)]
        begin, end = self._declared.begin(first), self._declared.end(last)
        self._inputs.extend([zip(t.tolist(), v.tolist(), strict=True) for t, v in columns])
        try:
            rows = self._rows(begin, end, dated)
        except BaseException:
            self._inputs.retract([len(t) for t in times])
            raise
        self._first, self._last, self._begin, self._end = first, last, begin, end
        self._dated = dated
        while self._inputs.next <= end:
            self._inputs.take()
        if rows:
            if self._waits is not None:
                rows.insert(0, self._waits)
            self._waits = rows.pop()
        if not math.isinf(end):
            self._advance(rows)
        return self._settled_steps()

    def _rows(self, begin: float, end: float, dated: Dated) -> list[tuple[float, Registers]]:
        """The terms at all new times of the trace; changes nothing."""
        if begin > end:
            return []
        return [
            (time, self._terms(list(values), (time, dated)))
            for time, values in self._inputs.ahead(end)
            if time >= begin
        ]

    def _advance(self, rows: Sequence[tuple[float, Registers]]) -> None:
        self._push(rows, self._end)
        for node in self._nodes:
            node.advance(self._begin, self._end)

    def _push(self, rows: Sequence[tuple[float, Registers]], frontier: float) -> None:
        for register, stream in enumerate(self._streams[: self._known]):
            for time, terms in rows:
                stream.push(time, terms[register])
            stream.frontier = frontier

    def _settled_steps(self) -> list[Breakpoint]:
        settled = self._streams[self._result].new
        for stream in self._streams:
            stream.new = []
        return settled

    def finish(self) -> list[tuple[float, float]]:
        return self._with_times(self._finish())

    def _finish(self) -> list[Breakpoint]:
        if self.finished:
            return []
        if self._waits is None:
            self.reader.refuse_end(self._first, self._last, self._dated)
        self._push([self._waits], just_after(self._end))
        for node in self._nodes:
            node.finish(self._begin, self._end)
        self.finished = True
        return self._settled_steps()

    def run(self, given: Sequence[GivenLike]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        steps = self._take(*self.reader.counted(given, self._last, self._dated)) + self._finish()
        ticks, values = zip(*steps, strict=True)
        return self.reader.times(np.array(ticks, np.int64), self._dated), np.array(values)

    def reset(self) -> None:
        width = len(self.reader.variables)
        self.finished = False
        self._first, self._last = [math.inf] * width, [-math.inf] * width
        self._begin, self._end = math.inf, -math.inf
        self._waits = None
        self._dated = None
        for part in self._parts:
            part.reset()
