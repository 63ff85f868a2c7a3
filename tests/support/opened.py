"""Formulas with unknown predicates, so that only the operators above them count."""

from __future__ import annotations

from typing import cast

from rtamt import Formula, variable
from rtamt.language.formula import make
from rtamt.language.node import Node


def opened(formula: Formula) -> tuple[Formula, tuple[str, ...]]:
    """Return the formula with a new variable instead of every predicate."""
    known: dict[Node, Node] = {}
    names: list[str] = []
    for node in formula.nodes():
        if not isinstance(node, Formula):
            continue
        assert node.op is not None
        if node.op.operands == "formula":
            known[node] = make(node.op.name, tuple(known[a] for a in node.args), node.interval)
        elif not node.args:
            known[node] = node
        else:
            names.append(f"x{len(names)}")
            known[node] = variable(names[-1]).formula()
    return cast("Formula", known[formula]), tuple(names)
