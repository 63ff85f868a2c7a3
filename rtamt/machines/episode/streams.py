"""Registers of the episode machine as signals over all times.

`rtamt.machines.episode.machine` explains settled and open values, tails, worlds and unknowns. Times
are sample numbers; the last axis of an array is time, and settled arrays have an axis of length 2
for each unknown in front.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rtamt.machines.state import StateFields
from rtamt.machines.terms import Registers
from rtamt.machines.windows import fold_all, padded, slide
from rtamt.program.algebra import FOLDS, Arrays, LatticeFold, greater, lesser
from rtamt.program.instructions import Window

__all__ = [
    "CUT",
    "LOWER",
    "NOW",
    "OPEN",
    "UPPER",
    "WORLDS",
    "Array",
    "Constant",
    "Operands",
    "Pointwise",
    "Polynomials",
    "Predicate",
    "Sliding",
    "Stream",
    "UnboundedFuture",
    "UnboundedPast",
    "in_world",
    "skips",
]

Array = NDArray[np.float64]

INF = math.inf
NOW, LOWER, UPPER = WORLDS = range(3)
CUT = CUT_LOWER, CUT_UPPER = range(3, 5)
"""The worlds of a trace that was cut, which are found when it ends."""
OPEN = {CUT_LOWER: LOWER, CUT_UPPER: UPPER}
"""The world of the open reading whose values a future without end has where nothing was recorded.
"""
_NOTHING: Array = np.zeros(0)


def in_world(settled: Array, unknowns: Array) -> Array:
    """The settled values for given values of the unknowns."""
    for u in unknowns:
        settled = greater(settled[0], lesser(settled[1], u))
    return settled


def skips(window: Window, world: int) -> bool:
    """Whether unseen elements count nothing in a world, but for the one of the window's time."""
    return world in {LOWER, UPPER} and window.skips(best=world == UPPER)


class Polynomials(StateFields):
    """Arrays of settled values."""

    STATE: ClassVar[tuple[str, ...]] = ("kept",)

    def __init__(self, nothing: Arrays) -> None:
        self.kept = self._nothing = nothing

    def reset(self) -> None:
        self.kept = self._nothing

    def substitute(self, axis: int, value: Array) -> None:
        """Write an unknown as a polynomial in what it is one sample later."""
        self.kept = tuple(
            greater(a.take([0], axis), lesser(a.take([1], axis), value[..., None]))
            for a in self.kept
        )


class Stream(Polynomials):
    """A register that is read at all times.

    Attributes:
        corners: The shape in front of settled values, a 2 for each unknown.
        late: How many samples of the future a value depends on, apart from the unknowns.
        past: For how many times after the last sample a value depends on samples.
        keep: How many settled values other registers read.
        last: Time of the last settled value, -1 before there is one.
    """

    STATE: ClassVar[tuple[str, ...]] = ("kept", "last")

    def __init__(self, corners: tuple[int, ...], late: int, past: int) -> None:
        super().__init__((np.zeros((*corners, 0)),))
        self.corners = corners
        self.late = late
        self.past = past
        self.keep = 1
        self.last = -1
        # For every world; `look` finds them anew after every sample.
        self.open = [_NOTHING] * 5
        self.tail = [math.nan, -INF, INF, -INF, INF]

    def reset(self) -> None:
        super().reset()
        self.last = -1

    def settle(self, t: int) -> Array | None:
        """The value at time t - late, which settles with sample t; None before time 0."""
        return None if t < self.late else self._settled(t - self.late)

    def _settled(self, time: int) -> Array:
        """The value of a time, which settles with sample ``time + late``."""
        raise NotImplementedError

    def look(self, t: int, unknowns: Array, worlds: Sequence[int] = WORLDS) -> None:
        """Find the open values and the tail of some worlds after sample t."""

    def append(self, value: Array, t: int) -> None:
        """Keep the value that settled with sample t."""
        (history,) = self.kept
        start = max(0, history.shape[-1] + 1 - self.keep)
        self.kept = (np.concatenate([history[..., start:], value[..., None]], axis=-1),)
        self.last = t - self.late

    def settled(self, begin: int, end: int) -> Array:
        """The settled values of times begin to end."""
        (history,) = self.kept
        first = self.last + 1 - history.shape[-1]
        return history[..., begin - first : end - first + 1]

    def seen(self, world: int, begin: int, end: int, unknowns: Array) -> Array:
        """The values of times begin to end in a world; in ``NOW`` the last must not be after t."""
        parts = []
        if begin <= self.last:
            known = self.settled(begin, min(end, self.last))
            parts.append(in_world(known, unknowns[world]))
        open_from = self.last + 1
        here = self.open[world]
        parts.append(here[max(0, begin - open_from) : max(0, end - open_from + 1)])
        beyond = end - max(begin - 1, self.last + len(here))
        if beyond > 0:
            parts.append(np.full(beyond, self.tail[world]))
        return np.concatenate(parts)


