"""The interface-aware semantics in dense time."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from typing import Literal

import pytest
from dense_oracle import Definition
from dense_signals import Signals, chunked, chunks, play, relevant, signals
from hypothesis import given, settings
from hypothesis import strategies as st
from interface_cases import Case, cases, read
from profiles import examples

import rtamt

Backend = Literal["native", "python"]
Breakpoints = list[tuple[float, float]]
INF = math.inf


def expected(case: Case, whole: Signals) -> Breakpoints:
    """Return the breakpoints by definition."""
    spec, of = case[0], read(case)
    # The definition is for samples; here the trace is a single sample. An unknown predicate has the
    # value 0.0, its upper bound.
    definition = Definition(
        relevant(whole, spec.variables),
        lambda f, values: of(f, {name: [value] for name, value in values.items()}, 0)[1],
    )
    return definition.breakpoints(spec.formula)


def dense(*, endless: bool) -> st.SearchStrategy[Case]:
    return cases(endless=endless, dense=True).filter(lambda case: case[0].variables)


@given(case=dense(endless=True), whole=signals())
def test_evaluate_dense_gives_the_definition(case: Case, whole: Signals, backend: Backend) -> None:
    spec, semantics = case
    found = rtamt.dense.evaluate(spec, whole, semantics=semantics, backend=backend)
    assert found == expected(case, whole)


@settings(max_examples=examples(50))
@given(case=dense(endless=False), whole=signals(), shares=chunks())
def test_dense_monitor_gives_the_definition_in_any_chunks(
    case: Case, whole: Signals, shares: list[list[float]], backend: Backend
) -> None:
    spec, semantics = case
    monitor = rtamt.dense.Monitor(spec, semantics=semantics, backend=backend)
    assert monitor.variables == spec.variables
    assert monitor.horizon == rtamt.dense.Monitor(spec, backend=backend).horizon
    assert play(monitor, chunked(whole, shares)) == expected(case, whole)


@pytest.mark.parametrize(
    "duplicate",
    [copy.copy, lambda m: pickle.loads(pickle.dumps(m))],
    ids=["copy", "pickle"],
)
def test_a_duplicate_keeps_the_semantics(
    duplicate: Callable[[rtamt.dense.Monitor], rtamt.dense.Monitor], backend: Backend
) -> None:
    text = "input float a; output float b; a > 0 and b > 0"
    monitor = rtamt.dense.Monitor(text, semantics="output-robustness", backend=backend)
    monitor.update({"a": [(0, 1)], "b": [(0, 3)]})
    twin = duplicate(monitor)
    assert twin.interface == monitor.interface
    assert twin.update({"a": [(1, -1), (2, 1)], "b": [(2, 5)]}) == [(0.0, 3.0), (1.0, -INF)]
