"""The origin of a formula's value: the operand and the place from which it was taken.

The meaning of an operator in `rtamt.language.operators` only chooses among the values of its
operands, by minimum and maximum, and changes their sign. Run on values with an origin, it shows
which value it chose.

To add an operator, nothing is needed here: its meaning explains it.

A place is the number of a sample, or a position of dense time (`rtamt.program.dense_lowering`).
`FormulaSignals` follows the origins through a formula, over samples and over dense time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self, TypeVar, cast

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.language.formula import Formula
from rtamt.language.node import Node, node_text
from rtamt.language.operators import Bounds, Operator
from rtamt.language.specification import Specification
from rtamt.machines.dense.runs import Positions, distinct
from rtamt.monitors.explanation import ShareRole
from rtamt.program.algebra import FOLDS, FUNCTIONS, ordered
from rtamt.program.implications import operand_signs
from rtamt.program.interface import Interface, PredicateValue

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
    """The operand and the place from which a value was taken.

    ``operand`` is None for a window outside the trace. ``witness`` is where ``until`` or ``since``
    reached its right side. ``outside`` has the ends of a window outside the trace, None for an open
    end. As long as the signs of ``parts`` stay, so does the sign of the value, whatever else
    changes.
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


BoundSignal = Callable[[Node, bool], RobustnessSignal]
"""Returns the lower or, with True, the upper bound of a formula."""


class NoSingleCause(Exception):  # noqa: N818 - no error for users
    """A bound that is not the value of one predicate on the trace."""


class OriginStep(NamedTuple):
    """A formula at a place on the path to the cause; its value is the upper bound if ``best``."""

    formula: Formula
    name: str | None
    text: str
    place: int
    origin: Origin
    reading: PredicateValue
    best: bool


class Share(NamedTuple):
    """A formula whose sign from a first to a last place contributes to a violation."""

    formula: Formula
    role: ShareRole
    first: int
    last: int
    best: bool
    outside: tuple[int | None, int | None] | None = None


