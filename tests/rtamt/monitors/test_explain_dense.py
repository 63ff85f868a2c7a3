"""Explanations in dense time: every step follows the definitions, and the last one decides."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable
from fractions import Fraction
from typing import Any, NamedTuple, cast

import golden_cases
import numpy as np
import pytest
from bits import bits
from choices import Backend
from dense_oracle import STEP
from dense_signals import INTEGERS, Signals, relevant, signals
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from opened import opened
from oracle import order
from profiles import examples
from reasons_oracle import Operands, Part, same
from reasons_oracle import holds as reason_holds
from region_oracle import Regions
from strategies import DENSE, INFINITIES, formulas, rooted

import rtamt
from rtamt import Formula, holds, variable
from rtamt.language.formula import make
from rtamt.language.interval import Interval
from rtamt.language.node import Node
from rtamt.monitors.explanation import DenseContribution, DenseExplanationStep

INF = math.inf


# What the steps say. -----------------------------------------------------------------------------
class Checked:
    """An explanation, checked by a definition that knows nothing of explanations."""

    def __init__(self, definition: Regions, explanation: rtamt.dense.Explanation) -> None:
        self.definition = definition
        self.last = 2 * definition.steps
        self.steps = explanation.steps
        for step in self.steps:
            assert order(step.value) == order(self.value(step.formula, self.place(step)))
            self.check_witness(step)
        for step, below in itertools.pairwise(self.steps):
            assert below.formula in step.formula.args
            assert order(below.value) in (order(step.value), order(-step.value))
            assert step.outside is None
            self.check_place(step, self.place(below))
        last = self.steps[-1]
        assert last.formula.op is not None
        if last.outside is None:
            assert last.formula.op.operands == "term"
        else:
            assert abs(last.value) == INF
            assert not self.window(last)

    def region(self, time: float, *, after: bool) -> int:
        """Return the region of a time in the definition, or the region right after it."""
        steps = (time - self.definition.begin) / self.definition.step
        assert steps == int(steps)
        return 2 * int(steps) + after

    def place(self, step: DenseExplanationStep) -> int:
        return self.region(step.time, after=step.after)

    def value(self, formula: Formula | Node, place: int) -> float:
        return self.definition.at(formula, "complete")(place)[1]

    def window(self, step: DenseExplanationStep) -> range:
        """Return the regions of the trace in the window of an operator."""
        f = step.formula
        assert f.op is not None
        scale = 2 / self.definition.step
        first = 0 if f.interval is None else int(f.interval.begin * scale)
        end = None if f.interval is None else f.interval.end
        last = self.last if end is None else int(end * scale)
        now = self.place(step)
        if f.op.future:
            return range(now + first, min(self.last, now + last) + 1)
        return range(max(0, now - last), now - first + 1)

    def check_place(self, step: DenseExplanationStep, place: int) -> None:
        """Check that the operator reads the operand's place."""
        assert step.formula.op is not None
        if not step.formula.op.timed:
            assert place == self.place(step)
        elif step.formula.op.name not in ("until", "since", "unless"):
            assert place in self.window(step)
        elif step.witness is not None:
            first, last = sorted(
                (self.place(step), self.region(step.witness, after=step.witness_after))
            )
            assert first <= place <= last

    def check_witness(self, step: DenseExplanationStep) -> None:
        """With the right side at the witness, the definition gives the value of the step."""
        if step.witness is None:
            assert not step.witness_after
            return
        assert step.formula.op is not None
        p, q = step.formula.args
        now, witness = self.place(step), self.region(step.witness, after=step.witness_after)
        assert witness in self.window(step)
        inside = witness % 2 == 1 and witness != now
        if step.formula.op.name == "since":
            way = range(witness + 1 - inside, now + 1)
        else:
            way = range(now, witness + inside)
        reached = min([self.value(q, witness), *(self.value(p, i) for i in way)], key=order)
        assert order(reached) == order(step.value)


Case = tuple[Formula, Signals, float]


