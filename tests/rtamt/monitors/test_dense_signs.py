"""The sign bit of the robustness over dense time: whether the formula holds, at 0 too."""

import itertools
import math
import random
from fractions import Fraction
from typing import get_args

import pytest
from choices import Backend
from dense_oracle import boolean
from dense_signals import INTEGERS, Signals, bitwise, chunked, chunks, play, relevant, signals
from hypothesis import given, settings
from hypothesis import strategies as st
from interface_oracle import SEMANTICS
from profiles import examples
from region_oracle import Regions
from strategies import formulas

import rtamt
from rtamt import Formula
from rtamt.inputs.event_reader import EventReader
from rtamt.language.parser import as_specification
from rtamt.machines.backend import BACKENDS
from rtamt.program.dense_lowering import compile_regions
from rtamt.program.implications import InstantRuns
from rtamt.program.interface import STANDARD
from rtamt.typing import End, SemanticsName

any_formula = formulas(endless=True, dense=True).filter(lambda f: f.variables)
bounded = formulas(dense=True).filter(lambda f: f.variables)
zeros = signals(INTEGERS)


def holding(robustness: rtamt.dense.Events) -> list[tuple[float, bool]]:
    """Where the formula begins to hold or to fail, read off the sign bits."""
    steps = [(time, sign > 0) for time, _, sign in bitwise(robustness)]
    return steps[:1] + [y for x, y in itertools.pairwise(steps) if x[1] != y[1]]


def truth(formula: Formula, whole: Signals) -> list[tuple[float, bool]]:
    """The same by the definition, in logic without numbers."""
    steps = boolean(relevant(whole, formula.variables)).breakpoints(formula)
    return [(float(time), value > 0) for time, value in steps]


@settings(max_examples=examples(60))
@given(formula=any_formula, whole=zeros)
def test_the_sign_bit_is_clear_where_the_formula_holds(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    assert holding(rtamt.dense.evaluate(formula, whole, backend=backend)) == truth(formula, whole)


@settings(max_examples=examples(40))
@given(formula=any_formula, whole=zeros)
def test_boolean_semantics_has_infinities_of_the_same_signs(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    robustness = rtamt.dense.evaluate(formula, whole, semantics="boolean", backend=backend)
    assert all(math.isinf(value) for value in robustness.values.tolist())
    assert holding(robustness) == truth(formula, whole)


@pytest.mark.parametrize("semantics", [*SEMANTICS, "boolean"])
@settings(max_examples=examples(12))
@given(formula=bounded.filter(lambda f: len(f.variables) > 1), whole=zeros, shares=chunks(2))
def test_back_ends_give_the_same_bits_under_every_semantics(
    semantics: SemanticsName, formula: Formula, whole: Signals, shares: list[list[float]]
) -> None:
    first, *_, last = formula.variables
    plain = semantics in ("standard", "boolean")
    inputs, outputs = (None, None) if plain else ([first], [last])
    native, python = (
        play(
            rtamt.dense.Monitor(
                formula, semantics=semantics, inputs=inputs, outputs=outputs, backend=b
            ),
            chunked(whole, shares),
        )
        for b in ("native", "python")
    )
    assert bitwise(native) == bitwise(python)


def test_steps_that_differ_in_the_sign_of_zero_are_not_one(backend: Backend) -> None:
    gears = {"x": [(0, 1), (1, 2), (2, 1), (4, 1)], "y": [(0, 1), (3, 2), (4, 1)]}
    for text, steps in {
        "x >= y": [(0, 0, 1), (1, 1, 1), (2, 0, 1), (3, -1, -1), (4, 0, 1)],
        "x > y": [(0, 0, -1), (1, 1, 1), (2, 0, -1), (3, -1, -1), (4, 0, -1)],
        "x == 1 and y == 1": [(0, 0, 1), (1, -1, -1), (2, 0, 1), (3, -1, -1), (4, 0, 1)],
        "x >= 2 or x < 1": [(0, 0, -1), (1, 0, 1), (2, 0, -1)],
        "not (x >= 2 or x < 1)": [(0, 0, 1), (1, 0, -1), (2, 0, 1)],
        "once[0:1](x >= 2 or x < 1)": [(0, 0, -1), (1, 0, 1), (3, 0, -1)],
    }.items():
        assert bitwise(rtamt.dense.evaluate(text, gears, backend=backend)) == steps, text


def drawn_runs(rng: random.Random, last: int) -> InstantRuns:
    """Runs of positions, one or more, none of which touches the next; the end may be open."""
    places = sorted(rng.sample(range(last + 4), rng.randint(1, min(6, last + 4))))
    runs: list[tuple[int, float]] = []
    for first in places:
        if not runs or first > runs[-1][1] + 1:
            runs.append((first, first + rng.choice((0, 0, 1, 2))))
    if rng.random() < 0.2:
        runs[-1] = runs[-1][0], math.inf
    return tuple(runs)


@settings(max_examples=examples(150))
@given(formula=any_formula, seed=st.integers(0, 2**32), end=st.sampled_from(get_args(End)))
def test_where_a_formula_fails_and_holds_for_certain_is_counted(
    formula: Formula, seed: int, end: End, backend: Backend
) -> None:
    rng = random.Random(seed)
    steps = rng.randint(0, 5)
    whole: Signals = {
        name: [(float(t), rng.choice((-2.0, -1.0, 1.0, 2.0))) for t in range(steps + 1)]
        for name in formula.variables
    }
    regions = compile_regions(as_specification(formula), Fraction(1), interface=STANDARD)
    reader = EventReader(regions)
    made = BACKENDS[backend]
    given = reader.whole(whole)
    signs = made.dense_signs(
        regions, reader.with_clock(made.clock(regions)), given, (0, steps), end
    )
    at = Regions(whole, 1).at(formula, end)
    bounds = [at(i) for i in range(2 * steps + 1)]
    for _ in range(5):
        instants = drawn_runs(rng, 2 * steps)
        inside = [i for i in range(2 * steps + 1) if any(a <= i <= z for a, z in instants)]
        fails = [i for i in inside if math.copysign(1.0, bounds[i][1]) < 0]
        begins = [
            i for i in fails if i - 1 not in fails or any(i == first for first, _ in instants)
        ]
        counted = sum(i % 2 for i in fails), len(begins), begins[0] if begins else None
        assert signs.fails_at(instants) == counted
        holds = instants[-1][1] <= 2 * steps
        holds = holds and all(math.copysign(1.0, bounds[i][0]) > 0 for i in inside)
        assert signs.holds_at(instants) == holds
