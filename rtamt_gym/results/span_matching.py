"""Matching of the violations of two recordings: the same, moved, new or gone."""

from __future__ import annotations

import heapq
import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

Status = Literal["same", "moved", "longer", "shorter", "new", "gone", "part", "undecided"]
"""The result for a violation of A or B.

``same``, ``moved``, ``longer`` and ``shorter`` have a partner in the other recording. ``new`` is in
B only and ``gone`` in A only. ``part`` has no partner, but a violation of the other recording
covers it, up to the tolerance at both ends. ``undecided`` has no partner, and the other recording
does not show whether it has one.
"""

ROUNDING: Final = 1e-14
"""The difference of equal times, relative to the largest time."""


class TimeSpan(NamedTuple):
    """A half-open interval of time, ``start <= t < stop``, which is never empty."""

    start: float
    stop: float
    censored: bool = False  # it may last longer, because the recording ends


@dataclass(frozen=True, slots=True)
class RecordedSpans:
    """The spans of one body in one recording."""

    violated: Sequence[TimeSpan]
    unknown: Sequence[TimeSpan]
    recorded: TimeSpan
    ahead: int | None = None  # the place of the violation at an instant after the recording
    satisfied: bool = False


@dataclass(frozen=True, slots=True)
class SpanMatches:
    """The violations of two recordings, matched."""

    pairs: tuple[tuple[int, int], ...]
    of_a: tuple[Status, ...]
    of_b: tuple[Status, ...]
    open_a: int  # unknown spans of A at times that B decides as not violated
    open_b: int


def match_spans(a: RecordedSpans, b: RecordedSpans, tolerance: float) -> SpanMatches:
    """Match the violations of two recordings, at most one to one.

    First, overlapping violations become partners, the longest overlap first. Then violations become
    partners if their starts differ by at most the tolerance, the nearest starts first. Equal
    candidates are taken in the order of time, so that exchanging A and B exchanges the result.
    """
    every = (*a.violated, *a.unknown, *b.violated, *b.unknown, a.recorded, b.recorded)
    ends = [abs(end) for span in every for end in span[:2] if math.isfinite(end)]
    slack = ROUNDING * max(ends, default=0.0)
    pairs = _overlapping(a.violated, b.violated, slack)
    pairs |= _near(a.violated, b.violated, pairs, tolerance + slack)
    sides = _Side(a, tolerance, slack), _Side(b, tolerance, slack)
    of_a, of_b = list[Status](), list[Status]()
    partners = {j: i for i, j in pairs.items()}
    for i, span in enumerate(a.violated):
        if i in pairs:
            of_a.append(_status(sides, span, b.violated[pairs[i]]))
        else:
            of_a.append(sides[1].alone(span, "gone", ahead=i == a.ahead))
    for j, span in enumerate(b.violated):
        if j in partners:
            of_b.append(of_a[partners[j]])
        else:
            of_b.append(sides[0].alone(span, "new", ahead=j == b.ahead))
    return SpanMatches(
        tuple(sorted(pairs.items())),
        tuple(of_a),
        tuple(of_b),
        sum(not sides[1].covers(span) for span in a.unknown),
        sum(not sides[0].covers(span) for span in b.unknown),
    )


def _overlapping(a: Sequence[TimeSpan], b: Sequence[TimeSpan], slack: float) -> dict[int, int]:
    """Return the partners that overlap, by the place in A."""
    candidates = []
    first = 0
    for i, one in enumerate(a):
        while first < len(b) and b[first].stop <= one.start:
            first += 1
        j = first
        while j < len(b) and b[j].start < one.stop:
            two = b[j]
            length = min(one.stop, two.stop) - max(one.start, two.start)
            shorter = min(one.stop - one.start, two.stop - two.start)
            if length > min(slack, shorter / 2):
                starts = one.start, two.start
                key = -length, abs(one.start - two.start), abs(one.stop - two.stop)
                candidates.append(((*key, min(starts), max(starts)), i, j))
            j += 1
    pairs = dict[int, int]()
    taken = set[int]()
    for _, i, j in sorted(candidates):
        if i not in pairs and j not in taken:
            pairs[i] = j
            taken.add(j)
    return pairs