class Predicate(Stream):
    """A term read as a formula: it settles at once, and is unknown at every unseen sample."""

    def __init__(self, corners: tuple[int, ...], register: int) -> None:
        super().__init__(corners, 0, 0)
        self._register = register
        self._now = math.nan

    def take(self, terms: Registers) -> None:
        """Take in the present sample."""
        self._now = terms[self._register]

    def _settled(self, time: int) -> Array:  # noqa: ARG002 - it is always the present
        return np.full(self.corners, self._now)


class Constant(Stream):
    """One value at every time, seen or not."""

    def __init__(self, corners: tuple[int, ...], value: float) -> None:
        super().__init__(corners, 0, 0)
        self._value = value
        self.tail = [value] * 5

    def _settled(self, time: int) -> Array:  # noqa: ARG002 - the same at every time
        return np.full(self.corners, self._value)


class Operands:
    """Operands of a window, read as elements of its lattice fold."""

    def __init__(self, fold: LatticeFold, streams: Sequence[Stream]) -> None:
        self.fold = fold
        self.streams = streams
        self.corners = streams[0].corners
        self.late = max(s.late for s in streams)
        self.past = max(s.past for s in streams)

    def hold(self, late: int, oldest: int) -> None:
        """Make the operands keep their values from time t - late + oldest on."""
        for s in self.streams:
            s.keep = max(s.keep, late - s.late - oldest + 1)

    def identities(self, *shape: int) -> Arrays:
        """Elements that are the identity of the fold."""
        return tuple(np.full(shape, e) for e in self.fold.identity)

    def settled(self, begin: int, end: int) -> Arrays:
        """The settled elements of times begin to end; identities before time 0."""
        first = max(0, begin)
        if first > end:
            return self.identities(*self.corners, end - begin + 1)
        elements = tuple(s.settled(first, end) for s in self.streams)
        return padded(self.fold, elements, first - begin, 0)

    def seen(
        self, world: int, begin: int, end: int, unknowns: Array, last: int | None = None
    ) -> Arrays:
        """The elements of times begin to end in a world; identities outside 0 to ``last``."""
        first = max(0, begin)
        last = end if last is None else min(end, last)
        if first > last:
            return self.identities(end - begin + 1)
        elements = tuple(s.seen(world, first, last, unknowns) for s in self.streams)
        return padded(self.fold, elements, first - begin, end - last)

    def tail(self, world: int) -> Arrays:
        """The element of all times after the open ones."""
        if world == NOW:
            return self.identities(1)
        return tuple(np.array([s.tail[world]]) for s in self.streams)


class _Windowed(Stream):
    """The folds of a window at every time."""

    def __init__(self, window: Window, operands: Operands, late: int, past: int) -> None:
        super().__init__(operands.corners, late, past)
        self.window = window
        self.operands = operands
        self.fold = operands.fold

    def look(self, t: int, unknowns: Array, worlds: Sequence[int] = WORLDS) -> None:
        begin = self.last + 1
        for world in worlds:
            count = max(0, (t if world == NOW else t + self.past) - begin + 1)
            values = self._open(world, begin, count, t, unknowns)
            # Of times from this one on the values are others.
            own = t + 1 - (self.window.begin if world in CUT and self.window.endless else 0)
            own = max(begin, own)
            if skips(self.window, world):
                values, self.tail[world] = self._alone(world, values, begin, own, unknowns)
            elif world in CUT and (self.window.endless or self.window.hi is None):
                rest = self.open[OPEN[world]][own - begin :]
                values = np.concatenate([values[: own - begin], rest])
                self.tail[world] = self.tail[OPEN[world]]
            self.open[world] = values

    def _alone(
        self, world: int, values: Array, begin: int, own: int, unknowns: Array
    ) -> tuple[Array, float]:
        """The values and the tail if from a time on each window has its own element alone."""
        if self.window.lo != 0:
            nothing = self.fold.identity[-1]
            rest = np.full(len(values[own - begin :]), nothing)
            return np.concatenate([values[: own - begin], rest]), nothing
        last = self.operands.streams[-1]
        end = begin + len(values) - 1
        rest = last.seen(world, own, end, unknowns) if own <= end else _NOTHING
        return np.concatenate([values[: own - begin], rest]), last.tail[world]

    def _last(self, world: int, t: int) -> int | None:
        """The last time whose elements count in a world; None: all of them."""
        return t if world == NOW or skips(self.window, world) else None

    def _open(self, world: int, begin: int, count: int, t: int, unknowns: Array) -> Array:
        """The values of ``count`` times from begin on; sets the tail."""
        raise NotImplementedError


