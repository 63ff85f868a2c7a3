"""The released classes for dense time: laws on generated signals, and the shapes of their calls."""

import copy
import itertools
import math
import pickle
from typing import Any

import pytest
from dense_signals import Breakpoints, Signals, chunked, chunks, relevant, signals
from hypothesis import given, settings
from strategies import VARIABLES, formulas

import rtamt
from rtamt import (
    DenseMonitor,
    Formula,
    Language,
    StlDenseTimeSpecification,
    evaluate_dense,
)

LANGUAGES = {"python": Language.PYTHON, "native": Language.CPP}
Pairs = list[list[float]]

bounded = formulas(dense=True).filter(lambda f: f.variables)


def declared(
    text: object, names: tuple[str, ...] = VARIABLES, language: Language = Language.PYTHON
) -> StlDenseTimeSpecification:
    """A parsed specification of variables of type float."""
    spec = StlDenseTimeSpecification(language=language)
    for name in names:
        spec.declare_var(name, "float")
    spec.spec = str(text)
    spec.parse()
    return spec


def call(signals: Signals) -> list[list[object]]:
    """Signals as the arguments of a call."""
    return [[name, [list(event) for event in events]] for name, events in signals.items()]


def update(spec: StlDenseTimeSpecification, chunk: Signals) -> Pairs:
    """What update gives."""
    return spec.update(*call(chunk))


# Laws. -------------------------------------------------------------------------------------------


@settings(max_examples=50)
@given(formula=formulas(endless=True, dense=True).filter(lambda f: f.variables), whole=signals())
def test_evaluate_gives_the_breakpoints_as_lists(
    formula: Formula, whole: Signals, backend: str
) -> None:
    spec = declared(formula, language=LANGUAGES[backend])
    expected = [list(step) for step in evaluate_dense(formula, whole, backend="python")]
    assert spec.evaluate(*call(whole)) == expected


def decided(formula: Formula, signals: Signals) -> Breakpoints:
    """All that the events so far decide, at the time at which they do.

    From the last time at which all is known, every variable keeps its value: what may still come
    can change only the robustness after that time less the horizon.
    """
    if any(not signals.get(name) for name in formula.variables):
        return []
    known = relevant(signals, formula.variables)
    end = min(events[-1][0] for events in known.values())
    if max(events[0][0] for events in known.values()) > end:
        return []
    horizon = DenseMonitor(formula).horizon
    held = {}
    for name, events in known.items():
        before = [event for event in events if event[0] <= end]
        held[name] = [*before, (end + horizon + 100.0, before[-1][1])]
    steps = evaluate_dense(formula, held)
    return [(time + horizon, value) for time, value in steps if time <= end - horizon]


@settings(max_examples=50)
@given(formula=bounded, whole=signals(), shares=chunks())
def test_update_gives_what_the_events_decide_at_once_and_each_breakpoint_once(
    formula: Formula, whole: Signals, shares: list[list[float]], backend: str
) -> None:
    spec = declared(formula, language=LANGUAGES[backend])
    told: Pairs = []
    so_far: Signals = {}
    for chunk in chunked(whole, shares):
        told += update(spec, chunk)
        for name, events in chunk.items():
            so_far.setdefault(name, []).extend(events)
        assert told == [list(step) for step in decided(formula, so_far)]


@settings(max_examples=50)
@given(formula=bounded, whole=signals(), shares=chunks())
def test_final_update_gives_the_rest(
    formula: Formula, whole: Signals, shares: list[list[float]]
) -> None:
    *calls, last = chunked(whole, shares)
    spec, monitor = declared(formula), DenseMonitor(formula)
    told = [step for chunk in calls for step in update(spec, chunk)]
    told += spec.final_update(*call(last))
    whole = relevant(whole, formula.variables)
    expected = [(t + monitor.horizon, v) for t, v in monitor.update(whole) + monitor.finish()]
    # What was decided at the last moment is told twice only where the end of the trace changes it.
    repeated = [step for step, later in itertools.pairwise(told) if step[0] == later[0]]
    assert [step for step in told if step not in repeated] == [list(step) for step in expected]
    with pytest.raises(rtamt.StateError, match="the trace is finished"):
        update(spec, {formula.variables[0]: [(1e6, 0.0)]})


@settings(max_examples=50)
@given(formula=bounded, whole=signals(), shares=chunks(1))
def test_copies_go_on_by_themselves_and_reset_starts_afresh(
    formula: Formula, whole: Signals, shares: list[list[float]]
) -> None:
    begin, rest = chunked(whole, shares)
    spec = declared(formula)
    first = update(spec, begin)
    twins = [copy.deepcopy(spec), pickle.loads(pickle.dumps(spec))]
    second = update(spec, rest)
    assert [update(twin, rest) for twin in twins] == [second, second]
    spec.reset()
    assert (update(spec, begin), update(spec, rest)) == (first, second)


# Calls. ------------------------------------------------------------------------------------------


def test_an_event_is_answered_at_its_own_time() -> None:
    spec = declared("once[0:2](a >= 3)")
    answers = [update(spec, {"a": [(t, v)]}) for t, v in [(0.0, 1.0), (1.5, 5.0), (3.0, 2.0)]]
    assert answers == [[[0.0, -2.0]], [[1.5, 2.0]], []]
    assert update(spec, {"a": [(7.0, 2.5)]}) == [[5.0, -1.0], [7.0, -0.5]]


