"""A direct implementation of the definitions of STL robustness in dense time.

Every number in a formula's intervals and every time of an event is a multiple of `step`. All
functions of time are therefore constant on the cells [g, g + step) of a grid; the end of the trace
is an instant with its own value. A cell has the value of the definition in its middle. Times and
the step may be fractions, which makes sums of times exact. Shares no code with the library.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction

from oracle import INF, holds, order, predicate

from rtamt.language.node import Node

STEP = 0.5
Time = float | Fraction
Signals = Mapping[str, Sequence[tuple[Time, float]]]


class Definition:
    """Values of formulas over signals.

    Args:
        signals: The events of every variable.
        read: Returns the value of a predicate from the values of its variables.
        step: Divides all times and bounds.
    """

    def __init__(
        self,
        signals: Signals,
        read: Callable[[Node, Mapping[str, float]], float] | None = None,
        step: Time = STEP,
    ) -> None:
        self.read = read or _value_of
        self.step = step
        self.begin = max(events[0][0] for events in signals.values())
        self.end = min(events[-1][0] for events in signals.values())
        assert self.begin <= self.end
        assert all(t % step == 0 for events in signals.values() for t, _ in events)
        cells = int((self.end - self.begin) / step)
        self.cells = [self.begin + step * i for i in range(cells)]
        self.inputs = {
            time: {name: _last(events, time) for name, events in signals.items()}
            for time in (*self.cells, self.end)
        }
        self.value = functools.cache(self._value)

    def breakpoints(self, formula: Node) -> list[tuple[float, float]]:
        """Return the robustness at every change of its value or sign."""
        steps = [(float(time), self.value(formula, time)) for time in (*self.cells, self.end)]
        return steps[:1] + [y for x, y in itertools.pairwise(steps) if order(x[1]) != order(y[1])]

    def _value(self, f: Node, here: Time) -> float:  # noqa: C901 - a table
        """Return the value at the end, or on the cell that starts here."""
        s = here if here == self.end else here + self.step / 2
        assert f.op is not None
        if f.op.operands == "term":
            return self.read(f, self.inputs[here])
        p, q = f.args[0], f.args[-1]
        a, b = _bounds(f, self.step)
        match f.op.name:
            case "not":
                return -self.value(p, here)
            case "and":
                return min((self.value(g, here) for g in f.args), key=order)
            case "or":
                return max((self.value(g, here) for g in f.args), key=order)
            case "implies":
                return max(-self.value(p, here), self.value(q, here), key=order)
            case "iff" | "xor":
                x, y = self.value(p, here), self.value(q, here)
                same = min(max(-x, y, key=order), max(-y, x, key=order), key=order)
                return same if f.op.name == "iff" else -same
            case "always":
                return self._least(p, self._closed(s + a, s + b))
            case "eventually":
                return -self._least(p, self._closed(s + a, s + b), sign=-1)
            case "historically":
                return self._least(p, self._closed(s - b, s - a))
            case "once":
                return -self._least(p, self._closed(s - b, s - a), sign=-1)
            case "until":
                return self._until(p, q, s, a, b)
            case "since":
                return max(
                    (
                        min(self.value(q, place), self._least(p, self._left_open(u, s)), key=order)
                        for u, place in self._witnesses(s - b, s - a)
                    ),
                    default=-INF,
                    key=order,
                )
            case "unless":
                throughout = self._least(p, self._closed(s, s + b))
                return max(throughout, self._until(p, q, s, a, b), key=order)
        raise NotImplementedError(f.op.name)

    def _until(self, p: Node, q: Node, s: Time, a: Time, b: Time) -> float:
        return max(
            (
                min(self.value(q, place), self._least(p, self._right_open(s, u)), key=order)
                for u, place in self._witnesses(s + a, s + b)
            ),
            default=-INF,
            key=order,
        )

    def _least(self, f: Node, places: Iterable[Time], sign: int = 1) -> float:
        return min((sign * self.value(f, place) for place in places), default=INF, key=order)

    def _witnesses(self, x: Time, y: Time) -> list[tuple[Time, Time]]:
        """Return times in [x, y]: starts and middles of cells, and the end; each with its cell."""
        times = [(t, g) for g in self.cells for t in (g, g + self.step / 2)]
        return [(t, g) for t, g in (*times, (self.end, self.end)) if x <= t <= y]

    def _closed(self, x: Time, y: Time) -> list[Time]:
        """Return the cells that overlap [x, y], and the end if it is inside."""
        met = [g for g in self.cells if g <= y and x < g + self.step]
        return met + [self.end] * (x <= self.end <= y)

    def _right_open(self, x: Time, y: Time) -> list[Time]:
        """Return the cells that overlap [x, y)."""
        return [g for g in self.cells if x < y and g < y and x < g + self.step]

    def _left_open(self, x: Time, y: Time) -> list[Time]:
        """Return the cells that overlap (x, y], and the end if it is inside."""
        return self._closed(x, y) if x < y else []


def boolean(signals: Signals) -> Definition:
    """Return the Boolean reading: +inf if a formula holds, otherwise -inf."""
    return Definition(signals, _holds)


def _bounds(f: Node, step: Time) -> tuple[Time, Time]:
    if f.interval is None:
        return 0, INF
    assert f.interval.begin % step == 0 == (f.interval.end or 0) % step
    return f.interval.begin, INF if f.interval.end is None else f.interval.end


def _last(events: Sequence[tuple[Time, float]], time: Time) -> float:
    return [value for t, value in events if t <= time][-1]


def _value_of(f: Node, inputs: Mapping[str, float]) -> float:
    return predicate(f, {name: [value] for name, value in inputs.items()}, 0)[0]


def _holds(f: Node, inputs: Mapping[str, float]) -> float:
    return INF if holds(f, {name: [value] for name, value in inputs.items()}, 0) else -INF
