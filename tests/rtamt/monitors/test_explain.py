"""Explanations over samples: every step follows the definitions, and the last one decides."""

import copy
import itertools
import math
import pickle
import random
import sys
from typing import Any

import numpy as np
import pytest
from bits import identical
from choices import Backend
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from opened import opened
from oracle import bounds, robustness
from profiles import examples
from strategies import FORMULAS, INTEGERS, QUARTERS, Trace, formulas, length, rooted, traces

import rtamt
from rtamt import (
    EpisodeMonitor,
    Explanation,
    Formula,
    InputError,
    StateError,
    evaluate,
    explain,
    holds,
    variable,
)

INF = math.inf


@st.composite
def explained(draw: st.DrawFn, name: str | None = None) -> tuple[Formula, Trace, int]:
    """A formula, a trace, and a sample."""
    formula = formulas(endless=True) if name is None else rooted(name, depth=2, endless=True)
    trace = draw(traces(values=QUARTERS + INTEGERS))
    return draw(formula), trace, draw(st.integers(0, length(trace) - 1))


# What the steps say. -----------------------------------------------------------------------------
def offsets(formula: Formula, i: int, n: int) -> range:
    """Return the samples of the trace in the window of a temporal operator."""
    assert formula.op is not None
    first, last = bounds(formula)
    if formula.op.sampled:
        first = last = 1
    if formula.op.future:
        return range(i + first, int(min(n - 1, i + last)) + 1)
    return range(int(max(0, i - last)), i - first + 1)


def reached(formula: Formula, trace: Trace, n: int, i: int, j: int) -> float:
    """Return the value of until and since for the witness j, by definition."""
    p, q = (robustness(arg, trace, n) for arg in formula.args)
    return min([q[j], *(p[i:j] if j >= i else p[j + 1 : i + 1])])


@pytest.mark.parametrize("name", FORMULAS)
@settings(max_examples=examples(25))
@given(data=st.data())
def test_every_step_has_the_value_of_its_formula_and_goes_on_with_an_operand_of_that_value(
    name: str, data: st.DataObject, backend: Backend
) -> None:
    formula, trace, sample = data.draw(explained(name))
    n = length(trace)
    explanation = explain(formula, trace, sample=sample, n=n, backend=backend)
    steps = explanation.steps
    assert (steps[0].formula, steps[0].sample) == (formula, sample)
    for step in steps:
        assert identical([step.value], [robustness(step.formula, trace, n)[step.sample]])
        if step.witness is not None:
            assert step.witness in offsets(step.formula, step.sample, n)
            value = reached(step.formula, trace, n, step.sample, step.witness)
            assert value == step.value
    for step, below in itertools.pairwise(steps):
        assert below.formula in step.formula.args
        assert abs(below.value) == abs(step.value)
        assert step.outside is None
    last = steps[-1]
    assert last.formula.op is not None
    if last.outside is not None:
        assert abs(last.value) == INF
        assert not offsets(last.formula, last.sample, n)
    else:
        assert last.formula.op.operands == "term"
    causes = last.formula.variables if last.outside is None else ()
    assert explanation.causes == tuple((v, last.sample, trace[v][last.sample]) for v in causes)


@given(case=explained())
def test_back_ends_explain_alike(case: tuple[Formula, Trace, int]) -> None:
    formula, trace, sample = case
    one, other = (
        explain(formula, trace, sample=sample, n=length(trace), backend=backend)
        for backend in ("python", rtamt.BACKEND)
    )
    assert one == other


# That it decided. --------------------------------------------------------------------------------
Case = tuple[Formula, Trace, int, Explanation]


@st.composite
def decided(draw: st.DrawFn) -> Case:
    """Predicates with values that differ from each other and from each other's negations."""
    formula, names = opened(draw(formulas(endless=True)))
    n = draw(st.integers(1, 12))
    rng = random.Random(draw(st.integers(0, 2**32)))
    magnitudes = rng.sample(range(1, 1 + n * len(names)), n * len(names))
    values = [m * rng.choice((-1.0, 1.0)) for m in magnitudes]
    trace = {name: values[i :: len(names)] for i, name in enumerate(names)}
    sample = draw(st.integers(0, n - 1))
    return formula, trace, n, explain(formula, trace, sample=sample, n=n)


