"""Windows longer than hypothesis draws, at the borders of blocks of a fold."""

import copy
import math
import pickle
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import episode, robustness
from profiles import examples
from strategies import chunkings

from rtamt import EpisodeMonitor, Formula, Interval, Monitor, evaluate, variable
from rtamt.language.formula import make
from rtamt.language.operators import OPERATORS

Backend = Literal["native", "python"]
TIMED = [name for name, row in OPERATORS.items() if row.timed]
A, B = variable("a") > 0, variable("b") > 0


def timed(name: str, begin: int, width: int) -> Formula:
    """Return the operator over a > 0, and b > 0 if it has two operands."""
    args = (A, B)[: OPERATORS[name].arity[0]]
    made = make(name, args, Interval.of(begin, begin + width))
    assert isinstance(made, Formula)
    return made


def walk(seed: int, n: int) -> dict[str, list[float]]:
    """Return values that repeat and drift, so that a fold keeps some of them for long."""
    steps = np.random.default_rng(seed).integers(-3, 4, (2, n))
    return {"a": (4.0 + steps[0].cumsum()).tolist(), "b": (steps[1] * 2.0).tolist()}


widths = st.integers(0, 40)
seeds = st.integers(0, 10**6)


@pytest.mark.parametrize("name", TIMED)
@settings(max_examples=examples(12))
@given(begin=st.integers(0, 20), width=widths, seed=seeds)
def test_long_windows_mean_what_their_definition_says(
    name: str, begin: int, width: int, seed: int, backend: Backend
) -> None:
    formula, n = timed(name, begin, width), 90
    trace = walk(seed, n)
    expected = robustness(formula, trace, n)
    assert evaluate(formula, trace, backend=backend).tolist() == expected
    monitor = Monitor(formula, backend=backend)
    late = monitor.latency
    online = [
        monitor.update({name: trace[name][i] for name in monitor.variables}) for i in range(n)
    ]
    assert np.isnan(online[:late]).all()
    assert online[late:] == expected[: max(0, n - late)]


@pytest.mark.parametrize("name", TIMED)
@settings(max_examples=examples(25))
@given(begin=st.integers(0, 20), width=widths, seed=seeds, chunks=chunkings(200))
def test_long_windows_do_not_depend_on_chunks_resets_and_duplicates(
    name: str, begin: int, width: int, seed: int, chunks: list[slice], backend: Backend
) -> None:
    monitor = Monitor(timed(name, begin, width), backend=backend)
    trace = walk(seed, 200)
    columns = {name: np.array(trace[name]) for name in monitor.variables}
    monitor.update_many({name: column[: seed % 100] for name, column in columns.items()})
    monitor.reset()
    whole = [
        monitor.update(*row) for row in zip(*(trace[v] for v in monitor.variables), strict=True)
    ]
    monitor.reset()
    parts = []
    for i, chunk in enumerate(chunks):
        parts.append(monitor.update_many({v: column[chunk] for v, column in columns.items()}))
        monitor = pickle.loads(pickle.dumps(monitor)) if i % 2 else copy.copy(monitor)
    assert np.array_equal(np.concatenate(parts), whole, equal_nan=True)
    offline = evaluate(monitor.specification, columns, backend=backend)
    late = monitor.latency
    assert np.array_equal(whole, [math.nan] * late + offline[: 200 - late].tolist(), equal_nan=True)


@pytest.mark.parametrize("name", [name for name in TIMED if not OPERATORS[name].future])
def test_endless_past_means_what_its_definition_says(name: str, backend: Backend) -> None:
    args = (A, B)[: OPERATORS[name].arity[0]]
    for begin in (0, 1, 17):
        formula = make(name, args, Interval.of(begin, None))
        assert isinstance(formula, Formula)
        trace = walk(begin, 120)
        expected = robustness(formula, trace, 120)
        monitor = Monitor(formula, backend=backend)
        block = {name: trace[name] for name in monitor.variables}
        assert monitor.update_many(block).tolist() == expected
        assert evaluate(formula, trace, backend=backend).tolist() == expected


def test_a_window_longer_than_the_trace_is_cut_at_both_ends(backend: Backend) -> None:
    x = {"x": [3.0, 1.0, 2.0]}
    big = 10**6
    assert evaluate(f"always[0:{big}](x > 0)", x, backend=backend).tolist() == [1.0, 1.0, 2.0]
    assert evaluate(f"once[1:{big}](x > 0)", x, backend=backend).tolist() == [-math.inf, 3.0, 3.0]
    assert (
        evaluate(f"always[{big}:{2 * big}](x > 0)", x, backend=backend).tolist() == [math.inf] * 3
    )
    until = evaluate(f"(x > 0) until[0:{2000 * big}] (x > 2)", x, backend=backend)
    assert until.tolist() == [1.0, 0.0, 0.0]


EPISODES = [
    "always[0:150](a > 3 implies eventually[20:70](b > 2))",
    "always((a > 3) implies ((a > -9) until[5:60] (b > 3)))",
    "eventually(always[0:90](a > 0)) and always(once[0:64](b > 0))",
    "eventually[0:200](historically[3:40](a > 0) and next(b > 0))",
    "always(eventually(b > 3) or (a > 1) since[2:77] (b > 0))",
    "not always[10:120](rise(a > 4) implies (b > -5) unless[0:31] (a > 20))",
]


@pytest.mark.slow(keep=2)
@pytest.mark.parametrize("text", EPISODES)
def test_long_episodes_agree_with_their_definition_now_and_then(
    text: str, backend: Backend
) -> None:
    n = 260
    trace = walk(len(text), n)
    monitor, twin = EpisodeMonitor(text, backend=backend), EpisodeMonitor(text, backend="python")
    for i in range(n):
        now = [m.update(a=trace["a"][i], b=trace["b"][i]) for m in (monitor, twin)]
        assert now[0] == now[1]
        assert (monitor.lower, monitor.upper) == (twin.lower, twin.upper)
        if i in {0, 30, 128}:
            expected = episode(monitor.specification.formula, trace, i + 1)
            assert (now[0], monitor.lower, monitor.upper) == expected
