"""The drop-in classes for dense time, online and offline."""

import copy
import math
import pickle
from fractions import Fraction
from typing import Any

import pytest
from compat_specs import LANGUAGES, Pairs, call, held, update
from compat_specs import declared_dense as declared
from dense_signals import Breakpoints, Signals, by_value, chunked, chunks, relevant, signals
from hypothesis import given, settings
from profiles import examples
from strategies import formulas

import rtamt
from rtamt import Formula, StlDenseTimeSpecification

bounded = formulas(dense=True).filter(lambda f: f.variables)


# Laws. -------------------------------------------------------------------------------------------


@settings(max_examples=examples(50))
@given(formula=formulas(endless=True, dense=True).filter(lambda f: f.variables), full=signals())
def test_evaluate_holds_signals_to_the_last_time(
    formula: Formula, full: Signals, backend: str
) -> None:
    spec = declared(formula, language=LANGUAGES[backend])
    same_end = held(relevant(full, formula.variables))
    steps = by_value(rtamt.dense.evaluate(formula, same_end, backend="python"))
    assert spec.evaluate(*call(full)) == [list(step) for step in steps]


@settings(max_examples=examples(50))
@given(formula=bounded, full=signals(), shares=chunks(1))
def test_copies_and_reset(formula: Formula, full: Signals, shares: list[list[float]]) -> None:
    begin, remainder = chunked(full, shares)
    spec = declared(formula)
    first = update(spec, begin)
    twins = [copy.deepcopy(spec), pickle.loads(pickle.dumps(spec))]
    second = update(spec, remainder)
    assert [update(twin, remainder) for twin in twins] == [second, second]
    spec.reset()
    assert (update(spec, begin), update(spec, remainder)) == (first, second)


# Calls. ------------------------------------------------------------------------------------------


def test_forms_of_signals() -> None:
    spec = declared("a > b", ("a", "b"))
    parts = ("a", [(0, 3.0)]), ["a", ((1, 4.0),)], ("b", [[0, 1.0], [1, 1.0]]), ("c", [(9, 9.0)])
    assert spec.evaluate(*parts) == [[0.0, 2.0], [1.0, 3.0]]
    assert spec.get_value("out") == [[0.0, 2.0], [1.0, 3.0]]
    assert spec.update(*parts) == [[0.0, 2.0], [1.0, 3.0]]
    assert spec.get_value("c") == [(9, 9.0)]


def test_get_value_of_named_formulas() -> None:
    spec = declared("out = p or b > 5", ("a", "b", "p", "out"))
    spec.add_sub_spec("p = a > 1")
    spec.parse()
    assert spec.get_value("a") == []
    update(spec, {"a": [(0.0, 3.0), (2.0, 4.0)], "b": [(0.0, 1.0), (2.0, 9.0)]})
    assert (spec.get_value("out"), spec.get_value("p")) == (4.0, 3.0)


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
    actual = spec.get_sampling_frequency(), spec.sampling_tolerance, spec.sampling_violation_counter  # type: ignore[func-returns-value]
    assert actual == (None, None, None)


def test_after_an_error_all_is_as_before() -> None:
    spec, twin = declared("once[0:1](a > b)"), declared("once[0:1](a > b)")
    for each in (spec, twin):
        update(each, {"a": [(0.0, 3.0)], "b": [(0.0, 1.0)]})
    for bad in (
        {"a": [(-1.0, 4.0)]},
        {"a": [(1.0, 2.0), (2.0, math.nan)]},
        {"a": [(2.0, 1.0), (1.0, 1.0)]},
    ):
        with pytest.raises(rtamt.RTAMTException):
            update(spec, bad)
    remainder: Signals = {"a": [(1.0, 0.0)], "b": [(1.0, 5.0)]}
    assert spec.var_object_dict == twin.var_object_dict
    assert update(spec, remainder) == update(twin, remainder)


def test_single_event_holds() -> None:
    events = ["a", [[0, 1], [10, -3]]], ["c", [[0, 0]]]
    assert declared("always(a > c)", ("a", "c")).evaluate(*events) == [[0.0, -3.0]]
    assert declared("a > c", ("a", "c")).evaluate(*events) == [[0.0, 1.0], [10.0, -3.0]]
    late = ["a", [[0, 1], [2, -3]]], ["c", [[4, 0], [5, 1]]]
    assert declared("a > c", ("a", "c")).evaluate(*late) == [[4.0, -3.0], [5.0, -4.0]]


@pytest.mark.parametrize("begin", [0.0, -3.0, 0.1, 1e6, 1.7e9])
@pytest.mark.parametrize("gap", [2e-10, 6e-10, 1e-9, 5e-9, 1e-6, 0.25])
def test_last_event_of_a_tick_counts(begin: float, gap: float) -> None:
    events = [(begin, 1.0), (begin + gap, 5.0), (begin + gap + 1.0, 2.0)]
    ticks = [round(Fraction(repr(time)) * 10**9) for time, _ in events]
    last = {tick: (tick / 10**9, value) for tick, (_, value) in zip(ticks, events, strict=True)}
    expected = [list(step) for step in last.values()]
    assert declared("a > 0", ("a",)).evaluate(["a", events]) == expected
    assert declared("a > 0", ("a",)).update(["a", events]) == expected


