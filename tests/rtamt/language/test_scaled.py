"""Predicates of a formula in units of their scales."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
import rtamt.language.formula

FORMULAS = [
    "always(x < 3) implies eventually[0:4](y > x + 2)",
    "(x >= 1 and y == 2) until[0:3] (x != y or not (y <= 1))",
    "historically[0:2](x > 0) xor (x since y < 4)",
    "always(x * y >= 2 and abs(x) < 3 and true)",
    "rise(x > 0) iff prev(x > 0)",
]
NUMBERS = st.integers(-4, 4).map(float)


@given(
    text=st.sampled_from(FORMULAS),
    rows=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=9),
    data=st.data(),
)
def test_it_holds_where_the_formula_holds(
    text: str, rows: list[tuple[float, float]], data: st.DataObject
) -> None:
    formula = rtamt.parse(text).formula
    scales = {
        each: data.draw(st.sampled_from([0.001, 0.3, 1.0, 7.0, 1000.0]))
        for each in rtamt.language.formula.predicates(formula)
    }
    x, y = np.array(rows).T
    plain = rtamt.evaluate(formula, {"x": x, "y": y})
    scaled = rtamt.evaluate(rtamt.language.formula.scaled(formula, scales), {"x": x, "y": y})
    np.testing.assert_array_equal(np.signbit(scaled), np.signbit(plain))


def test_each_predicate_counts_in_its_scale() -> None:
    formula = rtamt.parse("always(x < 30 and y > 1)").formula
    low, high = rtamt.language.formula.predicates(formula)
    scaled = rtamt.language.formula.scaled(formula, {low: 10.0})
    trace = {"x": [0.0, 20.0], "y": [3.0, 4.0]}
    assert rtamt.evaluate(formula, trace)[0] == 2.0
    assert rtamt.evaluate(scaled, trace)[0] == 1.0
    assert (
        rtamt.evaluate(rtamt.language.formula.scaled(formula, {low: 10.0, high: 4.0}), trace)[0]
        == 0.5
    )
    assert rtamt.language.formula.scaled(formula, {}) is formula
    assert rtamt.language.formula.predicates(scaled)[1] is high


def test_a_term_that_is_a_formula_is_divided() -> None:
    formula = rtamt.parse("always(x) and y").formula
    assert (
        str(
            rtamt.language.formula.scaled(
                formula, dict.fromkeys(rtamt.language.formula.predicates(formula), 2.0)
            )
        )
        == "always(x / 2) and y / 2"
    )


def test_predicates_are_found_once_in_order() -> None:
    formula = rtamt.parse("always(b > 1) and eventually(a < 2 or b > 1) and true").formula
    assert [str(each) for each in rtamt.language.formula.predicates(formula)] == ["b > 1", "a < 2"]
    assert rtamt.language.formula.predicates(rtamt.parse("true").formula) == ()


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (0, "expected a positive scale of x > 1, got 0"),
        (-2.5, "expected a positive scale of x > 1, got -2.5"),
        (math.inf, "expected a finite number in a term, got inf; write true or false for +-inf"),
        (math.nan, "expected a finite number in a term, got nan; write true or false for +-inf"),
    ],
)
def test_a_scale_is_positive_and_finite(scale: float, message: str) -> None:
    formula = rtamt.parse("always(x > 1)").formula
    with pytest.raises(rtamt.SpecificationError) as caught:
        rtamt.language.formula.scaled(
            formula, {rtamt.language.formula.predicates(formula)[0]: scale}
        )
    assert str(caught.value) == message


def test_a_scale_belongs_to_a_predicate_of_the_formula() -> None:
    formula = rtamt.parse("always(x > 1)").formula
    with pytest.raises(rtamt.SpecificationError) as caught:
        rtamt.language.formula.scaled(formula, {formula: 2.0})
    assert str(caught.value) == "expected scales of predicates of always(x > 1), got always(x > 1)"
