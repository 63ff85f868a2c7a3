"""Triggers of implications, in judgements and for known verdicts."""

import copy
import math
import pickle
from dataclasses import astuple
from typing import Any, Literal

import numpy as np
import pytest
from asked_oracle import dense_evidence, evidence
from choices import ENDS, Backend
from dense_signals import Signals, relevant, signals
from golden_cases import cases as golden
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from implying import aware, dense_requirements, requirements
from interface_cases import Case, read
from interface_oracle import SEMANTICS
from profiles import examples
from strategies import INFINITIES, Trace, length, traces
from uncertain_traces import Uncertain, uncertain_traces

import rtamt
from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    InputTypeError,
    Judgement,
    UncertainValue,
    VectorEpisodeMonitor,
    Verdict,
    judge,
    parse,
)
from rtamt.monitors import Evidence, Implications, TriggerCount

Rows = tuple[tuple[object, ...], ...]


def rows_of(found: Judgement) -> Rows:
    return tuple(astuple(each) for each in found.triggers)


def agrees(formula: Formula, trace: Trace, backend: Backend) -> None:
    n = length(trace)
    for end in ENDS:
        found = judge(formula, trace, end=end, n=n, backend=backend)
        assert (rows_of(found), found.never_triggered, found.vacuous) == evidence(
            formula, trace, n, end
        ), end


@settings(max_examples=examples(250))
@given(formula=requirements(), trace=traces(most=8))
def test_it_is_as_defined(formula: Formula, trace: Trace, backend: Backend) -> None:
    agrees(formula, trace, backend)


@settings(max_examples=examples(60))
@given(formula=requirements(total=False), trace=traces(most=6, values=INFINITIES))
def test_infinite_samples(formula: Formula, trace: Trace, backend: Backend) -> None:
    agrees(formula, trace, backend)


@settings(max_examples=examples(120))
@given(case=aware(requirements(2)), trace=traces(most=6))
def test_left_sides_are_judged_by_standard_semantics(
    case: Case, trace: Trace, backend: Backend
) -> None:
    spec, semantics = case
    n = length(trace)
    for end in ENDS:
        found = judge(spec, trace, end=end, n=n, semantics=semantics, backend=backend)
        expected = evidence(spec.formula, trace, n, end, read(case))
        assert (rows_of(found), found.never_triggered, found.vacuous) == expected, end


# Dense time. -------------------------------------------------------------------------------------
@pytest.mark.slow(backend="python")
@settings(max_examples=examples(200))
@given(formula=dense_requirements(), whole=signals())
def test_dense_time_is_as_defined(formula: Formula, whole: Signals, backend: Backend) -> None:
    assume(formula.variables)
    its = relevant(whole, formula.variables)
    for end in ENDS:
        found = rtamt.dense.judge(formula, its, end=end, backend=backend)
        expected = dense_evidence(formula, its, end)
        assert (rows_of(found), found.never_triggered, found.vacuous) == expected, end


@pytest.mark.slow(backend="python")
@settings(max_examples=examples(40))
@given(formula=dense_requirements(), whole=signals(), data=st.data())
def test_dense_left_sides_are_judged_by_standard_semantics(
    formula: Formula, whole: Signals, data: st.DataObject, backend: Backend
) -> None:
    spec, semantics = data.draw(aware(st.just(formula)))
    assume(spec.variables)
    its = relevant(whole, spec.variables)
    for end in ENDS:
        found = rtamt.dense.judge(spec, its, end=end, semantics=semantics, backend=backend)
        expected = dense_evidence(formula, its, end, read((spec, semantics)))
        assert (rows_of(found), found.never_triggered, found.vacuous) == expected, end


# What it is for. ---------------------------------------------------------------------------------
@pytest.mark.slow(backend="python")
def test_golden(backend: Backend) -> None:
    for case in golden("evidence.json"):
        formula = parse(case["formula"]).formula
        for end in ENDS[:2]:
            found, expected = judge(formula, case["trace"], end=end, backend=backend), case[end]
            rows = tuple(
                (str(parse(row["text"]).formula), *(row[key] for key in KEYS))
                for row in expected["asked"]
            )
            assert rows_of(found) == rows
            assert found.verdict.name == expected["verdict"]
            assert (found.never_triggered, found.vacuous) == (
                expected["never_asked"],
                expected["vacuous"],
            )


KEYS = ("samples", "occasions", "first", "vacuous")


RESPONSE = "always(req >= 3 implies eventually[0:2](gnt >= 3))"


