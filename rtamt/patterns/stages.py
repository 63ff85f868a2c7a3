"""The stages of requirements that ask for one thing after another.

A requirement is in stages if, as a whole, it has the shape

    eventually(p1 and eventually(p2 and ... eventually(pn)))

of two stages or more, with or without intervals: where the last operand of the ``and`` below an
``eventually`` is an ``eventually``, what stands before that is a stage, and the rest follows. How
the formula was written does not matter: by `rtamt.patterns.in_order`, as text, in a file.
"""

from __future__ import annotations

from typing import cast

from rtamt.language.formula import Formula, conjunction, make
from rtamt.language.interval import Interval
from rtamt.language.operators import OPERATORS
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification

__all__ = ["prefixes", "stages"]

_EVENTUALLY = OPERATORS["eventually"]
_AND = OPERATORS["and"]


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
