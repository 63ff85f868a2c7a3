"""The order in which a machine on samples executes a program, delay lines included."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import assert_never

from rtamt.program.program import Const, Instruction, Load, Map, Program, Window

__all__ = ["Delay", "Scheduled", "schedule"]


@dataclass(frozen=True, slots=True)
class Delay:
    """The operand, ``length`` samples late."""

    length: int
    operand: int


Scheduled = Instruction | Delay


def schedule(program: Program) -> Iterator[tuple[int, Scheduled]]:
    """The instructions and the slots that they write, with a delay line before each late operand.

    The first slots are the program's registers; those of delay lines follow.
    """
    slots: dict[tuple[int, int], int] = {}
    for register, instruction in enumerate(program.instructions):
        match instruction:
            case Load() | Const():
                yield register, instruction
            case Map() | Window():
                args = []
                for operand in instruction.args:
                    length = program.delay(register, operand)
                    slot = operand
                    if length and (operand, length) not in slots:
                        slot = slots[operand, length] = len(program.instructions) + len(slots)
                        yield slot, Delay(length, operand)
                    elif length:
                        slot = slots[operand, length]
                    args.append(slot)
                yield register, replace(instruction, args=tuple(args))
            case _ as never:
                assert_never(never)
