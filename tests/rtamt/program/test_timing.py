"""Times become samples exactly, or an error names the times that would."""

import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from catalogue import check, entries
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt import InputTypeError, Monitor, SpecificationError, evaluate
from rtamt.program.timing import as_period
from rtamt.typing import Period

HORIZONS: list[tuple[str, Period | None, str, int]] = [
    ("always[0:5](x > 0)", None, "s", 5),
    ("always[0:5](x > 0)", 1, "s", 5),
    ("always[0:5s](x > 0)", 1, "s", 5),
    ("always[0:5](x > 0)", "100ms", "s", 50),
    ("always[0:500ms](x > 0)", 0.1, "s", 5),
    ("always[100:500ms](x > 0)", 0.1, "s", 5),
    ("always[0:0.5](x > 0)", 0.1, "s", 5),
    ("always[0:0.5](x > 0)", "0.1", "s", 5),
    ("always[0:0.5](x > 0)", np.float64(0.1), "s", 5),
    ("always[0:0.5](x > 0)", np.float32(0.1), "s", 5),
    ("always[0:2](x > 0)", np.float32(1 / 15), "s", 30),
    ("always[0:2](x > 0)", 1 / 15, "s", 30),
    ("always[0:2](x > 0)", Fraction(1, 15), "s", 30),
    ("always[0:1](x > 0)", 1 / 3, "s", 3),
    ("always[0:300](x > 0)", "100 us", "us", 3),
    ("always[0:1e3us](x > 0)", 2.5e-4, "s", 4),
    ("always[0:7ns](x > 0)", "1ns", "s", 7),
    ("always[0:1ps](x > 0)", "1ps", "ms", 1),
    ("always[0:1](x > 0)", "1ms", "s", 1000),
    ("next(x > 0)", 0.1, "s", 1),
    ("always[0:0.2](x > 0) and eventually[0:300ms](y > 0)", 0.1, "s", 3),
    ("(x > 0) until[0.1:0.4] (y > 0)", 0.1, "s", 4),
    ("historically[1:2](eventually[0:3](x > 0))", 0.5, "s", 4),
    # The left operand is needed up to the sample before the moment of the right one.
    ("(x > 0) until[0:3] (y > 0)", None, "s", 3),
    ("(eventually[0:1](x > 0)) until[0:3] (y > 0)", None, "s", 3),
    ("(eventually[0:2](x > 0)) until[0:3] (y > 0)", None, "s", 4),
    ("(x > 0) until[0:3] (eventually[0:2](y > 0))", None, "s", 5),
]


@pytest.mark.parametrize(("text", "period", "unit", "latency"), HORIZONS)
def test_bounds_become_whole_samples(text: str, period: Period, unit: str, latency: int) -> None:
    assert Monitor(rtamt.parse(text, unit=unit), period).latency == latency


@given(samples=st.integers(1, 10**6), steps=st.integers(1, 10**4))
def test_a_float_period_means_its_simple_fraction(samples: int, steps: int) -> None:
    assert as_period(samples / steps) == Fraction(samples, steps)


def test_a_float_period_means_a_fraction_within_a_relative_1e_12_of_it() -> None:
    for near in (0.1 * (1 - 9e-13), 0.1 * (1 + 9e-13)):
        assert near != 0.1
        assert as_period(near) == Fraction(1, 10)
    for off in (0.1 * (1 - 11e-13), 0.1 * (1 + 11e-13)):
        assert as_period(off) != Fraction(1, 10)


def test_a_period_and_its_inverse_are_at_most_1e300() -> None:
    for value in (Fraction(10**300), Fraction(1, 10**300)):
        assert as_period(value) == value
    for beyond in (10**300 + 1, 10**301, Fraction(1, 10**300 + 1), Fraction(1, 10**301)):
        with pytest.raises(SpecificationError, match="expected a period from 1e-300 to 1e300 s"):
            as_period(beyond)


def test_the_unit_of_the_end_holds_for_both_bounds() -> None:
    x = {"x": [1.0, 2.0, 3.0, 4.0]}
    assert evaluate("always[100:200ms](x > 0)", x, 0.1).tolist() == [2.0, 3.0, 4.0, math.inf]


def test_periods_scale_time_and_not_values() -> None:
    x = {"x": [5.0, 1.0, 4.0, 2.0]}
    in_samples = evaluate("once[1:2](x > 0)", x)
    assert evaluate("once[0.02:0.04](x > 0)", x, "20ms").tolist() == in_samples.tolist()


ERRORS = entries(Path(__file__).with_name("errors.txt"))

REFUSED: list[tuple[str, Period | None, str]] = [
    ("x > 0 and once[250ms:1s](x > 0)", 0.1, "multiple"),
    ("eventually[150:400ms](x > 0)", 0.1, "multiple"),
    ("eventually[0:400ms](x > 0)", None, "unit"),
    ("eventually[0:2.5](x > 0)", None, "whole number"),
    ("once[0:3000000000](x > 0)", None, "limit"),
    ("once[0:10](x > 0)", "1ns", "limit"),
]


@pytest.mark.parametrize(("text", "period", "word"), REFUSED, ids=[r[0] for r in REFUSED])
def test_bounds_that_are_no_samples_are_refused(text: str, period: Period, word: str) -> None:
    said = set()
    for build in (Monitor, rtamt.EpisodeMonitor):
        with pytest.raises(SpecificationError, match=word) as caught:
            build(text, period)
        said.add(str(caught.value))
    with pytest.raises(SpecificationError, match=word) as caught:
        evaluate(text, {"x": [1.0]}, period)
    said.add(str(caught.value))
    assert len(said) == 1


@pytest.mark.parametrize(("call", "said"), ERRORS, ids=[call for call, _ in ERRORS])
def test_an_error_of_a_program_says_what_was_expected_and_the_way_out(call: str, said: str) -> None:
    check(call, said)


@pytest.mark.parametrize("period", [0, -1, 0.0, -0.1, math.nan, math.inf, "0ms", "-1", "fast", ""])
def test_a_period_is_a_positive_time(period: Period) -> None:
    with pytest.raises(SpecificationError, match="period"):
        Monitor("x > 0", period)


@pytest.mark.parametrize("period", [True, [1], 1j, b"1"])
def test_a_period_is_a_number_or_text(period: Period) -> None:
    with pytest.raises(InputTypeError, match="period"):
        Monitor("x > 0", period)
