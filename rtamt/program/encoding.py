"""Programs as the C++ machines read them: tuples of names and numbers.

`rtamt/native/python/encoding.hpp` reads the fields of a row by position. An instruction without a
second operand repeats the first.
"""

from __future__ import annotations

import functools
from fractions import Fraction
from typing import NamedTuple, assert_never

from rtamt.program.dense_lowering import MAX_TICKS, DenseProgram
from rtamt.program.instructions import Const, Instruction, Load, Map, Window
from rtamt.program.placement import Placement, place
from rtamt.program.program import Delay, Program, schedule


class DiscreteRow(NamedTuple):
    """An instruction or a delay line on samples."""

    slot: int  # where the value is written
    kind: str
    name: str
    first: int
    second: int
    value: float
    length: int = 0  # samples in a window or a delay line; 0 for a window without begin
    start: int = 0  # the first sample where a window reads a value of its operands


class FormulaRow(NamedTuple):
    """An instruction after the terms; bounds are samples, or positions of dense time, or None."""

    kind: str
    name: str
    first: int
    second: int
    lo: int | None
    hi: int | None
    guard: bool  # these two as in `rtamt.program.instructions.Window`
    endless: bool


class DenseRow(NamedTuple):
    """An instruction over dense time; bounds are ticks, None for an open window."""

    kind: str
    name: str
    first: int
    second: int
    value: float
    lo: int | None
    hi: int | None


class EncodedRegions(NamedTuple):
    """A program over regions, as in `rtamt.program.placement.Placement`."""

    terms: int
    constants: tuple[tuple[int, float], ...]  # the terms that are constants
    rows: tuple[FormulaRow, ...]
    initial: tuple[int, ...]
    streams: tuple[int, ...]
    unknowns: tuple[int, ...]


class Encoded(NamedTuple):
    """A program: its rows, how many are terms, its variables, the register of its result."""

    rows: tuple[DiscreteRow, ...]
    terms: int
    variables: tuple[str, ...]
    result: int


class EncodedDense(NamedTuple):
    """A program over dense time: as `Encoded`, and its clock.

    The clock is the number of ticks in a unit of time: the nearest double, and the number as a
    quotient of two integers; 0 and 1 if an int64 does not hold them.
    """

    rows: tuple[DenseRow, ...]
    terms: int
    variables: tuple[str, ...]
    result: int
    clock: tuple[float, int, int]


class EncodedEpisode(NamedTuple):
    """A program as in `rtamt.program.placement.Placement`."""

    terms: tuple[DiscreteRow, ...]
    formulas: tuple[FormulaRow, ...]
    initial: tuple[int, ...]
    streams: tuple[int, ...]
    variables: tuple[str, ...]


# Programs are equal only if they are the same object: compilers cache them, so it comes again.
@functools.lru_cache(maxsize=512)
def encoded_discrete(program: Program) -> Encoded:
    """Return the terms of a program on samples, and the schedule of its formulas."""
    rows = _terms(program)
    for slot, scheduled in schedule(program):
        length = start = 0
        if isinstance(scheduled, Delay):
            length = scheduled.length
        elif isinstance(scheduled, Window):
            length, start = scheduled.length or 0, program.start(slot)
        rows.append(DiscreteRow(slot, *_fields(program, scheduled), length, start))
    return Encoded(tuple(rows), program.terms, program.variables, program.result)


@functools.lru_cache(maxsize=256)
def encoded_episode(program: Program) -> EncodedEpisode:
    """Return the placement of a program for the episode machine."""
    placement = place(program)
    program = placement.program
    return EncodedEpisode(
        tuple(_terms(program)),
        _formulas(program),
        placement.initial,
        placement.streams,
        program.variables,
    )


@functools.lru_cache(maxsize=256)
def encoded_regions(placement: Placement) -> EncodedRegions:
    """Return the placement of a program over the regions of dense time."""
    program = placement.program
    terms = enumerate(program.instructions[: program.terms])
    return EncodedRegions(
        program.terms,
        tuple((register, term.value) for register, term in terms if isinstance(term, Const)),
        _formulas(program),
        placement.initial,
        placement.streams,
        placement.unknowns,
    )


@functools.lru_cache(maxsize=512)
def encoded_dense(dense: DenseProgram) -> EncodedDense:
    """Return the instructions of a program over dense time; a row for each register."""
    program = dense.program
    rows = []
    for instruction in program.instructions:
        lo = hi = None
        if isinstance(instruction, Window):
            lo, hi = instruction.lo, instruction.hi
        rows.append(DenseRow(*_fields(program, instruction), lo, hi))
    clock = clock_of(dense.tick)
    return EncodedDense(tuple(rows), program.terms, program.variables, program.result, clock)


def clock_of(tick: Fraction) -> tuple[float, int, int]:
    """Return the clock of `EncodedDense`, for ticks of this length in the unit of time."""
    units, ticks = tick.as_integer_ratio()
    quotient = (ticks, units) if max(ticks, units) < MAX_TICKS else (0, 1)
    return (float(1 / tick), *quotient)


@functools.lru_cache(maxsize=256)
def encoded_terms(program: Program) -> tuple[DiscreteRow, ...]:
    """Return the terms of a program, of any time."""
    return tuple(_terms(program))


def _terms(program: Program) -> list[DiscreteRow]:
    terms = enumerate(program.instructions[: program.terms])
    return [DiscreteRow(register, *_fields(program, term)) for register, term in terms]


def _formulas(program: Program) -> tuple[FormulaRow, ...]:
    rows = []
    for register in range(program.terms, len(program.instructions)):
        instruction = program.formula(register)
        lo = hi = None
        guard = endless = False
        if isinstance(instruction, Window):
            lo, hi = instruction.lo, instruction.hi
            guard, endless = instruction.guard, instruction.endless
        kind, name, first, second, _ = _fields(program, instruction)
        rows.append(FormulaRow(kind, name, first, second, lo, hi, guard, endless))
    return tuple(rows)


def _fields(program: Program, row: Instruction | Delay) -> tuple[str, str, int, int, float]:
    """Return kind, name, first and second operand, and value of an instruction or delay line."""
    match row:
        case Load(variable):
            return "LOAD", variable, program.variables.index(variable), 0, 0.0
        case Const(value):
            return "CONST", "", 0, 0, value
        case Map(function, args):
            return "MAP", function, args[0], args[-1], 0.0
        case Window(fold, _, _, args):
            return "WINDOW", fold, args[0], args[-1], 0.0
        case Delay(_, operand):
            return "DELAY", "", operand, operand, 0.0
        case _ as never:
            assert_never(never)
