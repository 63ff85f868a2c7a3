"""What a machine on samples executes: a program with its delay lines written out."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import assert_never

from rtamt.program.program import Const, Instruction, Load, Map, Program, Window

__all__ = ["Delay", "Scheduled", "encoded", "schedule"]


@dataclass(frozen=True, slots=True)
class Delay:
    """The operand, ``length`` samples late."""

    length: int
    operand: int


Scheduled = Instruction | Delay


def schedule(program: Program) -> Iterator[tuple[int, Scheduled]]:
    """The instructions with the slots that they write; late operands have slots of their own.

    Slots from 0 are the program's registers; those of delay lines follow.
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


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def encoded(program: Program) -> tuple[tuple[object, ...], ...]:
    """The schedule as the tuples that the C++ machine reads; names cross as text.

    ``(slot, kind, name, first operand, second operand, value, length, start)``: the length of an
    unbounded window is 0, and where there is no second operand the first stands twice.
    """
    rows: list[tuple[object, ...]] = []
    for slot, step in schedule(program):
        match step:
            case Load(variable):
                row = ("LOAD", variable, program.variables.index(variable), 0, 0.0, 0, 0)
            case Const(value):
                row = ("CONST", "", 0, 0, value, 0, 0)
            case Map(function, args):
                row = ("MAP", function, args[0], args[-1], 0.0, 0, 0)
            case Window(fold, lo, hi, args):
                length = 0 if lo is None or hi is None else hi - lo + 1
                row = ("WINDOW", fold, args[0], args[-1], 0.0, length, program.start(slot))
            case Delay(length, operand):
                row = ("DELAY", "", operand, operand, 0.0, length, 0)
            case _ as never:
                assert_never(never)
        rows.append((slot, *row))
    return tuple(rows)
