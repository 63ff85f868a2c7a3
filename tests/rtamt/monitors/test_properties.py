"""Monitors and evaluations against the definitions, the golden files and their own laws."""

import copy
import functools
import math
import pickle
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from bits import identical
from choices import Backend
from end_laws import MACHINES, count
from golden_cases import cases
from golden_cases import length as case_length
from hypothesis import Phase, find, given, settings
from hypothesis import strategies as st
from hypothesis.errors import NoSuchExample
from oracle import episode, horizon, order, robustness
from profiles import examples
from strategies import (
    INFINITIES,
    INTEGERS,
    QUARTERS,
    TERMS,
    VARIABLES,
    Trace,
    chunkings,
    formulas,
    length,
    rooted,
    sample,
    traces,
)

import rtamt
from rtamt import EpisodeMonitor, Formula, InputError, Monitor, SpecificationError, evaluate
from rtamt.language.operators import OPERATORS

ROOTS = tuple(OPERATORS)


def play(monitor: Monitor, trace: Trace, samples: Iterable[int]) -> list[float]:
    """Return the results of update at each of the samples."""
    return [monitor.update(sample(trace, i, monitor.variables)) for i in samples]


def block(monitor: Monitor, trace: Trace, part: slice) -> dict[str, list[float]]:
    """Return a part of a trace, of the variables of the monitor."""
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
    drawn: set[str] = {"rate"}  # drawn only by name

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


# Online. -----------------------------------------------------------------------------------------


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


def test_oracle_agrees_with_the_golden_discrete_cases_at_every_sample() -> None:
    golden = cases("discrete.json")
    assert len(golden) == 400
    for case in golden:
        formula = rtamt.parse(case["formula"]).formula
        expected = [float(value) for value in case["robustness"]]
        assert robustness(formula, case["trace"], case_length(case)) == expected, case["formula"]


def test_oracle_agrees_with_the_golden_horizons() -> None:
    for case in cases("discrete.json"):
        expected = math.inf if case["horizon"] is None else case["horizon"]
        assert horizon(rtamt.parse(case["formula"]).formula) <= expected, case["formula"]


def test_oracle_agrees_with_the_golden_episodes_after_every_sample() -> None:
    golden = cases("episode.json")
    assert len(golden) == 300
    for case in golden:
        formula = rtamt.parse(case["formula"]).formula
        for n, after in enumerate(case["after"], start=1):
            assert episode(formula, case["trace"], n) == tuple(map(float, after)), case["formula"]


DISCRETE = cases("discrete.json")


EPISODES = cases("episode.json")


def test_the_golden_files_are_whole() -> None:
    assert (len(DISCRETE), len(EPISODES)) == (400, 300)


def test_evaluate_agrees_with_golden_at_every_sample(backend: Backend) -> None:
    for case in DISCRETE:
        expected = [float(value) for value in case["robustness"]]
        assert evaluate(case["formula"], case["trace"], backend=backend).tolist() == expected, case


def test_monitor_gives_golden_values_no_later_than_the_golden_horizon(backend: Backend) -> None:
    for case in DISCRETE:
        if case["horizon"] is None:
            continue
        monitor, n = Monitor(case["formula"], backend=backend), case_length(case)
        assert monitor.latency <= case["horizon"], case
        values = monitor.update_many({v: case["trace"][v] for v in monitor.variables})
        expected = [math.nan] * monitor.latency + [float(value) for value in case["robustness"]]
        assert np.array_equal(values, expected[:n], equal_nan=True), case


def test_episode_monitor_agrees_with_golden_after_every_sample(backend: Backend) -> None:
    for case in EPISODES:
        monitor = EpisodeMonitor(case["formula"], backend=backend)
        for i, after in enumerate(case["after"]):
            now = monitor.update({v: case["trace"][v][i] for v in monitor.variables})
            found = (now, monitor.lower, monitor.upper)
            assert found == tuple(map(float, after)), (case["formula"], i)


