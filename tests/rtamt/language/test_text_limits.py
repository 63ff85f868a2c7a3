"""Limits of texts and numbers; hostile input fails before it costs much."""

import contextlib
import pickle
import tracemalloc
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from steps import StepCounter

import rtamt
from rtamt import InputTypeError, Interval, ParseError, RtamtError, SpecificationError
from rtamt.language import parser
from rtamt.language.interval import exact
from rtamt.language.node import MAX_OPERANDS, MAX_PARTS
from rtamt.language.parser import MAX_TEXT
from rtamt.program.timing import as_period

MILLION = 1_000_000
PIECES = [
    *(";", "\n", " ", "\t", "\r\n", "1", "9.", ".", "a", "a ", "a\n", "a.", "_", "é", "\u0661"),
    *("(", ")", "()", "[", "]", "[0:1]", "{", "//", "// a\n", "/**/", "/*", '"', "'", "\\", "\0"),
    *("+", "-", "*x", "x+", "x*", "<", "x<", "=", "x=", "!", "&", "|", "->", ",", ":", "@", "#"),
    *("not ", "G ", "G[0:1]", "x U ", "x->", "x and ", "inf ", "from ", "specification ", "s"),
    *("float x;", "const float c=1;", "p=x>0;", "@topic(x,a)\n", "max(x,", "sqrt(", "1e", "≥"),
]


