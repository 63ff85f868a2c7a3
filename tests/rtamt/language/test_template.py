"""Templates: a text with other values of its constants."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from copy import deepcopy
from fractions import Fraction

import pytest
from hypothesis import assume, given
from named_numbers import Named, with_names
from strategies import formulas

from rtamt import Formula, ParseError, Specification, SpecificationError, parse
from rtamt.errors import InputTypeError
from rtamt.language import SpecificationTemplate
from rtamt.language.grammar import reader

named = formulas(endless=True).flatmap(lambda formula: with_names(str(formula)))


def content(spec: Specification) -> tuple[object, ...]:
    """Return the content of a specification, with the nodes that have a place in its text.

    The place of an operator with an interval is the interval. It differs from the place of an
    operator whose bounds a text omits.
    """
    maps: list[Mapping[object, object]] = [spec.uses, spec.overrides, spec.types]  # type: ignore[list-item]
    places = {
        n: where for n, where in spec.positions.items() if n.interval is not None or n.op is None
    }
    parts = (spec, str(spec), spec.text, spec.bounding, spec.requirement)
    return (*parts, places, spec.positions.keys(), *map(dict, maps))


@given(named)
def test_template_matches_parse(named: Named) -> None:
    spec = parse(named.text, constants=named.first)
    template = SpecificationTemplate(spec)
    assert template.names == named.first.keys()
    try:
        expected = parse(named.text, constants={**named.first, **named.then})
    except SpecificationError:  # of several wrong bounds, each error may name another
        with pytest.raises(SpecificationError, match="expected a bound of at least"):
            template.at(named.then)
    else:
        assert content(template.at(named.then)) == content(expected)
    assert content(template.at(named.first)) == content(spec)


@given(named)
def test_template_formula_is_interned(named: Named) -> None:
    assume("--" not in named.written.replace(" ", ""))  # two signs in a row are not a bound
    try:
        expected = parse(named.written)
    except SpecificationError:
        return
    template = SpecificationTemplate(parse(named.text, constants=named.first))
    assert template.at(named.then).formula is expected.formula


TEXT = (
    "specification s\nconst float w = 2\nconst float top = 9\ninput float x in [0, top] = 1\n"
    'float v\n@ topic(v, /v)\n@ id(near, "R-1")\n'
    "near = always(x > -w)\nsoon = eventually[w ms:top](near and v > 1)\nfast = always(v < w)"
)


def test_requirements_ranges_and_units_follow() -> None:
    spec = parse(TEXT.replace("w ms:top", "w:top ms"), unit="ms")
    template = SpecificationTemplate(spec)
    expected = parse(spec.text, unit="ms", constants={"w": "0.5", "top": Fraction(7, 2)})
    filled = template.at({"w": "0.5", "top": Fraction(7, 2)})
    assert content(filled) == content(expected)
    assert filled.ranges["x"] == (0.0, 3.5)
    for name, part in spec.requirements.items():
        other = SpecificationTemplate(part).at({"w": 3, "top": 4})
        assert content(other) == content(
            parse(spec.text, unit="ms", constants={"w": 3, "top": 4}).requirements[name]
        )


def test_a_bound_follows_from_a_negated_constant() -> None:
    template = SpecificationTemplate("const float N = -3; always[-N:-N s](x > 0)")
    assert template.names == {"N"}
    assert template.at({"N": "-0.5"}).formula is parse("always[0.5:0.5 s](x > 0)").formula


def test_the_text_is_read_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = parse("const float w = 2; always(eventually[0:w](x > w))")
    template = SpecificationTemplate(spec)
    reads: list[str] = []
    monkeypatch.setattr(reader, "read", reads.append)
    for value in range(1, 20):
        wanted = f"always eventually[0:{value}](x > {value})"
        assert str(template.at({"w": value}).formula) == wanted
    assert reads == []


def test_a_template_is_copied_and_pickled() -> None:
    template = SpecificationTemplate(parse("always(x < limit)", constants={"limit": 2}))
    for copy in (deepcopy(template), pickle.loads(pickle.dumps(template))):
        assert copy.at({"limit": 3}) == parse("always(x < limit)", constants={"limit": 3})


@pytest.mark.parametrize(
    ("values", "parts"),
    [
        ({"limt": 3}, "the text has no constant 'limt'; did you mean 'limit'?"),
        ({"x": 3}, "the text has no constant 'x'; its constants are"),
        ({"unused": 3}, "nothing in the text uses the constant 'unused'"),
        ({"w": -1}, "expected a bound of at least 0, got -1"),
        ({"limit": "much"}, "expected a finite number for the constant 'limit', got 'much'"),
        ({"top": -1}, "expected 0 or more as the maximum, got -1"),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, object], parts: str) -> None:
    text = (
        "const float limit = 2; const float unused = 1; const float w = 1; const float top = 4; "
        "float x in [0, top]; eventually[0:w](x < limit)"
    )
    with pytest.raises(SpecificationError) as caught:
        SpecificationTemplate(text).at(values)  # type: ignore[arg-type]
    assert parts in str(caught.value)


def test_an_error_shows_the_place() -> None:
    with pytest.raises(ParseError) as caught:
        SpecificationTemplate("const float w = 1; always(eventually[0:w](x > 0))").at({"w": -2})
    assert "STL:1:37" in str(caught.value)
    assert "with w = -2" in str(caught.value)


def test_values_without_names_are_refused() -> None:
    with pytest.raises(InputTypeError, match="values of constants by name"):
        SpecificationTemplate("const float w = 1; always(x > w)").at([1])  # type: ignore[arg-type]


def test_a_formula_has_no_constants() -> None:
    formula: Formula = parse("always(x > 1)").formula
    assert SpecificationTemplate(formula).names == frozenset()


def test_equal_requirements_error() -> None:
    text = "const float p = 1; const float q = 2; a = x > p; b = x > 5; x > q"
    template = SpecificationTemplate(parse(text).requirements["spec"])
    assert template.at({"q": 3}).formula is parse("x > 3").formula
    with pytest.raises(SpecificationError) as caught:
        template.at({"q": 1})
    assert str(caught.value) == (
        "with these constants the requirement 'spec' equals another one: x > 1"
    )
