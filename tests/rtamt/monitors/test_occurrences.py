"""`rtamt.occurrences` and `rtamt.dense.occurrences`, against `judge` at every place."""

import functools
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from choices import ENDS, Backend
from dense_oracle import STEP
from dense_signals import Signals, relevant, signals
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from implying import aware
from interface_cases import Case
from occurrence_oracle import Expected, Judged, expected, order
from profiles import examples
from strategies import INTEGERS, Trace, formulas, length, rooted, traces
from uncertain_traces import Uncertain, uncertain_traces

import rtamt
from rtamt import Formula, InputError, UncertainValue, Verdict, judge, occurrences, parse
from rtamt.monitors import BodyOccurrences, Occurrences
from rtamt.typing import End


@functools.cache
@st.composite
def requirements(draw: st.DrawFn, *, dense: bool = False) -> Formula:
    """Formulas with bodies below ``always`` and ``and``."""
    below = formulas(2, endless=True, dense=dense)
    response = rooted("implies", 1, endless=True, dense=dense)
    answered = rooted("eventually", 0, endless=True, dense=dense) | rooted(
        "until", 0, endless=True, dense=dense
    )

    def divided(depth: int) -> Formula:
        match draw(st.sampled_from(("always", "window", "and") if depth else ("body",))):
            case "always":
                return divided(depth - 1).always()
            case "window":
                begin = draw(st.integers(0, 3))
                return divided(depth - 1).always(begin, begin + draw(st.integers(0, 4)))
            case "and":
                return divided(depth - 1) & divided(depth - 1)
        if draw(st.booleans()):
            return draw(below)
        left = draw(formulas(1, dense=dense))
        return left.implies(draw(answered)) if draw(st.booleans()) else draw(response)

    return divided(draw(st.integers(0, 3)))


def rows_of(body: BodyOccurrences, places: "Places") -> Expected:
    """Return the rows of a body as places."""
    return Expected(
        [
            (*places.run(row), order(row.robustness), places.at(row.worst_at))
            for row in body.violations
            if not row.unseen
        ],
        [places.run(row) for row in body.unknown],
        [
            (
                *places.run(row),
                row.verdict,
                None if math.isnan(row.answer_time) else row.answer_time,
                order(row.margin),
            )
            for row in body.responses
        ],
        [places.run(row) for row in body.unknown_triggers],
        [],
    )


class Places:
    """The places of sample numbers."""

    def __init__(self, last: int) -> None:
        self._last = last

    def at(self, time: float) -> int:
        return int(time)

    def run(self, row: Any) -> tuple[int, int]:  # noqa: ANN401 - a row of any kind
        assert row.duration == row.end - row.start
        assert not row.to_end or row.end == self._last
        assert (row.open_start, row.closed_end) == (False, row.to_end)
        return row.start, row.end - (not row.to_end)


def agrees(found: Occurrences, formula: Formula, trace: Judged) -> None:
    """Compare samples with the definition."""
    definition = expected(formula, trace)
    assert [body.text for body in found.bodies] == [*map(str, definition)]
    places = Places(trace.last)
    for body, its in zip(found.bodies, definition.values(), strict=True):
        assert rows_of(body, places) == its._replace(reads=[])
        assert body.length == len(its.reads)
        assert body.violated == sum(last - first + 1 for first, last, *_ in its.violations)


def laws(
    found: Occurrences, whole: rtamt.Judgement, at: Callable[[Formula, Any], rtamt.Judgement]
) -> None:
    """Check that the rows and the verdict agree."""
    assert (len(found) > 0) == (whole.verdict is Verdict.VIOLATED)
    for body in found.bodies:
        for row in body.violations:
            if row.unseen:
                its = at(parse(body.text).formula, row.start)
                assert len(body.violations) == 1
                assert its.verdict is Verdict.VIOLATED
                assert order(its.robustness) == order(row.robustness)
    if whole.verdict is Verdict.UNDECIDED:
        assert whole.unrecorded or any(len(body.unknown) for body in found.bodies)


def judged(trace: Any, n: int, end: End, **options: Any) -> Judged:  # noqa: ANN401
    semantics = options.pop("semantics", "standard")
    spec = options.pop("spec", None)

    def at(formula: Formula, place: int, semantics: Any = semantics) -> rtamt.Judgement:  # noqa: ANN401
        alone = formula.always(place, place)
        text = alone if spec is None else spec.with_result(alone)
        return judge(text, trace, end=end, n=n, semantics=semantics, **options)

    return Judged(at, functools.partial(at, semantics="standard"), n - 1, 1, 1)


@settings(max_examples=examples(50))
@given(formula=requirements(), trace=traces(most=9))
def test_matches_judge_at_each_sample(formula: Formula, trace: Trace, backend: Backend) -> None:
    n = length(trace)
    for end in ENDS:
        found = occurrences(formula, trace, end=end, n=n, backend=backend)
        places = judged(trace, n, end)
        agrees(found, formula, places)
        laws(found, judge(formula, trace, end=end, n=n), places.at)


