"""Predicates of formulas, and formulas with their predicates in units of scales."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from rtamt.errors import SpecificationError, brief
from rtamt.language.formula import Formula, Term, make, number, replaced
from rtamt.language.node import Node

__all__ = ["predicates", "scaled"]


def predicates(formula: Formula) -> tuple[Formula, ...]:
    """The comparisons, and the terms that are formulas; each once, in order of appearance.

    Example:
        >>> import rtamt
        >>> spec = rtamt.parse("always(rpm < 3000) implies always(v < 35 and rpm < 3000)")
        >>> rtamt.predicates(spec.formula)
        (<Formula rpm < 3000>, <Formula v < 35>)
    """
    formulas = (node for node in formula.nodes() if isinstance(node, Formula))
    return tuple(each for each in formulas if each.args and isinstance(each.args[0], Term))


def scaled(formula: Formula, scales: Mapping[Formula, float]) -> Formula:
    """The formula with the robustness of each predicate divided by its scale.

    The robustness of a formula over several units is decided by the one with the least numbers: of
    a speed in m/s and a rotation in rpm, by the speed. In units of their scales, predicates are
    comparable. Whether the formula holds does not change, unless a division rounds to 0.

    Args:
        formula: The formula.
        scales: Positive, finite numbers for some of its `predicates`; others are left as they are.

    Raises:
        SpecificationError: If a scale is not positive and finite, or belongs to no predicate.
        InputTypeError: If a scale is not a number.

    Example:
        >>> import rtamt
        >>> formula = rtamt.parse("always(rpm < 3000) implies eventually(v > 35)").formula
        >>> rpm, v = rtamt.predicates(formula)
        >>> print(rtamt.scaled(formula, {rpm: 1000, v: 10}))
        always((rpm - 3000) / 1000 < 0) implies eventually((v - 35) / 10 > 0)
    """
    known = set(predicates(formula))
    made: dict[Node, Node] = {}
    for predicate, scale in scales.items():
        if predicate not in known:
            raise SpecificationError(f"expected scales of predicates of {formula}, got {predicate}")
        if cast("float", number(scale).leaf) <= 0:
            raise SpecificationError(
                f"expected a positive scale of {predicate}, got {brief(scale)}"
            )
        made[predicate] = _divided(predicate, scale)
    return replaced(formula, made)


def _divided(predicate: Formula, scale: float) -> Formula:
    """A predicate whose robustness is divided by a scale; differences keep the sign."""
    name = predicate.op.name if predicate.op else ""
    left, *right = (cast("Term", each) for each in predicate.args)
    if not right:
        return cast("Formula", make(name, (left / scale,)))
    return cast("Formula", make(name, ((left - right[0]) / scale, number(0.0))))
