"""The origin of a formula's value: the operand and the sample from which it was taken.

The meaning of an operator in `rtamt.language.operators` only chooses among the values of its
operands, by min and max, and changes their sign. Run on values that carry the operand and the
sample from which they were taken, it shows which one it chose: no other code explains an operator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self, cast

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.samples import Floats
from rtamt.language.table import Bounds, Operator
from rtamt.program.algebra import FOLDS, FUNCTIONS, ordered

__all__ = ["Origin", "origin_of"]

INF = math.inf
Ordered = NDArray[np.int64]


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


@dataclass(frozen=True, slots=True)
class _Signal:
    """A signal of such numbers: the one at a sample, and the plain values in a range of samples."""

    at: Callable[[int], _Value]
    values: Callable[[range], Floats]


class _Definition:
    """Builds a meaning of the table on signals; the first registers are the operands."""

    def __init__(self, operands: Sequence[Floats]) -> None:
        self._samples = len(operands[0])
        self._signals = [_operand(i, values) for i, values in enumerate(operands)]

    def at(self, register: int, sample: int) -> _Value:
        return self._signals[register].at(sample)

    def constant(self, value: float) -> int:
        return self._new(lambda _: _Value.of(value, Origin()))

    def map(self, function: str, *args: int) -> int:
        apply = cast("Callable[..., _Value]", FUNCTIONS[function].apply)
        signals = [self._signals[a] for a in args]
        return self._new(lambda i: apply(*(s.at(i) for s in signals)))

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        (p,) = (self._signals[a] for a in args)
        first_best = _FIRST_BEST[fold]
        (empty,) = FOLDS[fold].identity

        def at(i: int) -> _Value:
            window = self._inside(i, lo, hi)
            if not window:
                return self._outside(empty, i, lo, hi)
            return p.at(window[first_best(p.values(window))])

        return self._new(at)

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds

        def held(i: int, reached: range) -> Ordered:
            return self._least(p, range(i, reached[-1]))[begin:]

        return self._reaching((begin, end), p, q, held, range)

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds
        past = None if end is None else -end, -begin

        def held(i: int, reached: range) -> Ordered:
            return self._least(p, range(i, reached[0], -1))[begin:][::-1]

        return self._reaching(past, p, q, held, lambda i, j: range(j + 1, i + 1))

    def _reaching(
        self,
        offsets: tuple[int | None, int | None],
        p: int,
        q: int,
        held: Callable[[int, range], Ordered],
        between: Callable[[int, int], range],
    ) -> int:
        """The greatest q of a window, each q cut to the least p between now and there."""
        before, goal = self._signals[p], self._signals[q]

        def at(i: int) -> _Value:
            window = self._inside(i, *offsets)
            if not window:
                return self._outside(-INF, i, *offsets)
            way = held(i, window)
            reached = np.minimum(way, ordered(goal.values(window)))
            witness = window[int(reached.argmax())]
            value, stretch = goal.at(witness), between(i, witness)
            if stretch and way[witness - window[0]] == reached.max():
                value = before.at(stretch[_FIRST_BEST["min"](before.values(stretch))])
            return _Value.of(value, replace(value.origin, witness=witness))

        return self._new(at)

    def _least(self, p: int, stretch: range) -> Ordered:
        """The least p among the first 0, 1, 2, ... samples of a stretch."""
        values = np.concatenate(([INF], self._signals[p].values(stretch)))
        return np.minimum.accumulate(ordered(values))

    def _inside(self, i: int, lo: int | None, hi: int | None) -> range:
        first = 0 if lo is None else max(0, i + lo)
        last = self._samples - 1 if hi is None else min(self._samples - 1, i + hi)
        return range(first, last + 1)

    def _outside(self, value: float, i: int, lo: int | None, hi: int | None) -> _Value:
        first, last = (None if offset is None else i + offset for offset in (lo, hi))
        return _Value.of(value, Origin(outside=(first, last)))

    def _new(self, at: Callable[[int], _Value]) -> int:
        self._signals.append(_Signal(at, lambda span: np.array([float(at(i)) for i in span])))
        return len(self._signals) - 1


_FIRST_BEST: Mapping[str, Callable[[Floats], int]] = {
    "min": lambda values: int(ordered(values).argmin()),
    "max": lambda values: int(ordered(values).argmax()),
}


def _operand(number: int, values: Floats) -> _Signal:
    return _Signal(
        at=lambda i: _Value.of(values[i], Origin(number, i)),
        values=lambda span: values[span.start : span.stop : span.step],
    )
