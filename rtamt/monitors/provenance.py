"""The origin of a formula's value: the operand and the place from which it was taken.

The meaning of an operator in `rtamt.language.operators` only chooses among the values of its
operands, by min and max, and changes their sign. Run on values that carry the operand and the
place from which they were taken, it shows which one it chose: no other code explains an operator.
A place is a sample here; `rtamt.monitors.dense_provenance` has ticks of dense time in place of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self, TypeVar, cast

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.printing import node_text
from rtamt.language.specification import Specification
from rtamt.language.table import Bounds, Operator
from rtamt.program.algebra import FOLDS, FUNCTIONS, ordered
from rtamt.program.interface import Interface, PredicateValue

__all__ = ["FIRST_BEST", "Definition", "Finding", "Origin", "Value", "Visit", "origin_of", "visits"]

INF = math.inf
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Origin:
    """The operand and the sample from which a value was taken.

    Attributes:
        operand: The number of the operand; None for the value of a window outside the trace.
        place: The place of the operand's value.
        witness: The place at which an ``until`` or ``since`` reached its right side.
        outside: First and last place of a window outside the trace; the first is None if the
            window has no beginning, the last if it has no end.
    """

    operand: int | None = None
    place: int = 0
    witness: int | None = None
    outside: tuple[int | None, int | None] | None = None


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
    names: dict[Node, str] = {}
    for name, named in specification.formulas.items():
        names.setdefault(named, name)
    formula = specification.formula
    while True:
        row = cast("Operator", formula.op)
        inner = {f: n for f, n in names.items() if f is not formula}
        origin = origin_at(formula, row, place) if row.operands == "formula" else Origin()
        reading = "value" if row.holds is None else interface.reading(formula)
        yield Visit(formula, names.get(formula), node_text(formula, inner), place, origin, reading)
        if origin.operand is None:
            return
        formula, place = cast("Formula", formula.args[origin.operand]), origin.place


def origin_of(
    row: Operator, bounds: Bounds | None, operands: Sequence[Floats], sample: int
) -> Origin:
    """The origin of the value of a formula at a sample.

    Where values are equal, the first operand counts, and of its samples the first.

    Args:
        row: The operator at the root of the formula.
        bounds: Its bounds in samples, if it has any.
        operands: The robustness of each operand at every sample.
        sample: The sample at which the formula is evaluated.
    """
    return _SampleDefinition(operands).origin(row, bounds, sample)


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
                value = Value.of(number, Origin(register, place))
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
            return apply(*values)

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


class _SampleDefinition(Definition):
    """Builds a meaning of the table on samples."""

    def __init__(self, operands: Sequence[Floats]) -> None:
        super().__init__(len(operands), lambda register, i: operands[register][i])
        self._samples = len(operands[0])
        self._columns = operands

    def _values(self, register: int, span: range) -> Finding[Floats]:
        if register < len(self._columns):
            return self._columns[register][span.start : span.stop : span.step]
        values: list[float] = []
        for i in span:
            values.append((yield register, i))  # noqa: PERF401 - no comprehension may yield
        return np.array(values, dtype=np.float64)

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        (p,) = args
        first_best = FIRST_BEST[fold]
        (empty,) = FOLDS[fold].identity

        def finding(i: int) -> Finding[Value]:
            window = self._inside(i, lo, hi)
            if not window:
                return self._outside(empty, i, lo, hi)
            values = yield from self._values(p, window)
            return cast("Value", (yield p, window[first_best(values)]))

        return self._new(finding)

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds

        def way(i: int, reached: range) -> tuple[range, slice]:
            return range(i, reached[-1]), slice(begin, None)

        return self._reaching((begin, end), p, q, way, range)

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds
        past = None if end is None else -end, -begin

        def way(i: int, reached: range) -> tuple[range, slice]:
            return range(i, reached[0], -1), slice(None, begin - 1 if begin else None, -1)

        return self._reaching(past, p, q, way, lambda i, j: range(j + 1, i + 1))

    def _reaching(
        self,
        offsets: tuple[int | None, int | None],
        p: int,
        q: int,
        way: Callable[[int, range], tuple[range, slice]],
        between: Callable[[int, int], range],
    ) -> int:
        """The greatest q of a window, each q cut to the least p between now and there.

        Args:
            offsets: The window.
            p: What must hold on the way.
            q: What must be reached.
            way: The samples on the way to the farthest of the window, outwards from now; which of
                the least p of the first 0, 1, 2, ... of them belong to the samples of the window.
            between: The samples between two.
        """

        def finding(i: int) -> Finding[Value]:
            window = self._inside(i, *offsets)
            if not window:
                return self._outside(-INF, i, *offsets)
            stretch, inside = way(i, window)
            passed = yield from self._values(p, stretch)
            held = np.minimum.accumulate(ordered(np.concatenate(([INF], passed))))[inside]
            goals = yield from self._values(q, window)
            reached = np.minimum(held, ordered(goals))
            place = int(reached.argmax())
            witness = window[place]
            value: Value = yield q, witness
            stretch = between(i, witness)
            if stretch and held[place] == reached[place]:
                least = yield from self._values(p, stretch)
                value = yield p, stretch[FIRST_BEST["min"](least)]
            return Value.of(value, replace(value.origin, witness=witness))

        return self._new(finding)

    def _inside(self, i: int, lo: int | None, hi: int | None) -> range:
        first = 0 if lo is None else max(0, i + lo)
        last = self._samples - 1 if hi is None else min(self._samples - 1, i + hi)
        return range(first, last + 1)


FIRST_BEST: Mapping[str, Callable[[Floats], int]] = {
    "min": lambda values: int(ordered(values).argmin()),
    "max": lambda values: int(ordered(values).argmax()),
}
