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
from oracle import order
from region_oracle import Regions

from rtamt import DenseExplanation, Formula, explain_dense, variable
from rtamt.language.formula import make
from rtamt.language.interval import Interval
from rtamt.language.node import Node
from rtamt.monitors.dense_explanation import DenseCircumstance

Backend = Literal["native", "python"]
Part = tuple[int, int, int, str]
"""An operand, 0 or 1, the first and the last one of some positions, and what it does there."""

INF = math.inf


class Reasons(NamedTuple):
    """Why an operator of two operands has its value at a position.

    Attributes:
        value: The value.
        decided: The operand and the position whose value it is; None: the window is empty.
        witness: The position of the right side; None: there is none.
        parts: What makes the sign of the value.
    """

    value: float
    decided: tuple[int, int] | None
    witness: int | None
    parts: list[Part]


class Operands:
    """The values of two operands at the positions of a trace."""

    def __init__(self, left: list[float], right: list[float]) -> None:
        self.left, self.right = left, right
        self.last = len(left) - 1

    def reasons(self, name: str, now: int, lo: int, hi: float) -> Reasons:
        if name != "unless":
            return self.reached(name, now, lo, hi)
        until = self.reached("until", now, lo, hi)
        stretch = range(now, int(min(self.last, now + hi)) + 1)
        value = min((self.left[k] for k in stretch), key=order)
        least = next(k for k in stretch if same(self.left[k], value))
        always = order(value) >= order(until.value)
        if always and holds(value):
            return Reasons(value, (0, least), None, [(0, now, stretch[-1], "held")])
        if holds(until.value):
            return until
        # It names the earliest place at which the left side fails, unless the way goes through
        # another one, which nothing names then.
        fails = next(k for k in stretch if not holds(self.left[k]))
        ranges = [(fails, fails), *(span for side, *span, _ in until.parts if side == 0)]
        if always and not any(first <= least <= last for first, last in ranges):
            fails = least
        parts = [(0, fails, fails, "broken" if hi else "missing"), *until.parts]
        if always:
            return Reasons(value, (0, least), None, parts)
        return until._replace(parts=parts)

    def reached(self, name: str, now: int, lo: int, hi: float) -> Reasons:
        """The reasons of since and until, from all positions of the window."""
        left, right = self.left, self.right
        if name == "since":
            window = range(int(max(0, now - hi)), now - lo + 1)
            ways = {j: range(j + (j % 2 == 0 or j == now), now + 1) for j in window}
        else:
            window = range(now + lo, int(min(self.last, now + hi)) + 1)
            ways = {j: range(now, j + (j % 2 == 1 and j != now)) for j in window}
        if not window:
            return Reasons(-INF, None, None, [])
        values = [min([right[j], *(left[k] for k in ways[j])], key=order) for j in window]
        value = max(values, key=order)
        witness = next(j for j, its in zip(window, values, strict=True) if same(its, value))
        way = ways[witness]
        decided = next(((0, k) for k in way if same(left[k], value)), (1, witness))
        if holds(value):
            held = [(0, way[0], way[-1], "held")] if way else []
            return Reasons(value, decided, witness, [*held, (1, witness, witness, "held")])
        # The right side fails wherever the left side holds on the way, and where that ends, it
        # fails itself.
        free = [j for j in window if all(holds(left[k]) for k in ways[j])]
        parts = [(1, free[0], free[-1], "missing")] if free else []
        if free != [*window]:
            fails = {k for way in ways.values() for k in way if not holds(left[k])}
            nearest = max(fails) if name == "since" else min(fails)
            parts.insert(0, (0, nearest, nearest, "broken"))
        return Reasons(value, decided, witness, parts)


def same(one: float, other: float) -> bool:
    return order(one) == order(other)


def holds(value: float) -> bool:
    return math.copysign(1.0, value) > 0.0


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


@pytest.mark.parametrize("name", ["since", "until", "unless"])
@settings(max_examples=250)
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
