"""The values that the terms of a program can have on a sample that is not known, or not exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rtamt.program.algebra import FUNCTIONS
from rtamt.program.instructions import Const, Load, Map
from rtamt.program.intervals import Range, range_of
from rtamt.program.program import Program

__all__ = ["of_ends", "ranges_of"]


def of_ends(lower: float, upper: float) -> Range:
    """The range of a variable, which is known if its ends are the same to the bit."""
    same = lower == upper and math.copysign(1.0, lower) == math.copysign(1.0, upper)
    return Range(lower, upper, same)


def ranges_of(program: Program, variables: Sequence[Range]) -> list[Range]:
    """The ranges of a program's terms, in the order of their registers.

    The list ends before the first term that has no value.

    Args:
        program: The program.
        variables: The range of each variable.
    """
    found: list[Range] = []
    for instruction in program.instructions[: program.terms]:
        match instruction:
            case Load(variable):
                found.append(variables[program.variables.index(variable)])
            case Const(value):
                found.append(Range(value, value, known=True))
            case Map(name, args):
                row = FUNCTIONS[name]
                made = range_of(row.apply, row.rule, *(found[a] for a in args))
                if made is None:
                    break
                found.append(made)
    return found