class FormulaSignals:
    """The robustness of all formulas on a trace, and where it comes from.

    ``signal`` returns a bound of a formula over the trace and ``ahead`` places after it: the upper
    one if its second argument is true, as ``best`` states for the specification. On a complete
    trace both bounds are the robustness.
    """

    def __init__(
        self,
        specification: Specification,
        interface: Interface,
        signal: BoundSignal,
        bounds: Callable[[Formula], Bounds],
        last: int,
        *,
        dense: bool = False,
        best: bool = False,
        ahead: int = 0,
    ) -> None:
        self._specification, self._interface = specification, interface
        self.signal, self._bounds = signal, bounds
        self._last, self._dense = last, dense
        self._best, self._ahead = best, ahead

    def named(self, formula: Formula) -> tuple[str | None, str]:
        """Return the name of a formula, or None, and its text with the names of formulas in it."""
        names: dict[Node, str] = {}
        for name, node in self._specification.formulas.items():
            names.setdefault(node, name)
        name_of_formula = names.pop(formula, None)
        return name_of_formula, node_text(formula, names)

    def path(self, place: int) -> list[OriginStep]:
        """Return the formulas from the specification at a place down to the deciding formula."""
        formula, path, best = self._specification.formula, list[OriginStep](), self._best
        while True:
            row = cast("Operator", formula.op)
            origin = Origin()
            if row.operands == "formula":
                origin = self._origin(formula, place, best=best)
            reading = "value" if row.holds is None else self._interface.reading(formula)
            path.append(OriginStep(formula, *self.named(formula), place, origin, reading, best))
            if origin.operand is None:
                return path
            best = self._best_of(formula, origin.operand, best=best)
            formula, place = cast("Formula", formula.args[origin.operand]), origin.place

    def rests_on_trace(self, path: Sequence[OriginStep]) -> bool:
        """Return whether a path follows one value of a bound down to a place of the trace."""
        values = [abs(self.signal(step.formula, step.best).at(step.place)) for step in path]
        last = path[-1]
        if last.origin.outside is not None:
            final = last.origin.outside[1]
            empty = final is not None and final <= self._last  # a window of the past
            return empty and all(value == math.inf for value in values)
        return last.place <= self._last and all(value == values[0] for value in values)

    def _best_of(self, formula: Formula, operand: int, *, best: bool) -> bool:
        """Return which bound of an operand a bound of a formula reads; see `_origin` for both."""
        return best == self._signs(formula).get(operand, True)

    def _signs(self, formula: Formula) -> Mapping[int, bool]:
        timed = formula.op is not None and formula.op.timed
        return operand_signs(formula, self._bounds(formula)) if timed else operand_signs(formula)

    def _origin(
        self, formula: Formula, place: int, *, best: bool, earliest: bool = False
    ) -> Origin:
        row = cast("Operator", formula.op)
        bounds = self._bounds(formula) if row.timed else None
        operands = [
            self.signal(arg, self._best_of(formula, i, best=best))
            for i, arg in enumerate(formula.args)
        ]
        if self._ahead:
            self._check_both(formula, place)
        # Future operators without an end read the recorded time.
        endless = row.future and bounds is not None and bounds[1] is None
        last = self._last if endless else self._last + self._ahead
        return origin_of(
            *(row, bounds, operands, last, place), dense=self._dense, earliest=earliest
        )

    def _check_both(self, formula: Formula, place: int) -> None:
        """Raise NoSingleCause if operands of both directions, as in ``iff``, have two bounds."""
        row = cast("Operator", formula.op)
        before = max(0, place - 1) if row.sampled else place
        for i, arg in enumerate(formula.args):
            if i in self._signs(formula):
                continue
            low, high = self.signal(arg, False), self.signal(arg, True)  # noqa: FBT003 - bounds
            if any(low.at(p) != high.at(p) for p in (before, place)):
                raise NoSingleCause

    def nearest(self, share: Share) -> tuple[int, float]:
        """Return where a formula comes nearest to the other sign, and its value there."""
        signal = self.signal(share.formula, share.best)
        places, values = signal.within(share.first, share.last)
        k = FIRST_BEST["min" if share.role == "held" else "max"](values)
        return int(places[k]), float(values[k])

    def shares(self, path: Sequence[OriginStep]) -> Iterator[Share]:
        """Yield the formulas that contribute to a violation in addition to the path.

        A path goes through one operand at one place: the request of a response, and not the grant.
        The violation stays as long as these formulas and the last formula of the path keep their
        signs.
        """
        if holds_by_sign(self.signal(path[0].formula, path[0].best).at(path[0].place)):
            return
        seen = {(path[-1].formula, path[-1].place, path[-1].place)}
        for step in path:
            stack = [(step.formula, part, step.best) for part in self._others(step)]
            stack.reverse()
            while stack:
                parent, part, best = stack.pop()
                formula = cast("Formula", parent.args[part.operand])
                best = self._best_of(parent, part.operand, best=best)
                key = formula, part.first, part.last
                if key in seen or not formula.variables:
                    continue
                seen.add(key)
                row = cast("Operator", formula.op)
                outside = None
                if part.first == part.last and row.operands == "formula":
                    origin = self._origin(formula, part.first, best=best, earliest=True)
                    below = [*flat(origin.parts)]
                    if below:
                        if part.broken and not row.timed:
                            below = [replace(item, broken=True) for item in below]
                        stack += [(formula, item, best) for item in reversed(below)]
                        continue
                    outside = origin.outside
                role: ShareRole = "broken" if part.broken else "missing"
                if holds_by_sign(self.signal(formula, best).at(part.first)):
                    role = "held"
                yield Share(formula, role, part.first, part.last, best, outside)

    def _others(self, step: OriginStep) -> Sequence[Part]:
        """Return the parts of a sign on the path, without the part that the path goes through."""
        origin = step.origin
        if origin.operand is None:
            return ()
        # Parts with the earliest places are few; use them if the path goes through one.
        earliest = self._origin(step.formula, step.place, best=step.best, earliest=True)
        parts = [*flat(earliest.parts)]
        if not any(
            part.operand == origin.operand and part.first <= origin.place <= part.last
            for part in parts
        ):
            parts = [*flat(origin.parts)]
        through = origin.operand, origin.place, origin.place
        return [part for part in parts if (part.operand, part.first, part.last) != through]
