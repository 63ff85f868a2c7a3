"""A program for bounds, split where its predicates end.

It has no negations (`rtamt.program.polarity`), so every register is monotone in the predicates: the
robustness is least (greatest) on the trace whose unseen predicates are all -inf (+inf). So
predicates are computed first, and are the variables of the program that follows.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

from rtamt.program.instructions import Const, Load, Map, Window, latencies_of
from rtamt.program.polarity import positive
from rtamt.program.program import Program

__all__ = ["SplitProgram", "initial_registers", "outputs_among", "split", "sufficient"]


@dataclass(frozen=True, eq=False, slots=True)
class SplitProgram:
    """A program for bounds.

    Attributes:
        predicates: Computes the predicates, opposites of predicates among them, as its outputs.
        formulas: What is made of them; its variables are those outputs.
        exact: The same registers, with bounds that are not cut to the trace.
        needed: Samples on which the bounds depend; None: all.
    """

    predicates: Program
    formulas: Program
    exact: Program
    needed: int | None


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def split(program: Program, n: int, *, best: bool) -> SplitProgram:
    """The programs that bound the result of a program.

    Args:
        program: The program.
        n: What `sufficient` gives for the traces.
        best: Whether neutral predicates are 0.0, as in the upper bound; in the lower, -0.0.
    """
    zero = 0.0 if best else -0.0
    exact, program = (positive(p).reading(zero) for p in (program, program.clamped(n)))
    behind = range(program.terms, len(program.instructions))
    read = {a for r in behind for a in program.formula(r).args} | {program.result}
    # The constants stay where they are: they keep their value at unseen samples.
    inputs = [
        r
        for r in sorted(read)
        if r < program.terms and not isinstance(program.instructions[r], Const)
    ]
    names = {r: f"#{i}" for i, r in enumerate(inputs)}  # no variables of a specification
    first = inputs[0] if inputs else program.result
    predicates = program.restricted(first, {names[r]: r for r in inputs})
    instructions = [Load(names[r]) if r in names else i for r, i in enumerate(program.instructions)]
    formulas = replace(
        program,
        instructions=tuple(instructions),
        latencies=latencies_of(instructions),
        variables=tuple(names.values()),
        rates={},
    )
    needed: int | None = 1
    for register in initial_registers(formulas):
        if isinstance(instructions[register], Window):
            late = formulas.latencies[register]
            needed = None if late is None or needed is None else max(needed, late + 1)
    return SplitProgram(predicates, formulas, exact, needed)


@functools.lru_cache(maxsize=512)
def outputs_among(part: Program, whole: Program) -> tuple[int, ...]:
    """Where the outputs of a program of terms are among the outputs of another, which has them all.

    The programs have the same variables and the same semantics.
    """
    known: dict[tuple[object, ...], int] = {}

    def numbered(program: Program) -> list[int]:
        """A number for every term; equal ones for equal terms."""
        numbers: list[int] = []
        for register in range(program.terms):
            match program.term(register):
                case Load(variable):
                    key: tuple[object, ...] = "load", variable
                case Const(value):
                    key = "const", repr(value)  # which tells 0.0 from -0.0
                case Map(function, args):
                    key = function, *(numbers[a] for a in args)
            numbers.append(known.setdefault(key, len(known)))
        return numbers

    numbers = numbered(whole)
    places = {numbers[r]: place for place, r in enumerate(whole.outputs.values())}
    numbers = numbered(part)
    return tuple(places[numbers[r]] for r in part.outputs.values())


def sufficient(program: Program, n: int) -> int:
    """A number to which bounds may be cut for a trace of n samples or less.

    From some sample on, all unseen ones are equal, and it does not matter how many there are.
    """
    memory, greatest = _memory_and_bound(program)
    return min(n + memory, greatest)


@functools.lru_cache(maxsize=512)
def _memory_and_bound(program: Program) -> tuple[int, int]:
    """After how many unseen samples all later ones are equal at most; the greatest window bound."""
    windows = [i for i in program.instructions if isinstance(i, Window)]
    before = [max(0, -_begin(window)) for window in windows]
    if not any(window.hi is None for window in windows):
        # No time after this one is read, so that no window reaches back further than it.
        last = sum(max(0, window.hi or 0) for window in windows)
        before = [min(last + 1, reach) for reach in before]
    return sum(before), max(
        (abs(b) for w in windows for b in (w.lo, w.hi) if b is not None), default=0
    )


@functools.lru_cache(maxsize=512)
def initial_registers(program: Program) -> tuple[int, ...]:
    """Registers that are read at time 0 alone, in order; the last is the result."""
    found = {program.result}
    for register in range(program.result, -1, -1):
        instruction = program.instructions[register]
        if register in found and isinstance(instruction, Map):
            found.update(instruction.args)
    return tuple(sorted(found))


def _begin(window: Window) -> int:
    """The offset from which on a window must read one number alone to have a value that stays."""
    # Folds are idempotent: a window without begin needs it at its end.
    return window.lo if window.lo is not None else window.hi or 0
