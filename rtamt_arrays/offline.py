"""Robustness of whole traces on arrays, many at once."""

from __future__ import annotations

import math

from rtamt.program.instructions import Map, Window
from rtamt.program.program import Program
from rtamt_arrays.functions import FUNCTIONS, Fold, Lattice, slide
from rtamt_arrays.operations import Operations, Tensor
from rtamt_arrays.terms import terms

__all__ = ["evaluated"]


def evaluated(
    program: Program, o: Operations, dtype: object, lattice: Lattice, values: list[Tensor]
) -> Tensor:
    """The robustness at every time of traces.

    Args:
        program: The program; its windows may have no end.
        o: The array library.
        dtype: The kind of numbers of constants.
        lattice: The functions in place of min and max.
        values: For each variable an array whose first axis is time.

    Returns:
        An array of the same shape; nan in a trace in which a variable or a term is nan.
    """
    shape = tuple(values[0].shape)
    n = shape[0]
    registers, wrong = terms(program, o, dtype, values)
    for instruction in program.instructions[program.terms :]:
        match instruction:
            case Map("min", (a, b)):
                registers.append(lattice.lesser(registers[a], registers[b]))
            case Map("max", (a, b)):
                registers.append(lattice.greater(registers[a], registers[b]))
            case Map(function, args):
                registers.append(FUNCTIONS[function](o, *(registers[a] for a in args)))
            case Window(name, lo, hi, args):
                # As `Program.clamped` does, in words that compilers of graphs read.
                lo = -n if lo is None else max(-n, min(n, lo))
                hi = n if hi is None else max(-n, min(n, hi))
                fold = Fold.named(name, lattice)
                before, after = max(0, -lo), max(0, hi)
                x = tuple(
                    o.concatenate(
                        [
                            o.full((before, *shape[1:]), identity, dtype),
                            o.broadcast(registers[a], shape),
                            o.full((after, *shape[1:]), identity, dtype),
                        ]
                    )
                    for a, identity in zip(args, fold.identity, strict=True)
                )
                begin = lo + before
                registers.append(slide(fold, x, hi - lo + 1)[-1][begin : begin + n])
            case _:
                msg = "an input behind the terms"
                raise AssertionError(msg)
    result = o.broadcast(registers[program.result], shape)
    if wrong is None:
        return result
    count = o.as_integers(wrong).sum(0)
    return o.where(count > 0, math.nan, result)