@pytest.mark.parametrize("piece", PIECES)
def test_a_text_of_a_megabyte_is_refused_unread(piece: str) -> None:
    text = piece * (MILLION // len(piece) + 1) + "x > 0"
    tracemalloc.start()
    try:
        with pytest.raises(SpecificationError) as caught:
            rtamt.parse(text)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert str(caught.value) == (
        f"the text has {len(text)} characters; the limit is {MAX_TEXT}; "
        "write several specifications"
    )
    assert peak < 2**20


@pytest.mark.slow(keep=12)
@pytest.mark.parametrize("piece", PIECES)
def test_the_cost_of_a_text_rises_with_its_length(piece: str) -> None:
    count, costs = StepCounter(), []
    for length in (2_000, 4_000):
        text = piece * (length // len(piece)) + "x > 0"
        parser._cached.cache_clear()
        costs.append(count(refused, text))
    assert costs[1] < 2.2 * costs[0] + 1_000


def refused(text: str) -> None:
    """Parse a text, and ignore errors."""
    with contextlib.suppress(ParseError):
        rtamt.parse(text)


def test_nested_and_operand_limit() -> None:
    text = "p0=x>0;" + "".join(f"p{i + 1}=p{i} and x>{i};" for i in range(1000))
    with pytest.raises(ParseError) as caught:
        rtamt.parse(text)
    assert caught.value.reason == f"the operators have more than {MAX_OPERANDS} operands together"
    assert caught.value.hint == "write the formulas as several specifications"


def test_long_formula_pickles() -> None:
    x = rtamt.variable("x" * 200)
    formula = rtamt.conjunction(x > i for i in range(1000))
    assert len(str(formula)) > MAX_TEXT
    assert pickle.loads(pickle.dumps(formula)) is formula
    spec = rtamt.Specification.of(formula)
    assert pickle.loads(pickle.dumps(spec)) == spec


# docs/language.md states the limits.
NAMES = [
    ("a." * 20_000 + "b", "a dotted name has 20001 parts; the limit is 32"),
    ("a." * 32 + "b", "a dotted name has 33 parts; the limit is 32"),
    ("a" * 256, "a name has 256 characters; the limit is 255"),
]


@pytest.mark.parametrize(("name", "reason"), NAMES, ids=["20001", "33", "256"])
def test_the_parts_of_a_name_are_limited(name: str, reason: str) -> None:
    with pytest.raises(SpecificationError) as caught:
        rtamt.variable(name)
    assert str(caught.value) == reason
    with pytest.raises(ParseError) as parsed:
        rtamt.parse(f"y > 0 and {name} > 0")
    assert (parsed.value.reason, parsed.value.column) == (reason, 11)
    assert parsed.value.hint == "write a shorter name"


@pytest.mark.parametrize("name", ["a." * 31 + "b", "a" * 255], ids=["32", "255"])
def test_the_longest_name_is_monitored(name: str) -> None:
    assert rtamt.Monitor(f"{name} > 0").update({name: 1.0}) == 1.0


def test_the_table_of_messages_grows_with_the_names() -> None:
    count, costs = StepCounter(), []
    for names in (50, 100, 200):
        fields = ".f" * (MAX_PARTS - 1)
        spec = rtamt.parse(" and ".join(f"v{names}x{i}{fields} > 0" for i in range(names)))
        costs.append(count(rtamt.Monitor, spec))
    assert costs[2] - costs[1] < 2.2 * (costs[1] - costs[0])


HUGE = [10**400, 10**5000, Fraction(10**400), Decimal("1e400"), np.longdouble("1e4000")]


@pytest.mark.parametrize("value", HUGE, ids=range(len(HUGE)))
def test_a_number_without_a_double_is_refused(value: float) -> None:
    with pytest.raises(SpecificationError, match="expected a finite number in a term, got"):
        rtamt.number(value)
    with pytest.raises(SpecificationError, match="expected a finite number in a term, got"):
        rtamt.variable("x") > value  # noqa: B015 - it raises


@pytest.mark.parametrize("value", [None, "1", 1j, [1], np.ones(1), np.ones(2), object(), b"1"])
def test_what_is_no_number_is_refused(value: float) -> None:
    with pytest.raises(InputTypeError, match="expected a real number, got"):
        rtamt.number(value)


DIGITS = "1" * 5_000
LONG = [
    (f"const float c = {DIGITS}\nx > c", "expected a number of at most 1000 digits, got 5000"),
    (f"const float c = 0.{DIGITS}\nx > c", "expected a number of at most 1000 digits, got 5002"),
    (f"G[0:{DIGITS}] x", "expected a bound of at most 1000 digits, got 5000"),
    ("G[0:1e99999999] x", "expected a bound between 1e-300 and 1e300, got 1e99999999"),
    (f"G[0:1e{DIGITS}] x", "expected a bound of at most 1000 digits, got 5002"),
]


@pytest.mark.parametrize(("text", "reason"), LONG, ids=range(len(LONG)))
def test_a_number_of_many_digits_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ParseError) as caught:
        rtamt.parse(text)
    assert caught.value.reason == reason


NUMBERS: list[tuple[object, str]] = [
    (DIGITS, "expected a number of at most 1000 characters for it, got 5000"),
    ("0." + DIGITS, "expected a number of at most 1000 characters for it, got 5002"),
    (10**5000, "expected a number between 1e-300 and 1e300 for it, got <int>"),
    (10**301, f"expected a number between 1e-300 and 1e300 for it, got {str(10**301)[:57]}..."),
    (Fraction(1, 10**5000), "expected a number between 1e-300 and 1e300 for it, got <Fraction>"),
    ("1e99999999", "expected a number between 1e-300 and 1e300 for it, got 1e99999999"),
    ("1_0", "expected a finite number for it, got '1_0'"),
    ("\u0661", "expected a finite number for it, got '\u0661'"),
    ("inf", "expected a finite number for it, got 'inf'"),
    ("1/0", "expected a finite number for it, got '1/0'"),
    (Decimal("NaN"), "expected a finite number for it, got Decimal('NaN')"),
]


@pytest.mark.parametrize(("value", "message"), NUMBERS, ids=range(len(NUMBERS)))
def test_a_number_is_checked_before_it_is_computed_with(value: str, message: str) -> None:
    with pytest.raises(SpecificationError) as caught:
        exact(value, "it")
    assert str(caught.value) == message
    with pytest.raises(SpecificationError, match="for the constant 'c'"):
        rtamt.parse("x > c", constants={"c": value})


@given(st.integers(-(2**20), 2**20), st.integers(0, 990), st.integers(1, 2**20))
def test_a_fraction_of_long_whole_numbers_is_exact(small: int, digits: int, below: int) -> None:
    """Only the value of a fraction must be within the limits, not its numerator and denominator."""
    value = Fraction(small * 10**digits + 1, below * 10**digits)
    assert exact(value, "it") == value


PERIODS = [
    *("1e400", "1e99999999", "1e-320", "1e400ms", "-1e400", DIGITS, "1" + "0" * 301, "1_0"),
    *(1e-320, 1e308, 10**400, 10**5000, Fraction(1, 10**400), np.longdouble("1e-4000")),
]


@pytest.mark.parametrize("period", PERIODS, ids=range(len(PERIODS)))
def test_a_period_is_checked_before_it_is_computed_with(period: str) -> None:
    for call in (as_period, lambda p: rtamt.Monitor("always[0:1](x > 0)", p)):
        with pytest.raises(SpecificationError, match=r"^expected a period from 1e-300 to 1e300 s"):
            call(period)


@pytest.mark.parametrize(
    "period", [np.uint64(2**64 - 1), np.int64(2**63 - 1), 2**64, np.int8(3), Fraction(7, 3), "1/3"]
)
def test_a_whole_period_is_exact_whatever_its_type(period: float) -> None:
    value = as_period(period)
    assert value == Fraction(str(period))
    assert type(value.numerator) is int
    assert rtamt.Monitor("next(x > 0)", period).latency == 1


@pytest.mark.parametrize("period", ["1e-300", 1e-300, "1e300"])
def test_an_explanation_is_written_at_any_period(period: str) -> None:
    assert str(rtamt.explain("always(x > 0)", {"x": [1, 0]}, period=period))


@pytest.mark.parametrize("bounds", [(0.5, Fraction(1)), (Fraction(0), 1.5), ("0", None)])
def test_an_interval_is_made_of_fractions(bounds: tuple[Fraction, Fraction]) -> None:
    with pytest.raises(InputTypeError, match="expected a Fraction as the bound of an interval"):
        Interval(*bounds)


class Silent:
    """An object with a repr that raises an error."""

    def __repr__(self) -> str:
        raise RuntimeError


@pytest.mark.parametrize("odd", [Silent(), 10**5000, [10**5000]], ids=range(3))
def test_errors_name_what_cannot_be_printed(odd: Any) -> None:  # noqa: ANN401 - it is anything
    for call in (
        lambda: rtamt.Monitor("x > 0").update(odd),
        lambda: rtamt.Monitor("x > 0", odd),
        lambda: rtamt.number(odd),
        lambda: rtamt.Monitor("x > 0", nan=odd),
        lambda: rtamt.Monitor("x > 0", align=odd),
        lambda: rtamt.Monitor("x > 0", backend=odd),
        lambda: rtamt.parse(odd),
        lambda: rtamt.parse("x > 0", unit=odd),
        lambda: rtamt.explain("x > 0", {"x": [1]}, sample=odd),
        lambda: rtamt.evaluate("true", {}, n=odd),
    ):
        with pytest.raises(RtamtError):
            call()


def test_expanded_names_size_limit() -> None:
    text = "a0 = x > 0 and y > 0\n"
    text += "".join(f"a{i + 1} = a{i} and not a{i}\n" for i in range(24))
    with pytest.raises(ParseError) as error:
        rtamt.parse(text + "a24")
    reason, *_, hint = str(error.value).splitlines()
    assert reason == ("STL:18:11: the formula has 1048575 nodes written out; the limit is 1000000")
    assert hint == "  hint: a name stands for its whole formula; write several specifications"
