"""Runs of places at which a formula fails, holds, or may do either.

A segment is a run of places with equal values: one sample, or a run of positions of dense time
(`rtamt.program.dense_lowering`). Values are the integers of `rtamt.program.algebra.ordered`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.machines.dense.runs import distinct
from rtamt.program.implications import InstantRuns

PlaceNumbers = NDArray[np.int64]
Flagged = NDArray[np.bool_]

FOREVER = np.iinfo(np.int64).max
"""The last place of a run without an end."""

FindRuns = Callable[
    [PlaceNumbers, PlaceNumbers], tuple[PlaceNumbers, PlaceNumbers, PlaceNumbers, PlaceNumbers]
]
"""Returns the runs of negative integers of a column, and the minimum of another column in each.

These are the first place of each run, the place after it, its minimum, and the first place of that.
"""

_SHORT_RUN = 32
"""Segments of each run that are compared with its minimum one by one."""


class PlaceRuns(NamedTuple):
    """Runs of places, in order.

    Attributes:
        first: The first place of each run.
        last: The last place of each run.
    """

    first: PlaceNumbers
    last: PlaceNumbers

    @staticmethod
    def of(instants: InstantRuns, last: int) -> PlaceRuns:
        """Return the parts of runs of instants up to a last place."""
        known = [(first, int(min(final, last))) for first, final in instants if first <= last]
        return PlaceRuns(*np.array(known, np.int64).reshape(-1, 2).T)

    @staticmethod
    def where(flags: Flagged, starts: PlaceNumbers | None, last: int) -> PlaceRuns:
        """Return the runs with a flag; without ``starts`` each place has its own flag."""
        places = _changes(flags)
        if starts is not None:
            places = starts[places]
        first, final = places[::2], places[1::2] - 1
        return PlaceRuns(first, final if len(final) == len(first) else np.append(final, last))

    def within(self, instants: InstantRuns) -> PlaceRuns:
        """Return the parts of the runs inside others, which do not touch."""
        if not len(self.first):
            return self
        if len(instants) == 1:
            ((begin, end),) = instants
            if begin <= self.first[0] and self.last[-1] <= end:
                return self
        first, last = [self.first[:0]], [self.last[:0]]
        for begin, end in instants:
            low = int(np.searchsorted(self.last, begin))
            high = int(np.searchsorted(self.first, end, "right"))
            first.append(np.maximum(self.first[low:high], begin))
            last.append(np.minimum(self.last[low:high], end).astype(np.int64))
        return PlaceRuns(np.concatenate(first), np.concatenate(last))

    def first_between(self, begin: int, end: int) -> int | None:
        """Return the first place of a run from begin to end."""
        run = int(np.searchsorted(self.last, begin))
        if run == len(self.first):
            return None
        place = max(begin, int(self.first[run]))
        return place if place <= end else None

    def length(self, step: int) -> int:
        """Return the number of samples, or of ticks of dense time, of `step` places each."""
        if step == 1:
            return int(self.last.sum() - self.first.sum()) + len(self.first)
        return int(np.sum((self.last + 1) // step - self.first // step))

    def at_or_after(self, places: PlaceNumbers) -> PlaceNumbers:
        """Return for each place the first place of a run from there on, or -1."""
        if not len(self.first):
            return np.full(len(places), -1, np.int64)
        run = np.searchsorted(self.last, places)
        first = self.first[np.minimum(run, len(self.first) - 1)]
        return np.where(run < len(self.first), np.maximum(places, first), -1)


def _changes(flags: Flagged) -> PlaceNumbers:
    """Return where flags begin and end, in turn."""
    changes = np.flatnonzero(flags[1:] != flags[:-1]) + 1
    return np.concatenate([np.zeros(1, np.int64), changes]) if flags[0] else changes


class UnseenPlace(NamedTuple):
    """A place after the trace at which a formula fails for certain.

    Attributes:
        place: The place.
        robustness: The largest possible robustness there.
    """

    place: int
    robustness: float


class Minima(NamedTuple):
    """The minimum in each of some runs.

    Attributes:
        values: The minima.
        places: The first place of each.
    """

    values: PlaceNumbers
    places: PlaceNumbers


class Segments:
    """The values of a formula over a trace.

    ``starts`` has the first place of each segment; None: every place is a segment. The robustness
    moves into the bounds of the end mode, which are the same object if all values are known.
    ``find_runs`` finds runs of negative integers; None: NumPy does.
    """

    def __init__(
        self,
        starts: PlaceNumbers | None,
        last: int,
        robustness: PlaceNumbers,
        lower: PlaceNumbers,
        upper: PlaceNumbers,
        find_runs: FindRuns | None = None,
    ) -> None:
        self.starts, self.last = starts, last
        self.known = lower is robustness and upper is robustness
        if not self.known:
            robustness = np.maximum(lower, np.minimum(robustness, upper))
        self.robustness = robustness
        self._lower, self._upper, self._find_runs = lower, upper, find_runs
        self._edges = None if starts is None else np.append(starts, last + 1)

    @functools.cached_property
    def fails(self) -> Flagged:
        """Whether the formula fails for certain, in each segment."""
        return self._upper < 0

    @functools.cached_property
    def holds(self) -> Flagged:
        """Whether the formula holds for certain, in each segment."""
        return self._lower >= 0

    @property
    def unknown(self) -> Flagged:
        """Whether the formula may hold or fail, in each segment."""
        return (self._lower < 0) & (self._upper >= 0)

    def failing(self, places: PlaceRuns) -> tuple[SegmentRuns, Minima]:
        """Return the runs that fail inside runs of places, with their minima; see `divided`."""
        if self._find_runs is not None and len(places.first) == 1:
            (begin,), (after,) = self.within(places)[1:]
            part = slice(begin, after)
            first, end, minima, worst = self._find_runs(self._upper[part], self.robustness[part])
            if begin:
                first, end, worst = first + begin, end + begin, worst + begin
            return SegmentRuns(self, first, end), Minima(minima, self.place(worst))
        runs = self.runs(self._only(self.fails, places))
        return runs, runs.minima()

    def holding(self, places: PlaceRuns) -> SegmentRuns:
        """Return the runs inside runs of places that hold for certain; see `divided`."""
        return self.runs(self._only(self.holds, places))

    def undecided(self, places: PlaceRuns) -> SegmentRuns:
        """Return the runs inside runs of places that may hold or fail; see `divided`."""
        if self.known:
            none = np.zeros(0, np.int64)
            return SegmentRuns(self, none, none)
        return self.runs(self._only(self.unknown, places))

    def _only(self, flags: Flagged, places: PlaceRuns) -> Flagged:
        return flags if self._is_covered(places) else flags & self.inside(places)

    def _is_covered(self, places: PlaceRuns) -> bool:
        first, last = places
        return len(first) == 1 and first[0] == 0 and last[0] == self.last

    def divided(self, runs: PlaceRuns) -> Segments:
        """Return the segments split at the edges of runs."""
        if self.starts is None or self._is_covered(runs):
            return self
        edges = np.concatenate([runs.first, runs.last + 1])
        edges = edges[edges <= self.last]
        source = np.searchsorted(self.starts, edges, "right") - 1
        new = self.starts[source] != edges
        if not new.any():
            return self
        starts = distinct(self.starts, edges[new])
        source = np.searchsorted(self.starts, starts, "right") - 1
        values = self.robustness[source]
        bounds = (values, values) if self.known else (self._lower[source], self._upper[source])
        return Segments(starts, self.last, values, *bounds, self._find_runs)

    def within(self, runs: PlaceRuns) -> SegmentRuns:
        """Return runs of places as runs of segments; see `divided`."""
        return SegmentRuns(self, self._segment(runs.first), self._segment(runs.last + 1))

    def inside(self, runs: PlaceRuns) -> Flagged:
        """Return whether each segment is in a run; see `divided`."""
        _, first, after = self.within(runs)
        flags = np.zeros(len(self.robustness), bool)
        for begin, end in zip(first.tolist(), after.tolist(), strict=True):
            flags[begin:end] = True
        return flags

    def runs(self, flags: Flagged) -> SegmentRuns:
        """Return the longest runs of segments with a flag."""
        changes = _changes(flags)
        first, after = changes[::2], changes[1::2]
        if len(after) < len(first):
            after = np.append(after, len(flags))
        return SegmentRuns(self, first, after)

    def _segment(self, places: PlaceNumbers) -> PlaceNumbers:
        return places if self.starts is None else np.searchsorted(self.starts, places)

    def place(self, segments: PlaceNumbers) -> PlaceNumbers:
        """Return the first places of segments; after the last one, the place after the trace."""
        return segments if self._edges is None else self._edges[segments]


class SegmentRuns(NamedTuple):
    """Runs of the segments of a formula, in order: each from a first segment to before another."""

    segments: Segments
    first: PlaceNumbers
    after: PlaceNumbers

    @property
    def places(self) -> PlaceRuns:
        """The places of the runs."""
        return PlaceRuns(self.segments.place(self.first), self.segments.place(self.after) - 1)

    def any(self, flags: Flagged) -> Flagged:
        """Return for each run whether one of its segments has a flag."""
        if not len(self.first):
            return np.zeros(0, bool)
        counts = np.concatenate([np.zeros(1, np.int64), np.cumsum(flags)])
        more: Flagged = counts[self.after] > counts[self.first]
        return more

    def minima(self) -> Minima:
        """Return the minimum robustness in each run, and the first place of it."""
        if not len(self.first):
            return Minima(self.first, self.first)
        values = self.segments.robustness
        edges = np.column_stack([self.first, self.after]).reshape(-1)
        minima = np.minimum.reduceat(values, edges[:-1] if edges[-1] == len(values) else edges)[::2]
        # Most runs are short: look at one segment of all of them at a time.
        places = self.first.copy()
        left = np.flatnonzero(values[places] != minima)
        for _ in range(_SHORT_RUN):
            if not len(left):
                break
            places[left] += 1
            left = left[values[places[left]] != minima[left]]
        if len(left):
            places[left] = self._first_equal(left, minima)
        return Minima(minima, self.segments.place(places))

    def _first_equal(self, runs: PlaceNumbers, minima: PlaceNumbers) -> PlaceNumbers:
        """Return the first segment of some runs with the minimum of the run."""
        lengths = self.after[runs] - self.first[runs]
        ends = np.cumsum(lengths)
        begins = ends - lengths
        members = np.arange(ends[-1]) + np.repeat(self.first[runs] - begins, lengths)
        equal = self.segments.robustness[members] == np.repeat(minima[runs], lengths)
        hits = np.flatnonzero(equal)
        places: PlaceNumbers = members[hits[np.searchsorted(hits, begins)]]
        return places
