"""The dialect of the language in which operators that do not chain group to the left."""

import pickle

import pytest

import rtamt
from rtamt import ParseError
from rtamt.language.parser import parse_as


@pytest.mark.parametrize(
    ("text", "grouped"),
    [
        ("p > 0 -> q > 0 -> r > 0 -> s > 0", "((p > 0 -> q > 0) -> r > 0) -> s > 0"),
        ("p -> q or r -> s", "(p -> (q or r)) -> s"),
        ("p until[0:2] q until r", "(p until[0:2] q) until r"),
        ("p since q unless[1:2] r", "(p since q) unless[1:2] r"),
        ("always p -> q -> (r -> s -> t)", "(always p -> q) -> ((r -> s) -> t)"),
    ],
)
def test_chains_group_to_the_left_where_they_are_allowed(text: str, grouped: str) -> None:
    spec = parse_as(text, "s", {}, {}, chains=True)
    assert spec.formula is rtamt.parse(grouped).formula
    assert rtamt.parse(str(spec)) == spec
    assert pickle.loads(pickle.dumps(spec)) == spec
    with pytest.raises(ParseError, match="not chain; write"):
        rtamt.parse(text)


def test_comparisons_never_chain() -> None:
    with pytest.raises(ParseError, match=r"'<' does not chain; write \(a < b\) and \(b < c\)"):
        parse_as("a < b < c", "s", {}, {}, chains=True)


def test_a_specification_of_the_dialect_is_read_again_as_what_it_is() -> None:
    text = "const float K = 2; p = x > K -> y > K -> z > L"
    spec = parse_as(text, "ms", {"L": 3, "unused": 4}, {}, chains=True)
    again = pickle.loads(pickle.dumps(spec))
    assert (again, again.text, again.unit, again.chains) == (spec, text, "ms", True)
    assert again.constants == {"K": 2.0, "L": 3.0}
