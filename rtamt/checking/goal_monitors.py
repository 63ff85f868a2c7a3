"""Monitors that tell fast that a trace is not as demanded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Final

from rtamt.checking.witness import Goal
from rtamt.errors import InputError
from rtamt.machines.protocols import End
from rtamt.monitors.monitor import EpisodeMonitor

__all__ = ["GoalMonitors"]

_PER_PART: Final = 5
"""So many samples of a monitor cost as much as a part of a truth."""


class GoalMonitors:
    """The monitors of what traces that end are to be like.

    Attributes:
        work: What a trace costs, in parts of truths.

    Args:
        demands: What is demanded.
        period: Seconds between samples, or None.
        end: How the end of a trace is read.
        samples: How many samples traces have.

    Raises:
        SpecificationError: If a monitor of episodes cannot have one of the formulas.
    """

    def __init__(
        self, demands: Sequence[Goal], period: Fraction | None, end: End, samples: int
    ) -> None:
        self._end = end
        self._monitors = [
            (EpisodeMonitor(each.program.specification, period), each.holds)
            for each in demands
            if each.program.variables
        ]
        self.work = 1 + samples * len(self._monitors) // _PER_PART

    def __call__(self, columns: Mapping[str, Sequence[float]]) -> bool:
        """Whether they judge a trace as demanded; not one on which a term is no number."""
        for monitor, holds in self._monitors:
            monitor.reset()
            try:
                for row in zip(*(columns[name] for name in monitor.variables), strict=True):
                    monitor.update(*row)
            except InputError:  # a term is no number there
                return False
            monitor.finish(self._end)
            if (monitor.verdict > 0) is not holds:
                return False
        return True
