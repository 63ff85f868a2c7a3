"""Registers over the regions of dense time, as runs: settled values, and open ones in each world.

`rtamt.machines.episode.machine` explains settled and open values, worlds and unknowns, and
`rtamt.program.dense_lowering` positions. Here open values have no end: the last run lasts for ever.
A trace may end at any time, now included. After the last position t nothing exists in ``NOW``. A
future fold reads only the seen positions, and its own, in ``LOWER`` if it is a maximum and
in ``UPPER`` if it is a minimum. A trace that was cut goes on: bounded windows read everything, and
those without an end read the recorded part or, if nothing of their window was recorded, have the
values of ``LOWER`` and ``UPPER``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.arrays import Floats
from rtamt.machines.dense.runs import (
    Runs,
    clipped,
    concatenated,
    identities,
    joint,
    paired,
    scanned,
    slid,
    suffixes,
)
from rtamt.machines.protocols import World
from rtamt.machines.state import StateFields
from rtamt.machines.windows import fold_all
from rtamt.program.algebra import FOLDS, Arrays, LatticeFold, greater, lesser
from rtamt.program.instructions import Window

INF = math.inf


def in_world(settled: Floats, unknowns: Floats) -> Floats:
    """Return the settled values for given values of the unknowns."""
    for u in unknowns:
        settled = greater(settled[0], lesser(settled[1], u))
    return settled


def substituted(values: Arrays, axis: int, value: Floats) -> Arrays:
    """Return polynomials in an unknown as polynomials in its later value."""
    return tuple(
        greater(a.take([0], axis), lesser(a.take([1], axis), value[..., None])) for a in values
    )


def constant(value: float, start: int, corners: tuple[int, ...] = ()) -> Runs:
    return Runs(np.array([start]), (np.full((*corners, 1), value),))


class RegionStream(StateFields):
    """A register that is read at all positions.

    Attributes:
        late: The number of future positions that a value depends on, apart from the unknowns.
        keep: The number of settled positions that other registers read again.
        last: The last settled position, -1 before there is one.
        open: For every world the runs after that, which `look` computes.
    """

    STATE: ClassVar[tuple[str, ...]] = ("kept", "last")

    def __init__(self, corners: tuple[int, ...], late: int) -> None:
        self.corners = corners
        self.late = late
        self.keep = 1
        self.open = [Runs(np.zeros(0, np.int64), (np.zeros(0),))] * len(World)
        self.reset()

    def reset(self) -> None:
        self.last = -1
        self.kept: Runs = Runs(np.zeros(0, np.int64), (np.zeros((*self.corners, 0)),))

    def settle(self, t: int) -> Runs | None:
        """Return the runs that settle with position t, in terms of unknowns of that time."""
        end = t - self.late
        return self._settled(self.last + 1, end) if end > self.last else None

    def _settled(self, begin: int, end: int) -> Runs:
        raise NotImplementedError

    def append(self, runs: Runs, t: int) -> None:
        """Store the runs that settled with position t."""
        self.kept = concatenated(self.kept, runs).merged()
        self.last = t - self.late

    def trim(self) -> None:
        """Forget values that no other register reads again."""
        first = int(self.kept.starts.searchsorted(self.last + 1 - self.keep, "right")) - 1
        if first > 0:
            values = tuple(a[..., first:].copy() for a in self.kept.values)
            self.kept = Runs(self.kept.starts[first:].copy(), values)

    def substitute(self, axis: int, value: Floats) -> None:
        """Write an unknown as a polynomial in its later value."""
        self.kept = Runs(self.kept.starts, substituted(self.kept.values, axis, value))

    def look(self, world: World, t: int, unknowns: Floats) -> None:
        """Compute the open values of a world after position t."""
        self.open[world] = self._look(world, self.last + 1, t, unknowns).merged()

    def _look(self, world: World, begin: int, t: int, unknowns: Floats) -> Runs:
        raise NotImplementedError

    def settled(self, begin: int, end: int) -> Runs:
        """Return the settled runs of positions begin to end."""
        return clipped(self.kept, begin, end)

    def seen(self, world: World, begin: int, unknowns: Floats) -> Runs:
        """Return the runs of a world from a position on."""
        if begin > self.last:
            return clipped(self.open[world], begin)
        known = clipped(self.kept, begin)
        known = Runs(known.starts, (in_world(known.last, unknowns[world]),))
        return concatenated(known, self.open[world])


class RegionPredicate(RegionStream):
    """A term read as a formula: it settles at once, and is unknown at unseen positions."""

    def __init__(self, corners: tuple[int, ...]) -> None:
        super().__init__(corners, 0)
        self.new = self.kept

    def take(self, starts: NDArray[np.int64], values: Floats) -> None:
        """Take the runs that will settle next; the last previous one goes on."""
        begin = self.last + 1
        if not len(starts) or starts[0] > begin:
            before = clipped(self.kept, self.last).last[..., -1]
            going_on = Runs(np.array([begin]), (before[..., None],))
            if not len(starts):
                self.new = going_on
                return
        else:
            going_on = Runs(starts[:0], (np.zeros((*self.corners, 0)),))
        spread = np.broadcast_to(values, (*self.corners, len(values)))
        self.new = concatenated(going_on, Runs(starts, (np.ascontiguousarray(spread),)))

    def _settled(self, begin: int, end: int) -> Runs:
        return clipped(self.new, begin, end)

    def _look(self, world: World, begin: int, t: int, unknowns: Floats) -> Runs:  # noqa: ARG002
        return constant(world.unseen, begin)


class RegionConstant(RegionStream):
    """One value at every position, seen or not."""

    def __init__(self, corners: tuple[int, ...], value: float) -> None:
        super().__init__(corners, 0)
        self._value = value

    def _settled(self, begin: int, end: int) -> Runs:  # noqa: ARG002 - the same everywhere
        return constant(self._value, begin, self.corners)

    def _look(self, world: World, begin: int, t: int, unknowns: Floats) -> Runs:  # noqa: ARG002
        return constant(self._value, begin)


class RegionPointwise(RegionStream):
    """The minimum or maximum of the operands at one position."""

    def __init__(self, fold: LatticeFold, streams: Sequence[RegionStream]) -> None:
        late = max(s.late for s in streams)
        super().__init__(streams[0].corners, late)
        self._fold, self._streams = fold, streams
        for s in streams:
            s.keep = max(s.keep, late - s.late)

    def _across(self, runs: Runs) -> Runs:
        first, *others = runs.values
        total: Arrays = (first,)
        for value in others:
            total = self._fold.combine_arrays(total, (value,))
        return Runs(runs.starts, total)

    def _settled(self, begin: int, end: int) -> Runs:
        return self._across(joint([s.settled(begin, end) for s in self._streams]))

    def _look(self, world: World, begin: int, t: int, unknowns: Floats) -> Runs:  # noqa: ARG002
        return self._across(joint([s.seen(world, begin, unknowns) for s in self._streams]))


def _stops(window: Window, world: World) -> bool:
    """Return whether a fold reads nothing after the last position except its own."""
    return not world.cut and window.ahead and world.ends(window)


class RegionOperands:
    """Operands of a window, read as elements of its fold."""

    def __init__(self, fold: LatticeFold, streams: Sequence[RegionStream]) -> None:
        self.fold = fold
        self.streams = streams
        self.corners = streams[0].corners
        self.late = max(s.late for s in streams)

    def hold(self, late: int, oldest: int) -> None:
        """Make the operands keep their values from position t - late + oldest + 1 on."""
        for s in self.streams:
            s.keep = max(s.keep, late - s.late - oldest)

    def settled(self, begin: int, end: int) -> Runs:
        """Return the settled elements of positions begin to end, from 0 on."""
        first = max(0, begin)
        if first > end:
            return identities(self.fold, self.corners, begin)
        runs = joint([s.settled(first, end) for s in self.streams])
        return paired(self.fold.name, runs, end)

    def seen(self, world: World, begin: int, unknowns: Floats) -> Runs:
        """Return the elements of a world from a position on."""
        runs = joint([s.seen(world, max(0, begin), unknowns) for s in self.streams])
        return paired(self.fold.name, runs, None)

    def own(self, lo: int, elements: Runs, t: int, begin: int) -> Runs:
        """Return the values of a fold at unseen positions: its own operand, or the identity."""
        begin = max(begin, t + 1)
        if lo == 0:
            later = clipped(elements, begin)
            return Runs(later.starts, later.values[-1:])
        return constant(self.fold.identity[-1], begin)


class RegionSliding(RegionStream):
    """The fold over offsets lo to hi."""

    def __init__(self, window: Window, lo: int, hi: int, streams: Sequence[RegionStream]) -> None:
        self._window, self._fold = window, FOLDS[window.fold]
        self._operands = RegionOperands(self._fold, streams)
        late = max(0, self._operands.late + hi)
        super().__init__(self._operands.corners, late)
        self._operands.hold(late, lo)
        self._lo, self._hi = lo, hi

    def _settled(self, begin: int, end: int) -> Runs:
        elements = self._operands.settled(begin + self._lo, end + self._hi)
        return slid(self._fold, elements, self._lo, self._hi, begin, end)

    def _look(self, world: World, begin: int, t: int, unknowns: Floats) -> Runs:
        lo, hi = self._lo, self._hi
        elements = self._operands.seen(world, begin + lo, unknowns)
        if _stops(self._window, world):
            later = self._operands.own(lo, elements, t, begin)
            if begin > t:
                return later
            known = concatenated(
                clipped(elements, begin + lo, t), identities(self._fold, (), max(t + 1, begin + lo))
            )
            return concatenated(slid(self._fold, known, lo, hi, begin, t), later)
        if self._window.endless and world.cut:
            recorded = t - self._window.begin
            later = clipped(self.open[world.opened], max(begin, recorded + 1))
            if begin > recorded:
                return later
            return concatenated(slid(self._fold, elements, lo, hi, begin, recorded), later)
        return slid(self._fold, elements, lo, hi, begin, None)


class RegionPast(RegionStream):
    """The fold over all offsets up to hi."""

    STATE = (*RegionStream.STATE, "_total")

    def __init__(self, window: Window, hi: int, streams: Sequence[RegionStream]) -> None:
        self._fold, self._hi = FOLDS[window.fold], hi
        self._operands = RegionOperands(self._fold, streams)
        late = max(0, self._operands.late + hi)
        super().__init__(self._operands.corners, late)
        self._operands.hold(late, hi)

    def reset(self) -> None:
        super().reset()
        self._total = identities(self._fold, self.corners, 0).values

    def _settled(self, begin: int, end: int) -> Runs:
        elements = self._operands.settled(begin + self._hi, end + self._hi)
        starts, values = self._scanned(self._total, elements, begin)
        self._total = tuple(a[..., -1:] for a in values)
        return clipped(Runs(starts, values[-1:]), begin)

    def _look(self, world: World, begin: int, t: int, unknowns: Floats) -> Runs:  # noqa: ARG002
        total = tuple(in_world(a, unknowns[world]) for a in self._total)
        elements = self._operands.seen(world, begin + self._hi, unknowns)
        starts, values = self._scanned(total, elements, begin)
        return clipped(Runs(starts, values[-1:]), begin)

    def _scanned(self, total: Arrays, elements: Runs, begin: int) -> Runs:
        both = zip(total, elements.values, strict=True)
        values = tuple(np.concatenate(pair, axis=-1) for pair in both)
        starts = np.append(np.array([begin]), elements.starts - self._hi)
        return Runs(starts, scanned(self._fold, values))

    def substitute(self, axis: int, value: Floats) -> None:
        super().substitute(axis, value)
        self._total = substituted(self._total, axis, value)


class RegionFuture(RegionStream):
    """The fold over all offsets from 0 on, which settles as a polynomial in its unknown.

    Attributes:
        axis: The axis of its unknown, the value at the first open position; None if it never
            settles.
    """

    def __init__(self, window: Window, axis: int | None, streams: Sequence[RegionStream]) -> None:
        self._window, self._fold = window, FOLDS[window.fold]
        self._operands = RegionOperands(self._fold, streams)
        super().__init__(self._operands.corners, self._operands.late)
        self._operands.hold(self.late, 0)
        self.axis = axis

    def _settled(self, begin: int, end: int) -> Runs:
        starts, elements = self._operands.settled(begin, end)
        shape = [1] * elements[0].ndim
        shape[self.axis or 0] = 2
        u = np.broadcast_to(np.array([-INF, INF]).reshape(shape), (*self.corners, 1))
        remainder = (*(np.full_like(u, e) for e in self._fold.identity[:-1]), u)
        both = tuple(
            np.concatenate([a, b], axis=-1) for a, b in zip(elements, remainder, strict=True)
        )
        return Runs(starts, (suffixes(self._fold, both)[-1][..., :-1].copy(),))

    def _look(self, world: World, begin: int, t: int, unknowns: Floats) -> Runs:
        elements = self._operands.seen(world, begin, unknowns)
        if world.cut:
            later = clipped(self.open[world.opened], max(begin, t + 1))
        elif _stops(self._window, world):
            later = self._operands.own(0, elements, t, begin)
        else:
            later, t = Runs(elements.starts[:0], (elements.last[:0],)), int(elements.starts[-1])
        if begin > t:
            # Settled positions read nothing of it, but a later position reads itself.
            if self.axis is not None:
                unknowns[world, self.axis] = self._fold.identity[-1]
            return later
        recorded = clipped(elements, begin, t)
        folds = Runs(recorded.starts, suffixes(self._fold, recorded.values)[-1:])
        if self.axis is not None:
            unknowns[world, self.axis] = folds.last[0]
        return concatenated(folds, later)


class AtBegin(StateFields):
    """The fold over positions lo to hi, which is read only at position 0."""

    STATE = ("_total", "_last")

    def __init__(self, window: Window, streams: Sequence[RegionStream]) -> None:
        self._window, self._fold = window, FOLDS[window.fold]
        self._operands = RegionOperands(self._fold, streams)
        self._operands.hold(self._operands.late, 0)
        self._lo, self._hi = max(0, window.lo or 0), window.hi
        self.reset()

    def reset(self) -> None:
        self._last = -1
        self._total = identities(self._fold, self._operands.corners, 0).values

    def substitute(self, axis: int, value: Floats) -> None:
        """Write an unknown as a polynomial in its later value."""
        self._total = substituted(self._total, axis, value)

    def settle(self) -> None:
        """Fold in the elements that have settled."""
        end = min(s.last for s in self._operands.streams)
        begin, self._last = max(self._lo, self._last + 1), max(end, self._last)
        if self._hi is not None:
            end = min(end, self._hi)
        if begin <= end:
            elements = self._operands.settled(begin, end).values
            total = fold_all(self._fold, elements)
            self._total = self._fold.combine_arrays(self._total, total)

    def value(self, world: World, t: int, unknowns: Floats) -> float:
        """Return the fold over settled and open values in a world after position t."""
        endless = self._hi is None or self._window.endless
        if world.cut and endless and self._window.begin > t:
            return self.value(world.opened, t, unknowns)
        total = tuple(in_world(a, unknowns[world]) for a in self._total)
        begin, end = max(self._lo, self._last + 1), self._hi
        if world.cut and end is None:
            end = t
        elif _stops(self._window, world):
            seen = max(t, 0) if self._lo == 0 else t
            end = seen if end is None else min(end, seen)
        if end is None or begin <= end:
            elements = clipped(self._operands.seen(world, begin, unknowns), begin, end).values
            total = self._fold.combine_arrays(total, fold_all(self._fold, elements))
        return float(total[-1].item())
