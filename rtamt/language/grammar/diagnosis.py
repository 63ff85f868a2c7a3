"""The errors of texts that are not specifications: expected and actual token, and a hint.

Hints for texts from Breach, S-TaLiRo, MATLAB or papers propose an equivalent form, or state that
none exists.

To add an error of the parser, write its text once, where `rtamt.language` raises it: here, in
another module of the grammar, or in the module of the object. Add a block with the exact text to
``tests/rtamt/language/parse_errors.txt``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from fractions import Fraction
from typing import Any, Final, Protocol

from antlr4.Token import Token as AntlrToken

from rtamt.errors import ParseError, SpecificationError, closest, nearest
from rtamt.language.declarations import PRIMITIVES
from rtamt.language.grammar.generated.StlParser import StlParser
from rtamt.language.interval import MAX_DIGITS, UNITS, exact
from rtamt.language.operators import OPERATORS, Notation, Operator


class Token(Protocol):
    """A token of the lexer; the line counts from 1, the column from 0."""

    type: int
    text: str
    line: int
    column: int
    start: int
    stop: int
    tokenIndex: int  # noqa: N815 - the name is ANTLR's

    def getInputStream(self) -> Any:  # noqa: ANN401, N802 - ANTLR is not typed
        """Return the stream of the characters."""


def text_around(token: Token) -> str:
    """Return the whole text that a token is part of."""
    text: str = token.getInputStream().strdata
    return text


def fail(token: Token, reason: str, hint: str = "") -> ParseError:
    """Return the error that points at a token."""
    return ParseError(reason, text_around(token), token.line, token.column + 1, hint)


def similar(word: str, words: Iterable[str], otherwise: str = "") -> str:
    """Return a hint with the most similar word, or ``otherwise``."""
    return nearest(word, words).removeprefix("; ") or otherwise


def similar_name(name: str, names: Iterable[str], declaration: str) -> str:
    """Return a hint for an unknown name: a similar one, and how to declare it."""
    close = closest(name, names, cutoff=0.4)
    declare = f"declare it: {declaration}"
    return f"did you mean '{close}'? If not, {declare}" if close else declare


_OPERANDS = frozenset(
    {StlParser.NAME, StlParser.ELEMENT, StlParser.NUMBER, StlParser.TRUTH, StlParser.CLOSE}
)
_CLOSERS = frozenset({StlParser.CLOSE, StlParser.CLOSE_INTERVAL})
_HEADS = {
    StlParser.SPECIFICATION: "write specification NAME",
    StlParser.FROM: "write from MODULE import TYPE; ',' separates several types",
    StlParser.CONST: "write const float NAME = 5",
    StlParser.INPUT: "write input float NAME",
    StlParser.OUTPUT: "write output float NAME",
}
_TYPE_COMMA = "write ',' between two types of an import"
_TYPE_NAME = "a type keeps its name here: leave out 'as' and the name after it"
COLUMN_HINT = 'write @ column(VARIABLE, "Level [mm]")'
ID_HINT = 'write @ id(NAME, "SYS-REQ-7")'
ANNOTATION_HINT = (
    f"write @ topic(VARIABLE, path), {COLUMN_HINT.removeprefix('write ')} or "
    f"{ID_HINT.removeprefix('write ')}"
)
LINK_HINT = 'write @ id(NAME, "SYS-REQ-7", "https://reqs.example/{id}")'
RANGE_HINT = "write in [0, 120]"
_OR_STATEMENT = ", or ';' between two statements"
_NEXT_STATEMENT = "write ';' or a new line between two statements"
_BEFORE_LABEL = 5  # the tokens '@', 'id' or 'column', '(', a name and ','
_LONG = 60
_INDEX = re.compile(r"\[\s*-?\d+\s*\]")
_ASCII = "names have letters, digits, '_' and dots; operators are as in: not (x >= 3) -> y < 2"
_PRINTED = "≥≤≠¬∧∨→⇒↔⇔□◇"  # noqa: RUF001 - as formulas are printed in papers
_SPELT = (">=", "<=", "!=", "not", "and", "or", "->", "->", "<->", "<->", "always", "eventually")
_INSTEAD = {
    "^": "write pow(x, 2) for a power",
    '"': "write '\"' where the text ends, on the same line",
    **{c: f"write '{spelling}'" for c, spelling in zip(_PRINTED, _SPELT, strict=True)},
}
# Names of operators in other tools that are more like the name of another operator here.
_ELSEWHERE = {"globally": "always", "finally": "eventually", "future": "eventually"}
_LENGTH = "write abs(x) for one number, sqrt(x * x + y * y) for two"
_IMPLICATION: Final = "write 'p implies q' for 'if p then q'"
_COMPOSED = {
    **dict.fromkeys(("if", "when"), _IMPLICATION),
    **dict.fromkeys(("norm", "hypot", "length", "dist", "distance"), _LENGTH),
    **dict.fromkeys(("square", "sq"), "write pow(x, 2) or x * x"),
    **dict.fromkeys(("clip", "clamp"), "write min(max(x, 0), 1)"),
    **dict.fromkeys(("sin", "cos", "tan"), "compute it before, and name its value as a variable"),
}
"""Functions of other languages, and how to write them in this one."""


def diagnose(
    tokens: Sequence[Token], token: Token, rule: str, expected: AbstractSet[int]
) -> ParseError:
    """Return the error for a token that a rule refuses, with the types that it accepts there."""
    if rule in ("interval", "bound"):
        return _in_interval(token, expected)
    if rule in ("range", "limit"):
        before = tokens[token.tokenIndex - 1]
        if StlParser.OPEN_INTERVAL not in expected or before.text == "in":
            return _in_range(token, expected)
        token, expected, rule = before, frozenset({StlParser.END}), "declaration"
    index = token.tokenIndex
    first = max((i + 1 for i in range(index) if tokens[i].type == StlParser.END), default=0)
    if index == first:
        return _at_start(token)
    before = tokens[index - 1]
    head = tokens[first]
    if head.type == StlParser.AT:
        kind = tokens[first + 1].text if index > first + 1 else ""
        return _in_annotation(kind, tokens[first:], token, expected)
    pair = index - first >= 2 and head.type == tokens[first + 1].type == StlParser.NAME
    typed = head.text in PRIMITIVES or (pair and any(t.type == StlParser.FROM for t in tokens))
    if head.type in _HEADS or (typed and (pair or index == first + 1)):
        reason, hint = _in_declaration(token, expected, named=index == first + 1)
        if head.type == StlParser.FROM and StlParser.END in expected:
            hint = _TYPE_NAME if token.text == "as" else _TYPE_COMMA
        return fail(token, reason, hint or _HEADS.get(head.type, ""))
    if pair and rule not in ("expression", "operand"):
        return _no_operator(head, tokens[first + 1], bracketed=False)
    if before.type in _OPERANDS and (StlParser.NUMBER not in expected or index == first + 1):
        return _no_operator(before, token, bracketed=rule == "operand")
    return _no_operand(before, token)


def misspelt(token: Token) -> ParseError:
    """Return the error for a character that the language does not have."""
    character = token.text
    named = f"'{character}'" if character.isprintable() else f"U+{ord(character):04X}"
    return fail(token, f"unexpected character {named}", _INSTEAD.get(character, _ASCII))


def no_formula(token: Token, instead: str, hint: str = "") -> ParseError:
    """Return the error for a text without a formula."""
    hint = hint or "write a formula, such as always(x > 0)"
    return fail(token, f"expected a formula, got {instead}", hint)


def no_id(token: Token) -> ParseError:
    """Return the error for a token that is not the id of a requirement."""
    hint = f'write "{token.text}"' if token.type in _OPERANDS else ID_HINT
    return fail(token, f"expected the id in quotes, got {_got(token)}", hint)


def no_bound(token: Token, hint: str) -> ParseError:
    """Return the error for a token that is not a bound of an interval."""
    return fail(token, f"expected an interval bound, got {_got(token)}", hint)


def exact_number(token: Token, digits: str, label: str) -> Fraction:
    """Return the exact value of a number in the text; errors call it by the label."""
    try:
        return exact(digits, label)
    except SpecificationError:
        reason = f"expected a {label} between 1e-300 and 1e300, got {shown(digits)}"
        if len(digits) > MAX_DIGITS:
            reason = f"expected a {label} of at most {MAX_DIGITS} digits, got {len(digits)}"
        raise fail(token, reason) from None


def shown(text: str) -> str:
    """Return a piece of text, cut to a length that fits into a message."""
    return text if len(text) <= _LONG else f"{text[:_LONG]}..."


def _got(token: Token) -> str:
    if token.type in (StlParser.END, AntlrToken.EOF) and token.text != ";":
        return "the end of the line" if token.text == "\n" else "the end of the text"
    return shown(token.text) if token.type == StlParser.STRING else f"'{shown(token.text)}'"


def _at_start(token: Token) -> ParseError:
    hint = _misplaced(token)
    if token.type == StlParser.IMPORT:
        hint = _HEADS[StlParser.FROM]
    elif token.type == StlParser.SPECIFICATION:
        hint = "the name of the specification comes first"
    return no_formula(token, _got(token), hint)


def _misplaced(token: Token) -> str:
    """Return a hint if a word may be meant as a variable; infix words are only misplaced."""
    if token.text == "inf":
        return "inf is only for the end of an interval; true is +inf, false is -inf"
    return "" if token.type == StlParser.INFIX else OPERATORS.refusal(token.text)


def _in_interval(token: Token, expected: AbstractSet[int]) -> ParseError:
    if StlParser.NUMBER in expected:
        if token.type == StlParser.CLOSE_INTERVAL:
            return no_bound(token, "an interval without end is [0:inf] or [0,)")
        return no_bound(token, "write a number, a constant or inf")
    if StlParser.COLON in expected:
        reason = f"expected ':' and the other bound, got {_got(token)}"
        return fail(token, reason, "write both bounds: [0:5]")
    *units, last = UNITS
    hint = f"a bound may have a unit: {', '.join(units)} or {last}"
    return fail(token, f"expected ']', got {_got(token)}", hint)


def no_range(token: Token) -> ParseError:
    """Return the error for a token that is not a range or the end of a declaration."""
    reason = f"expected the end of the statement, got {_got(token)}"
    return fail(token, reason, _NEXT_STATEMENT)


def _in_range(token: Token, expected: AbstractSet[int]) -> ParseError:
    if StlParser.OPEN_INTERVAL in expected:
        return fail(token, f"expected a range after 'in', got {_got(token)}", RANGE_HINT)
    if StlParser.NUMBER in expected:
        hint = "write a number, a constant or inf"
        return fail(token, f"expected a limit of a range, got {_got(token)}", hint)
    if StlParser.COLON in expected:
        reason = f"expected ',' and the maximum, got {_got(token)}"
        return fail(token, reason, f"a range has both limits: {RANGE_HINT}")
    hint = "a range ends with ']' and has no unit"
    return fail(token, f"expected ']', got {_got(token)}", hint)


def _in_annotation(
    kind: str, tokens: Sequence[Token], token: Token, expected: AbstractSet[int]
) -> ParseError:
    """Return the error in the tokens of an annotation, such as ``@ id(NAME, "ID")``."""
    usage = _ANNOTATIONS.get(kind, ANNOTATION_HINT)
    label = tokens[_BEFORE_LABEL] if len(tokens) > _BEFORE_LABEL else token
    unquoted = token.tokenIndex >= label.tokenIndex and label.type != StlParser.STRING
    if kind in _QUOTED and len(tokens) > _BEFORE_LABEL and unquoted:
        expect, name = _QUOTED[kind]
        hint = usage if token is label else f"{name} needs quotes: {usage}"
        return fail(label, f"expected {expect} in quotes, got {_got(label)}", hint)
    if kind == "id" and StlParser.STRING in expected:
        reason = f"expected the link in quotes, got {_got(token)}"
        return fail(token, reason, LINK_HINT)
    if StlParser.STRING in expected and StlParser.NAME not in expected:
        comma = tokens[tokens.index(token) - 1]  # a third value follows
        return fail(comma, "expected ')', got ','", usage)
    reason, hint = _in_declaration(token, expected, named=tokens[1] is token)
    return fail(token, reason, hint or usage)


_ANNOTATIONS = {
    "topic": "write @ topic(VARIABLE, path/of/the/topic)",
    "column": COLUMN_HINT,
    "id": ID_HINT,
}
_QUOTED = {
    "id": ("the id", "an id"),
    "column": ("the name of a column", "the name of a column"),
}
"""The second value of an annotation, and the start of a sentence on it."""


def _in_declaration(token: Token, expected: AbstractSet[int], *, named: bool) -> tuple[str, str]:
    if named or StlParser.NAME in expected:
        return f"expected a name, got {_got(token)}", OPERATORS.refusal(token.text)
    if StlParser.NUMBER in expected:
        return f"expected a number, got {_got(token)}", "write a plain number, such as 5 or -0.5"
    if StlParser.END in expected:
        hint = _NEXT_STATEMENT
        if token.type == StlParser.OPEN_INTERVAL or token.text.startswith("in["):
            hint = f"for a range {RANGE_HINT}"
        elif token.text == "in":
            hint = "a range stands before the value: float x in [0, 120] = 5"
        return f"expected the end of the statement, got {_got(token)}", hint
    words = [StlParser.literalNames[t] for t in sorted(expected)]
    return f"expected {' or '.join(words)}, got {_got(token)}", ""


def _no_operand(before: Token, token: Token) -> ParseError:
    if before.type == StlParser.EQUALS:
        reason = f"expected a formula after '=', got {_got(token)}"
    elif before.type in _CLOSERS:
        reason = f"expected an operand after the interval, got {_got(token)}"
    else:
        reason = f"expected an operand after '{before.text}', got {_got(token)}"
    hint = "write a variable, a number or '(' there"
    row = OPERATORS.words.get(before.text)
    if token.type == StlParser.OPEN_INTERVAL:
        hint = _where_intervals_stand()
    elif token.type == StlParser.EQUALS:
        joined = before.text + "="
        if any(joined in row.spellings for row in OPERATORS.values()):
            hint = f"write '{joined}' in one piece"
    elif misplaced := _misplaced(token):
        hint = misplaced
    elif row is not None and (before.text != row.symbol or _named(row, token)):
        hint = OPERATORS.refusal(before.text)
    return fail(token, reason, hint)


def _no_operator(before: Token, token: Token, *, bracketed: bool) -> ParseError:
    reason = f"expected an operator, got {_got(token)}"
    if before.type == StlParser.ELEMENT and (error := _misread(before, token)):
        return error
    if token.type == StlParser.EQUALS:
        implied = text_around(token)[token.stop + 1 :].startswith(">")
        meant = "implication is written '->'" if implied else "equality is written '=='"
        return fail(token, reason, meant)
    if before.type == StlParser.NAME and (error := _misnamed(before, token)):
        return error
    hint = _usual_form(before, token) or _hint_of_operator(before, token)
    hint = hint or "write an operator there" + ("" if bracketed else _OR_STATEMENT)
    return fail(token, reason, hint)


def _hint_of_operator(before: Token, token: Token) -> str:
    """Return the hint for a token after an operand, where an operator would stand; may be empty."""
    hint = ""
    if token.type == StlParser.OPEN_INTERVAL:
        hint = _where_intervals_stand()
        if before.type in (StlParser.NAME, StlParser.ELEMENT) and _INDEX.match(
            text_around(token), token.start
        ):
            hint = f"write an element without spaces, counted from 0: {before.text}[0]"
    elif before.type == StlParser.NUMBER and token.start == before.stop + 1:
        hint = f"write {before.text} * {token.text}"
        if token.text in UNITS:
            hint = "units are for the bounds of intervals only"
    elif token.type == StlParser.COMMA:
        hint = "',' separates only the operands of a function"
    elif token.type == StlParser.NAME:
        prefix = similar(before.text, _words("prefix")) if before.type == StlParser.NAME else ""
        hint = similar(token.text, _words("infix")) or prefix or hint
    return hint


_ROUND_INTERVAL: Final = re.compile(r"(\w+)\s*\(\s*$"), re.compile(r"\s*([\w.]+)\s*\)")
_QUANTITIES: Final = frozenset(
    re.split(
        " ", "m km cm mm mps kmh kph mph deg rad rpm hz khz kg g n nm v mv a ma w kw k c pa bar"
    )
)
"""Units of quantities that numbers in formulas do not have, in small letters."""


def _usual_form(before: Token, token: Token) -> str:
    """Return the hint for forms of other languages: intervals, decimals, units and conditions."""
    text, separator = text_around(token), token.text in {":", ","}
    if separator and before.type == StlParser.NUMBER:
        word = _ROUND_INTERVAL[0].search(text[: before.start])
        end = _ROUND_INTERVAL[1].match(text, token.stop + 1)
        row = OPERATORS.words.get(word[1]) if word else None
        if word and end and row is not None and row.timed:
            return f"intervals have square brackets: {word[1]}[{before.text}:{end[1]}]"
        digits = re.compile(r"\d+").match(text, token.stop + 1)
        if token.text == "," and digits:
            return f"numbers have a decimal point: {before.text}.{digits[0]}"
    if token.text == ":" and before.type == StlParser.NAME:
        return f"a formula is named with '=': {before.text} = ..."
    if token.text == "then" or before.text in {"if", "when"}:
        return _IMPLICATION
    if before.type == StlParser.NUMBER and token.text.lower() in _QUANTITIES:
        return f"numbers have no unit: write {before.text}, or {before.text} * {token.text}"
    return ""


def _misread(before: Token, token: Token) -> ParseError | None:
    """Return the error if the element before the refused token is meant as something else."""
    word, index = before.text.split("[", 1)
    bounds = f"[0:{index}"
    if token.type == StlParser.EQUALS:
        hint = f"formulas have plain names: {word} = ..."
        return fail(token, f"'{before.text}' is an element and cannot name a formula", hint)
    timed = [s for s in (*_words("prefix"), *_words("infix")) if OPERATORS.words[s].timed]
    meant = _ELSEWHERE.get(word.lower()) or closest(word, timed)
    if meant and token.type in _OPERANDS | {StlParser.OPEN}:
        return fail(before, f"unknown operator '{word}'", f"write {meant}{bounds}")
    return None


def _misnamed(before: Token, token: Token) -> ParseError | None:
    """Return the error if the name before the refused token is meant as an operator or function."""
    word = before.text
    functions = [name for name, row in OPERATORS.words.items() if row.notation == "call"]
    operators = [*_words("prefix"), *_words("infix")]
    hint = ""
    if word.lower() in _ELSEWHERE:
        hint = f"write '{_ELSEWHERE[word.lower()]}'"
    elif token.type == StlParser.OPEN_INTERVAL:
        hint = similar(word, [s for s in operators if OPERATORS.words[s].timed])
    if hint:
        return fail(before, f"unknown operator '{word}'", hint)
    if word in functions and token.type in _OPERANDS:
        reason = f"expected '(' after '{word}', got {_got(token)}"
        return fail(token, reason, f"write {word}({token.text})")
    if token.type == StlParser.OPEN:
        known = functions + _words("prefix")  # nobody mistakes an infix operator for a function
        hint = similar(word, known, f"functions are {', '.join(functions)}")
        hint = _COMPOSED.get(word.lower(), hint)
        return fail(before, f"unknown function '{word}'", hint)
    return None


def _named(prefix: Operator, token: Token) -> bool:
    """Return whether a prefix operator is meant as a variable, as in ``next > 3``."""
    row = OPERATORS.spellings.get((token.text, "infix"))
    return prefix.notation == "prefix" and row is not None and row.operands == "term"


def _words(notation: Notation) -> list[str]:
    """Return the words of a notation; no typing error is close to a single letter."""
    return [s for s, row in OPERATORS.words.items() if row.notation == notation and len(s) > 1]


def _where_intervals_stand() -> str:
    *timed, last = [row.symbol for row in OPERATORS.values() if row.timed]
    return f"an interval can only follow {', '.join(timed)} or {last}"


_Hint = Callable[[re.Match[str]], str]

_INTERVAL: Final = r"[\[(][^\[\]()]*[,:][^\[\]()]*[\])]"
_TEMPORAL: Final[Mapping[str, str]] = {
    "[]": "always",
    "<>": "eventually",
    **dict.fromkeys(("G", "alw", "always"), "always"),
    **dict.fromkeys(("F", "ev", "eventually"), "eventually"),
    **dict.fromkeys(("H", "hist", "historically"), "historically"),
    **dict.fromkeys(("O", "once"), "once"),
    **dict.fromkeys(("U", "until"), "until"),
    **dict.fromkeys(("S", "since"), "since"),
}
_WORDS: Final = "|".join(word for word in _TEMPORAL if word.isalpha())
_LATEX: Final[Mapping[str, str]] = {
    **dict.fromkeys(("land", "wedge"), "and"),
    **dict.fromkeys(("lor", "vee"), "or"),
    **dict.fromkeys(("neg", "lnot"), "not"),
    **dict.fromkeys(("implies", "rightarrow", "Rightarrow", "to"), "->"),
    **dict.fromkeys(("iff", "leftrightarrow", "Leftrightarrow"), "<->"),
    **dict.fromkeys(("square", "Box"), "always"),
    **dict.fromkeys(("lozenge", "Diamond"), "eventually"),
    **dict.fromkeys(("leq", "le"), "<="),
    **dict.fromkeys(("geq", "ge"), ">="),
    **dict.fromkeys(("neq", "ne"), "!="),
}
_MOMENT: Final = "; in 'p {0} q', p need not hold at the moment of q"


def _temporal(match: re.Match[str]) -> str:
    interval = match["interval"] or ""
    if not _is_closed(interval):
        return _OPEN.format(interval)
    word = _TEMPORAL.get(match["word"])
    if word is None:
        return f"for p {match['word']} q write not (not p until{interval} not q)"
    more = _MOMENT.format(word) if word in ("until", "since") else ""
    return f"write '{word}{interval}'{more}"


def _is_closed(interval: str) -> bool:
    """Return whether an interval includes its bounds; True without an interval."""
    return not interval or bool(re.fullmatch(r"\[.*(\]|[:,]\s*inf\s*\))", interval))


_OPEN: Final = "intervals include both bounds; {} cannot be written"


def _fixed(text: str) -> _Hint:
    return lambda _: text


def _parameter(match: re.Match[str]) -> str:
    return f"write const float {match[1]} = {match[2]}, one line for each parameter"


def _latex(match: re.Match[str]) -> str:
    return f"write '{_LATEX[match[1]]}'" if match[1] in _LATEX else ""


def _signal(match: re.Match[str]) -> str:
    return f"write float {match[1]}, one line for each signal, or leave the signals out"


def _present(match: re.Match[str]) -> str:
    return f"write {match[1]}: a name is the present value"


_ROWS: Final[tuple[tuple[str, _Hint], ...]] = (
    # S-TaLiRo and papers: an operator, an underscore, an interval.
    (rf"(?<![\w\]])(?P<word>\[\]|<>)(?:(?=\[|_)_?\{{?(?P<interval>{_INTERVAL}))?", _temporal),
    (rf"\b(?P<word>{_WORDS})_\{{?(?P<interval>{_INTERVAL})?", _temporal),
    (rf"\b(?P<word>R|V|release)(?=[\s_(\[])(?:_?\{{?(?P<interval>{_INTERVAL}))?", _temporal),
    (r"/\\", _fixed("write 'and'")),
    (r"\\/", _fixed("write 'or'")),
    (r"<=>", _fixed("write '<->'")),
    (r"=?=>", _fixed("implication is written '->'")),
    (r"\\([A-Za-z]+)", _latex),
    # Breach
    (r":=", _fixed("a formula is named with '=': p = always(x > 0)")),
    (r"\bparam\s+(\w+)\s*=\s*([-\w.]+)[^\n]*", _parameter),
    (r"\bsignal\s+(\w+)[^\n]*", _signal),
    (r"\b([A-Za-z_]\w*)\s*[\[(]\s*t\s*[\])]", _present),
    (
        r"\b([A-Za-z_]\w*)\s*[\[(]\s*t\s*[-+][^\])]*[\])]",
        _fixed("only the present value can be written: x for x[t]"),
    ),
    # MATLAB
    (r"~=", _fixed("write !=")),
    (r"~", _fixed("write 'not'; for a signal of 0 and 1 write x < 0.5, as x alone means x >= 0")),
    (r"\.\^", _fixed("write pow(x, 2) for x.^2")),
    (r"\.[*/]", _fixed("write it without the dot: all values are numbers")),
    (r"[#%]", _fixed("a comment starts with //")),
    (r"\.\.\.", _fixed("leave it out: a line continues after an operator and inside brackets")),
)
_TABLE: Final = tuple((re.compile(pattern), hint) for pattern, hint in _ROWS)
_MARGIN: Final = 100
"""The most characters of a foreign form before the refused place."""


def foreign_hint(text: str, index: int) -> str:
    """Return the hint for a form of another tool at an index; empty for other texts.

    Example:
        >>> foreign_hint("[]_[0,20] p", 0)
        "write 'always[0,20]'"
    """
    begin = max(0, index - _MARGIN)
    for pattern, hint in _TABLE:
        for match in pattern.finditer(text, begin, index + _MARGIN):
            if match.start() <= index < match.end() and (advice := hint(match)):
                return advice
    return ""
