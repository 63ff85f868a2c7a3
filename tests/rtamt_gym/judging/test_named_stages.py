"""Named stages: the progress of any requirement, against its definition, and its errors."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from staged import NAMES, End, Rows, progress, verdict
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
from rtamt.patterns import in_order, stages
from rtamt_gym.judging.panel import Panel
from rtamt_gym.judging.stages import progress_of, progress_of_events, stages_of
from rtamt_gym.judging.vector_panel import VectorPanel
from rtamt_gym.options.evaluation import Reading

READS = rtamt.parse("always(a + b + c > 1e9)").formula
"""Does not matter to a disjunction, and reads every variable."""

TASK = rtamt.parse("near = a > 0; limit = 2; eventually always[0:1](near and b >= limit and c > 0)")


@st.composite
def conditions(draw: st.DrawFn) -> list[Formula]:
    """Stages, all with or all without operators of time."""
    depth = draw(st.integers(0, 1))
    return draw(st.lists(formulas(depth), min_size=2, max_size=4))


@st.composite
def requirements(draw: st.DrawFn) -> Formula:
    """A requirement of any shape that a goal can have."""
    return draw(formulas(1)).eventually() | READS


def chains(wanted: list[Formula]) -> list[Formula]:
    longer = [in_order(*wanted[:count]) for count in range(2, len(wanted) + 1)]
    return [wanted[0].eventually(), *longer]


def rows_of(trace: Trace) -> list[tuple[float, ...]]:
    return [tuple(trace[name][i] for name in NAMES) for i in range(length(trace))]


def played(spec: Specification, rows: Rows, reading: Reading, end: End = "complete") -> list[float]:
    """The progress that the monitors of one environment give."""
    panel = Panel({"task": spec}, reading)
    feed = panel.feeder(NAMES)
    found = []
    for row in rows:
        feed(row)
        found.append(panel.progress["task"])
    panel.finish(end)
    return [*found, panel.progress["task"]]


@pytest.mark.parametrize("end", ["complete", "cut", "open"])
def test_progress_in_named_stages_is_its_definition(end: End) -> None:
    @settings(max_examples=examples(40))
    @given(requirements(), conditions(), traces())
    def check(whole: Formula, wanted: list[Formula], trace: Trace) -> None:
        rows = rows_of(trace)
        found = played(Specification.of(whole), rows, Reading(stages=wanted), end)
        assert found == sorted(found)
        assert (found[-1] == 1) is (verdict(whole, rows, end) is Verdict.SATISFIED)
        defined = progress(whole, wanted, chains(wanted), rows, end)
        assert found == pytest.approx(defined, rel=1e-15, abs=0)

    check()


@settings(max_examples=examples(30))
@given(conditions(), traces())
def test_the_stages_of_a_shape_can_be_named(wanted: list[Formula], trace: Trace) -> None:
    spec = Specification.of(in_order(*wanted))
    if len(spec.variables) < len(NAMES):
        return
    rows = rows_of(trace)
    named = Reading(stages={"task": stages(spec)})
    assert played(spec, rows, named) == played(spec, rows, Reading())


@settings(max_examples=examples(30))
@given(requirements(), conditions(), st.lists(traces(), min_size=3, max_size=3))
def test_many_environments_have_the_progress_of_one(
    whole: Formula, wanted: list[Formula], several: list[Trace]
) -> None:
    specs = {"task": Specification.of(whole), "calm": rtamt.parse("always(a < 9)")}
    reading = Reading(stages={"task": wanted})
    panel = VectorPanel(specs, 3, reading, NAMES)
    rows = [rows_of(trace) for trace in several]
    alone = [Panel(specs, reading) for _ in rows]
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
    panel.reset(np.array([False, True, False]))
    assert panel.progress["task"][1] == 0


@pytest.mark.parametrize("end", ["complete", "cut"])
def test_a_recorded_trace_has_the_progress_that_its_run_had(end: End) -> None:
    @settings(max_examples=examples(20))
    @given(requirements(), conditions(), traces())
    def check(whole: Formula, wanted: list[Formula], trace: Trace) -> None:
        spec = Specification.of(whole)
        columns = {name: np.array(values) for name, values in trace.items()}
        found = progress_of(spec, columns, Reading(end=end, stages=wanted))
        assert found == played(spec, rows_of(trace), Reading(stages=wanted), end)[-1]

    check()


@settings(max_examples=examples(60))
@given(requirements(), st.lists(formulas(0), min_size=2, max_size=4), traces(), st.data())
def test_events_have_the_progress_of_the_samples_that_they_are(
    whole: Formula, wanted: list[Formula], trace: Trace, data: st.DataObject
) -> None:
    """A value is left out where it is that of the sample before; times are any that increase."""
    n = length(trace)
    steps = data.draw(st.lists(st.sampled_from([0.1, 0.5, 3.0]), min_size=n, max_size=n))
    times = np.cumsum(steps)
    events = {}
    for name, values in trace.items():
        kept = [i for i in range(n) if i in (0, n - 1) or values[i] != values[i - 1]]
        events[name] = times[kept], np.array(values)[kept]
    spec = Specification.of(whole)
    columns = {name: np.array(values) for name, values in trace.items()}
    reading = Reading(stages=wanted)
    unmet = rtamt.parse("false or always(a + b + c > 1e9)")
    sampled = progress_of(unmet, columns, reading)
    assert progress_of_events(spec, events, reading, satisfied=False) == sampled
    assert progress_of_events(spec, events, reading, satisfied=True) == 1


def test_stages_with_times_of_their_own_have_no_progress_in_dense_time() -> None:
    events = {name: (np.array([0.0, 1.0]), np.array([1.0, 1.0])) for name in NAMES}
    for text in (
        "eventually(a > 0 and eventually[0:2](b > 0))",
        "eventually(always[0:2](a > 0) and eventually(b > 0))",
    ):
        spec = rtamt.parse(text)
        assert progress_of_events(spec, events, Reading(), satisfied=True) is None


def test_names_of_the_specification_stand_for_what_they_mean() -> None:
    found = stages_of({"task": TASK}, Reading(stages=["near", "b >= limit", "c > limit / 2"]))
    texts = [str(each) for each in found["task"].conditions]
    assert texts == ["a > 0", "b >= 2", "c > 2 / 2"]


def test_a_requirement_satisfied_before_its_stages_is_done() -> None:
    spec = rtamt.parse("eventually(a > 0) or always(b + c > 1e9)")
    reading = Reading(stages=["b > 0", "c > 0"])
    rows = [(-1, -4, 0), (-1, -1, 0), (1, -1, 0), (1, 1, 1)]
    assert played(spec, rows, reading) == [0, 0.375, 1, 1, 1]


def test_all_stages_without_satisfaction_stay_below_one() -> None:
    spec = rtamt.parse("eventually always(a > 0 and b > 0)")
    reading = Reading(stages=["a > 0", "b > 0"])
    almost = math.nextafter(1.0, 0.0)
    assert played(spec, [(1, 1, 0), (1, -1, 0)], reading) == [almost, almost, almost]
    assert played(spec, [(1, 1, 0), (1, 1, 0)], reading) == [almost, almost, 1]


def test_a_value_that_holds_over_nan_holds_for_stages_too() -> None:
    spec = rtamt.parse("eventually(a > 0 and eventually(b > 0 and eventually(c > 0)))")
    rows = [(1, -4, -1), (math.nan, math.nan, -1), (math.nan, -1, math.nan), (0, 1, -0.5)]
    held = [(1, -4, -1), (1, -4, -1), (1, -1, -1), (0, 1, -0.5)]
    known = played(spec, held, Reading())
    assert played(spec, rows, Reading(nan="hold")) == known
    panel = VectorPanel({"task": spec}, 2, Reading(nan="hold"), NAMES)
    found = []
    for row in rows:
        panel.feed(np.array([row, row]))
        found.append(panel.progress["task"].tolist())
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
def test_bad_stages_are_refused_at_construction(
    given: Any,  # noqa: ANN401 - what is wrong
    error: type[Exception],
    said: str,
    vector: bool,  # noqa: FBT001
) -> None:
    def made() -> object:
        reading, specs = Reading(stages=given), {"task": TASK}
        return VectorPanel(specs, 2, reading, NAMES) if vector else Panel(specs, reading)

    with pytest.raises(error) as caught:
        made()
    assert said in str(caught.value)
    if error is ParseError:
        assert caught.value.__notes__ == ["in stage 2", "in the stages of 'task'"]


def test_stages_are_of_one_requirement_and_of_an_episode() -> None:
    specs = {"task": TASK, "calm": rtamt.parse("always(a < 9)")}
    with pytest.raises(InputError, match=r"write \{'task': \[...\]\}"):
        Panel(specs, Reading(stages=["a > 0", "b > 0"]))
    step = Reading(view="step", stages=["a > 0", "b > 0"])
    with pytest.raises(InputError, match="view='step' judges every instant by itself"):
        Panel({"calm": specs["calm"]}, step)


def test_any_number_of_stages_without_operators_of_time() -> None:
    texts = [f"a > {number}" for number in range(20)]
    spec = rtamt.parse("eventually(a > 19 and b > 0 and c > 0)")
    rows = [(number + 0.5, 0, 0) for number in range(20)]
    found = played(spec, rows, Reading(stages=texts))
    assert found[9] == pytest.approx(10 / 20 + 0.0, abs=1 / 20)
    assert found[-1] == math.nextafter(1.0, 0.0)
