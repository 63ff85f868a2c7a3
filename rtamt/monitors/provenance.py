"""The origin of a formula's value: the operand and the sample from which it was taken.

The meaning of an operator in `rtamt.language.operators` only chooses among the values of its
operands, by min and max, and changes their sign. Run on values that carry the operand and the
sample from which they were taken, it shows which one it chose: no other code explains an operator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar, cast

import numpy as np

from rtamt.inputs.samples import Floats
from rtamt.language.table import Bounds, Operator
from rtamt.program.algebra import FOLDS, FUNCTIONS, ordered

__all__ = ["Origin", "origin_of"]

INF = math.inf
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Origin:
    """The operand and the sample from which a value was taken.

    Attributes:
        operand: The number of the operand; None for the value of a window outside the trace.
        sample: The sample of the operand.
        witness: The sample at which an ``until`` or ``since`` reached its right side.
        outside: First and last sample of a window outside the trace; the first is None if the
            window has no beginning, the last if it has no end.
    """

    operand: int | None = None
    sample: int = 0
    witness: int | None = None
    outside: tuple[int | None, int | None] | None = None


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
    definition = _Definition(operands)
    registers = range(len(operands))
    arguments = registers if bounds is None else (bounds, *registers)
    return definition.at(row.meaning(definition, *arguments), sample).origin


class _Value(float):
    """A number that remembers its origin; min and max of such numbers is one of them."""

    __slots__ = ("origin",)
    origin: Origin

    @classmethod
    def of(cls, value: float, origin: Origin) -> Self:
        new = cls(value)
        new.origin = origin
        return new

    def __neg__(self) -> _Value:
        return _Value.of(-float(self), self.origin)


# Finds the value of a register at a sample: it asks for values of other registers, by number and
# sample, is sent them, and returns its own. So no call waits for another one, and the number of
# operands is not limited by the depth of calls.
_Finding = Generator[tuple[int, int], Any, _T]


class _Definition:
    """Builds a meaning of the table on signals; the first registers are the operands."""

    def __init__(self, operands: Sequence[Floats]) -> None:
        self._samples = len(operands[0])
        self._operands = operands
        self._findings: list[Callable[[int], _Finding[_Value]]] = []

    def at(self, register: int, sample: int) -> _Value:
        """The value of a register at a sample."""
        asked: list[_Finding[_Value]] = []
        while True:
            if register < len(self._operands):
                value = _Value.of(self._operands[register][sample], Origin(register, sample))
            else:
                asked.append(self._findings[register - len(self._operands)](sample))
                value = None
            while asked:
                try:
                    register, sample = asked[-1].send(value)
                    break
                except StopIteration as found:
                    value = found.value
                    asked.pop()
            else:
                return cast("_Value", value)

    def _values(self, register: int, span: range) -> _Finding[Floats]:
        if register < len(self._operands):
            return self._operands[register][span.start : span.stop : span.step]
        values: list[float] = []
        for i in span:
            values.append((yield register, i))  # noqa: PERF401 - no comprehension may yield
        return np.array(values, dtype=np.float64)

    def constant(self, value: float) -> int:
        def finding(_: int) -> _Finding[_Value]:
            yield from ()
            return _Value.of(value, Origin())

        return self._new(finding)

    def map(self, function: str, *args: int) -> int:
        apply = cast("Callable[..., _Value]", FUNCTIONS[function].apply)

        def finding(i: int) -> _Finding[_Value]:
            values = []
            for a in args:
                values.append((yield a, i))  # noqa: PERF401 - no comprehension may yield
            return apply(*values)

        return self._new(finding)

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        (p,) = args
        first_best = _FIRST_BEST[fold]
        (empty,) = FOLDS[fold].identity

        def finding(i: int) -> _Finding[_Value]:
            window = self._inside(i, lo, hi)
            if not window:
                return self._outside(empty, i, lo, hi)
            values = yield from self._values(p, window)
            return cast("_Value", (yield p, window[first_best(values)]))

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

        def finding(i: int) -> _Finding[_Value]:
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
            value: _Value = yield q, witness
            stretch = between(i, witness)
            if stretch and held[place] == reached[place]:
                least = yield from self._values(p, stretch)
                value = yield p, stretch[_FIRST_BEST["min"](least)]
            return _Value.of(value, replace(value.origin, witness=witness))

        return self._new(finding)

    def _inside(self, i: int, lo: int | None, hi: int | None) -> range:
        first = 0 if lo is None else max(0, i + lo)
        last = self._samples - 1 if hi is None else min(self._samples - 1, i + hi)
        return range(first, last + 1)

    def _outside(self, value: float, i: int, lo: int | None, hi: int | None) -> _Value:
        first, last = (None if offset is None else i + offset for offset in (lo, hi))
        return _Value.of(value, Origin(outside=(first, last)))

    def _new(self, finding: Callable[[int], _Finding[_Value]]) -> int:
        self._findings.append(finding)
        return len(self._operands) + len(self._findings) - 1


_FIRST_BEST: Mapping[str, Callable[[Floats], int]] = {
    "min": lambda values: int(ordered(values).argmin()),
    "max": lambda values: int(ordered(values).argmax()),
}
