"""A direct implementation of the end modes of a trace; shares no code with the library.

A value is an interval ``(low, high)``; -0.0 counts as less than +0.0. `oracle` defines the modes
complete and open, and this module defines cut: an unbounded future has its open bounds if no sample
of its window was recorded.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable

from oracle import Read, Trace, Value, bounds, episode, opened, predicate

from rtamt.language.formula import make
from rtamt.language.interval import Interval
from rtamt.language.node import Node

INF = math.inf
UNKNOWN = -INF, INF


def ended(
    formula: Node, trace: Trace, n: int, end: str, read: Read = predicate
) -> tuple[float, float, float]:
    """Return robustness, moved to the bounds, and bounds of a trace of n samples with this end."""
    now, low, high = episode(formula, trace, n, read)
    if end == "complete":
        low = high = now
    elif end == "cut":
        low, high = cut(formula, trace, n, 0, read)
    return max(low, min(now, high, key=_order), key=_order), low, high


def holds(x: float) -> bool:
    """Return whether the sign bit is clear."""
    return math.copysign(1.0, x) > 0


def cut(
    f: Node, trace: Trace, n: int, i: int, read: Read = predicate, *, seen: int | None = None
) -> Value:
    """Return the bounds of a formula at time i, seen or not, of a trace cut after n samples.

    Predicates are known at ``seen`` samples, at first n.
    """
    return _Cut(f, trace, n, read, n if seen is None else seen).at(f, i)


class _Cut:
    def __init__(self, f: Node, trace: Trace, n: int, read: Read, seen: int) -> None:
        self.trace, self.n, self.read, self.seen = trace, n, read, seen
        self.open = opened(f, trace, seen, read)
        self.known: dict[tuple[Node, int], Value] = {}

    def at(self, f: Node, i: int) -> Value:
        if (f, i) not in self.known:
            self.known[f, i] = self._at(f, i)
        return self.known[f, i]

    def _at(self, f: Node, i: int) -> Value:  # noqa: C901 - a table
        assert f.op is not None
        if f.op.operands == "term":
            return self.read(f, self.trace, i if i < self.seen else None)
        a, b = bounds(f)
        p, q = (functools.partial(self.at, g) for g in (f.args[0], f.args[-1]))
        back = range(int(max(i - b, 0)), i - a + 1)
        last = self.n - 1 if b == INF else i + int(b)
        ahead = range(i + a, last + 1)
        if f.op.name in ("always", "eventually", "until") and b == INF and not ahead:
            return self.open(f, i)
        match f.op.name:
            case "not":
                return _not(p(i))
            case "and":
                return _all(self.at(g, i) for g in f.args)
            case "or":
                return _any(self.at(g, i) for g in f.args)
            case "implies":
                return _any([_not(p(i)), q(i)])
            case "iff":
                return _all([_any([_not(p(i)), q(i)]), _any([_not(q(i)), p(i)])])
            case "xor":
                return _any([_all([p(i), _not(q(i))]), _all([_not(p(i)), q(i)])])
            case "prev":
                return _all([p(i - 1)] if i else [])
            case "s_prev":
                return _any([p(i - 1)] if i else [])
            case "next" | "s_next":
                return p(i + 1)
            case "rise":
                return _all([p(i), _not(p(i - 1))] if i else [p(i)])
            case "fall":
                return _all([_not(p(i)), p(i - 1)] if i else [_not(p(i))])
            case "historically":
                return _all(map(p, back))
            case "once":
                return _any(map(p, back))
            case "since":
                return _any(_all([q(j), *map(p, range(j + 1, i + 1))]) for j in back)
            case "always":
                return _all(map(p, ahead))
            case "eventually":
                return _any(map(p, ahead))
            case "until":
                return _any(_all([q(j), *map(p, range(i, j))]) for j in ahead)
            case "unless":
                end = None if b == INF else int(b)
                throughout = make("always", f.args[:1], Interval.of(0, end))
                until = make("until", f.args, Interval.of(a, end))
                return _any([self.at(throughout, i), self.at(until, i)])
        raise NotImplementedError(f.op.name)


def _not(p: Value) -> Value:
    return -p[1], -p[0]


def _order(x: float) -> tuple[float, bool]:
    return x, holds(x)


def _all(values: Iterable[Value]) -> Value:
    lows, highs = zip((INF, INF), *values, strict=True)
    return min(lows, key=_order), min(highs, key=_order)


def _any(values: Iterable[Value]) -> Value:
    return _not(_all(map(_not, values)))
