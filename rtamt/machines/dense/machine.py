"""The machine over dense time in Python: the definition that tests compare the C++ machine with."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar, assert_never

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.event_reader import Dated, EventReader, TimedColumn
from rtamt.inputs.events import EventsLike, GivenLike
from rtamt.machines.dense.rows import EventMachine, together
from rtamt.machines.state import StateFields
from rtamt.machines.terms import Registers, Terms
from rtamt.program.algebra import FOLDS, FUNCTIONS, Element, LatticeFold
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.instructions import Map, Window

Breakpoint = tuple[float, float]
"""A tick and the value from there on. Ticks are whole numbers: an `int`, or inf or -inf."""
_Values = tuple[float, ...]


def just_after(tick: float) -> float:
    """Return the next tick; a stream with this frontier is known at the tick itself."""
    return tick + 1


class StepStream(StateFields):
    """The known values of a register.

    Attributes:
        new: The breakpoints of the present call of the machine.
        frontier: The time before which the register is known.
        value: The value just before the frontier; nan without one.
    """

    __slots__ = ("frontier", "new", "value")
    STATE = ("new", "frontier", "value")

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.new: list[Breakpoint] = []
        self.frontier = -math.inf
        self.value = math.nan

    def push(self, tick: float, value: float) -> None:
        """Set the value from a tick on; a change of the value or its sign is a breakpoint."""
        if value != self.value or math.copysign(1.0, value) != math.copysign(1.0, self.value):
            self.new.append((tick, value))
            self.value = value


class Joint(StateFields):
    """Queues of breakpoints of several streams, read in the order of time."""

    __slots__ = ("_now", "_waiting")
    STATE = ("_now", "_waiting")

    def __init__(self, width: int) -> None:
        self._waiting: list[deque[Breakpoint]] = [deque() for _ in range(width)]
        self.reset()

    def reset(self) -> None:
        for waiting in self._waiting:
            waiting.clear()
        self._now = [math.nan] * len(self._waiting)

    def extend(self, steps: Sequence[Iterable[Breakpoint]]) -> None:
        """Add new breakpoints of every stream."""
        for waiting, new in zip(self._waiting, steps, strict=True):
            waiting.extend(new)

    @property
    def next(self) -> float:
        """The time of the next breakpoint of any stream; inf if none waits."""
        return min((waiting[0][0] for waiting in self._waiting if waiting), default=math.inf)

    def take(self) -> _Values:
        """Remove the breakpoints of the next time; return all streams' values from then on."""
        time = self.next
        for i, waiting in enumerate(self._waiting):
            if waiting and waiting[0][0] == time:
                self._now[i] = waiting.popleft()[1]
        return tuple(self._now)


class StreamNode(StateFields):
    """Computes the stream of a register from the streams of its operands."""

    STATE: ClassVar[tuple[str, ...]] = ("_joint",)

    def __init__(self, args: Sequence[StepStream], out: StepStream) -> None:
        self._args, self._out = args, out
        self._joint = Joint(len(args))

    def reset(self) -> None:
        self._joint.reset()

    def advance(self, begin: float, known: float) -> None:
        """Advance as far as the operands are known, in a trace from ``begin`` to ``known``."""
        raise NotImplementedError

    def finish(self, begin: float, end: float) -> None:
        """Advance to the end of the trace; the operands are known up to there."""
        raise NotImplementedError

    def _collect(self) -> None:
        self._joint.extend([arg.new for arg in self._args])


class MapNode(StreamNode):
    """Applies a function to the operands' values at one time."""

    def __init__(self, function: str, args: Sequence[StepStream], out: StepStream) -> None:
        super().__init__(args, out)
        self._apply = FUNCTIONS[function].apply

    def advance(self, begin: float, known: float) -> None:  # noqa: ARG002 - as all nodes
        self._run(min(arg.frontier for arg in self._args))

    def finish(self, begin: float, end: float) -> None:  # noqa: ARG002
        self._run(just_after(end))

    def _run(self, before: float) -> None:
        self._collect()
        while (time := self._joint.next) < before:
            self._out.push(time, self._apply(*self._joint.take()))
        self._out.frontier = before


class WindowNode(StreamNode):
    """Folds the steps that a window meets.

    The step from t to t' meets the closed window from s + lo to s + hi if t <= s + hi and s + lo <
    t'. It enters at s = t - hi and leaves at s = t' - lo, and the fold is a right-continuous
    function of s. The last instant of the trace counts as a step without an end, except for windows
    that start after s: those are empty from ``end - lo`` on.
    """

    STATE = (*StreamNode.STATE, "_inside", "_begun")

    def __init__(
        self, fold: LatticeFold, lo: float, hi: float, args: Sequence[StepStream], out: StepStream
    ) -> None:
        super().__init__(args, out)
        self._lo, self._hi = lo, hi
        self._empty = fold.identity[-1]
        self._inside = Queue(fold, lo)
        self._begun = False

    def reset(self) -> None:
        super().reset()
        self._inside.reset()
        self._begun = False

    def advance(self, begin: float, known: float) -> None:
        self._collect()
        before = min(known, min(arg.frontier for arg in self._args) - self._hi)
        self._run(begin, before)
        self._out.frontier = before

    def finish(self, begin: float, end: float) -> None:
        self._collect()
        if self._lo > 0:
            empty = max(begin, end - self._lo)
            self._run(begin, empty)
            self._out.push(empty, self._empty)
        else:
            self._run(begin, just_after(end))

    def _run(self, begin: float, before: float) -> None:
        joint, inside = self._joint, self._inside
        while True:
            # The fold has a value at the start of the trace, even if the window is empty there.
            now = min(joint.next - self._hi, inside.leaves) if self._begun else begin
            if not now < before:
                break
            while joint.next - self._hi <= now:
                inside.push(joint.next, joint.take())
            while inside.leaves <= now:
                inside.pop()
            self._out.push(now, inside.value)
            self._begun = True


