"""Progress in stages: its laws, an independent definition, and its errors."""

import math
import pickle
from typing import Any, Literal, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from staged import NAMES, End, Rows, decided, progress, verdict
from strategies import Trace, formulas, length, traces

import rtamt
from rtamt import (
    Formula,
    InputError,
    InputTypeError,
    ParseError,
    Specification,
    SpecificationError,
    Verdict,
)
from rtamt.patterns import in_order, prefixes, stages
from rtamt_gym.judging.monitor_set import MonitorSet
from rtamt_gym.judging.stages import progress_of, progress_of_events, stages_of
from rtamt_gym.judging.vector_monitor_set import VectorMonitorSet
from rtamt_gym.options.evaluation import EvaluationOptions

READS = rtamt.parse("always(a + b + c > 1e9)").formula
"""Has no effect on a disjunction, and reads every variable."""

TASK = rtamt.parse("near = a > 0; limit = 2; eventually always[0:1](near and b >= limit and c > 0)")

Kind = Literal["shape", "named"]
both_kinds = pytest.mark.parametrize("kind", ["shape", "named"])


class Task(NamedTuple):
    """A requirement, its stages, their deciding formulas, and the options that name them."""

    formula: Formula
    stages: list[Formula]
    deciders: list[Formula]
    reading: EvaluationOptions

    @property
    def spec(self) -> Specification:
        return Specification.of(self.formula)

    def expected(self, rows: Rows, end: End | None) -> list[float]:
        """Return the progress after every sample, and after the end."""
        return progress(self.formula, self.stages, self.deciders, rows, end)


@st.composite
def conditions(draw: st.DrawFn) -> list[Formula]:
    """Stages, all with or all without temporal operators."""
    return draw(st.lists(formulas(draw(st.integers(0, 1))), min_size=2, max_size=4))


@st.composite
def requirements(draw: st.DrawFn) -> Formula:
    """Requirements of any shape that a goal can have."""
    return draw(formulas(1)).eventually() | READS


@st.composite
def tasks(draw: st.DrawFn, kind: Kind) -> Task:
    """Requirements whose shape has stages, or of any shape with named stages."""
    wanted = draw(conditions())
    if kind == "shape":  # with and without a time for each stage
        formula = in_order(*wanted, within=draw(st.sampled_from([None, 1, 3])))
        return Task(formula, [*stages(formula)], [*prefixes(formula)], EvaluationOptions())
    longer = [in_order(*wanted[:count]) for count in range(2, len(wanted) + 1)]
    deciders = [wanted[0].eventually(), *longer]
    return Task(draw(requirements()), wanted, deciders, EvaluationOptions(stages={"task": wanted}))


def rows_of(trace: Trace) -> list[tuple[float, ...]]:
    return [tuple(trace[name][i] for name in NAMES) for i in range(length(trace))]


def fed(monitor_set: MonitorSet, rows: Rows) -> list[float]:
    """Return the progress after every sample."""
    feed = monitor_set.feeder(NAMES)
    values = []
    for row in rows:
        feed(row)
        values.append(monitor_set.progress["task"])
    return values


def played(
    spec: Specification, rows: Rows, end: End = "complete", reading: EvaluationOptions | None = None
) -> list[float]:
    """Return the progress in one environment, after every sample and after the end."""
    monitor_set = MonitorSet({"task": spec}, reading or EvaluationOptions())
    values = fed(monitor_set, rows)
    monitor_set.finish(end)
    return [*values, monitor_set.progress["task"]]


@both_kinds
@pytest.mark.parametrize("end", ["complete", "cut", "open"])
def test_progress_matches_the_oracle(end: End, kind: Kind) -> None:
    @settings(max_examples=examples(40))
    @given(tasks(kind), traces())
    def check(task: Task, trace: Trace) -> None:
        rows = rows_of(trace)
        values = played(task.spec, rows, end, task.reading)
        assert values == sorted(values)
        for t, now in enumerate(values[:-1] if kind == "shape" else ()):
            assert (now == 1) is (verdict(task.formula, rows[: t + 1]) is Verdict.SATISFIED)
            number, count = decided(task.deciders, rows[: t + 1]), len(task.stages)
            assert now == 1 or number / count <= now < (number + 1) / count
        assert (values[-1] == 1) is (verdict(task.formula, rows, end) is Verdict.SATISFIED)
        assert values == pytest.approx(task.expected(rows, end), rel=1e-15, abs=0)

    check()


