"""The origin of a formula's value: the operand and the place from which it was taken.

The meaning of an operator in `rtamt.language.operators` only chooses among the values of its
operands, by min and max, and changes their sign. Run on values that carry the operand and the
place from which they were taken, it shows which one it chose: no other code explains an operator.
A place is a sample in `rtamt.monitors.sample_provenance`, and a tick of dense time in
`rtamt.monitors.dense_provenance`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self, TypeVar, cast

from rtamt.inputs.arrays import Floats
from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.printing import node_text
from rtamt.language.specification import Specification
from rtamt.language.table import Bounds, Operator
from rtamt.program.algebra import FUNCTIONS, ordered
from rtamt.program.interface import Interface, PredicateValue

__all__ = [
    "FIRST_BEST",
    "Definition",
    "Finding",
    "Origin",
    "Part",
    "Parts",
    "Value",
    "Visit",
    "as_broken",
    "flat",
    "holds_by_sign",
    "named",
    "visits",
]

INF = math.inf
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Part:
    """An operand at some places, whose sign there has a part in the sign of a value.

    Attributes:
        operand: The number of the operand.
        first: The first one of the places.
        last: The last one; the places between them belong to it.
        broken: Whether the operand had to hold on a stretch of places and fails at this one.
    """

    operand: int
    first: int
    last: int
    broken: bool = False


Parts = Part | tuple["Parts", ...]
"""Some parts, nested as they came together, so that many operands need no copies."""


def flat(parts: Parts) -> Iterator[Part]:
    """The parts one by one, in their order."""
    stack = [parts]
    while stack:
        found = stack.pop()
        if isinstance(found, Part):
            yield found
        else:
            stack += reversed(found)


@dataclass(frozen=True, slots=True)
class Origin:
    """The operand and the sample from which a value was taken.

    Attributes:
        operand: The number of the operand; None for the value of a window outside the trace.
        place: The place of the operand's value.
        witness: The place at which an ``until`` or ``since`` reached its right side.
        outside: First and last place of a window outside the trace; the first is None if the
            window has no beginning, the last if it has no end.
        parts: The operands at places that make the sign of the value: as long as the sign of each
            of them stays, so does the sign of the value, whatever else changes.
    """

    operand: int | None = None
    place: int = 0
    witness: int | None = None
    outside: tuple[int | None, int | None] | None = None
    parts: Parts = ()


class Visit(NamedTuple):
    """A formula at a place, on the way from a specification to what decided.

    Attributes:
        formula: The formula.
        name: Its name in the specification, or None.
        text: The formula as text; named formulas inside it are shown by their names.
        place: The place at which it is evaluated.
        origin: From where it has its value there.
        reading: What it counts under the semantics, if it is a predicate.
    """

    formula: Formula
    name: str | None
    text: str
    place: int
    origin: Origin
    reading: PredicateValue


def visits(
    specification: Specification,
    interface: Interface,
    place: int,
    origin_at: Callable[[Formula, Operator, int], Origin],
) -> Iterator[Visit]:
    """The formulas from a specification down to the predicate or the window that decided.

    Args:
        specification: The specification.
        interface: What predicates count.
        place: The place at which the specification is evaluated.
        origin_at: The origin of the value of a formula of formulas at a place.
    """
    formula = specification.formula
    while True:
        row = cast("Operator", formula.op)
        origin = origin_at(formula, row, place) if row.operands == "formula" else Origin()
        reading = "value" if row.holds is None else interface.reading(formula)
        yield Visit(formula, *named(specification, formula), place, origin, reading)
        if origin.operand is None:
            return
        formula, place = cast("Formula", formula.args[origin.operand]), origin.place


def named(specification: Specification, formula: Formula) -> tuple[str | None, str]:
    """The name of a formula, or None, and its text with the names of the formulas inside it."""
    names: dict[Node, str] = {}
    for name, its in specification.formulas.items():
        names.setdefault(its, name)
    own = names.pop(formula, None)
    return own, node_text(formula, names)


class Value(float):
    """A number that remembers its origin; min and max of such numbers is one of them."""

    __slots__ = ("origin",)
    origin: Origin

    @classmethod
    def of(cls, value: float, origin: Origin) -> Self:
        """The number from an origin."""
        new = cls(value)
        new.origin = origin
        return new

    def having(self, parts: Parts) -> Value:
        """The number with other parts of its sign."""
        return Value.of(self, replace(self.origin, parts=parts))

    def __neg__(self) -> Value:
        return Value.of(-float(self), self.origin)


# Finds the value of a register at a place: it asks for values of other registers, by number and
# place, is sent them, and returns its own. So no call waits for another one, and the number of
# operands is not limited by the depth of calls.
Finding = Generator[tuple[int, int], Any, _T]


class Definition:
    """Builds a meaning of the table on signals; the first registers are the operands.

    A class of it has the builder's `window`, `until` and `since` over its kind of places.

    Args:
        operands: The number of operands.
        operand: The value of an operand at a place.
    """

    def __init__(self, operands: int, operand: Callable[[int, int], float]) -> None:
        self._operands = operands
        self._operand = operand
        self._findings: list[Callable[[int], Finding[Value]]] = []

    def origin(self, row: Operator, bounds: Bounds | None, place: int) -> Origin:
        """The origin of the value of an operator of the operands at a place."""
        registers = range(self._operands)
        arguments = registers if bounds is None else (bounds, *registers)
        return self._at(row.meaning(self, *arguments), place).origin

    def _at(self, register: int, place: int) -> Value:
        """The value of a register at a place."""
        asked: list[Finding[Value]] = []
        while True:
            if register < self._operands:
                number = self._operand(register, place)
                part = Part(register, place, place)
                value = Value.of(number, Origin(register, place, parts=part))
            else:
                asked.append(self._findings[register - self._operands](place))
                value = None
            while asked:
                try:
                    register, place = asked[-1].send(value)
                    break
                except StopIteration as found:
                    value = found.value
                    asked.pop()
            else:
                return cast("Value", value)

    def constant(self, value: float) -> int:
        """The same value at every place."""

        def finding(_: int) -> Finding[Value]:
            yield from ()
            return Value.of(value, Origin())

        return self._new(finding)

    def map(self, function: str, *args: int) -> int:
        """The function of the operands' values at one place."""
        apply = cast("Callable[..., Value]", FUNCTIONS[function].apply)

        def finding(i: int) -> Finding[Value]:
            values = []
            for a in args:
                values.append((yield a, i))  # noqa: PERF401 - no comprehension may yield
            found = apply(*values)
            if function in FIRST_BEST and (function == "min") == holds_by_sign(found):
                return found.having(tuple(value.origin.parts for value in values))
            return found

        return self._new(finding)

    def _outside(self, value: float, i: int, lo: int | None, hi: int | None) -> Value:
        first, last = (None if offset is None else i + offset for offset in (lo, hi))
        return Value.of(value, Origin(outside=(first, last)))

    def _new(self, finding: Callable[[int], Finding[Value]]) -> int:
        self._findings.append(finding)
        return self._operands + len(self._findings) - 1

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        """The fold over the places from lo to hi from now."""
        raise NotImplementedError

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        """Half-open until."""
        raise NotImplementedError

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        """Half-open since."""
        raise NotImplementedError


FIRST_BEST: Mapping[str, Callable[[Floats], int]] = {
    "min": lambda values: int(ordered(values).argmin()),
    "max": lambda values: int(ordered(values).argmax()),
}


def holds_by_sign(value: float) -> bool:
    """Whether a formula of this value holds: the sign bit is clear."""
    return math.copysign(1.0, value) > 0.0


def as_broken(parts: Parts) -> Parts:
    """The parts of a value that had to hold on a stretch, and fails at this place of it."""
    return tuple(replace(part, broken=True) for part in flat(parts))