@st.composite
def cases(
    draw: st.DrawFn,
    name: str | None = None,
    values: st.SearchStrategy[float] | None = None,
    *,
    total: bool = True,
) -> Case:
    """A formula, signals, and a time of the trace, which may be inside a cell."""
    kinds: dict[str, Any] = {"endless": True, "dense": True, "total": total}
    strategy = formulas(**kinds) if name is None else rooted(name, depth=2, **kinds)
    formula = draw(strategy.filter(lambda f: f.variables))
    whole = relevant(draw(signals() if values is None else signals(values)), formula.variables)
    begin = max(events[0][0] for events in whole.values())
    end = min(events[-1][0] for events in whole.values())
    return formula, whole, draw(st.sampled_from(np.arange(begin, end + 0.1, STEP / 2).tolist()))


def checked(case: Case, backend: Backend) -> rtamt.dense.Explanation:
    """Return the explanation of a case, with all its steps checked."""
    formula, whole, time = case
    explanation = rtamt.dense.explain(formula, whole, time, backend=backend)
    assert (explanation.steps[0].formula, explanation.time) == (formula, time)
    steps = Checked(Regions(whole, STEP / 2), explanation).steps
    if time == max(events[0][0] for events in whole.values()):
        found = rtamt.dense.judge(formula, whole, "complete", backend=backend)
        assert order(explanation.robustness) == order(found.robustness)
    last = steps[-1]
    known = {name: [v for t, v in events if t <= last.time][-1] for name, events in whole.items()}
    causes = last.formula.variables if last.outside is None else ()
    assert explanation.causes == tuple((v, last.time, known[v]) for v in causes)
    return explanation


@pytest.mark.parametrize("name", DENSE)
@settings(max_examples=examples(20))
@given(data=st.data())
def test_every_step_has_the_value_of_its_formula_and_goes_on_with_an_operand_of_that_value(
    name: str, data: st.DataObject, backend: Backend
) -> None:
    checked(data.draw(cases(name)), backend)


@given(case=cases(values=INTEGERS))
def test_an_explanation_has_the_sign_of_the_robustness_all_the_way_down(
    case: Case, backend: Backend
) -> None:
    explanation = checked(case, backend)
    for step, below in itertools.pairwise(explanation.steps):
        assert step.formula.op is not None
        if step.formula.op.name == "not":
            assert holds(below.value) is not holds(step.value)
        elif step.formula.op.name not in ("implies", "iff", "xor"):
            assert bits([below.value]) == bits([step.value])


@st.composite
def changing_after_instants(draw: st.DrawFn) -> Case:
    """An operator with a witness, over operands that change right after an instant."""
    past = rooted("once", dense=True) | rooted("historically", dense=True)
    name = draw(st.sampled_from(["since", "until", "unless"]))
    interval = draw(rooted(name, dense=True)).interval
    formula = cast("Formula", make(name, (draw(past), draw(past)), interval))
    assume(formula.variables)
    drawn = signals(st.sampled_from([-2.0, -1.0, 1.0, 2.0]))
    whole = relevant(draw(drawn), formula.variables)
    begin = max(events[0][0] for events in whole.values())
    end = min(events[-1][0] for events in whole.values())
    return formula, whole, draw(st.sampled_from(np.arange(begin, end + 0.1, STEP / 2).tolist()))


@settings(max_examples=examples(100))
@given(case=changing_after_instants())
def test_a_witness_may_be_an_instant_before_a_change(case: Case, backend: Backend) -> None:
    checked(case, backend)


@settings(max_examples=examples(50))
@given(case=cases(values=st.sampled_from(INFINITIES), total=False))
def test_infinite_values_are_explained(case: Case, backend: Backend) -> None:
    checked(case, backend)


@settings(max_examples=examples(50))
@given(case=cases())
def test_back_ends_explain_alike_and_fit_80_columns(case: Case) -> None:
    formula, whole, time = case
    one, other = (
        rtamt.dense.explain(formula, whole, time, backend=backend)
        for backend in ("python", rtamt.BACKEND)
    )
    assert one == other
    assert max(map(len, str(one).splitlines())) <= 80


