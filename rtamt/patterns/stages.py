"""The stages of requirements that demand one thing after another.

A requirement has stages if it has the form

    eventually(p1 and eventually(p2 and ... eventually(pn)))

with at least two stages, with or without intervals. If the last operand of the ``and`` below an
``eventually`` is an ``eventually``, the operands before it are a stage, and the rest follows.
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

_EVENTUALLY = OPERATORS["eventually"]
_AND = OPERATORS["and"]
_VALUE = OPERATORS["value"]


def stages(spec: str | Formula | Specification) -> tuple[Formula, ...]:
    """Return the stages of a requirement, in order; empty if it has no stages.

    Args:
        spec: Text, a formula or a specification; the last formula of a text counts, with named
            formulas inserted.

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
    """Return the requirement up to each of its stages; the last one is the complete requirement.

    Args:
        spec: As for `stages`.

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
    """Return the stages that the caller names, for a requirement of any form.

    Args:
        spec: As for `stages`.
        several: Formulas or their texts, in order, which may use the named formulas and constants
            of the specification.

    Raises:
        SpecificationError: If a text is wrong, or a stage reads a variable that the requirement
            does not use.

    Example:
        >>> spec = "limit = 2; near = d < limit; eventually always[0:5](near and up > 0)"
        >>> named_stages(spec, ["near", "up > limit"])
        (<Formula d < 2>, <Formula up > 2>)
    """
    spec = as_specification(spec)
    definitions = _definitions(spec)
    formulas = []
    for index, stage in enumerate(several, 1):
        formula = stage
        if isinstance(formula, str):
            try:
                formula = parse(formula, unit=spec.unit).formula
            except RtamtError as error:
                error.add_note(f"in stage {index}")
                raise
        formula = replaced(formula, definitions)
        for name in formula.variables:
            if name not in spec.variables:
                known = ", ".join(spec.variables) or "no variable"
                msg = f"stage {index}, {stage}, reads {name}, which the requirement does not"
                raise SpecificationError(f"{msg}; it reads {known}")
        formulas.append(formula)
    return tuple(formulas)


def _definitions(spec: Specification) -> dict[Node, Node]:
    """Return the formulas and constants that the names of a specification stand for."""
    nodes: dict[Node, Node] = {variable(n): number(value) for n, value in spec.constants.items()}
    for name, formula in spec.formulas.items():
        term = variable(name)
        if formula.op is _VALUE:
            nodes[term] = formula.args[0]
        else:
            nodes[term.formula()] = formula
    return nodes


def _steps(spec: str | Formula | Specification) -> list[tuple[Interval | None, Formula]]:
    """Return the interval and the condition of each stage."""
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
    chain: Formula | None = None
    for interval, stage in reversed(steps):
        inner = stage if chain is None else stage & chain
        chain = cast("Formula", make("eventually", (inner,), interval))
    return cast("Formula", chain)
