"""What else a violation stands on, beside what decided its robustness.

The way of an explanation is one way through a formula. Where several operands or several samples
failed together, it goes through one of them: the request of a response, say, and not the grant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, cast

from rtamt.language.formula import Formula
from rtamt.language.table import Operator
from rtamt.monitors.provenance import Origin, Part, Visit, flat, holds_by_sign

__all__ = ["Share", "ShareRole", "beside"]

ShareRole = Literal["held", "missing", "broken"]
"""What a formula had to do with a violation."""


class Share(NamedTuple):
    """A formula whose sign at some places has a share in a violation.

    Attributes:
        formula: The formula.
        role: ``"held"``: it holds; ``"missing"``: it fails where it could have prevented the
            violation; ``"broken"``: it fails, and had to hold on a stretch of places.
        first: The first one of the places.
        last: The last one; the places between them belong to it.
        outside: First and last place of its window if that lies outside the trace; see `Origin`.
    """

    formula: Formula
    role: ShareRole
    first: int
    last: int
    outside: tuple[int | None, int | None] | None = None


def beside(
    way: Sequence[Visit],
    origin_at: Callable[[Formula, Operator, int], Origin],
    value_at: Callable[[Formula, int], float],
) -> Iterator[Share]:
    """The formulas that have a share in a violation, beside those on the way to what decided.

    As long as they and the last formula of the way keep their signs, the violation stays.

    Args:
        way: The formulas from the one that is violated down to what decided.
        origin_at: The origin of the value of a formula of formulas at a place; its parts name the
            earliest place where an operand failed that had to hold on a stretch.
        value_at: The value of a formula at a place.
    """
    seen = {(way[-1].formula, way[-1].place, way[-1].place)}
    for visit in way:
        stack = [(visit.formula, part) for part in _others(visit, origin_at)]
        stack.reverse()
        while stack:
            parent, part = stack.pop()
            formula = cast("Formula", parent.args[part.operand])
            key = formula, part.first, part.last
            if key in seen or not formula.variables:
                continue
            seen.add(key)
            row = cast("Operator", formula.op)
            outside = None
            if part.first == part.last and row.operands == "formula":
                origin = origin_at(formula, row, part.first)
                below = [*flat(origin.parts)]
                if below:
                    if part.broken and not row.timed:
                        below = [replace(each, broken=True) for each in below]
                    stack += [(formula, each) for each in reversed(below)]
                    continue
                outside = origin.outside
            role = _role(value_at(formula, part.first), part)
            yield Share(formula, role, part.first, part.last, outside)


def _others(visit: Visit, origin_at: Callable[[Formula, Operator, int], Origin]) -> Sequence[Part]:
    """The parts of the sign of a formula on the way, but the one through which the way goes."""
    its = visit.origin
    if its.operand is None:
        return ()
    # Those that name the earliest place name few of them, if the way goes through one.
    parts = [*flat(origin_at(visit.formula, cast("Operator", visit.formula.op), visit.place).parts)]
    if not any(
        part.operand == its.operand and part.first <= its.place <= part.last for part in parts
    ):
        parts = [*flat(its.parts)]
    through = its.operand, its.place, its.place
    return [part for part in parts if (part.operand, part.first, part.last) != through]


def _role(value: float, part: Part) -> ShareRole:
    if holds_by_sign(value):
        return "held"
    return "broken" if part.broken else "missing"