def test_a_satisfied_response_without_a_request_says_so(backend: Backend) -> None:
    idle = judge(RESPONSE, {"req": [0] * 5, "gnt": [0] * 5}, backend=backend)
    assert (idle.verdict, idle.never_triggered, idle.vacuous) == (Verdict.SATISFIED, True, True)
    assert idle.triggers == (
        TriggerCount("req >= 3 implies eventually[0:2](gnt >= 3)", 0, 0, None, vacuous=True),
    )
    assert str(idle).splitlines()[-1] == "never triggered"
    trace = {"req": [3, 3, 0, 0, 0, 4, 0, 0], "gnt": [3, 3, 3, 0, 0, 5, 0, 0]}
    busy = judge(RESPONSE, trace, backend=backend)
    assert (busy.never_triggered, busy.vacuous) == (False, False)
    assert str(busy).splitlines()[-1] == "triggered 2 times, first at sample 0"
    late = judge("eventually(a > 0) or (b > 0 implies c > 0)", {"a": [1], "b": [1], "c": [1]})
    assert str(late).splitlines()[-1] == (
        "triggered 1 time, first at sample 0, satisfied without an answer"
    )
    several = judge("always(a implies b) and always(b implies c)", {"a": [0], "b": [-1], "c": [1]})
    assert str(several).splitlines()[-2:] == [
        "triggered 1 time, first at sample 0: a implies b",
        "never triggered: b implies c",
    ]


@pytest.mark.parametrize("semantics", ["standard", "output-vacuity"])
def test_a_request_holds_if_all_that_its_value_may_be_does(
    semantics: Literal["standard", "output-vacuity"], backend: Backend
) -> None:
    spec = "input float gap; output float brake; always({} implies brake > 0)"
    low, high = np.array([1.0, 1.0, 4.0, 1.0]), np.array([2.0, 5.0, 6.0, 1.0])
    trace: dict[str, object] = {"gap": UncertainValue(low, high), "brake": [1, 1, 1, 1]}
    for left, first, samples in (("gap <= 2", 0, 2), ("gap >= 4", 2, 1), ("gap < 6", 0, 3)):
        found = judge(spec.format(left), trace, semantics=semantics, backend=backend)
        assert (found.triggers[0].first, found.triggers[0].samples) == (first, samples)


def test_a_request_that_may_have_been_is_not_said_to_be_missing(backend: Backend) -> None:
    nan = math.nan
    for req, gnt, verdict in (([0, nan, 0], [0] * 3, "UNDECIDED"), ([nan], [5], "SATISFIED")):
        found = judge(RESPONSE, {"req": req, "gnt": gnt}, nan="unknown", backend=backend)
        assert (found.verdict.name, found.triggers[0].count) == (verdict, 0)
        assert "not certainly triggered" in str(found).splitlines()
        assert "never triggered" not in str(found)
    events = {"req": [(0, 0.0), (1, nan), (2, 0.0)], "gnt": [(0, 0.0), (2, 0.0)]}
    dense = rtamt.dense.judge(
        "always(req >= 3 implies gnt >= 3)", events, nan="unknown", backend=backend
    )
    assert "not certainly triggered" in str(dense).splitlines()
    several = "always(a > 0 implies b > 0) and always(b > 0 implies c > 0)"
    two = judge(several, {"a": [1], "b": [nan], "c": [1]}, nan="unknown", backend=backend)
    assert "triggered 1 time, first at sample 0: a > 0 implies b > 0" in str(two)
    assert "not certainly triggered: b > 0 implies c > 0" in str(two)


def test_bounds_are_in_the_unit_of_the_text_and_whole_samples(backend: Backend) -> None:
    spec = parse("always[200:400](a > 0 implies b > 0)", unit="ms")
    found = judge(spec, {"a": [1] * 9, "b": [1] * 9}, "100ms", backend=backend)
    assert (found.triggers[0].samples, found.triggers[0].first) == (3, 2)
    found = judge(spec, {"a": [1] * 9, "b": [1] * 9}, 0.15, align="outward", backend=backend)
    assert (found.triggers[0].samples, found.triggers[0].first) == (3, 1)
    whole = {"a": [(0, 1), (1000, 1)], "b": [(0, 1), (1000, 1)]}
    dense = rtamt.dense.judge(spec, whole, backend=backend)
    assert dense.triggers[0].duration == 0.2
    assert (dense.triggers[0].first, dense.triggers[0].count) == (200, 1)


