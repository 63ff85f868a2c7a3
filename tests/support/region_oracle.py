"""A direct implementation of STL robustness in dense time, exact at every instant.

Every time of an event and every bound is a multiple of a step. Functions of time are therefore
constant at the instants that are multiples of the step, and on the open intervals between them.
These regions are numbered: the instant i steps after the start is 2i, the interval after it 2i + 1.

A value is an interval ``(low, high)``. On a complete trace it is a point. Otherwise, regions after
the last instant were not seen, and predicates may have any value there. In an open trace such a
region may be missing; in a cut trace it exists. Shares no code with the library.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction

from oracle import INF, Read, Trace, Value, all_, any_, not_, order, predicate

from rtamt.language.node import Node

Time = float | Fraction
Signals = Mapping[str, Sequence[tuple[Time, float]]]
STEP = 0.25


class Regions:
    """Formulas on a trace.

    Args:
        signals: The events of every variable.
        step: Divides all times and bounds.
        read: The value of a predicate at an instant, as the `oracle` reads it at a sample.
    """

    def __init__(self, signals: Signals, step: Time = STEP, read: Read = predicate) -> None:
        self.begin = max(events[0][0] for events in signals.values())
        end = min(events[-1][0] for events in signals.values())
        assert all(time % step == 0 for events in signals.values() for time, _ in events)
        self.step, self.read = step, read
        self.steps = int((end - self.begin) / step)
        times = [self.begin + step * i for i in range(self.steps + 1)]
        self.trace: Trace = {
            name: [[value for time, value in events if time <= now][-1] for now in times]
            for name, events in signals.items()
        }

    def complete(self, formula: Node, steps: int | None = None) -> Value:
        """Return the robustness at the start, if the trace ends after a number of steps."""
        return _End(self, formula, steps, "complete").at(formula, 0)

    def open(self, formula: Node, steps: int | None = None) -> Value:
        """Return the bounds at the start after a number of steps, over all continuations."""
        return _End(self, formula, steps, "open").at(formula, 0)

    def ended(self, formula: Node, end: str) -> tuple[float, float, float]:
        """Return the robustness at the start, moved to its bounds, and the bounds."""
        worst, now = self.complete(formula)
        low, high = worst, now
        if end != "complete":
            low, high = _End(self, formula, None, end).at(formula, 0)
        return max(low, min(now, high, key=order), key=order), low, high

    def at(self, formula: Node, end: str) -> Callable[[int], Value]:
        """Return the value in any region, for an end mode."""
        return functools.partial(_End(self, formula, None, end).at, formula)

    def first_decided(self, formula: Node) -> Time | None:
        """Return the first instant after which the bounds have one sign."""
        for steps in range(self.steps + 1):
            low, high = self.open(formula, steps)
            if math.copysign(1.0, low) == math.copysign(1.0, high):
                return self.begin + steps * self.step
        return None


class _End:
    def __init__(self, regions: Regions, formula: Node, steps: int | None, end: str) -> None:
        self.regions, self.end = regions, end
        self.seen = 2 * (regions.steps if steps is None else steps)
        # No value changes any more from there on, at instants and on intervals.
        self.last = self.seen + 2 + self.settled(formula)
        self.at = functools.cache(self._at)
        self.open = self if end != "cut" else _End(regions, formula, steps, "open")

    def bounds(self, f: Node) -> tuple[int, float]:
        if f.interval is None:
            return 0, INF
        begin, end = f.interval.begin, f.interval.end
        assert begin % self.regions.step == 0 == (end or 0) % self.regions.step
        scale = 2 / self.regions.step
        return int(begin * scale), INF if end is None else int(end * scale)

    def settled(self, f: Node) -> int:
        a, b = self.bounds(f) if f.op is not None and f.op.timed else (0, 0)
        return 2 + int(a if b == INF else b) + max(map(self.settled, f.args), default=0)

    def _at(self, f: Node, i: int) -> Value:  # noqa: C901 - a table
        assert f.op is not None
        if self.end == "complete":
            assert i <= self.seen
        elif i > self.last + 1:
            return self.at(f, self.last + (i - self.last) % 2)
        if f.op.operands == "term":
            return self.regions.read(f, self.regions.trace, i // 2 if i <= self.seen else None)
        p, q = (functools.partial(self.at, g) for g in (f.args[0], f.args[-1]))
        a, b = self.bounds(f)
        match f.op.name:
            case "not":
                return not_(p(i))
            case "and":
                return all_(self.at(g, i) for g in f.args)
            case "or":
                return any_(self.at(g, i) for g in f.args)
            case "implies":
                return any_([not_(p(i)), q(i)])
            case "iff":
                return all_([any_([not_(p(i)), q(i)]), any_([not_(q(i)), p(i)])])
            case "xor":
                return any_([all_([p(i), not_(q(i))]), all_([not_(p(i)), q(i)])])
            case "historically":
                return all_(p(j) for j in self.back(i, a, b))
            case "once":
                return any_(p(j) for j in self.back(i, a, b))
            case "since":
                return any_(
                    all_([q(j), *(p(k) for k in range(j if _inside(i, j) else j + 1, i + 1))])
                    for j in self.back(i, a, b)
                )
            case "always":
                return self.always(f, p, i, a, b)
            case "eventually":
                return not_(self.always(f, lambda j: not_(p(j)), i, a, b))
            case "until":
                return self.until(f, i, a, b)
            case "unless":
                return any_([self.always(f, p, i, 0, b), self.until(f, i, a, b)])
        raise NotImplementedError(f.op.name)

    def back(self, i: int, a: int, b: float) -> range:
        return range(int(max(i - b, 0)), i - a + 1)

    def ahead(self, i: int, a: int, b: float) -> range | None:
        """Return the regions of a window; None if it is unbounded and no part was recorded."""
        if b == INF and self.end == "cut":
            return range(i + a, self.seen + 1) or None
        stop = i + b
        if self.end == "complete":
            stop = min(stop, self.seen)
        elif b == INF:
            stop = max(i + a, self.last) + 1
        return range(i + a, int(stop) + 1)

    def needed(self, i: int, j: int, value: Value) -> Value:
        """Return the contribution of region j to a minimum over regions from i on."""
        return (value[0], INF) if self.end == "open" and j > self.seen and j != i else value

    def always(self, f: Node, p: Callable[[int], Value], i: int, a: int, b: float) -> Value:
        ahead = self.ahead(i, a, b)
        if ahead is None:
            return self.open.always_open(f, i, a)
        return all_(self.needed(i, j, p(j)) for j in ahead)

    def always_open(self, f: Node, i: int, a: int) -> Value:
        p = functools.partial(self.at, f.args[0])
        assert f.op is not None
        if f.op.name == "eventually":
            return self.always(f, lambda j: not_(p(j)), i, a, INF)
        return self.always(f, p, i, a, INF)

    def until(self, f: Node, i: int, a: int, b: float) -> Value:
        ahead = self.ahead(i, a, b)
        if ahead is None:
            return self.open.until(f, i, a, b)
        found: list[Value] = []
        for j in ahead:
            before = range(i, j + 1 if _inside(i, j) else j)
            value = all_([self.at(f.args[-1], j), *(self.at(f.args[0], k) for k in before)])
            found.append(not_(self.needed(i, j, not_(value))))
        return any_(found)


def _inside(i: int, witness: int) -> bool:
    """Return whether p's region is next to a witness in its own region."""
    return witness != i and witness % 2 == 1


def inside(low: float, value: float, high: float) -> bool:
    """Return whether a value lies between bounds, -0.0 below 0.0."""
    return order(low) <= order(value) <= order(high)
