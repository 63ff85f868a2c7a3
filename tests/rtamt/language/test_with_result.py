"""A specification with another result is one that its text describes."""

import pickle

import pytest

from rtamt import Formula, Specification, parse

TEXTS = (
    "always(x > 0) and always(x < 9)",
    "input float x; output float y; always(x > 0 implies eventually[0:2](y > 0))",
    "a = x > 0; b = always(a) and eventually(y > 1)",
    "a = x > 0; always(a) and a",
    "specification s; const float c = 3; a = x > c; b = not a",
    "a = always(x > 0); a",
)


def parts(spec: Specification) -> list[Formula]:
    return [node for node in spec.formula.nodes() if isinstance(node, Formula)]


@pytest.mark.parametrize("text", TEXTS)
def test_its_text_and_its_pickle_are_those_of_an_equal_specification(text: str) -> None:
    spec = parse(text)
    for part in parts(spec):
        for other in (
            spec.with_result(part),
            spec.with_result(~part),
            spec.with_result(part).always(),
        ):
            assert parse(other.text) == other
            assert pickle.loads(pickle.dumps(other)) == other
            assert other.declarations == spec.declarations
        assert spec.with_result(part).formula is part


def test_a_requirement_with_another_result_is_no_requirement_of_the_text() -> None:
    spec = parse("a = always(x > 0); b = always(y > 0)").requirements["a"]
    (part,) = spec.formula.args
    assert isinstance(part, Formula)
    other = spec.with_result(part)
    assert other.variables == ("x",)
    assert pickle.loads(pickle.dumps(other)) == other