def test_a_single_instant_of_dense_time_counts(backend: Backend) -> None:
    whole = {"a": [(0, 0), (2, 1)], "b": [(0, 1), (2, 1)]}
    found = rtamt.dense.judge("always(a > 0 implies b > 0)", whole, backend=backend)
    assert astuple(found.triggers[0])[1:] == (0.0, 1, 2.0, False)
    dates = np.array(["2024-01-01T00:00:00", "2024-01-01T00:00:02"], "datetime64[s]")
    dated = {name: rtamt.dense.Events(dates, [0.0, 1.0]) for name in "ab"}
    found = rtamt.dense.judge("always(a > 0 implies b > 0)", dated, backend=backend)
    assert found.triggers[0].first == dates[1]
    assert str(found.triggers[0]).startswith("triggered 1 time, first at time 2024-01-01T00:00:02")


def test_between_two_instants_that_are_read_nothing_is(backend: Backend) -> None:
    spec = "(a > 0 implies b > 0) and next(next(a > 0 implies b > 0))"
    found = judge(spec, {"a": [-1, 1, -1], "b": [1, 1, 1]}, backend=backend)
    assert (found.never_triggered, found.triggers[0].samples) == (True, 0)


def test_what_until_holds_is_not_asked_at_the_last_instant_of_its_window(backend: Backend) -> None:
    spec = "(a > 0 implies b > 0) until[0:2] c > 0"
    trace = {"a": [-1, -1, -1, 1], "b": [1] * 4, "c": [1] * 4}
    late = judge(f"next({spec})", trace, end="complete", backend=backend)
    assert (late.never_triggered, late.triggers[0].samples) == (True, 0)
    events = {"a": [(0, -1), (2, 1), (5, 1)], "b": [(0, 1), (5, 1)], "c": [(0, 1), (5, 1)]}
    dense = rtamt.dense.judge(spec, events, backend=backend)
    assert (dense.never_triggered, dense.triggers[0].count) == (True, 0)


def test_named_formulas_count_where_they_are_used(backend: Backend) -> None:
    spec = "granted = req >= 3 implies gnt >= 3; always granted and always[2:3] granted"
    found = judge(spec, {"req": [0, 3, 3, 3], "gnt": [3] * 4}, backend=backend)
    assert [astuple(each) for each in found.triggers] == [
        ("req >= 3 implies gnt >= 3", 3, 1, 1, False)
    ]


def test_held_values_count(backend: Backend) -> None:
    trace = {"a": [1, np.nan, -1], "b": [1, 1, 1]}
    found = judge("always(a > 0 implies b > 0)", trace, nan="hold", backend=backend)
    assert found.triggers[0].samples == 2
    spec = parse("input float a; output float b; always(a > 0 implies b > 0)")
    for semantics in SEMANTICS:
        found = judge(spec, trace, semantics=semantics, nan="hold", backend=backend)
        assert found.triggers[0].samples == 2


