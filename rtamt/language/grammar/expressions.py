"""From the tokens of an expression to its tree, by precedence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import cast

from rtamt.errors import ParseError, SpecificationError
from rtamt.language.formula import Formula, make, number
from rtamt.language.grammar.diagnosis import (
    Token,
    exact_number,
    fail,
    no_bound,
    shown,
    similar_name,
    text_around,
)
from rtamt.language.grammar.generated.StlParser import StlParser
from rtamt.language.interval import (
    UNITS,
    Interval,
    TracedInterval,
    decimal_text,
    is_decimal,
    no_unit,
)
from rtamt.language.node import MAX_DEPTH, MAX_OPERANDS, Node
from rtamt.language.operators import OPERATORS, Operator

_LEAVES = (StlParser.NAME, StlParser.ELEMENT, StlParser.NUMBER, StlParser.TRUTH)
_CLOSING = (StlParser.CLOSE, StlParser.CLOSE_INTERVAL)

_BACK = "bounds are not negative; for the past, use once, historically or since"
_UNIT_WORDS = {
    word: hint
    for hint, words in {
        "write ms for milliseconds, min for minutes": "m",
        "write s": "sec secs second seconds",
        "write ms": "msec msecs millis millisecond milliseconds",
        "write us": "usec usecs micros microsecond microseconds µs μs",
        "write ns": "nsec nsecs nanos nanosecond nanoseconds",
        "write min": "mins minute minutes",
        "write h": "hr hrs hour hours",
        "write 24h for a day": "d day days",
        "write a time, such as 500ms for 2 Hz": "hz khz mhz hertz",
    }.items()
    for word in words.split()
}
"""Hints for words that may be meant as a unit."""

_LONG = 60
"""The most characters of operands in an error with two ways to group them; otherwise p, q, r."""


class _Frame:
    """An operator that waits for its last operand, or an open bracket."""

    __slots__ = ("base", "interval", "row", "strength", "tokens")

    def __init__(self, row: Operator | None, strength: int, token: Token, base: int) -> None:
        self.row = row
        self.strength = strength  # 0 is a bracket: no operator binds as loosely
        self.tokens = [token]
        self.interval: Interval | None = None
        self.base = base


class TreeBuilder:
    """Builds the trees of a text after the parser has checked its syntax."""

    def __init__(
        self,
        tokens: Sequence[Token],
        constants: Mapping[str, Fraction],  # values of the names that may be bounds of intervals
        resolve: Callable[[Token], Node],  # returns the node of a name
        *,
        chains: bool,  # as for `parse_as`
        traced: bool,  # whether intervals with constants become `TracedInterval`
    ) -> None:
        self.tokens = tokens
        self.constants = constants
        self.resolve = resolve
        self.chains = chains
        self.traced = traced
        self.positions: dict[Node, tuple[int, int]] = {}  # of interval, operator or name
        self.bounding: set[str] = set()  # names of constants that are bounds of intervals
        self._values: list[Node] = []
        self._frames: list[_Frame] = []
        self._operands = 0

    def build(self, first: int, last: int) -> Node:
        """Return the tree of the tokens from first to last: a term or a formula."""
        operand_next = True
        index = first
        while index <= last:
            token = self.tokens[index]
            kind = token.type
            if kind in _LEAVES:
                self._values.append(self._leaf(token))
                operand_next = False
            elif kind == StlParser.OPEN:
                self._push(None, 0, token)
            elif kind == StlParser.FUNCTION:
                self._push(OPERATORS.spellings[token.text, "call"], 0, token)
                index += 1  # its bracket
            elif kind == StlParser.COMMA:
                self._reduce(1)
                operand_next = True
            elif kind == StlParser.CLOSE:
                self._close()
                operand_next = False
            else:
                if operand_next:
                    row = OPERATORS.spellings[token.text, "prefix"]
                    self._push(row, row.precedence, token)
                else:
                    self._infix(OPERATORS.spellings[token.text, "infix"], token)
                index = self._interval(index)
                operand_next = True
            index += 1
        self._reduce(1)
        return self._values.pop()

    def _push(self, row: Operator | None, strength: int, token: Token) -> None:
        self._frames.append(_Frame(row, strength, token, len(self._values)))

    def _close(self) -> None:
        self._reduce(1)
        frame = self._frames.pop()
        if frame.row is not None:
            self._apply(frame)

    def _infix(self, row: Operator, token: Token) -> None:
        strength = row.precedence
        self._reduce(strength + 1)
        frame = self._frames[-1] if self._frames else None
        if frame is not None and frame.strength == strength:
            # A run of one operator becomes one node. A chain without a meaning is collected too,
            # because its error shows all operands.
            run = frame.row is row and row.grouping in ("flat", "left-flat")
            left = self.chains and row.operands == "formula"
            if run or (row.grouping == "none" and not left):
                frame.tokens.append(token)
                return
            self._reduce(strength)
        self._frames.append(_Frame(row, strength, token, len(self._values) - 1))

    def _reduce(self, strength: int) -> None:
        """Apply the operators that bind at least as strongly."""
        while self._frames and self._frames[-1].strength >= strength:
            self._apply(self._frames.pop())

    def _apply(self, frame: _Frame) -> None:
        row = cast("Operator", frame.row)
        args = tuple(self._values[frame.base :])
        del self._values[frame.base :]
        token = frame.tokens[0]
        if row.grouping == "none" and len(frame.tokens) > 1:
            raise self._chained(row, frame.tokens, args)
        try:
            node = make(row.name, args, frame.interval)
        except SpecificationError as error:
            raise fail(token, str(error), _hint_for_operands(row, args)) from None
        self._operands += len(node.args)
        if self._operands > MAX_OPERANDS:
            reason = f"the operators have more than {MAX_OPERANDS} operands together"
            raise fail(token, reason, "write the formulas as several specifications")
        if frame.interval is not None:
            token = self.tokens[token.tokenIndex + 1]
        self._values.append(self._place(node, token))

    def _place(self, node: Node, token: Token) -> Node:
        self.positions.setdefault(node, (token.line, token.column + 1))
        return node

    def _leaf(self, token: Token) -> Node:
        if token.type in (StlParser.NAME, StlParser.ELEMENT):
            return self._place(self.resolve(token), token)
        if token.type == StlParser.TRUTH:
            return make(OPERATORS.words[token.text].name, ())
        try:
            return number(float(token.text))
        except SpecificationError:
            reason = f"expected a number of at most 1.797e308, got {shown(token.text)}"
            raise fail(token, reason, "true and false are +inf and -inf") from None

    def _chained(self, row: Operator, tokens: Sequence[Token], args: Sequence[Node]) -> ParseError:
        first, second = (self._spelled(t) for t in tokens[:2])
        p, q, r = (str(a) for a in args[:3])
        if len(p) + len(q) + len(r) > _LONG:
            p, q, r = "p", "q", "r"
        names = " and ".join(dict.fromkeys(f"'{t.text}'" for t in tokens[:2]))
        does = "do" if tokens[0].text != tokens[1].text else "does"
        if row.operands == "term":
            forms = f"({p} {first} {q}) and ({q} {second} {r})"
        else:
            forms = f"({p} {first} {q}) {second} {r} or {p} {first} ({q} {second} {r})"
        return fail(tokens[1], f"{names} {does} not chain; write {forms}")

    def _spelled(self, token: Token) -> str:
        """Return an operator with its interval, as it stands in the text."""
        last = token
        if self.tokens[token.tokenIndex + 1].type == StlParser.OPEN_INTERVAL:
            index = token.tokenIndex + 2
            while self.tokens[index].type not in _CLOSING:
                index += 1
            last = self.tokens[index]
        return text_around(token)[token.start : last.stop + 1]

    def _interval(self, index: int) -> int:
        """Read the interval after the operator at an index; return its last index."""
        if self.tokens[index + 1].type != StlParser.OPEN_INTERVAL:
            return index
        first = index + 2
        begin, unit, index = self._bound(first)
        if begin is None:
            reason = "expected a finite bound as the start of an interval, got inf"
            raise fail(self.tokens[first], reason, "only the end may be inf: [0:inf]")
        second, begin_scale, end_scale = index + 1, Fraction(1), Fraction(1)
        end: Fraction | None = None
        end_unit: Token | None = None
        if self.tokens[second].type in _CLOSING:
            index = second
        else:
            end, end_unit, index = self._bound(second)
        if unit is not None and end is not None:
            if end_unit is None:
                bounds = f"{decimal_text(begin)}:{decimal_text(end)}{unit.text}"
                reason = "expected a unit after the end, got one only after the start"
                raise fail(unit, reason, f"the unit of the end applies to both: [{bounds}]")
            begin_scale, end_scale = _common_scales(UNITS[unit.text], UNITS[end_unit.text])
            begin, end = begin * begin_scale, end * end_scale
            end_unit = end_unit if end_scale == 1 else unit
        unit = end_unit or unit
        begin_of = self._constant_of(first, begin_scale)
        end_of = self._constant_of(second, end_scale)
        named = begin_of is not None or end_of is not None
        if end is None and begin == 0 and not named:
            return index
        text = unit.text if unit else None
        try:
            interval = Interval(begin, end, text)
            if named:
                interval = TracedInterval(begin, end, text, begin_of, end_of)
        except SpecificationError as error:
            if begin < 0:
                raise fail(self.tokens[first], str(error), _BACK) from None
            hint = "write the smaller bound first" if (end or 0) >= 0 else _BACK
            raise fail(self.tokens[second], str(error), hint) from None
        self._frames[-1].interval = interval
        return index

    def _constant_of(self, index: int, scale: Fraction) -> tuple[str, Fraction] | None:
        """Return the constant of the bound at an index and its factor; None if it is not traced."""
        negative = self.tokens[index].type == StlParser.MINUS
        name = self.tokens[index + negative].text
        if not self.traced or name not in self.constants:
            return None
        return name, -scale if negative else scale

    def _bound(self, index: int) -> tuple[Fraction | None, Token | None, int]:
        """Return the value and the unit of a bound, and the index after it."""
        token = self.tokens[index]
        negative = token.type == StlParser.MINUS
        index += negative
        value = self._value(self.tokens[index])
        if negative:
            if value is None:
                raise fail(token, "expected a bound of at least 0, got -inf", _BACK)
            value = -value
        unit = self.tokens[index + 1]
        if unit.type != StlParser.NAME:
            return value, None, index + 1
        if unit.text not in UNITS:
            hint = _UNIT_WORDS.get(unit.text.lower(), "")
            raise fail(unit, no_unit(unit.text), hint)
        return value, unit, index + 2

    def _value(self, token: Token) -> Fraction | None:
        if token.type == StlParser.INF:
            return None
        if token.type == StlParser.NUMBER:
            return exact_number(token, token.text, "bound")
        name = token.text
        if name in self.constants:
            self.bounding.add(name)
            return self.constants[name]
        if name == "nan":
            reason = "expected a number as the bound of an interval, got nan"
            raise fail(token, reason, "write a number, a constant or inf")
        if name in UNITS:
            raise no_bound(token, f"write a number before the unit: [0:500{name}]")
        hint = similar_name(name, self.constants, f"const float {name} = 5")
        raise fail(token, f"unknown constant '{name}'", hint)


def _common_scales(begin: Fraction, end: Fraction) -> tuple[Fraction, Fraction]:
    """Return the factors that give two bounds one unit, from the lengths of their units.

    This is the unit of the end, or of the begin for ``[10s:1min]``, because no decimal number of
    minutes is exactly 10 s.
    """
    scale = begin / end
    return (scale, Fraction(1)) if is_decimal(scale) else (Fraction(1), 1 / scale)


def _hint_for_operands(row: Operator, args: Sequence[Node]) -> str:
    least, most = row.arity
    if not least <= len(args) <= (most or len(args)):
        operands = "x" if most == 1 else "x, y" if most else "x, y, ..."
        return f"write {row.symbol}({operands})"
    if row.operands == "term" and any(isinstance(a, Formula) for a in args):
        return "arithmetic and comparisons take variables, numbers and functions of them"
    if row.name == "rate":
        return "the rate of a sum is the sum of the rates: rate(x) + rate(y)"
    if max(a.depth for a in args) >= MAX_DEPTH:
        return "group long chains in brackets, or write several specifications"
    return "a name stands for its whole formula; write several specifications"  # it is too large
