"""Registers of the episode machine as signals over all times, in plain floats.

`rtamt.machines.episode.machine` explains settled and open values, tails, worlds and unknowns. Times
are sample numbers.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from itertools import accumulate
from typing import ClassVar

from rtamt.machines.protocols import OPEN_WORLDS, World
from rtamt.machines.state import StateFields
from rtamt.machines.windows import slide, suffixes
from rtamt.program.algebra import FOLDS, FUNCTIONS, Element, LatticeFold
from rtamt.program.instructions import Window

INF = math.inf

Unknowns = list[list[float]]
"""The values of all unknowns in each world, which `Stream.look` updates."""

Polynomial = tuple[float, ...]
"""A value that depends on unknowns, given by its values at the corners, where all are -inf or +inf.

Bit i of a corner's number is set where unknown i is +inf. A polynomial in the first k unknowns has
2**k corners, a plain number has one.
"""

lesser, greater = FUNCTIONS["min"].apply, FUNCTIONS["max"].apply


def value_of(polynomial: Polynomial, unknowns: Sequence[float]) -> float:
    """Return the value of a polynomial for given values of the unknowns."""
    for u in unknowns:
        if len(polynomial) == 1:
            break
        corners = zip(polynomial[::2], polynomial[1::2], strict=True)
        polynomial = tuple(greater(low, lesser(high, u)) for low, high in corners)
    return polynomial[0]


def substituted(polynomial: Polynomial, unknown: int, value: Polynomial) -> Polynomial:
    """Return the polynomial with another one in place of an unknown."""
    bit = 1 << unknown
    if len(polynomial) <= bit:
        return polynomial
    values = value * (len(polynomial) // len(value))
    return tuple(
        greater(polynomial[corner & ~bit], lesser(polynomial[corner | bit], u))
        for corner, u in enumerate(values)
    )


class Stream(StateFields):
    """A register that is read at all times.

    Args:
        unknowns: The unknowns of the machine, which all streams share.
        corners: The number of corners of its settled values.
        late: The number of future samples that a value depends on, apart from the unknowns.
        past: The number of times after the last sample whose values depend on samples.

    Attributes:
        keep: The number of settled values that other registers read.
        t: Time of the last sample.
        last: Time of the last settled value, -1 before the first.
        history: The last settled values, a list for each corner.
        open: The values after `last` in each world.
        tail: The value at all later times in each world.
    """

    STATE: ClassVar[tuple[str, ...]] = ("history", "last")

    def __init__(self, unknowns: Unknowns, corners: int, late: int, past: int) -> None:
        self.unknowns = unknowns
        self.corners = corners
        self.late = late
        self.past = past
        self.keep = 1
        self.t = -1
        self.open: list[list[float]] = [[] for _ in World]
        self.tail = [world.unseen for world in World]

    def reset(self) -> None:
        self.last = -1
        self.history: list[list[float]] = [[] for _ in range(self.corners)]

    def settle(self, time: int) -> Polynomial:
        """Return the value of a time, which settles with sample ``time + late``."""
        raise NotImplementedError

    def append(self, value: Polynomial, time: int) -> None:
        """Store the settled value of the next time."""
        for values, number in zip(self.history, value, strict=True):
            values.append(number)
            del values[: -self.keep]
        self.last = time

    def substitute(self, unknown: int, value: Polynomial) -> None:
        """Write an unknown as a polynomial in its value one sample later."""
        if self.last >= 0:
            polynomials = zip(*self.history, strict=True)
            columns = zip(*(substituted(p, unknown, value) for p in polynomials), strict=True)
            self.history = [list(column) for column in columns]

    def look(self, t: int, worlds: Sequence[World] = OPEN_WORLDS) -> None:
        """Compute the open values and the tail in some worlds after sample t."""
        self.t, begin = t, self.last + 1
        for world in worlds:
            end = t if world == World.NOW else t + self.past
            self.open[world], self.tail[world] = self._look(world, begin, end)

    def _look(self, world: World, begin: int, end: int) -> tuple[list[float], float]:
        """Return the values of times begin to end in a world, and the value at all later times."""
        raise NotImplementedError

    def settled(self, time: int) -> Polynomial:
        """Return the settled value of a time."""
        return tuple(values[time - self.last - 1] for values in self.history)

    def at_corner(self, corner: int, begin: int, end: int) -> list[float]:
        """Return the settled values of times begin to end at a corner."""
        values = self.history[corner % self.corners]
        first = self.last + 1 - len(values)
        return values[begin - first : end - first + 1]

    def seen(self, world: World, begin: int, end: int) -> list[float]:
        """Return the values of times begin to end in a world; in ``NOW`` up to the last sample."""
        first = self.last + 1
        values = self.open[world][max(0, begin - first) : max(0, end - first + 1)]
        if begin < first:
            columns = [self.at_corner(c, begin, min(end, self.last)) for c in range(self.corners)]
            settled = columns[0]
            if self.corners > 1:
                unknowns = self.unknowns[world]
                settled = [value_of(p, unknowns) for p in zip(*columns, strict=True)]
            values = settled + values
        return values + [self.tail[world]] * (end - begin + 1 - len(values))


class Leaf(Stream):
    """A predicate, which is unknown at unseen samples, or a constant, which is not.

    Attributes:
        now: The value at the present sample.
    """

    def __init__(self, unknowns: Unknowns, constant: float | None = None) -> None:
        super().__init__(unknowns, 1, 0, 0)
        self.now = math.nan
        if constant is not None:
            self.tail = [constant] * len(World)

    def settle(self, time: int) -> Polynomial:  # noqa: ARG002 - it is the present
        return (self.now,)

    def look(self, t: int, worlds: Sequence[World] = OPEN_WORLDS) -> None:
        """Do nothing: no value is open, and the tail stays."""


class Operands:
    """Operands of a window, read as elements of its lattice fold."""

    def __init__(self, fold: LatticeFold, streams: Sequence[Stream]) -> None:
        self.fold = fold
        self.streams = streams
        self.unknowns = streams[0].unknowns
        self.corners = max(s.corners for s in streams)
        self.late = max(s.late for s in streams)
        self.past = max(s.past for s in streams)

    def hold(self, late: int, oldest: int) -> None:
        """Make the operands keep their values from time t - late + oldest on."""
        for s in self.streams:
            s.keep = max(s.keep, late - s.late - oldest + 1)

    def settled(self, time: int, corners: int) -> list[Element]:
        """Return the settled element of a time at each of so many corners."""
        polynomials = (s.settled(time) for s in self.streams)
        return list(zip(*(p * (corners // len(p)) for p in polynomials), strict=True))

    def at_corner(self, corner: int, begin: int, end: int) -> list[Element]:
        """Return the settled elements of times begin to end at a corner; none before time 0."""
        begin, end = max(0, begin), max(-1, end)
        numbers = (s.at_corner(corner, begin, end) for s in self.streams)
        return list(zip(*numbers, strict=True))

    def seen(self, world: World, begin: int, end: int) -> list[Element]:
        """Return the elements of times begin to end in a world; identities before time 0."""
        early = min(0, end + 1) - begin
        if early > 0:
            return [self.fold.identity] * early + self.seen(world, begin + early, end)
        numbers = [s.seen(world, begin, end) for s in self.streams]
        return list(zip(*numbers, strict=True))

    def tail(self, world: World) -> Element:
        """Return the element of all times after the open ones."""
        if world == World.NOW:
            return self.fold.identity
        return tuple(s.tail[world] for s in self.streams)


class _Fold(Stream):
    """A fold of operands.

    Args:
        operands: The operands.
        lo: The first offset whose settled elements are read.
        hi: The last offset.
        corners: The number of corners of its settled values, by default as the operands.
    """

    def __init__(self, operands: Operands, lo: int, hi: int, corners: int | None = None) -> None:
        late, past = max(0, operands.late + hi), max(0, operands.past - lo)
        super().__init__(operands.unknowns, corners or operands.corners, late, past)
        self._operands = operands
        self._fold = operands.fold
        self._lo, self._hi = lo, hi
        operands.hold(late, lo)


class Pointwise(_Fold):
    """The minimum or maximum of two operands at each time."""

    def __init__(self, function: str, streams: Sequence[Stream]) -> None:
        super().__init__(Operands(FOLDS[function], streams), 0, 0)
        self._choose = FUNCTIONS[function].apply

    def settle(self, time: int) -> Polynomial:
        pairs = self._operands.settled(time, self.corners)
        return tuple(self._choose(x, y) for x, y in pairs)

    def _look(self, world: World, begin: int, end: int) -> tuple[list[float], float]:
        p, q = self._operands.streams
        values: list[float] = []
        if begin <= end:
            values = [*map(self._choose, p.seen(world, begin, end), q.seen(world, begin, end))]
        return values, self._choose(p.tail[world], q.tail[world])


class RunningFold(StateFields):
    """The fold of all elements so far, at each corner."""

    STATE: ClassVar[tuple[str, ...]] = ("_elements",)

    def __init__(self, operands: Operands) -> None:
        self._operands = operands
        self._combine = operands.fold.combine

    def reset(self) -> None:
        self._elements: list[Element] = [self._operands.fold.identity] * self._operands.corners

    def push(self, time: int) -> None:
        """Fold in the settled element of the next time."""
        newest = self._operands.settled(time, self._operands.corners)
        self._elements = [*map(self._combine, self._elements, newest)]

    @property
    def value(self) -> Polynomial:
        """The last number of the fold."""
        return tuple(element[-1] for element in self._elements)

    def seen(self, world: World) -> Element:
        """Return the fold in a world."""
        unknowns = self._operands.unknowns[world]
        return tuple(value_of(p, unknowns) for p in zip(*self._elements, strict=True))

    def substitute(self, unknown: int, value: Polynomial) -> None:
        """Write an unknown as a polynomial in its value one sample later."""
        polynomials = zip(*self._elements, strict=True)
        numbers = [substituted(p, unknown, value) for p in polynomials]
        self._elements = list(zip(*numbers, strict=True))


class UnboundedPast(_Fold):
    """The fold over all offsets up to hi, which is not after now."""

    STATE = (*_Fold.STATE, "_total")

    def __init__(self, window: Window, streams: Sequence[Stream]) -> None:
        newest = window.hi or 0
        super().__init__(Operands(FOLDS[window.fold], streams), newest, newest)
        self._total = RunningFold(self._operands)

    def reset(self) -> None:
        super().reset()
        self._total.reset()

    def settle(self, time: int) -> Polynomial:
        if time + self._hi >= 0:
            self._total.push(time + self._hi)
        return self._total.value

    def _look(self, world: World, begin: int, end: int) -> tuple[list[float], float]:
        combine = self._fold.combine
        elements = self._operands.seen(world, begin + self._hi, end + self._hi)
        folds = [*accumulate(elements, combine, initial=self._total.seen(world))]
        tail = combine(folds[-1], self._operands.tail(world))
        return [fold[-1] for fold in folds[1:]], tail[-1]

    def substitute(self, unknown: int, value: Polynomial) -> None:
        super().substitute(unknown, value)
        self._total.substitute(unknown, value)


class _Window(_Fold):
    """The fold over a window with a begin."""

    def __init__(
        self, window: Window, operands: Operands, hi: int, corners: int | None = None
    ) -> None:
        super().__init__(operands, window.lo or 0, hi, corners)
        self._ends = [world.ends(window) for world in World]
        # In a cut trace, this number of last recorded times has the values of an open one.
        self._unread: int | None = None
        if window.endless or window.hi is None:
            self._unread = window.begin if window.endless else 0

    def _look(self, world: World, begin: int, end: int) -> tuple[list[float], float]:
        if world.cut and self._unread is not None:
            first = max(begin, self.t + 1 - self._unread)
            after, tail = self.open[world.opened][first - begin :], self.tail[world.opened]
        elif self._ends[world] and world != World.NOW:
            first = max(begin, self.t + 1)
            after, tail = self._alone(world, first, end)
        else:
            first, after, tail = end + 1, [], self._operands.tail(world)[-1]
        return self._folds(world, begin, first - 1) + after, tail

    def _alone(self, world: World, begin: int, end: int) -> tuple[list[float], float]:
        """Return the values of unseen times and the tail where unseen elements are skipped."""
        if self._lo == 0:
            operand = self._operands.streams[-1]
            return operand.seen(world, begin, end), operand.tail[world]
        nothing = self._fold.identity[-1]
        return [nothing] * (end - begin + 1), nothing

    def _folds(self, world: World, begin: int, end: int) -> list[float]:
        """Return the folds of times begin to end."""
        raise NotImplementedError


class Sliding(_Window):
    """The fold over offsets lo to hi."""

    def __init__(self, window: Window, streams: Sequence[Stream]) -> None:
        super().__init__(window, Operands(FOLDS[window.fold], streams), window.hi or 0)

    def settle(self, time: int) -> Polynomial:
        fold, operands = self._fold, self._operands
        begin, end = time + self._lo, time + self._hi
        corners = (operands.at_corner(c, begin, end) for c in range(self.corners))
        return tuple(functools.reduce(fold.combine, x, fold.identity)[-1] for x in corners)

    def _folds(self, world: World, begin: int, end: int) -> list[float]:
        if begin > end:
            return []
        operands = self._operands
        last = min(end + self._hi, self.t if self._ends[world] else self.t + operands.past)
        elements = operands.seen(world, begin + self._lo, last)
        remainder = self._fold.identity if self._ends[world] else operands.tail(world)
        return slide(self._fold, elements, remainder, self._hi - self._lo + 1, end - begin + 1)


class UnboundedFuture(_Window):
    """The fold over all offsets from 0 on, which settles as a polynomial in its unknown.

    Attributes:
        unknown: The number of its unknown, the value at the first open time.
    """

    def __init__(self, window: Window, unknown: int, streams: Sequence[Stream]) -> None:
        super().__init__(window, Operands(FOLDS[window.fold], streams), 0, 2 << unknown)
        self.unknown = unknown

    def settle(self, time: int) -> Polynomial:
        combine, nothing = self._fold.combine, self._fold.identity[:-1]
        newest = self._operands.settled(time, self.corners)
        return tuple(
            combine(element, (*nothing, INF if corner >> self.unknown else -INF))[-1]
            for corner, element in enumerate(newest)
        )

    def _folds(self, world: World, begin: int, end: int) -> list[float]:
        remainder = self._fold.identity if self._ends[world] else self._operands.tail(world)
        folds = suffixes(self._fold, self._operands.seen(world, begin, end), remainder)
        self.unknowns[world][self.unknown] = folds[0][-1]
        return [fold[-1] for fold in folds[:-1]]
