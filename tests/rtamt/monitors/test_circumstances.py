"""The other contributions to a violation, over samples and in dense time."""

import math
import pickle
import random

import numpy as np
import pytest
from choices import Backend
from dense_signals import Signals, relevant, signals
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from implying import dense_requirements, requirements
from oracle import robustness
from profiles import examples
from region_oracle import STEP, Regions
from strategies import FORMULAS, QUARTERS, Trace, formulas, length, rooted, traces

import rtamt
from rtamt import Explanation, Formula, explain, variable

Case = tuple[Formula, Trace, int]


def holds(value: float) -> bool:
    return math.copysign(1.0, value) > 0.0


@st.composite
def violated(draw: st.DrawFn, name: str | None = None) -> Case:
    """A formula, a trace, and a sample at which it is violated."""
    if name is not None:
        formula = draw(rooted(name, depth=2, endless=True))
    elif draw(st.booleans()):
        formula = draw(requirements(2))
    else:
        formula = draw(formulas(endless=True))
    trace = draw(traces(most=8))
    n = length(trace)
    if all(map(holds, robustness(formula, trace, n))):
        formula = ~formula
    failing = [i for i, value in enumerate(robustness(formula, trace, n)) if not holds(value)]
    return formula, trace, draw(st.sampled_from(failing))


def named(why: Explanation) -> list[tuple[Formula, range]]:
    """Return the formulas, and the samples, whose signs an explanation names."""
    found = [
        (each.formula, range(each.window[0], each.window[1] + 1))
        for each in why.contributions
        if each.outside is None
    ]
    last = why.steps[-1]
    if last.outside is None:
        found.append((last.formula, range(last.sample, last.sample + 1)))
    return found


@pytest.mark.parametrize("name", [None, *FORMULAS])
@settings(max_examples=examples(20))
@given(data=st.data())
def test_a_violation_stays_as_long_as_what_is_named_keeps_its_sign(
    name: str | None, data: st.DataObject
) -> None:
    formula, trace, sample = data.draw(violated(name))
    n = length(trace)
    why = explain(formula, trace, sample=sample, n=n)
    rng = random.Random(data.draw(st.integers(0, 2**32)))
    signs = [(f, i, holds(robustness(f, trace, n)[i])) for f, span in named(why) for i in span]
    for share in (0.1, 0.3, 0.5, 0.9) * 6:
        other = {
            name: [rng.choice(QUARTERS) if rng.random() < share else x for x in column]
            for name, column in trace.items()
        }
        if all(holds(robustness(f, other, n)[i]) == sign for f, i, sign in signs):
            assert not holds(robustness(formula, other, n)[sample])


@settings(max_examples=examples(150))
@given(case=violated())
def test_each_is_what_it_says(case: Case, backend: Backend) -> None:
    formula, trace, sample = case
    n = length(trace)
    why = explain(formula, trace, sample=sample, n=n, backend=backend)
    for each in why.contributions:
        first, last = each.window
        values = robustness(each.formula, trace, n)[first : last + 1]
        assert 0 <= first <= each.sample <= last < n
        assert {holds(value) for value in values} == {each.role == "held"}
        best = min(values) if each.role == "held" else max(values)
        assert each.value == best
        assert values.index(best) == each.sample - first
        assert each.role != "broken" or first == last
        assert each.outside is None or abs(each.value) == math.inf
        assert each.formula.variables
    assert all(len(line) <= 80 for line in str(why).splitlines())
    assert pickle.loads(pickle.dumps(why)) == why


@settings(max_examples=examples(60))
@given(case=violated())
def test_what_is_satisfied_has_none(case: Case) -> None:
    formula, trace, sample = case
    n = length(trace)
    assert explain(~formula, trace, sample=sample, n=n).contributions == ()


REQ, GNT = variable("req") >= 3, variable("gnt") >= 3


