"""A program without negations above its predicates, so that every register is monotone in them."""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

from rtamt.language.traced import applied
from rtamt.program.algebra import FOLDS, FUNCTIONS
from rtamt.program.instructions import Const, Instruction, Map, Window, latencies_of
from rtamt.program.program import Program

__all__ = ["positive"]


def positive(program: Program) -> Program:
    """The same robustness with negations pushed down to the predicates.

    A register that is read both negated and not becomes two registers, whose bounds are
    independent, as in interval arithmetic. A negated predicate becomes a term: at an unseen sample
    it is as unknown as the predicate. A window that begins late and has no end becomes a shift of
    a window that begins now.
    """
    writer = _Writer(program)
    writer.write(program.result, negated=False)
    terms_first = sorted(range(len(writer.instructions)), key=lambda r: not writer.is_term[r])
    raw = replace(
        program,
        instructions=tuple(writer.instructions),
        terms=sum(writer.is_term),
        latencies=latencies_of(writer.instructions),
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
        """Write a register and what it needs; depth first, without recursion."""
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