@pytest.mark.parametrize("formula", ["a > 1", "a > c", "always(a > c)"])
def test_a_variable_without_events_gives_no_robustness(formula: str) -> None:
    spec = declared(formula, ("a", "c"))
    for events in ((["a", []], ["c", []]), (["a", []], ["c", [[0, 1], [2, 3]]])):
        assert spec.evaluate(*events) == []
        assert spec.get_value("out") == []
    with pytest.raises(rtamt.InputError, match=r"No signal 'a'|none of 'a'"):
        spec.evaluate(["c", []])


@pytest.mark.parametrize("signal", [{"a": [(0, 1)]}, ["a", [0, 1]], ["a"], 7])
def test_signals_of_another_kind_are_refused(signal: object) -> None:
    spec: Any = declared("a > 0")
    with pytest.raises(rtamt.InputTypeError) as raised:
        spec.evaluate(signal)
    expected = "expected a name and its events, as ['x', [[0.0, 1.5], [2.0, 1.0]]], got "
    assert str(raised.value) == expected + repr(signal)


def test_sample_operators_and_unbounded_future_errors() -> None:
    with pytest.raises(rtamt.RTAMTException, match="'prev'"):
        declared("prev(a > 0)").evaluate(["a", [(0.0, 1.0)]])
    spec = declared("a > 1 implies eventually(a > 2)")
    with pytest.raises(rtamt.RTAMTException, match="'eventually' without an end"):
        update(spec, {"a": [(0.0, 1.0)]})
    assert spec.evaluate(["a", [(0.0, 2.0), (1.0, 5.0)]]) == [[0.0, 3.0]]


def settled(formula: Formula, known: Signals) -> float | None:
    """Return the minimum of the variables' last times, if all variables have a value there."""
    if any(not known.get(name) for name in formula.variables):
        return None
    signals = relevant(known, formula.variables)
    end = min(events[-1][0] for events in signals.values())
    return end if max(events[0][0] for events in signals.values()) <= end else None


def decided(formula: Formula, known: Signals, end: float) -> Breakpoints:
    """Return all values that the events decide up to the settled time, at their decision.

    Later events can change only the robustness after that time less the horizon: every variable
    keeps its value from there on.
    """
    horizon, lasting = rtamt.dense.Monitor(formula).horizon, {}
    for name, events in relevant(known, formula.variables).items():
        before = [event for event in events if event[0] <= end]
        lasting[name] = [*before, (end + horizon + 100.0, before[-1][1])]
    steps = rtamt.dense.evaluate(formula, lasting)
    # 0.0 and -0.0 are equal for programs, so there is no step between them.
    return by_value([(time + horizon, value) for time, value in steps if time <= end - horizon])


def expected_of(formula: Formula, known: Signals, before: float | None) -> Pairs:
    """Return the result of a call that completes these events after the time `before`."""
    end = settled(formula, known)
    if end is None or end == before:
        return []
    steps = decided(formula, known, end)
    if not steps:  # the window of the first instant is not over
        so_far = {n: [e for e in known[n] if e[0] <= end] for n in formula.variables}
        return [[end, rtamt.dense.evaluate(formula, held(so_far))[0][1]]]
    news = [list(step) for step in steps if before is None or step[0] > before]
    return news if news and news[-1][0] == end else [*news, [end, steps[-1][1]]]


@given(formula=bounded, full=signals(), shares=chunks())
def test_update_returns_new_steps_and_settled_value(
    formula: Formula, full: Signals, shares: list[list[float]], backend: str
) -> None:
    spec = declared(formula, language=LANGUAGES[backend])
    known: Signals = {}
    before = None
    for chunk in chunked(full, shares):
        reported = update(spec, chunk)
        for name, events in chunk.items():
            known.setdefault(name, []).extend(events)
        assert reported == expected_of(formula, known, before)
        before = settled(formula, known)
        if reported:
            assert spec.get_value("out") == reported[-1][1]


def function(pairs: Pairs, since: float = -math.inf) -> Breakpoints:
    """Return the step function of pairs; the last pair at a time counts."""
    return by_value(sorted({time: value for time, value in pairs if time >= since}.items()))


def whole_trace(formula: Formula, full: Signals) -> Breakpoints:
    """Return the result of `evaluate`, with each step at the time when it is known online."""
    horizon = rtamt.dense.Monitor(formula).horizon
    steps = rtamt.dense.evaluate(formula, held(relevant(full, formula.variables)))
    return by_value([(time + horizon, value) for time, value in steps])


