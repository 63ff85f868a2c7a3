"""Folds over windows of dense time: of the steps that a window meets, or of all to the end."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from rtamt.machines.dense.streams import Joint, Stream, just_after
from rtamt.machines.windows import State
from rtamt.program.algebra import Element, LatticeFold

__all__ = ["SuffixNode", "WindowNode"]


class WindowNode:
    """The fold of all steps that a window meets.

    The step from t to t' meets the closed window from s + lo to s + hi if t <= s + hi and
    s + lo < t'. So it comes at s = t - hi and leaves at s = t' - lo, and the fold is a
    right-continuous function of s. The last instant of the trace counts as a step without an end,
    except for windows that begin after s: those are empty from ``end - lo`` on.
    """

    def __init__(
        self, fold: LatticeFold, lo: float, hi: float, args: Sequence[Stream], out: Stream
    ) -> None:
        self._lo, self._hi = lo, hi
        self._args, self._out = args, out
        self._empty = fold.identity[-1]
        self._joint = Joint(len(args))
        self._inside = Total(fold) if math.isinf(lo) else Queue(fold, lo)
        self._begun = False

    def advance(self, begin: float, known: float) -> None:
        """Go on to where steps may still come."""
        self._joint.extend([arg.new for arg in self._args])
        before = min(known, min(arg.frontier for arg in self._args) - self._hi)
        self._run(begin, before)
        self._out.frontier = before

    def finish(self, begin: float, end: float) -> None:
        """Go on to the end; windows that begin later are empty."""
        self._joint.extend([arg.new for arg in self._args])
        after = just_after(end)
        if self._lo > 0:
            empty = max(begin, end - self._lo)
            self._run(begin, empty)
            self._out.push(empty, self._empty)
        else:
            self._run(begin, after)
        self._out.frontier = after

    def _run(self, begin: float, before: float) -> None:
        joint, inside = self._joint, self._inside
        while True:
            # The first value is that of the trace's begin, whenever the first step comes.
            now = min(joint.next - self._hi, inside.leaves) if self._begun else begin
            if not now < before:
                break
            while joint.next - self._hi <= now:
                inside.push(joint.next, joint.take())
            while inside.leaves <= now:
                inside.pop()
            self._out.push(now, inside.value)
            self._begun = True

    def reset(self) -> None:
        """Forget every step."""
        self._joint.reset()
        self._inside.reset()
        self._begun = False

    def state(self) -> State:
        """The steps that wait, and those inside the window."""
        return [self._joint.state(), self._inside.state(), self._begun]

    def restore(self, state: State) -> None:
        """Take them over."""
        joint, inside, self._begun = state
        self._joint.restore(joint)
        self._inside.restore(inside)


class Total:
    """The fold of all steps so far, for windows that nothing leaves."""

    leaves = math.inf
    _total: Element

    def __init__(self, fold: LatticeFold) -> None:
        self._fold = fold
        self.reset()

    def push(self, begin: float, x: Element) -> None:  # noqa: ARG002 - as in Queue
        """Take in the next step."""
        self._total = self._fold.combine(self._total, x)

    def pop(self) -> None:
        """Nothing leaves."""
        raise AssertionError

    @property
    def value(self) -> float:
        """The fold."""
        return self._total[-1]

    def reset(self) -> None:
        """Forget every step."""
        self._total = self._fold.identity

    def state(self) -> State:
        """The fold."""
        return [self._total]

    def restore(self, state: State) -> None:
        """Take it over."""
        (self._total,) = state


class Queue:
    """The fold of the steps inside a window, first in, first out, in two stacks.

    ``_older`` holds the folds of its steps with all younger ones of it; when it is used up, the
    steps of ``_younger`` move there, each once (Tangwongsan, Hirzel and Schneider, "General
    incremental sliding-window aggregation", VLDB 2015).
    """

    _begins: deque[float]
    _older: list[Element]
    _younger: list[Element]
    _total: Element

    def __init__(self, fold: LatticeFold, lo: float) -> None:
        self._combine, self._identity = fold.combine, fold.identity
        self._lo = lo
        self.reset()

    def push(self, begin: float, x: Element) -> None:
        """Take in the next step."""
        self._begins.append(begin)
        self._younger.append(x)
        self._total = self._combine(self._total, x)

    def pop(self) -> None:
        """Let the oldest step go."""
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
        """When the oldest step leaves; it ends where the next one, which has come, begins."""
        return self._begins[1] - self._lo if len(self._begins) > 1 else math.inf

    def reset(self) -> None:
        """Forget every step."""
        self._begins = deque()
        self._older = []
        self._younger = []
        self._total = self._identity

    def state(self) -> State:
        """The steps."""
        return [list(self._begins), self._older[:], self._younger[:], self._total]

    def restore(self, state: State) -> None:
        """Take them over."""
        begins, older, younger, self._total = state
        self._begins = deque(begins)
        self._older, self._younger = list(older), list(younger)


class SuffixNode:
    """The fold of all steps from s + lo to the end of the trace: known when that has come."""

    def __init__(self, fold: LatticeFold, lo: float, args: Sequence[Stream], out: Stream) -> None:
        self._fold, self._lo = fold, lo
        self._args, self._out = args, out
        self._joint = Joint(len(args))

    def advance(self, begin: float, known: float) -> None:  # noqa: ARG002 - as all nodes
        """Collect the steps."""
        self._joint.extend([arg.new for arg in self._args])

    def finish(self, begin: float, end: float) -> None:
        """Fold the steps from the last to the first; one leaves where the next one begins."""
        self.advance(begin, end)
        steps: list[tuple[float, Element]] = []
        while (time := self._joint.next) <= end:
            steps.append((time, self._joint.take()))
        fold = self._fold.identity
        folds = [(end, fold[-1])] if self._lo > 0 else []  # windows that begin later are empty
        for time, x in reversed(steps):
            fold = self._fold.combine(x, fold)
            folds.append((time, fold[-1]))
        # Of what happens at one time, and of all before the begin, the last counts.
        values = {max(begin, time - self._lo): value for time, value in reversed(folds)}
        for time, value in values.items():
            self._out.push(time, value)
        self._out.frontier = just_after(end)

    def reset(self) -> None:
        """Forget every step."""
        self._joint.reset()

    def state(self) -> State:
        """The steps."""
        return self._joint.state()

    def restore(self, state: State) -> None:
        """Take them over."""
        self._joint.restore(state)
