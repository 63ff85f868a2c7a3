"""The order in which a machine on samples executes the formulas of a program."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from rtamt.program.instructions import Map, Window
from rtamt.program.program import Program

__all__ = ["Delay", "Scheduled", "schedule"]


@dataclass(frozen=True, slots=True)
class Delay:
    """The operand, ``length`` samples late."""

    length: int
    operand: int


Scheduled = Map | Window | Delay


def schedule(program: Program) -> Iterator[tuple[int, Scheduled]]:
    """The instructions after the terms and the slots that they write, with the delay lines.

    The program's registers take the first slots, delay lines the next. A delay line comes before
    the first instruction that reads it.
    """
    slots: dict[tuple[int, int], int] = {}
    for register in range(program.terms, len(program.instructions)):
        instruction = program.formula(register)
        args = []
        for operand in instruction.args:
            length = program.delay(register, operand)
            slot = slots.get((operand, length), operand)
            if length and slot == operand:
                slot = slots[operand, length] = len(program.instructions) + len(slots)
                yield slot, Delay(length, operand)
            args.append(slot)
        yield register, replace(instruction, args=tuple(args))