# That it decided. --------------------------------------------------------------------------------
@st.composite
def opened_cases(draw: st.DrawFn) -> Case:
    """Predicates with values that differ from each other and from each other's negations."""
    drawn = formulas(endless=True, dense=True).filter(lambda f: f.variables)
    formula, names = opened(draw(drawn))
    rng = random.Random(draw(st.integers(0, 2**32)))
    magnitudes = iter(rng.sample(range(1, 200), 8 * len(names)))
    end = STEP * rng.randint(0, 12)
    whole: Signals = {}
    for name in names:
        inner = rng.sample(range(1, 12), 6)
        times = sorted({0.0, *(STEP * i for i in inner if STEP * i < end), end})
        whole[name] = [(time, next(magnitudes) * rng.choice((-1.0, 1.0))) for time in times]
    return formula, whole, STEP * rng.randint(0, int(end / STEP))


@given(case=opened_cases(), move=st.sampled_from((-0.75, -0.25, 0.5)))
def test_the_robustness_follows_the_value_that_decided_wherever_the_others_move_on_their_side(
    case: Case, move: float
) -> None:
    formula, whole, time = case
    explanation = rtamt.dense.explain(formula, whole, time)
    if not explanation.causes:
        other = {name: [(t, -v / 2) for t, v in events] for name, events in whole.items()}
        assert rtamt.dense.explain(formula, other, time).robustness == explanation.robustness
        return
    (cause,) = explanation.causes
    sign = cause.value / explanation.robustness
    assert sign in (1.0, -1.0)
    events = whole[cause.variable]
    at = max(i for i, (t, _) in enumerate(events) if t <= cause.time)
    bound = abs(cause.value)
    apart = {
        name: [(t, math.copysign(1e6, v) if abs(v) > bound else v / 1e6) for t, v in its]
        for name, its in whole.items()
    }
    for others in (whole, apart):
        moved = {name: list(its) for name, its in others.items()}
        moved[cause.variable][at] = events[at][0], cause.value + move
        after = rtamt.dense.explain(formula, moved, time).robustness
        assert after == explanation.robustness + sign * move
        if time == 0:
            assert rtamt.dense.judge(formula, moved, "complete").robustness == after


def test_golden_instants_are_explained(backend: Backend) -> None:
    for case in golden_cases.cases("dense_instant.json"):
        explanation = rtamt.dense.explain(case["formula"], case["signals"], backend=backend)
        assert explanation.robustness == float(case["robustness"])
        last = explanation.steps[-1]
        assert abs(last.value) == abs(explanation.robustness)


# Times. ------------------------------------------------------------------------------------------
@settings(max_examples=examples(50))
@given(case=cases())
def test_times_may_be_late_or_dates(case: Case) -> None:
    formula, whole, time = case
    explanation = rtamt.dense.explain(formula, whole, time)
    late = 1_700_000_000
    shifted = {name: [(t + late, v) for t, v in events] for name, events in whole.items()}
    begin = np.datetime64("2026-01-01T00:00:00", "ns")

    def date(seconds: float) -> Any:  # noqa: ANN401 - a date among numbers
        return begin + np.timedelta64(int(seconds * 1e9), "ns")

    dated = {name: [(date(t), v) for t, v in events] for name, events in whole.items()}
    ways: list[tuple[Any, Callable[[float], Any]]] = [(shifted, lambda t: t + late), (dated, date)]
    for whole_there, there in ways:
        other = rtamt.dense.explain(formula, whole_there, there(time))
        assert [(s.formula, s.time, s.value, s.witness) for s in other.steps] == [
            (s.formula, there(s.time), s.value, None if s.witness is None else there(s.witness))
            for s in explanation.steps
        ]
        assert [(c.time, c.value) for c in other.causes] == [
            (there(c.time), c.value) for c in explanation.causes
        ]