@settings(max_examples=examples(40))
@given(formula=requirements(), trace=traces(most=7, values=INTEGERS))
def test_signs_of_zero(formula: Formula, trace: Trace) -> None:
    n = length(trace)
    for end in ENDS:
        found = occurrences(formula, trace, end=end, n=n)
        places = judged(trace, n, end)
        agrees(found, formula, places)
        laws(found, judge(formula, trace, end=end, n=n), places.at)


@settings(max_examples=examples(50))
@given(formula=requirements(), trace=uncertain_traces(most=7))
def test_unknown_samples(formula: Formula, trace: Uncertain) -> None:
    assume(formula.variables)
    columns = {
        name: UncertainValue(
            *np.array(
                [(v.lower, v.upper) if isinstance(v, UncertainValue) else (v, v) for v in column]
            ).T
        )
        for name, column in trace.items()
    }
    for end in ENDS:
        found = occurrences(formula, columns, end=end)
        places = judged(columns, len(trace["a"]), end)
        agrees(found, formula, places)
        laws(found, judge(formula, columns, end=end), places.at)


@settings(max_examples=examples(50))
@given(case=aware(requirements()), trace=traces(most=6))
def test_interface_aware_semantics(case: Case, trace: Trace) -> None:
    spec, semantics = case
    n = length(trace)
    for end in ENDS:
        found = occurrences(spec, trace, end=end, n=n, semantics=semantics)
        agrees(found, spec.formula, judged(trace, n, end, semantics=semantics, spec=spec))
        whole = judge(spec, trace, end=end, n=n, semantics=semantics)
        assert (len(found) > 0) == (whole.verdict is Verdict.VIOLATED)


@settings(max_examples=examples(50))
@given(
    response=rooted("implies", 1, endless=True),
    windows=st.lists(st.sampled_from(((0, None), (1, 3), (2, 2), (1, None))), min_size=1),
    trace=traces(most=9),
)
def test_responses_are_as_many_as_triggers(
    response: Formula, windows: list[tuple[int, int | None]], trace: Trace
) -> None:
    formula, n = response, length(trace)
    for window in windows[:2]:
        formula = formula.always(*window)
    for end in ENDS:
        (body,) = occurrences(formula, trace, end=end, n=n).bodies
        triggers = judge(formula, trace, end=end, n=n).triggers
        count = triggers[0].count if triggers and triggers[0].text == body.text else 0
        assert len(body.responses) == count


class DensePlaces:
    """The places of times from a start on."""

    def __init__(self, begin: float, last: int) -> None:
        self.begin, self._last = begin, last

    def time(self, place: int) -> float:
        return self.begin + place // 2 * STEP

    def row(self, first: int, last: int) -> tuple[float, float, float, bool, bool, bool]:
        start, end = self.time(first), self.time(last + 1)
        return start, end, end - start, last == self._last, first % 2 == 1, last % 2 == 0


def dense_agrees(found: Occurrences, formula: Formula, trace: Judged, begin: float) -> None:
    places = DensePlaces(begin, trace.last)
    definition = expected(formula, trace)
    assert [body.text for body in found.bodies] == [*map(str, definition)]
    for body, its in zip(found.bodies, definition.values(), strict=True):
        assert [
            (*row[:4], row.open_start, row.closed_end, order(row.robustness), row.worst_at)
            for row in body.violations
            if not row.unseen
        ] == [
            (*places.row(first, last), worst, places.time(where))
            for first, last, worst, where in its.violations
        ]
        assert [*body.unknown] == [places.row(*run) for run in its.unknown]
        assert [*body.unknown_triggers] == [places.row(*run) for run in its.unknown_triggers]
        assert [
            (
                *(*row[:4], row.open_start, row.closed_end, row.verdict),
                None if math.isnan(row.answer_time) else row.answer_time,
                order(row.margin),
            )
            for row in body.responses
        ] == [
            (*places.row(first, last), verdict, None if time is None else time * STEP, margin)
            for first, last, verdict, time, margin in its.responses
        ]
        assert body.length == STEP * sum(place % 2 for place in its.reads)


