"""Whether a formula holds at a sample of a finite trace: STL read as logic, without numbers.

Only the atoms are shared with the oracle of robustness: positive holds, negative does not.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from oracle import Trace, bounds, predicate

from rtamt.language.node import Node


def positive(f: Node, trace: Trace, i: int) -> bool:
    """Whether the robustness of an atom is above 0."""
    return predicate(f, trace, i)[0] > 0


Atom = Callable[[Node, Trace, int], bool]


def holds(  # noqa: C901 - a table
    f: Node, trace: Trace, n: int, i: int, atom: Atom = positive
) -> bool:
    """Whether the formula is true at sample i; a window that the trace cuts away is empty."""
    assert f.op is not None
    if f.op.operands == "term":
        return atom(f, trace, i)
    p, q = (partial(holds, g, trace, n, atom=atom) for g in (f.args[0], f.args[-1]))
    a, b = bounds(f)
    ahead = [j for j in range(i, n) if a <= j - i <= b]
    back = [j for j in range(i + 1) if a <= i - j <= b]
    match f.op.name:
        case "not":
            return not p(i)
        case "and":
            return all(holds(g, trace, n, i, atom) for g in f.args)
        case "or":
            return any(holds(g, trace, n, i, atom) for g in f.args)
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
