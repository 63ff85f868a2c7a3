"""Dense time against the definition, the golden file, discrete time and the signs of 0."""

import itertools
import math
import random
from fractions import Fraction
from typing import get_args

import numpy as np
import pytest
from choices import Backend
from dense_oracle import Definition, boolean
from dense_signals import (
    INTEGERS,
    Signals,
    bitwise,
    by_value,
    chunked,
    chunks,
    play,
    relevant,
    signals,
)
from golden_cases import cases
from hypothesis import given, settings
from hypothesis import strategies as st
from interface_oracle import SEMANTICS
from profiles import examples
from region_oracle import Regions
from strategies import DENSE, INFINITIES, Trace, formulas, length, rooted, traces

import rtamt
from rtamt import Formula, Interval, SpecificationError, evaluate, parse
from rtamt.inputs.event_reader import EventReader
from rtamt.language.formula import make
from rtamt.language.node import Node
from rtamt.language.parser import as_specification
from rtamt.machines.backend import BACKENDS
from rtamt.program.dense_lowering import compile_regions
from rtamt.program.implications import InstantRuns
from rtamt.program.interface import STANDARD
from rtamt.typing import End, SemanticsName

GOLDEN = cases("dense.json")

dense_formulas = formulas(endless=True, dense=True).filter(lambda f: f.variables)


def expected(formula: Formula, whole: Signals) -> list[tuple[float, float]]:
    """Return the definition's breakpoints."""
    return Definition(relevant(whole, formula.variables)).breakpoints(formula)


# Against the definition. -------------------------------------------------------------------------


