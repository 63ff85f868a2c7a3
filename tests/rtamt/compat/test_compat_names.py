"""The names that the released classes take: what must be declared, and words of the language."""

from collections.abc import Callable
from typing import Any, TypeVar

import pytest

import rtamt
from rtamt.compat.specification import AbstractSpecification

_S = TypeVar("_S", bound=AbstractSpecification)
Kind = Callable[[], AbstractSpecification]

CLASSES: list[Kind] = [
    rtamt.StlDiscreteTimeOnlineSpecification,
    rtamt.StlDiscreteTimeOfflineSpecification,
    rtamt.StlDenseTimeOnlineSpecification,
    rtamt.StlDenseTimeOfflineSpecification,
]


def made(kind: Callable[[], _S], text: str, *names: str) -> _S:
    """A specification of variables of type float, not yet parsed."""
    spec = kind()
    for name in names:
        spec.declare_var(name, "float")
    spec.spec = text
    return spec


@pytest.mark.parametrize("kind", CLASSES)
def test_a_name_that_nobody_declares_is_refused_at_parse(kind: Kind) -> None:
    spec = made(kind, "always[0:1](sped < 30)", "speed")
    with pytest.raises(rtamt.ParseError) as caught:
        spec.parse()
    assert str(caught.value) == (
        "STL:1:13: 'sped' is not declared\n"
        "  always[0:1](sped < 30)\n"
        "              ^\n"
        "  hint: did you mean 'speed'? declare_var('sped', 'float') declares it"
    )
    spec.spec = "always[0:1](speed < 30)"
    spec.parse()
    spec.spec = "sped < 30"
    with pytest.raises(rtamt.ParseError, match="'sped' is not declared"):
        spec.parse()
    spec.add_var("sped")
    spec.parse()


UNDECLARED = [
    ("a > 3", [], "1:1: 'a'", "declare_var('a', 'float') declares it"),
    ("cmd.linear.x > 3", [], "1:1: 'cmd.linear.x'", "declare_var('cmd', 'float') declares it"),
    ("p and quiet", ["p = x > 1"], "2:7: 'quiet'", "declare_var('quiet', 'float') declares it"),
    ("p and x > 1", ["p = yy > 1"], "1:5: 'yy'", "declare_var('yy', 'float') declares it"),
    (
        "sped > x or spede > x",
        ["speed = x + 1"],
        "2:1: 'sped'",
        "did you mean 'speed'? declare_var('sped', 'float') declares it",
    ),
    ("float y; y > 1 and x > 1 and z > 1", [], "1:30: 'z'", "declare it: float z"),
]


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize(("text", "parts", "place", "hint"), UNDECLARED)
def test_the_first_such_name_is_shown_where_it_stands(
    kind: Kind, text: str, parts: list[str], place: str, hint: str
) -> None:
    spec = made(kind, text, "x")
    for part in parts:
        spec.add_sub_spec(part)
    with pytest.raises(rtamt.ParseError) as caught:
        spec.parse()
    assert str(caught.value).startswith(f"STL:{place} is not declared\n")
    assert caught.value.hint == hint


@pytest.mark.parametrize("kind", CLASSES)
def test_calls_and_the_text_may_each_declare_a_part(kind: Kind) -> None:
    spec = made(kind, "float y\nconst float k = 2\nout = p and y > k and x > c", "x")
    spec.declare_const("c", "float", "1")
    spec.add_sub_spec("p = x > 0")
    spec.parse()
    assert {"x", "y", "p", "out", "c"} <= spec.vars


@pytest.mark.parametrize("word", ["min", "max", "rise", "fall", "abs", "sqrt", "log", "s", "ms"])
def test_words_that_the_language_takes_as_names_are_variables(word: str) -> None:
    for text in (f"{word} > 1 and a > 2", f"float b\nonce({word} - 1 > 0) and (a > 2 or b > 99)"):
        discrete = made(rtamt.StlDiscreteTimeSpecification, text, word, "a")
        discrete.parse()
        assert discrete.update(0, [(word, 3.0), ("a", 7.0)]) == 2.0
        assert discrete.evaluate({"time": [0], word: [3.0], "a": [7.0], "b": [0.0]}) == [[0, 2.0]]
        dense = made(rtamt.StlDenseTimeSpecification, text, word, "a")
        dense.parse()
        events = [word, [[0.0, 3.0]]], ["a", [[0.0, 7.0]]], ["b", [[0.0, 0.0]]]
        assert dense.update(*events) == dense.evaluate(*events) == [[0.0, 2.0]]
        assert discrete.get_value(word) == [3.0]


def test_ignored_data_of_a_name_like_an_absent_variable_is_told_in_the_log_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    said = "the data of 'sped' is ignored: no variable has that name; did you mean 'speed'?"
    discrete = made(rtamt.StlDiscreteTimeSpecification, "speed < 30 and gap > 1", "speed", "gap")
    discrete.parse()
    sample: list[tuple[Any, float]] = [("sped", 50.0), ("gap", 5.0), ("other", 1.0), (7, 1.0)]
    for i in range(3):
        assert discrete.update(i, sample) == 4.0
    assert caplog.messages == [said]
    dense = made(rtamt.StlDenseTimeSpecification, "speed < 30 and gap > 1", "speed", "gap")
    dense.parse()
    for i in range(3):
        assert dense.update(["sped", [[i, 50.0]]], ["gap", [[i, 5.0]]], ["other", []]) == []
    assert caplog.messages == [said, said]


def test_data_beside_that_of_all_variables_is_ignored_in_silence(
    caplog: pytest.LogCaptureFixture,
) -> None:
    discrete = made(rtamt.StlDiscreteTimeSpecification, "speed1 < 30", "speed1")
    discrete.parse()
    assert discrete.update(0, [("speed1", 20.0), ("speed2", 50.0)]) == 10.0
    dense = made(rtamt.StlDenseTimeSpecification, "speed1 < 30", "speed1")
    dense.parse()
    assert dense.update(["speed1", [[0, 20.0]]], ["speed2", [[0, 50.0]]]) == [[0.0, 10.0]]
    assert caplog.messages == []
