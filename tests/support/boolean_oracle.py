"""Whether a formula holds at a sample of a finite trace: STL as logic, without numbers."""

from __future__ import annotations

from functools import partial

import oracle
from oracle import Trace, bounds

from rtamt.language.node import Node


def holds(f: Node, trace: Trace, n: int, i: int) -> bool:  # noqa: C901 - a table
    """Return whether the formula is true at sample i; a window beyond the trace is empty."""
    assert f.op is not None
    if f.op.operands == "term":
        return oracle.holds(f, trace, i)
    p, q = (partial(holds, g, trace, n) for g in (f.args[0], f.args[-1]))
    a, b = bounds(f)
    ahead = [j for j in range(i, n) if a <= j - i <= b]
    back = [j for j in range(i + 1) if a <= i - j <= b]
    match f.op.name:
        case "not":
            return not p(i)
        case "and":
            return all(holds(g, trace, n, i) for g in f.args)
        case "or":
            return any(holds(g, trace, n, i) for g in f.args)
        case "implies":
            return not p(i) or q(i)
        case "iff":
            return p(i) == q(i)
        case "xor":
            return p(i) != q(i)
        case "prev":
            return i == 0 or p(i - 1)
        case "s_prev":
            return i > 0 and p(i - 1)
        case "next":
            return i == n - 1 or p(i + 1)
        case "s_next":
            return i < n - 1 and p(i + 1)
        case "rise":
            return p(i) and (i == 0 or not p(i - 1))
        case "fall":
            return not p(i) and (i == 0 or p(i - 1))
        case "historically":
            return all(p(j) for j in back)
        case "once":
            return any(p(j) for j in back)
        case "always":
            return all(p(j) for j in ahead)
        case "eventually":
            return any(p(j) for j in ahead)
        case "until":
            return any(q(j) and all(p(k) for k in range(i, j)) for j in ahead)
        case "since":
            return any(q(j) and all(p(k) for k in range(j + 1, i + 1)) for j in back)
        case "unless":
            throughout = all(p(j) for j in range(i, n) if j - i <= b)
            return throughout or any(q(j) and all(p(k) for k in range(i, j)) for j in ahead)
    raise NotImplementedError(f.op.name)
