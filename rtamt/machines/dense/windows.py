"""Folds of windows over dense time: of the steps that a window meets, or of all to the end."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from rtamt.machines.dense.streams import StepStream, StreamNode, just_after
from rtamt.machines.state import StateFields
from rtamt.program.algebra import Element, LatticeFold

__all__ = ["SuffixNode", "WindowNode"]


class WindowNode(StreamNode):
    """Folds the steps that a window meets.

    The step from t to t' meets the closed window from s + lo to s + hi if t <= s + hi and
    s + lo < t'. So it enters at s = t - hi and leaves at s = t' - lo, and the fold is a
    right-continuous function of s. The last instant of the trace counts as a step without an end,
    except for windows that begin after s: those are empty from ``end - lo`` on.
    """

    STATE = (*StreamNode.STATE, "_inside", "_begun")

    def __init__(
        self, fold: LatticeFold, lo: float, hi: float, args: Sequence[StepStream], out: StepStream
    ) -> None:
        super().__init__(args, out)
        self._lo, self._hi = lo, hi
        self._empty = fold.identity[-1]
        self._inside = Total(fold) if math.isinf(lo) else Queue(fold, lo)
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
            # The fold has a value at the begin of the trace, even if the window is empty there.
            now = min(joint.next - self._hi, inside.leaves) if self._begun else begin
            if not now < before:
                break
            while joint.next - self._hi <= now:
                inside.push(joint.next, joint.take())
            while inside.leaves <= now:
                inside.pop()
            self._out.push(now, inside.value)
            self._begun = True


class Total(StateFields):
    """The fold of all steps so far, for windows without begin."""

    STATE = ("_total",)
    leaves = math.inf

    def __init__(self, fold: LatticeFold) -> None:
        self._combine, self._identity = fold.combine, fold.identity
        self.reset()

    def reset(self) -> None:
        self._total = self._identity

    def push(self, begin: float, x: Element) -> None:  # noqa: ARG002 - as in Queue
        """Take in the next step."""
        self._total = self._combine(self._total, x)

    def pop(self) -> None:
        raise AssertionError

    @property
    def value(self) -> float:
        """The fold."""
        return self._total[-1]


class Queue(StateFields):
    """The steps inside a window, first in, first out, in two stacks, and their fold.

    ``_older`` has, for each of its steps, the fold of that step and the younger ones in ``_older``.
    When it is used up, the steps of ``_younger`` move there, each once (Tangwongsan, Hirzel and
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
        """Take in the next step."""
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
        """The time at which the oldest step leaves; it ends where the next one begins."""
        return self._begins[1] - self._lo if len(self._begins) > 1 else math.inf


class SuffixNode(StreamNode):
    """Folds all steps from s + lo to the end of the trace; known only when the trace has ended."""

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
        # Several folds may come to the same time, as at the begin: the latest step's counts.
        values = {max(begin, time - self._lo): value for time, value in reversed(folds)}
        for time, value in values.items():
            self._out.push(time, value)
