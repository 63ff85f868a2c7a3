"""A direct implementation of the definitions of STL robustness; shares no code with the library.

A value is an interval ``(low, high)``. On a finite trace every predicate is a point. Over all
continuations and ends of a trace (``open_end=True``) a predicate at an unseen sample is (-inf,
inf), the future is unbounded, and from `settled` samples on every sub-formula keeps its value. An
unseen sample may be missing from a window of the future, except at the instant of the operator
itself.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from rtamt.language.node import Node

INF = math.inf
Value = tuple[float, float]
Trace = Mapping[str, Sequence[float]]
Read = Callable[[Node, Trace, int | None], Value]
"""The value of a predicate at a sample; None is an unseen sample."""


def predicate(f: Node, trace: Trace, i: int | None) -> Value:
    """Return the value of a predicate; any value at an unseen sample, if it has variables."""
    if i is None:
        if f.variables:
            return -INF, INF
        i = 0
    value = difference(f, trace, i)
    if value == 0:
        value = 0.0 if holds(f, trace, i) else -0.0
    return value, value


def holds(f: Node, trace: Trace, i: int) -> bool:
    """Return whether a predicate holds at a sample, as a comparison."""
    assert f.op is not None
    if f.op.name in ("true", "false"):
        return f.op.name == "true"
    x, *rest = (term(arg, trace, i) for arg in f.args)
    return bool(_COMPARISONS[f.op.name if rest else ">="](x, rest[0] if rest else 0.0))


def robustness(formula: Node, trace: Trace, n: int, read: Read = predicate) -> list[float]:
    """Return the robustness at every sample of a trace of n samples."""
    return [value[1] for value in values(formula, trace, n, read)]


def values(formula: Node, trace: Trace, n: int, read: Read = predicate) -> list[Value]:
    """Return the robustness at every sample; from -0.0 to 0.0 if a neutral predicate decides it."""
    at = _meaning(trace, n, n - 1, read, open_end=False)
    return [at(formula, i) for i in range(n)]


def episode(
    formula: Node, trace: Trace, n: int, read: Read = predicate
) -> tuple[float, float, float]:
    """Return robustness at 0 if the trace ends after n samples, and otherwise its bounds."""
    now = robustness(formula, trace, n, read)[0] if n else math.nan
    return now, *opened(formula, trace, n, read)(formula, 0)


def opened(
    formula: Node, trace: Trace, n: int, read: Read = predicate
) -> Callable[[Node, int], Value]:
    """Return the bounds of sub-formulas at any time over all continuations of n samples."""
    return _meaning(trace, n, n + settled(formula), read, open_end=True)


def horizon(f: Node) -> float:
    """Return the samples of future that the formula needs; inf for all."""
    if f.op is None or f.op.operands == "term":
        return 0
    h = [horizon(arg) for arg in f.args]
    a, b = bounds(f)
    match f.op.name:
        case "next" | "s_next":
            return h[0] + 1
        case "prev" | "s_prev":
            return max(0, h[0] - 1)
        case "always" | "eventually":
            return h[0] + b
        case "once" | "historically":
            return max(0, h[0] - a)
        case "until":
            return h[1] if b == 0 else b + max(h[0] - 1, h[1])
        case "unless":
            return max(b + h[0], h[1] if b == 0 else b + max(h[0] - 1, h[1]))
        case "since":
            return h[1] if b == 0 else max(h[0], h[1] - a, 0)
        case _:
            return max(h)


def settled(f: Node) -> int:
    """Return the samples after the last seen one until no value changes: unseen ones are equal."""
    a, b = bounds(f)
    own = 0 if f.op is None else 1 + int(a if b == INF else b)
    return own + max(map(settled, f.args), default=0)


def bounds(f: Node) -> tuple[int, float]:
    if f.interval is None:
        timed = f.op is not None and f.op.timed
        return 0, INF if timed else 0
    return int(f.interval.begin), INF if f.interval.end is None else int(f.interval.end)


def not_(p: Value) -> Value:
    return -p[1], -p[0]


def all_(values: Iterable[Value]) -> Value:
    low, high = [INF], [INF]
    for value in values:
        low.append(value[0])
        high.append(value[1])
    return min(low, key=order), min(high, key=order)


def order(value: float) -> tuple[float, float]:
    """Return a key that orders numbers with -0.0 below 0.0."""
    return value, math.copysign(1.0, value)


def any_(values: Iterable[Value]) -> Value:
    return not_(all_(map(not_, values)))


def _meaning(  # noqa: C901
    trace: Trace, n: int, last: int, read: Read, *, open_end: bool
) -> Callable[[Node, int], Value]:
    @functools.cache
    def at(f: Node, i: int) -> Value:  # noqa: C901 - a table
        if open_end:
            i = min(i, last)
        assert f.op is not None
        if f.op.operands == "term":
            return read(f, trace, i if i < n else None)
        a, b = bounds(f)
        p, q = (functools.partial(at, g) for g in (f.args[0], f.args[-1]))
        first, final = 0, INF if open_end else last
        stop = int(min(i + b, max(i + a, last) if open_end else last))
        ahead = range(i + a, stop + 1)
        back = range(int(max(i - b, 0)), i - a + 1)

        def needed(j: int, value: Value) -> Value:
            """Return the contribution of time j to a minimum over times from now on."""
            return (value[0], INF) if open_end and j >= n and j != i else value

        def offered(j: int, value: Value) -> Value:
            """Return the contribution of time j to a maximum."""
            return not_(needed(j, not_(value)))

        def witness(j: int) -> Value:
            return offered(j, all_([q(j), *map(p, range(i, j))]))

        match f.op.name:
            case "not":
                return not_(p(i))
            case "and":
                return all_(at(g, i) for g in f.args)
            case "or":
                return any_(at(g, i) for g in f.args)
            case "implies":
                return any_([not_(p(i)), q(i)])
            case "iff":
                return all_([any_([not_(p(i)), q(i)]), any_([not_(q(i)), p(i)])])
            case "xor":
                return any_([all_([p(i), not_(q(i))]), all_([not_(p(i)), q(i)])])
            case "prev":
                return all_([p(i - 1)] if i > first else [])
            case "s_prev":
                return any_([p(i - 1)] if i > first else [])
            case "next":
                return all_([needed(i + 1, p(i + 1))] if i < final else [])
            case "s_next":
                return any_([offered(i + 1, p(i + 1))] if i < final else [])
            case "rise":
                return all_([p(i), not_(p(i - 1))] if i > first else [p(i)])
            case "fall":
                return all_([not_(p(i)), p(i - 1)] if i > first else [not_(p(i))])
            case "historically":
                return all_(map(p, back))
            case "once":
                return any_(map(p, back))
            case "always":
                return all_(needed(j, p(j)) for j in ahead)
            case "eventually":
                return any_(offered(j, p(j)) for j in ahead)
            case "until":
                return any_(map(witness, ahead))
            case "since":
                return any_(all_([q(j), *map(p, range(j + 1, i + 1))]) for j in back)
            case "unless":
                throughout = all_(needed(j, p(j)) for j in range(i, stop + 1))
                return any_([throughout, *map(witness, ahead)])
        raise NotImplementedError(f.op.name)

    return at


def difference(f: Node, trace: Trace, i: int) -> float:
    """Return the distance of a predicate from its bound."""
    assert f.op is not None
    if f.op.name in ("true", "false"):
        value = INF if f.op.name == "true" else -INF
    else:
        x, y = (term(arg, trace, i) for arg in (f.args[0], f.args[-1]))
        match f.op.name:
            case "value":
                value = x
            case ">=" | ">":
                value = x - y
            case "<=" | "<":
                value = y - x
            case "==":
                value = -abs(x - y)
            case "!=":
                value = abs(x - y)
            case name:
                raise NotImplementedError(name)
    if math.isnan(value):
        raise ValueError(f"{f} is nan at {i}")
    return value


def term(t: Node, trace: Trace, i: int) -> float:
    """Return the value of a term in IEEE doubles."""
    if t.op is None:
        return trace[t.leaf][i] if isinstance(t.leaf, str) else float(t.leaf or 0.0)
    first, *rest = (term(arg, trace, i) for arg in t.args)
    if t.op.name == "rate":
        before = term(t.args[0], trace, max(i - 1, 0))
        return 0.0 if first == before else first - before
    if t.op.name in _UNARY:
        value = _ieee(_UNARY[t.op.name], first)
    else:
        value = functools.reduce(functools.partial(_ieee, _BINARY[t.op.name]), rest, first)
    if math.isnan(value):
        raise ValueError(f"{t} is nan at {i}")
    return value


def _ieee(function: Callable[..., float], *args: float) -> float:
    try:
        return float(function(*args))
    except (ArithmeticError, ValueError):  # Python raises an error; use the IEEE value of NumPy
        with np.errstate(all="ignore"):
            return float(_IEEE[function](*map(np.float64, args)))


_UNARY: dict[str, Callable[[float], float]] = {
    "neg": operator.neg,
    "abs": abs,
    "sqrt": math.sqrt,
    "exp": math.exp,
    "ln": math.log,
}
_BINARY: dict[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "min": min,
    "max": max,
    "pow": math.pow,
    "log": lambda x, base: _ieee(operator.truediv, _ieee(math.log, x), _ieee(math.log, base)),
}
_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    ">": operator.gt,
    "<=": operator.le,
    "<": operator.lt,
    "==": operator.eq,
    "!=": operator.ne,
}
_IEEE: dict[Callable[..., float], Callable[..., float]] = {
    math.sqrt: np.sqrt,
    math.exp: np.exp,
    math.log: np.log,
    math.pow: np.power,
    operator.truediv: np.divide,
}