@given(formula=dense_formulas, whole=signals())
def test_evaluate_dense_gives_the_definition(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    robustness = rtamt.dense.evaluate(formula, whole, backend=backend)
    assert bitwise(robustness) == bitwise(expected(formula, whole))


@pytest.mark.parametrize("name", DENSE)
@settings(max_examples=examples(12))
@given(data=st.data(), whole=signals())
def test_every_operator_means_what_its_definition_says(
    name: str, data: st.DataObject, whole: Signals, backend: Backend
) -> None:
    strategy = rooted(name, depth=1, endless=True, dense=True)
    formula = data.draw(strategy.filter(lambda f: f.variables))
    robustness = rtamt.dense.evaluate(formula, whole, backend=backend)
    assert bitwise(robustness) == bitwise(expected(formula, whole))


@settings(max_examples=examples(50))
@given(
    formula=formulas(endless=True, total=False, dense=True).filter(lambda f: f.variables),
    whole=signals(st.sampled_from(INFINITIES)),
)
def test_infinite_values_are_legal(formula: Formula, whole: Signals, backend: Backend) -> None:
    robustness = rtamt.dense.evaluate(formula, whole, backend=backend)
    assert bitwise(robustness) == bitwise(expected(formula, whole))


# Against the golden file. ------------------------------------------------------------------------


def test_the_golden_file_is_whole() -> None:
    assert len(GOLDEN) == 250


def test_the_oracle_agrees_with_golden() -> None:
    for case in GOLDEN:
        golden = [tuple(map(float, step)) for step in case["robustness"]]
        formula = parse(case["formula"]).formula
        definition = Definition(relevant(case["signals"], formula.variables), step=0.25)
        assert by_value(definition.breakpoints(formula)) == golden, case


def test_evaluate_dense_agrees_with_golden(backend: Backend) -> None:
    for case in GOLDEN:
        golden = [tuple(map(float, step)) for step in case["robustness"]]
        robustness = rtamt.dense.evaluate(case["formula"], case["signals"], backend=backend)
        assert by_value(robustness) == golden, case


def test_dense_monitor_agrees_with_golden_no_later_than_the_golden_horizon(
    backend: Backend,
) -> None:
    for case in GOLDEN:
        golden = [tuple(map(float, step)) for step in case["robustness"]]
        if case["horizon"] is None:
            continue
        monitor = rtamt.dense.Monitor(case["formula"], backend=backend)
        assert monitor.horizon <= case["horizon"], case
        given = monitor.update({v: case["signals"][v] for v in monitor.variables})
        assert by_value(given) == [step for step in golden if step[0] < monitor.settled]
        assert by_value(given + monitor.finish()) == golden, case


# Against discrete time. --------------------------------------------------------------------------

AGREE = (
    "not",
    "and",
    "or",
    "implies",
    "iff",
    "xor",
    "historically",
    "once",
    "always",
    "eventually",
    "until",
)


@st.composite
def agreeing(draw: st.DrawFn, depth: int = 3) -> Formula:
    """Formulas of the operators that are equal over samples and over steps."""
    if depth == 0:
        return draw(rooted(draw(st.sampled_from((">=", "<", "==", "!=")))))
    name = draw(st.sampled_from(AGREE))
    interval = None
    if name in ("historically", "once"):
        begin = draw(st.integers(0, 2))
        interval = Interval.of(begin, begin + draw(st.integers(0, 3)))
    elif name in ("always", "eventually", "until"):
        interval = Interval.of(0, draw(st.integers(0, 3)))
    below = agreeing(depth - 1 - draw(st.integers(0, depth - 1)))
    args: tuple[Node, ...] = (draw(below),)
    if name not in ("not", "historically", "once", "always", "eventually"):
        args = (*args, draw(below))
    formula = make(name, args, interval)
    assert isinstance(formula, Formula)
    return formula


def sampled(trace: Trace) -> Signals:
    return {name: list(enumerate(map(float, column))) for name, column in trace.items()}


@settings(max_examples=examples(60))
@given(formula=agreeing().filter(lambda f: f.variables), trace=traces())
def test_dense_time_equals_discrete_time_on_samples_as_steps(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    n = length(trace)
    robustness = rtamt.dense.evaluate(formula, sampled(trace), backend=backend)
    places = np.searchsorted(robustness.times, np.arange(n), side="right") - 1
    assert robustness.values[places].tolist() == evaluate(formula, trace, backend=backend).tolist()


@pytest.mark.parametrize("operator", ["always", "eventually"])
@given(trace=traces(), begin=st.integers(1, 3), width=st.integers(0, 3))
@settings(max_examples=examples(12))
def test_a_later_window_equals_discrete_time_while_it_ends_before_the_last_sample(
    operator: str, trace: Trace, begin: int, width: int, backend: Backend
) -> None:
    formula = f"{operator}[{begin}:{begin + width}](a > b)"
    robustness = rtamt.dense.evaluate(formula, sampled(trace), backend=backend)
    inside = max(0, length(trace) - 1 - begin - width)
    places = np.searchsorted(robustness.times, np.arange(inside), side="right") - 1
    discrete = evaluate(formula, trace, backend=backend)[:inside]
    assert robustness.values[places].tolist() == discrete.tolist()


# By hand. ----------------------------------------------------------------------------------------


def test_units_are_converted(backend: Backend) -> None:
    signal = {"x": [(0, 1), (250, 5), (1000, 5)]}
    in_ms = parse("once[0:0.5s](x > 1)", unit="ms")
    assert rtamt.dense.evaluate(in_ms, signal, backend=backend) == [(0, 0), (250, 4)]
    late = parse("historically[0:0.5s](x > 1)", unit="ms")
    assert rtamt.dense.evaluate(late, signal, backend=backend) == [(0, 0), (750, 4)]


@pytest.mark.parametrize(
    ("text", "symbol", "way"),
    [
        ("prev (x > 1)", "prev", "once[0:d]"),
        ("s_prev (x > 1)", "s_prev", "once[0:d]"),
        ("rise(x > 1)", "rise", "once[0:d]"),
        ("fall(x > 1)", "fall", "once[0:d]"),
        ("next (x > 1)", "next", "eventually[0:d]"),
        ("s_next (x > 1)", "s_next", "eventually[0:d]"),
    ],
)
def test_operators_on_neighbouring_samples_are_refused(text: str, symbol: str, way: str) -> None:
    expected = (
        f"STL:1:1: '{symbol}' reads the next or previous sample, and dense time has events only\n"
        f"  {text}\n"
        "  ^\n"
        f"  hint: look a time d away with {way}, or use Monitor with a period"
    )
    for call in (
        lambda: rtamt.dense.Monitor(text),
        lambda: rtamt.dense.evaluate(text, {"x": [(0, 1)]}),
    ):
        with pytest.raises(SpecificationError) as error:
            call()
        assert str(error.value) == expected


def test_a_formula_without_variables_is_refused() -> None:
    with pytest.raises(SpecificationError) as error:
        rtamt.dense.evaluate("once[0:1] true", {})
    assert str(error.value) == (
        "STL:1:5: a formula without variables has no events to set the start and end of a trace\n"
        "  once[0:1] true\n"
        "      ^\n"
        "  hint: use evaluate() with n=, or a formula of a variable"
    )


def test_other_named_formulas_do_not_matter(backend: Backend) -> None:
    text = "root = sqrt(x) > 1\nx > 1"
    assert rtamt.dense.evaluate(text, {"x": [(0, -4), (1, 3)]}, backend=backend) == [
        (0, -5),
        (1, 2),
    ]


# The sign bit. -----------------------------------------------------------------------------------
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
@given(formula=dense_formulas, whole=zeros)
def test_the_sign_bit_is_clear_where_the_formula_holds(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    assert holding(rtamt.dense.evaluate(formula, whole, backend=backend)) == truth(formula, whole)


@settings(max_examples=examples(40))
@given(formula=dense_formulas, whole=zeros)
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
@given(formula=dense_formulas, seed=st.integers(0, 2**32), end=st.sampled_from(get_args(End)))
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