class Queue(StateFields):
    """The steps inside a window, first in, first out, in two stacks, and their fold.

    Without a begin, no step leaves, and only the fold is kept.

    ``_older`` has, for each of its steps, the fold of that step and the younger ones in ``_older``.
    When it is empty, the steps of ``_younger`` move there, each once (Tangwongsan, Hirzel and
    Schneider, "General incremental sliding-window aggregation", VLDB 2015).
    """

    STATE = ("_begins", "_older", "_younger", "_total")

    def __init__(self, fold: LatticeFold, lo: float) -> None:
        self._combine, self._identity = fold.combine, fold.identity
        self._lo = lo
        self.reset()

    def reset(self) -> None:
        self._begins: deque[float] = deque()
        self._older: list[Element] = []
        self._younger: list[Element] = []
        self._total = self._identity

    def push(self, begin: float, x: Element) -> None:
        """Add the next step."""
        if not math.isinf(self._lo):
            self._begins.append(begin)
            self._younger.append(x)
        self._total = self._combine(self._total, x)

    def pop(self) -> None:
        """Remove the oldest step."""
        if not self._older:
            fold = self._identity
            while self._younger:
                fold = self._combine(self._younger.pop(), fold)
                self._older.append(fold)
            self._total = self._identity
        self._older.pop()
        self._begins.popleft()

    @property
    def value(self) -> float:
        """The fold."""
        return self._combine(self._older[-1] if self._older else self._identity, self._total)[-1]

    @property
    def leaves(self) -> float:
        """The time at which the oldest step leaves; it ends at the start of the next one."""
        return self._begins[1] - self._lo if len(self._begins) > 1 else math.inf


class SuffixNode(StreamNode):
    """Folds all steps from s + lo to the end of the trace; known only after the end."""

    def __init__(
        self, fold: LatticeFold, lo: float, args: Sequence[StepStream], out: StepStream
    ) -> None:
        super().__init__(args, out)
        self._fold, self._lo = fold, lo

    def advance(self, begin: float, known: float) -> None:  # noqa: ARG002 - as all nodes
        self._collect()

    def finish(self, begin: float, end: float) -> None:
        self.advance(begin, end)
        steps: list[tuple[float, Element]] = []
        while (time := self._joint.next) <= end:
            steps.append((time, self._joint.take()))
        fold = self._fold.identity
        folds = [(end, fold[-1])] if self._lo > 0 else []  # windows after the end are empty
        for time, x in reversed(steps):
            fold = self._fold.combine(x, fold)
            folds.append((time, fold[-1]))
        # Several folds may have the same time, as at the start: the latest step counts.
        values = {max(begin, time - self._lo): value for time, value in reversed(folds)}
        for time, value in values.items():
            self._out.push(time, value)


class PythonDenseMachine(EventMachine[tuple[float, Registers]]):
    """Runs a program on events, in chunks of any size, each variable at its own pace.

    The trace starts with the latest of the variables' first events, and is known up to the earliest
    of their last events. Terms are computed at every event of a variable; then each register of a
    formula advances as far as its operands are known. The terms at the last known time wait:
    without another event, that time is the end of the trace, an instant; otherwise, a step starts
    there.
    """

    STATE = (*EventMachine.STATE, "_begin", "_end", "_waits", "_parts")
    _begin: float
    _end: float
    _waits: tuple[float, Registers] | None

    def __init__(self, dense: DenseProgram, reader: EventReader, observed: Sequence[int]) -> None:
        program = dense.program
        super().__init__(program, reader)
        self._observed = tuple(observed)
        self._result = program.result
        self._known = program.terms
        self._terms = Terms(program, reader.refuse)
        self._streams = [StepStream() for _ in program.instructions]
        self._nodes = [self._node(dense, r) for r in range(self._known, len(self._streams))]
        self._parts = [*self._streams, *self._nodes]
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
        return self._with_times(self._take(*self._read(events, named)))

    def _with_times(self, steps: Sequence[Breakpoint]) -> list[tuple[float, float]]:
        return [(self.reader.time(tick, self._dated), value) for tick, value in steps]

    def _take(self, columns: Sequence[TimedColumn], dated: Dated) -> list[Breakpoint]:
        self._begin, self._end, rows = self._extend(columns, dated)
        if rows:
            if self._waits is not None:
                rows.insert(0, self._waits)
            self._waits = rows.pop()
        if not math.isinf(self._end):
            self._advance(rows)
        return self._settled_steps()

    def _rows(self, begin: int, end: int, dated: Dated) -> list[tuple[float, Registers]]:
        ticks, values = together(self._waiting, begin, end)
        samples = zip(*(column.tolist() for column in values), strict=True)
        return [
            (tick, self._terms(list(sample), (tick, dated)))
            for tick, sample in zip(ticks.tolist(), samples, strict=True)
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
        super().reset()
        self._begin, self._end = math.inf, -math.inf
        self._waits = None
        for part in self._parts:
            part.reset()