@settings(max_examples=examples(50))
@given(formula=bounded, full=signals(), shares=chunks())
def test_updates_match_evaluate(
    formula: Formula, full: Signals, shares: list[list[float]], backend: str
) -> None:
    *calls, last = chunked(full, shares)
    spec = declared(formula, language=LANGUAGES[backend])
    reported = [pair for chunk in calls for pair in update(spec, chunk)]
    reported += spec.final_update(*call(last))
    expected = whole_trace(formula, full)
    assert function(reported, since=expected[0][0]) == expected
    with pytest.raises(rtamt.StateError, match="the trace is finished"):
        update(spec, {formula.variables[0]: [(1e6, 0.0)]})


@settings(max_examples=examples(50))
@given(formula=bounded, full=signals())
def test_event_replaces_event_of_same_time(formula: Formula, full: Signals, backend: str) -> None:
    spec = declared(formula, language=LANGUAGES[backend])
    reported = []
    events = [(time, name, value) for name in full for time, value in full[name]]
    for time, name, value in sorted(events):
        reported += update(spec, {name: [(time, value + 3.0)]})
        reported += update(spec, {name: [(time, value - 2.0), (time, value)]})
    reported += spec.final_update()
    expected = whole_trace(formula, full)
    assert function(reported, since=expected[0][0]) == expected


# Calls. ------------------------------------------------------------------------------------------


def test_an_event_is_answered_at_its_own_time() -> None:
    spec = declared("once[0:2](a >= 3)")
    answers = [update(spec, {"a": [(t, v)]}) for t, v in [(0.0, 1.0), (1.5, 5.0), (3.0, 2.0)]]
    assert answers == [[[0.0, -2.0]], [[1.5, 2.0]], [[3.0, 2.0]]]
    assert update(spec, {"a": [(7.0, 2.5)]}) == [[5.0, -1.0], [7.0, -0.5]]


def test_each_settled_time_gives_a_pair() -> None:
    spec = declared("a > b")
    answers = [update(spec, {"a": [(t, 3.0)], "b": [(t, 1.0)]}) for t in (0.0, 1.0, 2.0)]
    assert answers == [[[0.0, 2.0]], [[1.0, 2.0]], [[2.0, 2.0]]]
    assert update(spec, {"a": [(9.0, 4.0)]}) == []
    assert update(spec, {"b": []}) == []
    assert update(spec, {"b": [(5.0, 1.0)]}) == [[5.0, 2.0]]


def test_update_before_a_window_is_over() -> None:
    spec = declared("always[0:2](a >= 3)")
    spec.pastify()
    answers = [update(spec, {"a": [(t, v)]}) for t, v in [(0.0, 9.0), (1.0, 5.0), (1.5, 8.0)]]
    assert answers == [[[0.0, 6.0]], [[1.0, 2.0]], [[1.5, 2.0]]]
    assert update(spec, {"a": [(4.0, 0.0)]}) == [[2.0, 2.0], [3.5, 5.0], [4.0, -3.0]]
    assert spec.evaluate(["a", [(0.0, 1.0), (1.0, 5.0), (4.0, 0.0)]]) == [
        [0.0, -2.0],
        [1.0, 2.0],
        [2.0, -3.0],
    ]


def test_event_at_same_time_corrects_report() -> None:
    spec = declared("a > 0", ("a",))
    assert update(spec, {"a": [(0.0, 1.0), (4.0, 5.0)]}) == [[0.0, 1.0], [4.0, 5.0]]
    assert update(spec, {"a": [(4.0, 5.0), (6.0, 7.0)]}) == [[6.0, 7.0]]
    assert update(spec, {"a": [(6.0, 8.0)]}) == [[6.0, 8.0]]
    assert update(spec, {"a": [(6.0, 5.0), (7.0, 5.0)]}) == [[6.0, 5.0], [7.0, 5.0]]
    with pytest.raises(rtamt.InputError) as caught:
        update(spec, {"a": [(6.0, 8.0)]})
    assert str(caught.value) == "expected a time after 7.0 at event 0 of 'a', got 6.0"


def test_final_update_needs_events_of_every_variable() -> None:
    spec = declared("a > b")
    update(spec, {"a": [(0.0, 3.0)]})
    with pytest.raises(rtamt.StateError):
        spec.final_update()
    assert spec.final_update(["b", [[0.0, 1.0], [2.0, 2.0]]]) == [[0.0, 2.0], [2.0, 1.0]]


def test_value_at_the_last_tick() -> None:
    last = Fraction(2**62 - 1, 10**9)
    for time, reported in ((last - 1, True), (last, False)):
        spec = declared("a > 0", ("a",))
        shown = [[float(time), 2.0]]
        assert spec.update(["a", [[0.0, 1], [time, 2]]]) == [
            [0.0, 1.0],
            *(shown if reported else []),
        ]
        assert spec.final_update() == ([] if reported else shown)
