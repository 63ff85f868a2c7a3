"""What verdicts on many traces stand on, without judging them again: as `judge` says it."""

import math
import pickle
from typing import Literal

import numpy as np
import pytest
from dense_signals import Signals, relevant, signals
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from implying import aware, dense_requirements, requirements
from interface_cases import Case
from profiles import examples
from strategies import Trace, length, traces
from uncertain_traces import Uncertain, uncertain_traces

from rtamt import (
    Between,
    DenseEpisodeMonitor,
    DenseImplications,
    EpisodeMonitor,
    Evidence,
    Formula,
    Implications,
    InputError,
    InputTypeError,
    Judgement,
    VectorEpisodeMonitor,
    Verdict,
    judge,
    judge_dense,
)

Backend = Literal["native", "python"]
End = Literal["complete", "cut", "open"]
ENDS: tuple[End, ...] = ("complete", "cut", "open")
ENDS_OF_VALUES = "lower", "upper"
RESPONSE = "always(req >= 3 implies eventually[0:2](gnt >= 3))"


def of(found: Judgement) -> Evidence[object]:
    return Evidence(found.asked, found.vacuous, found.never_asked)


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
        assert its.texts == tuple(each.text for each in found.asked)
        table = np.array([trace[name] for name in its.variables]).reshape(len(its.variables), n)
        assert its.evidence(table.T, end, monitor.verdict) == of(found)


@settings(max_examples=examples(60))
@given(case=aware(requirements(2, total=False)), trace=uncertain_traces(most=6))
def test_samples_that_are_not_known(case: Case, trace: Uncertain, backend: Backend) -> None:
    spec, semantics = case
    n = len(next(iter(trace.values())))
    columns = {
        name: Between(*(np.array([getattr(x, end, x) for x in column]) for end in ENDS_OF_VALUES))
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
        name: Between(*(np.array([getattr(x, end, x) for x in column]) for end in ENDS_OF_VALUES))
        for name, column in trace.items()
    }
    counted = []
    for its in (semantics, "standard"):
        try:
            found = judge(spec, columns, end="cut", n=n, semantics=its, backend=backend)
        except InputError:  # a term has no value
            return
        counted.append([(each.samples, each.occasions, each.first) for each in found.asked])
    assert counted[0] == counted[1]


@settings(max_examples=examples(40))
@given(formula=requirements(2), several=st.lists(traces(most=6), min_size=2, max_size=3))
def test_each_lane_has_its_own(formula: Formula, several: list[Trace], backend: Backend) -> None:
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
    counted = DenseImplications(spec, semantics=semantics, backend=backend)
    for end in ENDS:
        found = judge_dense(spec, its, end=end, semantics=semantics, backend=backend)
        monitor = DenseEpisodeMonitor(spec, semantics=semantics, backend=backend)
        monitor.update(its)
        monitor.finish(end)
        assert counted.evidence(its, end, monitor.verdict) == of(found)
        assert counted.evidence(its, end) == of(found)
        assert counted.texts == tuple(each.text for each in found.asked)


def test_without_an_implication_nothing_is_read(backend: Backend) -> None:
    none: Evidence[object] = Evidence((), vacuous=False, never_asked=False)
    sampled = Implications("always(a > 0)", backend=backend)
    assert (bool(sampled), sampled.texts, sampled.evidence({}, "cut")) == (False, (), none)
    dense = DenseImplications("always(a > 0)", backend=backend)
    assert (bool(dense), dense.texts, dense.evidence({})) == (False, (), none)


def test_a_verdict_that_was_given_is_believed(backend: Backend) -> None:
    """An episode that failed by how it ended is not satisfied, whatever its samples are."""
    its = Implications(RESPONSE, backend=backend)
    idle = {"req": [0.0] * 4, "gnt": [0.0] * 4}
    assert its.evidence(idle).never_asked
    assert not its.evidence(idle, verdict=Verdict.VIOLATED).never_asked
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
    dense = DenseImplications(RESPONSE, resolution="1ms", backend=backend)
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
        DenseImplications(RESPONSE, backend=backend).evidence({"req": [(0, 1), (1, 1)]})
    with pytest.raises(TypeError, match="unexpected keyword argument 'ends'"):
        Implications(RESPONSE, ends="cut")  # type: ignore[call-arg]


def test_implications_show_their_formula_and_their_number() -> None:
    assert repr(Implications("always(x > 0 implies y > 0)")) == (
        "<Implications of always(x > 0 implies y > 0): 1>"
    )
    assert repr(DenseImplications("always(x > 0)")) == "<DenseImplications of always(x > 0): 0>"