@given(case=decided(), move=st.sampled_from((-0.75, -0.25, 0.5)))
def test_the_robustness_follows_the_deciding_value_wherever_the_others_move_on_their_side(
    case: Case, move: float
) -> None:
    formula, trace, n, explanation = case
    assume(math.isfinite(explanation.robustness))
    (cause,) = explanation.causes
    assert cause.value in (explanation.robustness, -explanation.robustness)
    sign = cause.value / explanation.robustness
    bound = abs(cause.value)
    apart = {
        name: [math.copysign(1e6, v) if abs(v) > bound else v / 1e6 for v in values]
        for name, values in trace.items()
    }
    for others in (trace, apart):
        moved = {name: list(values) for name, values in others.items()}
        moved[cause.variable][cause.sample] = cause.value + move
        after = robustness(formula, moved, n)[explanation.sample]
        assert after == explanation.robustness + sign * move


@given(case=decided(), seed=st.integers(0, 2**32))
def test_no_value_matters_where_no_value_decided(case: Case, seed: int) -> None:
    formula, trace, n, explanation = case
    assume(not explanation.causes)
    rng = random.Random(seed)
    other = {name: [rng.choice(QUARTERS) for _ in values] for name, values in trace.items()}
    after = robustness(formula, other, n)[explanation.sample]
    assert after == explanation.robustness
    assert abs(after) == INF


# Ties, forms and texts. --------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("formula", "sample", "decided"),
    [
        ("always(a)", 0, ("a", 1)),
        ("eventually(not a)", 0, ("a", 1)),
        ("historically(a)", 3, ("a", 1)),
        ("once(not a)", 3, ("a", 1)),
        ("a and b", 3, ("a", 3)),
        ("b and a", 3, ("b", 3)),
        ("not b implies a", 3, ("b", 3)),
        ("a until (c + 0)", 0, ("a", 1)),
        ("b since a", 3, ("b", 1)),
    ],
)
def test_of_equal_values_the_first_operand_and_the_first_sample_decide(
    formula: str, sample: int, decided: tuple[str, int]
) -> None:
    trace = {"a": [2, 1, 2, 1], "b": [1, 1, 1, 1], "c": [0, 0, 1, 1]}
    explanation = explain(formula, trace, sample=sample)
    assert abs(explanation.robustness) == 1
    assert [(c.variable, c.sample) for c in explanation.causes] == [decided]


SPEC = """
granted = eventually[0:1s](gnt >= 3)
out = always(req >= 3 implies granted)
"""


TRACE: dict[str, Any] = {
    "gnt": [0, 0, 0, 2.5, 1],
    "req": [0, 0, 5, 0, 0],
    "note": ["", "", "", "", ""],
}


def test_an_explanation_is_a_table_with_names_times_and_the_values_that_decided() -> None:
    explanation = explain(SPEC, TRACE, "500ms", start=100)
    assert str(explanation) == (
        "robustness -0.5 at 100 s, decided by gnt >= 3 at 101.5 s\n"
        "\n"
        "     at  value  formula\n"
        "  100 s   -0.5  out = always(req >= 3 implies granted)\n"
        "  101 s   -0.5  req >= 3 implies granted\n"
        "  101 s   -0.5  granted = eventually[0:1s](gnt >= 3)\n"
        "101.5 s   -0.5  gnt >= 3\n"
        "101.5 s    2.5  gnt\n"
        "  101 s      2  held: req >= 3\n"
        "101.5 s   -0.5  missing: gnt >= 3\n"
        "                  never from 101 s to 102 s; this is the nearest"
    )
    assert [step.name for step in explanation.steps] == ["out", None, "granted", None]
    assert [step.time for step in explanation.steps] == [100, 101, 101, 101.5]
    assert explanation.robustness == -0.5
    assert explanation.predicate is (variable("gnt") >= 3)
    assert explanation.causes == (("gnt", 3, 2.5),)
    assert pickle.loads(pickle.dumps(explanation)) == explanation


