"""Programs as the C++ machines read them: tuples of names and numbers.

Names of instructions, functions and lattice folds cross as text. `rtamt/native/python/encoding.hpp`
reads the fields by position, in the order of their definition. An instruction without a second
operand repeats the first.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import NamedTuple, assert_never

from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.placement import place
from rtamt.program.program import Const, Load, Map, Program, Window
from rtamt.program.schedule import Delay, Scheduled, schedule

__all__ = [
    "DenseRow",
    "DiscreteRow",
    "Encoded",
    "EncodedEpisode",
    "FormulaRow",
    "encoded_dense",
    "encoded_discrete",
    "encoded_episode",
]


class DiscreteRow(NamedTuple):
    """An instruction or a delay line on samples.

    Attributes:
        slot: Where the value is written.
        length: Samples in a window or a delay line; 0 for a window without begin.
        start: The first sample at which a window takes in a value of its operands.
    """

    slot: int
    kind: str
    name: str
    first: int
    second: int
    value: float
    length: int
    start: int


class FormulaRow(NamedTuple):
    """An instruction after the terms; a bound is None where a window has none."""

    kind: str
    name: str
    first: int
    second: int
    lo: int | None
    hi: int | None


class DenseRow(NamedTuple):
    """An instruction over dense time; bounds are times, -inf or inf where a window has none."""

    kind: str
    name: str
    first: int
    second: int
    value: float
    lo: float
    hi: float


class Encoded(NamedTuple):
    """A program: its rows, how many are terms, its variables, the register of its result."""

    rows: tuple[DiscreteRow, ...] | tuple[DenseRow, ...]
    terms: int
    variables: tuple[str, ...]
    result: int


class EncodedEpisode(NamedTuple):
    """A program as `rtamt.program.placement.Placement` describes it."""

    terms: tuple[DiscreteRow, ...]
    formulas: tuple[FormulaRow, ...]
    initial: tuple[int, ...]
    streams: tuple[int, ...]
    variables: tuple[str, ...]


# Programs are equal only if they are the same object: compilers cache them, so it comes again.
@functools.lru_cache(maxsize=512)
def encoded_discrete(program: Program) -> Encoded:
    """The schedule of a program on samples."""
    return Encoded(_scheduled(program), program.terms, program.variables, program.result)


@functools.lru_cache(maxsize=256)
def encoded_episode(program: Program) -> EncodedEpisode:
    """The placement of a program, for the machine that bounds an episode."""
    placement = place(program)
    program = placement.program
    known = program.terms
    terms = replace(
        program, instructions=program.instructions[:known], latencies=program.latencies[:known]
    )
    formulas = []
    for instruction in program.instructions[known:]:
        kind, name, first, second, _ = _fields(program, instruction)
        lo = hi = None
        if isinstance(instruction, Window):
            lo, hi = instruction.lo, instruction.hi
        formulas.append(FormulaRow(kind, name, first, second, lo, hi))
    return EncodedEpisode(
        _scheduled(terms), tuple(formulas), placement.initial, placement.streams, program.variables
    )


@functools.lru_cache(maxsize=512)
def encoded_dense(dense: DenseProgram) -> Encoded:
    """The instructions of a program over dense time; a row for each register."""
    program = dense.program
    rows = []
    for instruction in program.instructions:
        lo = hi = 0.0
        if isinstance(instruction, Window):
            lo = -math.inf if instruction.lo is None else dense.time(instruction.lo)
            hi = math.inf if instruction.hi is None else dense.time(instruction.hi)
        rows.append(DenseRow(*_fields(program, instruction), lo, hi))
    return Encoded(tuple(rows), program.terms, program.variables, program.result)


def _scheduled(program: Program) -> tuple[DiscreteRow, ...]:
    rows = []
    for slot, instruction in schedule(program):
        length = start = 0
        if isinstance(instruction, Delay):
            length = instruction.length
        elif isinstance(instruction, Window):
            length, start = instruction.length or 0, program.start(slot)
        rows.append(DiscreteRow(slot, *_fields(program, instruction), length, start))
    return tuple(rows)


def _fields(program: Program, instruction: Scheduled) -> tuple[str, str, int, int, float]:
    """Kind, name, first operand, second operand and value of an instruction."""
    match instruction:
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
