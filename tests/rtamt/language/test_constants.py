"""Constants of callers, and texts with traced constants."""

import copy
import pickle
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt import Formula, ParseError, SpecificationError, parse, variable
from rtamt.language.parser import as_specification, traced
from rtamt.program.instructions import Const
from rtamt.program.lowering import compile_program

TEXT = "const float limit = 0.2\nconst float T = 3\nalways[0:T](x < limit) and y > limit"
decimals = st.decimals(0, 100, places=3)


@given(limit=decimals, end=decimals)
def test_passed_constant_overrides_text(limit: str, end: str) -> None:
    spec = rtamt.parse(TEXT, constants={"limit": limit, "T": end})
    written = TEXT.replace("0.2", str(limit)).replace("T = 3", f"T = {end}")
    assert spec == rtamt.parse(written)
    assert spec.formula is rtamt.parse(written).formula
    assert spec.constants == {"limit": float(limit), "T": float(end)}


def test_what_is_not_given_stays() -> None:
    assert rtamt.parse(TEXT, constants={"T": 1}).constants == {"limit": 0.2, "T": 1.0}
    assert rtamt.parse(TEXT).constants == {"limit": 0.2, "T": 3.0}


def test_copies_pickles_and_files_keep_it(tmp_path: Path) -> None:
    path = tmp_path / "swept.stl"
    path.write_text(TEXT)
    spec = rtamt.load(path, constants={"limit": "1e-3"})
    assert spec.overrides == {"limit": Fraction(1, 1000)}
    for twin in (copy.deepcopy(spec), pickle.loads(pickle.dumps(spec)), rtamt.parse(str(spec))):
        assert twin == spec
        assert twin.constants == {"limit": 0.001, "T": 3.0}


def test_a_name_that_the_text_does_not_have_is_refused() -> None:
    expected = {
        (TEXT, "limt"): "the text has no constant 'limt'; did you mean 'limit'?",
        (TEXT, "speed"): "the text has no constant 'speed'; its constants are limit, T",
        ("x < limit", "limt"): "the text has no constant 'limt'; did you mean 'limit'?",
        ("x < 3", "speed"): "the text has no constant 'speed'",
    }
    for (text, name), message in expected.items():
        with pytest.raises(SpecificationError) as caught:
            rtamt.parse(text, constants={name: 1})
        assert str(caught.value) == message


def test_a_value_is_checked_as_if_the_text_had_it() -> None:
    with pytest.raises(ParseError, match="expected a bound of at least 0, got -1"):
        rtamt.parse(TEXT, constants={"T": -1})
    with pytest.raises(ParseError, match="'T' is already declared"):
        rtamt.parse("const float T = 3\nconst float T = 4\nx > T", constants={"T": 1})


TRACED = (
    "const float a = 2; const float b = 2; const float T = 3; always[0:T](x > a * -b + 1 and y < b)"
)


def constants(text: str) -> set[tuple[str, float]]:
    """Return the constants of a program, as text and number."""
    program = compile_program(traced(parse(text)))
    return {(repr(i.value), float(i.value)) for i in program.instructions if isinstance(i, Const)}


def test_traced_numbers_in_program() -> None:
    assert constants(TRACED) == {("add(mul(a, neg(b)), 1)", -3.0), ("b", 2.0)}
    assert constants("const float k = 4; sqrt(k) > k or not k > 1 or x > 3") == {
        ("max(above(sqrt(k), k), neg(above(k, 1)))", -2.0),
        ("3.0", 3.0),
    }


def test_equal_constants_of_two_names_are_told_apart() -> None:
    assert constants("const float a = 1; const float b = 1; x > a and x < b and y > 1") == {
        ("a", 1.0),
        ("b", 1.0),
        ("1.0", 1.0),
    }


def test_what_was_read_twice_is_one_formula() -> None:
    spec = traced(parse(TRACED))
    assert spec.formula is traced(parse(TRACED)).formula
    assert spec.formula is not parse(TRACED).formula
    assert parse(TRACED).formula is parse("always[0:3](x > 2 * -2 + 1 and y < 2)").formula


def test_names_of_bounds_are_known() -> None:
    assert parse(TRACED).bounding == {"T"}
    assert parse("x > 1").bounding == frozenset()


def test_given_values_and_requirements_are_kept() -> None:
    text = "const float v = 5; a = always(x > v); b = always(y < v)"
    spec = traced(parse(text, constants={"v": 7}).requirements["b"])
    assert (str(spec.formula), spec.constants["v"]) == ("always(y < v)", 7.0)
    assert spec.requirement == "b"


def test_a_formula_made_in_python_is_itself() -> None:
    formula: Formula = (variable("x") > 3).always(0, 2)
    assert traced(as_specification(formula)).formula is formula