@pytest.mark.parametrize(
    ("formula", "b", "said"),
    [
        ("a > 0 until b > 0", [-1, -2, -3], "nearest: the right side at sample 0"),
        ("a > 0 until b > 0", [-1, -2, 0], "nearest: the right side at sample 2"),
        ("a > 0 until b >= 0", [-1, -2, 0], "witness: the right side at sample 2"),
        ("not (a > 0 until b > 0)", [-1, -2, -3], "nearest: the right side at sample 0"),
        ("not (a > 0 until b > 0)", [-1, -2, 3], "witness: the right side at sample 2"),
        ("historically(a > 0 since b > 0)", [-1, -2, -3], "nearest: the right side at sample 0"),
        # The right side holds there, and the left side failed before.
        ("a > 1 until b > 0", [-1, -2, 3], "nearest: the right side at sample 2"),
    ],
)
def test_only_what_holds_has_a_witness(formula: str, b: list[float], said: str) -> None:
    text = str(explain(formula, {"a": [3, 1, 2], "b": b}))
    assert [line.strip() for line in text.splitlines() if "right side at" in line] == [said]


def test_a_zero_that_hangs_on_a_predicate_left_out_has_no_witness() -> None:
    text = "input float64 a; output float64 b; a > 0 until b > 0"
    explanation = explain(text, {"a": [3, 1], "b": [-1, 2]}, semantics="input-vacuity")
    assert (explanation.robustness, explanation.steps[-1].reading) == (0, "zero")
    assert "nearest: the right side at sample 0" in str(explanation)


def test_a_witness_and_a_window_outside_the_trace_are_named() -> None:
    trace = {"a": [3, 1, 2, 3], "b": [0, 0, 5, 0]}
    assert str(explain("a until[1:3] b", trace)) == (
        "robustness 1 at sample 0, decided by a at sample 1\n"
        "\n"
        "      at  value  formula\n"
        "sample 0      1  a until[1:3] b\n"
        "                   witness: the right side at sample 2\n"
        "sample 1      1  a\n"
        "sample 1      1  a"
    )
    shown = {
        "not eventually[5:9](a)": "2.5 s to 4.5 s",
        "always[4:4](a)": "2 s",
        "eventually[4:inf](a)": "from 2 s on",
        "once[1:inf](a)": "up to -0.5 s",
        "prev a": "-0.5 s",
        "a since[2:3] b": "-1.5 s to -1 s",
    }
    for formula, window in shown.items():
        text = formula.replace("9", "4.5").replace("5:", "2.5:").replace("4:4", "2:2")
        text = text.replace("[4:", "[2:").replace("1:inf", "0.5:inf").replace("2:3", "1:1.5")
        explanation = explain(text, trace, 0.5)
        assert explanation.causes == ()
        assert explanation.predicate is None
        assert str(explanation).splitlines()[-1].strip() == (
            f"its window lies outside the trace: {window}"
        )


def test_times_have_the_digits_that_tell_samples_apart() -> None:
    explanation = explain("always(a)", {"a": [3, 3, 1]}, 0.1, start=1_700_000_000)
    assert str(explanation).splitlines()[-1] == "1700000000.2 s      1  a"


def test_of_two_names_of_a_formula_the_first_is_shown() -> None:
    explanation = explain("p = a > 2; q = a > 2; always(q)", {"a": [3, 1]})
    assert [step.name for step in explanation.steps] == [None, "p"]
    assert str(explanation).splitlines()[3] == "sample 0     -1  always(p)"


def test_what_a_predicate_counts_under_interface_semantics_is_said() -> None:
    spec = "input float req; output float gnt; always(req >= 3 implies {})"
    given = explain(spec.format("false and gnt > 1"), TRACE, semantics="output-robustness")
    assert str(given) == (
        "robustness -inf at sample 0, decided by req >= 3 at sample 2\n"
        "\n"
        "      at  value  formula\n"
        "sample 0   -inf  always(req >= 3 implies false and gnt > 1)\n"
        "sample 2   -inf  req >= 3 implies false and gnt > 1\n"
        "sample 2    inf  req >= 3\n"
        "                   counts only whether it holds\n"
        "sample 2      5  req"
    )
    mixed = explain(spec.format("req > gnt"), TRACE, semantics="output-vacuity")
    assert str(mixed).splitlines()[5:7] == [
        "sample 0      0  req > gnt",
        "                   of no concern: counts 0",
    ]


@given(case=explained())
def test_explanations_fit_80_columns(case: tuple[Formula, Trace, int]) -> None:
    formula, trace, sample = case
    explanation = explain(formula, trace, 1, sample=sample, n=length(trace), start=1e9)
    assert max(map(len, str(explanation).splitlines())) <= 80


