"""Ranges of declarations: ``input float x in [0, 120]``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import cast

from rtamt.language.grammar.diagnosis import (
    RANGE_HINT,
    Token,
    exact_number,
    fail,
    no_range,
    similar_name,
)
from rtamt.language.grammar.generated.StlParser import StlParser
from rtamt.language.grammar.tokens import Limits, Span, Statement
from rtamt.language.printing import number_text
from rtamt.language.ranges import is_whole, range_of_type, range_text

__all__ = ["RangeReader"]


class RangeReader:
    """Reads the range of a declaration.

    Args:
        text: The whole text.
        tokens: Its tokens.
        constants: The values of constants that limits may name.
    """

    def __init__(
        self, text: str, tokens: Sequence[Token], constants: Mapping[str, Fraction]
    ) -> None:
        self._text, self._tokens, self._constants = text, tokens, constants

    def read(self, statement: Statement, kind: str, default: float | None) -> tuple[float, float]:
        """The range, which a declared value lies in.

        Raises:
            ParseError: If it holds no number, more than the type has, or not the declared value.
        """
        word, limits = cast("Token", statement.within), cast("Limits", statement.bounds)
        if word.text != "in":
            raise no_range(self._text, word)
        lower, upper = self._limit(limits.lower), self._limit(limits.upper)
        found, first, last = (lower, upper), limits.lower.start, limits.upper.start
        if lower > upper:
            reason = f"expected {number_text(lower)} or more as the greatest value"
            hint = "the smaller limit stands first"
            raise fail(self._text, last, f"{reason}, got {number_text(upper)}", hint)
        if math.isinf(lower) and lower == upper:
            reason = f"expected a range that holds a number, got {range_text(found)}"
            raise fail(self._text, first, reason, RANGE_HINT)
        if is_whole(kind) and math.floor(min(upper, 2.0**63)) < max(lower, -(2.0**63)):
            reason = f"no whole number lies in {range_text(found)}, and {kind} has no others"
            raise fail(self._text, first, reason, RANGE_HINT)
        known = range_of_type(kind)
        if known is not None and (lower < known[0] or upper > known[1]):
            reason = f"{kind} has values in {range_text(known)}, got {range_text(found)}"
            hint = "say a range in it, or take another type"
            raise fail(self._text, first if lower < known[0] else last, reason, hint)
        if default is not None and not lower <= default <= upper:
            span = cast("Span", statement.default)
            reason = f"expected a value in {range_text(found)}, got {number_text(default)}"
            hint = "a variable has this value before its first sample"
            raise fail(self._text, span.start, reason, hint)
        return found

    def _limit(self, part: Span) -> float:
        token, last = part.start, part.stop
        negative = token.type == StlParser.MINUS
        if last.type == StlParser.INF:
            return -math.inf if negative else math.inf
        if last.type == StlParser.NUMBER:
            exact = exact_number(self._text, last, last.text, "number")
        elif last.text in self._constants:
            exact = self._constants[last.text]
        elif last.text == "nan":
            reason = "expected a number as the limit of a range, got nan"
            raise fail(self._text, last, reason, "write a number, a constant or inf")
        else:
            hint = similar_name(last.text, self._constants, f"const float {last.text} = 5")
            raise fail(self._text, last, f"unknown constant '{last.text}'", hint)
        return float(-exact if negative else exact)
