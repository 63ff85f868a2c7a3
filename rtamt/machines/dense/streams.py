"""Streams over dense time, and the nodes that make one stream from others.

A stream is a right-continuous step function of time, which is counted in ticks. It is given by its
breakpoints: from a breakpoint (time, value) to the next it has that value, which is called a step.
It is known before its *frontier*. A node takes in new breakpoints, and goes as far as the frontiers
of its operands allow: the breakpoints that it makes do not depend on how events were divided into
calls.
"""

from __future__ import annotations

import heapq
import itertools
import math
import operator
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import ClassVar

from rtamt.machines.state import StateFields
from rtamt.program.algebra import FUNCTIONS

__all__ = ["Breakpoint", "Joint", "MapNode", "StepStream", "StreamNode", "just_after"]

Breakpoint = tuple[float, float]
"""A tick and the value from there on. Ticks are whole numbers: an `int`, or inf or -inf."""
_Values = tuple[float, ...]


def just_after(tick: float) -> float:
    """The next tick; a stream with this frontier is known at the tick itself."""
    return tick + 1


class StepStream(StateFields):
    """The value of a register as far as it is known.

    Attributes:
        new: The breakpoints that the present call of the machine has added.
        frontier: The time before which the register is known.
        value: The value just before the frontier; nan where there is none.
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
        """Take in the value from a tick on; it makes a breakpoint if it or its sign differs."""
        if value != self.value or math.copysign(1.0, value) != math.copysign(1.0, self.value):
            self.new.append((tick, value))
            self.value = value


class Joint(StateFields):
    """Queues of breakpoints of several streams, which are read in the order of time.

    Args:
        width: The number of streams.
        before: The value of each before its first breakpoint; none if it is not given.
    """

    __slots__ = ("_before", "_now", "_waiting")
    STATE = ("_now", "_waiting")

    def __init__(self, width: int, before: Sequence[float] | None = None) -> None:
        self._before = [math.nan] * width if before is None else before
        self._waiting: list[deque[Breakpoint]] = [deque() for _ in range(width)]
        self.reset()

    def reset(self) -> None:
        for waiting in self._waiting:
            waiting.clear()
        self._now = list(self._before)

    def extend(self, steps: Sequence[Iterable[Breakpoint]]) -> None:
        """Take in new breakpoints of every stream."""
        for waiting, new in zip(self._waiting, steps, strict=True):
            waiting.extend(new)

    def retract(self, counts: Sequence[int]) -> None:
        """Remove the newest breakpoints of every stream, as many as each count says."""
        for waiting, count in zip(self._waiting, counts, strict=True):
            for _ in range(count):
                waiting.pop()

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

    def ahead(self, last: float) -> Iterator[tuple[float, _Values]]:
        """The times up to the last with the values that `take` will return; removes nothing."""
        now = self._now[:]
        steps = heapq.merge(*itertools.starmap(_labelled, enumerate(self._waiting)))
        for time, group in itertools.groupby(steps, key=operator.itemgetter(0)):
            if time > last:
                break
            for _, i, value in group:
                now[i] = value
            yield time, tuple(now)


def _labelled(i: int, steps: Iterable[Breakpoint]) -> Iterator[tuple[float, int, float]]:
    return ((time, i, value) for time, value in steps)


class StreamNode(StateFields):
    """Makes the stream of a register from the streams of its operands."""

    STATE: ClassVar[tuple[str, ...]] = ("_joint",)

    def __init__(self, args: Sequence[StepStream], out: StepStream) -> None:
        self._args, self._out = args, out
        self._joint = Joint(len(args))

    def reset(self) -> None:
        self._joint.reset()

    def advance(self, begin: float, known: float) -> None:
        """Go as far as the operands are known, in a trace known from ``begin`` to ``known``."""
        raise NotImplementedError

    def finish(self, begin: float, end: float) -> None:
        """Go to the end of the trace; the operands are known up to there."""
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
