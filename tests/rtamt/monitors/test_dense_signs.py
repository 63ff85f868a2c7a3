"""The sign bit of the robustness over dense time: whether the formula holds, at 0 too."""

import itertools
import math
from typing import Literal

import pytest
from dense_oracle import boolean
from dense_signals import INTEGERS, Signals, bitwise, chunked, chunks, play, relevant, signals
from hypothesis import given, settings
from hypothesis import strategies as st
from interface_oracle import SEMANTICS
from strategies import DENSE, formulas, rooted

from rtamt import DenseMonitor, Events, Formula, SemanticsName, evaluate_dense

Backend = Literal["native", "python"]
any_formula = formulas(endless=True, dense=True).filter(lambda f: f.variables)
bounded = formulas(dense=True).filter(lambda f: f.variables)
zeros = signals(INTEGERS)


def holding(robustness: Events) -> list[tuple[float, bool]]:
    """Where the formula begins to hold or to fail, read off the sign bits."""
    steps = [(time, sign > 0) for time, _, sign in bitwise(robustness)]
    return steps[:1] + [y for x, y in itertools.pairwise(steps) if x[1] != y[1]]


def truth(formula: Formula, whole: Signals) -> list[tuple[float, bool]]:
    """The same by the definition, in logic without numbers."""
    steps = boolean(relevant(whole, formula.variables)).breakpoints(formula)
    return [(float(time), value > 0) for time, value in steps]


@settings(max_examples=60)
@given(formula=any_formula, whole=zeros)
def test_the_sign_bit_is_clear_where_the_formula_holds(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    assert holding(evaluate_dense(formula, whole, backend=backend)) == truth(formula, whole)


@settings(max_examples=6)
@pytest.mark.parametrize("name", DENSE)
@given(data=st.data(), whole=zeros)
def test_so_it_is_under_every_operator(
    name: str, data: st.DataObject, whole: Signals, backend: Backend
) -> None:
    strategy = rooted(name, depth=1, endless=True, dense=True)
    formula = data.draw(strategy.filter(lambda f: f.variables))
    assert holding(evaluate_dense(formula, whole, backend=backend)) == truth(formula, whole)


@settings(max_examples=40)
@given(formula=any_formula, whole=zeros)
def test_boolean_semantics_has_infinities_of_the_same_signs(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    robustness = evaluate_dense(formula, whole, semantics="boolean", backend=backend)
    assert all(math.isinf(value) for value in robustness.values.tolist())
    assert holding(robustness) == truth(formula, whole)


@settings(max_examples=40)
@given(formula=bounded, whole=zeros, shares=chunks())
def test_chunks_do_not_change_a_sign(
    formula: Formula, whole: Signals, shares: list[list[float]], backend: Backend
) -> None:
    steps = play(DenseMonitor(formula, backend=backend), chunked(whole, shares))
    assert bitwise(steps) == bitwise(evaluate_dense(formula, whole, backend=backend))


@pytest.mark.parametrize("semantics", [*SEMANTICS, "boolean"])
@settings(max_examples=12)
@given(formula=bounded.filter(lambda f: len(f.variables) > 1), whole=zeros, shares=chunks(2))
def test_back_ends_give_the_same_bits_under_every_semantics(
    semantics: SemanticsName, formula: Formula, whole: Signals, shares: list[list[float]]
) -> None:
    first, *_, last = formula.variables
    plain = semantics in ("standard", "boolean")
    inputs, outputs = (None, None) if plain else ([first], [last])
    native, python = (
        play(
            DenseMonitor(formula, semantics=semantics, inputs=inputs, outputs=outputs, backend=b),
            chunked(whole, shares),
        )
        for b in ("native", "python")
    )
    assert bitwise(native) == bitwise(python)


def test_steps_that_differ_in_the_sign_of_zero_are_not_one(backend: Backend) -> None:
    gears = {"x": [(0, 1), (1, 2), (2, 1), (4, 1)], "y": [(0, 1), (3, 2), (4, 1)]}
    for text, steps in {
        "x >= y": [(0, 0, 1), (1, 1, 1), (2, 0, 1), (3, -1, -1), (4, 0, 1)],
        "x > y": [(0, 0, -1), (1, 1, 1), (2, 0, -1), (3, -1, -1), (4, 0, -1)],
        "x == 1 and y == 1": [(0, 0, 1), (1, -1, -1), (2, 0, 1), (3, -1, -1), (4, 0, 1)],
        "x >= 2 or x < 1": [(0, 0, -1), (1, 0, 1), (2, 0, -1)],
        "not (x >= 2 or x < 1)": [(0, 0, 1), (1, 0, -1), (2, 0, 1)],
        "once[0:1](x >= 2 or x < 1)": [(0, 0, -1), (1, 0, 1), (3, 0, -1)],
    }.items():
        assert bitwise(evaluate_dense(text, gears, backend=backend)) == steps, text