@both_kinds
def test_batch_progress_matches_single_environments(kind: Kind) -> None:
    @settings(max_examples=examples(30))
    @given(tasks(kind), st.lists(traces(), min_size=3, max_size=3), st.booleans())
    def check(task: Task, several: list[Trace], other: bool) -> None:  # noqa: FBT001 - drawn
        specs = {"task": task.spec, "calm": rtamt.parse("always(a < 9)")}
        if other:
            specs["other"] = rtamt.parse("eventually(b > 0 and eventually(c > 0))")
        batch = VectorMonitorSet(specs, 3, task.reading, NAMES)
        episodes = [rows_of(trace) for trace in several]
        single = [MonitorSet(specs, task.reading) for _ in episodes]
        feeds = [monitor_set.feeder(NAMES) for monitor_set in single]
        for t in range(max(map(len, episodes))):
            running = np.array([t < len(rows) for rows in episodes])
            batch.feed(np.array([rows[min(t, len(rows) - 1)] for rows in episodes]), running)
            for env in running.nonzero()[0].tolist():
                feeds[env](episodes[env][t])
            ends = np.array([t == len(rows) - 1 for rows in episodes])
            batch.finish(ends)
            for env in ends.nonzero()[0].tolist():
                single[env].finish()
            assert batch.least_progress is not None
            for env, monitor_set in enumerate(single):
                assert {k: v[env] for k, v in batch.progress.items()} == monitor_set.progress
                assert batch.least_progress[env] == monitor_set.least_progress
        assert set(batch.progress) == ({"task", "other"} if other else {"task"})
        batch.reset(np.array([False, True, False]))
        left = batch.progress["task"].tolist()
        assert left == [single[0].progress["task"], 0, single[2].progress["task"]]

    check()


@both_kinds
@pytest.mark.parametrize("end", ["complete", "cut"])
def test_trace_progress_matches_its_run(end: End, kind: Kind) -> None:
    @settings(max_examples=examples(20))
    @given(tasks(kind), traces())
    def check(task: Task, trace: Trace) -> None:
        if not task.spec.variables:
            return
        columns = {name: np.array(values) for name, values in trace.items()}
        reading = task.reading.about("task").having(end=end)
        last = played(task.spec, rows_of(trace), end, task.reading)[-1]
        assert progress_of(task.spec, columns, reading) == last

    check()
    assert progress_of(rtamt.parse("always(a > 0)"), {"a": np.ones(2)}, EvaluationOptions()) is None


@settings(max_examples=examples(30))
@given(tasks("shape"), st.lists(traces(least=2), min_size=2, max_size=2), st.data())
def test_held_value_counts_like_a_repeated_value(
    task: Task, several: list[Trace], data: st.DataObject
) -> None:
    spec = {"task": task.spec}
    hold = EvaluationOptions(nan="hold")
    monitor_set, many = (
        MonitorSet(spec, EvaluationOptions()),
        VectorMonitorSet(spec, 2, hold, NAMES),
    )
    holding = MonitorSet(spec, hold)
    feed, feed_holding = monitor_set.feeder(NAMES), holding.feeder(NAMES)
    for trace in several:  # one episode after the other
        last: list[float] = []
        for row in rows_of(trace):
            lost = data.draw(
                st.sets(st.sampled_from(range(len(NAMES)))) if last else st.just(set())
            )
            last = [last[i] if i in lost else value for i, value in enumerate(row)]
            gappy = [math.nan if i in lost else value for i, value in enumerate(row)]
            feed(last)
            feed_holding(gappy)
            many.feed(np.array([gappy, gappy]))
            assert holding.progress == monitor_set.progress
            assert many.progress["task"].tolist() == [monitor_set.progress["task"]] * 2
        for each in (monitor_set, holding, many):
            each.reset()


