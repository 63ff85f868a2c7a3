"""Every error of the language by its exact text; parse_errors.txt is the table."""

from __future__ import annotations

import copy
import pickle
import traceback
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt.errors import ParseError, SpecificationError
from rtamt.language.node import MAX_DEPTH
from rtamt.language.operators import OPERATORS

TABLE = Path(__file__).with_name("parse_errors.txt")


def cases() -> list[tuple[str, list[str]]]:
    """Return text and message of each block; lines that start with ``> `` are the text."""
    blocks = (block.splitlines() for block in TABLE.read_text(encoding="utf-8").split("\n\n"))
    return [
        (
            "\n".join(line[2:] for line in block if line.startswith("> ")),
            [line for line in block if not line.startswith("> ")],
        )
        for block in blocks
        if not block[0].startswith("#")
    ]


@pytest.mark.parametrize(("text", "message"), cases(), ids=[text for text, _ in cases()])
def test_error_text(text: str, message: list[str]) -> None:
    with pytest.raises(ParseError) as caught:
        rtamt.parse(text)
    assert str(caught.value).splitlines() == message


def test_an_unknown_function_is_told_the_known_ones() -> None:
    with pytest.raises(ParseError, match=r"^STL:1:1: unknown function 'foo'") as caught:
        rtamt.parse("foo(x) > 3")
    functions = [row.symbol for row in OPERATORS.values() if row.notation == "call"]
    assert caught.value.hint == f"functions are {', '.join(functions)}"


PIECES = (
    *sorted({s for row in OPERATORS.values() for s in row.spellings} | OPERATORS.reserved),
    *"()[]:,;=@/-. \n\té",
    *("x", "a.b", "K", "5", "1e3", "ms", "nan", "float", "topic", "//", "/*", "*/", "[0:5]"),
    *("const float K = 3\n", "float x\n", "p = ", "x > 0"),
)


@given(st.lists(st.sampled_from(PIECES), max_size=12), st.sampled_from(["", " "]))
def test_any_text_parses_or_raises(pieces: list[str], between: str) -> None:
    try:
        spec = rtamt.parse(between.join(pieces))
    except ParseError:
        return
    assert rtamt.parse(str(spec)) == spec


@pytest.mark.parametrize("text", ["", " \t", "\n\n", "// nothing", "/* nothing\n */"])
def test_empty_text_is_an_error(text: str) -> None:
    with pytest.raises(ParseError) as caught:
        rtamt.parse(text)
    assert caught.value.reason == "expected a formula, got the end of the text"
    assert caught.value.hint == "write a formula, such as always(x > 0)"


def test_error_has_its_parts() -> None:
    with pytest.raises(ParseError) as caught:
        rtamt.parse("float x\n\tx >> 3")
    error = caught.value
    assert (error.line, error.column) == (2, 5)
    assert error.reason == "expected an operand after '>', got '>'"
    assert error.hint == "write a variable, a number or '(' there"
    assert str(error).splitlines()[1:3] == ["  \tx >> 3", "  \t   ^"]
    for twin in (copy.copy(error), pickle.loads(pickle.dumps(error))):
        assert str(twin) == str(error)
        assert twin.column == error.column


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_lines_are_counted_by_line_feeds_alone(newline: str) -> None:
    text = newline.join(["float x // \x0c \x85 \u2028", "", "x > $"])
    with pytest.raises(ParseError) as caught:
        rtamt.parse(text)
    assert str(caught.value).splitlines()[:3] == [
        "STL:3:5: unexpected character '$'",
        "  x > $",
        "      ^",
    ]


def test_invisible_character_is_named_by_its_code() -> None:
    with pytest.raises(ParseError, match=r"STL:1:2: unexpected character U\+00A0"):
        rtamt.parse("x\u00a0> 3")


def test_long_lines_and_words_are_cut() -> None:
    long = "x > 1 and " * 500
    with pytest.raises(ParseError) as caught:
        rtamt.parse(long + "y z " + long)
    _, line, caret, _ = str(caught.value).splitlines()
    assert len(line) < 130
    assert line[caret.index("^")] == "z"
    with pytest.raises(ParseError) as caught:
        rtamt.parse("x > " + "9" * 100_000)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("text", "column", "subject"),
    [
        ("(" * 10_000, MAX_DEPTH + 1, "brackets are"),
        ("(" * 10_000 + "x" + ")" * 10_000, MAX_DEPTH + 1, "brackets are"),
        ("abs(" * 10_000, 4 * (MAX_DEPTH + 1), "brackets are"),
        ("not " * 10_000 + "x", 4 * MAX_DEPTH + 1, "the formula is"),
        ("!" * 10_000, MAX_DEPTH + 1, "the formula is"),
        ("G[0:5]" * 10_000 + "x", 6 * MAX_DEPTH + 1, "the formula is"),
        ("x > " + "-" * 10_000 + "y", 5 + MAX_DEPTH, "the formula is"),
    ],
)
def test_depth_error_points_at_token(text: str, column: int, subject: str) -> None:
    with pytest.raises(ParseError) as caught:
        rtamt.parse(text)
    assert caught.value.reason == f"{subject} nested 201 deep; the limit is 200"
    assert caught.value.column == column
    assert caught.value.hint == "write the formula as several specifications"


def test_a_chain_that_nests_too_deep_says_so() -> None:
    with pytest.raises(ParseError) as caught:
        rtamt.parse("x" + " - x" * 1000 + " > 0")
    assert caught.value.reason == "the formula is nested 201 deep; the limit is 200"
    assert caught.value.hint == "group long chains in brackets, or write several specifications"


def test_huge_numbers_error() -> None:
    for text in ("G[0:1e999999999] x", "G[1e-999999999:1] x", "const float K = 1e999999999\nx > K"):
        with pytest.raises(ParseError, match="between 1e-300 and 1e300"):
            rtamt.parse(text)
    with pytest.raises(SpecificationError, match="between 1e-300 and 1e300"):
        rtamt.parse("x > K", constants={"K": "1e999999999"})


def test_tracebacks_do_not_show_the_inside_of_the_parser() -> None:
    with pytest.raises(ParseError) as caught:
        rtamt.parse("(" * 150 + "x y" + ")" * 150)
    assert len(traceback.extract_tb(caught.value.__traceback__)) < 10
    assert caught.value.__suppress_context__
