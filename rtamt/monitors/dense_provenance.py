"""The origin of a formula's value in dense time: the operand and the tick from which it was taken.

Signals are right-continuous step functions: a value at a tick lasts from there on. So the least and
the greatest value of a window are values at one of its ticks: where a step begins, or where the
window does, inside of a step. Two stretches of the definitions lack a first instant or a last one:
``since`` asks for its left side just after the witness, and ``until[a:b]``, right after the tick
that is explained, up to right after that a later. Values there are those from the tick on.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.inputs.clock import Ticks
from rtamt.language.table import Bounds, Operator
from rtamt.monitors.provenance import FIRST_BEST, Definition, Finding, Origin, Value
from rtamt.program.algebra import FOLDS, ordered

__all__ = ["StepFunction", "dense_origin_of"]

INF = np.inf


class StepFunction(NamedTuple):
    """A right-continuous step function: the ticks where it changes, and its values from there on.

    The first tick is where the trace begins.
    """

    ticks: Ticks
    values: Floats

    def at(self, tick: int) -> float:
        """The value at a tick of the trace."""
        return float(self.values[_step(self.ticks, tick)])


def dense_origin_of(
    row: Operator,
    bounds: Bounds | None,
    operands: Sequence[StepFunction],
    trace: tuple[int, int],
    tick: int,
) -> Origin:
    """The origin of the value of a formula at a tick.

    Where values are equal, the first operand counts, and of its ticks the first.

    Args:
        row: The operator at the root of the formula.
        bounds: Its bounds in ticks, if it has any.
        operands: The robustness of each operand.
        trace: The ticks at which the trace begins and ends.
        tick: Where the formula is evaluated.
    """
    return _DenseDefinition(operands, trace).origin(row, bounds, tick)


def _step(ticks: Ticks, tick: int) -> int:
    """The number of the step in which a tick is."""
    return int(np.searchsorted(ticks, tick, "right")) - 1


class _DenseDefinition(Definition):
    """Builds a meaning of the table on step functions.

    Args:
        operands: The operands.
        trace: The ticks at which the trace begins and ends.
    """

    def __init__(self, operands: Sequence[StepFunction], trace: tuple[int, int]) -> None:
        super().__init__(len(operands), lambda register, tick: operands[register].at(tick))
        self._begin, self._end = trace
        self._functions = operands
        self._ticks = [function.ticks for function in operands]

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
            met = self._met(self._ticks[p], now, lo, hi)
            if not met:
                return self._outside(empty, now, lo, hi)
            ticks = self._inside(self._ticks[p], met, None if lo is None else now + lo)
            values = yield from self._values(p, ticks)
            return cast("Value", (yield p, int(ticks[first_best(values)])))

        return self._new(finding)

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds
        self._changes((p, q), (0, begin, end))
        joint = np.union1d(self._ticks[p], self._ticks[q])

        def finding(now: int) -> Finding[Value]:
            met = self._met(joint, now, begin, end)
            if not met:
                return self._outside(-INF, now, begin, end)
            way = self._inside(joint, range(_step(joint, now), met.stop), now)
            witnesses = self._inside(joint, met, now + begin)
            passed = yield from self._values(p, way)
            goals = yield from self._values(q, witnesses)
            # p is needed before a witness: before the step in which it is, if that begins with it.
            counts = np.arange(len(way) - len(met), len(way))
            counts[0] += begin > 0
            held = np.minimum.accumulate(ordered(np.concatenate(([INF], passed))))[counts]
            reached = np.minimum(held, ordered(goals))
            best = int(reached.argmax())
            before = way[: counts[best]]
            decided = q, int(witnesses[best])
            if len(before) and held[best] == reached[best]:
                decided = p, int(before[FIRST_BEST["min"](passed[: counts[best]])])
            value: Value = yield decided
            return Value.of(value, replace(value.origin, witness=int(witnesses[best])))

        return self._new(finding)

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds
        lo = None if end is None else -end
        self._changes((p, q), (0, lo, -begin))
        joint = np.union1d(self._ticks[p], self._ticks[q])

        def finding(now: int) -> Finding[Value]:
            met = self._met(joint, now, lo, -begin)
            if not met:
                return self._outside(-INF, now, lo, -begin)
            first = None if lo is None else now + lo
            way = self._inside(joint, range(met.start, _step(joint, now) + 1), first)
            witnesses = way[: len(met)]
            if begin == 0:  # now is a witness too, the last one; it needs no p
                witnesses = np.append(witnesses[witnesses < now], now)
            # p is needed after a witness: on the rest of the step in which it is, too.
            passed = yield from self._values(p, way)
            goals = yield from self._values(q, witnesses)
            backwards = np.concatenate(([INF], passed[::-1]))
            held = np.minimum.accumulate(ordered(backwards))[::-1][: len(witnesses)]
            if begin == 0:
                held[-1] = ordered(np.array([INF])).item()
            reached = np.minimum(held, ordered(goals))
            best = int(reached.argmax())
            decided = q, int(witnesses[best])
            if witnesses[best] < now and held[best] == reached[best]:
                decided = p, int(way[best + FIRST_BEST["min"](passed[best:])])
            value: Value = yield decided
            return Value.of(value, replace(value.origin, witness=int(witnesses[best])))

        return self._new(finding)

    def _met(self, ticks: Ticks, now: int, lo: int | None, hi: int | None) -> range:
        """The steps that the window from lo to hi meets, now and right after now."""
        if lo is not None and lo > 0 and now + lo >= self._end:
            return range(0)
        if hi is not None and now + hi < self._begin:
            return range(0)
        first = 0 if lo is None else max(0, _step(ticks, now + lo))
        last = len(ticks) - 1 if hi is None else _step(ticks, now + hi)
        return range(first, last + 1)

    def _inside(self, ticks: Ticks, steps: range, first: int | None) -> Ticks:
        """Where each of consecutive steps begins, the first one not before a tick."""
        inside = ticks[steps.start : steps.stop].copy()
        if first is not None:
            inside[0] = max(int(inside[0]), first)
        return inside

    def _values(self, register: int, ticks: Ticks) -> Finding[Floats]:
        if register < len(self._functions):
            function = self._functions[register]
            return function.values[np.searchsorted(function.ticks, ticks, "right") - 1]
        values: list[float] = []
        for tick in ticks.tolist():
            values.append((yield register, tick))  # noqa: PERF401 - no comprehension may yield
        return np.array(values, dtype=np.float64)

    def _changes(self, args: Iterable[int], offsets: Iterable[int | None]) -> None:
        """Note where the next register may change: where an operand does, seen from an offset."""
        ends = np.array([self._begin, self._end])
        places = [np.append(self._ticks[arg], self._end) for arg in args]
        seen = [ticks - offset for ticks in places for offset in offsets if offset is not None]
        ticks = np.unique(np.concatenate([ends, *seen]))
        self._ticks.append(ticks[(ticks >= self._begin) & (ticks <= self._end)])
