"""Common parts of errors: their arguments, and hints with the nearest name."""

import ast
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st
from paths import ROOT
from steps import StepCounter

import rtamt
from rtamt.errors import Advice, Argument, Message, closest, nearest, shown_lines

LETTERS = st.text("abc", min_size=1, max_size=12)


@given(st.lists(LETTERS | st.integers() | st.none()), LETTERS)
def test_the_nearest_name_is_one_of_the_texts(names: list[object], name: str) -> None:
    close = closest(name, names)
    assert close is None or close in names
    assert nearest(name, names) == ("" if close is None else f"; did you mean {close!r}?")
    assert closest(name, [*names, name]) == name


@pytest.mark.parametrize("given_name", [3, None, ["x"]])
def test_what_is_no_text_is_near_to_nothing(given_name: object) -> None:
    assert nearest(given_name, ["x", 3]) == ""


def test_a_long_name_costs_no_search() -> None:
    count = StepCounter()
    short = count(nearest, "x" * 50, ["y" * 50])
    assert count(nearest, "x" * 4000, ["y" * 4000]) < short
    assert count(nearest, "x" * 50, ["y" * 4000]) < short
    text = "x > 1 and {} > 2"
    spec = "float y; " + text
    (known, unknown) = (
        count(_refused, spec.format("z" * letters)) / letters for letters in (60, 4000)
    )
    assert unknown < known


def _refused(text: str) -> None:
    with pytest.raises(rtamt.ParseError):
        rtamt.parse(text)


def test_names_are_compared_in_one_place() -> None:
    result = {
        path.relative_to(ROOT).as_posix()
        for package in ("rtamt", "rtamt_gym", "rtamt_ros", "envs")
        for path in (ROOT / package).rglob("*.py")
        if "generated" not in path.parts
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Import) and node.names[0].name == "difflib"
    }
    assert result == {"rtamt/errors.py"}


ARGUMENTS = st.builds(Argument, LETTERS, st.just(...) | LETTERS | st.integers())
PIECES = st.recursive(
    st.text() | ARGUMENTS,
    lambda inner: st.lists(inner).map(lambda pieces: Message(*pieces)) | inner.map(Advice),
)


def printed(piece: object) -> str:
    return shown_lines(piece) if type(piece) is str else str(piece)


@given(st.lists(PIECES, min_size=1))
def test_message_text_in_python(pieces: list[object]) -> None:
    error = rtamt.InputError(*pieces)
    assert str(error) == error.message == "".join(map(printed, pieces))
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.arguments) == (type(error), str(error), error.arguments)
    around = rtamt.InputError("trace 3: ", error)
    assert str(around) == f"trace 3: {error}"
    assert around.arguments == error.arguments


@given(st.text(), st.lists(st.text() | ARGUMENTS))
def test_a_program_without_options_gives_no_advice(text: str, pieces: list[object]) -> None:
    message = Message(text, Advice(*pieces))
    helpful = not any(isinstance(piece, Argument) for piece in pieces)
    assert message.worded(lambda _: None) == (message if helpful else printed(text))
    assert message.worded(str) == message


def test_arguments_of_a_parse_error() -> None:
    with pytest.raises(rtamt.ParseError) as caught:
        rtamt.Monitor("always[0:1](x > 0)", 0.4)
    assert caught.value.arguments == ("align",)
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.arguments) == (str(caught.value), ("align",))


@pytest.mark.parametrize("text", ["always[0:1ps](x > 0)", rtamt.parse("always[0:1ps](x > 0)")])
def test_hint_without_option_is_omitted(
    text: str | rtamt.Specification,
) -> None:
    with pytest.raises(rtamt.SpecificationError) as caught:
        rtamt.dense.Monitor(text)
    head, hint = str(caught.value).split("\n  hint: ")
    assert hint == "give resolution='1ps'"
    assert caught.value.message.worded(lambda _: None) == head
    assert caught.value.message.worded(lambda _: "-r 1ps").endswith("\n  hint: give -r 1ps")
