"""Progress in stages: its laws, and its definition written down once more, from scratch."""

import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from staged import NAMES, End, Rows, decided, progress, verdict
from strategies import Trace, formulas, length, traces

import rtamt
from rtamt import Formula, Specification, Verdict
from rtamt.patterns import in_order, prefixes, stages
from rtamt_gym.judging.panel import Panel
from rtamt_gym.judging.stages import progress_of
from rtamt_gym.judging.vector_panel import VectorPanel
from rtamt_gym.options.evaluation import Reading


@st.composite
def requirements(draw: st.DrawFn) -> Formula:
    """Stages of any operators, with and without a time for each."""
    parts = draw(st.lists(formulas(draw(st.integers(0, 1))), min_size=2, max_size=4))
    return in_order(*parts, within=draw(st.sampled_from([None, 1, 3])))


def expected(formula: Formula, rows: Rows, end: End | None) -> list[float]:
    """The progress after every sample, and after the end."""
    return progress(formula, stages(formula), prefixes(formula), rows, end)


def rows_of(trace: Trace) -> list[tuple[float, ...]]:
    return [tuple(trace[name][i] for name in NAMES) for i in range(length(trace))]


def played(spec: Specification, rows: Rows, end: End) -> list[float]:
    """The progress that the monitors of one environment give."""
    panel = Panel({"task": spec}, Reading())
    feed = panel.feeder(NAMES)
    found = []
    for row in rows:
        feed(row)
        found.append(panel.progress["task"])
    panel.finish(end)
    return [*found, panel.progress["task"]]


@pytest.mark.parametrize("end", ["complete", "cut"])
def test_progress_is_its_definition_and_keeps_its_laws(end: End) -> None:
    @settings(max_examples=examples(40))
    @given(requirements(), traces())
    def check(formula: Formula, trace: Trace) -> None:
        rows = rows_of(trace)
        spec = Specification.of(formula)
        found = played(spec, rows, end)
        assert found == sorted(found)
        for t, came in enumerate(found[:-1]):
            assert (came == 1) is (verdict(formula, rows[: t + 1]) is Verdict.SATISFIED)
            number, count = decided(prefixes(formula), rows[: t + 1]), len(stages(formula))
            assert came == 1 or number / count <= came < (number + 1) / count
        assert (found[-1] == 1) is (verdict(formula, rows, end) is Verdict.SATISFIED)
        assert found == pytest.approx(expected(formula, rows, end), rel=1e-15, abs=0)

    check()


@settings(max_examples=examples(30))
@given(requirements(), st.lists(traces(), min_size=3, max_size=3), st.booleans())
def test_many_environments_have_the_progress_of_one(
    formula: Formula,
    several: list[Trace],
    both: bool,  # noqa: FBT001 - drawn
) -> None:
    specs = {"task": Specification.of(formula), "calm": rtamt.parse("always(a < 9)")}
    if both:
        specs["other"] = rtamt.parse("eventually(b > 0 and eventually(c > 0))")
    panel = VectorPanel(specs, 3, Reading(), NAMES)
    rows = [rows_of(trace) for trace in several]
    alone = [Panel(specs, Reading()) for _ in rows]
    feeds = [each.feeder(NAMES) for each in alone]
    for t in range(max(map(len, rows))):
        lanes = np.array([t < len(each) for each in rows])
        panel.feed(np.array([each[min(t, len(each) - 1)] for each in rows]), lanes)
        for lane in lanes.nonzero()[0].tolist():
            feeds[lane](rows[lane][t])
        ends = np.array([t == len(each) - 1 for each in rows])
        panel.finish(ends)
        for lane in ends.nonzero()[0].tolist():
            alone[lane].finish()
        for lane, each in enumerate(alone):
            assert {k: v[lane] for k, v in panel.progress.items()} == each.progress
            assert panel.least_progress is not None
            assert panel.least_progress[lane] == each.least_progress
    assert set(panel.progress) == {"task", "other"} if both else {"task"}
    panel.reset(np.array([False, True, False]))
    kept = panel.progress["task"]
    assert kept[1] == 0
    assert [kept[0], kept[2]] == [alone[0].progress["task"], alone[2].progress["task"]]


@settings(max_examples=examples(30))
@given(requirements(), st.lists(traces(least=2), min_size=2, max_size=2), st.data())
def test_a_value_that_is_held_counts_as_if_it_came_again(
    formula: Formula, several: list[Trace], data: st.DataObject
) -> None:
    spec = {"task": Specification.of(formula)}
    hold = Reading(nan="hold")
    panel, many = Panel(spec, Reading()), VectorPanel(spec, 2, hold, NAMES)
    holding = Panel(spec, hold)
    feed, feed_holding = panel.feeder(NAMES), holding.feeder(NAMES)
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
            assert holding.progress == panel.progress
            assert many.progress["task"].tolist() == [panel.progress["task"]] * 2
        for each in (panel, holding, many):
            each.reset()


def test_an_episode_holds_no_value_of_the_one_before() -> None:
    many = VectorPanel(
        {"task": rtamt.parse("eventually(a > 0 and eventually(b > 0))")},
        2,
        Reading(nan="hold"),
        "ab",
    )
    many.feed(np.array([[1.0, 1.0], [-1.0, -1.0]]))
    many.reset(np.array([True, False]))
    with pytest.raises(rtamt.InputError, match="'a' is nan at sample 0"):
        many.feed(np.array([[math.nan, 1.0], [math.nan, 1.0]]))