def test_a_future_formula_is_stamped_with_the_time_at_which_it_is_known() -> None:
    spec = declared("eventually[0:2](a >= 3)")
    spec.pastify()
    assert update(spec, {"a": [(0.0, 1.0), (1.0, 5.0)]}) == []
    assert update(spec, {"a": [(4.0, 0.0)]}) == [[2.0, 2.0]]
    assert spec.evaluate(["a", [(0.0, 1.0), (1.0, 5.0), (4.0, 0.0)]]) == [[0.0, 2.0], [4.0, -3.0]]


def test_signals_may_be_tuples_unknown_or_in_several_parts() -> None:
    spec = declared("a > b", ("a", "b"))
    parts = ("a", [(0, 3.0)]), ["a", ((1, 4.0),)], ("b", [[0, 1.0], [1, 1.0]]), ("c", [(9, 9.0)])
    assert spec.evaluate(*parts) == [[0.0, 2.0], [1.0, 3.0]]
    assert spec.get_value("out") == [[0.0, 2.0], [1.0, 3.0]]
    assert spec.update(*parts) == [[0.0, 2.0], [1.0, 3.0]]
    assert spec.get_value("c") == [(9, 9.0)]


def test_a_chunk_may_begin_with_the_last_event_once_more() -> None:
    spec = declared("a > 0", ("a",))
    assert update(spec, {"a": [(0.0, 1.0), (4.0, 5.0)]}) == [[0.0, 1.0], [4.0, 5.0]]
    assert update(spec, {"a": [(4.0, 5.0), (6.0, 7.0)]}) == [[6.0, 7.0]]
    with pytest.raises(rtamt.InputError, match=r"expected a time after 6\.0 at event 0 of 'a'"):
        update(spec, {"a": [(6.0, 8.0)]})


def test_get_value_gives_the_last_robustness_of_named_formulas() -> None:
    spec = declared("out = p or b > 5", ("a", "b", "p", "out"))
    spec.add_sub_spec("p = a > 1")
    spec.parse()
    assert spec.get_value("a") == []
    update(spec, {"a": [(0.0, 3.0), (2.0, 4.0)], "b": [(0.0, 1.0), (2.0, 9.0)]})
    assert (spec.get_value("out"), spec.get_value("p")) == (4.0, 2.0)


class Float:
    """A message."""

    def __init__(self, value: float = 0.0) -> None:
        self.value = value


def test_variables_may_be_messages() -> None:
    spec = StlDenseTimeSpecification()
    spec.import_module(__name__, "Float")
    for name in ("a", "c"):
        spec.declare_var(name, "Float")
    spec.spec = "c.value = a.value <= 2"
    spec.parse()
    assert (spec.out_var, spec.free_vars) == ("c", {"a"})
    events = [(0.0, Float(1.0)), (1.0, Float(5.0))]
    assert spec.update(["a", events]) == spec.evaluate(["a", events]) == [[0.0, 1.0], [1.0, -3.0]]
    with pytest.raises(rtamt.InputTypeError, match="expected a number"):
        spec.update(["a", [(2.0, Float("3"))]])  # type: ignore[arg-type]


def test_units_are_those_of_the_specification() -> None:
    spec = declared("eventually[0:2](a > 0)")
    spec.unit = "ms"
    assert update(spec, {"a": [(0.0, 1.0), (2.0, 3.0)]}) == [[2.0, 3.0]]
    spec = declared("eventually[0:2000ms](a > 0)")
    assert update(spec, {"a": [(0.0, 1.0), (2.0, 3.0)]}) == [[2.0, 3.0]]


def test_a_sampling_period_means_nothing() -> None:
    spec = declared("a > 0")
    spec.set_sampling_period(100, "ms", 0.1)
    found = spec.get_sampling_frequency(), spec.sampling_tolerance, spec.sampling_violation_counter  # type: ignore[func-returns-value]
    assert found == (None, None, None)


def test_after_an_error_all_is_as_before() -> None:
    spec, twin = declared("once[0:1](a > b)"), declared("once[0:1](a > b)")
    for each in (spec, twin):
        update(each, {"a": [(0.0, 3.0)], "b": [(0.0, 1.0)]})
    for bad in (
        {"a": [(0.0, 4.0)]},
        {"a": [(1.0, math.nan)]},
        {"a": [(2.0, 1.0), (1.0, 1.0)]},
    ):
        with pytest.raises(rtamt.RTAMTException):
            update(spec, bad)
    rest: Signals = {"a": [(1.0, 0.0)], "b": [(1.0, 5.0)]}
    assert spec.var_object_dict == twin.var_object_dict
    assert update(spec, rest) == update(twin, rest)


@pytest.mark.parametrize("signal", [{"a": [(0, 1)]}, ["a", [0, 1]], ["a"], 7])
def test_signals_of_another_kind_are_refused(signal: object) -> None:
    spec: Any = declared("a > 0")
    with pytest.raises(rtamt.InputTypeError) as raised:
        spec.evaluate(signal)
    expected = "expected a name and its events, as ['x', [[0.0, 1.5], [2.0, 1.0]]], got "
    assert str(raised.value) == expected + repr(signal)


def test_operators_of_samples_and_a_future_without_end_are_refused_when_asked() -> None:
    with pytest.raises(rtamt.RTAMTException, match="'prev'"):
        declared("prev(a > 0)").evaluate(["a", [(0.0, 1.0)]])
    spec = declared("a > 1 implies eventually(a > 2)")
    with pytest.raises(rtamt.RTAMTException, match="'eventually' without an end"):
        update(spec, {"a": [(0.0, 1.0)]})
    assert spec.evaluate(["a", [(0.0, 2.0), (1.0, 5.0)]]) == [[0.0, 3.0]]
