"""The stages of requirements that ask for one thing after another.

A requirement is in stages if, as a whole, it has the shape

    eventually(p1 and eventually(p2 and ... eventually(pn)))

of two stages or more, with or without intervals: where the last operand of the ``and`` below an
``eventually`` is an ``eventually``, what stands before that is a stage, and the rest follows. How
the formula was written does not matter: by `rtamt.patterns.in_order`, as text, in a file.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import cast

from rtamt.errors import RtamtError, SpecificationError
from rtamt.language.formula import Formula, conjunction, make, number, replaced, variable
from rtamt.language.interval import Interval
from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS
from rtamt.language.parser import as_specification, parse
from rtamt.language.specification import Specification

__all__ = ["named_stages", "prefixes", "stages"]

_EVENTUALLY = OPERATORS["eventually"]
_AND = OPERATORS["and"]
_VALUE = OPERATORS["value"]


def stages(spec: str | Formula | Specification) -> tuple[Formula, ...]:
    """The stages of a requirement, in order; empty if it is not in stages.

    Args:
        spec: A text, a formula or a specification. Of several formulas the last counts, with names
            replaced by what they mean.

    Raises:
        SpecificationError: If a text is wrong.

    Example:
        >>> stages("eventually(near > 0 and eventually[0:5](grasped > 0 and eventually(up > 0)))")
        (<Formula near > 0>, <Formula grasped > 0>, <Formula up > 0>)
        >>> stages("eventually(up > 0)"), stages("always(x > 0)")
        ((), ())
    """
    return tuple(stage for _, stage in _steps(spec))


def prefixes(spec: str | Formula | Specification) -> tuple[Formula, ...]:
    """The requirement up to each of its stages: of one stage, of two, and so on; the last is whole.

    Args:
        spec: As in `stages`.

    Raises:
        SpecificationError: If a text is wrong.

    Example:
        >>> prefixes("eventually(near > 0 and eventually[0:5](up > 0))")
        (<Formula eventually(near > 0)>, <Formula eventually(near > 0 and eventually[0:5](up > 0))>)
    """
    steps = _steps(spec)
    return tuple(_chain(steps[:count]) for count in range(1, len(steps) + 1))


def named_stages(
    spec: str | Formula | Specification, several: Iterable[str | Formula]
) -> tuple[Formula, ...]:
    """The stages of a requirement that are named, whatever its shape.

    Args:
        spec: As in `stages`.
        several: Formulas or their texts, in order. The names of formulas and of constants of the
            specification mean in them what they mean there.

    Raises:
        SpecificationError: If a text is wrong, or a stage reads what the requirement does not.

    Example:
        >>> spec = "limit = 2; near = d < limit; eventually always[0:5](near and up > 0)"
        >>> named_stages(spec, ["near", "up > limit"])
        (<Formula d < 2>, <Formula up > 2>)
    """
    whole = as_specification(spec)
    instead = _meant(whole)
    found = []
    for place, each in enumerate(several, 1):
        formula = each
        if isinstance(formula, str):
            try:
                formula = parse(formula, unit=whole.unit).formula
            except RtamtError as error:
                error.add_note(f"in stage {place}")
                raise
        formula = replaced(formula, instead)
        for name in formula.variables:
            if name not in whole.variables:
                known = ", ".join(whole.variables) or "no variable"
                msg = f"stage {place}, {each}, reads {name}, which the requirement does not"
                raise SpecificationError(f"{msg}; it reads {known}")
        found.append(formula)
    return tuple(found)


def _meant(spec: Specification) -> dict[Node, Node]:
    """What stands for the names of formulas and constants of a specification."""
    found: dict[Node, Node] = {variable(n): number(value) for n, value in spec.constants.items()}
    for name, formula in spec.formulas.items():
        term = variable(name)
        if formula.op is _VALUE:
            found[term] = formula.args[0]
        else:
            found[term.formula()] = formula
    return found


def _steps(spec: str | Formula | Specification) -> list[tuple[Interval | None, Formula]]:
    """The interval and the condition of each stage."""
    formula = as_specification(spec).formula
    steps: list[tuple[Interval | None, Formula]] = []
    while formula.op is _EVENTUALLY:
        below = cast("Formula", formula.args[0])
        *parts, last = cast("tuple[Formula, ...]", below.args) if below.op is _AND else (below,)
        if not parts or last.op is not _EVENTUALLY:
            return [*steps, (formula.interval, below)] if steps else []
        steps.append((formula.interval, conjunction(parts)))
        formula = last
    return []


def _chain(steps: list[tuple[Interval | None, Formula]]) -> Formula:
    found: Formula | None = None
    for interval, stage in reversed(steps):
        whole = stage if found is None else stage & found
        found = cast("Formula", make("eventually", (whole,), interval))
    return cast("Formula", found)
