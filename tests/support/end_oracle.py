"""The readings of the end of a trace, written down naively; shares no code with the library.

A value is an interval ``(low, high)``; -0.0 counts as less than +0.0. The complete and the open
reading are those of `oracle`; here is that of a trace that was cut.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable

from oracle import Read, Trace, Value, bounds, episode, predicate

from rtamt.language.node import Node

INF = math.inf
UNKNOWN = -INF, INF


def ended(
    formula: Node, trace: Trace, n: int, end: str, read: Read = predicate
) -> tuple[float, float, float]:
    """Robustness and bounds of a trace of n samples that ends."""
    now, low, high = episode(formula, trace, n, read)
    if (holds(low) == holds(high)) or end == "open":
        return now, low, high
    return now, *((now, now) if end == "complete" else cut(formula, trace, n, 0, read))


def holds(x: float) -> bool:
    """Whether the sign bit is clear."""
    return math.copysign(1.0, x) > 0


def cut(
    f: Node, trace: Trace, n: int, i: int, read: Read = predicate, *, seen: int | None = None
) -> Value:
    """The bounds of a formula at time i, seen or not, of a trace that was cut after n samples.

    Predicates are known at ``seen`` samples, at first n.
    """
    return _Cut(trace, n, read, n if seen is None else seen).at(f, i)


class _Cut:
    def __init__(self, trace: Trace, n: int, read: Read, seen: int) -> None:
        self.trace, self.n, self.read, self.seen = trace, n, read, seen
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
        if b < INF:
            ahead: range | None = range(i + a, int(i + b) + 1)
        elif f.op.name in ("always", "eventually", "until", "unless"):
            if i >= self.n:
                return UNKNOWN
            ahead = range(i + a, self.n) or None
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
                return UNKNOWN if ahead is None else _all(map(p, ahead))
            case "eventually":
                return UNKNOWN if ahead is None else _any(map(p, ahead))
            case "until" | "unless":
                if ahead is None:  # p is needed up to a witness of which nothing is known
                    until = _all([UNKNOWN, *map(p, range(i, i + a))])
                else:
                    until = _any(_all([q(j), *map(p, range(i, j))]) for j in ahead)
                if f.op.name == "until":
                    return until
                last = self.n - 1 if b == INF else i + int(b)
                return _any([_all(map(p, range(i, last + 1))), until])
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