@pytest.mark.parametrize("end", ["complete", "cut"])
def test_a_recorded_trace_has_the_progress_that_its_run_had(end: End) -> None:
    @settings(max_examples=examples(20))
    @given(requirements(), traces())
    def check(formula: Formula, trace: Trace) -> None:
        spec = Specification.of(formula)
        if not spec.variables:
            return
        columns = {name: np.array(values) for name, values in trace.items()}
        found = progress_of(spec, columns, Reading(end=end))
        assert found == played(spec, rows_of(trace), end)[-1]

    check()
    assert progress_of(rtamt.parse("always(a > 0)"), {"a": np.ones(2)}, Reading()) is None


def test_a_stage_counts_what_came_after_the_one_before_it() -> None:
    spec = rtamt.parse("eventually(a > 0 and eventually(b > 0 and eventually(c > 0)))")
    rows = [
        (-4, -4, -4),  # a sets out at -4
        (-1, 9, 9),  # three quarters of the way to stage 1; b and c are too early
        (1, -2, 3),  # stage 1; b sets out at -2
        (0, -1, 1),
        (0, 0, 1),  # b > 0 does not hold at 0, however near it is
        (0, 1, -9),  # stage 2; c sets out at -9, although it held before
        (0, 0, 1),
    ]
    thirds = [0, 0.75, 1, 1.5, 2, 2, 3, 3]
    found = played(spec, rows, "complete")
    assert found == pytest.approx([third / 3 for third in thirds])
    assert found[4] == math.nextafter(2 / 3, 0)
    assert found[-1] == 1


def test_the_end_decides_stages_as_it_is_read() -> None:
    spec = rtamt.parse("eventually(a > 0 and eventually always[0:3](b > 0))")
    rows = [(1.0, 1.0, 0.0), (1.0, 1.0, 0.0)]
    almost = math.nextafter(1.0, 0.0)  # what is seen holds, and is not certain
    assert played(spec, rows, "complete") == [almost, almost, 1.0]
    assert played(spec, rows, "cut") == [almost, almost, almost]
    columns = {"a": np.ones(2), "b": np.ones(2)}
    assert progress_of(spec, columns, Reading(end="complete")) == 1.0
    assert progress_of(spec, columns, Reading(end="cut")) == almost


def test_what_the_end_makes_a_failure_keeps_its_progress() -> None:
    panel = Panel({"task": rtamt.parse("eventually(a > 0 and eventually(b > 0))")}, Reading())
    panel.feeder(NAMES)((1.0, -1.0, 0.0))
    panel.finish("failure")
    assert panel.progress == {"task": 0.5}
    assert panel.violated_by == "task"


def test_verdicts_alone_move_it_by_whole_stages() -> None:
    spec = rtamt.parse("eventually(a > 0 and eventually(b > 0))")
    panel = Panel({"task": spec}, Reading(semantics="boolean"))
    feed = panel.feeder(NAMES)
    found = []
    for row in ((-4, -4, 0), (-1, -4, 0), (1, -4, 0), (0, -1, 0), (0, 1, 0)):
        feed(row)
        found.append(panel.progress["task"])
    assert found == [0, 0, 0.5, 0.5, 1]


@pytest.mark.parametrize("view", ["episode", "step"])
def test_others_have_none_and_cost_nothing(view: Any) -> None:  # noqa: ANN401 - a literal
    specs = {
        "near": rtamt.parse("eventually[0:5](a > 0)"),
        "calm": rtamt.parse("always(a < 9)"),
    }
    if view == "step":
        specs = {"task": rtamt.parse("eventually[0:2](a > 0 and eventually[0:2](b > 0))")}
    panel = Panel(specs, Reading(view=view))
    vector = VectorPanel(specs, 2, Reading(view=view), NAMES)
    assert panel.progress == vector.progress == {}
    assert (panel.least_progress, vector.least_progress) == (None, None)
    assert (panel._stages, vector._stages) == (None, None)


def test_a_state_brings_the_progress_back() -> None:
    specs = {"task": rtamt.parse("eventually(a > 0 and eventually(b > 0))")}
    panel, other = Panel(specs, Reading()), Panel(specs, Reading())
    feed, feed_other = panel.feeder(NAMES), other.feeder(NAMES)
    feed((1.0, -4.0, 0.0))
    state = pickle.loads(pickle.dumps(panel.state()))
    for row in ((0.0, -2.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0)):
        feed(row)
    assert panel.progress == {"task": 1.0}
    other.restore(state)
    panel.restore(state)
    for row, came in (((0.0, -2.0, 0.0), 0.75), ((0.0, 1.0, 0.0), 1.0)):
        feed(row)
        feed_other(row)
        assert panel.progress == other.progress == {"task": came}


def test_a_stage_holds_values_from_before_it_was_next() -> None:
    spec, nan = rtamt.parse("eventually(a > 0 and eventually(b > 0))"), math.nan
    panel = Panel({"task": spec}, Reading(nan="hold"))
    feed = panel.feeder(NAMES)
    found = []
    for row in ((-1.0, -4.0, 0.0), (1.0, nan, 0.0), (1.0, nan, 0.0), (1.0, -1.0, 0.0)):
        feed(row)
        found.append(panel.progress["task"])
    assert found == [0, 0.5, 0.5, 0.875]


def test_a_state_brings_the_values_that_are_held_back() -> None:
    specs = {"task": rtamt.parse("eventually(a > 0 and eventually(b > 0))")}
    panel, other = (Panel(specs, Reading(nan="hold")) for _ in range(2))
    feed, feed_other = panel.feeder(NAMES), other.feeder(NAMES)
    feed((-1.0, -4.0, 0.0))
    state = pickle.loads(pickle.dumps(panel.state()))
    feed((-1.0, -8.0, 0.0))
    panel.restore(state)
    other.restore(state)
    for row, came in (((1.0, math.nan, 0.0), 0.5), ((1.0, -1.0, 0.0), 0.875)):
        feed(row)
        feed_other(row)
        assert panel.progress == other.progress == {"task": came}