@pytest.mark.parametrize("name", MACHINES)
def test_each_machine_keeps_the_laws_of_the_ends(name: str) -> None:
    pytest.importorskip("rtamt._native", reason="no compiler was at hand")
    found = count(*MACHINES[name], cases=60)
    assert found.zeros > 0
    assert found.faults[:3] == []


def test_each_named_formula_is_late_by_its_own_future(backend: Backend) -> None:
    spec = """
        high = x > 1
        soon = eventually[0:2](high)
        always[0:1](soon)
    """
    monitor = Monitor(spec, backend=backend)
    assert monitor.latencies == {"high": 0, "soon": 2}
    seen: list[float] = []
    for x in (3.0, 0.0, 5.0):
        monitor.update(x=x)
        seen += monitor.values.values()
    assert identical(seen, [2, math.nan, -1, math.nan, 4, 4])


HIDDEN = [
    ("F[0:0](eventually(x > 0))", "eventually"),
    ("x > 0 until[0:0] (eventually(x > 0))", "eventually"),
    ("historically[0:0](always(x > 0))", "always"),
    ("once[0:0](eventually(x > 0))", "eventually"),
    ("x > 0 since[0:0] (always(x > 0))", "always"),
    ("p = always(x > 0)\nG[0:0] p", "always"),
    ("p = F[0:0](eventually(x > 0))\neventually(x > 0)", "eventually"),
    ("p = eventually(0 < x)\neventually(x > 0)", "eventually"),
    ("always[0:0](historically[0:0](eventually(x > 0)))", "eventually"),
]


MAKERS: dict[str, Callable[[str], object]] = {
    "Monitor": rtamt.Monitor,
    "VectorMonitor": lambda text: rtamt.VectorMonitor(text, 2),
    "DenseMonitor": rtamt.dense.Monitor,
}


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize(("text", "symbol"), HIDDEN)
def test_one_below_a_window_of_one_sample_is_refused(name: str, text: str, symbol: str) -> None:
    with pytest.raises(SpecificationError) as caught:
        MAKERS[name](text)
    reason, *_, hint = str(caught.value).splitlines()
    monitor, instead = "Monitor", "EpisodeMonitor or evaluate()"
    if name == "DenseMonitor":
        monitor, instead = "rtamt.dense.Monitor", "rtamt.dense.evaluate()"
    assert reason.partition(": ")[2] == (
        f"'{symbol}' without an end needs the whole future, and {monitor} cannot wait for it"
    )
    assert hint == f"  hint: write an end, as in {symbol}[0:10], or use {instead}"


@pytest.mark.parametrize("text", ["always(x > 0)", "always[0:inf](x > 0)", "p = always(x > 0)\np"])
def test_one_at_the_root_is_folded(text: str) -> None:
    fold = max if "eventually" in text else min
    monitor = rtamt.Monitor(text)
    values = [3.0, -1.0, 5.0]
    expected = [fold(values[: i + 1]) for i in range(3)]
    assert [monitor.update(x) for x in values] == expected
    assert all(value == expected[-1] for value in monitor.values.values())


@given(formulas(2, endless=True), traces())
def test_no_formula_below_a_window_of_one_sample_is_folded(formula: Formula, trace: Trace) -> None:
    wrapped = formula.always().eventually(0, 0)
    with pytest.raises(SpecificationError, match="without an end needs the whole future"):
        rtamt.Monitor(wrapped)
    n = length(trace)
    whole = rtamt.evaluate(wrapped, trace, n=n)
    np.testing.assert_array_equal(whole, rtamt.evaluate(formula.always(), trace, n=n))
    assert not np.isnan(whole).any()
    assert whole[0] <= math.inf


# A batch. ----------------------------------------------------------------------------------------
def test_a_nan_is_told_by_its_sample_however_many_variables_there_are(backend: Backend) -> None:
    text, short = "always(x > y or z > 0)", {"x": [[1.0]], "y": [[1.0]], "z": [[math.nan]]}
    with pytest.raises(InputError, match=r"variable 'z' is nan at sample 0; "):
        evaluate(text, short, backend=backend)
    alone = {name: values[0] for name, values in short.items()}
    with pytest.raises(InputError, match=r"^variable 'z' is nan at sample 0; "):
        evaluate(text, alone, backend=backend)


