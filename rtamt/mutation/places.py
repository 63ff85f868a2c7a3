"""What stands where in the text of a requirement: operators, their operands, intervals, numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, cast

from rtamt.language.grammar.diagnosis import Token
from rtamt.language.grammar.generated.StlParser import StlParser
from rtamt.language.grammar.tokens import read
from rtamt.language.operators import OPERATORS
from rtamt.language.specification import Specification
from rtamt.language.table import Notation, Operator

__all__ = ["Bound", "Change", "RequirementText"]

_CONTEXT: Final = 40
"""The most characters that are shown around a changed number or comparison."""

_PREDICATE: Final = 9
"""How strongly comparisons bind; what binds less joins formulas."""

_NOTATIONS: Final[Mapping[int, Notation]] = {
    StlParser.TEMPORAL: "prefix",
    StlParser.PREFIX: "prefix",
    StlParser.BINDING: "infix",
    StlParser.INFIX: "infix",
    StlParser.SLASH: "infix",
    StlParser.FUNCTION: "call",
}
_OPERAND_ENDS: Final = frozenset(
    {StlParser.NAME, StlParser.ELEMENT, StlParser.NUMBER, StlParser.TRUTH, StlParser.CLOSE}
)


@dataclass(frozen=True, slots=True)
class Change:
    """One change of a text, or of the value that a constant of it is given.

    Attributes:
        line: The line of what is changed, from 1.
        column: Its column, from 1.
        before: What stands there, with enough beside it to be understood.
        after: The same after the change; empty if nothing is left.
        begin: The place of the first character that goes.
        end: The place behind the last one.
        new: The characters that come instead.
        given: A constant with its new value, if that does not come from the text.
    """

    line: int
    column: int
    before: str
    after: str
    begin: int
    end: int
    new: str
    given: tuple[str, Fraction] | None = None


@dataclass(frozen=True, slots=True)
class Bound:
    """A bound of an interval.

    Attributes:
        at: The place of its number or constant.
        is_end: Whether it is the upper bound.
        unit: Its unit; None if it has none.
        first: The place of the bracket before the interval.
        last: The place of the bracket behind it.
    """

    at: int
    is_end: bool
    unit: str | None
    first: int
    last: int


class RequirementText:
    """The tokens of the formulas that a requirement is made of; a place is the number of a token.

    Args:
        spec: The requirement, whose text is read again.
        period: Seconds between samples; None if nobody knows.
    """

    def __init__(self, spec: Specification, period: Fraction | None) -> None:
        self.spec, self.period, self.text = spec, period, spec.text
        statements, self.tokens = read(spec.text)
        self._declared = {each.name.text: each for each in statements.constants if each.name}
        self._spans: dict[int, tuple[int, int]] = {}
        needed = _needed(spec)
        for each in statements.definitions:
            if (each.name.text if each.name else "") in needed:
                span = each.formula.start.tokenIndex, each.formula.stop.tokenIndex
                self._spans |= dict.fromkeys(range(span[0], span[1] + 1), span)
        self._partners = _partners(self.tokens)
        self.bounds = [bound for at in self._spans for bound in self._bounds(at)]
        self._inside = {
            at for bound in self.bounds for at in range(bound.first, bound.last + 1)
        }  # of intervals

    def operators(self, *names: str) -> Iterator[int]:
        """The places of operators by the names of their rows; of all if none is named."""
        for at in self._spans:
            row = self.row(at)
            if row is not None and (not names or row.name in names):
                yield at

    def row(self, at: int) -> Operator | None:
        """The row of an operator; None if another token stands there."""
        token = self.tokens[at]
        notation = _NOTATIONS.get(token.type)
        if token.type == StlParser.MINUS and at not in self._inside:
            infix = self.tokens[at - 1].type in _OPERAND_ENDS and at - 1 not in self._inside
            notation = "infix" if infix and self._spans[at][0] < at else "prefix"
        return None if notation is None else OPERATORS.spellings[token.text, notation]

    def numbers(self) -> Iterator[int]:
        """The places of numbers in terms."""
        for at in self._spans:
            if self.tokens[at].type == StlParser.NUMBER and at not in self._inside:
                yield at

    def names(self) -> Iterator[int]:
        """The places of constants in terms."""
        for at in self._spans:
            token, free = self.tokens[at], at not in self._inside
            if free and token.type == StlParser.NAME and token.text in self.spec.constants:
                yield at

    def constants(self) -> Mapping[str, Bound | None]:
        """The constants that the requirement names, with the first bound that each of them is."""
        found: dict[str, Bound | None] = {}
        for bound in self.bounds:
            token = self.tokens[bound.at]
            if token.type == StlParser.NAME:
                found.setdefault(token.text, bound)
        return found | {
            name: None for at in self.names() if (name := self.tokens[at].text) not in found
        }

    def left(self, at: int) -> int:
        """The place of the first token of the left operand of an infix operator."""
        row = cast("Operator", self.row(at))
        return self._first(at, row.precedence + (row.grouping == "flat"))

    def right(self, at: int) -> int:
        """The place of the last token of the right operand of an infix operator."""
        return self._last(at, cast("Operator", self.row(at)).precedence + 1)

    def begins_run(self, left: int, row: Operator) -> bool:
        """Whether no operator of the same row stands before a left operand."""
        before = left - 1
        return before < self._spans[left][0] or self.row(before) is not row

    def between(self, first: int, last: int) -> str:
        """The text from one token to another."""
        return self.text[self.tokens[first].start : self.tokens[last].stop + 1]

    def bracketed(self, first: int, last: int) -> bool:
        """Whether the tokens from first to last stand in one pair of brackets."""
        return self.tokens[first].type == StlParser.OPEN and self._partners[first] == last

    def swapped(self, at: int, new: str) -> Change:
        """The change of a token, shown with the predicate or the interval that it belongs to."""
        row = self.row(at)
        first = last = at
        if row is None or row.operands == "term":
            first, last = self._first(at, _PREDICATE), self._last(at, _PREDICATE)
        elif self._has_interval(at):
            last = self._partners[at + 1]
        return self.change((at, at), new, (first, last))

    def change(self, places: tuple[int, int], new: str, shown: tuple[int, int]) -> Change:
        """The change of tokens, shown with others around them if they are not too many."""
        tokens = self.tokens
        begin, end = tokens[places[0]].start, tokens[places[1]].stop + 1
        low, high = tokens[shown[0]].start, tokens[shown[1]].stop + 1
        if high - low > _CONTEXT:
            low, high = begin, end
        after = self.text[low:begin] + new + self.text[end:high]
        where = tokens[places[0]]
        texts = " ".join(self.text[low:high].split()), " ".join(after.split())
        return Change(where.line, where.column + 1, *texts, begin, end, new)

    def declared(self, name: str, value: str) -> Change:
        """The change of a constant: where it is declared, or of the value that it is given."""
        at = next(i for i in self._spans if self.tokens[i].text == name)
        statement = self._declared.get(name)
        if name not in self.spec.given and statement is not None and statement.default:
            part = statement.default
            where, end = part.start, part.stop.stop + 1
            before, given = self.text[where.start : end], None
            begin, new = where.start, value
        else:
            where, begin, end, new = self.tokens[at], 0, 0, ""
            before, given = self.constant_text(name), (name, Fraction(value))
        shown = f"{name} = {before}", f"{name} = {value}"
        return Change(where.line, where.column + 1, *shown, begin, end, new, given)

    def constant_text(self, name: str) -> str:
        """The number of a constant as it was written, or else the shortest text of its value."""
        statement = self._declared.get(name)
        if name not in self.spec.given and statement is not None and statement.default:
            part = statement.default
            return self.text[part.start.start : part.stop.stop + 1].replace(" ", "")
        return str(self.spec.constants[name]).removesuffix(".0")

    def _first(self, at: int, least: int) -> int:
        """The first token before a place that nothing divides which binds less strongly."""
        begin = self._spans[at][0]
        while at > begin:
            before = self._partners.get(at - 1, at - 1)
            if before >= at or self.tokens[before].type == StlParser.COMMA:
                return at  # a bracket opens before it
            if self.tokens[before].type == StlParser.OPEN_INTERVAL:
                before -= 1
            row = self.row(before)
            if row is not None and row.notation != "call" and row.precedence < least:
                return at
            at = before
        return at

    def _last(self, at: int, least: int) -> int:
        """The last token behind a place that nothing divides which binds less strongly."""
        end = self._spans[at][1]
        while at < end:
            after = self._partners.get(at + 1, at + 1)
            if after <= at or self.tokens[after].type == StlParser.COMMA:
                return at  # a bracket closes behind it
            row = self.row(after)
            if row is not None and row.notation == "infix" and row.precedence < least:
                return at
            at = after
        return at

    def _has_interval(self, at: int) -> bool:
        is_operator = self.tokens[at].type in _NOTATIONS
        return is_operator and self.tokens[at + 1].type == StlParser.OPEN_INTERVAL

    def _bounds(self, at: int) -> Iterator[Bound]:
        """The bounds of the interval that begins with a token, if one does."""
        if self.tokens[at].type != StlParser.OPEN_INTERVAL:
            return
        last, is_end = self._partners[at], False
        for place in range(at + 1, last):
            kind = self.tokens[place].type
            if kind in (StlParser.COLON, StlParser.COMMA):
                is_end = True
            elif kind in (StlParser.NUMBER, StlParser.NAME):
                if self.tokens[place - 1].type in (StlParser.NUMBER, StlParser.NAME):
                    continue  # a unit
                yield Bound(place, is_end, self._unit(place, last), at, last)

    def _unit(self, at: int, last: int) -> str | None:
        """The unit of a bound: its own, else the end's."""
        for place in (at + 1, last - 1):
            before = self.tokens[place - 1].type
            if self.tokens[place].type == StlParser.NAME and before in _OPERAND_ENDS:
                return self.tokens[place].text
        return None


def _partners(tokens: Sequence[Token]) -> dict[int, int]:
    """For each bracket the place of the one that belongs to it."""
    found: dict[int, int] = {}
    opened: list[int] = []
    for at, token in enumerate(tokens):
        if token.type in (StlParser.OPEN, StlParser.OPEN_INTERVAL):
            opened.append(at)
        elif token.type in (StlParser.CLOSE, StlParser.CLOSE_INTERVAL):
            found[at] = opened.pop()
            found[found[at]] = at
    return found


def _needed(spec: Specification) -> set[str]:
    """The names of the formulas that a requirement is made of; the last one may be ``""``."""
    names = [name for name, formula in spec.formulas.items() if formula is spec.formula]
    result = "" if "" in spec.uses else names[-1]
    needed, found = set[str](), [result]
    while found:
        name = found.pop()
        if name not in needed:
            needed.add(name)
            found += spec.uses.get(name, ())
    return needed
