"""Explanations of verdicts under an end mode, against `judge` on changed traces."""

import math
import random
from collections.abc import Callable

import pytest

import rtamt
from rtamt import Verdict
from rtamt.internal import explain_dense_verdict, explain_verdict
from rtamt.typing import End

Trace = dict[str, list[float]]

SHAPES = (
    "always({a} implies eventually[0:2]({b}))",
    "always({a} implies eventually[1:3]({b} and {c}))",
    "eventually(always[1:2]({a}))",
    "always(({a}) until[0:3] ({b}))",
    "eventually({a} and eventually[0:2](not {b}))",
    "always(eventually[0:1]({a}))",
    "({a}) unless[0:4] ({b})",
    "always[0:3]({a} or next({b}))",
    "always(once[0:2]({a}) implies eventually[0:1]({b}))",
    "eventually(historically[0:2]({a}) and not ({b}))",
    "always({a} iff {b})",
    "always(rise({a}) implies eventually[0:2]({b}))",
    "always({a} implies ({b} since[0:2] {c}))",
    "not always({a} implies always[0:2]({b}))",
    "always({a} implies (eventually[0:2]({b}) xor {c}))",
    "always[0:3](eventually({a}))",
)


def drawn(seed: int) -> tuple[str, Trace]:
    """Formulas and traces with different numbers only."""
    chance = random.Random(seed)
    names = [chance.choice(["x", "y", "z"]) for _ in range(3)]
    a, b, c = (
        f"{name} {chance.choice(['>=', '<='])} {chance.uniform(-3, 3):.6f}" for name in names
    )
    formula = SHAPES[seed % len(SHAPES)].format(a=a, b=b, c=c)
    n = chance.randint(3, 9)
    return formula, {name: [chance.uniform(-6, 6) for _ in range(n)] for name in "xyz"}


def bound(judgement: rtamt.Judgement) -> float:
    """Return the bound that decides a verdict."""
    return judgement.upper if judgement.verdict is Verdict.VIOLATED else judgement.lower


Judge = Callable[[str, Trace, End], rtamt.Judgement]


def of_samples(formula: str, trace: Trace, end: End) -> rtamt.Judgement:
    return rtamt.judge(formula, trace, period=1, end=end)


def of_events(formula: str, trace: Trace, end: End) -> rtamt.Judgement:
    return rtamt.dense.judge(formula, events(trace), end)


def events(trace: Trace) -> dict[str, list[tuple[float, float]]]:
    return {name: [*enumerate(map(float, values))] for name, values in trace.items()}


def check_cause(
    formula: str, trace: Trace, end: End, judge: Judge, cause: tuple[str, float, float]
) -> bool:
    """Check that the deciding bound follows a named value; return whether the verdict does."""
    name, place, value = cause
    assert trace[name][int(place)] == value
    before = judge(formula, trace, end)
    changed = []
    for far in (-1e6, 1e6):
        values = [*trace[name]]
        values[int(place)] = far
        changed.append(judge(formula, {**trace, name: values}, end))
    violated = before.verdict is Verdict.VIOLATED
    bounds = {after.upper if violated else after.lower for after in changed}
    assert bounds != {bound(before)}, (formula, trace, cause)
    return {after.verdict for after in changed} != {before.verdict}


@pytest.mark.parametrize("end", ["cut", "open", "complete"])
def test_named_value_carries_the_bound(end: End) -> None:
    decided = explained = changed = 0
    for seed in range(320):
        formula, trace = drawn(seed)
        judgement = of_samples(formula, trace, end)
        if judgement.verdict is Verdict.UNDECIDED:
            continue
        decided += 1
        violated = judgement.verdict is Verdict.VIOLATED
        explanation = explain_verdict(formula, trace, 1, end=end, violated=violated)
        if explanation is None:
            continue
        explained += 1
        assert explanation.robustness == bound(judgement), (formula, trace)
        for cause in explanation.causes:
            changed += check_cause(formula, trace, end, of_samples, cause)
    assert explained > 0.95 * decided > 40
    assert changed > 0.25 * explained  # in the others another value decides as well


@pytest.mark.parametrize("end", ["cut", "open", "complete"])
def test_named_value_carries_the_bound_in_dense_time(end: End) -> None:
    decided = explained = changed = 0
    for seed in range(160):
        formula, trace = drawn(seed)
        if "next" in formula or "rise" in formula:
            continue
        judgement = of_events(formula, trace, end)
        if judgement.verdict is Verdict.UNDECIDED:
            continue
        decided += 1
        violated = judgement.verdict is Verdict.VIOLATED
        explanation = explain_dense_verdict(formula, events(trace), end, violated=violated)
        if explanation is None:
            continue
        explained += 1
        assert explanation.robustness == bound(judgement), (formula, trace)
        for cause in explanation.causes:
            event = (cause[0], math.floor(cause[1]), cause[2])
            changed += check_cause(formula, trace, end, of_events, event)
    assert explained > 0.95 * decided > 20
    assert changed > 0.25 * explained  # in the others another value decides as well


LATE = {"req": [0.0, 5, 0, 0, 0, 5], "gnt": [0.0, 0, 2, 2, 0, -10]}
RESPONSE = "always(req >= 3 implies eventually[0:2](gnt >= 3))"


def test_undecided_request_is_no_cause() -> None:
    explanation = explain_verdict(RESPONSE, LATE, 1, end="cut", violated=True)
    assert explanation is not None
    assert explanation.reason == "decided by gnt >= 3 at 2 s, where gnt = 2"
    held, *_ = explanation.contributions
    assert (str(held.formula), held.sample, held.role) == ("req >= 3", 1, "held")
    dense = explain_dense_verdict(RESPONSE, events(LATE), "cut", violated=True)
    assert dense is not None
    assert dense.reason == explanation.reason


def test_window_outside_the_trace_is_no_cause() -> None:
    trace = {"z": [-2.0, 4, -5, 0, 2]}
    formula = "eventually(always[1:2](z >= -1))"
    explanation = explain_verdict(formula, trace, 1, end="cut", violated=False)
    assert explanation is not None
    assert explanation.reason == "decided by z >= -1 at 3 s, where z = 0"


def test_no_explanation_of_unseen_samples() -> None:
    trace, formula = {"x": [-1.0, -2.0]}, "eventually[5:6](true) or x > 0"
    assert of_samples(formula, trace, "cut").verdict is Verdict.SATISFIED
    assert explain_verdict(formula, trace, 1, end="cut", violated=False) is None
    dense = explain_dense_verdict(formula, events(trace), "cut", violated=False)
    assert dense is None
