"""Windows that are found by passes of their own, and put back as variables.

Windows without end are folded backwards. Future is past with time flipped: the mirrored window, run
backwards, has a latency.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

from rtamt.program.instructions import Instruction, Load, Window, latencies_of
from rtamt.program.program import Program

__all__ = ["Folded", "folded_apart"]


class Folded(NamedTuple):
    """A window.

    Attributes:
        register: Its register in the program of which it was a part.
        window: The window, as it was there.
        operands: The program of its operands, which are its outputs in order.
        fold: The program that folds them; backwards if the window has no end.
    """

    register: int
    window: Window
    operands: Program
    fold: Program


def folded_apart(
    program: Program, others: Collection[int] = ()
) -> tuple[tuple[Folded, ...], Program]:
    """The windows without end, in order, and the program that has a variable in place of each.

    A window may need the variables of those before it; its variable comes behind them.

    Args:
        program: The program.
        others: Registers of windows to which the same happens.
    """
    folded: list[Folded] = []
    # Everything before the first window without end has a latency.
    for register, before in enumerate(program.instructions):
        if not isinstance(before, Window) or not (before.hi is None or register in others):
            continue
        window = program.window(register)  # the variables of those before are in front of it
        operands = {str(i): register for i, register in enumerate(window.args)}
        part = program.restricted(window.args[0], operands)
        folded.append(Folded(register, before, part, _folding(program, window)))
        # A variable of a specification cannot have such a name.
        program = _with_variable(program, register, f"#{len(program.variables)}")
    return tuple(folded), program


def _folding(program: Program, window: Window) -> Program:
    """The program that folds the operands of a window; backwards if it has no end."""
    width = len(window.args)
    names = tuple(str(i) for i in range(width))
    part = replace(window, args=tuple(range(width)))
    last = part.mirrored() if part.hi is None else part
    instructions: tuple[Instruction, ...] = (*map(Load, names), last)
    return replace(
        program,
        instructions=instructions,
        terms=width,
        latencies=latencies_of(instructions),
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
