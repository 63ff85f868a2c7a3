"""Interval arithmetic of every function, against its values at points inside the intervals."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bits import bits, identical
from interval_oracle import NUMBERS, Ends, contains, hull, some_ends, values
from numpy.typing import NDArray

from rtamt import InputError, parse
from rtamt.inputs.samples import SampleReader
from rtamt.machines.backend import BACKENDS
from rtamt.machines.terms import FindRanges
from rtamt.program.algebra import EVERYTHING, FUNCTIONS, Range, everything, of_ends, range_of
from rtamt.program.instructions import Const, Load, Map
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program

INF = math.inf

WIDER = ("exp", "ln", "pow", "log")
"""Functions with ends a step further out, and sometimes with all values."""


def found(name: str, *operands: Ends) -> Ends | None:
    row = FUNCTIONS[name]
    made = range_of(row.apply, row.rule, *(Range(*ends) for ends in operands))
    return None if made is None else made[:2]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_value_lies_inside(name: str) -> None:
    row, rng = FUNCTIONS[name], random.Random(name)
    for _ in range(200):
        operands = [some_ends(rng) for _ in range(row.arity)]
        ends = found(name, *operands)
        for value in values(row.apply, operands, rng):
            assert ends is not None, (operands, value)
            assert contains(ends, value), (operands, value, ends)


@pytest.mark.parametrize(
    "name",
    [name for name, row in FUNCTIONS.items() if name not in WIDER and row.rule is not everything],
)
def test_both_ends_are_values(name: str) -> None:
    row, rng = FUNCTIONS[name], random.Random(name)
    exact = 0
    for _ in range(200):
        operands = [some_ends(rng) for _ in range(row.arity)]
        ends = found(name, *operands)
        if ends is None:
            assert not list(values(row.apply, operands, rng)), operands
        elif ends != EVERYTHING:
            its = list(values(row.apply, operands, rng))
            if name in ("equal", "unequal"):  # both are equal at a point outside our list
                its.append(0.0 if name == "equal" else -0.0)
                near = ends[1] if name == "equal" else -ends[0]
                its = its if near == 0.0 else its[:-1]
            if name in ("eq", "ne") and ends == (-INF, INF):
                continue
            assert identical(hull(its), ends), (operands, hull(its), ends)
            exact += 1
    assert exact > (0 if name in ("eq", "ne") else 60)


def steps(x: float, y: float) -> int:
    """Return the number of doubles between two of the same sign."""
    bits = np.array([x, y]).view(np.int64)
    return abs(int(bits[0] - bits[1]))


@pytest.mark.parametrize(("name", "most"), [("exp", 1), ("ln", 1), ("pow", 1), ("log", 4)])
def test_rounded_functions_are_a_step_wider(name: str, most: int) -> None:
    row, rng = FUNCTIONS[name], random.Random(name)
    numbers = [x for x in NUMBERS if 0.25 <= x <= 100.0]
    wider = 0
    for _ in range(200):
        operands = [some_ends(rng, numbers) for _ in range(row.arity)]
        ends = found(name, *operands)
        assert ends is not None
        if ends == EVERYTHING:  # a base of a logarithm may be 1
            continue
        least, greatest = hull(values(row.apply, operands, rng))
        if math.isinf(greatest) or math.isinf(least) or 0.0 in (least, greatest):
            continue
        assert steps(ends[0], least) <= most
        assert steps(ends[1], greatest) <= most
        wider += ends[0] < least and ends[1] > greatest
    assert wider > 60


def test_what_the_rules_say() -> None:
    everything = EVERYTHING
    assert found("abs", everything) == (0.0, INF)
    assert found("abs", (-3.0, 2.0)) == (0.0, 3.0)
    assert found("exp", everything) == (0.0, INF)  # a step further would be negative
    assert found("sqrt", (-4.0, 4.0)) == (0.0, 2.0)  # the part without a root is omitted
    assert found("sqrt", (-4.0, -1.0)) is None
    assert found("ln", (-4.0, -1.0)) is None
    assert found("ln", (-4.0, 1.0)) == (-INF, 5e-324)
    assert found("log", (1.0, 2.0), (-3.0, -2.0)) is None
    # A divisor that may be 0, of either sign, and one that may not.
    assert found("div", (1.0, 2.0), (-1.0, 1.0)) == everything
    assert found("div", (1.0, 2.0), (0.0, 1.0)) == everything
    assert found("div", (1.0, 2.0), (-1.0, -0.0)) == everything
    assert found("div", (1.0, 2.0), (0.5, 1.0)) == (1.0, 4.0)
    # Ends that are not numbers.
    assert found("add", (-INF, 1.0), (2.0, INF)) == everything
    assert found("mul", (0.0, 1.0), (2.0, INF)) == everything
    # Powers: everything, unless the power is monotone in both operands.
    assert found("pow", (-1.0, 2.0), (2.0, 2.0)) == everything
    assert found("pow", (-1.0, 2.0), (0.0, 3.0)) == everything
    for operands, ends in {
        ((-3.0, -2.0), (2.0, 2.0)): (4.0, 9.0),
        ((-2.0, 3.0), (3.0, 3.0)): (-8.0, 27.0),
        ((2.0, 3.0), (-1.0, 2.0)): (1 / 3, 9.0),
        ((-2.0, 4.0), (0.5, 0.5)): (0.0, 2.0),
        ((-2.0, 4.0), (0.25, 0.5)): (0.0, 2.0),
    }.items():
        got = found("pow", *operands)
        assert got is not None
        assert [steps(*pair) for pair in zip(got, ends, strict=True)] <= [1, 1], operands
        assert got[0] <= ends[0]
        assert got[1] >= ends[1]
    for zero, ends in (((-0.0, 3.0), (0.0, 9.0)), ((-0.0, 0.0), (0.0, 5e-324))):
        got = found("pow", zero, (2.0, 2.0))
        assert got is not None
        assert [steps(*pair) for pair in zip(got, ends, strict=True)] <= [1, 1], zero
    assert found("pow", (-3.0, -2.0), (0.5, 0.5)) is None
    assert found("pow", (-INF, -2.0), (0.5, 0.5)) == everything  # inf is that power of -inf


def test_known_operands_give_the_value_itself() -> None:
    rng = random.Random(5)
    for name, row in FUNCTIONS.items():
        for _ in range(100):
            at = [rng.choice(NUMBERS) for _ in range(row.arity)]
            made = range_of(row.apply, row.rule, *(Range(x, x, known=True) for x in at))
            value = row.apply(*at)
            if math.isnan(value):
                assert made is None
            else:
                assert made is not None
                assert made.known, name
                assert identical(made[:2], (value, value))
    # A divisor that is known to be 0 follows IEEE 754; one that reads an unknown sample does not.
    row = FUNCTIONS["div"]
    one, zero = Range(1.0, 2.0), Range(0.0, 0.0, known=True)
    assert range_of(row.apply, row.rule, one, zero) == (INF, INF, False)
    assert range_of(row.apply, row.rule, one, zero._replace(known=False)) == (*EVERYTHING, False)
    assert [of_ends(*ends).known for ends in ((1.0, 1.0), (-0.0, 0.0), (0.0, 0.0))] == [
        True,
        False,
        True,
    ]


def applied(name: str, arity: int) -> Program:
    """Return a program that applies a function to two variables and a constant."""
    model = compile_program(parse("x + y > 0"))
    terms: list[Any] = [Load("x"), Load("y"), Const(2.0), Map(name, (0, 1)[:arity])]
    terms += [Map(name, (3, 2)[:arity]), Map(name, (2, 3)[:arity])]
    return replace(
        model,
        instructions=tuple(terms),
        terms=len(terms),
        result=len(terms) - 1,
        outputs={},
        sources=model.sources[:1] * len(terms),
    )


def outcome(
    find: FindRanges, program: Program, columns: Sequence[list[NDArray[np.float64]]]
) -> str | list[int]:
    """Return the bits of all ends, or the error."""
    try:
        reader = SampleReader(program, bounds=True)
        found = find(program, reader, range(program.terms), columns[0], columns[1], 1)
        return bits(np.array(found).ravel())
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_both_back_ends_agree_to_the_bit(name: str) -> None:
    program = applied(name, FUNCTIONS[name].arity)
    rng, compared = random.Random(name), 0
    first, *others = (BACKENDS[b].term_ranges for b in BACKENDS)
    zeros, more, nothing, two = (-0.0, 0.0), (-0.0, 3.0), (0.0, 0.0), (2.0, 2.0)
    given = [list(pair) for pair in itertools.product((zeros, more, nothing, two), repeat=2)]
    given += [[some_ends(rng) for _ in range(2)] for _ in range(500)]
    for ends in given:
        columns = [[np.array([each[i]]) for each in ends] for i in range(2)]
        expected = outcome(first, program, columns)
        for find in others:
            assert outcome(find, program, columns) == expected, ends
        compared += not isinstance(expected, str)
    assert compared > 100


def test_a_function_of_which_nothing_is_known_may_be_everything() -> None:
    known, unknown = Range(2.0, 2.0, known=True), Range(1.0, 3.0)
    assert range_of(lambda x, y: x - y, everything, known, known) == Range(0.0, 0.0, known=True)
    assert range_of(lambda x, y: x - y, everything, known, unknown) == Range(*EVERYTHING)
