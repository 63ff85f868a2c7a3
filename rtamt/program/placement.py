"""The times at which an episode machine reads each register of a program.

The operators above all windows are read only at time 0. The operands of windows are read at all
times, as streams.
"""

from __future__ import annotations

import functools
import operator
from dataclasses import dataclass, replace
from typing import assert_never

from rtamt.errors import SpecificationError
from rtamt.language.interval import applied
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Const, Instruction, Load, Map, Window
from rtamt.program.program import Program

MAX_UNKNOWNS = 8
"""The most windows without an end inside other temporal operators.

Each doubles the time of an update and the memory of a machine.
"""


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """A program and the times at which its registers are read."""

    program: Program  # the program, without negations above its predicates
    # registers that are read only at time 0, in order; the last is the result
    initial: tuple[int, ...]
    # registers that are read at all times, in order; some are in both lists
    streams: tuple[int, ...]
    unknowns: tuple[int, ...]  # streams of windows without an end, which never settle


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def place(program: Program) -> Placement:
    """Place the registers of a program, after its negations are removed."""
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
            case Load() | Const():
                pass
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


def positive(program: Program) -> Program:
    """Return the same robustness with negations pushed down to the predicates.

    A register that is read both negated and not becomes two registers with independent bounds. A
    negated predicate becomes a term, which is unknown at unseen samples. A late window without an
    end becomes a shift of a window that starts now.
    """
    formulas = range(program.terms, len(program.instructions))
    read = {(program.result, False)}  # registers, and whether they are negated
    for register in reversed(formulas):
        instruction = program.formula(register)
        for negated in (False, True):
            if (register, negated) in read:
                read.update((a, negated != _negates(instruction)) for a in instruction.args)
    writer = _Writer(program)
    known = {(register, False): register for register in range(program.terms)}
    for register in range(program.terms):
        if (register, True) in read:
            known[register, True] = writer.negate(register)
    terms = len(writer.instructions)
    for register in formulas:
        instruction = program.formula(register)
        for negated in (False, True):
            if (register, negated) in read:
                args = tuple(known[a, negated != _negates(instruction)] for a in instruction.args)
                known[register, negated] = writer.write(register, args, negated=negated)
    sources = tuple(program.sources[register] for register in writer.origins)
    raw = replace(program, instructions=tuple(writer.instructions), terms=terms, sources=sources)
    return raw.restricted(known[program.result, False], {})


class _Writer:
    """Writes instructions after the terms of a program, with the register that each came from."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.instructions: list[Instruction] = list(program.instructions[: program.terms])
        self.origins = list(range(program.terms))

    def negate(self, register: int) -> int:
        """Write the negation of a term."""
        match self.instructions[register]:
            case Const(_, neutral=True):
                return register
            case Const(value):
                return self._emit(Const(applied("neg", operator.neg, value)), register)
            case _:
                return self._emit(Map("neg", (register,)), register)

    def write(self, register: int, args: tuple[int, ...], *, negated: bool) -> int:
        """Write a formula of operands that are written."""
        match self.program.formula(register):
            case Map("neg"):
                return args[0]
            case Map(function):
                name = FOLDS[function].dual if negated else function
                return self._emit(Map(name, args), register)
            case Window(fold, lo, hi) as window:
                name = FOLDS[fold].dual if negated else fold
                if hi is not None or not lo:
                    return self._emit(replace(window, fold=name, args=args), register)
                open_end = self._emit(Window(name, 0, None, args), register)
                shift = "max" if FOLDS[name].identity[-1] < 0 else "min"
                return self._emit(Window(shift, lo, lo, (open_end,), endless=True), register)
            case _ as never:
                assert_never(never)

    def _emit(self, instruction: Instruction, origin: int) -> int:
        self.instructions.append(instruction)
        self.origins.append(origin)
        return len(self.instructions) - 1


def _negates(instruction: Map | Window) -> bool:
    return isinstance(instruction, Map) and instruction.function == "neg"


@functools.lru_cache(maxsize=512)
def variants_of(program: Program) -> tuple[Program, ...]:
    """Return the program without negations; with neutral predicates, with -0.0 and with 0.0.

    A negated neutral predicate is neutral, and its worst value is -0.0 too.
    """
    known = positive(program)
    return (known.with_zero(-0.0), known.with_zero(0.0)) if program.neutral else (known,)


@functools.lru_cache(maxsize=512)
def neutral_registers(program: Program) -> tuple[int, ...]:
    """Return the registers of neutral predicates in the programs of `variants_of`."""
    return tuple(
        register
        for register, term in enumerate(positive(program).instructions)
        if isinstance(term, Const) and term.neutral
    )
