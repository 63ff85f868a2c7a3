"""What is wrong where the grammar refuses a token, and the way out."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet
from typing import Protocol

from antlr4.Token import Token as AntlrToken

from rtamt.errors import ParseError
from rtamt.language.grammar.generated.StlLexer import StlLexer
from rtamt.language.grammar.generated.StlParser import StlParser
from rtamt.language.interval import UNITS
from rtamt.language.operators import OPERATORS

__all__ = [
    "PRIMITIVES",
    "Token",
    "diagnose",
    "fail",
    "got",
    "misspelt",
    "nearest",
    "nearest_name",
    "shown",
]

PRIMITIVES = (
    *("bool", "int", "uint", "long", "float", "double", "float32", "float64"),
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
)
"""Types of variables and constants that need no import. All values are doubles in the end."""


class Token(Protocol):
    """A token of the lexer; the line counts from 1, the column from 0."""

    type: int
    text: str
    line: int
    column: int
    start: int
    stop: int
    tokenIndex: int  # noqa: N815 - the name is ANTLR's


def fail(text: str, token: Token, reason: str, hint: str = "") -> ParseError:
    """The error with its caret under a token."""
    return ParseError(reason, text, token.line, token.column + 1, hint)


def nearest(word: str, words: Iterable[str], otherwise: str = "") -> str:
    """A hint that names the word most like the one that was written, if one is like it."""
    close = difflib.get_close_matches(word, tuple(words), 1)
    return f"did you mean '{close[0]}'?" if close else otherwise


def nearest_name(name: str, names: Iterable[str], declaration: str) -> str:
    """A hint for an unknown name: the nearest one, and how to declare it."""
    close = difflib.get_close_matches(name, tuple(names), 1, cutoff=0.4)
    declare = f"declare it: {declaration}"
    return f"did you mean '{close[0]}'? If not, {declare}" if close else declare


_WORDS = {
    spelling: row
    for row in OPERATORS.values()
    for spelling in row.spellings
    if spelling.isidentifier()
}
_SYMBOLS = frozenset(s for row in OPERATORS.values() for s in row.spellings)
_FUNCTIONS = [row.symbol for row in OPERATORS.values() if row.notation == "call"]
_TIMED = [row.symbol for row in OPERATORS.values() if row.timed]
_INTERVAL = f"an interval stands after {', '.join(_TIMED)} only"
_PREFIXES = [s for s, row in _WORDS.items() if row.notation == "prefix" and len(s) > 1]
_INFIXES = [s for s, row in _WORDS.items() if row.notation == "infix" and len(s) > 1]
_OPERANDS = frozenset({StlLexer.NAME, StlLexer.NUMBER, StlLexer.TRUTH, StlLexer.CLOSE})
_HEADS = {
    StlLexer.SPECIFICATION: "write specification NAME",
    StlLexer.FROM: "write from MODULE import TYPE",
    StlLexer.AT: "write @ topic(VARIABLE, path/of/the/topic)",
    StlLexer.CONST: "write const float NAME = 5",
    StlLexer.INPUT: "write input float NAME",
    StlLexer.OUTPUT: "write output float NAME",
}
_LONG = 60
_ASCII = "names are of letters, digits, '_' and dots, operators as in: not (x >= 3) -> y < 2"
_INSTEAD = {
    "#": "a comment begins with //",
    "^": "write pow(x, 2) for a power",
    **{
        character: f"write '{spelling}'"
        for character, spelling in zip(
            "≥≤≠¬∧∨→⇒↔⇔□◇",  # noqa: RUF001 - as formulas are printed in papers
            (
                ">=",
                "<=",
                "!=",
                "not",
                "and",
                "or",
                "->",
                "->",
                "<->",
                "<->",
                "always",
                "eventually",
            ),
            strict=True,
        )
    },
}
_FORMULA = "write a formula, such as always(x > 0)"
_OPERAND = "write a variable, a number or '(' there"


def diagnose(
    text: str, tokens: Sequence[Token], token: Token, rule: str, expected: AbstractSet[int]
) -> ParseError:
    """The error for a token that the grammar refuses.

    Args:
        text: The whole text.
        tokens: Its tokens.
        token: The refused one.
        rule: Name of the rule of the grammar that refuses it.
        expected: Types of the tokens that the rule would take.
    """
    if rule in ("interval", "bound"):
        reason, hint = _in_interval(token, expected)
        return fail(text, token, reason, hint)
    at = token.tokenIndex
    first = max((i + 1 for i in range(at) if tokens[i].type == StlLexer.END), default=0)
    if at == first:
        hint = _unnameable(token) or _FORMULA
        if token.type == StlLexer.IMPORT:
            hint = _HEADS[StlLexer.FROM]
        elif token.type == StlLexer.SPECIFICATION:
            hint = "the name of the specification stands before all else"
        return fail(text, token, f"expected a formula, got {got(token)}", hint)
    before = tokens[at - 1]
    head = tokens[first]
    pair = at - first >= 2 and head.type == tokens[first + 1].type == StlLexer.NAME
    typed = head.text in PRIMITIVES or (pair and any(t.type == StlLexer.FROM for t in tokens))
    if head.type in _HEADS or (typed and (pair or at == first + 1)):
        reason, hint = _in_declaration(token, expected, named=at == first + 1)
        return fail(text, token, reason, hint or _HEADS.get(head.type, ""))
    if pair and rule not in ("expression", "operand"):
        return _no_operator(text, head, tokens[first + 1], bracketed=False)
    if before.type == StlLexer.FUNCTION:
        reason = f"expected '(' after '{before.text}', got {got(token)}"
        operand = token.type in _OPERANDS
        return fail(
            text,
            token,
            reason,
            f"write {before.text}({token.text})" if operand else _reserved(before),
        )
    if before.type in _OPERANDS and (StlLexer.NUMBER not in expected or at == first + 1):
        return _no_operator(text, before, token, bracketed=rule == "operand")
    return _no_operand(text, before, token)


def misspelt(text: str, token: Token) -> ParseError:
    """The error for a character that the language does not have."""
    character = token.text
    named = f"'{character}'" if character.isprintable() else f"U+{ord(character):04X}"
    return fail(text, token, f"unexpected character {named}", _INSTEAD.get(character, _ASCII))


def got(token: Token) -> str:
    """A token, as an error says it."""
    if token.type in (StlLexer.END, AntlrToken.EOF) and token.text != ";":
        return "the end of the line" if token.text == "\n" else "the end of the text"
    return f"'{shown(token.text)}'"


def shown(text: str) -> str:
    """A piece of text, cut to a length that a message can take."""
    return text if len(text) <= _LONG else f"{text[:_LONG]}..."


def _reserved(token: Token) -> str:
    word = token.text
    if word == "inf":
        return "inf is only for the end of an interval; true is +inf, false is -inf"
    if word not in OPERATORS.reserved:
        return ""
    row = _WORDS.get(word)
    if row is None:
        what = "a word of the language"
    elif row.notation == "call":
        what = "a function"
    else:
        what = "an operator" if word == row.symbol else f"the operator '{row.symbol}'"
    return f"'{word}' is {what} and cannot name a variable"


def _unnameable(token: Token) -> str:
    """A hint if a variable may have been meant where an operator like `and` is just misplaced."""
    return "" if token.type == StlLexer.INFIX else _reserved(token)


def _in_interval(token: Token, expected: AbstractSet[int]) -> tuple[str, str]:
    if StlLexer.NUMBER in expected:
        reason = f"expected an interval bound, got {got(token)}"
        if token.type == StlLexer.CLOSE_INTERVAL:
            return reason, "an interval without end is [0:inf] or [0,)"
        return reason, "write a number, a constant or inf"
    if StlLexer.COLON in expected:
        return f"expected ':' and the other bound, got {got(token)}", "write both bounds: [0:5]"
    return (
        f"expected ']', got {got(token)}",
        f"after a bound comes a unit out of {', '.join(UNITS)}",
    )


def _in_declaration(token: Token, expected: AbstractSet[int], *, named: bool) -> tuple[str, str]:
    if named or StlLexer.NAME in expected:
        return f"expected a name, got {got(token)}", _reserved(token)
    if StlLexer.NUMBER in expected:
        return f"expected a number, got {got(token)}", "write a plain number, such as 5 or -0.5"
    if StlLexer.END in expected:
        hint = "write ';' or a new line between two statements"
        return f"expected the end of the statement, got {got(token)}", hint
    words = [StlParser.literalNames[t] for t in sorted(expected)]
    return f"expected {' or '.join(words)}, got {got(token)}", ""


def _no_operand(text: str, before: Token, token: Token) -> ParseError:
    place = f"'{before.text}'" if before.text not in ("]", ")") else "the interval"
    what = "a formula" if before.type == StlLexer.EQUALS else "an operand"
    hint = _unnameable(token)
    if token.type == StlLexer.OPEN_INTERVAL:
        hint = _INTERVAL
    elif token.type == StlLexer.EQUALS:
        joined = before.text + "="
        hint = f"write '{joined}' in one piece" if joined in _SYMBOLS else ""
    elif not hint and before.text in _WORDS and before.text != _WORDS[before.text].symbol:
        hint = _reserved(before)
    return fail(text, token, f"expected {what} after {place}, got {got(token)}", hint or _OPERAND)


# What other tools call our operators, where the nearest word would be another one.
_ELSEWHERE = {"globally": "always", "finally": "eventually", "future": "eventually"}


def _no_operator(text: str, before: Token, token: Token, *, bracketed: bool) -> ParseError:
    reason = f"expected an operator, got {got(token)}"
    hint = "write an operator there" + ("" if bracketed else ", or ';' between two statements")
    word = before.text if before.type == StlLexer.NAME else ""
    if token.type == StlLexer.EQUALS:
        implied = text[token.stop + 1 : token.stop + 2] == ">"
        meant = "implication is written '->'" if implied else "equality is written '=='"
        return fail(text, token, reason, meant)
    if word.lower() in _ELSEWHERE:
        here = _ELSEWHERE[word.lower()]
        return fail(text, before, f"unknown operator '{word}'", f"write '{here}'")
    if token.type == StlLexer.OPEN and word:
        known = f"functions are {', '.join(_FUNCTIONS)}"
        hint = nearest(word, [*_FUNCTIONS, *_PREFIXES, *_INFIXES], known)
        return fail(text, before, f"unknown function '{word}'", hint)
    if token.type == StlLexer.OPEN_INTERVAL:
        if close := nearest(word, [s for s in (*_PREFIXES, *_INFIXES) if _WORDS[s].timed]):
            return fail(text, before, f"unknown operator '{word}'", close)
        return fail(text, token, reason, _INTERVAL)
    if before.type == StlLexer.NUMBER and token.start == before.stop + 1:
        hint = f"write {before.text} * {token.text}"
        if token.text in UNITS:
            hint = "units are for the bounds of intervals only"
    elif token.type == StlLexer.COMMA:
        hint = "',' stands between the operands of a function only"
    elif token.type == StlLexer.NAME:
        hint = nearest(token.text, _INFIXES) or nearest(word, _PREFIXES, hint)
    return fail(text, token, reason, hint)