def test_ticks_that_doubles_do_not_tell_apart_are_told_apart(backend: Backend) -> None:
    begin, last = 1_700_000_000_000_000_000, 10**17
    spec = rtamt.parse("always(x > 0 implies once[0:1](y > 0))", unit="ns")
    after: dict[str, Any] = {
        "x": [(0, -5), (100, 5), (101, -5), (last, -5)],
        "y": [(0, -3), (90, 9), (98, -3), (99, -2), (101, -7), (last, 1)],
    }
    whole = {name: [(begin + t, v) for t, v in events] for name, events in after.items()}
    explanation = rtamt.dense.explain(spec, whole, backend=backend)
    assert (explanation.robustness, explanation.causes[0].value) == (-2.0, -2.0)
    dates = {
        name: [(np.datetime64(t, "ns"), value) for t, value in events]
        for name, events in whole.items()
    }
    explanation = rtamt.dense.explain(spec, dates, backend=backend)
    (cause,) = explanation.causes
    assert (cause.variable, cause.value) == ("y", -2.0)
    assert cause.time == np.datetime64(begin + 99, "ns")
    assert "2023-11-14T22:13:20.000000099     -2  y" in str(explanation).splitlines()


def test_a_time_goes_to_the_nearest_tick_and_may_be_exact() -> None:
    whole: dict[str, Any] = {"x": [(0, 1), (0.3, 2), (1, 2)]}
    times: list[Any] = [0.3, 0.1 + 0.2, Fraction(3, 10), np.float64(0.3), 0.3 - 1e-10]
    for time in times:
        assert rtamt.dense.explain("x > 0", whole, time).robustness == 2.0
    assert rtamt.dense.explain("x > 0", whole, 0.2).robustness == 1.0
    assert rtamt.dense.explain("x > 0", whole, 1).time == 1.0
    assert rtamt.dense.explain("x > 0", whole, 0.26, resolution="100ms").time == 0.3


def test_without_a_time_the_begin_of_the_trace_is_explained() -> None:
    whole: dict[str, Any] = {"x": [(0, 1), (3, 1)], "y": [(1.5, 5), (2.5, 4)]}
    explanation = rtamt.dense.explain("x + y > 0", whole)
    assert (explanation.time, explanation.end, explanation.robustness) == (1.5, 2.5, 6.0)
    assert explanation.causes == (("x", 1.5, 1.0), ("y", 1.5, 5.0))


class ReasonCase(NamedTuple):
    """An operator, a formula that it decides, signals, and an instant of the trace."""

    inner: Formula
    outer: Formula
    whole: Signals
    instant: int


def operand(rng: random.Random, name: str, other: str) -> Formula:
    """A predicate, or a formula of two variables that may change right after an instant."""
    p, q = variable(name) > 0, variable(other) > 0
    a = rng.randint(0, 2)
    b = a + rng.randint(0, 2)
    deep = p.once(a, b), p.eventually(a, b), p.always(a, b), p.until(q, a, b), ~p, p & q
    return rng.choice((p, p, p, p, *deep))


def closed(rng: random.Random) -> Formula:
    """A formula that changes right after an instant: an until with a duration."""
    p, q = variable(rng.choice("ab")) > 0, variable(rng.choice("ab")) > 0
    k = rng.randint(1, 2)
    its = p.until(q, k, k)
    return ~its if rng.random() < 0.5 else its


