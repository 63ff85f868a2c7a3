"""A direct implementation of the definition of interface-aware robustness.

Shares no code with the library.
"""

from __future__ import annotations

from oracle import INF, Read, Trace, Value, holds, predicate

from rtamt.language.node import Node
from rtamt.typing import SemanticsName

SEMANTICS: tuple[SemanticsName, ...] = (
    "standard",
    "boolean",
    "output-robustness",
    "input-vacuity",
    "input-robustness",
    "output-vacuity",
)


def reader(semantics: str, inputs: frozenset[str], outputs: frozenset[str]) -> Read:
    """Return a reader of predicates: their robustness with respect to U, relative to V.

    A predicate has its usual value if one of its variables is in U and the others are in U or V. It
    is infinite, with the sign of its truth, if all are in V. If one is in neither, it is 0 and its
    truth is unknown.
    """

    def read(f: Node, trace: Trace, i: int | None) -> Value:
        y = set(f.variables)
        everything = set(trace) | y
        u, v = {
            "standard": (everything, set()),
            "boolean": (set(), everything),
            "output-robustness": (outputs, everything - outputs),
            "input-robustness": (inputs, everything - inputs),
            "input-vacuity": (inputs, set()),
            "output-vacuity": (outputs, set()),
        }[semantics]
        if not y <= u | v:
            return -0.0, 0.0
        if not y <= v or semantics == "standard":
            return predicate(f, trace, i)
        if i is None and y:
            return -INF, INF
        value = INF if holds(f, trace, i or 0) else -INF
        return value, value

    return read
