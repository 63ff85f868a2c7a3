"""Laws of `Monitor` and `evaluate`, on generated formulas and traces and on every back-end."""

import copy
import functools
import math
import pickle
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Literal

import numpy as np
import pytest
from bits import identical
from boolean_oracle import holds
from hypothesis import Phase, find, given, settings
from hypothesis import strategies as st
from hypothesis.errors import NoSuchExample
from oracle import horizon, order, robustness
from profiles import examples
from strategies import (
    INFINITIES,
    TERMS,
    Trace,
    chunkings,
    formulas,
    length,
    rooted,
    sample,
    traces,
)

import rtamt
from rtamt import Formula, Monitor, evaluate
from rtamt.language.operators import OPERATORS

Backend = Literal["native", "python"]
ROOTS = tuple(OPERATORS)


def play(monitor: Monitor, trace: Trace, samples: Iterable[int]) -> list[float]:
    """What update gives at each of the samples."""
    return [monitor.update(sample(trace, i, monitor.variables)) for i in samples]


def block(monitor: Monitor, trace: Trace, part: slice) -> dict[str, list[float]]:
    """A part of a trace, of the variables that the monitor has."""
    return {name: trace[name][part] for name in monitor.variables}


@st.composite
def interrupted(draw: st.DrawFn, *, endless: bool = False) -> tuple[Formula, Trace, int]:
    """A formula with variables, a trace, and a number of samples before an interruption."""
    formula = draw(formulas(endless=endless).filter(lambda f: f.variables))
    trace = draw(traces(least=2, most=16))
    return formula, trace, draw(st.integers(0, length(trace)))


# The registry: a new operator is tested by being registered. -------------------------------------


@pytest.mark.slow  # needs all its examples
def test_strategies_draw_every_operator() -> None:
    drawn: set[str] = {"rate"}  # drawn by name alone

    def draws_all(formula: Formula) -> bool:
        drawn.update(node.op.name for node in formula.nodes() if node.op is not None)
        return drawn == set(OPERATORS)

    # Other versions of Python and Hypothesis draw other examples.
    enough = settings(max_examples=examples(2000), phases=[Phase.generate])
    with suppress(NoSuchExample):
        find(formulas(endless=True), draws_all, settings=enough)
    assert drawn == set(OPERATORS)


@pytest.mark.parametrize("name", ROOTS)
@settings(max_examples=examples(25))
@given(data=st.data(), trace=traces())
def test_every_operator_means_what_its_definition_says(
    name: str, data: st.DataObject, trace: Trace, backend: Backend
) -> None:
    formula = data.draw(rooted(name, depth=1, endless=True))
    n = length(trace)
    assert identical(evaluate(formula, trace, n=n, backend=backend), robustness(formula, trace, n))


@pytest.mark.parametrize("name", [name for name in ROOTS if name not in TERMS])
@settings(max_examples=examples(25))
@given(data=st.data(), trace=traces(most=16))
def test_every_operator_online_gives_its_definition_late_by_its_horizon(
    name: str, data: st.DataObject, trace: Trace, backend: Backend
) -> None:
    formula = data.draw(rooted(name, depth=1))
    monitor = Monitor(formula, backend=backend)
    late, n = monitor.latency, length(trace)
    assert late == horizon(formula)
    expected = [math.nan] * late + robustness(formula, trace, n)
    assert identical(play(monitor, trace, range(n)), expected[:n])


# Offline. ----------------------------------------------------------------------------------------


