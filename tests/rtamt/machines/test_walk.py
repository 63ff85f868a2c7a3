"""Traces column by column, against the definition and the machine that takes samples."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from bits import identical
from end_oracle import cut, ended
from hypothesis import given, settings
from implying import aware, requirements
from interface_cases import Case
from oracle import opened, robustness
from profiles import examples
from strategies import Trace, formulas, length, traces

from rtamt import EpisodeMonitor, Formula, Specification, parse
from rtamt.inputs.samples import SampleReader
from rtamt.language.parser import as_specification
from rtamt.machines.backend import BACKENDS
from rtamt.machines.bounds import TraceBounds
from rtamt.machines.protocols import End
from rtamt.machines.walk import number_of, to_keys
from rtamt.program.interface import STANDARD, Interface, as_interface
from rtamt.program.lowering import compile_program

ENDS: tuple[End, ...] = get_args(End)


def bounds_of(
    spec: Formula | Specification, trace: Trace, n: int, interface: Interface = STANDARD
) -> TraceBounds:
    program = compile_program(as_specification(spec), interface=interface)
    columns = [np.array(trace[name], np.float64) for name in program.variables]
    reader, machines = SampleReader(program, bounds=True), BACKENDS["python"]
    return TraceBounds.of(program, reader, machines, (columns, columns), n, everywhere=True)


@pytest.fixture(params=["whole", "blocks", "native"], autouse=True)
def _blocks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folds of all elements at once, of three at a time, and of pairs in C++."""
    if request.param == "native":
        if "native" not in BACKENDS:
            pytest.skip("no compiler was at hand")
        folding = replace(BACKENDS["python"], fold_pairs=BACKENDS["native"].fold_pairs)
        monkeypatch.setitem(BACKENDS, "python", folding)
    if request.param != "whole":
        monkeypatch.setattr("rtamt.machines.walk._BLOCK", 3)
        monkeypatch.setattr("rtamt.machines.walk._PREFIX_BLOCK", 3)


@settings(max_examples=examples(150))
@given(formula=formulas(depth=3, endless=True), trace=traces(most=12))
def test_every_end_agrees_with_its_definition(formula: Formula, trace: Trace) -> None:
    n = length(trace)
    found = bounds_of(formula, trace, n)
    assert identical([found.robustness()], ended(formula, trace, n, "complete")[:1])
    for end in ENDS:
        assert identical(found.bounds(end), ended(formula, trace, n, end)[1:]), end


@settings(max_examples=examples(150))
@given(formula=requirements(total=False), trace=traces(most=10))
def test_signs_at_every_sample_agree_with_the_definition(formula: Formula, trace: Trace) -> None:
    n = length(trace)
    found = bounds_of(formula, trace, n)
    complete = robustness(formula, trace, n)
    unseen = opened(formula, trace, n)
    bounds = {
        "complete": [(value, value) for value in complete],
        "cut": [cut(formula, trace, n, i) for i in range(n)],
        "open": [unseen(formula, i) for i in range(n)],
    }
    for end in ENDS:
        fails = [math.copysign(1, high) < 0 for _, high in bounds[end]]
        holds = [math.copysign(1, low) > 0 for low, _ in bounds[end]]
        assert (found.fails(end).tolist(), found.holds(end).tolist()) == (fails, holds), end


@settings(max_examples=examples(100))
@given(case=aware(requirements(2)), trace=traces(most=10))
def test_predicates_that_count_0_agree_with_the_machine(case: Case, trace: Trace) -> None:
    (spec, semantics), n = case, length(trace)
    found = bounds_of(spec, trace, n, as_interface(spec, semantics, None, None))
    for end in ENDS:
        monitor = EpisodeMonitor(spec, semantics=semantics, backend="python")
        for i in range(n):
            monitor.update({name: trace[name][i] for name in monitor.variables})
        monitor.finish(end)
        assert identical(found.bounds(end), monitor.bounds()), end


def test_long_traces_agree_with_the_machine() -> None:
    rng, n = np.random.default_rng(0), 400
    trace = {"x": rng.normal(size=n).tolist(), "y": rng.normal(size=n).tolist()}
    for text in (
        "always(eventually[0:5](x > 0) or once[1:3](y > 0))",
        "always(eventually(x > 2))",
        "eventually(always[3:90](x > -2))",
        "(x > -2) until[4:300](y > 2)",
        "always((x > -2) until (y > 1))",
        "always((x > -1) since (y > 0) or prev(x > 0))",
        "always(historically[3:7](x < 2) or always(y > 0))",
    ):
        found = bounds_of(parse(text), trace, n)
        for end in ENDS:
            monitor = EpisodeMonitor(text, backend="python")
            for sample in zip(*(trace[name] for name in monitor.variables), strict=True):
                monitor.update(*sample)
            whole = monitor.robustness
            monitor.finish(end)
            assert identical([found.robustness(), *found.bounds(end)], [whole, *monitor.bounds()])


def test_keys_are_in_the_order_of_the_numbers() -> None:
    numbers = [-math.inf, -2.5, -5e-324, -0.0, 0.0, 5e-324, 1.0, math.inf]
    keys = to_keys(np.array(numbers)).tolist()
    assert keys == sorted(set(keys))
    assert identical([number_of(key) for key in keys], numbers)
