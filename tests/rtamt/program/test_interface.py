"""Laws of the interface-aware semantics, on generated formulas and signatures."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from typing import Literal

import boolean_oracle
import numpy as np
import pytest
from bits import identical
from hypothesis import given, settings
from hypothesis import strategies as st
from interface_cases import NEUTRAL, RELATIVE, VACUITY, Case, cases, read
from oracle import episode, horizon, robustness
from profiles import examples
from strategies import (
    INFINITIES,
    VARIABLES,
    Trace,
    chunkings,
    length,
    sample,
    traces,
)

from rtamt import EpisodeMonitor, Monitor, VectorEpisodeMonitor, VectorMonitor, evaluate
from rtamt.typing import SemanticsName

Backend = Literal["native", "python"]
INF = math.inf


def defined(case: Case, trace: Trace) -> list[float]:
    """The robustness by definition."""
    return robustness(case[0].formula, trace, length(trace), read(case))


def offline(case: Case, trace: Trace, backend: Backend) -> list[float]:
    values = evaluate(case[0], trace, n=length(trace), semantics=case[1], backend=backend)
    return [float(value) for value in values]


def same(x: object, y: object) -> bool:
    return np.array_equal(np.array(x, float), np.array(y, float), equal_nan=True)


# The definition. ---------------------------------------------------------------------------------


@given(case=cases(endless=True), trace=traces())
def test_evaluate_gives_the_definition_at_every_sample(
    case: Case, trace: Trace, backend: Backend
) -> None:
    assert same(offline(case, trace, backend), defined(case, trace))


@given(case=cases(endless=True, total=False), trace=traces(values=INFINITIES))
def test_infinite_samples_are_compared_like_others(
    case: Case, trace: Trace, backend: Backend
) -> None:
    assert same(offline(case, trace, backend), defined(case, trace))


@given(case=cases(), trace=traces(most=16), data=st.data())
def test_monitor_gives_the_definition_late_by_the_latency_of_the_standard_semantics(
    case: Case, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    spec, semantics = case
    monitor = Monitor(spec, semantics=semantics, backend=backend)
    assert monitor.latency == horizon(spec.formula)
    assert monitor.variables == spec.variables
    n = length(trace)
    expected = [*[math.nan] * monitor.latency, *defined(case, trace)][:n]
    assert same([monitor.update(sample(trace, i, spec.variables)) for i in range(n)], expected)
    if spec.variables:
        monitor.reset()
        columns = {name: np.array(trace[name]) for name in spec.variables}
        blocks = [
            monitor.update_many({name: column[part] for name, column in columns.items()})
            for part in data.draw(chunkings(n))
        ]
        assert same(np.concatenate(blocks), expected)


@given(case=cases(endless=True), trace=traces(most=8))
def test_episode_monitor_gives_the_definition_and_its_bounds(
    case: Case, trace: Trace, backend: Backend
) -> None:
    spec, semantics = case
    monitor = EpisodeMonitor(spec, semantics=semantics, backend=backend)
    for n in range(length(trace) + 1):
        if n:
            monitor.update(sample(trace, n - 1, spec.variables))
        found = (monitor.robustness, monitor.lower, monitor.upper)
        assert identical(found, episode(spec.formula, trace, n, read(case)))


@settings(max_examples=examples(40))
@given(case=cases(), rows=st.lists(traces(least=4, most=4), min_size=3, max_size=3))
def test_entries_in_batch_are_single_monitors(
    case: Case, rows: list[Trace], backend: Backend
) -> None:
    spec, semantics = case
    entries = VectorMonitor(spec, 3, semantics=semantics, backend=backend)
    episodes = VectorEpisodeMonitor(spec, 3, semantics=semantics, backend=backend)
    single = [Monitor(spec, semantics=semantics, backend=backend) for _ in rows]
    whole = [EpisodeMonitor(spec, semantics=semantics, backend=backend) for _ in rows]
    for i in range(4):
        block = np.array([[t[v][i] for v in spec.variables] for t in rows], float).reshape(3, -1)
        assert same(
            entries.update(block), [m.update(*row) for m, row in zip(single, block, strict=True)]
        )
        now = [m.update(*row) for m, row in zip(whole, block, strict=True)]
        assert identical(episodes.update(block), now)
        assert identical(episodes.lower, [m.lower for m in whole])
        assert identical(episodes.upper, [m.upper for m in whole])
        assert episodes.verdict.tolist() == [m.verdict for m in whole]


@pytest.mark.parametrize(
    "duplicate",
    [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))],
    ids=["copy", "deepcopy", "pickle"],
)
@settings(max_examples=examples(20))
@given(case=cases(), trace=traces(least=4, most=8))
def test_a_duplicate_keeps_the_semantics_and_goes_on(
    duplicate: Callable[[Monitor], Monitor], case: Case, trace: Trace, backend: Backend
) -> None:
    spec, semantics = case
    original = Monitor(spec, semantics=semantics, backend=backend)
    cut, n = 2, length(trace)
    for i in range(cut):
        original.update(sample(trace, i, spec.variables))
    twin = duplicate(original)
    assert twin.interface == original.interface
    expected = [*[math.nan] * twin.latency, *defined(case, trace)][cut:n]
    assert same(
        [twin.update(sample(trace, i, spec.variables)) for i in range(cut, n)],
        expected,
    )


# What the semantics are for. ---------------------------------------------------------------------


@given(case=cases(endless=True), trace=traces())
def test_the_sign_says_whether_the_formula_holds_where_no_predicate_counts_0(
    case: Case, trace: Trace, backend: Backend
) -> None:
    n = length(trace)
    for i, value in enumerate(offline(case, trace, backend)):
        if value != 0 or case[1] not in NEUTRAL:
            holds = boolean_oracle.holds(case[0].formula, trace, n, i)
            assert (math.copysign(1, value) > 0) == holds


@given(case=cases(RELATIVE, endless=True), trace=traces())
def test_what_is_given_takes_nothing_away_from_a_margin(
    case: Case, trace: Trace, backend: Backend
) -> None:
    standard = evaluate(case[0], trace, n=length(trace), backend=backend)
    for plain, relative in zip(standard, offline(case, trace, backend), strict=True):
        assert plain <= 0 or relative >= plain
        assert plain >= 0 or relative <= plain


@given(case=cases(VACUITY, endless=True), trace=traces(least=8, most=8), data=st.data())
def test_vacuity_does_not_change_with_the_other_side_and_its_sign_is_that_of_every_trace(
    case: Case, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    spec, semantics = case
    role = semantics.partition("-")[0]
    other = data.draw(traces(least=8, most=8))
    mixed = {v: (trace if spec.declarations[v].io == role else other)[v] for v in VARIABLES}
    vacuity = offline(case, trace, backend)
    assert same(offline(case, mixed, backend), vacuity)
    for i, value in enumerate(vacuity):
        if value != 0:
            holds = boolean_oracle.holds(spec.formula, mixed, 8, i)
            assert (value > 0) == holds


# The figures of the paper. -----------------------------------------------------------------------

GRANTED = "always((req >= 3) implies eventually[0:5](gnt >= 3))"
# (b): never a request. (d): one of height 4, and within its window no grant above 1.
SIGNALS = {
    "b": {"req": [0.0, 2, 2, 0, 1, 0, 0, 0, 0, 0], "gnt": [0.0] * 10},
    "d": {"req": [0.0, 4, 0, 0, 0, 0, 0, 0, 0, 0], "gnt": [0.0, 0, 0, 0, 1, 0, 0, 0, 4, 0]},
}
FIGURES: list[tuple[str, SemanticsName, float]] = [
    ("b", "standard", 1),
    ("b", "output-robustness", INF),
    ("b", "input-vacuity", 1),
    ("b", "input-robustness", 1),
    ("b", "output-vacuity", 0),
    ("d", "standard", -1),
    ("d", "output-robustness", -2),
    ("d", "input-robustness", -1),
    ("d", "input-vacuity", 0),
    ("d", "output-vacuity", 0),
]


@pytest.mark.parametrize(("signal", "semantics", "expected"), FIGURES)
def test_request_and_grant_of_the_paper(
    signal: str, semantics: SemanticsName, expected: float, backend: Backend
) -> None:
    trace = SIGNALS[signal]
    declared = f"input float req; output float gnt; {GRANTED}"
    whole = evaluate(declared, trace, semantics=semantics, backend=backend)
    assert whole[0] == expected
    req, gnt = ("req",), ("gnt",)
    monitor = Monitor(GRANTED, semantics=semantics, inputs=req, outputs=gnt, backend=backend)
    assert monitor.update_many(trace)[-1] == expected
    entries = VectorMonitor(declared, 1, semantics=semantics, backend=backend)
    episode = EpisodeMonitor(declared, semantics=semantics, backend=backend)
    rows = np.array([trace["req"], trace["gnt"]]).T
    for row in rows:
        last = entries.update([row])[0], episode.update(row)
    assert last == (expected, expected)
    assert episode.finish() == expected
