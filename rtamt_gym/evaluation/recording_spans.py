"""The violations of recordings as spans on one clock, for `rtamt_gym.results.span_matching`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

from rtamt.monitors import BodyOccurrences, RunTable
from rtamt_gym.results.outcome import Outcome
from rtamt_gym.results.span_matching import RecordedSpans, TimeSpan
from rtamt_gym.results.trial import Trial


@dataclass(frozen=True, slots=True)
class RequirementClock:
    """The times at which a requirement was evaluated on a recording.

    Attributes:
        begin: The start of the recording; 0 if it has no times.
        first: The start of the trace of the requirement.
        last: The last time.
        step: The time that the last sample stands for; in dense time as short as possible.
    """

    begin: float
    first: float
    last: float
    step: float

    @classmethod
    def of(cls, row: Trial, outcome: Outcome) -> Self:
        """Return the clock of a requirement on a recording."""
        extent = row.extent
        if extent is None:
            return cls(0.0, -math.inf, math.inf, 0.0)
        if extent.begin is None or extent.end is None:  # bounds count samples
            return cls(0.0, 0.0, float((extent.samples or 1) - 1), 1.0)
        late = outcome.late_start
        first = extent.begin if late is None else late.judged
        step = math.nextafter(extent.end, math.inf) - extent.end
        if extent.period is not None:
            step = float(extent.period)
        return cls(extent.begin, first, extent.end, step)

    @property
    def length(self) -> float:
        """The length of the recording."""
        return self.last - self.begin


def recorded_spans(
    body: BodyOccurrences, clock: RequirementClock, shift: float, *, satisfied: bool
) -> RecordedSpans:
    """Return the spans of a body, later by a shift.

    A sample stands for a period, also the last one. An instant of dense time is a span to the next
    floating-point number.

    Args:
        body: The occurrences.
        clock: The times of the recording.
        shift: The shift, in the unit of the times.
        satisfied: Whether the recording satisfies the requirement.
    """
    unseen = body.violations.columns["unseen"].tolist()
    return RecordedSpans(
        [*_spans(body.violations, clock, shift, unseen)],
        [*_spans(body.unknown, clock, shift)],
        _span(clock.first + shift, clock.last + clock.step + shift),
        unseen.index(True) if any(unseen) else None,
        satisfied,
    )


def _spans(
    table: RunTable[Any], clock: RequirementClock, shift: float, unseen: list[bool] | None = None
) -> Iterator[TimeSpan]:
    names = "start", "end", "to_end", "open_start", "closed_end"
    columns = (table.columns[name].tolist() for name in names)
    ahead = unseen or [False] * len(table)
    for start, end, to_end, opened, closed, after in zip(*columns, ahead, strict=True):
        censored = to_end or after
        first, stop = float(start) + shift, float(end) + shift
        if censored:
            stop += clock.step
        elif closed:
            stop = math.nextafter(stop, math.inf)
        yield _span(math.nextafter(first, math.inf) if opened else first, stop, censored=censored)


def _span(start: float, stop: float, *, censored: bool = False) -> TimeSpan:
    return TimeSpan(start, stop if stop > start else math.nextafter(start, math.inf), censored)