def _near(
    a: Sequence[TimeSpan], b: Sequence[TimeSpan], pairs: dict[int, int], limit: float
) -> dict[int, int]:
    """Return further partners by the distance of their starts, the nearest first.

    The nearest two spans without a partner are always neighbours in time, so that only neighbours
    are candidates.
    """
    taken = set(pairs.values())
    free = [(span.start, 0, i) for i, span in enumerate(a) if i not in pairs]
    free += [(span.start, 1, j) for j, span in enumerate(b) if j not in taken]
    free.sort()
    before, after = list(range(-1, len(free) - 1)), list(range(1, len(free) + 1))
    used = [False] * len(free)
    heap = list[tuple[float, float, int, int]]()

    def consider(left: int, right: int) -> None:
        if left < 0 or right >= len(free) or free[left][1] == free[right][1]:
            return
        distance = free[right][0] - free[left][0]
        if distance <= limit:
            heapq.heappush(heap, (distance, free[left][0], left, right))

    for place in range(len(free) - 1):
        consider(place, place + 1)
    result = dict[int, int]()
    while heap:
        _, _, left, right = heapq.heappop(heap)
        if used[left] or used[right]:
            continue
        used[left] = used[right] = True
        ends = {free[place][1]: free[place][2] for place in (left, right)}
        result[ends[0]] = ends[1]
        outer_left, outer_right = before[left], after[right]
        if outer_left >= 0:
            after[outer_left] = outer_right
        if outer_right < len(free):
            before[outer_right] = outer_left
        consider(outer_left, outer_right)
    return result


class _Side:
    """The times when a recording is violated, unknown or not recorded."""

    def __init__(self, spans: RecordedSpans, tolerance: float, slack: float) -> None:
        self.limit, self._slack = tolerance + slack, slack
        self._satisfied = spans.satisfied
        self._recorded = spans.recorded
        outside = TimeSpan(-math.inf, spans.recorded.start), TimeSpan(spans.recorded.stop, math.inf)
        self._violated = _union(spans.violated, slack)
        self._not_satisfied = _union([*spans.violated, *spans.unknown, *outside], slack)

    def covers(self, span: TimeSpan) -> bool:
        """Return whether the recording is nowhere certainly satisfied in a span."""
        return self._contains(self._not_satisfied, span)

    def alone(self, span: TimeSpan, word: Literal["new", "gone"], *, ahead: bool) -> Status:
        """Return the status of a violation of the other recording that has no partner."""
        if self._contains(self._violated, span):
            return "part"
        if ahead and self._satisfied:
            return word
        return "undecided" if self.covers(span) else word

    def satisfied_in(self, span: TimeSpan) -> float:
        """Return for how long the recording is satisfied in a span."""
        return _outside(self._not_satisfied, span)

    def _contains(self, union: Sequence[TimeSpan], span: TimeSpan) -> bool:
        """Return whether one stretch contains a span, up to the tolerance at both ends.

        A stretch that only touches the span does not contain it. At the ends of the recorded time
        there is no tolerance, because nothing was violated or unknown outside.
        """
        place = max(bisect_right(union, span.start, key=lambda other: other.start) - 1, 0)
        while place < len(union) and union[place].start < span.stop:
            start, stop = union[place].start, union[place].stop
            common = min(stop, span.stop) - max(start, span.start)
            shorter = min(stop - start, span.stop - span.start)
            early = self._slack if start == self._recorded.stop else self.limit
            late = self._slack if stop == self._recorded.start else self.limit
            if common > min(self._slack, shorter / 2) and (
                start - span.start <= early and span.stop - stop <= late
            ):
                return True
            place += 1
        return False


def _union(spans: Iterable[TimeSpan], slack: float) -> list[TimeSpan]:
    """Return the stretches of spans with gaps of at most the slack, in order."""
    result = list[TimeSpan]()
    for start, stop, _ in sorted(spans):
        if result and start <= result[-1].stop + slack:
            result[-1] = TimeSpan(result[-1].start, max(result[-1].stop, stop))
        else:
            result.append(TimeSpan(start, stop))
    return result


def _outside(union: Sequence[TimeSpan], span: TimeSpan) -> float:
    """Return the length of the part of a span that is not in a union."""
    total, time = 0.0, span.start
    place = max(bisect_right(union, time, key=lambda other: other.start) - 1, 0)
    while place < len(union) and time < span.stop:
        other = union[place]
        total += max(min(other.start, span.stop) - time, 0.0)
        time = max(time, other.stop)
        place += 1
    return total + max(span.stop - time, 0.0)


def _status(sides: tuple[_Side, _Side], one: TimeSpan, two: TimeSpan) -> Status:
    """Return the status of partners of A and B."""
    limit = sides[0].limit
    later = two.stop - one.stop
    ends = (
        abs(later) <= limit
        or (one.censored and later >= -limit)
        or (two.censored and later <= limit)
    )
    if ends and abs(one.start - two.start) <= limit:
        return "same"
    growth = (two.stop - two.start) - (one.stop - one.start)
    if min(growth, sides[0].satisfied_in(two)) > limit:
        return "longer"
    if min(-growth, sides[1].satisfied_in(one)) > limit:
        return "shorter"
    return "moved"
