"""Programs: their form, their listing, and what they read first."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import VARIABLES, Trace, formulas, traces

import rtamt
from rtamt import Formula, SpecificationError
from rtamt.language.parser import as_specification
from rtamt.program.algebra import FOLDS, FUNCTIONS
from rtamt.program.dense_lowering import compile_dense, compile_regions
from rtamt.program.encoding import encoded_episode
from rtamt.program.instructions import Const, Load, Map, Window, operands
from rtamt.program.interface import STANDARD
from rtamt.program.lowering import ProgramBuilder, compile_program
from rtamt.program.program import Program


def compiled(text: str) -> Program:
    return compile_program(rtamt.parse(text))


PROGRAM = compiled("always[0:2](x + 1 > y) or once[0:1](y > 0)")


@given(formulas(3, endless=True))
def test_programs_are_well_formed(formula: Formula) -> None:
    spec = as_specification(formula)
    tick = Fraction(1)
    dense = (
        []
        if any(n.op and n.op.sampled for n in spec.nodes()) or not spec.variables
        else [compile_dense(spec, tick).program, compile_regions(spec, tick).program]
    )
    for program in (compile_program(spec), *dense):
        assert max(program.result, *program.outputs.values(), 0) < len(program.instructions)
        written = program.instructions[program.terms :]
        assert len(set(written)) == len(written)
        for register, instruction in enumerate(program.instructions):
            assert all(0 <= a < register for a in operands(instruction))
            match instruction:
                case Load() | Const():
                    assert register < program.terms
                    assert isinstance(instruction, Const) or instruction.variable in spec.variables
                case Map(function, args):
                    assert FUNCTIONS[function].arity == len(args)
                    assert register >= program.terms or max(args) < program.terms
                case Window(fold, lo, hi, args):
                    assert register >= program.terms
                    assert FOLDS[fold].width == len(args)
                    assert (hi is not None and hi <= 0) or (lo is not None and lo >= 0)
                    assert lo is None or hi is None or lo <= hi


@pytest.mark.parametrize(
    ("write", "problem"),
    [
        (lambda builder: builder.window("min", -1, 1, 0), "the window of min looks both ways"),
        (lambda builder: builder.window("min", None, None, 0), "the window of min looks both ways"),
        (lambda builder: builder.window("min", 3, 1, 0), "the window of min is empty"),
        (lambda builder: builder.window("min", 0, 2, 0, 0), "min has wrong arity"),
        (lambda builder: builder.map("min", 0), "min has wrong arity"),
    ],
)
def test_wrong_meaning_error(write: Callable[[ProgramBuilder], int], problem: str) -> None:
    builder = ProgramBuilder(rtamt.parse("x > 0"), None, STANDARD, None)
    builder.program()
    with pytest.raises(AssertionError, match=f"^{problem} in the meaning of "):
        write(builder)


def test_equal_calls_share_a_program() -> None:
    spec = rtamt.parse("always(x > 0)")
    program = compile_program(spec)
    assert compile_program(spec, None, interface=STANDARD) is program
    assert compile_program(spec, period=None, online=False) is program


def test_the_listing_says_which_constants_are_neutral() -> None:
    assert "neutral" not in str(PROGRAM)
    neutral = PROGRAM.changed(lambda i: Const(0.0, neutral=True) if i == Const(1.0) else i)
    assert str(neutral).count("CONST 0, neutral ") == 1


def test_the_listing_has_what_waits_for_ever_and_the_registers_of_names() -> None:
    listing = str(compiled("p = x > 1; q = eventually(y > 0); always[0:2](p or q)"))
    assert listing.splitlines() == [
        "0  LOAD x                 0  x",
        "1  CONST 1                0  1",
        "2  MAP above 0 1          0  x > 1",
        "3  LOAD y                 0  y",
        "4  CONST 0                0  0",
        "5  MAP above 3 4          0  y > 0",
        "6  WINDOW max [0, inf] 5  -  eventually(y > 0)",
        "7  MAP max 2 6            -  x > 1 or eventually(y > 0)",
        "8  WINDOW min [0, 2] 7    -  always[0:2](x > 1 or eventually(y > 0))",
        "result 8, p = 2, q = 6",
    ]
    assert str(PROGRAM).splitlines()[-1] == f"result {PROGRAM.result}"


@pytest.mark.parametrize("compiler", [compile_dense, compile_regions])
def test_regions_refuse_what_dense_time_refuses(compiler: Callable[..., object]) -> None:
    spec = rtamt.parse("once[0:4e9](once[0:4e9](x > 0))")
    with pytest.raises(SpecificationError, match="nested here are together 2\\*\\*62 ticks of 1ns"):
        compiler(spec, Fraction(1, 10**9))


@pytest.mark.parametrize(
    ("text", "ticks"),
    [
        ("x > 0", 0),
        ("always(x > 0)", 0),
        ("historically(x > 0)", 0),
        ("once[0:2](x > 0)", 2),
        ("eventually[1:inf](x > 0)", 1),
        ("always[0:2](x > 0) and eventually[1:3](x > 0)", 3),
        ("always[0:2](eventually[1:3](x > 0))", 5),
    ],
)
def test_regions_reach_as_far_as_their_bounds_together(text: str, ticks: int) -> None:
    assert compile_regions(rtamt.parse(text), Fraction(1)).reach == ticks


def test_regions_have_the_named_formulas_that_are_asked_for() -> None:
    spec = rtamt.parse("p = once[0:9](y > 0); x > 0")
    alone = compile_regions(spec, Fraction(1))
    assert (dict(alone.program.outputs), len(alone.program.instructions)) == ({}, 3)
    named = compile_regions(spec, Fraction(1), named=True)
    assert [*named.program.outputs] == ["p"]
    assert isinstance(named.program.instructions[named.program.outputs["p"]], Window)
    assert (alone.reach, named.reach) == (0, 0)


def test_of_the_rows_of_an_episode_only_windows_say_how_an_end_is_read() -> None:
    program = compiled("(x > 0) until[2:inf] (y > 0) or next(x > 0 and y > 0)")
    rows = encoded_episode(program).formulas
    marked = {(row.kind, row.guard, row.endless) for row in rows}
    assert marked == {
        ("MAP", False, False),
        ("WINDOW", False, False),
        ("WINDOW", True, True),
        ("WINDOW", False, True),
    }


@pytest.mark.parametrize(
    ("text", "variables"),
    [
        ("x > 0", {"x"}),
        ("x > y and next(z > 0)", {"x", "y"}),
        ("always[0:1](x > 0) or always[1:2](y > 0)", {"x"}),
        ("eventually(x > 0)", {"x"}),
        ("eventually[1:inf](x > 0)", set()),
        ("once[0:2](x > 0) or prev(y > 0)", {"x"}),
        ("next(once[1:2](x > 0)) and next(prev(y > 0))", {"x", "y"}),
        ("next(prev(x > 0) and once[0:0](y > 0))", {"x"}),
    ],
)
def test_what_is_read_first_is_read_at_sample_0(text: str, variables: set[str]) -> None:
    assert compiled(text).read_first() == variables


@given(formulas(3, endless=True), traces(), st.sampled_from(VARIABLES), st.floats(-9.0, 9.0))
def test_what_is_not_read_first_decides_nothing_at_sample_0(
    formula: Formula, trace: Trace, name: str, other: float
) -> None:
    spec = as_specification(formula)
    if name in spec.variables and name not in compile_program(spec).read_first():
        moved = {**trace, name: [other, *trace[name][1:]]}
        first = [rtamt.evaluate(spec, each)[0] for each in (trace, moved)]
        assert np.array_equal(first[:1], first[1:], equal_nan=True)
