"""At which times an episode machine reads each register of a program.

The operators above all windows are read at time 0 alone. The operands of windows are read at all
times, as streams.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

from rtamt.errors import SpecificationError
from rtamt.program.instructions import Map, Window
from rtamt.program.polarity import positive
from rtamt.program.program import Program

__all__ = ["MAX_UNKNOWNS", "Placement", "place"]

MAX_UNKNOWNS = 8
"""How many windows without end a formula may have inside other temporal operators.

Each doubles the time of an update and the memory of a machine.
"""


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """A program and the times at which its registers are read.

    Attributes:
        program: The program, without negations above its predicates.
        initial: Registers that are read at time 0 alone, in order; the last is the result.
        streams: Registers that are read at all times, in order. One may be read both ways.
        unknowns: Streams of windows without end, which never settle.
    """

    program: Program
    initial: tuple[int, ...]
    streams: tuple[int, ...]
    unknowns: tuple[int, ...]


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def place(program: Program) -> Placement:
    """Place the registers of a program, after its negations are removed.

    Raises:
        SpecificationError: On more than `MAX_UNKNOWNS` windows without end inside others.
    """
    program = positive(program)
    initial, streams, unknowns = {program.result}, set[int](), list[int]()
    for register in range(len(program.instructions) - 1, program.terms - 1, -1):
        match program.instructions[register]:
            case Map(_, args):
                initial.update(args if register in initial else ())
                streams.update(args if register in streams else ())
            case Window(_, _, hi, args):
                streams.update(args)
                if hi is None and register in streams:
                    unknowns.append(register)
    if len(unknowns) > MAX_UNKNOWNS:
        written = len({program.sources[register] for register in unknowns})
        expanded = ""
        if written < len(unknowns):
            expanded = (
                f", which count as {len(unknowns)}: one that is read both negated and not, as "
                "below iff and xor, counts twice, and so does unless"
            )
        msg = (
            f"the formula has {written} operators without an end inside others{expanded}; "
            f"the limit is {MAX_UNKNOWNS}; write an end, as in eventually[0:100], or judge "
            "recorded traces with judge()"
        )
        raise SpecificationError(msg)
    return Placement(
        program, tuple(sorted(initial)), tuple(sorted(streams)), tuple(reversed(unknowns))
    )
