"""From text to tokens and statements: the module that runs ANTLR.

The scanner reads the lexer's tokens one by one, and stops at the first bracket that is nested too
deep. It sets the types of words and symbols and decides which newlines end a statement. The parser
then checks the syntax and finds the parts of the statements; expressions.py builds the trees of
expressions from their tokens.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import NoReturn, Protocol, cast

from antlr4 import InputStream
from antlr4.atn.PredictionMode import PredictionMode
from antlr4.error.Errors import RecognitionException
from antlr4.error.ErrorStrategy import BailErrorStrategy
from antlr4.Token import Token as AntlrToken

from rtamt.errors import ParseError
from rtamt.language.grammar.diagnosis import Token, diagnose, fail, foreign_hint, misspelt
from rtamt.language.grammar.generated.StlLexer import StlLexer
from rtamt.language.grammar.generated.StlParser import StlParser
from rtamt.language.node import MAX_DEPTH, too_deep, too_long
from rtamt.language.operators import OPERATORS, Notation


class Span(Protocol):
    """The first and the last token of a rule of the grammar."""

    start: Token
    stop: Token


class Limits(Protocol):
    """The limits of a range."""

    lower: Span
    upper: Span


class Statement(Protocol):
    """The labelled parts of a statement (see Stl.g4): None if left out, absent in other kinds."""

    kind: Token
    variable: Token
    location: Span | None
    label: Token | None
    link: Token | None
    module: Token
    names: Sequence[Token]
    io: Token | None
    name: Token | None
    within: Token | None
    bounds: Limits | None
    default: Span | None
    formula: Span


class Statements(Protocol):
    """The statements of a text by kind, in the order of the text."""

    name: Token | None
    imports: Sequence[Statement]
    annotations: Sequence[Statement]
    constants: Sequence[Statement]
    declarations: Sequence[Statement]
    definitions: Sequence[Statement]


# The type of a word or symbol, by the notation of its row and whether an interval may follow.
_TYPES: Mapping[tuple[Notation, bool], int] = {
    ("prefix", True): StlParser.TEMPORAL,
    ("prefix", False): StlParser.PREFIX,
    ("infix", True): StlParser.BINDING,
    ("infix", False): StlParser.INFIX,
    ("atom", False): StlParser.TRUTH,
    ("call", False): StlParser.NAME,  # until a bracket follows
}
_SPELT = frozenset({StlParser.NAME, StlParser.ELEMENT, StlParser.SYMBOL})
_PREFIX = frozenset({StlParser.TEMPORAL, StlParser.PREFIX, StlParser.MINUS})
_INFIX = frozenset({StlParser.BINDING, StlParser.INFIX, StlParser.MINUS, StlParser.SLASH})
# A newline after these does not end a statement.
_UNFINISHED = _PREFIX | _INFIX | {StlParser.EQUALS}
_NAMES = (StlParser.NAME, StlParser.ELEMENT)
_KEYWORDS = {text.strip("'"): kind for kind, text in enumerate(StlParser.literalNames)}
# A name follows these; it does not call a function.
_NAMING = frozenset({StlParser.NAME, StlParser.SPECIFICATION, StlParser.IMPORT})
_OPEN_ENDS = frozenset({StlParser.COLON, StlParser.COMMA, StlParser.INF})

# ANTLR's decision tables are shared by all parsers and grow while they run.
_lock = threading.Lock()


def read(text: str) -> tuple[Statements, Sequence[Token]]:
    """Return the statements of a text and its tokens."""
    try:
        return _read(text)
    except ParseError as error:
        lines = text.split("\n")[: error.line - 1]
        hint = foreign_hint(text, sum(len(line) + 1 for line in lines) + error.column - 1)
        if not hint:
            raise
        refused = ParseError(error.reason, text, error.line, error.column, hint)
        raise refused.with_traceback(None) from None


def _read(text: str) -> tuple[Statements, Sequence[Token]]:
    with _lock:
        tokens = _Scanner(text).scan()
        parser = StlParser(_Stream(tokens))
        parser.buildParseTrees = False
        parser._interp.predictionMode = PredictionMode.SLL  # noqa: SLF001 - the documented way
        parser._errHandler = _Refusal(tokens)  # noqa: SLF001
        try:
            return cast("Statements", parser.specification()), tokens
        except ParseError as error:
            raise error.with_traceback(None) from None  # it has two calls per bracket


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens: list[Token] = []
        self.brackets: list[Token] = []
        self.newline: Token | None = None
        self.unfinished = True
        self.prefixes = 0

    def scan(self) -> list[Token]:
        lexer = StlLexer(InputStream(self.text))
        while (token := cast("Token", lexer.nextToken())).type != AntlrToken.EOF:
            if token.type == StlParser.END and token.text == "\n":
                if not (self.unfinished or self.brackets or self.newline):
                    self.newline = token
                continue
            if token.type == StlParser.ELEMENT:
                self._split(lexer, token)
            if token.type in _SPELT:
                token.type = self._type(token)
            elif token.type == StlParser.OPEN and self._calls():
                self.tokens[-1].type = StlParser.FUNCTION
                self.newline = None
            if self.newline and token.type not in _INFIX:
                self.tokens.append(self.newline)
            self.newline = None
            self.unfinished = token.type in _UNFINISHED
            if not self.unfinished:
                self._check(token)
            self._count(token)
            self.tokens.append(token)
        if self.brackets:
            raise self._unclosed()
        return self._finish(lexer, token)

    def _split(self, lexer: StlLexer, token: Token) -> None:
        """Split an element into a word and a bracket if the word is reserved."""
        word = token.text.partition("[")[0]
        if word in OPERATORS.reserved:
            token.stop = token.start + len(word) - 1
            token.type = _KEYWORDS.get(word, StlParser.NAME)
            lexer.inputStream.seek(token.stop + 1)
            lexer._hitEOF = False  # noqa: SLF001 - ANTLR has no other way to go back
            lexer.column = token.column + len(word)

    def _type(self, token: Token) -> int:
        text = self.text[token.start : token.stop + 1]
        if token.type in _NAMES:
            if reason := too_long(text):
                raise fail(token, reason, "write a shorter name")
            row = OPERATORS.words.get(text)
            return token.type if row is None else _TYPES[row.notation, row.timed]
        rows = OPERATORS.spellings
        row = rows.get((text, "prefix")) or rows[text, "infix"]
        return _TYPES[row.notation, row.timed]

    def _calls(self) -> bool:
        """Return whether the next bracket holds the operands of a function."""
        if not self.tokens or self.tokens[-1].type != StlParser.NAME:
            return False
        before = self.tokens[-2].type if len(self.tokens) > 1 else None
        # Outside brackets, a comma stands between the types of an import only.
        named = before in _NAMING or (before == StlParser.COMMA and not self.brackets)
        return not named and self.tokens[-1].text in OPERATORS.words

    def _check(self, token: Token) -> None:
        match token.type:
            case StlParser.OPEN | StlParser.OPEN_INTERVAL:
                self.brackets.append(token)
            case StlParser.CLOSE | StlParser.CLOSE_INTERVAL:
                self._close(token)
            case StlParser.END:
                if self.brackets:
                    raise self._unclosed()
                self.unfinished = True
            case StlParser.OPEN_COMMENT:
                hint = "write '*/' where it ends"
                raise fail(token, "the comment is not closed", hint)
            case StlParser.ILLEGAL:
                raise misspelt(token)

    def _close(self, token: Token) -> None:
        if not self.brackets:
            hint = "remove it, or open a bracket before it"
            raise fail(token, f"'{token.text}' has no opening bracket", hint)
        opened = self.brackets.pop()
        if opened.type == StlParser.OPEN_INTERVAL:
            open_end = self.tokens[-1].type in _OPEN_ENDS
            if token.type == StlParser.CLOSE and not open_end:
                reason = f"expected ']' to close {_place(opened)}, got ')'"
                raise fail(token, reason, "both bounds belong to an interval: [0:5]")
            self.unfinished = not self._is_range(opened)  # an operand follows an interval
        elif token.type == StlParser.CLOSE_INTERVAL:
            raise fail(token, f"expected ')' to close {_place(opened)}, got ']'")

    def _is_range(self, opened: Token) -> bool:
        """Return whether a bracket opens a range of a declaration, not an interval.

        The grammar refuses a bracket at the start of the text, so the result does not matter there.
        """
        index = next(i for i in range(len(self.tokens) - 1, -1, -1) if self.tokens[i] is opened)
        return self.tokens[index - 1].type == StlParser.NAME

    def _count(self, token: Token) -> None:
        if not self.brackets or self.brackets[-1].type != StlParser.OPEN_INTERVAL:
            if token.type in _PREFIX:
                self.prefixes += 1
            elif not self.unfinished:
                self.prefixes = 0
        if self.prefixes > MAX_DEPTH:
            reason = too_deep("the formula is", self.prefixes)
        elif len(self.brackets) > MAX_DEPTH:
            reason = too_deep("brackets are", len(self.brackets))
        else:
            return
        raise fail(token, reason, "write the formula as several specifications")

    def _finish(self, lexer: StlLexer, eof: Token) -> list[Token]:
        """End the last statement at its last token, not at empty lines below it."""
        if self.tokens:
            last = self.tokens[-1]
            eof.line, eof.column = last.line, last.column + len(last.text)
        if self.tokens and self.tokens[-1].type != StlParser.END:
            end = lexer.emitEOF()
            end.type, end.text = StlParser.END, ""
            end.line, end.column = eof.line, eof.column
            self.tokens.append(end)
        self.tokens.append(eof)
        for index, token in enumerate(self.tokens):
            token.tokenIndex = index
        return self.tokens

    def _unclosed(self) -> ParseError:
        opened = self.brackets[-1]
        closer = "]" if opened.type == StlParser.OPEN_INTERVAL else ")"
        hint = f"write '{closer}' where it ends"
        return fail(opened, f"'{opened.text}' is not closed", hint)


def _place(token: Token) -> str:
    return f"'{token.text}' of {token.line}:{token.column + 1}"


class _Stream:
    """The tokens as a stream, five times as fast as the stream of ANTLR."""

    def __init__(self, tokens: Sequence[Token]) -> None:
        self.tokens = tokens
        self.index = 0

    def LT(self, k: int) -> Token | None:  # noqa: N802 - the names are ANTLR's
        if k == 1:  # most calls; ANTLR does not consume the last token
            return self.tokens[self.index]
        index = self.index + (k - 1 if k > 0 else k)
        return self.tokens[min(index, len(self.tokens) - 1)] if index >= 0 else None

    def LA(self, k: int) -> int:  # noqa: N802
        index = self.index if k == 1 else min(self.index + k - 1, len(self.tokens) - 1)
        return self.tokens[index].type

    def get(self, index: int) -> Token:
        return self.tokens[index]

    def consume(self) -> None:
        self.index += 1

    def seek(self, index: int) -> None:
        self.index = index

    def mark(self) -> int:
        return 0

    def release(self, marker: int) -> None:
        pass


class _Refusal(BailErrorStrategy):  # type: ignore[misc] # ANTLR is not typed
    """An error strategy that ends the parse at the first syntax error, with our own message."""

    def __init__(self, tokens: Sequence[Token]) -> None:
        super().__init__()
        self.tokens = tokens

    def reportError(self, recognizer: StlParser, e: RecognitionException) -> NoReturn:  # noqa: N802
        self._refuse(recognizer, e.offendingToken)

    def recoverInline(self, recognizer: StlParser) -> NoReturn:  # noqa: N802
        self._refuse(recognizer, recognizer.getCurrentToken())

    def _refuse(self, parser: StlParser, token: Token) -> NoReturn:
        rule = parser.ruleNames[parser._ctx.getRuleIndex()]  # noqa: SLF001
        expected = frozenset(parser.getExpectedTokens())
        raise diagnose(self.tokens, token, rule, expected)
