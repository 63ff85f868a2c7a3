"""The tokens of a requirement: operators with their operands, intervals and numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, cast

from rtamt.language.grammar.diagnosis import Token
from rtamt.language.grammar.generated.StlParser import StlParser
from rtamt.language.grammar.tokens import read
from rtamt.language.operators import OPERATORS, Notation, Operator
from rtamt.language.specification import Specification

_CONTEXT: Final = 40
"""The maximum number of characters to show around a change."""

_PREDICATE: Final = 9
"""The precedence of comparisons; operators below it join formulas."""

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
    """One change of a text, or of the value of a constant."""

    line: int  # the line of the change, from 1
    column: int  # its column, from 1
    before: str  # the text before the change, with some context
    after: str  # the text after the change; empty if nothing is left
    begin: int  # the index of the first removed character
    end: int  # the index after the last removed character
    new: str  # the characters to insert
    # a constant with its new value if its value is not in the text; otherwise None
    constant: tuple[str, Fraction] | None = None


@dataclass(frozen=True, slots=True)
class Bound:
    """A bound of an interval."""

    index: int  # the index of its number or constant
    unit: str | None  # its unit, or None
    first: int  # the index of the opening bracket of the interval
    last: int  # the index of the closing bracket


class RequirementText:
    """The tokens of the formulas of a requirement, by index.

    Args:
        spec: The requirement; its text is read again.
        period: Seconds between samples, or None if unknown.
    """

    def __init__(self, spec: Specification, period: Fraction | None) -> None:
        self.spec, self.period, self.text = spec, period, spec.text
        statements, self.tokens = read(spec.text)
        self._declared = {const.name.text: const for const in statements.constants if const.name}
        self._spans: dict[int, tuple[int, int]] = {}
        needed = _needed(spec)
        for definition in statements.definitions:
            if (definition.name.text if definition.name else "") in needed:
                formula = definition.formula
                span = formula.start.tokenIndex, formula.stop.tokenIndex
                self._spans |= dict.fromkeys(range(span[0], span[1] + 1), span)
        self._partners = _partners(self.tokens)
        self.bounds = [bound for index in self._spans for bound in self._bounds(index)]
        # the tokens of intervals
        self._inside = {
            index for bound in self.bounds for index in range(bound.first, bound.last + 1)
        }

    def operators(self, *names: str) -> Iterator[int]:
        """Yield the indices of operators with certain names."""
        for index in self._spans:
            row = self.row(index)
            if row is not None and row.name in names:
                yield index

    def row(self, index: int) -> Operator | None:
        """Return the row of an operator, or None for another token."""
        token = self.tokens[index]
        notation = _NOTATIONS.get(token.type)
        if token.type == StlParser.MINUS and index not in self._inside:
            infix = self.tokens[index - 1].type in _OPERAND_ENDS and index - 1 not in self._inside
            notation = "infix" if infix and self._spans[index][0] < index else "prefix"
        return None if notation is None else OPERATORS.spellings[token.text, notation]

    def numbers(self) -> Iterator[int]:
        """Yield the indices of numbers in terms."""
        for index in self._spans:
            if self.tokens[index].type == StlParser.NUMBER and index not in self._inside:
                yield index

    def names(self) -> Iterator[int]:
        """Yield the indices of constants in terms."""
        for index in self._spans:
            token, free = self.tokens[index], index not in self._inside
            if free and token.type == StlParser.NAME and token.text in self.spec.constants:
                yield index

    def constants(self) -> Mapping[str, Bound | None]:
        """Return the constants of the requirement, each with the first bound that it sets."""
        bounds: dict[str, Bound | None] = {}
        for bound in self.bounds:
            token = self.tokens[bound.index]
            if token.type == StlParser.NAME:
                bounds.setdefault(token.text, bound)
        return bounds | {
            name: None for index in self.names() if (name := self.tokens[index].text) not in bounds
        }

    def left(self, index: int) -> int:
        """Return the index of the first token of the left operand of an infix operator."""
        row = cast("Operator", self.row(index))
        return self._first(index, row.precedence + (row.grouping == "flat"))

    def right(self, index: int) -> int:
        """Return the index of the last token of the right operand of an infix operator."""
        return self._last(index, cast("Operator", self.row(index)).precedence + 1)

    def starts_run(self, left: int, row: Operator) -> bool:
        """Return whether a left operand is the first of a run of one operator."""
        before = left - 1
        return before < self._spans[left][0] or self.row(before) is not row

    def between(self, first: int, last: int) -> str:
        """Return the text from one token to another."""
        return self.text[self.tokens[first].start : self.tokens[last].stop + 1]

    def bracketed(self, first: int, last: int) -> bool:
        """Return whether one pair of brackets encloses the tokens from first to last."""
        return self.tokens[first].type == StlParser.OPEN and self._partners[first] == last

    def swapped(self, index: int, new: str) -> Change:
        """Return the change of a token, shown with its predicate or interval."""
        row = self.row(index)
        first = last = index
        if row is None or row.operands == "term":
            first, last = self._first(index, _PREDICATE), self._last(index, _PREDICATE)
        elif self._has_interval(index):
            last = self._partners[index + 1]
        return self.change((index, index), new, (first, last))

    def change(self, changed: tuple[int, int], new: str, shown: tuple[int, int]) -> Change:
        """Return the change of tokens, with the tokens to show around them."""
        tokens = self.tokens
        begin, end = tokens[changed[0]].start, tokens[changed[1]].stop + 1
        low, high = tokens[shown[0]].start, tokens[shown[1]].stop + 1
        if high - low > _CONTEXT:
            low, high = begin, end
        after = self.text[low:begin] + new + self.text[end:high]
        first = tokens[changed[0]]
        texts = " ".join(self.text[low:high].split()), " ".join(after.split())
        return Change(first.line, first.column + 1, *texts, begin, end, new)

    def declared(self, name: str, value: str) -> Change:
        """Return the change of a constant, in its declaration or of its value."""
        statement = self._declared.get(name)
        if name not in self.spec.overrides and statement is not None and statement.default:
            token, end = statement.default.start, statement.default.stop.stop + 1
            begin, new, constant = token.start, value, None
            before = self.text[begin:end]
        else:
            token = next(self.tokens[i] for i in self._spans if self.tokens[i].text == name)
            begin, end, new, constant = 0, 0, "", (name, Fraction(value))
            before = self.constant_text(name)
        texts = f"{name} = {before}", f"{name} = {value}"
        return Change(token.line, token.column + 1, *texts, begin, end, new, constant)

    def constant_text(self, name: str) -> str:
        """Return the number of a constant as in the text; otherwise, its shortest text."""
        statement = self._declared.get(name)
        if name not in self.spec.overrides and statement is not None and statement.default:
            part = statement.default
            return self.text[part.start.start : part.stop.stop + 1].replace(" ", "")
        return str(self.spec.constants[name]).removesuffix(".0")

    def _first(self, index: int, minimum: int) -> int:
        """Return the start of the operand before an index; operators below ``minimum`` end it."""
        begin = self._spans[index][0]
        while index > begin:
            before = self._partners.get(index - 1, index - 1)
            if before >= index or self.tokens[before].type == StlParser.COMMA:
                return index  # after an opening bracket
            if self.tokens[before].type == StlParser.OPEN_INTERVAL:
                before -= 1
            row = self.row(before)
            if row is not None and row.notation != "call" and row.precedence < minimum:
                return index
            index = before
        return index

    def _last(self, index: int, minimum: int) -> int:
        """Return the end of the operand after an index; operators below ``minimum`` end it."""
        end = self._spans[index][1]
        while index < end:
            after = self._partners.get(index + 1, index + 1)
            if after <= index or self.tokens[after].type == StlParser.COMMA:
                return index  # before a closing bracket
            row = self.row(after)
            if row is not None and row.notation == "infix" and row.precedence < minimum:
                return index
            index = after
        return index

    def _has_interval(self, index: int) -> bool:
        is_operator = self.tokens[index].type in _NOTATIONS
        return is_operator and self.tokens[index + 1].type == StlParser.OPEN_INTERVAL

    def _bounds(self, first: int) -> Iterator[Bound]:
        """Yield the bounds of the interval that starts at an index."""
        if self.tokens[first].type != StlParser.OPEN_INTERVAL:
            return
        last, values = self._partners[first], (StlParser.NUMBER, StlParser.NAME)
        for index in range(first + 1, last):
            # A name after a number or a constant is its unit.
            if self.tokens[index].type in values and self.tokens[index - 1].type not in values:
                yield Bound(index, self._unit(index, last), first, last)

    def _unit(self, index: int, last: int) -> str | None:
        """Return the unit of a bound; otherwise, the unit of the end."""
        for position in (index + 1, last - 1):
            before = self.tokens[position - 1].type
            if self.tokens[position].type == StlParser.NAME and before in _OPERAND_ENDS:
                return self.tokens[position].text
        return None


def _partners(tokens: Sequence[Token]) -> dict[int, int]:
    """Return the index of the other bracket of each pair."""
    partners: dict[int, int] = {}
    opened: list[int] = []
    for index, token in enumerate(tokens):
        if token.type in (StlParser.OPEN, StlParser.OPEN_INTERVAL):
            opened.append(index)
        elif token.type in (StlParser.CLOSE, StlParser.CLOSE_INTERVAL):
            partners[index] = opened.pop()
            partners[partners[index]] = index
    return partners


def _needed(spec: Specification) -> set[str]:
    """Return the names of the formulas of a requirement; the last one may be ``""``."""
    names = [name for name, formula in spec.formulas.items() if formula is spec.formula]
    result = "" if "" in spec.uses else names[-1]
    needed, stack = set[str](), [result]
    while stack:
        name = stack.pop()
        if name not in needed:
            needed.add(name)
            stack += spec.uses.get(name, ())
    return needed