def test_held_values_are_causes() -> None:
    explanation = explain("always(a)", {"a": [3, 1, math.nan]}, sample=2, nan="hold")
    assert explanation.causes == (("a", 2, 1.0),)


def test_a_formula_without_variables_is_explained_by_itself() -> None:
    explanation = explain("eventually(true)", {}, n=2)
    assert (explanation.predicate, explanation.causes) == (rtamt.parse("(true)").formula, ())


# Refused. ----------------------------------------------------------------------------------------


def test_what_evaluate_refuses_is_refused_alike() -> None:
    cases: list[tuple[str, dict[str, list[float]], dict[str, Any]]] = [
        ("always(a)", {"b": [1]}, {}),
        ("always(a)", {"a": []}, {}),
        ("always(sqrt(a) > 0)", {"a": [1, -1]}, {}),
        ("always[0:1.5](a)", {"a": [1]}, {}),
        ("always[0:1ms](a)", {"a": [1]}, {"period": 0.3}),
        ("always(a)", {"a": [1]}, {"semantics": "input-vacuity"}),
        ("a = always(b\n", {"b": [1]}, {}),
    ]
    for formula, data, options in cases:
        messages = []
        for function in (rtamt.evaluate, explain):
            with pytest.raises(rtamt.RtamtError) as caught:
                function(formula, data, **options)
            messages.append(str(caught.value))
        assert messages[0] == messages[1]


def test_an_array_has_the_columns_that_evaluate_expects() -> None:
    text = "f = always(b > 0); always(a > 0)"
    table = np.array([[1.0, 5.0], [2.0, 4.0]])
    assert explain(text, table).robustness == rtamt.evaluate(text, table)[0]


def test_of_a_zero_it_is_said_whether_the_formula_holds() -> None:
    assert str(explain("not (a > 3) and a >= -0.0", {"a": [3]})) == (
        "robustness 0, holds, at sample 0, decided by a > 3 at sample 0\n"
        "\n"
        "      at        value  formula\n"
        "sample 0     0, holds  not (a > 3) and a >= -0\n"
        "sample 0     0, holds  not (a > 3)\n"
        "sample 0  0, violated  a > 3\n"
        "sample 0            3  a"
    )
    assert "0, violated, at sample 0" in str(explain("a > 0", {"a": [0]}))


def test_the_zero_that_decides_is_the_one_with_the_sign_of_the_whole() -> None:
    trace = {"a": [0, 0, 1], "b": [1, 0, 0]}
    explanation = explain("always(a >= 0 and (a >= 0 until[0:1] b > 0))", trace)
    assert [(s.text, s.sample) for s in explanation.steps][-1] == ("b > 0", 1)
    explanation = explain("eventually(a > 0 or b == 0)", {"a": [0, 0], "b": [1, 0]})
    assert [(s.text, s.sample) for s in explanation.steps][-1] == ("b == 0", 1)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("junction", ["and", "or"])
def test_a_formula_of_many_operands_is_explained(junction: str) -> None:
    count = 2 * sys.getrecursionlimit()
    text = f" {junction} ".join(f"x > {i}" for i in range(count))
    explanation = explain(text, {"x": [5]})
    decided = f"x > {count - 1}" if junction == "and" else "x > 0"
    assert [str(step.formula) for step in explanation.steps[1:]] == [decided]
    assert f"decided by {decided} at sample 0" in str(explanation)


def test_what_decides_nothing_may_have_no_value() -> None:
    text, trace = "sqrt(x) > 0 until[0:0] y > 0", {"x": [-1], "y": [1]}
    assert evaluate(text, trace).tolist() == [1.0]
    assert str(explain(text, trace)) == (
        "robustness 1 at sample 0, decided by y > 0 at sample 0\n"
        "\n"
        "      at  value  formula\n"
        "sample 0      1  sqrt(x) > 0 until[0:0] y > 0\n"
        "                   witness: the right side at sample 0\n"
        "sample 0      1  y > 0\n"
        "sample 0      1  y"
    )
    assert explain(f"({text}) and x < 0", trace).robustness == 1.0