def test_reset_forgets_held_values() -> None:
    many = VectorMonitorSet(
        {"task": rtamt.parse("eventually(a > 0 and eventually(b > 0))")},
        2,
        EvaluationOptions(nan="hold"),
        "ab",
    )
    many.feed(np.array([[1.0, 1.0], [-1.0, -1.0]]))
    many.reset(np.array([True, False]))
    with pytest.raises(rtamt.InputError, match="'a' is nan at sample 0"):
        many.feed(np.array([[math.nan, 1.0], [math.nan, 1.0]]))


def test_stage_starts_after_the_previous_stage() -> None:
    spec = rtamt.parse("eventually(a > 0 and eventually(b > 0 and eventually(c > 0)))")
    rows = [
        (-4, -4, -4),  # a starts at -4
        (-1, 9, 9),  # three quarters of stage 1; b and c are too early
        (1, -2, 3),  # stage 1; b starts at -2
        (0, -1, 1),
        (0, 0, 1),  # b > 0 does not hold at 0, however near it is
        (0, 1, -9),  # stage 2; c starts at -9, although it held before
        (0, 0, 1),
    ]
    thirds = [0, 0.75, 1, 1.5, 2, 2, 3, 3]
    found = played(spec, rows, "complete")
    assert found == pytest.approx([third / 3 for third in thirds])
    assert found[4] == math.nextafter(2 / 3, 0)
    assert found[-1] == 1


def test_end_mode_decides_stages() -> None:
    spec = rtamt.parse("eventually(a > 0 and eventually always[0:3](b > 0))")
    rows = [(1.0, 1.0, 0.0), (1.0, 1.0, 0.0)]
    almost = math.nextafter(1.0, 0.0)  # the past holds, but is not certain
    assert played(spec, rows, "complete") == [almost, almost, 1.0]
    assert played(spec, rows, "cut") == [almost, almost, almost]
    columns = {"a": np.ones(2), "b": np.ones(2)}
    assert progress_of(spec, columns, EvaluationOptions(end="complete")) == 1.0
    assert progress_of(spec, columns, EvaluationOptions(end="cut")) == almost


def test_failure_keeps_progress() -> None:
    monitor_set = MonitorSet(
        {"task": rtamt.parse("eventually(a > 0 and eventually(b > 0))")}, EvaluationOptions()
    )
    monitor_set.feeder(NAMES)((1.0, -1.0, 0.0))
    monitor_set.finish("failure")
    assert monitor_set.progress == {"task": 0.5}
    assert monitor_set.violated_by == "task"


def test_boolean_progress_moves_by_stages() -> None:
    spec = rtamt.parse("eventually(a > 0 and eventually(b > 0))")
    rows = [(-4, -4, 0), (-1, -4, 0), (1, -4, 0), (0, -1, 0), (0, 1, 0)]
    monitor_set = MonitorSet({"task": spec}, EvaluationOptions(semantics="boolean"))
    assert fed(monitor_set, rows) == [0, 0, 0.5, 0.5, 1]


@pytest.mark.parametrize("view", ["episode", "step"])
def test_requirements_without_stages_have_no_progress(view: Any) -> None:  # noqa: ANN401 - a literal
    specs = {
        "near": rtamt.parse("eventually[0:5](a > 0)"),
        "calm": rtamt.parse("always(a < 9)"),
    }
    if view == "step":
        specs = {"task": rtamt.parse("eventually[0:2](a > 0 and eventually[0:2](b > 0))")}
    monitor_set = MonitorSet(specs, EvaluationOptions(view=view))
    vector = VectorMonitorSet(specs, 2, EvaluationOptions(view=view), NAMES)
    assert monitor_set.progress == vector.progress == {}
    assert (monitor_set.least_progress, vector.least_progress) == (None, None)
    assert (monitor_set._stages, vector._stages) == ({}, {})