@given(formula=formulas(endless=True), trace=traces(most=16))
def test_evaluate_gives_the_definition_at_every_sample(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    n = length(trace)
    assert identical(evaluate(formula, trace, n=n, backend=backend), robustness(formula, trace, n))


@given(formula=formulas(endless=True, total=False), trace=traces(values=INFINITIES))
def test_infinite_samples_are_legal(formula: Formula, trace: Trace, backend: Backend) -> None:
    n = length(trace)
    assert identical(evaluate(formula, trace, n=n, backend=backend), robustness(formula, trace, n))


@given(formula=formulas(endless=True), trace=traces())
def test_the_sign_of_the_robustness_says_whether_the_formula_holds(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    n = length(trace)
    for i, value in enumerate(evaluate(formula, trace, n=n, backend=backend)):
        assert (math.copysign(1, value) > 0) == holds(formula, trace, n, i)


# Online. -----------------------------------------------------------------------------------------


@given(case=interrupted())
def test_online_equals_offline_after_latency_and_is_nan_before(
    case: tuple[Formula, Trace, int], backend: Backend
) -> None:
    formula, trace, _ = case
    monitor, n = Monitor(formula, backend=backend), length(trace)
    offline = evaluate(formula, trace, backend=backend)
    expected = [math.nan] * monitor.latency + offline.tolist()
    assert identical(play(monitor, trace, range(n)), expected[:n])


@given(formula=formulas())
def test_latency_is_the_horizon(formula: Formula, backend: Backend) -> None:
    monitor = Monitor(formula, backend=backend)
    assert monitor.latency == horizon(formula) <= monitor.specification.horizon


@given(
    name=st.sampled_from(["always", "eventually"]), formula=formulas(depth=2), trace=traces(most=16)
)
def test_endless_root_is_the_least_or_greatest_value_so_far(
    name: str, formula: Formula, trace: Trace, backend: Backend
) -> None:
    root = formula.always() if name == "always" else formula.eventually()
    fold = functools.partial(min if name == "always" else max, key=order)
    monitor, n = Monitor(root, backend=backend), length(trace)
    late = monitor.latency
    assert late == horizon(formula)
    inner = robustness(formula, trace, n)
    expected = [math.nan if t < late else fold(inner[: t - late + 1]) for t in range(n)]
    assert identical(play(monitor, trace, range(n)), expected)


@given(case=interrupted(), data=st.data())
def test_update_many_in_any_chunking_equals_a_loop_of_update(
    case: tuple[Formula, Trace, int], data: st.DataObject, backend: Backend
) -> None:
    formula, trace, _ = case
    n = length(trace)
    chunks = data.draw(chunkings(n))
    monitor = Monitor(formula, backend=backend)
    parts = [monitor.update_many(block(monitor, trace, chunk)) for chunk in chunks]
    loop = play(Monitor(formula, backend=backend), trace, range(n))
    assert identical(np.concatenate(parts), loop)


@given(case=interrupted())
def test_update_many_and_update_mix(case: tuple[Formula, Trace, int], backend: Backend) -> None:
    formula, trace, cut = case
    n = length(trace)
    expected = play(Monitor(formula, backend=backend), trace, range(n))
    first, second = Monitor(formula, backend=backend), Monitor(formula, backend=backend)
    mixed = [
        *first.update_many(block(first, trace, slice(cut))),
        *play(first, trace, range(cut, n)),
    ]
    assert identical(mixed, expected)
    mixed = [
        *play(second, trace, range(cut)),
        *second.update_many(block(second, trace, slice(cut, n))),
    ]
    assert identical(mixed, expected)


@given(case=interrupted(endless=True))
def test_back_ends_give_equal_bits(case: tuple[Formula, Trace, int], backend: Backend) -> None:
    formula, trace, _ = case
    reference = evaluate(formula, trace, backend="python")
    assert identical(evaluate(formula, trace, backend=backend), reference)
    if horizon(formula) < math.inf:
        n = length(trace)
        monitor, twin = Monitor(formula, backend=backend), Monitor(formula, backend="python")
        assert identical(play(monitor, trace, range(n)), play(twin, trace, range(n)))
        assert monitor.latency == twin.latency


@given(case=interrupted())
def test_reset_forgets_everything(case: tuple[Formula, Trace, int], backend: Backend) -> None:
    formula, trace, cut = case
    monitor = Monitor(formula, backend=backend)
    play(monitor, trace, reversed(range(cut)))
    monitor.reset()
    assert monitor.samples == 0
    fresh = Monitor(formula, backend=backend)
    assert identical(
        play(monitor, trace, range(length(trace))), play(fresh, trace, range(length(trace)))
    )


@pytest.mark.parametrize(
    "duplicate",
    [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))],
    ids=["copy", "deepcopy", "pickle"],
)
@settings(max_examples=examples(40))
@given(case=interrupted())
def test_a_duplicate_mid_run_continues_like_the_original_and_apart_from_it(
    duplicate: Callable[[Monitor], Monitor], case: tuple[Formula, Trace, int], backend: Backend
) -> None:
    formula, trace, cut = case
    n = length(trace)
    original = Monitor(formula, backend=backend)
    expected = play(Monitor(formula, backend=backend), trace, range(n))
    play(original, trace, range(cut))
    twin = duplicate(original)
    assert (twin.backend, twin.samples, twin.latency) == (backend, cut, original.latency)
    assert identical(play(twin, trace, range(cut, n)), expected[cut:])
    assert identical(play(original, trace, range(cut, n)), expected[cut:])


# Named formulas. ---------------------------------------------------------------------------------


@given(p=formulas(2), q=formulas(2), trace=traces(most=16))
def test_named_formulas_are_observed_each_late_by_its_own_horizon(
    p: Formula, q: Formula, trace: Trace, backend: Backend
) -> None:
    spec = rtamt.parse(f"p = ({p})\nq = ({q}) and p\nr = eventually[0:2](q) or not p")
    named = spec.formulas
    monitor, n = Monitor(spec, backend=backend), length(trace)
    late = {name: horizon(formula) for name, formula in named.items()}
    assert monitor.latencies == late
    assert identical(list(monitor.values.values()), [math.nan] * 3)
    expected = {name: robustness(formula, trace, n) for name, formula in named.items()}
    for t in range(n):
        result = monitor.update(sample(trace, t, monitor.variables))
        assert list(monitor.values) == ["p", "q", "r"]
        for name, value in monitor.values.items():
            past = t - int(late[name])
            assert identical([value], [expected[name][past] if past >= 0 else math.nan])
        assert identical([result], [monitor.values["r"]])