@settings(max_examples=examples(40))
@given(formula=requirements(dense=True), whole=signals())
def test_dense_time_matches_judge_at_each_place(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    assume(formula.variables)
    its = relevant(whole, formula.variables)
    begin = max(events[0][0] for events in its.values())
    last = round(2 * (min(events[-1][0] for events in its.values()) - begin) / STEP)
    # A body with fewer variables has the same extent with a formula that is always +inf.
    keep = parse(" and ".join(f"({name} implies true)" for name in its)).formula
    for end in ENDS:
        found = rtamt.dense.occurrences(formula, its, end, backend=backend)

        def at(part: Formula, place: int, end: End = end) -> rtamt.Judgement:
            time = place * STEP / 2
            return rtamt.dense.judge(part.always(time, time) & keep, its, end)

        dense_agrees(found, formula, Judged(at, at, last, round(2 / STEP), 2), begin)
        whole_ = rtamt.dense.judge(formula, its, end)
        laws(found, whole_, lambda part, time: at(part, round(2 * (time - begin) / STEP)))


def test_an_unseen_violation_is_one_row() -> None:
    (row,) = occurrences("always[0:9](prev(x > 0))", {"x": [1, 1, -4]}, period=0.5)
    assert row == (1.5, 1.5, 0.0, False, -4.0, 1.5, True, False, True)
    assert judge("always[0:9](prev(x > 0))", {"x": [1, 1, -4]}).verdict is Verdict.VIOLATED
    assert not len(occurrences("always[0:9](prev(x > 0))", {"x": [1, 1, -4]}, end="open"))


def test_an_unseen_violation_in_dense_time_needs_every_future() -> None:
    """Any values may follow, also for a formula that reads only the past."""
    body = "((x > 0 or once[1:1](y > 0)) and once[2:2](z > 0)) or once[3:3](y > 0)"
    trace = {"x": [(0, 1), (4, 1)], "y": [(0, -1), (4, -1)], "z": [(0, 1), (3, -1), (4, 1)]}
    (row,) = rtamt.dense.occurrences(f"always[4:9]({body})", trace)
    assert (row.start, row.robustness, row.unseen) == (5.0, -1.0, True)
    verdicts = [
        rtamt.dense.judge(f"always[{time}:{time}]({body})", trace).verdict.name
        for time in (4, 4.5, 5)
    ]
    assert verdicts == ["SATISFIED", "UNDECIDED", "VIOLATED"]
    (row,) = rtamt.dense.occurrences("always[5:9](historically(z > 1))", {"z": [(0, 1), (4, 1)]})
    assert row.robustness == rtamt.dense.judge("historically(z > 1)", {"z": [(0, 1)]}).robustness


def test_dense_runs_state_whether_their_ends_belong_to_them() -> None:
    trace = {"x": [(0, -1), (1.5, 0), (2.5, 2), (5, 2)]}
    found = rtamt.dense.occurrences("always[0:4.5](eventually[0:2](x < 1))", trace)
    (violated,), (unknown,) = found.bodies[0].violations, found.bodies[0].unknown
    assert (violated.start, violated.open_start) == (2.5, False)
    assert (violated.end, violated.closed_end) == (3.0, True)
    assert (unknown.start, unknown.open_start) == (3.0, True)
    assert (unknown.end, unknown.to_end, unknown.closed_end) == (4.5, False, True)


def test_equal_bodies_are_one_list() -> None:
    found = occurrences("always[0:1](x > 0) and always[2:3](x > 0)", {"x": [1, -1, -2, 3, -1]})
    (body,) = found.bodies
    assert [row[:4] for row in body.violations] == [(1, 3, 2, False)]
    assert (body.length, body.violated) == (4, 2)


def test_any_other_root_is_read_at_the_start() -> None:
    found = occurrences("x > 0", {"x": [-1, -2, 3]})
    assert found.at_start
    assert [row[:2] for row in found] == [(0, 1)]
    assert str(found).endswith("evaluated at the first instant only; always(...) covers the trace")


def test_statistics_and_columns() -> None:
    trace = {"req": [0, 4, 0, 0, 4, 0, 0, 4], "gnt": [0, 0, 5, 0, 0, 0, 0, 0]}
    found = occurrences("always(req >= 3 implies eventually[0:1](gnt >= 3))", trace, period="500ms")
    (body,) = found.bodies
    assert body.share == 1 / 8
    assert body.per_hour == 3600 / 4
    assert body.answer_times.tolist() == [0.5]
    assert body.outcomes == {Verdict.VIOLATED: 1, Verdict.UNDECIDED: 1, Verdict.SATISFIED: 1}
    assert body.responses.columns["verdict"].tolist() == [1, -1, 0]
    assert body.responses[1:][0].verdict is Verdict.VIOLATED
    assert body.unknown[0] == (3.5, 3.5, 0.0, True, False, True)
    assert pickle.loads(pickle.dumps(found)) == found


def test_dates_stay_dates() -> None:
    times = np.array(["2024-01-01T00:00:00", "2024-01-01T00:00:02", "2024-01-01T00:00:05"], "M8[s]")
    events = rtamt.dense.Events(times, [1.0, 7.0, 2.0])
    (row,) = rtamt.dense.occurrences("always(x < 5)", {"x": events})
    assert (row.start, row.end, row.duration) == (times[1], times[2], 3.0)


def test_errors_are_those_of_judge() -> None:
    with pytest.raises(InputError, match=r"^expected end='complete', 'cut' or 'open', got 'late'$"):
        occurrences("x > 0", {"x": [1]}, end="late")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^occurrences\(\) got an unexpected keyword argument"):
        occurrences(parse("x > 0"), {"x": [1]}, perod=1)  # type: ignore[call-arg]
