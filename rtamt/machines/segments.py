"""Runs of places at which a formula fails, holds, or may do either.

A segment is a run of places with equal values: one sample, or a run of positions of dense time
(`rtamt.program.dense_lowering`). Values are the integers of `rtamt.program.algebra.ordered`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.machines.dense.runs import distinct
from rtamt.program.implications import InstantRuns

PlaceNumbers = NDArray[np.int64]
Flagged = NDArray[np.bool_]

FOREVER = np.iinfo(np.int64).max
"""The last place of a run without an end."""

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
        return int(np.sum((self.last + 1) // step - self.first // step))

    def at_or_after(self, places: PlaceNumbers) -> PlaceNumbers:
        """Return for each place the first place of a run from there on; -1 if there is none."""
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


class Segments(NamedTuple):
    """The values of a formula over a trace.

    Attributes:
        starts: The first place of each segment; None: every place is a segment.
        last: The last place of the trace.
        robustness: The robustness in each segment, within the bounds of the end mode.
        fails: Whether the formula fails for certain, in each segment.
        holds: Whether it holds for certain.
    """

    starts: PlaceNumbers | None
    last: int
    robustness: PlaceNumbers
    fails: Flagged
    holds: Flagged

    @staticmethod
    def of(
        starts: PlaceNumbers | None,
        last: int,
        robustness: PlaceNumbers,
        lower: PlaceNumbers,
        upper: PlaceNumbers,
    ) -> Segments:
        """Return segments from the robustness and its bounds; all are one object if known."""
        if lower is robustness and upper is robustness:
            fails = robustness < 0
            return Segments(starts, last, robustness, fails, ~fails)
        robustness = np.maximum(lower, np.minimum(robustness, upper))
        return Segments(starts, last, robustness, upper < 0, lower >= 0)

    @property
    def unknown(self) -> Flagged:
        """Whether the formula may hold or fail, in each segment."""
        return ~(self.fails | self.holds)

    def divided(self, runs: PlaceRuns) -> Segments:
        """Return segments of which each is inside or outside of every run."""
        if self.starts is None:
            return self
        edges = np.concatenate([runs.first, runs.last + 1])
        edges = edges[edges <= self.last]
        source = np.searchsorted(self.starts, edges, "right") - 1
        new = self.starts[source] != edges
        if not new.any():
            return self
        starts = distinct(self.starts, edges[new])
        source = np.searchsorted(self.starts, starts, "right") - 1
        values = self.robustness[source], self.fails[source], self.holds[source]
        return Segments(starts, self.last, *values)

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
        if self.starts is None:
            return segments
        return np.append(self.starts, self.last + 1)[segments]


class SegmentRuns(NamedTuple):
    """Runs of the segments of a formula, in order.

    Attributes:
        segments: The segments.
        first: The first segment of each run.
        after: The segment after each run.
    """

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