RESPONSES = st.sampled_from(
    (
        (REQ.implies(GNT.eventually(0, 2))).always(),
        (REQ.implies(GNT.eventually(1, 3))).always(0, 4),
        (REQ.rise() & REQ).implies(GNT.eventually()).always(),
        (REQ.once(0, 1).implies(GNT.eventually(0, 2).always(0, 1))).always(),
        REQ.implies(REQ.implies(GNT.eventually(0, 2))).always(),
        (REQ.implies(REQ.until(GNT, 0, 3))).always(),
        (REQ.implies(GNT)).always(),
    )
)


@settings(max_examples=examples(150))
@given(
    formula=RESPONSES,
    req=st.lists(st.sampled_from((0.0, 2.0, 3.0, 5.0)), min_size=8, max_size=8),
    gnt=st.lists(st.sampled_from((0.0, 2.0, 3.0)), min_size=8, max_size=8),
)
def test_of_a_violated_response_the_request_and_the_answer_are_named(
    formula: Formula, req: list[float], gnt: list[float], backend: Backend
) -> None:
    trace = {"req": req, "gnt": gnt}
    assume(not holds(robustness(formula, trace, 8)[0]))
    why = explain(formula, trace, backend=backend)
    variables = {name for f, _ in named(why) for name in f.variables}
    assert variables == {"req", "gnt"}
    roles = {each.role for each in why.contributions}
    assert roles
    assert "missing" in roles or why.causes[0].variable == "gnt"


def test_a_window_is_cut_to_the_trace() -> None:
    trace = {"req": [0, 0, 0, 4, 0], "gnt": [5, 0, 0, 1, 2]}
    why = explain("always(req >= 3 implies eventually[0:4](gnt >= 3))", trace)
    assert [(e.role, e.text, e.window, e.sample) for e in why.contributions] == [
        ("missing", "gnt >= 3", (3, 4), 4)
    ]


def test_the_text_names_both_sides() -> None:
    spec = "always(req >= 3 implies eventually[0:0.2](gnt >= 3))"
    trace = {"req": [0, 9, 0, 0, 0], "gnt": [5, 0, 0, 1, 4]}
    assert str(explain(spec, trace, period=0.1)).splitlines() == [
        "robustness -2 at 0 s, decided by gnt >= 3 at 0.3 s",
        "",
        "   at  value  formula",
        "  0 s     -2  always(req >= 3 implies eventually[0:0.2](gnt >= 3))",
        "0.1 s     -2  req >= 3 implies eventually[0:0.2](gnt >= 3)",
        "0.1 s     -2  eventually[0:0.2](gnt >= 3)",
        "0.3 s     -2  gnt >= 3",
        "0.3 s      1  gnt",
        "0.1 s      6  held: req >= 3",
        "0.3 s     -2  missing: gnt >= 3",
        "                never from 0.1 s to 0.3 s; this is the nearest",
    ]


def test_a_broken_until_says_which_side_broke() -> None:
    why = explain("a > 0 until[0:4] b > 0", {"a": [1, 1, -1, 2, 3], "b": [-1, -4, -3, 5, 6]})
    assert [(e.role, e.text, e.window, e.sample, e.value) for e in why.contributions] == [
        ("broken", "a > 0", (2, 2), 2, -1.0),
        ("missing", "b > 0", (0, 2), 0, -1.0),
    ]
    # No failure: the right side was not reached in the window.
    why = explain("a > 0 until[0:3] b > 0", {"a": [1] * 5, "b": [-1, -4, -3, -5, 6]})
    assert [(e.role, e.text, e.window) for e in why.contributions] == [("missing", "b > 0", (0, 3))]
    # It failed before the start of the window: the right side does not matter.
    why = explain("a > 0 until[2:3] b > 0", {"a": [1, -1, 1, 1, 1], "b": [1] * 5})
    assert (str(why.predicate), why.contributions) == ("a > 0", ())


