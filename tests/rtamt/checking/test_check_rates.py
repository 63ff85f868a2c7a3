"""Rates of change, against every trace over a grid of values that keeps them."""

import itertools
import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_texts import VALUES, texts

import rtamt
from rtamt import InputError, InputTypeError, Verdict, judge
from rtamt.checking.encoding import VariableLimits

RATES = st.sampled_from([(-1.0, 1.0), (-0.5, 0.5), (0.0, 1.0), (-2.0, 0.0), (0.5, 1.0)])


@given(text=texts, rate=RATES)
def test_answers_are_those_of_the_traces_that_keep_the_rate(
    text: str, rate: tuple[float, float]
) -> None:
    if "x" not in text:
        return
    found = rtamt.check(text, rates={"x": rate}).requirements["spec"]
    possible = {
        judge(text, {"x": list(trace)}, end="cut").verdict
        for n in range(1, 5)
        for trace in itertools.product(VALUES, repeat=n)
        if all(rate[0] <= b - a <= rate[1] for a, b in itertools.pairwise(trace))
    }
    for verdict, answer in (
        (Verdict.SATISFIED, found.satisfiable),
        (Verdict.VIOLATED, found.falsifiable),
    ):
        if verdict in possible:
            assert answer.says == "yes"
        if answer.trace is not None:
            values = answer.trace.columns.get("x", ())
            assert all(
                rate[0] <= Fraction(b) - Fraction(a) <= rate[1]
                for a, b in itertools.pairwise(values)
            )


@pytest.mark.slow
def test_a_no_names_the_rate_on_which_it_rests() -> None:
    text = "always[0:9](x < 1 implies next(x > 5))"
    found = rtamt.check(text, "100ms", rates={"x": (-2, 2)}).requirements["spec"]
    assert [answer.says for answer in found.asked.values()] == ["no"]
    never = rtamt.check("x < 1 and next(x > 5)", "100ms", rates={"x": (-2, 2)})
    assert never.requirements["spec"].satisfiable.clash == (
        "x < 1",
        "next(x > 5)",
        "rate: x in [-2, 2] per second",
    )


def test_a_rate_is_per_second_or_per_sample() -> None:
    text = "x < 0 and eventually[0:1](x > 1)"
    slow = {"x": (-1.05, 1.05)}
    assert rtamt.check(text, "100ms", rates=slow).requirements["spec"].satisfiable.says == "yes"
    assert rtamt.check(text, rates={"x": (-1, 1)}).requirements["spec"].satisfiable.says == "no"
    assert rtamt.check(text, rates={"x": (-1, 2)}).requirements["spec"].satisfiable.says == "yes"


def test_steps_that_doubles_round_keep_the_rate() -> None:
    found = rtamt.check("x <= 0 and eventually[0:30](x >= 2.9)", rates={"x": (-0.1, 0.1)})
    trace = found.requirements["spec"].satisfiable.trace
    assert trace is not None
    steps = [Fraction(b) - Fraction(a) for a, b in itertools.pairwise(trace.columns["x"])]
    assert max(steps) <= 0.1


def test_what_repeats_keeps_the_rate() -> None:
    text = "always(eventually(x > 3) and eventually(x < 0))"
    found = rtamt.check(text, rates={"x": (-2, 2)}).requirements["spec"].satisfiable
    assert found.trace is not None
    values = found.trace.unrolled("x")
    assert all(abs(b - a) <= 2 for a, b in itertools.pairwise(values))


def test_examples_and_comparisons_keep_rates() -> None:
    text = "always(x > 3 implies eventually[0:4](x < 0))"
    for example in rtamt.examples(text, rates={"x": (-1, 1)})["spec"].examples:
        values = example.trace.unrolled("x")
        assert all(abs(b - a) <= 1 for a, b in itertools.pairwise(values))
    same = rtamt.equivalent("x < 1 and next(x < 5)", "x < 1", rates={"x": (-2, 2)})
    assert same.says == "yes"


@pytest.mark.parametrize(
    ("rates", "message"),
    [
        (
            {"z": (0, 1)},
            "rates= expected variables of the specification, which are x, got 'z'",
        ),
        ({"x": (2, -2)}, "rates= 'x': expected (lower, upper) with lower <= upper, got (2, -2)"),
        ({"x": 3}, "rates= 'x': expected (lower, upper) with lower <= upper, got 3"),
    ],
)
def test_wrong_rates_are_refused(rates: dict[str, tuple[float, float]], message: str) -> None:
    with pytest.raises(InputError) as error:
        rtamt.check("x > 0", rates=rates)
    assert str(error.value) == message


def test_rates_that_are_no_mapping_are_refused() -> None:
    with pytest.raises(InputTypeError) as error:
        rtamt.check("x > 0", rates=[("x", 1)])  # type: ignore[arg-type]
    assert str(error.value) == "rates= expected a mapping of variables, got list"


@pytest.mark.parametrize(
    ("values", "loop", "kept"),
    [
        ((0.0, 1.0, 2.0), 0, True),
        ((0.0, 1.0, 2.0), 3, False),  # from 2 back to 0
        ((0.0, 1.0, 2.0), 1, True),
        ((0.0, 2.0), 0, False),
        ((2.0, 3.5), 0, False),  # out of range
        ((math.inf, math.inf), 0, True),
        ((0.0, math.inf), 0, False),
        ((math.inf, 0.0), 0, False),
    ],
)
def test_values_keep_ranges_and_rates(values: tuple[float, ...], loop: int, *, kept: bool) -> None:
    upper = math.inf if math.inf in values else 3.0
    limits = VariableLimits({"x": (0.0, upper)}, {"x": (-1.0, 1.0)})
    assert limits.kept({"x": values}, loop) is kept
