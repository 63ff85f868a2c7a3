"""The region of dense time and the operand from which a formula has its value there.

`rtamt.program.dense_regions` numbers the regions: instant t is position 2t, the open interval after
it, up to the next tick, 2t + 1. On each of them everything is constant. So the least and the
greatest value of a window are values at a position: where a run of equal values begins, or where
the window does, inside of a run.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.language.table import Bounds, Operator
from rtamt.machines.dense.runs import Positions, distinct
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

__all__ = ["RegionValues", "dense_origin_of"]


class RegionValues(NamedTuple):
    """Values over the regions of a trace, as runs of equal ones.

    Attributes:
        starts: Where the runs begin; the first at position 0.
        values: Their values.
    """

    starts: Positions
    values: Floats

    def at(self, position: int) -> float:
        """The value at a position of the trace."""
        return float(self.values[_run(self.starts, position)])


def dense_origin_of(
    row: Operator,
    bounds: Bounds | None,
    operands: Sequence[RegionValues],
    last: int,
    position: int,
    *,
    earliest: bool,
) -> Origin:
    """The origin of the value of a formula at a position.

    Where values are equal, the first operand counts, and of its positions the first.

    Args:
        row: The operator at the root of the formula.
        bounds: Its bounds in positions, if it has any.
        operands: The robustness of each operand.
        last: The last position of the trace.
        position: Where the formula is evaluated.
        earliest: As for `rtamt.monitors.sample_provenance.origin_of`.
    """
    return _RegionDefinition(operands, last, earliest=earliest).origin(row, bounds, position)


def _run(starts: Positions, position: int) -> int:
    """The number of the run in which a position is."""
    return int(np.searchsorted(starts, position, "right")) - 1


def _clipped(starts: Positions, first: int, last: int) -> Positions:
    """Where the runs from a position to another one begin, the first one not before that."""
    inside = starts[_run(starts, first) : _run(starts, last) + 1].copy()
    inside[0] = first
    return inside


class _RegionDefinition(Definition):
    """Builds a meaning of the table on runs over regions.

    Args:
        operands: The operands.
        last: The last position of the trace.
    """

    def __init__(self, operands: Sequence[RegionValues], last: int, *, earliest: bool) -> None:
        super().__init__(len(operands), lambda register, position: operands[register].at(position))
        self._last = last
        self._earliest = earliest
        self._columns = operands
        self._starts = [operand.starts for operand in operands]

    def constant(self, value: float) -> int:
        self._changes((), ())
        return super().constant(value)

    def map(self, function: str, *args: int) -> int:
        self._changes(args, (0,))
        return super().map(function, *args)

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        (p,) = args
        first_best = FIRST_BEST[fold]
        (empty,) = FOLDS[fold].identity
        self._changes((p,), (lo, hi))

        def finding(now: int) -> Finding[Value]:
            window = self._inside(now, lo, hi)
            if not window:
                return self._outside(empty, now, lo, hi)
            places = _clipped(self._starts[p], window[0], window[-1])
            values = yield from self._values(p, places)
            value: Value = yield p, int(places[first_best(values)])
            if (fold == "min") == holds_by_sign(value):
                return value.having((yield from self._parts(p, window)))
            if fold == "min" and lo != hi:
                found = value
                if self._earliest:
                    found = yield p, int(places[int(np.signbit(values).argmax())])
                return value.having(as_broken(found.origin.parts))
            return value

        return self._new(finding)

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds
        self._changes((p, q), (0, begin, end))
        joint = distinct(self._starts[p], self._starts[q])

        def finding(now: int) -> Finding[Value]:
            window = self._inside(now, begin, end)
            if not window:
                return self._outside(-INF, now, begin, end)
            witnesses = _clipped(joint, window[0], window[-1])
            way = _clipped(joint, now, window[-1])
            passed = yield from self._values(p, way)
            goals = yield from self._values(q, witnesses)
            # p is needed before a witness, and in its interval too unless that is now.
            needed = witnesses - ((witnesses % 2 == 0) | (witnesses == now))
            counts = np.where(needed < now, 0, np.searchsorted(way, needed, "right"))
            held = np.minimum.accumulate(ordered(np.concatenate(([INF], passed))))[counts]
            best = int(np.minimum(held, ordered(goals)).argmax())
            decided = q, int(witnesses[best])
            if counts[best] and held[best] <= ordered(goals)[best]:
                decided = p, int(way[FIRST_BEST["min"](passed[: counts[best]])])
            value: Value = yield decided
            witness = int(witnesses[best])
            if holds_by_sign(value):
                right, left = range(witness, witness + 1), range(now, int(needed[best]) + 1)
            else:
                right, left = window, range(0)
                if np.signbit(passed).any():  # up to where p fails, q does
                    broken = int(way[int(np.signbit(passed).argmax())])
                    right = range(window[0], broken + (broken % 2 == 0 or broken == now))
                    left = range(broken, broken + 1)
            return (yield from self._reached(value, witness, (p, left), (q, right), window))

        return self._new(finding)

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds
        lo = None if end is None else -end
        self._changes((p, q), (0, lo, -begin))
        joint = distinct(self._starts[p], self._starts[q])

        def finding(now: int) -> Finding[Value]:
            window = self._inside(now, lo, -begin)
            if not window:
                return self._outside(-INF, now, lo, -begin)
            way = _clipped(joint, window[0], now)
            # A witness at the end of a run needs no p in it, if it is an instant or now.
            ends = np.append(way[1:] - 1, now)
            ends = ends[((ends % 2 == 0) | (ends == now)) & (ends <= window[-1])]
            witnesses = distinct(way[way <= window[-1]], ends)
            passed = yield from self._values(p, way)
            goals = yield from self._values(q, witnesses)
            needed = witnesses + ((witnesses % 2 == 0) | (witnesses == now))
            runs = np.searchsorted(way, needed, "right") - 1
            backwards = np.minimum.accumulate(ordered(passed[::-1].copy()))[::-1]
            everything = ordered(np.array([INF])).item()
            held = np.where(needed > now, everything, backwards[runs])
            best = int(np.minimum(held, ordered(goals)).argmax())
            decided = q, int(witnesses[best])
            if needed[best] <= now and held[best] <= ordered(goals)[best]:
                rest = way[runs[best] :].copy()
                rest[0] = needed[best]
                decided = p, int(rest[FIRST_BEST["min"](passed[runs[best] :])])
            value: Value = yield decided
            witness = int(witnesses[best])
            if holds_by_sign(value):
                right, left = range(witness, witness + 1), range(int(needed[best]), now + 1)
            else:
                right, left = window, range(0)
                if np.signbit(passed).any():  # from where p fails on, q does
                    run = len(way) - 1 - int(np.signbit(passed)[::-1].argmax())
                    broken = now if run == len(way) - 1 else int(way[run + 1]) - 1
                    first = broken + (broken % 2 == 1 and broken != now)
                    right = range(first, window.stop)
                    left = range(broken, broken + 1)
            return (yield from self._reached(value, witness, (p, left), (q, right), window))

        return self._new(finding)

    def _reached(
        self,
        value: Value,
        witness: int,
        left: tuple[int, range],
        right: tuple[int, range],
        window: range,
    ) -> Finding[Value]:
        """The value of an ``until`` or ``since`` with its parts."""
        p, held = left
        q, goals = right
        goals = range(max(goals.start, window.start), min(goals.stop, window.stop))
        parts = yield from self._parts(p, held)
        if not holds_by_sign(value):
            if goals == window:  # all of it could be reached
                parts = ()
            parts = as_broken(parts)
        both = parts, (yield from self._parts(q, goals))
        return Value.of(value, replace(value.origin, witness=witness, parts=both))

    def _parts(self, register: int, span: range) -> Finding[Parts]:
        """The parts of the sign of a register at all positions of a span."""
        if not span:
            return ()
        if register < len(self._columns):
            return Part(register, span[0], span[-1])
        parts: list[Parts] = []
        for place in _clipped(self._starts[register], span[0], span[-1]).tolist():
            value = yield register, place
            parts.append(value.origin.parts)
        return tuple(parts)

    def _inside(self, now: int, lo: int | None, hi: int | None) -> range:
        first = 0 if lo is None else max(0, now + lo)
        last = self._last if hi is None else min(self._last, now + hi)
        return range(first, last + 1)

    def _values(self, register: int, places: Positions) -> Finding[Floats]:
        if register < len(self._columns):
            column = self._columns[register]
            return column.values[np.searchsorted(column.starts, places, "right") - 1]
        values: list[float] = []
        for place in places.tolist():
            values.append((yield register, place))  # noqa: PERF401 - no comprehension may yield
        return np.array(values, dtype=np.float64)

    def _changes(self, args: Iterable[int], offsets: Iterable[int | None]) -> None:
        """Note where the next register may change: where an operand does, seen from an offset.

        What until asks of intervals changes one position later too, what since does one earlier.
        """
        places = [np.append(self._starts[arg], self._last + 1) for arg in args]
        seen = [starts - offset for starts in places for offset in offsets if offset is not None]
        near = [starts + shift for starts in seen for shift in (-1, 0, 1)]
        self._starts.append(distinct(np.array([0], np.int64), *near))
