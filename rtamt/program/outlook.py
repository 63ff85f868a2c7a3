"""The programs that bound the robustness of a whole trace at its first sample.

They have no negations (`rtamt.program.polarity`), so every register is monotone in the predicates:
the robustness is least (greatest) on the trace whose unseen predicates are all -inf (+inf).
Predicates are therefore computed first, and are variables of the programs that follow.

In the open reading an unseen sample may not be there, and some windows skip it
(`rtamt.program.instructions.Window.skips`). Mostly that changes nothing, as what they skip is what
their fold makes of nothing. The others, which `otherwise_read` finds, are read by passes of their
own.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from rtamt.program.algebra import FOLDS, FUNCTIONS
from rtamt.program.instructions import (
    Const,
    Instruction,
    Load,
    Map,
    Window,
    latencies_of,
    operands,
)
from rtamt.program.passes import Folded, folded_apart
from rtamt.program.polarity import positive
from rtamt.program.program import Program

__all__ = [
    "Outlook",
    "initial",
    "look_out",
    "looks_ahead",
    "nested",
    "otherwise_read",
    "outputs_among",
    "past",
    "planned",
    "reaches",
    "read_beyond",
    "sufficient",
    "throughout",
    "together",
    "unending",
]


@dataclass(frozen=True, eq=False, slots=True)
class Outlook:
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
    needed: int | None = 1
    for register in initial(formulas):
        if isinstance(instructions[register], Window):
            late = formulas.latencies[register]
            needed = None if late is None or needed is None else max(needed, late + 1)
    return Outlook(predicates, formulas, exact, needed)


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
def unending(program: Program, unseen: float) -> Program:
    """The program for traces that go on for ever, whose unseen predicates have one infinite value.

    A register is a constant there if what comes in the end decides it at all times. The program is
    the same object if there is none.
    """
    needed = program.pruned()
    instructions = needed.instructions
    ends = _ends(needed, unseen)
    best = unseen > 0
    fixed: dict[int, float] = {}  # the values of registers that have one value at all times
    for register, instruction in enumerate(instructions):
        if isinstance(instruction, Load):
            continue
        if isinstance(instruction, Const):
            fixed[register] = instruction.value
            continue
        args = instruction.args
        always = _stays(instruction, [fixed.get(a) for a in args])
        if isinstance(instruction, Window):
            # A window that may be empty has no value of its operands then.
            nothing = FOLDS[instruction.fold].identity[-1]
            empty = instruction.hi is not None and instruction.hi < 0
            skips = instruction.skips(best=best)
            if empty or (skips and instruction.lo and always != nothing):
                always = None
            endless = instruction.hi is None and not skips
            if endless and len(args) == 1 and ends[register] == -nothing:
                always = -nothing
        if always is not None:
            fixed[register] = always
    if all(isinstance(instructions[register], Const) for register in fixed):
        return program
    constant = [Const(fixed[r]) if r in fixed else i for r, i in enumerate(instructions)]
    others = [r for r in range(len(constant)) if r not in fixed]
    terms = len(fixed) + sum(r < needed.terms for r in others)
    return (
        replace(needed, instructions=tuple(constant), latencies=latencies_of(constant))
        .reordered([*fixed, *others], terms)
        .pruned()
    )


@functools.lru_cache(maxsize=512)
def read_beyond(program: Program, registers: tuple[int, ...], *, also: bool) -> frozenset[int]:
    """The registers whose values at unseen times others need, if a trace was cut.

    A window without end speaks of recorded times alone, unless it is itself read beyond them.

    Args:
        program: The program.
        registers: Those that are asked for at recorded times.
        also: Whether these are asked for at unseen times too.
    """
    found = set(registers) if also else set()
    for register in sorted(program.needed(*registers), reverse=True):
        instruction = program.instructions[register]
        ahead = isinstance(instruction, Window) and (instruction.hi or 0) > 0
        if ahead or register in found:
            found.update(operands(instruction))
    return frozenset(found)


def otherwise_read(
    program: Program,
    registers: tuple[int, ...],
    *,
    best: bool,
    cut: bool,
    read: Collection[int],
) -> frozenset[int]:
    """The windows with an end whose values near the end of a trace a machine would not give.

    Args:
        program: The program; its variables are predicates, which are unknown at unseen samples.
        registers: Those that are asked for; others matter as far as these need them.
        best: Whether it is the upper bound.
        cut: Whether it is the reading of a trace that was cut; else the open one.
        read: The registers that are read at unseen times.
    """
    beyond = at_unseen(program, best=best)
    skipping, endless, late = set(), set(), False
    for register in program.needed(*registers):
        window = program.instructions[register]
        if not isinstance(window, Window):
            continue
        if window.hi is None:
            late |= beyond[register] is None and register in read
            continue
        value = beyond[window.args[-1]]
        skips = window.skips(best=best) and value != FOLDS[window.fold].identity[-1]
        if skips:
            skipping.add(register)
        if window.endless and (skips or window.guard or value is None):
            endless.add(register)
    if not cut:
        return frozenset(skipping)
    # A future without end has the values of the open reading where nothing was recorded.
    return frozenset(skipping | endless if endless or late else ())


@functools.lru_cache(maxsize=1024)
def at_unseen(program: Program, *, best: bool) -> tuple[float | None, ...]:
    """The value of each register at all unseen times of the open reading, if it is known.

    Args:
        program: The program; its variables are predicates.
        best: Whether it is the upper bound.
    """
    unseen = math.inf if best else -math.inf
    values: list[float | None] = []
    for instruction in program.instructions:
        match instruction:
            case Load():
                values.append(unseen)
            case Const(value):
                values.append(value)
            case Map():
                values.append(_stays(instruction, [values[a] for a in instruction.args]))
            case Window(_, lo, _, args) as window:
                known = [values[a] for a in args]
                if window.skips(best=best):  # folds are idempotent
                    values.append(FOLDS[window.fold].identity[-1] if lo else known[-1])
                else:
                    behind = lo is None or lo < 0
                    values.append(None if behind or None in known else known[-1])
    return tuple(values)


def _stays(instruction: Map | Window, values: Sequence[float | None]) -> float | None:
    """The value for operands that keep theirs; None stands for one that is not known."""
    if isinstance(instruction, Window):
        if instruction.lo is None or None in values:
            return None
        return values[-1]  # folds are idempotent
    apply = FUNCTIONS[instruction.function].apply
    known = [value for value in values if value is not None]
    if len(known) == len(values):
        return functools.reduce(apply, known)
    decides = {"min": -math.inf, "max": math.inf}[instruction.function]
    return decides if decides in known else None


def initial(program: Program) -> tuple[int, ...]:
    """Registers that are read at time 0 alone, in order; the last is the result."""
    found = {program.result}
    for register in range(program.result, -1, -1):
        instruction = program.instructions[register]
        if register in found and isinstance(instruction, Map):
            found.update(instruction.args)
    return tuple(sorted(found))


def nested(program: Program) -> bool:
    """Whether one fold without end is over another, and one pass backwards does all of them."""
    windows = [(r, i) for r, i in enumerate(program.instructions) if isinstance(i, Window)]
    if any(window.lo is None for _, window in windows):
        return False
    return not {r for r, window in windows if window.hi is None} <= {*initial(program)}


@functools.lru_cache(maxsize=512)
def together(program: Program) -> Program | None:
    """The program for all worlds in one pass over the samples of a trace; None: there is none.

    Its outputs are the results if the trace goes on for ever, by the value of its unseen
    predicates, unless that is a constant of `unending`; and, as ``"nan"``, if it is complete.
    """
    windows = (i for i in program.instructions if isinstance(i, Window))
    if not nested(program) or any((window.lo, window.hi) != (0, None) for window in windows):
        return None
    instructions: list[Instruction] = []
    known: dict[Instruction, int] = {}
    outputs: dict[str, int] = {}

    def emit(instruction: Instruction) -> int:
        # The constants -0.0 and 0.0 are equal, and are two.
        if isinstance(instruction, Const) or instruction not in known:
            known[instruction] = len(instructions)
            instructions.append(instruction)
        return known[instruction]

    for unseen in (-math.inf, math.inf, math.nan):
        part = program.pruned() if math.isnan(unseen) else unending(program, unseen).pruned()
        if isinstance(part.instructions[part.result], Const):
            continue
        new: list[int] = []
        for instruction, end in zip(part.instructions, _ends(part, unseen), strict=True):
            written = instruction
            if not isinstance(instruction, Load | Const):
                written = replace(instruction, args=tuple(new[a] for a in instruction.args))
            register = emit(written)
            if isinstance(written, Window) and not (
                end is None or math.isnan(unseen) or written.skips(best=unseen > 0)
            ):
                register = _with_end(written, end, register, emit)
            new.append(register)
        outputs[str(unseen)] = new[part.result]
    inputs = [r for r, i in enumerate(instructions) if isinstance(i, Load | Const)]
    others = [r for r in range(len(instructions)) if r not in inputs]
    joint = replace(
        program,
        instructions=tuple(instructions),
        latencies=latencies_of(instructions),
        result=outputs["nan"],
        outputs=outputs,
        sources=program.sources[-1:] * len(instructions),
    )
    return joint.reordered([*inputs, *others], len(inputs))


def _with_end(window: Window, end: float, register: int, emit: Callable[[Instruction], int]) -> int:
    """Extends a window over recorded samples by the value that its operand keeps behind them."""
    identity = FOLDS[window.fold].identity
    empty = identity[-1]
    if end == empty:
        return register
    last = emit(Const(end))
    if len(window.args) > 1:  # as far as the first operand lasts
        lasts = "min" if identity[0] > 0 else "max"
        last = emit(Map(lasts, (emit(Window(lasts, 0, None, window.args[:1])), last)))
    return emit(Map("min" if empty > 0 else "max", (register, last)))


def _ends(program: Program, unseen: float) -> list[float | None]:
    """The value that each register keeps in the end; None: that is not known."""
    ends: list[float | None] = []
    for instruction in program.instructions:
        match instruction:
            case Load():
                ends.append(unseen)
            case Const(value):
                ends.append(value)
            case Window(fold, lo) if lo and instruction.skips(best=unseen > 0):
                ends.append(FOLDS[fold].identity[-1])
            case Map() | Window():
                ends.append(_stays(instruction, [ends[a] for a in instruction.args]))
    return ends


def looks_ahead(program: Program) -> bool:
    """Whether a window with an end needs later samples."""
    windows = (i for i in program.instructions if isinstance(i, Window))
    return any(window.hi is not None and window.hi > 0 for window in windows)


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
    """A program that evaluates a window without end on a whole trace, given its operands' columns.

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
def planned(
    program: Program, registers: tuple[int, ...], others: frozenset[int]
) -> tuple[tuple[Folded, ...], Program]:
    """Applies `folded_apart` to the part that computes some registers, its outputs in order.

    The windows name their registers in the whole program.
    """
    outputs = {str(i): register for i, register in enumerate(registers)}
    kept = sorted(program.needed(*registers))
    windows, last = folded_apart(
        program.restricted(registers[0], outputs),
        [i for i, register in enumerate(kept) if register in others],
    )
    return tuple(each._replace(register=kept[each.register]) for each in windows), last


def reaches(program: Program, ahead: Mapping[str, int]) -> list[int]:
    """From how many samples after the first unseen one on each register keeps its value.

    Args:
        program: Its variables keep their values from some sample on.
        ahead: That sample for each variable, counted from the first unseen one.
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
