"""The definition of interface-aware robustness, written down naively.

Shares no code with the library.
"""

from __future__ import annotations

import math
import operator

from oracle import INF, Read, Trace, Value, predicate, term

from rtamt.language.node import Node
from rtamt.program.interface import Semantics

SEMANTICS: tuple[Semantics, ...] = (
    "standard",
    "output-robustness",
    "input-vacuity",
    "input-robustness",
    "output-vacuity",
)

_COMPARISONS = {
    ">=": operator.ge,
    ">": operator.gt,
    "<=": operator.le,
    "<": operator.lt,
    "==": operator.eq,
    "!=": operator.ne,
}


def reader(semantics: str, inputs: frozenset[str], outputs: frozenset[str]) -> Read:
    """How predicates are read: their robustness with respect to U, relative to V.

    A predicate has its usual value if one of its variables is in U and the others are in U or V.
    It is infinite, with the sign of its truth, if all are in V, and 0 if one is in neither.
    """

    def read(f: Node, trace: Trace, i: int | None) -> Value:
        y = set(f.variables)
        everything = set(trace) | y
        u, v = {
            "standard": (everything, set()),
            "output-robustness": (outputs, everything - outputs),
            "input-robustness": (inputs, everything - inputs),
            "input-vacuity": (inputs, set()),
            "output-vacuity": (outputs, set()),
        }[semantics]
        if not y <= u | v:
            return 0.0, 0.0
        if not y <= v or semantics == "standard":
            return predicate(f, trace, i)
        if i is None and y:
            return -INF, INF
        value = INF if holds(f, trace, i or 0) else -INF
        return value, value

    return read


def holds(f: Node, trace: Trace, i: int) -> bool:
    """Whether a predicate holds at a sample."""
    assert f.op is not None
    if f.op.name in ("true", "false"):
        return f.op.name == "true"
    x, *rest = (term(arg, trace, i) for arg in f.args)
    y = rest[0] if rest else 0.0
    assert not math.isnan(x + y) or math.isinf(x)
    return bool(_COMPARISONS[f.op.name if rest else ">="](x, y))
