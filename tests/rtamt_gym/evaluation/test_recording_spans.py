"""Spans of dense recordings contain exactly the instants of their runs."""

import math

import numpy as np
import pytest

from rtamt.monitors import BodyOccurrences, Occurrence, Response, RunTable, UnknownRun
from rtamt_gym.evaluation.recordings import RequirementClock, recorded_spans
from rtamt_gym.results.span_matching import RecordedSpans, match_spans

CLOCK = RequirementClock(0.0, 0.0, 10.0, math.nextafter(10.0, math.inf) - 10.0)


def body_of(run: Occurrence) -> BodyOccurrences:
    """A body with one violation."""
    violations = RunTable(Occurrence, {n: np.array([c]) for n, c in run._asdict().items()})
    unknown, triggers = (
        RunTable(UnknownRun, {name: np.empty(0) for name in UnknownRun._fields}) for _ in range(2)
    )
    responses = RunTable(Response, {name: np.empty(0) for name in Response._fields})
    return BodyOccurrences("x < 1", violations, unknown, responses, triggers, 10.0, 1.0, "s")


def spans(start: float, end: float, *, opened: bool = False, closed: bool = False) -> RecordedSpans:
    run = Occurrence(
        start,
        end,
        end - start,
        to_end=end == 10,
        robustness=-1.0,
        worst_at=start,
        unseen=False,
        open_start=opened,
        closed_end=closed,
    )
    return recorded_spans(body_of(run), CLOCK, 0.0, satisfied=False)


@pytest.mark.parametrize("opened", [False, True])
@pytest.mark.parametrize(("end", "closed"), [(5.0, False), (5.0, True), (10.0, True)])
def test_span_has_the_instants_of_its_run(end: float, *, opened: bool, closed: bool) -> None:
    (span,) = spans(2.0, end, opened=opened, closed=closed).violated
    assert (span.start <= 2.0) == (not opened)
    assert (end < span.stop) == closed
    assert span.start <= math.nextafter(2.0, 3.0) < math.nextafter(end, 0.0) < span.stop
    assert span.censored == (end == 10)


@pytest.mark.parametrize(("closed", "status"), [(False, "new"), (True, "shorter")])
def test_instant_at_the_end_of_a_run(status: str, *, closed: bool) -> None:
    found = match_spans(spans(2.0, 5.0, closed=closed), spans(5.0, 5.0, closed=True), 0.0)
    assert found.of_b == (status,)


def test_shift_moves_the_recording_and_its_runs() -> None:
    run = Occurrence(2.0, 5.0, 3.0, False, -1.0, 2.0, False)  # noqa: FBT003 - fields of a row
    moved = recorded_spans(body_of(run), CLOCK, 7.0, satisfied=True)
    assert [(span.start, span.stop) for span in moved.violated] == [(9.0, 12.0)]
    assert (moved.recorded.start, moved.satisfied) == (7.0, True)
