"""Windows of the episode machine that are read at time 0 alone.

`rtamt.machines.episode.machine` explains the terms.
"""

from __future__ import annotations

from collections.abc import Sequence

from rtamt.machines.episode.streams import CUT, NOW, Array, Operands, Polynomials, Stream, in_world
from rtamt.machines.windows import fold_all
from rtamt.program.algebra import LatticeFold

__all__ = ["InitialFold"]


class InitialFold(Polynomials):
    """The fold over times lo to hi."""

    def __init__(
        self, fold: LatticeFold, lo: int | None, hi: int | None, streams: Sequence[Stream]
    ) -> None:
        self._operands = Operands(fold, streams)
        self._operands.hold(self._operands.late, 0)
        super().__init__(self._operands.identities(*self._operands.corners, 1))
        self.fold = fold
        self._begin = max(0, lo or 0)
        self._end = hi

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
        total = tuple(in_world(a, unknowns[world]) for a in self.kept)
        begin = max(self._begin, t - operands.late + 1)
        # A future without end speaks of recorded times alone if the trace was cut. It begins now:
        # `rtamt.program.polarity` writes a later begin as a shift.
        recorded = world == NOW or (world in CUT and self._end is None)
        last = t if recorded else t + operands.past
        end = last if self._end is None else min(last, self._end)
        if begin <= end:
            elements = operands.seen(world, begin, end, t, unknowns)
            total = self.fold.combine_arrays(total, fold_all(self.fold, elements))
        if not recorded and (self._end is None or self._end > last):
            total = self.fold.combine_arrays(total, operands.tail(world))
        return total[-1].item()
