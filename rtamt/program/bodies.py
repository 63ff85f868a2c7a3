"""The bodies of a requirement: the formulas that it demands at one instant after the other.

A requirement such as ``always(p and always[0:5] q)`` demands ``p`` and ``q`` at many instants. From
the root down, ``always`` and ``and`` only divide the demand; the first formula of every way that is
neither is a body. The requirement fails if and only if a body fails at an instant where it is read,
because a minimum is negative if and only if an operand is.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import cast

from rtamt.language.formula import Formula, make
from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS, Bounds
from rtamt.program.implications import InstantRuns, TraceSpan, merged_runs

_DIVIDES = (OPERATORS["always"], OPERATORS["and"])


@functools.lru_cache(maxsize=512)
def bodies(formula: Formula) -> tuple[Formula, ...]:
    """Return the bodies of a formula in the order of the text, equal ones once.

    Example:
        >>> from rtamt import parse
        >>> bodies(parse("always(a > 0 and always[0:5](b > 0)) and eventually(c > 0)").formula)
        (<Formula a > 0>, <Formula b > 0>, <Formula eventually(c > 0)>)
    """
    reached: dict[Formula, None] = {}
    seen: set[Node] = set()
    stack: list[Node] = [formula]
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        if node.op in _DIVIDES:
            stack += reversed(node.args)
        else:
            reached[cast("Formula", node)] = None
    return tuple(reached)


def body_reads(
    formula: Formula, bounds: Callable[[Node], Bounds], span: TraceSpan
) -> Mapping[Formula, InstantRuns]:
    """Return the instants, also after the trace, at which a formula read at 0 reads its bodies."""
    runs: dict[Node, list[tuple[int, float]]] = {formula: [(0, 0)]}
    for node in reversed([*formula.nodes()]):
        if node not in runs or node.op not in _DIVIDES:
            continue
        instants = merged_runs(runs[node])
        if node.op is OPERATORS["always"]:
            instants = span.window(bounds(node), instants)
        for operand in node.args:
            runs.setdefault(operand, []).extend(instants)
    return {body: merged_runs(runs[body]) for body in bodies(formula)}


def with_one_body(formula: Formula, body: Formula) -> Formula:
    """Return the formula with ``true`` as each of its other bodies."""
    changed: dict[Node, Node] = dict.fromkeys(bodies(formula), make("true", ()))
    changed[body] = body
    for node in formula.nodes():  # operands first
        if node.op in _DIVIDES and node not in changed and all(a in changed for a in node.args):
            args = tuple(changed[operand] for operand in node.args)
            changed[node] = make(node.op.name, args, node.interval)
    return cast("Formula", changed[formula])
