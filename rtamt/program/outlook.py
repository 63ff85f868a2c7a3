"""The programs that bound the robustness of a whole trace at its first sample.

They have no negations (`rtamt.program.polarity`), so every register is monotone in the predicates:
the least (greatest) robustness is that of a trace whose unseen predicates are all -inf (+inf).
Predicates are therefore computed first, and are variables of the programs that follow.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace

from rtamt.program.algebra import FOLDS
from rtamt.program.passes import Folded, folded_apart
from rtamt.program.polarity import positive
from rtamt.program.program import Const, Instruction, Load, Map, Program, Window, latencies_of

__all__ = ["Outlook", "look_out", "past", "planned", "reaches", "sufficient", "throughout"]


@dataclass(frozen=True, eq=False, slots=True)
class Outlook:
    """A program for bounds.

    Attributes:
        predicates: Computes the predicates, opposites of predicates among them, as its outputs.
        formulas: What is made of them; its variables are those outputs.
        exact: The same registers, with bounds that are not cut to the trace.
        initial: Registers of ``formulas`` that are read at time 0 alone, in order; the last is the
            result.
        needed: Samples on which the bounds depend; None: all.
    """

    predicates: Program
    formulas: Program
    exact: Program
    initial: tuple[int, ...]
    needed: int | None


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def look_out(program: Program, n: int, *, best: bool) -> Outlook:
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
    )
    initial = {program.result}
    for register in reversed(behind):
        instruction = program.formula(register)
        if register in initial and isinstance(instruction, Map):
            initial.update(instruction.args)
    needed: int | None = 1
    for register in initial:
        if register >= program.terms and isinstance(instructions[register], Window):
            late = formulas.latencies[register]
            needed = None if late is None or needed is None else max(needed, late + 1)
    return Outlook(predicates, formulas, exact, tuple(sorted(initial)), needed)


@functools.lru_cache(maxsize=512)
def _memory_and_bound(program: Program) -> tuple[int, int]:
    """For how long unseen samples may differ from one another at most, and the greatest bound."""
    windows = [i for i in program.instructions if isinstance(i, Window)]
    before = [max(0, -_begin(window)) for window in windows]
    if not any(window.hi is None for window in windows):
        # No time after this one is read, so that no window reaches back further than it.
        last = sum(max(0, window.hi or 0) for window in windows)
        before = [min(last + 1, reach) for reach in before]
    return sum(before), max(
        (abs(b) for w in windows for b in (w.lo, w.hi) if b is not None), default=0
    )


def sufficient(program: Program, n: int) -> int:
    """A number to which bounds may be cut for a trace of n samples or less.

    From some sample on, all unseen ones are equal, and it does not matter how many there are.
    """
    memory, greatest = _memory_and_bound(program)
    return min(n + memory, greatest)


def past(program: Program) -> int | None:
    """On how many samples before it a value depends at most; None: on all."""
    windows = [i for i in program.instructions if isinstance(i, Window)]
    if any(window.lo is None for window in windows):
        return None
    return sum(max(0, -(window.lo or 0)) for window in windows)


def throughout(program: Program, register: int) -> Program:
    """What a window without end makes of the whole trace, from columns of its operands.

    The outputs are the numbers of the fold's element for all samples.
    """
    window = program.window(register)
    fold = FOLDS[window.fold]
    names = tuple(str(i) for i in range(fold.width))
    others: list[Instruction] = [
        Window("min" if empty > 0 else "max", 0, None, (i,))
        for i, empty in enumerate(fold.identity[:-1])
    ]
    last = replace(window, args=tuple(range(fold.width)))
    instructions: list[Instruction] = [*map(Load, names), *others, last]
    return replace(
        program,
        instructions=tuple(instructions),
        terms=fold.width,
        latencies=latencies_of(instructions),
        result=len(instructions) - 1,
        outputs={name: fold.width + i for i, name in enumerate(names)},
        variables=names,
        sources=program.sources[register : register + 1] * len(instructions),
    ).mirrored()


@functools.lru_cache(maxsize=512)
def planned(program: Program, registers: tuple[int, ...]) -> tuple[tuple[Folded, ...], Program]:
    """What `folded_apart` makes of the part that computes some registers, its outputs in order."""
    outputs = {str(i): register for i, register in enumerate(registers)}
    return folded_apart(replace(program, result=registers[0], outputs=outputs).pruned())


def reaches(program: Program, ahead: Mapping[str, int]) -> list[int]:
    """From how many samples after the first unseen one on each register keeps its value.

    Args:
        program: Its variables keep their values from some sample on.
        ahead: That sample for each variable, counted likewise.
    """
    found: list[int] = []
    for instruction in program.instructions:
        match instruction:
            case Load(variable):
                found.append(ahead[variable])
            case Const():
                found.append(0)
            case Map(_, args):
                found.append(max(found[a] for a in args))
            case Window(_, _, _, args) as window:
                found.append(max(0, max(found[a] for a in args) - _begin(window)))
    return found


def _begin(window: Window) -> int:
    """The offset from which on a window must read one number alone to have a value that stays."""
    # Folds are idempotent: a window without begin needs it at its end.
    return window.lo if window.lo is not None else window.hi or 0
