"""Windows without end, folded backwards and put back as variables.

Future is past with time flipped: the mirrored window, run backwards, has a latency.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Load, Window, latencies_of
from rtamt.program.program import Program

__all__ = ["Folded", "folded_apart"]


class Folded(NamedTuple):
    """A window without end.

    Attributes:
        operands: The program of its operands, which are its outputs in order.
        fold: The program that folds them backwards.
        identity: What the window makes of no sample.
    """

    operands: Program
    fold: Program
    identity: float


def folded_apart(program: Program) -> tuple[tuple[Folded, ...], Program]:
    """The windows without end, in order, and the program that has a variable in place of each.

    A window may need the variables of those before it; its variable comes behind them.
    """
    folded = []
    while None in program.latencies:
        # Everything before the first window without end has a latency.
        windows = ((r, i) for r, i in enumerate(program.instructions) if isinstance(i, Window))
        cut, window = next((r, window) for r, window in windows if window.hi is None)
        operands = {str(i): register for i, register in enumerate(window.args)}
        part = program.restricted(window.args[0], operands)
        folded.append(Folded(part, _folding(program, window), FOLDS[window.fold].identity[-1]))
        # A variable of a specification cannot have such a name.
        program = _with_variable(program, cut, f"#{len(program.variables)}")
    return tuple(folded), program


def _folding(program: Program, window: Window) -> Program:
    """The program that folds the operands of a window without end backwards."""
    width = len(window.args)
    names = tuple(str(i) for i in range(width))
    mirrored = replace(window, args=tuple(range(width))).mirrored()
    return replace(
        program,
        instructions=(*map(Load, names), mirrored),
        terms=width,
        latencies=(0,) * (width + 1),
        result=width,
        outputs={"": width},
        variables=names,
        sources=program.sources[-1:] * (width + 1),
    )


def _with_variable(program: Program, cut: int, name: str) -> Program:
    """The program with a window replaced by a variable, which becomes its first register."""
    instructions = list(program.instructions)
    instructions[cut] = Load(name)
    loaded = replace(
        program,
        instructions=tuple(instructions),
        latencies=latencies_of(instructions),
        variables=(*program.variables, name),
    )
    others = (r for r in range(len(instructions)) if r != cut)
    return loaded.reordered([cut, *others], program.terms + 1)