class Sliding(_Windowed):
    """The fold over offsets lo to hi."""

    def __init__(self, window: Window, streams: Sequence[Stream]) -> None:
        self._lo, self._hi = lo, hi = window.lo or 0, window.hi or 0
        operands = Operands(FOLDS[window.fold], streams)
        super().__init__(window, operands, max(0, operands.late + hi), max(0, operands.past - lo))
        operands.hold(self.late, lo)

    def _settled(self, time: int) -> Array:
        elements = self.operands.settled(time + self._lo, time + self._hi)
        return fold_all(self.fold, elements)[-1][..., 0]

    def _open(self, world: int, begin: int, count: int, t: int, unknowns: Array) -> Array:
        tail = self.operands.tail(world)
        self.tail[world] = self.fold.combine_arrays(tail, tail)[-1].item()
        if count == 0:
            return _NOTHING
        end = begin + count - 1 + self._hi
        last = self._last(world, t)
        elements = self.operands.seen(world, begin + self._lo, end, unknowns, last)
        return slide(self.fold, elements, self._hi - self._lo + 1)[-1]


class Pointwise(Sliding):
    """The least or greatest of the operands at one time."""

    def __init__(self, fold: str, streams: Sequence[Stream]) -> None:
        super().__init__(Window(fold, 0, 0, ()), streams)

    def _settled(self, time: int) -> Array:
        return self._across([s.settled(time, time)[..., 0] for s in self.operands.streams])

    def _open(
        self,
        world: int,
        begin: int,
        count: int,
        t: int,  # noqa: ARG002 - the operands know where the trace ends
        unknowns: Array,
    ) -> Array:
        streams = self.operands.streams
        self.tail[world] = self._across([np.array(s.tail[world]) for s in streams]).item()
        if count == 0:
            return _NOTHING
        return self._across([s.seen(world, begin, begin + count - 1, unknowns) for s in streams])

    def _across(self, values: list[Array]) -> Array:
        first, *rest = values
        for value in rest:
            (first,) = self.fold.combine_arrays((first,), (value,))
        return first


class UnboundedPast(_Windowed):
    """The fold over all offsets up to hi."""

    STATE = (*_Windowed.STATE, "_total")

    def __init__(self, window: Window, streams: Sequence[Stream]) -> None:
        self._hi = hi = window.hi or 0
        operands = Operands(FOLDS[window.fold], streams)
        super().__init__(window, operands, max(0, operands.late + hi), operands.past - hi)
        operands.hold(self.late, hi)
        self._total = Polynomials(operands.identities(*operands.corners, 1))

    def reset(self) -> None:
        super().reset()
        self._total.reset()

    def _settled(self, time: int) -> Array:
        newest = self.operands.settled(time + self._hi, time + self._hi)
        self._total.kept = self.fold.combine_arrays(self._total.kept, newest)
        return self._total.kept[-1][..., 0]

    def _open(self, world: int, begin: int, count: int, t: int, unknowns: Array) -> Array:
        combine = self.fold.combine_arrays
        total = tuple(in_world(a, unknowns[world]) for a in self._total.kept)
        end = begin + count - 1 + self._hi
        elements = self.operands.seen(world, begin + self._hi, end, unknowns, self._last(world, t))
        elements = tuple(np.concatenate(pair) for pair in zip(total, elements, strict=True))
        prefixes = slide(self.fold, padded(self.fold, elements, count, 0), count + 1)
        last = tuple(a[-1:] for a in prefixes)
        self.tail[world] = combine(last, self.operands.tail(world))[-1].item()
        return prefixes[-1][1:]

    def substitute(self, axis: int, value: Array) -> None:
        super().substitute(axis, value)
        self._total.substitute(axis, value)


class UnboundedFuture(_Windowed):
    """The fold over all offsets from 0 on, which settles as a polynomial in its unknown.

    Attributes:
        axis: The axis of its unknown, the value at the first open time.
    """

    def __init__(self, window: Window, axis: int, streams: Sequence[Stream]) -> None:
        operands = Operands(FOLDS[window.fold], streams)
        super().__init__(window, operands, operands.late, operands.past)
        operands.hold(self.late, 0)
        self.axis = axis

    def _settled(self, time: int) -> Array:
        newest = tuple(a[..., 0] for a in self.operands.settled(time, time))
        shape = [1] * newest[0].ndim
        shape[self.axis] = 2
        unknown = np.array([-INF, INF]).reshape(shape)
        rest = (*(np.full_like(unknown, e) for e in self.fold.identity[:-1]), unknown)
        return np.broadcast_to(self.fold.combine_arrays(newest, rest)[-1], newest[0].shape)

    def _open(self, world: int, begin: int, count: int, t: int, unknowns: Array) -> Array:
        tail = self.operands.tail(world)
        unseen = 0
        if world in CUT or skips(self.window, world):  # what follows is found by `look`
            tail, unseen = self.operands.identities(1), begin + count - 1 - t
        else:
            self.tail[world] = self.fold.combine_arrays(tail, tail)[-1].item()
        count -= unseen
        elements = self.operands.seen(world, begin, begin + count - 1, unknowns)
        elements = tuple(np.concatenate(pair) for pair in zip(elements, tail, strict=True))
        suffixes = slide(self.fold, padded(self.fold, elements, 0, count), count + 1)[-1]
        unknowns[world, self.axis] = suffixes[0]
        return np.append(suffixes[:count], [math.nan] * unseen)
