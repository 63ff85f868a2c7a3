"""The origin of a value over the positions of dense time, checked at every position."""

from __future__ import annotations

import functools
import math
import random
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from profiles import examples
from reasons_oracle import Operands, Part, Reasons

from rtamt.language.operators import OPERATORS, Bounds, Builder, Operator
from rtamt.monitors.origins import Origin, RobustnessSignal, flat, origin_of

INF = math.inf
WINDOWS = {"always": "min", "eventually": "max", "historically": "min", "once": "max"}


class Drawn(NamedTuple):
    """Two operands at the positions of a trace, a position, and bounds."""

    left: list[float]
    right: list[float]
    now: int
    lo: int
    hi: int | None

    @property
    def end(self) -> float:
        return INF if self.hi is None else self.hi

    def origin(self, row: Operator) -> Origin:
        """Return the choice of the row among its operands."""
        operands = [runs(self.left), runs(self.right)][: row.arity[0]]
        last = len(self.left) - 1
        bounds = self.lo, self.hi
        return origin_of(row, bounds, operands, last, self.now, dense=True, earliest=True)


def drawn(seed: int) -> Drawn:
    rng = random.Random(seed)
    last, stays = 2 * rng.randint(0, 10), rng.choice((0.4, 0.7, 0.9))
    values = rng.choice(((-2.0, -1.0, 1.0, 2.0), (-1.0, 1.0), (-0.0, 0.0, 1.0), (-2.0, -1.0, 1.0)))

    def operand() -> list[float]:
        found = [rng.choice(values)]
        while len(found) <= last:
            found.append(found[-1] if rng.random() < stays else rng.choice(values))
        return found

    lo = 2 * rng.choice((0, 0, 1, 2))
    hi = rng.choice((None, lo, lo + 2, lo + 4, lo + 8))
    return Drawn(operand(), operand(), rng.randint(0, last), lo, hi)


def runs(values: list[float]) -> RobustnessSignal:
    """Return the values as runs of equal bits."""
    bits = np.array(values).view(np.int64)
    starts = np.flatnonzero(np.append(True, bits[1:] != bits[:-1])).astype(np.int64)
    return RobustnessSignal(np.array(values)[starts], starts)


def decided(origin: Origin) -> tuple[int, int] | None:
    return None if origin.operand is None else (origin.operand, origin.place)


def parts_of(origin: Origin) -> list[tuple[int, int, int, bool]]:
    return [(part.operand, part.first, part.last, part.broken) for part in flat(origin.parts)]


def marked(parts: list[Part]) -> list[tuple[int, int, int, bool]]:
    return [(side, first, last, role == "broken") for side, first, last, role in parts]


@pytest.mark.parametrize("name", ["since", "until"])
@settings(max_examples=examples(400))
@given(seed=st.integers(0, 2**32))
def test_of_two_operands_the_best_witness_and_the_worst_place_on_the_way_decide(
    name: str, seed: int
) -> None:
    case = drawn(seed)
    origin = case.origin(OPERATORS[name])
    reasons = Operands(case.left, case.right).reached(name, case.now, case.lo, case.end)
    assert (decided(origin), origin.witness) == (reasons.decided, reasons.witness)
    assert parts_of(origin) == marked(reasons.parts)
    near = case.now + (-case.lo if name == "since" else case.lo)
    far = None if case.hi is None else case.now + (-case.hi if name == "since" else case.hi)
    window = (far, near) if name == "since" else (near, far)
    assert origin.outside == (window if reasons.decided is None else None)


@pytest.mark.parametrize("name", WINDOWS)
@settings(max_examples=examples(200))
@given(seed=st.integers(0, 2**32))
def test_of_a_window_the_first_best_place_decides(name: str, seed: int) -> None:
    case = drawn(seed)
    origin = case.origin(OPERATORS[name])
    reasons = windowed(name, case.left, case.lo, case.end)(case.now)
    assert decided(origin) == reasons.decided
    assert parts_of(origin) == marked(reasons.parts)


def windowed(name: str, values: list[float], lo: int, hi: float) -> Callable[[int], Reasons]:
    """Return the reasons of a window at a position."""
    offsets: tuple[float, float] = (lo, hi) if OPERATORS[name].future else (-hi, -lo)
    return lambda now: Operands(values).windowed(WINDOWS[name], now, *offsets)


def of_operators(inner: str, outer: str, bounds: Bounds, *, mapped: bool) -> Operator:
    """An operator that is a window over another one, whose operands may be mapped."""

    def meaning(b: Builder, own: Bounds, p: int, q: int) -> int:
        if mapped:
            p, q = b.map("neg", p), b.map("max", q, b.constant(-1.0))
        operands = (p, q)[: OPERATORS[inner].arity[0]]
        below = OPERATORS[inner].meaning(b, own, *operands)
        return OPERATORS[outer].meaning(b, bounds, below)

    return Operator(("made",), "infix", 6, "", meaning, (2, 2), timed=True)


@pytest.mark.parametrize("outer", WINDOWS)
@pytest.mark.parametrize("inner", ["since", "until", "once", "always"])
@example(seed=328)  # a since changes one position before its left side
@example(seed=789)  # an until changes one position after
@settings(max_examples=examples(60))
@given(seed=st.integers(0, 2**32))
def test_an_operator_made_of_operators_is_explained_through_the_inner_one(
    inner: str, outer: str, seed: int
) -> None:
    case, rng = drawn(seed), random.Random(seed + 1)
    mapped = rng.random() < 0.3
    left, right = case.left, case.right
    if mapped:
        left, right = [-x for x in left], [max(x, -1.0) for x in right]
    if inner in WINDOWS:
        through = windowed(inner, left, case.lo, case.end)
    else:
        through = functools.partial(Operands(left, right).reached, inner, lo=case.lo, hi=case.end)
    below = [through(i) for i in range(len(left))]
    lo = 2 * rng.randint(0, 2)
    hi = rng.choice((None, lo, lo + 2, lo + 4))
    outside = windowed(outer, [each.value for each in below], lo, INF if hi is None else hi)
    row = of_operators(inner, outer, (lo, hi), mapped=mapped)
    for now in range(len(left)):
        reasons, origin = outside(now), case._replace(now=now).origin(row)
        if reasons.decided is None:
            assert (decided(origin), origin.outside is None) == (None, False)
            continue
        chosen = below[reasons.decided[1]]
        side, place = chosen.decided or (None, 0)
        if side == 1 and mapped and case.right[place] < -1.0:
            side, place = None, 0  # a constant
        assert (origin.operand, origin.place, origin.witness) == (side, place, chosen.witness)
        # The positions of the inner operator at the start of a run, and at its changes.
        ((_, first, last, _),) = reasons.parts
        named = {part[:3] for part in parts_of(origin)}
        if not mapped:
            assert {part[:3] for part in below[first].parts} <= named
            assert named <= {part[:3] for i in range(first, last + 1) for part in below[i].parts}