def test_past_and_weak_operators_say_it_too() -> None:
    why = explain("a > 0 since[0:3] b > 0", {"a": [1, 1, -6, 2], "b": [1, 1, -3, -5]}, sample=3)
    assert [(e.role, e.text, e.window) for e in why.contributions] == [
        ("broken", "a > 0", (2, 2)),
        ("missing", "b > 0", (2, 3)),
    ]
    why = explain("a > 0 unless[0:4] b > 0", {"a": [1, 1, -1, -2, 3], "b": [-1, -4, -3, 5, 6]})
    assert [(e.role, e.text, e.window) for e in why.contributions] == [
        ("broken", "a > 0", (2, 2)),
        ("missing", "b > 0", (0, 2)),
    ]


def test_a_nested_response_names_each_condition() -> None:
    trace = {"req": [4, 0, 0], "on": [2, 2, 2], "gnt": [0, 0, 1]}
    spec = "ready = on > 1; always(req > 3 implies (ready implies eventually[0:1](gnt > 3)))"
    why = explain(spec, trace)
    assert [(e.role, e.name, e.text) for e in why.contributions] == [
        ("held", "ready", "on > 1"),
        ("missing", None, "gnt > 3"),
    ]
    assert "held: ready = on > 1" in str(why)


def test_a_window_outside_the_trace_is_said() -> None:
    why = explain("always(a > 0 implies eventually[3:4](b > 0))", {"a": [-1, -1, 2], "b": [1] * 3})
    assert str(why).splitlines()[-2:] == [
        "sample 2   -inf  missing: eventually[3:4](b > 0)",
        "                   its window lies outside the trace: sample 5 to sample 6",
    ]


@pytest.mark.slow
def test_of_many_the_text_shows_some() -> None:
    names = [f"x{i}" for i in range(3000)]
    formula = rtamt.disjunction(variable(name) > 0 for name in names)
    why = explain(formula, {name: np.array([-1.0]) for name in names})
    assert len(why.contributions) == 2999
    assert str(why).splitlines()[-1].endswith("and 2979 more")


def named_in_dense_time(why: rtamt.dense.Explanation, begin: float) -> list[tuple[Formula, range]]:
    """Return the formulas, and the regions, whose signs an explanation names."""

    def region(time: float) -> int:
        """Return the region of a time; a tick after an instant is in the interval after it."""
        place = (time - begin) / STEP
        return 2 * int(place) + (place != int(place))

    found = []
    for each in why.contributions:
        if each.outside is not None:
            continue
        first, last = map(region, each.window)
        if first == last:
            span = range(first + each.after, first + each.after + 1)
            assert each.open_begin == each.open_end == each.after
        else:
            whole = last % 2 == 1 or not each.open_end
            span = range(first + each.open_begin, last + whole)
        assert span[0] <= region(each.time) + each.after <= span[-1]
        found.append((each.formula, span))
    step = why.steps[-1]
    if step.outside is None:
        its = region(step.time) + step.after
        found.append((step.formula, range(its, its + 1)))
    return found


def check(formula: Formula, whole: Signals, instant: int, seed: int, backend: Backend) -> None:
    """The formula, or its negation, is violated at an instant as long as the named parts stay."""
    assume(formula.variables)
    its = relevant(whole, formula.variables)
    regions = Regions(its, STEP)
    place = 2 * min(instant, regions.steps)
    if holds(regions.at(formula, "complete")(place)[0]):
        formula = ~formula
    why = rtamt.dense.explain(
        formula, its, float(regions.begin) + place // 2 * STEP, backend=backend
    )
    signs = []
    for f, span in named_in_dense_time(why, float(regions.begin)):
        at = regions.at(f, "complete")
        signs += [(f, i, holds(at(i)[0])) for i in span]
    for each in why.contributions:
        own = {sign for f, _, sign in signs if f is each.formula}
        assert each.outside is not None or (each.role == "held") in own
    assert all(len(line) <= 80 for line in str(why).splitlines())
    rng = random.Random(seed)
    for share in (0.1, 0.4, 0.9):
        other = {
            name: [(t, rng.choice(QUARTERS) if rng.random() < share else x) for t, x in events]
            for name, events in its.items()
        }
        after = Regions(other, STEP)
        if all(holds(after.at(f, "complete")(i)[0]) == sign for f, i, sign in signs):
            assert not holds(after.at(formula, "complete")(place)[0])


