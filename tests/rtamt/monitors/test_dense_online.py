"""`DenseMonitor`: what is settled, once, whatever the chunks; stopped and continued anywhere."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest
from dense_signals import (
    Chunks,
    Signals,
    bitwise,
    chunked,
    chunks,
    of,
    play,
    signals,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import formulas

from rtamt import DenseMonitor, Events, Formula, evaluate_dense, parse

Backend = Literal["native", "python"]
Steps = list[tuple[float, float]]

bounded = formulas(dense=True).filter(lambda f: f.variables)


def least_last(monitor: DenseMonitor, calls: Chunks) -> float:
    """The time up to which all variables are known after some calls."""
    last = dict.fromkeys(monitor.variables, -math.inf)
    for chunk in calls:
        last |= {name: events[-1][0] for name, events in of(monitor, chunk).items()}
    return min(last.values())


# What is settled. --------------------------------------------------------------------------------


@given(formula=bounded, whole=signals(), shares=chunks())
def test_update_gives_all_that_is_settled_and_each_breakpoint_once(
    formula: Formula, whole: Signals, shares: list[list[float]], backend: Backend
) -> None:
    expected = list(evaluate_dense(formula, whole, backend=backend))
    monitor = DenseMonitor(formula, backend=backend)
    assert monitor.settled == -math.inf
    given_so_far: Steps = []
    calls = chunked(whole, shares)
    for i, chunk in enumerate(calls):
        given_so_far += monitor.update(of(monitor, chunk))
        assert monitor.settled == least_last(monitor, calls[: i + 1]) - monitor.horizon
        assert given_so_far == [step for step in expected if step[0] < monitor.settled]
    assert not monitor.finished
    assert given_so_far + monitor.finish() == expected
    assert monitor.finished
    assert monitor.settled == least_last(monitor, calls)
    assert monitor.finish() == []


@given(formula=bounded)
def test_horizon_is_that_of_the_specification(formula: Formula, backend: Backend) -> None:
    assert DenseMonitor(formula, backend=backend).horizon == parse(str(formula)).horizon


@given(data=st.data(), formula=bounded, shares=chunks())
def test_chunks_do_not_matter_at_times_that_no_double_adds_exactly(
    data: st.DataObject, formula: Formula, shares: list[list[float]], backend: Backend
) -> None:
    tenths = data.draw(signals())
    whole = {n: [(t / 3 + 0.1, v) for t, v in events] for n, events in tenths.items()}
    expected = evaluate_dense(formula, whole, backend=backend)
    assert play(DenseMonitor(formula, backend=backend), chunked(whole, shares)) == expected


@given(formula=bounded, whole=signals(), shares=chunks())
def test_back_ends_agree_to_the_bit(
    formula: Formula, whole: Signals, shares: list[list[float]], backend: Backend
) -> None:
    moved = {n: [(t / 7, v / 3) for t, v in events] for n, events in whole.items()}
    monitor = DenseMonitor(formula, backend=backend)
    reference = DenseMonitor(formula, backend="python")
    for chunk in chunked(moved, shares):
        given_now = monitor.update(of(monitor, chunk))
        assert bitwise(given_now) == bitwise(reference.update(of(reference, chunk)))
        assert monitor.settled == reference.settled
    assert bitwise(monitor.finish()) == bitwise(reference.finish())


@pytest.mark.parametrize("operator", ["always", "eventually"])
@given(whole=signals(), shares=chunks())
@settings(max_examples=examples(25))
def test_a_whole_formula_without_an_end_gives_the_extreme_so_far(
    operator: str, whole: Signals, shares: list[list[float]], backend: Backend
) -> None:
    past = {"always": "historically", "eventually": "once"}[operator]
    running = evaluate_dense(f"{past} once[0:1](a > b)", whole, backend=backend)
    monitor = DenseMonitor(f"{operator} once[0:1](a > b)", backend=backend)
    assert monitor.horizon == 0
    assert play(monitor, chunked(whole, shares)) == running


def test_a_variable_may_run_ahead_of_another(backend: Backend) -> None:
    monitor = DenseMonitor("once[0:2](x > y)", backend=backend)
    assert monitor.update({"x": [(0, 1), (1, 5), (4, 2), (10, 0)]}) == []
    assert monitor.settled == -math.inf
    assert monitor.update({"y": [(0.5, 0)]}) == []
    assert monitor.settled == 0.5
    assert monitor.update({"y": [(3, 1)]}) == [(0.5, 1), (1, 5)]
    assert monitor.update({}) == monitor.update({"x": []}) == []
    assert monitor.update({"y": [(7, 9)]}) == [(5, 4), (6, 1)]
    assert monitor.finish() == []


# Values of named formulas. -----------------------------------------------------------------------


def test_named_formulas_have_values_late_by_their_own_latency(backend: Backend) -> None:
    text = "near = x < 3\nsoon = eventually[0:2] near\nonce[0:1] soon"
    monitor = DenseMonitor(text, backend=backend)
    assert monitor.latencies == {"near": 0.0, "soon": 2.0}
    assert monitor.horizon == 2.0
    assert str(monitor.values) == "{'near': nan, 'soon': nan}"
    monitor.update({"x": [(0, 5), (1, 2)]})
    assert str(monitor.values) == "{'near': -2.0, 'soon': nan}"
    monitor.update({"x": [(2.5, 4), (3, 1)]})
    assert monitor.values == {"near": -1.0, "soon": 1.0}
    monitor.finish()
    assert monitor.values == {"near": 2.0, "soon": 2.0}


@given(formula=bounded, other=bounded, whole=signals(), shares=chunks())
@settings(max_examples=examples(30))
def test_values_are_the_robustness_just_before_it_is_unknown(
    formula: Formula, other: Formula, whole: Signals, shares: list[list[float]], backend: Backend
) -> None:
    monitor = DenseMonitor(f"first = ({formula})\nsecond = ({other})", backend=backend)
    calls = chunked(whole, shares)
    names = monitor.variables
    robustness = {
        "first": evaluate_dense(f"second = ({other})\n({formula})", whole, backend=backend),
        "second": evaluate_dense(f"first = ({formula})\n({other})", whole, backend=backend),
    }
    for i, chunk in enumerate(calls):
        monitor.update(of(monitor, chunk))
        known = least_last(monitor, calls[: i + 1])
        for name, late in monitor.latencies.items():
            before = [v for t, v in robustness[name] if t < known - late]
            value = monitor.values[name]
            assert value == before[-1] if before else math.isnan(value)
    monitor.finish()
    assert monitor.values == {name: steps[-1][1] for name, steps in robustness.items()}
    assert names == monitor.variables


# Stopped and continued. --------------------------------------------------------------------------


def again(monitor: DenseMonitor) -> DenseMonitor:
    """Out of a pickle."""
    loaded: DenseMonitor = pickle.loads(pickle.dumps(monitor))
    return loaded


@pytest.mark.parametrize("twin", [copy.copy, copy.deepcopy, again])
@given(formula=bounded, whole=signals(), shares=chunks(4), after=st.integers(0, 5))
@settings(max_examples=examples(20))
def test_a_twin_continues_and_leaves_the_original_alone(
    twin: Callable[[DenseMonitor], DenseMonitor],
    formula: Formula,
    whole: Signals,
    shares: list[list[float]],
    after: int,
    backend: Backend,
) -> None:
    calls = chunked(whole, shares)
    monitor = DenseMonitor(formula, backend=backend)
    begun = [step for chunk in calls[:after] for step in monitor.update(of(monitor, chunk))]
    other = twin(monitor)
    assert (other.settled, other.finished, other.horizon) == (
        monitor.settled,
        monitor.finished,
        monitor.horizon,
    )
    expected = list(evaluate_dense(formula, whole, backend=backend))
    assert begun + play(other, calls[after:]) == expected
    assert begun + play(monitor, calls[after:]) == expected
    assert twin(monitor).finished
    assert twin(monitor).finish() == []


@pytest.mark.parametrize("twin", [copy.copy, copy.deepcopy, again])
def test_a_twin_has_the_unit_and_the_interface_of_the_original(
    twin: Callable[[DenseMonitor], DenseMonitor], backend: Backend
) -> None:
    spec = parse("x >= y implies eventually[0:0.5s](y > x)", unit="ms")
    monitor = DenseMonitor(
        spec, backend=backend, semantics="output-robustness", inputs=["x"], outputs=["y"]
    )
    other = twin(monitor)
    assert other.horizon == 500
    assert other.specification == spec
    assert other.interface == monitor.interface
    assert (other.interface.inputs, other.interface.outputs) == (("x",), ("y",))


@given(formula=bounded, whole=signals(), shares=chunks(4), after=st.integers(0, 5))
@settings(max_examples=examples(20))
def test_a_state_stays_as_it_was_taken_whatever_goes_on_from_it(
    formula: Formula, whole: Signals, shares: list[list[float]], after: int, backend: Backend
) -> None:
    calls = chunked(whole, shares)
    monitor = DenseMonitor(formula, backend=backend)
    begun = [step for chunk in calls[:after] for step in monitor.update(of(monitor, chunk))]
    make, arguments, state = monitor.__reduce__()
    expected = list(evaluate_dense(formula, whole, backend=backend))
    assert begun + play(monitor, calls[after:]) == expected
    for _ in range(2):
        other = make(*arguments)
        other.__setstate__(state)
        assert begun + play(other, calls[after:]) == expected


@given(formula=bounded, whole=signals(), shares=chunks(4), after=st.integers(0, 6))
@settings(max_examples=examples(30))
def test_reset_forgets_everything(
    formula: Formula, whole: Signals, shares: list[list[float]], after: int, backend: Backend
) -> None:
    calls = chunked(whole, shares)
    monitor = DenseMonitor(formula, backend=backend)
    for chunk in calls[:after]:
        monitor.update(of(monitor, chunk))
    if after > 5:
        monitor.finish()
    monitor.reset()
    assert (monitor.settled, monitor.finished) == (-math.inf, False)
    assert play(monitor, calls) == list(evaluate_dense(formula, whole, backend=backend))


# Memory. -----------------------------------------------------------------------------------------


@pytest.mark.slow(keep=3)
@pytest.mark.parametrize(
    "text",
    [
        "always[0:2](x > y)",
        "once[0:2](x > y)",
        "historically (x > y)",
        "always (x > y)",
        "(x > y) since (x > 0)",
        "(x > y) since[1:2] (x > 0)",
        "(x > 0) until[1:2] (y > 0)",
        "once[5:7] eventually[1:2] (x > y)",
        "historically[0:1] x > 0 and eventually[0:1] y > 0",
    ],
)
def test_memory_is_that_of_the_events_inside_the_windows(text: str, backend: Backend) -> None:
    monitor = DenseMonitor(text, backend=backend)
    noise = np.random.default_rng(3).standard_normal((2, 4000))
    times = np.arange(4000) / 10
    sizes = []
    for i in range(0, 4000, 5):
        part = slice(i, i + 5)
        monitor.update(
            {name: Events(times[part], v[part]) for name, v in zip("xy", noise, strict=True)}
        )
        sizes.append(len(pickle.dumps(monitor)))
    assert max(sizes[400:]) <= 1.3 * max(sizes[100:400])


def test_representation(backend: Backend) -> None:
    monitor = DenseMonitor("always[0:0.5](x > 1)", backend=backend)
    assert repr(monitor) == "<DenseMonitor of always[0:0.5](x > 1), horizon 0.5>"
    assert monitor.interpolation == "previous"


def test_a_subclass_with_another_update_is_refused() -> None:
    with pytest.raises(TypeError, match=r"^Doubled\.update would never be called"):
        type("Doubled", (DenseMonitor,), {"update": lambda _, events: events})
