"""The sign of a robustness: whether the formula holds, also at 0."""

import math

import numpy as np
import pytest
from bits import identical
from boolean_oracle import holds as true_at
from choices import Backend
from episode_monitors import feed
from golden_cases import cases
from hypothesis import given
from hypothesis import strategies as st
from oracle import horizon
from strategies import INTEGERS, Trace, formulas, length, sample, traces

from rtamt import (
    EpisodeMonitor,
    Formula,
    Monitor,
    VectorMonitor,
    Verdict,
    evaluate,
    holds,
)

INF = math.inf


@pytest.mark.parametrize(
    ("robustness", "expected"),
    [(1.5, True), (-2, False), (0.0, True), (-0.0, False), (0, True), (INF, True), (-INF, False)],
)
def test_a_number_is_read_as_a_bool(robustness: float, *, expected: bool) -> None:
    for number in (robustness, np.float64(robustness)):
        assert holds(number) is expected


def test_an_array_of_any_shape_is_read_as_booleans_of_that_shape() -> None:
    table = np.array([[1.0, -0.0, 0.0], [-INF, 2.0, -1.0]])
    expected = [[True, False, True], [False, True, False]]
    for robustness in (table, table.tolist(), table.astype(np.float32), table[::1, ::1]):
        found = holds(robustness)
        assert found.dtype == np.bool_
        assert found.tolist() == expected
    assert holds(table.T).tolist() == np.array(expected).T.tolist()
    assert holds([]).tolist() == []
    assert holds(np.array([0, -1])).tolist() == [True, False]


def test_it_reads_what_evaluate_gives() -> None:
    trace = {"x": [2, 3, 4], "y": [3, 3, 3]}
    assert holds(evaluate("x >= y", trace)).tolist() == [False, True, True]
    assert holds(evaluate("x > y", trace)).tolist() == [False, False, True]
    assert holds(evaluate("always(x == 3 or y == 3)", trace)).tolist() == [True] * 3


def table(trace: Trace, names: tuple[str, ...]) -> list[list[float]]:
    """Return a row for each sample."""
    return [[trace[name][i] for name in names] for i in range(length(trace))]


def truth(formula: Formula, trace: Trace) -> list[bool]:
    """Return whether the formula holds at every sample."""
    n = length(trace)
    return [true_at(formula, trace, n, i) for i in range(n)]


@given(formula=formulas(endless=True), trace=traces(values=INTEGERS))
def test_evaluate_says_whether_the_formula_holds(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    n = length(trace)
    robustness = evaluate(formula, trace, n=n, backend=backend)
    assert holds(robustness).tolist() == truth(formula, trace)
    given = evaluate(formula, trace, n=n, backend=backend, semantics="boolean")
    assert given.tolist() == [INF if true else -INF for true in truth(formula, trace)]


@given(formula=formulas(), trace=traces(values=INTEGERS, most=16))
def test_monitors_give_the_bits_of_evaluate(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    n = length(trace)
    monitor = Monitor(formula, backend=backend)
    robustness = evaluate(formula, trace, n=n, backend=backend)
    expected = [*[math.nan] * monitor.latency, *robustness][:n]
    names = monitor.variables
    assert identical([monitor.update(sample(trace, i, names)) for i in range(n)], expected)
    monitor.reset()
    rows = np.array(table(trace, names)).reshape(n, len(names))
    assert identical(monitor.update_many(rows), expected)
    entries = VectorMonitor(formula, 2, backend=backend)
    for row, value in zip(rows, expected, strict=True):
        assert identical(entries.update(np.stack([row, row])), [value, value])


@given(formula=formulas(endless=True, depth=2), trace=traces(values=INTEGERS))
def test_an_episode_says_at_every_sample_whether_it_holds_if_it_ends_there(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(length(trace)):
        assert holds(feed(monitor, trace, i)) is true_at(formula, trace, i + 1, 0)
    undecided = monitor.verdict is Verdict.UNDECIDED
    robustness = monitor.finish()
    if undecided:
        assert identical([monitor.lower, monitor.upper], [robustness, robustness])
        assert monitor.verdict == (1 if holds(robustness) else -1)
    assert monitor.verdict is not Verdict.UNDECIDED


@given(
    formula=formulas(depth=2),
    start=traces(values=INTEGERS, most=8),
    ends=st.lists(traces(values=INTEGERS, least=17, most=17), min_size=4, max_size=4),
)
def test_the_bounds_say_what_holds_whatever_comes(
    formula: Formula, start: Trace, ends: list[Trace], backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(length(start)):
        feed(monitor, start, i)
    for end in ends:
        whole = {name: [*start[name], *end[name]] for name in start}
        n = length(whole)
        assert horizon(formula) < n
        true = true_at(formula, whole, n, 0)
        assert true or not holds(monitor.lower)
        assert holds(monitor.upper) or not true


@pytest.mark.slow(backend="python")
def test_every_golden_formula_holds_where_another_program_says(backend: Backend) -> None:
    golden = [case for case in cases("verdict.json") if "holds" in case]
    assert len(golden) == 400
    for case in golden:
        n = len(case["holds"])
        robustness = evaluate(case["formula"], case["trace"], n=n, backend=backend)
        assert robustness.tolist() == [float(value) for value in case["robustness"]], case
        assert holds(robustness).tolist() == case["holds"], case