@st.composite
def tables(draw: st.DrawFn, values: tuple[float, ...]) -> dict[str, np.ndarray[Any, Any]]:
    """Values of every variable, of shape (traces, samples)."""
    traces, samples = draw(st.integers(0, 4)), draw(st.integers(1, 9))
    size = traces * samples * len(VARIABLES)
    drawn = draw(st.binary(min_size=size, max_size=size))
    array = np.array([values[byte % len(values)] for byte in drawn])
    return dict(zip(VARIABLES, array.reshape(len(VARIABLES), traces, samples), strict=True))


@given(formula=formulas(endless=True), data=tables(QUARTERS + INTEGERS), drawn=st.data())
def test_each_trace_has_the_values_of_its_own(
    formula: Formula, data: dict[str, np.ndarray[Any, Any]], drawn: st.DataObject, backend: Backend
) -> None:
    traces, samples = data["a"].shape
    drawing = st.lists(st.integers(1, samples), min_size=traces, max_size=traces)
    optional = st.none() if samples > 1 else st.nothing()
    lengths = drawn.draw(optional | drawing.map(lambda counts: np.array(counts, dtype=int)))
    names = sorted(formula.variables)
    chosen: Any = data if names else np.empty((traces, samples, 0))
    if lengths is not None and names:
        for i, n in enumerate(lengths):
            data[names[0]][i, n:] = math.nan
    found = evaluate(formula, chosen, lengths=lengths, backend=backend)
    assert found.shape == (traces, samples)
    for i in range(traces):
        n = samples if lengths is None else int(lengths[i])
        alone = {name: data[name][i, :n] for name in names}
        expected = evaluate(formula, alone, n=n, backend=backend)
        assert identical(found[i, :n], expected)
        assert np.isnan(found[i, n:]).all()


@given(formula=formulas(depth=2, total=False, endless=True), data=tables((*INFINITIES, math.nan)))
def test_nan_is_held_within_its_trace(
    formula: Formula, data: dict[str, np.ndarray[Any, Any]], backend: Backend
) -> None:
    if not formula.variables:
        return
    for values in data.values():
        values[:, 0] = np.nan_to_num(values[:, 0])
    lengths = np.full(len(data["a"]), data["a"].shape[1])
    found = evaluate(formula, data, lengths=lengths, nan="hold", backend=backend)
    for i, row in enumerate(found):
        alone = {name: values[i] for name, values in data.items()}
        assert row.tolist() == evaluate(formula, alone, nan="hold", backend=backend).tolist()


def test_an_array_has_its_columns_in_the_order_of_the_variables(backend: Backend) -> None:
    rng = np.random.default_rng(0)
    data = rng.normal(size=(3, 20, 2))
    found = evaluate("always[0:1s](x > y)", data, "500ms", backend=backend)
    expected = [evaluate("always[0:1s](x > y)", each, "500ms") for each in data]
    assert np.array_equal(found, expected)
    for same in (np.asfortranarray(data), data[:, ::-1][:, ::-1], data.tolist()):
        assert np.array_equal(evaluate("always[0:1s](x > y)", same, "500ms"), found)


def test_interface_aware_semantics_are_those_of_evaluate(backend: Backend) -> None:
    text = "always(req >= 3 implies eventually[0:5](gnt >= 3))"
    data = {"req": [[4, 0, 0], [2, 0, 0]], "gnt": [[0, 1, 1], [0, 0, 0]]}
    arguments: dict[str, Any] = {"inputs": ["req"], "outputs": ["gnt"], "backend": backend}
    for semantics in ("output-robustness", "input-vacuity"):
        found = evaluate(text, data, semantics=semantics, **arguments)
        for i in range(2):
            alone = {name: values[i] for name, values in data.items()}
            expected = evaluate(text, alone, semantics=semantics, **arguments)
            assert found[i].tolist() == expected.tolist()