def test_times_without_end_are_shown_in_all_digits_that_doubles_have() -> None:
    explanation = explain("x > 0", {"x": [1]}, period="1e-300", start=1e300)
    assert "decided by x > 0 at 1e+300 s" in str(explanation)
    explanation = explain("x > 0", {"x": [1, 1]}, period="1e-300", sample=1)
    assert "at 1e-300 s" in str(explanation)
    explanation = explain("x > 0", {"x": [1, 1]}, period=1e-9, start=1.7e9, sample=1)
    assert "at 1700000000 s" in str(explanation)


def test_a_zero_that_hangs_on_a_predicate_of_no_concern_neither_holds_nor_fails() -> None:
    text = "input float req; output float gnt; always(req >= 3 implies gnt >= 3)"
    explanation = explain(text, {"req": [3], "gnt": [0]}, semantics="input-vacuity")
    assert "robustness 0 at sample 0" in str(explanation)
    assert "holds" not in str(explanation)
    given = explain("x > 3", {"x": [3]}, semantics="boolean")
    assert given.robustness == -math.inf
    assert not holds(given.robustness)
    assert "counts only whether it holds" in str(given)


def test_a_formula_without_spaces_fills_its_lines_and_is_not_broken_at_a_minus() -> None:
    formula = f"{'abs(-' * 40}x{')' * 40}"
    first, second, *_ = str(explain(f"{formula} > 5", {"x": [1]})).splitlines()
    assert (len(first), len(second)) == (80, 80)
    assert f"decided by {formula}".startswith(first[first.index("decided") :] + second.strip())


def fed(monitor: EpisodeMonitor, trace: Trace, samples: range) -> EpisodeMonitor:
    for i in samples:
        monitor.update({name: trace[name][i] for name in monitor.variables})
    return monitor


@settings(max_examples=examples(30))
@given(formula=formulas(endless=True), trace=traces(least=2), data=st.data())
def test_an_episode_is_explained_as_the_trace_of_its_samples(
    formula: Formula, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    n = length(trace)
    cut = data.draw(st.integers(1, n))
    monitor = EpisodeMonitor(formula, 0.5, backend=backend, history=True)
    plain = EpisodeMonitor(formula, 0.5, backend=backend)
    fed(monitor, trace, range(cut))
    part = {name: values[:cut] for name, values in trace.items()}
    explanation = explain(formula, part, 0.5, n=cut, backend=backend)
    assert monitor.explain() == explanation
    assert explanation.robustness == monitor.robustness
    fed(plain, trace, range(cut))
    assert (monitor.lower, monitor.upper) == (plain.lower, plain.upper)
    for twin in (copy.copy(monitor), pickle.loads(pickle.dumps(monitor))):
        assert twin.explain() == explanation
        fed(twin, trace, range(cut, n))
        assert twin.explain() == explain(formula, trace, 0.5, n=n, backend=backend)
    assert monitor.explain() == explanation
    monitor.reset()
    fed(monitor, trace, range(1))
    monitor.finish()
    assert monitor.explain().robustness == monitor.robustness


def test_an_episode_without_history_says_how_to_be_explained() -> None:
    monitor = EpisodeMonitor("always(a)")
    monitor.update(a=1)
    with pytest.raises(StateError) as caught:
        monitor.explain()
    assert str(caught.value) == (
        "explain() needs the samples of the episode; make the monitor with history=True"
    )
    with pytest.raises(StateError) as caught:
        EpisodeMonitor("always(a)", history=True).explain()
    assert str(caught.value) == "explain() needs at least one sample, got none since reset"


def test_a_state_replaces_the_samples_that_were_kept(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(a)", history=True, backend=backend)
    monitor.update(a=3)
    *_, state = monitor.__reduce__()
    monitor.update(a=1)
    monitor.__setstate__(state)
    monitor.update(a=2)
    assert monitor.explain().causes == (("a", 1, 2.0),)


def test_a_refused_sample_is_not_kept(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(a)", history=True, backend=backend)
    monitor.update(a=3)
    with pytest.raises(InputError):
        monitor.update(a=math.nan)
    monitor.update(2.0)
    assert monitor.explain().causes == (("a", 1, 2.0),)


def test_without_history_update_is_the_method_of_the_machine(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(a)", backend=backend)
    assert monitor.update == monitor._machine.update
