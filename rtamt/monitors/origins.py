"""The origin of a formula's value: the operand and the place from which it was taken.

The meaning of an operator in `rtamt.language.operators` only chooses among the values of its
operands, by minimum and maximum, and changes their sign. Run on values with an origin, it shows
which value it chose.

To add an operator, nothing is needed here: its meaning explains it.

A place is the number of a sample, or a position of dense time (`rtamt.program.dense_lowering`).
`FormulaSignals` in `rtamt.monitors.explainer` follows the origins through a formula, over samples
and over dense time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self, TypeVar, cast

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.language.operators import Bounds, Operator
from rtamt.machines.dense.runs import Positions, distinct
from rtamt.program.algebra import FOLDS, FUNCTIONS, ordered

INF = math.inf
_T = TypeVar("_T")


class RobustnessSignal(NamedTuple):
    """Values over the places of a trace: of runs that start at ``starts``, or of every place."""

    values: Floats
    starts: Positions | None = None

    def at(self, place: int) -> float:
        """Return the value at a place."""
        return float(self.values[place if self.starts is None else _run(self.starts, place)])

    def within(self, first: int, last: int) -> tuple[Positions, Floats]:
        """Return where the runs from one place to another start, and their values."""
        places = _clipped(self.starts, first, last)
        return places, self.among(places)

    def among(self, places: Positions) -> Floats:
        """Return the values at increasing places, without gaps if every place has its own value."""
        if self.starts is None:
            return self.values[places[0] : places[-1] + 1] if len(places) else self.values[:0]
        return self.values[self.starts.searchsorted(places, "right") - 1]


def _run(starts: Positions, place: int) -> int:
    """Return the number of the run that contains a place."""
    return int(starts.searchsorted(place, "right")) - 1


def _clipped(starts: Positions | None, first: int, last: int) -> Positions:
    """Return where the runs from one place to another start, the first at the first place."""
    if starts is None:
        return np.arange(first, last + 1)
    inside = starts[_run(starts, first) : _run(starts, last) + 1].copy()
    inside[0] = first
    return inside


@dataclass(frozen=True, slots=True)
class Part:
    """An operand on a span of places that contributes to the sign of a value.

    ``broken`` is set if the operand had to hold on a stretch of places and fails at this place.
    """

    operand: int
    first: int
    last: int
    broken: bool = False


Parts = Part | tuple["Parts", ...]
"""Parts, nested so that many operands need no copies."""


def flat(parts: Parts) -> Iterator[Part]:
    """Yield the parts one by one, in their order."""
    stack = [parts]
    while stack:
        item = stack.pop()
        if isinstance(item, Part):
            yield item
        else:
            stack += reversed(item)


@dataclass(frozen=True, slots=True)
class Origin:
    """The operand and the place from which a value was taken; None for a window outside the trace.

    ``witness`` is where ``until`` or ``since`` reached its right side. ``outside`` has the ends of
    a window outside the trace, None for an open end. As long as the signs of ``parts`` stay, so
    does the sign of the value, whatever else changes.
    """

    operand: int | None = None
    place: int = 0
    witness: int | None = None
    outside: tuple[int | None, int | None] | None = None
    parts: Parts = ()


class Value(float):
    """A number that remembers its origin; min and max of such numbers return one of them."""

    __slots__ = ("origin",)
    origin: Origin

    @classmethod
    def of(cls, value: float, origin: Origin) -> Self:
        """Return the number with an origin."""
        number = cls(value)
        number.origin = origin
        return number

    def having(self, parts: Parts) -> Value:
        """Return the number with other parts of its sign."""
        return Value.of(self, replace(self.origin, parts=parts))

    def __neg__(self) -> Value:
        return Value.of(-float(self), self.origin)


FIRST_BEST: Mapping[str, Callable[[Floats], int]] = {
    "min": lambda values: int(ordered(values).argmin()),
    "max": lambda values: int(ordered(values).argmax()),
}


def holds_by_sign(value: float) -> bool:
    """Return whether a formula with this value holds: the sign bit is clear."""
    return math.copysign(1.0, value) > 0.0


def _as_broken(parts: Parts) -> Parts:
    return tuple(replace(part, broken=True) for part in flat(parts))


# A computation of a register at a place: it yields the number and the place of a register that it
# reads, receives that value, and returns its own. No call waits for another, so the depth of calls
# does not limit the number of operands.
Computation = Generator[tuple[int, int], Any, _T]


def origin_of(
    row: Operator,
    bounds: Bounds | None,
    operands: Sequence[RobustnessSignal],
    last: int,
    place: int,
    *,
    dense: bool = False,
    earliest: bool = False,
) -> Origin:
    """Return the origin of the value of a formula at a place; of equal values, the first.

    With ``earliest``, parts of an operand that had to hold on a stretch name the first place at
    which it fails, instead of the place with the smallest value.
    """
    definition = _Definition(operands, last, dense=dense, earliest=earliest)
    return definition.origin(row, bounds, place)


class _Definition:
    """A meaning of the operator table on signals; the first registers are the operands."""

    def __init__(
        self, operands: Sequence[RobustnessSignal], last: int, *, dense: bool, earliest: bool
    ) -> None:
        self._operands = operands
        self._last = last
        self._step = 2 if dense else 1
        self._earliest = earliest
        self._starts = [operand.starts for operand in operands]
        self._computations: list[Callable[[int], Computation[Value]]] = []

    def origin(self, row: Operator, bounds: Bounds | None, place: int) -> Origin:
        registers = range(len(self._operands))
        arguments = registers if bounds is None else (bounds, *registers)
        return self._at(row.meaning(self, *arguments), place).origin

    def _at(self, register: int, place: int) -> Value:
        """Return the value of a register at a place."""
        waiting: list[Computation[Value]] = []
        while True:
            if register < len(self._operands):
                number = self._operands[register].at(place)
                value = Value.of(
                    number, Origin(register, place, parts=Part(register, place, place))
                )
            else:
                waiting.append(self._computations[register - len(self._operands)](place))
                value = None
            while waiting:
                try:
                    register, place = waiting[-1].send(value)
                    break
                except StopIteration as stop:
                    value = stop.value
                    waiting.pop()
            else:
                return cast("Value", value)

    def constant(self, value: float) -> int:
        """Emit the same value at every place."""

        def computation(_: int) -> Computation[Value]:
            yield from ()
            return Value.of(value, Origin())

        return self._new(computation, (), ())

    def map(self, function: str, *args: int) -> int:
        """Emit the function of the operands' values at one place."""
        apply = cast("Callable[..., Value]", FUNCTIONS[function].apply)

        def computation(now: int) -> Computation[Value]:
            values = []
            for a in args:
                values.append((yield a, now))  # noqa: PERF401 - no comprehension may yield
            result = apply(*values)
            if function in FIRST_BEST and (function == "min") == holds_by_sign(result):
                return result.having(tuple(value.origin.parts for value in values))
            return result

        return self._new(computation, args, (0,))

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        """Emit the fold over the places from lo to hi from now."""
        (p,) = args
        first_best = FIRST_BEST[fold]
        (empty,) = FOLDS[fold].identity

        def computation(now: int) -> Computation[Value]:
            window = self._inside(now, lo, hi)
            if not window:
                return self._outside(empty, now, lo, hi)
            places = _clipped(self._starts[p], window[0], window[-1])
            values = yield from self._values(p, places)
            value: Value = yield p, int(places[first_best(values)])
            if (fold == "min") == holds_by_sign(value):
                return value.having((yield from self._parts(p, window)))
            if fold == "min" and lo != hi:
                failing = value
                if self._earliest:
                    failing = yield p, int(places[int(np.signbit(values).argmax())])
                return value.having(_as_broken(failing.origin.parts))
            return value

        return self._new(computation, (p,), (lo, hi))

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        """Emit half-open until: the largest q, each limited by the smallest p before it."""
        begin, end = bounds
        joint = self._joint(p, q)

        def computation(now: int) -> Computation[Value]:
            window = self._inside(now, begin, end)
            if not window:
                return self._outside(-INF, now, begin, end)
            witnesses = _clipped(joint, window[0], window[-1])
            path = _clipped(joint, now, window[-1])
            passed = yield from self._values(p, path)
            goals = yield from self._values(q, witnesses)
            # p must hold before a witness, and in an open interval also at it, unless that is now.
            needed = witnesses - self._excluded(witnesses, now)
            counts = np.where(needed < now, 0, np.searchsorted(path, needed, "right"))
            held = np.minimum.accumulate(ordered(np.concatenate(([INF], passed))))[counts]
            best = int(np.minimum(held, ordered(goals)).argmax())
            witness = int(witnesses[best])
            source = q, witness
            if counts[best] and held[best] <= ordered(goals)[best]:
                source = p, int(path[FIRST_BEST["min"](passed[: counts[best]])])
            value: Value = yield source
            if holds_by_sign(value):
                right, left = range(witness, witness + 1), range(now, int(needed[best]) + 1)
            else:
                right, left = window, range(0)
                if np.signbit(passed).any():  # q fails up to the place where p fails
                    broken = int(path[int(np.signbit(passed).argmax())])
                    right = range(window[0], broken + int(self._excluded(broken, now)))
                    left = range(broken, broken + 1)
            return (yield from self._reached(value, witness, (p, left), (q, right), window))

        return self._new(computation, (p, q), (0, begin, end))

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        """Emit half-open since: the largest q, each limited by the smallest p after it."""
        begin, end = bounds
        lo = None if end is None else -end
        joint = self._joint(p, q)

        def computation(now: int) -> Computation[Value]:
            window = self._inside(now, lo, -begin)
            if not window:
                return self._outside(-INF, now, lo, -begin)
            path = _clipped(joint, window[0], now)
            # A witness at the end of a run does not need p there if it is an instant or now.
            ends = np.append(path[1:] - 1, now)
            ends = ends[self._excluded(ends, now) & (ends <= window[-1])]
            witnesses = distinct(path[path <= window[-1]], ends)
            passed = yield from self._values(p, path)
            goals = yield from self._values(q, witnesses)
            needed = witnesses + self._excluded(witnesses, now)
            runs = np.searchsorted(path, needed, "right") - 1
            backwards = np.minimum.accumulate(ordered(passed[::-1].copy()))[::-1]
            everything = ordered(np.array([INF])).item()
            held = np.where(needed > now, everything, backwards[runs])
            best = int(np.minimum(held, ordered(goals)).argmax())
            witness = int(witnesses[best])
            source = q, witness
            if needed[best] <= now and held[best] <= ordered(goals)[best]:
                remainder = path[runs[best] :].copy()
                remainder[0] = needed[best]
                source = p, int(remainder[FIRST_BEST["min"](passed[runs[best] :])])
            value: Value = yield source
            if holds_by_sign(value):
                right, left = range(witness, witness + 1), range(int(needed[best]), now + 1)
            else:
                right, left = window, range(0)
                if np.signbit(passed).any():  # q fails from the place where p fails
                    run = len(path) - 1 - int(np.signbit(passed)[::-1].argmax())
                    broken = now if run == len(path) - 1 else int(path[run + 1]) - 1
                    right = range(broken + (not self._excluded(broken, now)), window.stop)
                    left = range(broken, broken + 1)
            return (yield from self._reached(value, witness, (p, left), (q, right), window))

        return self._new(computation, (p, q), (0, lo, -begin))

    def _excluded(self, place: Any, now: int) -> Any:  # noqa: ANN401 - a place or an array
        """Return whether a witness at a place needs no p there: a sample, an instant, or now."""
        return (place % self._step == 0) | (place == now)

    def _reached(
        self,
        value: Value,
        witness: int,
        left: tuple[int, range],
        right: tuple[int, range],
        window: range,
    ) -> Computation[Value]:
        """Return the value of an ``until`` or ``since`` with its parts."""
        p, held = left
        q, goals = right
        goals = range(max(goals.start, window.start), min(goals.stop, window.stop))
        parts = yield from self._parts(p, held)
        if not holds_by_sign(value):
            if goals == window:  # all of it could be reached
                parts = ()
            parts = _as_broken(parts)
        both = parts, (yield from self._parts(q, goals))
        return Value.of(value, replace(value.origin, witness=witness, parts=both))

    def _parts(self, register: int, span: range) -> Computation[Parts]:
        """Return the parts of the sign of a register at all places of a span."""
        if not span:
            return ()
        if register < len(self._operands):
            return Part(register, span[0], span[-1])
        parts: list[Parts] = []
        for position in _clipped(self._starts[register], span[0], span[-1]).tolist():
            value = yield register, position
            parts.append(value.origin.parts)
        return tuple(parts)

    def _values(self, register: int, places: Positions) -> Computation[Floats]:
        if register < len(self._operands):
            return self._operands[register].among(places)
        values: list[float] = []
        for position in places.tolist():
            values.append((yield register, position))  # noqa: PERF401 - no comprehension may yield
        return np.array(values, dtype=np.float64)

    def _inside(self, now: int, lo: int | None, hi: int | None) -> range:
        first = 0 if lo is None else max(0, now + lo)
        last = self._last if hi is None else min(self._last, now + hi)
        return range(first, last + 1)

    def _outside(self, value: float, now: int, lo: int | None, hi: int | None) -> Value:
        first, last = (None if offset is None else now + offset for offset in (lo, hi))
        return Value.of(value, Origin(outside=(first, last)))

    def _joint(self, p: int, q: int) -> Positions | None:
        """Return where one of two registers may change; None for everywhere."""
        first, second = self._starts[p], self._starts[q]
        return None if first is None or second is None else distinct(first, second)

    def _new(
        self,
        computation: Callable[[int], Computation[Value]],
        args: Iterable[int],
        offsets: Iterable[int | None],
    ) -> int:
        """Add a register that may change where an operand changes, seen from one of the offsets.

        In dense time, until may also change one place later, and since one place earlier.
        """
        self._computations.append(computation)
        starts: Positions | None = None
        if self._step > 1:
            changes = [np.append(cast("Positions", self._starts[a]), self._last + 1) for a in args]
            shifted = [
                places - offset for places in changes for offset in offsets if offset is not None
            ]
            near = [places + shift for places in shifted for shift in (-1, 0, 1)]
            starts = distinct(np.array([0], np.int64), *near)
        self._starts.append(starts)
        return len(self._starts) - 1
