"""What `update` of the released dense classes gives at each call, on generated chunks."""

import math
from fractions import Fraction

import pytest
from compat_specs import LANGUAGES, Pairs, call, held, update
from compat_specs import declared_dense as declared
from dense_signals import Breakpoints, Signals, by_value, chunked, chunks, relevant, signals
from hypothesis import given, settings
from profiles import examples
from strategies import formulas

import rtamt
from rtamt import DenseMonitor, Formula, evaluate_dense

bounded = formulas(dense=True).filter(lambda f: f.variables)


def settled(formula: Formula, known: Signals) -> float | None:
    """The least last time of the variables, if all are known then."""
    if any(not known.get(name) for name in formula.variables):
        return None
    signals = relevant(known, formula.variables)
    end = min(events[-1][0] for events in signals.values())
    return end if max(events[0][0] for events in signals.values()) <= end else None


def decided(formula: Formula, known: Signals, end: float) -> Breakpoints:
    """All that the events decide up to the settled time, each at the time at which they do.

    What may still come can change only the robustness after that time less the horizon: every
    variable keeps its value from there on.
    """
    horizon, lasting = DenseMonitor(formula).horizon, {}
    for name, events in relevant(known, formula.variables).items():
        before = [event for event in events if event[0] <= end]
        lasting[name] = [*before, (end + horizon + 100.0, before[-1][1])]
    steps = evaluate_dense(formula, lasting)
    # Between zeros of other signs there is no step for programs.
    return by_value([(time + horizon, value) for time, value in steps if time <= end - horizon])


def expected_of(formula: Formula, known: Signals, before: float | None) -> Pairs:
    """What a call gives after which these events are known; `before` is the settled time then."""
    end = settled(formula, known)
    if end is None or end == before:
        return []
    steps = decided(formula, known, end)
    if not steps:  # the window of the first instant is not over
        so_far = {n: [e for e in known[n] if e[0] <= end] for n in formula.variables}
        return [[end, evaluate_dense(formula, held(so_far))[0][1]]]
    news = [list(step) for step in steps if before is None or step[0] > before]
    return news if news and news[-1][0] == end else [*news, [end, steps[-1][1]]]


@given(formula=bounded, whole=signals(), shares=chunks())
def test_update_gives_the_new_steps_and_the_value_at_the_settled_time(
    formula: Formula, whole: Signals, shares: list[list[float]], backend: str
) -> None:
    spec = declared(formula, language=LANGUAGES[backend])
    known: Signals = {}
    before = None
    for chunk in chunked(whole, shares):
        told = update(spec, chunk)
        for name, events in chunk.items():
            known.setdefault(name, []).extend(events)
        assert told == expected_of(formula, known, before)
        before = settled(formula, known)
        if told:
            assert spec.get_value("out") == told[-1][1]


def function(pairs: Pairs, since: float = -math.inf) -> Breakpoints:
    """The step function that pairs describe; of several at one time the last counts."""
    return by_value(sorted({time: value for time, value in pairs if time >= since}.items()))


def whole_trace(formula: Formula, whole: Signals) -> Breakpoints:
    """What `evaluate` gives, each step at the time at which it is known online."""
    horizon = DenseMonitor(formula).horizon
    steps = evaluate_dense(formula, held(relevant(whole, formula.variables)))
    return by_value([(time + horizon, value) for time, value in steps])


@settings(max_examples=examples(50))
@given(formula=bounded, whole=signals(), shares=chunks())
def test_with_final_update_the_calls_give_what_evaluate_does(
    formula: Formula, whole: Signals, shares: list[list[float]], backend: str
) -> None:
    *calls, last = chunked(whole, shares)
    spec = declared(formula, language=LANGUAGES[backend])
    told = [pair for chunk in calls for pair in update(spec, chunk)]
    told += spec.final_update(*call(last))
    expected = whole_trace(formula, whole)
    assert function(told, since=expected[0][0]) == expected
    with pytest.raises(rtamt.StateError, match="the trace is finished"):
        update(spec, {formula.variables[0]: [(1e6, 0.0)]})


@settings(max_examples=examples(50))
@given(formula=bounded, whole=signals())
def test_an_event_replaces_the_one_of_the_same_time_in_whatever_call(
    formula: Formula, whole: Signals, backend: str
) -> None:
    spec = declared(formula, language=LANGUAGES[backend])
    told = []
    events = [(time, name, value) for name in whole for time, value in whole[name]]
    for time, name, value in sorted(events):
        told += update(spec, {name: [(time, value + 3.0)]})
        told += update(spec, {name: [(time, value - 2.0), (time, value)]})
    told += spec.final_update()
    expected = whole_trace(formula, whole)
    assert function(told, since=expected[0][0]) == expected


# Calls. ------------------------------------------------------------------------------------------


def test_an_event_is_answered_at_its_own_time() -> None:
    spec = declared("once[0:2](a >= 3)")
    answers = [update(spec, {"a": [(t, v)]}) for t, v in [(0.0, 1.0), (1.5, 5.0), (3.0, 2.0)]]
    assert answers == [[[0.0, -2.0]], [[1.5, 2.0]], [[3.0, 2.0]]]
    assert update(spec, {"a": [(7.0, 2.5)]}) == [[5.0, -1.0], [7.0, -0.5]]


def test_every_call_that_moves_time_gives_a_pair_though_the_value_stays() -> None:
    spec = declared("a > b")
    answers = [update(spec, {"a": [(t, 3.0)], "b": [(t, 1.0)]}) for t in (0.0, 1.0, 2.0)]
    assert answers == [[[0.0, 2.0]], [[1.0, 2.0]], [[2.0, 2.0]]]
    assert update(spec, {"a": [(9.0, 4.0)]}) == []
    assert update(spec, {"b": []}) == []
    assert update(spec, {"b": [(5.0, 1.0)]}) == [[5.0, 2.0]]


def test_until_a_window_is_over_update_gives_the_robustness_of_the_trace_so_far() -> None:
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


def test_an_event_of_the_same_time_corrects_what_was_told() -> None:
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


def test_the_value_at_the_last_tick_that_a_clock_counts_comes_with_the_end() -> None:
    last = Fraction(2**62 - 1, 10**9)
    for time, told in ((last - 1, True), (last, False)):
        spec = declared("a > 0", ("a",))
        shown = [[float(time), 2.0]]
        assert spec.update(["a", [[0.0, 1], [time, 2]]]) == [[0.0, 1.0], *(shown if told else [])]
        assert spec.final_update() == ([] if told else shown)
