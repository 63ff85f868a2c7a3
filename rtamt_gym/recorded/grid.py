"""Samples at even distances: how far they lie off, their period, and resampling by holding."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rtamt_gym.recorded.columns import NEAR
from rtamt_gym.recorded.times import TimeAxis, simple

__all__ = ["HOLE", "Grid", "Resampled", "resampled"]

_DRIFT = 0.01
"""The part by which every step may differ from the usual one, however far a slow clock drifts."""

_FINEST, _MANY = 100, 1_000_000
"""The most samples for each row that resampling makes, and how many it makes of any trace."""

HOLE = 1.75
"""A step of so many usual ones and more is one over samples that are not there."""


class Grid:
    """Even distances beside the times of two samples or more.

    Args:
        times: The times.
        jitter: The part of the period by which a sample may lie off the grid.
    """

    def __init__(self, times: TimeAxis, jitter: float | None) -> None:
        self.jitter = NEAR if jitter is None else jitter
        since = times.since
        with np.errstate(over="ignore"):  # steps past all floats are refused by who asks
            self.steps = np.diff(since)
        self.usual = float(np.median(self.steps))
        """The median of the distances."""
        self._exact = times.step
        self._precision = 2 * times.precision
        self._since = since
        self.slope = float(since[-1]) / (len(since) - 1)
        """The distance of the grid's points."""
        if self.rises and np.isfinite(self.slope) and not self.even:
            self.slope = self._nearest_slope()

    def _nearest_slope(self) -> float:
        """The distance of the grid whose points the samples lie nearest to.

        How far they lie off is a convex function of it, whose least value is searched for.
        """
        room = 2 * self.jitter / len(self.steps) + 1e-12
        low, high = self.slope * (1 - room), self.slope * (1 + room)
        for _ in range(40):
            third = (high - low) / 3
            if self._spread(low + third) <= self._spread(high - third):
                high -= third
            else:
                low += third
        return (low + high) / 2

    def _spread(self, slope: float) -> float:
        """How far the samples lie apart beside points at such a distance."""
        with np.errstate(over="ignore", invalid="ignore"):
            off = self._since - np.arange(len(self._since)) * slope
            return float(off.max() - off.min())

    @property
    def rises(self) -> bool:
        """Whether every time is after the one before."""
        return bool((self.steps > 0).all())

    @property
    def even(self) -> bool:
        """Whether the samples count as on the grid."""
        if not (self.rises and np.isfinite(self.slope)):
            return False
        near = self._spread(self.slope) <= 2 * self.jitter * self.slope + self._precision
        drifts = np.abs(self.steps - self.usual) <= _DRIFT * self.usual + self._precision
        return near or bool(drifts.all())

    @property
    def even_between_holes(self) -> bool:
        """Whether the samples are even but for steps over samples that are not there."""
        if not self.rises or not np.isfinite(self.slope):
            return False
        off = np.abs(self.steps - self.usual)
        near = off <= 2 * self.jitter * self.usual + self._precision
        return bool((near | (self.steps >= HOLE * self.usual)).all())

    @property
    def fitted(self) -> Fraction:
        """The distance of samples between holes, as simple as their rounding allows."""
        steps = self.steps[self.steps < HOLE * self.usual]
        blur = (self._precision + float(steps.max() - steps.min())) / len(steps)
        slope = float(steps.mean())
        return simple(slope, max(1e-9 * slope, blur))

    @property
    def odd(self) -> int:
        """The place of the first step that two samples near to the grid do not explain.

        If there is none, the place of the step that is farthest from the usual.
        """
        if self.usual <= 0:
            return int((self.steps <= 0).argmax())
        away = np.abs(self.steps - self.usual)
        away[self.steps <= 0] = np.inf
        odd = away > 2 * self.jitter * self.usual
        return int(odd.argmax() if odd.any() else away.argmax())

    @property
    def period(self) -> Fraction:
        """The distance, exact or as simple as the rounding of the times and their jitter allow."""
        if self._exact is not None:
            return self._exact
        blur = (self._precision + 2 * self._spread(self.slope)) / len(self.steps)
        return simple(self.slope, max(1e-9 * self.slope, blur))


@dataclass(frozen=True, slots=True)
class Resampled:
    """Samples on a grid, each with the values of the last row at or before it.

    Attributes:
        rows: The row of each sample.
        period: Seconds between the samples.
        held: Whether each sample lies behind its row, by more than the jitter.
        off: The number of rows that lay off the grid.
        gap: The longest distance of two rows, in seconds.
        at: The row before that distance.
    """

    rows: NDArray[np.intp]
    period: Fraction
    held: NDArray[np.bool_]
    off: int
    gap: float
    at: int


def resampled(times: TimeAxis, grid: Grid) -> Resampled | None:
    """Takes samples every usual distance, from the first row to the last, where values hold.

    A row that lies behind a sample by no more than the jitter counts as on it. None: there would
    be more than a hundred samples for every row, and more than a million.

    Args:
        times: Times that rise.
        grid: The grid beside them, which is not even.
    """
    fits = grid.even_between_holes
    period = grid.fitted if fits else simple(grid.usual, 0.01 * grid.usual)
    near = grid.jitter * grid.usual
    count = int((float(times.since[-1]) + near) / period) + 1
    if count > max(_FINEST * len(times.since), _MANY):
        return None
    samples = np.arange(count) * period.numerator / period.denominator
    rows = np.searchsorted(times.since, samples + near, side="right") - 1
    places = times.since / float(period)
    off = int((np.abs(places - np.rint(places)) > grid.jitter + 1e-9).sum())
    at = int(grid.steps.argmax())
    held = samples - times.since[rows] > near
    return Resampled(rows, period, held, off, float(grid.steps[at]), at)
