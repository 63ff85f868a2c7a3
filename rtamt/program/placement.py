"""The times at which an episode machine reads each register of a program.

The operators above all windows are read only at time 0. The operands of windows are read at all
times, as streams.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import assert_never

from rtamt.errors import SpecificationError
from rtamt.language.interval import applied
from rtamt.program.algebra import FOLDS, FUNCTIONS
from rtamt.program.instructions import Const, Instruction, Map, Window
from rtamt.program.program import Program

MAX_UNKNOWNS = 8
"""The most windows without an end inside other temporal operators.

Each doubles the time of an update and the memory of a machine.
"""


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """A program and the times at which its registers are read.

    Attributes:
        program: The program, without negations above its predicates.
        initial: Registers that are read only at time 0, in order; the last is the result.
        streams: Registers that are read at all times, in order; some are in both lists.
        unknowns: Streams of windows without an end, which never settle.
    """

    program: Program
    initial: tuple[int, ...]
    streams: tuple[int, ...]
    unknowns: tuple[int, ...]


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
    writer = _Writer(program)
    writer.write(program.result, negated=False)
    terms_first = sorted(range(len(writer.instructions)), key=lambda r: not writer.is_term[r])
    raw = program.rewritten(
        writer.instructions,
        terms=sum(writer.is_term),
        result=writer.known[program.result, False],
        outputs={},
        sources=tuple(program.sources[r] for r in writer.origins),
    )
    return raw.reordered(terms_first, raw.terms).pruned()


class _Writer:
    def __init__(self, program: Program) -> None:
        self.program = program
        self.instructions: list[Instruction] = list(program.instructions[: program.terms])
        self.is_term = [True] * program.terms
        self.origins = list(range(program.terms))
        self.known: dict[tuple[int, bool], int] = {(r, False): r for r in range(program.terms)}

    def write(self, register: int, *, negated: bool) -> None:
        """Write a register and its operands, depth first, without recursion."""
        stack = [(register, negated)]
        while stack:
            key = stack[-1]
            missing = [need for need in self._needs(*key) if need not in self.known]
            if missing:
                stack.extend(missing)
                continue
            stack.pop()
            if key not in self.known:
                self.known[key] = self._written(*key)

    def _needs(self, register: int, negated: bool) -> list[tuple[int, bool]]:  # noqa: FBT001
        if register < self.program.terms:
            return []
        match self.program.formula(register):
            case Map("neg", (operand,)):
                return [(operand, not negated)]
            case Map(_, args) | Window(_, _, _, args):
                return [(a, negated) for a in args]
            case _ as never:
                assert_never(never)

    def _written(self, register: int, negated: bool) -> int:  # noqa: FBT001
        if register < self.program.terms:
            instruction = self.program.instructions[register]
            if isinstance(instruction, Const) and instruction.neutral:
                return register
            if isinstance(instruction, Const):
                value = applied("neg", FUNCTIONS["neg"].apply, instruction.value)
                return self._emit(Const(value), register, term=True)
            return self._emit(Map("neg", (register,)), register, term=True)
        args = tuple(self.known[need] for need in self._needs(register, negated))
        match self.program.formula(register):
            case Map("neg"):
                return args[0]
            case Map(function):
                name = FOLDS[function].dual if negated else function
                return self._emit(Map(name, args), register, term=False)
            case Window(fold, lo, None) if lo:
                name = FOLDS[fold].dual if negated else fold
                open_end = self._emit(Window(name, 0, None, args), register, term=False)
                shift = "max" if FOLDS[name].identity[-1] < 0 else "min"
                late = Window(shift, lo, lo, (open_end,), endless=True)
                return self._emit(late, register, term=False)
            case Window(fold) as window:
                name = FOLDS[fold].dual if negated else fold
                return self._emit(replace(window, fold=name, args=args), register, term=False)
            case _ as never:
                assert_never(never)

    def _emit(self, instruction: Instruction, origin: int, *, term: bool) -> int:
        self.instructions.append(instruction)
        self.is_term.append(term)
        self.origins.append(origin)
        return len(self.instructions) - 1


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
