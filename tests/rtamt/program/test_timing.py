"""Time becomes samples exactly, or an error that says which times would."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt import InputTypeError, Monitor, Period, SpecificationError, evaluate
from rtamt.program.timing import as_period

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
]


@pytest.mark.parametrize(("text", "period", "unit", "latency"), HORIZONS)
def test_bounds_become_whole_samples(text: str, period: Period, unit: str, latency: int) -> None:
    assert Monitor(rtamt.parse(text, unit=unit), period).latency == latency


@given(samples=st.integers(1, 10**6), steps=st.integers(1, 10**4))
def test_a_float_period_means_its_simple_fraction(samples: int, steps: int) -> None:
    assert as_period(samples / steps) == Fraction(samples, steps)


def test_the_unit_of_the_end_holds_for_both_bounds() -> None:
    x = {"x": [1.0, 2.0, 3.0, 4.0]}
    assert evaluate("always[100:200ms](x > 0)", x, 0.1).tolist() == [2.0, 3.0, 4.0, math.inf]


def test_periods_scale_time_and_not_values() -> None:
    x = {"x": [5.0, 1.0, 4.0, 2.0]}
    in_samples = evaluate("once[1:2](x > 0)", x)
    assert evaluate("once[0.02:0.04](x > 0)", x, "20ms").tolist() == in_samples.tolist()


REFUSED: list[tuple[str, Period | None, str]] = [
    (
        "always[0:0.25](x > 0)",
        0.1,
        (
            "STL:1:7: bound 0.25 s is not a multiple of the period 0.1 s (2.5 steps)\n"
            "  always[0:0.25](x > 0)\n"
            "        ^\n"
            "  hint: use 0.2 s or 0.3 s, take samples 0.05 s apart, or let align= round it"
        ),
    ),
    (
        "x > 0 and once[250ms:1s](x > 0)",
        "100ms",
        (
            "STL:1:15: bound 0.25 s is not a multiple of the period 0.1 s (2.5 steps)\n"
            "  x > 0 and once[250ms:1s](x > 0)\n"
            "                ^\n"
            "  hint: use 0.2 s or 0.3 s, take samples 0.05 s apart, or let align= round it"
        ),
    ),
    (
        "eventually[150:400ms](x > 0)",
        0.1,
        (
            "STL:1:11: bound 150 ms is not a multiple of the period 0.1 s (1.5 steps)\n"
            "  eventually[150:400ms](x > 0)\n"
            "            ^\n"
            "  hint: use 100 ms or 200 ms, take samples 0.05 s apart, or let align= round it"
        ),
    ),
    (
        "eventually[0:400ms](x > 0)",
        None,
        (
            "STL:1:11: [0:400ms] has a unit, but no period is known\n"
            "  eventually[0:400ms](x > 0)\n"
            "            ^\n"
            "  hint: give period= in seconds or as text such as '100ms', or write bounds in samples"
        ),
    ),
    (
        "eventually[0:2.5](x > 0)",
        None,
        (
            "STL:1:11: bound 2.5 is not a whole number of samples\n"
            "  eventually[0:2.5](x > 0)\n"
            "            ^\n"
            "  hint: use 2 or 3, give period= for bounds in time, or let align= round it"
        ),
    ),
    (
        "once[0:3000000000](x > 0)",
        None,
        (
            "STL:1:5: bound 3000000000 is 3000000000 samples; the limit is 2147483648\n"
            "  once[0:3000000000](x > 0)\n"
            "      ^\n"
            "  hint: write a smaller bound or a longer period"
        ),
    ),
    (
        "once[0:10](x > 0)",
        "1ns",
        (
            "STL:1:5: bound 10 s is 10000000000 samples; the limit is 2147483648\n"
            "  once[0:10](x > 0)\n"
            "      ^\n"
            "  hint: write a smaller bound or a longer period"
        ),
    ),
]


@pytest.mark.parametrize(("text", "period", "message"), REFUSED, ids=[r[0] for r in REFUSED])
def test_bounds_that_are_no_samples_are_refused(text: str, period: Period, message: str) -> None:
    for build in (Monitor, rtamt.EpisodeMonitor):
        with pytest.raises(SpecificationError) as caught:
            build(text, period)
        assert str(caught.value) == message
    with pytest.raises(SpecificationError) as caught:
        evaluate(text, {"x": [1.0]}, period)
    assert str(caught.value) == message


@pytest.mark.parametrize("period", [0, -1, 0.0, -0.1, math.nan, math.inf, "0ms", "-1", "fast", ""])
def test_a_period_is_a_positive_time(period: Period) -> None:
    with pytest.raises(SpecificationError) as caught:
        Monitor("x > 0", period)
    assert str(caught.value) == (
        f'expected a period from 1e-300 to 1e300 s, or text such as "100ms", got {period!r}'
    )


@pytest.mark.parametrize("period", [True, [1], 1j, b"1"])
def test_a_period_is_a_number_or_text(period: Period) -> None:
    with pytest.raises(InputTypeError) as caught:
        Monitor("x > 0", period)
    assert str(caught.value) == (
        f'expected a period in seconds or as text such as "100ms", got {period!r}'
    )


def test_a_formula_made_in_python_names_itself_where_there_is_no_text() -> None:
    formula = (rtamt.variable("x") > 0).always(0, 2.5)
    with pytest.raises(SpecificationError) as caught:
        Monitor(formula)
    assert str(caught.value) == (
        "bound 2.5 is not a whole number of samples\n"
        "  in always[0:2.5](x > 0)\n"
        "  hint: use 2 or 3, give period= for bounds in time, or let align= round it"
    )
