"""The sample and the operand from which a formula over samples has its value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.language.table import Bounds, Operator
from rtamt.monitors.provenance import (
    FIRST_BEST,
    INF,
    Definition,
    Finding,
    Origin,
    Part,
    Parts,
    Value,
    as_broken,
    holds_by_sign,
)
from rtamt.program.algebra import FOLDS, ordered

__all__ = ["origin_of"]


def origin_of(
    row: Operator,
    bounds: Bounds | None,
    operands: Sequence[Floats],
    sample: int,
    *,
    earliest: bool = False,
) -> Origin:
    """The origin of the value of a formula at a sample.

    Where values are equal, the first operand counts, and of its samples the first.

    Args:
        row: The operator at the root of the formula.
        bounds: Its bounds in samples, if it has any.
        operands: The robustness of each operand at every sample.
        sample: The sample at which the formula is evaluated.
        earliest: Whether, where an operand had to hold on a stretch, its parts name the first
            sample at which it fails, in place of the one with the least value.
    """
    return _SampleDefinition(operands, earliest=earliest).origin(row, bounds, sample)


class _SampleDefinition(Definition):
    """Builds a meaning of the table on samples."""

    def __init__(self, operands: Sequence[Floats], *, earliest: bool) -> None:
        super().__init__(len(operands), lambda register, i: operands[register][i])
        self._samples = len(operands[0])
        self._columns = operands
        self._earliest = earliest

    def _values(self, register: int, span: range) -> Finding[Floats]:
        if register < len(self._columns):
            return self._columns[register][span.start : span.stop : span.step]
        values: list[float] = []
        for i in span:
            values.append((yield register, i))  # noqa: PERF401 - no comprehension may yield
        return np.array(values, dtype=np.float64)

    def _parts(self, register: int, span: range) -> Finding[Parts]:
        """The parts of the sign of a register at all samples of a span."""
        if register < len(self._columns):
            return Part(register, min(span[0], span[-1]), max(span[0], span[-1])) if span else ()
        parts: list[Parts] = []
        for i in span:
            value = yield register, i
            parts.append(value.origin.parts)
        return tuple(parts)

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        (p,) = args
        first_best = FIRST_BEST[fold]
        (empty,) = FOLDS[fold].identity

        def finding(i: int) -> Finding[Value]:
            window = self._inside(i, lo, hi)
            if not window:
                return self._outside(empty, i, lo, hi)
            values = yield from self._values(p, window)
            value: Value = yield p, window[first_best(values)]
            if (fold == "min") == holds_by_sign(value):
                return value.having((yield from self._parts(p, window)))
            if fold == "min" and lo != hi:
                found = value
                if self._earliest:
                    found = yield p, window[int(np.signbit(values).argmax())]
                return value.having(as_broken(found.origin.parts))
            return value

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
            there = between(i, witness)
            if there and held[place] == reached[place]:
                least = yield from self._values(p, there)
                value = yield p, there[FIRST_BEST["min"](least)]
            if holds_by_sign(value):
                needed, broken = range(witness, witness + 1), there
            else:  # where p has held on the way, q fails
                open_ones = np.flatnonzero(held >= 0)
                needed = window[open_ones[0] : open_ones[-1] + 1] if len(open_ones) else range(0)
                k = int(np.signbit(passed).argmax()) if len(passed) else 0
                broken = stretch[k : k + 1] if np.signbit(passed).any() else range(0)
            left = yield from self._parts(p, broken)
            right = yield from self._parts(q, needed)
            if not holds_by_sign(value):
                left = as_broken(left)
            return Value.of(value, replace(value.origin, witness=witness, parts=(left, right)))

        return self._new(finding)

    def _inside(self, i: int, lo: int | None, hi: int | None) -> range:
        first = 0 if lo is None else max(0, i + lo)
        last = self._samples - 1 if hi is None else min(self._samples - 1, i + hi)
        return range(first, last + 1)