def test_stage_holds_earlier_values() -> None:
    spec, nan = rtamt.parse("eventually(a > 0 and eventually(b > 0))"), math.nan
    rows = [(-1.0, -4.0, 0.0), (1.0, nan, 0.0), (1.0, nan, 0.0), (1.0, -1.0, 0.0)]
    assert fed(MonitorSet({"task": spec}, EvaluationOptions(nan="hold")), rows) == [
        0,
        0.5,
        0.5,
        0.875,
    ]


@pytest.mark.parametrize(
    ("nan", "before", "between", "after"),
    [
        (
            "raise",
            (1.0, -4.0, 0.0),
            [(0.0, -2.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0)],
            [((0.0, -2.0, 0.0), 0.75), ((0.0, 1.0, 0.0), 1.0)],
        ),
        (
            "hold",
            (-1.0, -4.0, 0.0),
            [(-1.0, -8.0, 0.0)],
            [((1.0, math.nan, 0.0), 0.5), ((1.0, -1.0, 0.0), 0.875)],
        ),
    ],
)
def test_state_restores_progress_and_held_values(
    nan: Literal["raise", "hold"],
    before: tuple[float, ...],
    between: list[tuple[float, ...]],
    after: list[tuple[tuple[float, ...], float]],
) -> None:
    specs = {"task": rtamt.parse("eventually(a > 0 and eventually(b > 0))")}
    monitor_set, other = (MonitorSet(specs, EvaluationOptions(nan=nan)) for _ in range(2))
    feed, feed_other = monitor_set.feeder(NAMES), other.feeder(NAMES)
    feed(before)
    state = pickle.loads(pickle.dumps(monitor_set.state()))
    for row in between:
        feed(row)
    monitor_set.restore(state)
    other.restore(state)
    for row, progressed in after:
        feed(row)
        feed_other(row)
        assert monitor_set.progress == other.progress == {"task": progressed}


@settings(max_examples=examples(30))
@given(conditions(), traces())
def test_named_stages_equal_found_stages(wanted: list[Formula], trace: Trace) -> None:
    spec = Specification.of(in_order(*wanted))
    if len(spec.variables) < len(NAMES):
        return
    rows = rows_of(trace)
    named = EvaluationOptions(stages={"task": stages(spec)})
    assert played(spec, rows, "complete", named) == played(spec, rows)


@settings(max_examples=examples(60))
@given(requirements(), st.lists(formulas(0), min_size=2, max_size=4), traces(), st.data())
def test_event_progress_matches_samples(
    whole: Formula, wanted: list[Formula], trace: Trace, data: st.DataObject
) -> None:
    """A value equal to the previous sample is omitted; times may be any that rise."""
    n = length(trace)
    steps = data.draw(st.lists(st.sampled_from([0.1, 0.5, 3.0]), min_size=n, max_size=n))
    times = np.cumsum(steps)
    events = {}
    for name, values in trace.items():
        kept = [i for i in range(n) if i in (0, n - 1) or values[i] != values[i - 1]]
        events[name] = times[kept], np.array(values)[kept]
    spec = Specification.of(whole)
    columns = {name: np.array(values) for name, values in trace.items()}
    reading = EvaluationOptions(stages=wanted)
    unmet = rtamt.parse("false or always(a + b + c > 1e9)")
    sampled = progress_of(unmet, columns, reading)
    assert progress_of_events(spec, events, reading, satisfied=False) == sampled
    assert progress_of_events(spec, events, reading, satisfied=True) == 1


def test_timed_stages_have_no_dense_progress() -> None:
    events = {name: (np.array([0.0, 1.0]), np.array([1.0, 1.0])) for name in NAMES}
    for text in (
        "eventually(a > 0 and eventually[0:2](b > 0))",
        "eventually(always[0:2](a > 0) and eventually(b > 0))",
    ):
        spec = rtamt.parse(text)
        assert progress_of_events(spec, events, EvaluationOptions(), satisfied=True) is None


def test_stages_may_use_names_of_the_specification() -> None:
    found = stages_of(
        {"task": TASK}, EvaluationOptions(stages=["near", "b >= limit", "c > limit / 2"])
    )
    texts = [str(each) for each in found["task"].conditions]
    assert texts == ["a > 0", "b >= 2", "c > 2 / 2"]