seeds = st.integers(0, 2**32)


@settings(max_examples=examples(30))
@given(
    formula=st.one_of(dense_requirements(), formulas(2, dense=True)), whole=signals(), seed=seeds
)
def test_a_violation_in_dense_time_stays_too(
    formula: Formula, whole: Signals, seed: int, backend: Backend
) -> None:
    check(formula, whole, 0, seed, backend)


@pytest.mark.parametrize("name", ["since", "until", "unless"])
@settings(max_examples=examples(50))
@given(data=st.data(), whole=signals(), instant=st.integers(0, 12), seed=seeds)
def test_so_does_one_of_two_operands_at_any_time(
    name: str, data: st.DataObject, whole: Signals, instant: int, seed: int, backend: Backend
) -> None:
    check(data.draw(rooted(name, 1, dense=True)), whole, instant, seed, backend)


def test_of_a_violated_response_the_request_and_the_grant_are_named(backend: Backend) -> None:
    trace: Signals = {
        "req": [(0.0, 0.0), (1.5, 9.0), (1.6, 0.0), (9.0, 0.0)],
        "gnt": [(0.0, 0.0), (4.0, 2.0), (9.0, 2.0)],
    }
    why = rtamt.dense.explain(
        "always(req >= 3 implies eventually[0:3](gnt >= 3))", trace, backend=backend
    )
    assert str(why).splitlines()[3:] == [
        "  0 s     -1  always(req >= 3 implies eventually[0:3](gnt >= 3))",
        "1.5 s     -1  req >= 3 implies eventually[0:3](gnt >= 3)",
        "1.5 s     -1  eventually[0:3](gnt >= 3)",
        "  4 s     -1  gnt >= 3",
        "  4 s      2  gnt",
        "1.5 s      6  held: req >= 3",
        "  4 s     -1  missing: gnt >= 3",
        "                never from 1.5 s to 4.5 s; this is the nearest",
    ]
    grant = why.contributions[1]
    assert (grant.role, grant.window, grant.open_begin, grant.open_end) == (
        "missing",
        (1.5, 4.5),
        False,
        False,
    )


def test_a_broken_until_in_dense_time_says_which_side_broke(backend: Backend) -> None:
    a = [(0.0, 1.0), (2.0, -1.0), (9.0, 1.0)]
    trace: Signals = {"a": a, "b": [(0.0, -3.0), (3.0, 5.0), (9.0, 5.0)]}
    why = rtamt.dense.explain("a > 0 until[0:4] b > 0", trace, backend=backend)
    assert [(e.role, e.text, e.window) for e in why.contributions] == [("missing", "b > 0", (0, 2))]
    assert (str(why.predicate), why.steps[-1].time) == ("a > 0", 2)
    trace = {"a": a, "b": [(0.0, -0.5), (9.0, 5.0)]}
    why = rtamt.dense.explain("a > 0 until[0:4] b > 0", trace, backend=backend)
    assert [(e.role, e.text, e.window) for e in why.contributions] == [
        ("broken", "a > 0", (2, 2)),
        ("missing", "b > 0", (0, 2)),
    ]


def test_a_window_from_right_after_a_time_does_not_have_its_begin(backend: Backend) -> None:
    trace: Signals = {  # the until holds only at 0 s
        "p": [(0.0, 1.0), (1.0, -1.0), (9.0, -1.0)],
        "q": [(0.0, -1.0), (1.0, 1.0), (9.0, 1.0)],
        "r": [(0.0, -2.0), (9.0, -2.0)],
    }
    spec = "always[0:2](p > 0 until[1:2] q > 0 or eventually[3:4](r > 0))"
    why = rtamt.dense.explain(spec, trace, resolution="1s", backend=backend)
    assert (why.steps[1].time, why.steps[1].after) == (0, True)
    (missing,) = [each for each in why.contributions if each.text == "r > 0"]
    assert (missing.role, missing.window) == ("missing", (3, 5))
    assert (missing.open_begin, missing.open_end) == (True, True)