def drawn(name: str, seed: int) -> ReasonCase:
    rng = random.Random(seed)
    begin, end = rng.randint(0, 2), rng.randint(4, 9)
    values = rng.choice(((-2, -1, 1, 2), (-1, 1), (-3, -2, 1), (-2, 1, 2, 3), (-1, 0, 1)))
    whole: Signals = {}
    for each in "abcd":
        times = sorted({begin, *rng.sample(range(begin, end), rng.randint(0, end - begin)), end})
        whole[each] = [(float(time), float(rng.choice(values))) for time in times]
    lo = rng.choice((0, 0, 1, 2))
    interval = Interval.of(lo, rng.choice((None, lo, lo + 1, lo + 2, lo + 4)))
    operands = operand(rng, "a", "b"), operand(rng, "c", "d")
    if rng.random() < 0.4:
        changing = closed(rng), closed(rng)
        operands = operands if changing[0] is changing[1] else changing
    inner = cast("Formula", make(name, operands, interval))
    its = ~inner if rng.random() < 0.4 else inner
    outer = rng.choice((its, its, its, its.always(0, rng.randint(0, 3)), its.historically()))
    return ReasonCase(inner, outer, whole, rng.randint(0, end - begin))


class Said:
    """The explanation of the operator, in positions from the start of the trace."""

    def __init__(self, inner: Formula, why: rtamt.dense.Explanation, begin: float) -> None:
        self._begin = begin
        known = inner, *inner.args
        step, *below = (each for each in why.steps if each.formula in known)
        assert step.formula is inner
        self.now = self.place(step.time, after=step.after)
        self.value, self.outside, self.witness = step.value, step.outside, None
        if step.witness is not None:
            self.witness = self.place(step.witness, after=step.witness_after)
        self.decided = None
        if below:
            place = self.place(below[0].time, after=below[0].after)
            self.decided = inner.args.index(below[0].formula), place
        self.parts: list[Part] = [
            (inner.args.index(each.formula), *self.span(each), each.role)
            for each in why.contributions
            if each.formula in inner.args
        ]

    def place(self, time: float, *, after: bool) -> int:
        return 2 * int(time - self._begin) + after

    def span(self, each: DenseContribution) -> tuple[int, int]:
        first, last = each.window
        low = self.place(first, after=each.open_begin)
        return low, low if first == last else self.place(last, after=False) - each.open_end


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("name", ["since", "until", "unless"])
@settings(max_examples=examples(250))
@given(seed=st.integers(0, 2**32))
def test_an_explanation_names_what_the_definition_chooses(
    name: str, seed: int, backend: Backend
) -> None:
    inner, outer, whole, instant = drawn(name, seed)
    its = {each: whole[each] for each in outer.variables}
    regions = Regions(its, 1)
    time = float(regions.begin) + min(instant, regions.steps)
    why = rtamt.dense.explain(outer, its, time, resolution="1s", backend=backend)
    robustness = regions.at(outer, "complete")(2 * min(instant, regions.steps))[1]
    assert same(why.robustness, robustness)
    said = Said(inner, why, float(regions.begin))
    left, right = (
        [regions.at(arg, "complete")(i)[1] for i in range(2 * regions.steps + 1)]
        for arg in inner.args
    )
    lo, hi = (0, None) if inner.interval is None else (inner.interval.begin, inner.interval.end)
    bounds = 2 * int(lo), INF if hi is None else 2 * int(hi)
    reasons = Operands(left, right).reasons(name, said.now, *bounds)
    assert same(said.value, reasons.value)
    assert (said.decided, said.witness) == (reasons.decided, reasons.witness)
    outside = None
    if reasons.decided is None:
        places = sorted(said.now + (-at if name == "since" else at) for at in bounds)
        outside = tuple(None if math.isinf(at) else float(regions.begin) + at // 2 for at in places)
    assert said.outside == outside
    if reason_holds(why.robustness):
        assert why.contributions == ()
        return
    # A step decides. The operands of a formula at one place are described there.
    named = set() if reasons.decided is None else {reasons.decided + reasons.decided[1:]}
    compound = {side for side, arg in enumerate(inner.args) if is_compound(arg)}
    expected: list[Part] = []
    for side, first, last, role in reasons.parts:
        if (side, first, last) not in named and not (side in compound and first == last):
            expected.append((side, first, last, role))
        named.add((side, first, last))
    spans = [part for part in said.parts if not (part[0] in compound and part[1] == part[2])]
    assert spans == expected


def is_compound(node: Node) -> bool:
    return node.op is not None and node.op.operands == "formula"
