"""Windows of the episode machine that are read at time 0 alone.

`rtamt.machines.episode.machine` explains the terms.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

from rtamt.machines.episode.streams import (
    CUT,
    NOW,
    OPEN,
    Operands,
    RunningFold,
    Stream,
    skipping,
)
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Window

__all__ = ["InitialFold"]


class InitialFold(RunningFold):
    """The fold over times lo to hi."""

    def __init__(self, window: Window, streams: Sequence[Stream]) -> None:
        super().__init__(Operands(FOLDS[window.fold], streams))
        self._operands.hold(self._operands.late, 0)
        self._window = window
        self._skipping = skipping(window)
        self._begin = max(0, window.lo or 0)
        self._end = window.hi

    def settle(self, t: int) -> None:
        """Fold in the element that settled with sample t."""
        time = t - self._operands.late
        if self._begin <= time and (self._end is None or time <= self._end):
            self.push(time)

    def value_in(self, world: int, t: int) -> float:
        """Return the fold over settled, open and later values in a world."""
        operands = self._operands
        if world in CUT and self._window.endless and self._window.begin > t:
            world = OPEN[world]
        # A future without end speaks of recorded times alone if the trace was cut. It begins now:
        # `rtamt.program.polarity` writes a later begin as a shift.
        recorded = world == NOW or (world in CUT and self._end is None)
        last = t if recorded else t + operands.past
        if world in self._skipping:  # time 0 is there
            recorded, last = True, max(0, t)
        begin = max(self._begin, t - operands.late + 1)
        end = last if self._end is None else min(last, self._end)
        elements = operands.seen(world, begin, end) if begin <= end else []
        if not recorded and (self._end is None or self._end > last):
            elements.append(operands.tail(world))
        return functools.reduce(self._combine, elements, self.seen(world))[-1]
