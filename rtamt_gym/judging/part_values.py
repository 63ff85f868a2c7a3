"""The values of the parts of a specification that clocks are counted from, in many environments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt_gym.judging.picking import pick
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["Aligned", "PartValues", "Which"]

Which = slice | Lanes
"""The environments that take a sample."""


class PartValues:
    """The values of a part of a specification, late by ``late`` samples; nan before the first."""

    def __init__(self, monitor: rtamt.VectorMonitor, columns: Sequence[str]) -> None:
        self._monitor = monitor
        self._pick = pick([columns.index(name) for name in monitor.variables])
        self.late = monitor.latency
        self.value: Floats = np.full(monitor.num, np.nan)

    def feed(self, table: Floats, lanes: Lanes | None) -> None:
        self.value = self._monitor.update(table[:, self._pick], lanes)

    def reset(self, lanes: Lanes | None) -> None:
        self._monitor.reset(lanes)
        self.value = np.where(True if lanes is None else lanes, np.nan, self.value)


class Aligned:
    """Delays the values of a part by ``more`` samples, so that they fit the values of another."""

    def __init__(self, part: PartValues, more: int, num: int) -> None:
        self._part = part
        self._more = more
        self._held = np.full((more, num), np.nan)
        self.value: Floats = np.full(num, np.nan)

    def feed(self, which: Which, samples: NDArray[np.int64]) -> None:
        if self._more == 0:
            self.value = self._part.value
            return
        place = samples % self._more, np.arange(len(self.value))[which]
        self.value = self.value.copy()
        self.value[which] = self._held[place]
        self._held[place] = self._part.value[which]

    def reset(self, which: Which) -> None:
        self._held[:, which] = np.nan
