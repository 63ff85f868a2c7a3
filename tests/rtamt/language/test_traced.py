"""Texts that are read with traced constants."""

from rtamt import Formula, parse, variable
from rtamt.language.parser import as_specification, traced
from rtamt.program.instructions import Const
from rtamt.program.lowering import compile_program

TEXT = (
    "const float a = 2; const float b = 2; const float T = 3; always[0:T](x > a * -b + 1 and y < b)"
)


def constants(text: str) -> set[tuple[str, float]]:
    """The constants of a program, as text and number."""
    program = compile_program(traced(parse(text)))
    return {(repr(i.value), float(i.value)) for i in program.instructions if isinstance(i, Const)}


def test_a_program_says_how_its_numbers_follow_from_constants() -> None:
    assert constants(TEXT) == {("add(mul(a, neg(b)), 1)", -3.0), ("b", 2.0)}
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
    spec = traced(parse(TEXT))
    assert spec.formula is traced(parse(TEXT)).formula
    assert spec.formula is not parse(TEXT).formula
    assert parse(TEXT).formula is parse("always[0:3](x > 2 * -2 + 1 and y < 2)").formula


def test_names_of_bounds_are_known() -> None:
    assert parse(TEXT).bounding == {"T"}
    assert parse("x > 1").bounding == frozenset()


def test_given_values_and_requirements_are_kept() -> None:
    text = "const float v = 5; a = always(x > v); b = always(y < v)"
    spec = traced(parse(text, constants={"v": 7}).requirements["b"])
    assert (str(spec.formula), spec.constants["v"]) == ("always(y < v)", 7.0)
    assert spec.requirement == "b"


def test_a_formula_made_in_python_is_itself() -> None:
    formula: Formula = (variable("x") > 3).always(0, 2)
    assert traced(as_specification(formula)).formula is formula
