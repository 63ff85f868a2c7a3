"""Of since, until and unless at any time: the witness, the side that decided, and what else counts.

Times and bounds are whole ticks here, so that the positions of an explanation are the regions of
`region_oracle`: the instant that is i ticks after the begin is 2i, what lies after it 2i + 1.
"""

from __future__ import annotations

import math
import random
from typing import Literal, NamedTuple, cast

import pytest
from dense_signals import Signals
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from reasons_oracle import Operands, Part, holds, same
from region_oracle import Regions

from rtamt import DenseExplanation, Formula, explain_dense, variable
from rtamt.language.formula import make
from rtamt.language.interval import Interval
from rtamt.language.node import Node
from rtamt.monitors.explanation import DenseCircumstance

Backend = Literal["native", "python"]
INF = math.inf


class Case(NamedTuple):
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
    """A formula that changes right after an instant: an until that must last for so long."""
    p, q = variable(rng.choice("ab")) > 0, variable(rng.choice("ab")) > 0
    k = rng.randint(1, 2)
    its = p.until(q, k, k)
    return ~its if rng.random() < 0.5 else its


def drawn(name: str, seed: int) -> Case:
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
    return Case(inner, outer, whole, rng.randint(0, end - begin))


class Said:
    """What an explanation says of the operator, in positions from the begin of the trace."""

    def __init__(self, inner: Formula, why: DenseExplanation, begin: float) -> None:
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
            for each in why.circumstances
            if each.formula in inner.args
        ]

    def place(self, time: float, *, after: bool) -> int:
        return 2 * int(time - self._begin) + after

    def span(self, each: DenseCircumstance) -> tuple[int, int]:
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
    why = explain_dense(outer, its, time, resolution="1s", backend=backend)
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
    if holds(why.robustness):
        assert why.circumstances == ()
        return
    # What decided is a step. A formula at one place is said by its own operands there.
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