def test_early_satisfaction_completes_progress() -> None:
    spec = rtamt.parse("eventually(a > 0) or always(b + c > 1e9)")
    reading = EvaluationOptions(stages=["b > 0", "c > 0"])
    rows = [(-1, -4, 0), (-1, -1, 0), (1, -1, 0), (1, 1, 1)]
    assert played(spec, rows, "complete", reading) == [0, 0.375, 1, 1, 1]


def test_all_stages_without_satisfaction_stay_below_one() -> None:
    spec = rtamt.parse("eventually always(a > 0 and b > 0)")
    reading = EvaluationOptions(stages=["a > 0", "b > 0"])
    almost = math.nextafter(1.0, 0.0)
    assert played(spec, [(1, 1, 0), (1, -1, 0)], "complete", reading) == [almost, almost, almost]
    assert played(spec, [(1, 1, 0), (1, 1, 0)], "complete", reading) == [almost, almost, 1]


def test_nan_hold_applies_to_stages() -> None:
    spec = rtamt.parse("eventually(a > 0 and eventually(b > 0 and eventually(c > 0)))")
    rows = [(1, -4, -1), (math.nan, math.nan, -1), (math.nan, -1, math.nan), (0, 1, -0.5)]
    held = [(1, -4, -1), (1, -4, -1), (1, -1, -1), (0, 1, -0.5)]
    known = played(spec, held)
    assert played(spec, rows, "complete", EvaluationOptions(nan="hold")) == known
    monitor_set = VectorMonitorSet({"task": spec}, 2, EvaluationOptions(nan="hold"), NAMES)
    found = []
    for row in rows:
        monitor_set.feed(np.array([row, row]))
        found.append(monitor_set.progress["task"].tolist())
    assert found == [[each, each] for each in known[:-1]]


@pytest.mark.parametrize("vector", [False, True])
@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ({"tsak": ["a > 0", "b > 0"]}, InputError, "did you mean 'task'"),
        (["a > 0"], InputError, "expected two or more stages=, got 1"),
        ("a > 0", InputTypeError, "expected stages= as a list of formulas"),
        ([1, 2], InputTypeError, "expected formulas or their texts in stages=, got 1"),
        ({"task": ["a > 0", "b >"]}, ParseError, ""),
        (["a > 0", "d > 0"], SpecificationError, "stage 2, d > 0, reads d, which the requirement"),
    ],
)
def test_stages_errors(
    given: Any,  # noqa: ANN401 - what is wrong
    error: type[Exception],
    said: str,
    vector: bool,  # noqa: FBT001
) -> None:
    def made() -> object:
        reading, specs = EvaluationOptions(stages=given), {"task": TASK}
        return VectorMonitorSet(specs, 2, reading, NAMES) if vector else MonitorSet(specs, reading)

    with pytest.raises(error) as caught:
        made()
    assert said in str(caught.value)
    if error is ParseError:
        assert caught.value.__notes__ == ["in stage 2", "in the stages of 'task'"]


def test_stages_need_one_requirement_and_episodes() -> None:
    specs = {"task": TASK, "calm": rtamt.parse("always(a < 9)")}
    with pytest.raises(InputError, match=r"write \{'task': \[...\]\}"):
        MonitorSet(specs, EvaluationOptions(stages=["a > 0", "b > 0"]))
    step = EvaluationOptions(view="step", stages=["a > 0", "b > 0"])
    with pytest.raises(InputError, match="view='step' evaluates every instant by itself"):
        MonitorSet({"calm": specs["calm"]}, step)


def test_any_number_of_instant_stages() -> None:
    texts = [f"a > {number}" for number in range(20)]
    spec = rtamt.parse("eventually(a > 19 and b > 0 and c > 0)")
    rows = [(number + 0.5, 0, 0) for number in range(20)]
    found = played(spec, rows, "complete", EvaluationOptions(stages=texts))
    assert found[9] == pytest.approx(10 / 20 + 0.0, abs=1 / 20)
    assert found[-1] == math.nextafter(1.0, 0.0)
