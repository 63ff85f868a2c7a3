"""Samples at even distances and their period, resampling, and the gaps between records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rtamt.columns import median
from rtamt_gym.recorded.columns import NEAR
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import TimeAxis, simple
from rtamt_gym.results.extent import Gap
from rtamt_gym.tables import counted, number, time_text

_DRIFT = 0.01
"""The part by which every step may differ from the usual one, however far a slow clock drifts."""

_FINEST, _MANY = 100, 1_000_000
"""The most samples for each row that resampling makes, and how many it makes of any trace."""

HOLE = 1.75
"""A step of so many usual ones and more is one over samples that are not there."""


class Grid:
    """Even distances that fit the times of two or more samples.

    Args:
        times: The times.
        jitter: The part of the period by which a sample may lie off the grid.
    """

    def __init__(self, times: TimeAxis, jitter: float | None) -> None:
        self.jitter = NEAR if jitter is None else jitter
        since = times.since
        with np.errstate(over="ignore"):  # callers refuse infinite steps
            self.steps = np.diff(since)
        self._exact = times.step
        self.usual = median(self.steps) if times.step is None else float(times.step)
        """The distance that the format states, or the median of the distances."""
        self._precision = 2 * times.precision
        self._since = since
        self.slope = self.usual if self._exact else float(since[-1]) / (len(since) - 1)
        """The distance of the grid's points."""
        if self._exact is None and self.rises and np.isfinite(self.slope) and not self.even:
            self.slope = self._nearest_slope()
            del self.even  # it depends on the slope

    def _nearest_slope(self) -> float:
        """Return the step of the grid that is nearest to the samples.

        The spread of the distances is a convex function of the step, so a search finds its minimum.
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
        """Return the spread of the distances from the samples to a grid with this step."""
        with np.errstate(over="ignore", invalid="ignore"):
            off = self._since - np.arange(len(self._since)) * slope
            return float(off.max() - off.min())

    @cached_property
    def rises(self) -> bool:
        """Whether the times increase."""
        return bool((self.steps > 0).all())

    @cached_property
    def even(self) -> bool:
        """Whether the samples count as on the grid."""
        if not (self.rises and np.isfinite(self.slope)):
            return False
        near = self._spread(self.slope) <= 2 * self.jitter * self.slope + self._precision
        drifts = np.abs(self.steps - self.usual) <= _DRIFT * self.usual + self._precision
        return near or bool(drifts.all())

    @property
    def even_between_holes(self) -> bool:
        """Whether the samples are even, apart from steps over missing samples."""
        if not self.rises or not np.isfinite(self.slope):
            return False
        off = np.abs(self.steps - self.usual)
        near = off <= 2 * self.jitter * self.usual + self._precision
        return bool((near | (self.steps >= HOLE * self.usual)).all())

    @property
    def fitted(self) -> Fraction:
        """The distance of samples between holes, as simple as their rounding allows."""
        if self._exact is not None:
            return self._exact
        steps = self.steps[self.steps < HOLE * self.usual]
        blur = (self._precision + float(steps.max() - steps.min())) / len(steps)
        slope = float(steps.mean())
        return simple(slope, max(1e-9 * slope, blur))

    @property
    def odd(self) -> int:
        """The index of the first step that two samples near the grid do not explain.

        Without such a step, the index of the step that is farthest from the usual step.
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
        held: Whether each sample is later than its row by more than the jitter.
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
    """Resample by holding values, every usual step from the first row to the last.

    A row that is later than a sample by no more than the jitter counts as on it. Return None if
    there would be more than a hundred samples for every row, and more than a million.

    Args:
        times: Increasing times.
        grid: The grid of these times, which are not even.
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
    index = int(grid.steps.argmax())
    held = samples - times.since[rows] > near
    return Resampled(rows, period, held, off, float(grid.steps[index]), index)


@dataclass(frozen=True, slots=True)
class Records:
    """When a variable was recorded.

    Attributes:
        times: The times, which increase; the last may be the end of the trace.
        steps: The distances of neighbours.
        usual: The median distance; None until it is computed.
    """

    times: Floats
    steps: Floats
    usual: float | None = None

    @staticmethod
    def of(times: Floats) -> Records:
        """Return the records at some times."""
        with np.errstate(over="ignore"):  # rtamt refuses times so far apart
            return Records(times, np.diff(times))

    def measured(self) -> Records:
        """Return the same records, with the median of their distances if there are two."""
        usual = median(self.steps) if len(self.steps) else None
        return replace(self, usual=usual)


def longest_gap(records: Mapping[str, Records], start: float = 0.0) -> Gap | None:
    """Return the longest time between two records of one variable, or None without two records.

    If several gaps are equally long, return the gap with the most usual steps.

    Args:
        records: The records of each variable; variables that share an object share the computation.
        start: The offset to add to the times, in seconds.
    """
    longest: dict[int, tuple[float, float, Records, list[str]]] = {}
    for name, record in records.items():
        if not len(record.steps):
            continue
        if id(record) not in longest:
            index = int(record.steps.argmax())
            longest[id(record)] = (
                float(record.steps[index]),
                float(record.times[index]) + start,
                record,
                [],
            )
        longest[id(record)][3].append(name)
    if not longest:
        return None
    most = max(seconds for seconds, *_ in longest.values())
    longest_records = [record for record in longest.values() if record[0] == most]
    usuals = [_usual(record) for _, _, record, _ in longest_records]
    best = int(np.argmin(usuals))
    seconds, begin, _, _ = longest_records[best]
    names = [name for _, other, _, names in longest_records if other == begin for name in names]
    variables = "" if len(names) == len(records) else ", ".join(names)
    return Gap(seconds, begin, usuals[best], variables)


def _usual(records: Records) -> float:
    return median(records.steps) if records.usual is None else records.usual


def hole_note(records: Mapping[str, Records], most: float, start: float = 0.0) -> str:
    """Return the note on times without records, where variables are unknown; empty if none.

    Args:
        records: The records of each variable.
        most: The longest time in seconds for which a value may hold.
        start: The offset to add to the times, in seconds.
    """
    texts: dict[str, list[str]] = {}
    for name, record in records.items():
        # Times since 1970 in doubles are rounded to 0.24 us, and so are their steps.
        rounded = 2 * np.spacing(np.abs(record.times).max(initial=0.0))
        (holes,) = np.nonzero(record.steps > most + rounded)
        if not len(holes):
            continue
        longest = int(holes[record.steps[holes].argmax()])
        length = f"{number(float(record.steps[longest]))} s"
        after = f"after {time_text(float(record.times[longest]) + start, most)}"
        words = f"a hole of {length} {after}"
        if len(holes) > 1:
            words = f"{counted(len(holes), 'hole')}, the longest of {length} {after}"
        texts.setdefault(words, []).append(name)
    if not texts:
        return ""
    each_said = [
        words if _all(names, records) else f"{', '.join(names)}: {words}"
        for words, names in texts.items()
    ]
    return (
        f"values are unknown where nothing was recorded for more than {number(most)} s "
        f"({'; '.join(each_said)})"
    )


def _all(names: Sequence[str], records: Mapping[str, Records]) -> bool:
    return len(names) == len(records)
