"""Windows of the episode machine that are read at time 0 alone.

`rtamt.machines.episode.machine` explains the terms.
"""

from __future__ import annotations

from collections.abc import Sequence

from rtamt.machines.episode.streams import (
    CUT,
    NOW,
    OPEN,
    Array,
    Operands,
    Polynomials,
    Stream,
    in_world,
    skips,
)
from rtamt.machines.windows import fold_all
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Window

__all__ = ["InitialFold"]


class InitialFold(Polynomials):
    """The fold over times lo to hi."""

    def __init__(self, window: Window, streams: Sequence[Stream]) -> None:
        self.fold = fold = FOLDS[window.fold]
        self._operands = Operands(fold, streams)
        self._operands.hold(self._operands.late, 0)
        super().__init__(self._operands.identities(*self._operands.corners, 1))
        self._window = window
        self._begin = max(0, window.lo or 0)
        self._end = window.hi

    def _inside(self, time: int) -> bool:
        return self._begin <= time and (self._end is None or time <= self._end)

    def settle(self, t: int) -> None:
        """Fold in the element that settled with sample t."""
        time = t - self._operands.late
        if self._inside(time):
            newest = self._operands.settled(time, time)
            self.kept = self.fold.combine_arrays(self.kept, newest)

    def value(self, world: int, t: int, unknowns: Array) -> float:
        """The fold over settled, open and later values in a world."""
        operands = self._operands
        if world in CUT and self._window.endless and self._window.begin > t:
            world = OPEN[world]
        total = tuple(in_world(a, unknowns[world]) for a in self.kept)
        begin = max(self._begin, t - operands.late + 1)
        # A future without end speaks of recorded times alone if the trace was cut. It begins now:
        # `rtamt.program.polarity` writes a later begin as a shift.
        recorded = world == NOW or (world in CUT and self._end is None)
        if skips(self._window, world):  # time 0 is there
            recorded, t = True, max(0, t)
        last = t if recorded else t + operands.past
        end = last if self._end is None else min(last, self._end)
        if begin <= end:
            elements = operands.seen(world, begin, end, unknowns)
            total = self.fold.combine_arrays(total, fold_all(self.fold, elements))
        if not recorded and (self._end is None or self._end > last):
            total = self.fold.combine_arrays(total, operands.tail(world))
        return total[-1].item()