def test_it_is_found_when_it_is_asked_for_and_reads_no_array_of_the_caller(
    backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = parse("input float a; output float b; always(a > 0 implies b > 0)")
    with monkeypatch.context() as patched:
        patched.delattr("rtamt.monitors.judgement.evidence_of")
        found = []
        for semantics in SEMANTICS:
            a, b = np.ones(4), np.ones(4)
            found.append(judge(spec, {"a": a, "b": b}, semantics=semantics, backend=backend))
            a[:] = b[:] = -1.0
        rtamt.dense.judge(spec, {name: [(0, 1), (1, 1)] for name in "ab"}, backend=backend)
    assert [each.triggers[0].samples for each in found] == [4] * len(SEMANTICS)


def test_it_belongs_to_the_value_of_a_judgement() -> None:
    trace = {"a": [1.0, -1.0, 1.0], "b": [1.0, 1.0, 1.0]}
    found = judge("always(a > 0 implies b > 0)", trace)
    other = judge("always(a > 0 implies b > 0)", {**trace, "a": [1.0, 1.0, 1.0]})
    assert found.robustness == other.robustness
    assert found != other
    for twin in (copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        assert twin == found
        assert (twin.triggers, twin.vacuous) == (found.triggers, found.vacuous)


def test_formulas_that_share_their_parts_are_walked_once() -> None:
    formula = parse("a > 0 implies b > 0").formula
    for _ in range(15):
        formula = formula.always(0, 1) & formula.always(1, 2)
    found = judge(formula, {"a": [1.0] * 40, "b": [1.0] * 40}, end="complete")
    assert astuple(found.triggers[0])[1:] == (31, 1, 0, False)


@pytest.mark.parametrize("options", [{}, {"nan": "unknown"}, {"max_gap": 9}], ids=str)
def test_a_request_in_dense_time_may_be_between_two_values(
    options: dict[str, Any], backend: Backend
) -> None:
    a = [(0, UncertainValue(1.0, 2.0)), (2, UncertainValue(-1.0, 1.0)), (4, 1.0), (5, 1.0)]
    whole: dict[str, Any] = {"a": a, "b": [(0, 1.0), (5, 1.0)]}
    spec = "always(a > 0 implies b > 0)"
    found = rtamt.dense.judge(spec, whole, backend=backend, **options)
    assert [astuple(each)[1:] for each in found.triggers] == [(3.0, 2, 0.0, False)]
    assert str(found).splitlines()[-1] == "triggered 2 times, first at time 0"


ENDS_OF_VALUES = "lower", "upper"


def of(found: Judgement) -> Evidence[object]:
    return Evidence(found.triggers, found.vacuous, found.never_triggered)


@settings(max_examples=examples(100))
@given(case=aware(requirements(2)), trace=traces(most=8))
def test_a_run_has_the_rows_of_its_judgement(case: Case, trace: Trace, backend: Backend) -> None:
    spec, semantics = case
    n = length(trace)
    its = Implications(spec, semantics=semantics, backend=backend)
    for end in ENDS:
        found = judge(spec, trace, end=end, n=n, semantics=semantics, backend=backend)
        monitor = EpisodeMonitor(spec, semantics=semantics, backend=backend)
        for i in range(n):
            monitor.update({name: trace[name][i] for name in spec.variables})
        monitor.finish(end)
        assert its.evidence(trace, end, monitor.verdict, n=n) == of(found)
        assert its.evidence(trace, end, n=n) == of(found)
        assert its.texts == tuple(each.text for each in found.triggers)
        table = np.array([trace[name] for name in its.variables]).reshape(len(its.variables), n)
        assert its.evidence(table.T, end, monitor.verdict) == of(found)


@settings(max_examples=examples(60))
@given(case=aware(requirements(2, total=False)), trace=uncertain_traces(most=6))
def test_samples_that_are_not_known(case: Case, trace: Uncertain, backend: Backend) -> None:
    spec, semantics = case
    n = len(next(iter(trace.values())))
    columns = {
        name: UncertainValue(
            *(np.array([getattr(x, end, x) for x in column]) for end in ENDS_OF_VALUES)
        )
        for name, column in trace.items()
    }
    its = Implications(spec, semantics=semantics, backend=backend)
    for end in ENDS:
        monitor = EpisodeMonitor(spec, semantics=semantics, backend=backend)
        try:
            for i in range(n):
                monitor.update({name: trace[name][i] for name in spec.variables})
        except InputError:  # a term has no value
            with pytest.raises(InputError, match="is not a number"):
                its.evidence(columns, end, n=n)
            return
        monitor.finish(end)
        found = judge(spec, columns, end=end, n=n, semantics=semantics, backend=backend)
        assert its.evidence(columns, end, monitor.verdict, n=n) == of(found)


@settings(max_examples=examples(100))
@given(case=aware(requirements(1)), trace=uncertain_traces(most=5, share=0.6))
def test_left_sides_that_are_not_known_hold_by_standard_semantics(
    case: Case, trace: Uncertain, backend: Backend
) -> None:
    spec, semantics = case
    n = len(next(iter(trace.values())))
    columns = {
        name: UncertainValue(
            *(np.array([getattr(x, end, x) for x in column]) for end in ENDS_OF_VALUES)
        )
        for name, column in trace.items()
    }
    counted = []
    for its in (semantics, "standard"):
        try:
            found = judge(spec, columns, end="cut", n=n, semantics=its, backend=backend)
        except InputError:  # a term has no value
            return
        counted.append([(each.samples, each.count, each.first) for each in found.triggers])
    assert counted[0] == counted[1]


@settings(max_examples=examples(40))
@given(formula=requirements(2), several=st.lists(traces(most=6), min_size=2, max_size=3))
def test_each_entry_has_its_own(formula: Formula, several: list[Trace], backend: Backend) -> None:
    assume(formula.variables)
    its = Implications(formula, backend=backend)
    n = min(map(length, several))
    tables = np.array([[trace[name][:n] for name in its.variables] for trace in several])
    monitor = VectorEpisodeMonitor(formula, len(several), backend=backend)
    for i in range(n):
        monitor.update(tables[:, :, i])
    monitor.finish(end="cut")
    for table, trace, verdict in zip(tables, several, monitor.verdict, strict=True):
        found = judge(formula, {name: trace[name][:n] for name in trace}, backend=backend)
        assert its.evidence(table.T, "cut", Verdict(verdict)) == of(found)


@settings(max_examples=examples(60))
@given(formula=dense_requirements(), whole=signals(), data=st.data())
def test_a_run_in_dense_time_has_the_rows_of_its_judgement(
    formula: Formula, whole: Signals, data: st.DataObject, backend: Backend
) -> None:
    spec, semantics = data.draw(aware(st.just(formula)))
    assume(spec.variables)
    its = relevant(whole, spec.variables)
    counted = rtamt.dense.Implications(spec, semantics=semantics, backend=backend)
    for end in ENDS:
        found = rtamt.dense.judge(spec, its, end=end, semantics=semantics, backend=backend)
        monitor = rtamt.dense.EpisodeMonitor(spec, semantics=semantics, backend=backend)
        monitor.update(its)
        monitor.finish(end)
        assert counted.evidence(its, end, monitor.verdict) == of(found)
        assert counted.evidence(its, end) == of(found)
        assert counted.texts == tuple(each.text for each in found.triggers)


def test_without_an_implication_nothing_is_read(backend: Backend) -> None:
    none: Evidence[object] = Evidence((), vacuous=False, never_triggered=False)
    sampled = Implications("always(a > 0)", backend=backend)
    assert (bool(sampled), sampled.texts, sampled.evidence({}, "cut")) == (False, (), none)
    dense = rtamt.dense.Implications("always(a > 0)", backend=backend)
    assert (bool(dense), dense.texts, dense.evidence({})) == (False, (), none)


def test_a_verdict_that_was_given_is_believed(backend: Backend) -> None:
    """An episode that failed by its end is not satisfied, for any samples."""
    its = Implications(RESPONSE, backend=backend)
    idle = {"req": [0.0] * 4, "gnt": [0.0] * 4}
    assert its.evidence(idle).never_triggered
    assert not its.evidence(idle, verdict=Verdict.VIOLATED).never_triggered
    assert not its.evidence(idle, verdict=Verdict.UNDECIDED).vacuous


def test_a_copy_counts_as_the_original(backend: Backend) -> None:
    trace = {"req": [0, 4, 0, 4], "gnt": [0, 0, 5, math.nan]}
    its = Implications(RESPONSE, "100ms", nan="unknown", backend=backend, align="outward")
    twin = pickle.loads(pickle.dumps(its))
    assert twin.texts == its.texts
    assert twin.evidence(trace, "cut") == its.evidence(trace, "cut")
    assert its.evidence(trace, "cut") == of(
        judge(RESPONSE, trace, "100ms", nan="unknown", align="outward", backend=backend)
    )
    dense = rtamt.dense.Implications(RESPONSE, resolution="1ms", backend=backend)
    whole = {"req": [(0, 0), (1, 4), (6, 0)], "gnt": [(0, 5), (6, 5)]}
    assert pickle.loads(pickle.dumps(dense)).evidence(whole) == dense.evidence(whole)


def test_errors(backend: Backend) -> None:
    its = Implications(RESPONSE, backend=backend)
    with pytest.raises(InputError, match="No column 'gnt'"):
        its.evidence({"req": [1.0]})
    with pytest.raises(InputError, match="at least 1 sample"):
        its.evidence({"req": [], "gnt": []})
    with pytest.raises(InputError, match="expected end="):
        its.evidence({"req": [1.0], "gnt": [1.0]}, "closed")  # type: ignore[arg-type]
    with pytest.raises(InputTypeError, match=r"expected an rtamt\.Verdict, got 1"):
        its.evidence({"req": [1.0], "gnt": [1.0]}, "cut", 1)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="No signal 'gnt'"):
        rtamt.dense.Implications(RESPONSE, backend=backend).evidence({"req": [(0, 1), (1, 1)]})
    with pytest.raises(TypeError, match="unexpected keyword argument 'ends'"):
        Implications(RESPONSE, ends="cut")  # type: ignore[call-arg]


def test_implications_show_their_formula_and_their_number() -> None:
    assert repr(Implications("always(x > 0 implies y > 0)")) == (
        "<Implications of always(x > 0 implies y > 0): 1>"
    )
    assert (
        repr(rtamt.dense.Implications("always(x > 0)")) == "<DenseImplications of always(x > 0): 0>"
    )
