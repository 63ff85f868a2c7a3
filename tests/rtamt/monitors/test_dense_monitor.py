"""Monitors of events: chunks, exact times, ticks and dates."""

import copy
import itertools
import math
import pickle
import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from choices import Backend
from dense_oracle import Definition
from dense_signals import (
    INTEGERS,
    Chunks,
    Signals,
    bitwise,
    chunked,
    chunks,
    of,
    play,
    relevant,
    signals,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import formulas

import rtamt
from rtamt import Formula, Specification, parse
from rtamt.language.interval import UNITS

Steps = list[tuple[float, float]]


bounded = formulas(dense=True).filter(lambda f: f.variables)


def least_last(monitor: rtamt.dense.Monitor, calls: Chunks) -> float:
    """Return the time up to which all variables are known after some calls."""
    last = dict.fromkeys(monitor.variables, -math.inf)
    for chunk in calls:
        last |= {name: events[-1][0] for name, events in of(monitor, chunk).items()}
    return min(last.values())


# What is settled. --------------------------------------------------------------------------------
@given(formula=bounded, whole=signals() | signals(INTEGERS), shares=chunks())
def test_update_gives_all_that_is_settled_and_each_breakpoint_once(
    formula: Formula, whole: Signals, shares: list[list[float]], backend: Backend
) -> None:
    expected = list(rtamt.dense.evaluate(formula, whole, backend=backend))
    monitor = rtamt.dense.Monitor(formula, backend=backend)
    assert monitor.settled == -math.inf
    given_so_far: Steps = []
    calls = chunked(whole, shares)
    for i, chunk in enumerate(calls):
        given_so_far += monitor.update(of(monitor, chunk))
        assert monitor.settled == least_last(monitor, calls[: i + 1]) - monitor.horizon
        assert given_so_far == [step for step in expected if step[0] < monitor.settled]
    assert not monitor.finished
    assert bitwise(given_so_far + monitor.finish()) == bitwise(expected)
    assert monitor.finished
    assert monitor.settled == least_last(monitor, calls)
    assert monitor.finish() == []


@given(formula=bounded)
def test_horizon_is_that_of_the_specification(formula: Formula, backend: Backend) -> None:
    assert rtamt.dense.Monitor(formula, backend=backend).horizon == parse(str(formula)).horizon


@given(data=st.data(), formula=bounded, shares=chunks())
def test_chunks_do_not_matter_at_times_that_no_double_adds_exactly(
    data: st.DataObject, formula: Formula, shares: list[list[float]], backend: Backend
) -> None:
    tenths = data.draw(signals())
    whole = {n: [(t / 3 + 0.1, v) for t, v in events] for n, events in tenths.items()}
    expected = rtamt.dense.evaluate(formula, whole, backend=backend)
    assert play(rtamt.dense.Monitor(formula, backend=backend), chunked(whole, shares)) == expected


@pytest.mark.parametrize("operator", ["always", "eventually"])
@given(whole=signals(), shares=chunks())
@settings(max_examples=examples(25))
def test_a_whole_formula_without_an_end_gives_the_extreme_so_far(
    operator: str, whole: Signals, shares: list[list[float]], backend: Backend
) -> None:
    past = {"always": "historically", "eventually": "once"}[operator]
    running = rtamt.dense.evaluate(f"{past} once[0:1](a > b)", whole, backend=backend)
    monitor = rtamt.dense.Monitor(f"{operator} once[0:1](a > b)", backend=backend)
    assert monitor.horizon == 0
    assert play(monitor, chunked(whole, shares)) == running


def test_a_variable_may_run_ahead_of_another(backend: Backend) -> None:
    monitor = rtamt.dense.Monitor("once[0:2](x > y)", backend=backend)
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
    monitor = rtamt.dense.Monitor(text, backend=backend)
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
    monitor = rtamt.dense.Monitor(f"first = ({formula})\nsecond = ({other})", backend=backend)
    calls = chunked(whole, shares)
    names = monitor.variables
    robustness = {
        "first": rtamt.dense.evaluate(f"second = ({other})\n({formula})", whole, backend=backend),
        "second": rtamt.dense.evaluate(f"first = ({formula})\n({other})", whole, backend=backend),
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
def again(monitor: rtamt.dense.Monitor) -> rtamt.dense.Monitor:
    """Return a copy by pickle."""
    loaded: rtamt.dense.Monitor = pickle.loads(pickle.dumps(monitor))
    return loaded


@pytest.mark.parametrize("twin", [copy.copy, copy.deepcopy, again])
@given(formula=bounded, whole=signals(), shares=chunks(4), after=st.integers(0, 5))
@settings(max_examples=examples(20))
def test_a_twin_continues_and_leaves_the_original_alone(
    twin: Callable[[rtamt.dense.Monitor], rtamt.dense.Monitor],
    formula: Formula,
    whole: Signals,
    shares: list[list[float]],
    after: int,
    backend: Backend,
) -> None:
    calls = chunked(whole, shares)
    monitor = rtamt.dense.Monitor(formula, backend=backend)
    begun = [step for chunk in calls[:after] for step in monitor.update(of(monitor, chunk))]
    other = twin(monitor)
    assert (other.settled, other.finished, other.horizon) == (
        monitor.settled,
        monitor.finished,
        monitor.horizon,
    )
    expected = list(rtamt.dense.evaluate(formula, whole, backend=backend))
    assert begun + play(other, calls[after:]) == expected
    assert begun + play(monitor, calls[after:]) == expected
    assert twin(monitor).finished
    assert twin(monitor).finish() == []


@pytest.mark.parametrize("twin", [copy.copy, copy.deepcopy, again])
def test_a_twin_has_the_unit_and_the_interface_of_the_original(
    twin: Callable[[rtamt.dense.Monitor], rtamt.dense.Monitor], backend: Backend
) -> None:
    spec = parse("x >= y implies eventually[0:0.5s](y > x)", unit="ms")
    monitor = rtamt.dense.Monitor(
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
    monitor = rtamt.dense.Monitor(formula, backend=backend)
    begun = [step for chunk in calls[:after] for step in monitor.update(of(monitor, chunk))]
    make, arguments, state = monitor.__reduce__()
    expected = list(rtamt.dense.evaluate(formula, whole, backend=backend))
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
    monitor = rtamt.dense.Monitor(formula, backend=backend)
    for chunk in calls[:after]:
        monitor.update(of(monitor, chunk))
    if after > 5:
        monitor.finish()
    monitor.reset()
    assert (monitor.settled, monitor.finished) == (-math.inf, False)
    assert play(monitor, calls) == list(rtamt.dense.evaluate(formula, whole, backend=backend))


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
    monitor = rtamt.dense.Monitor(text, backend=backend)
    noise = np.random.default_rng(3).standard_normal((2, 4000))
    times = np.arange(4000) / 10
    sizes = []
    for i in range(0, 4000, 5):
        part = slice(i, i + 5)
        monitor.update(
            {
                name: rtamt.dense.Events(times[part], v[part])
                for name, v in zip("xy", noise, strict=True)
            }
        )
        sizes.append(len(pickle.dumps(monitor)))
    assert max(sizes[400:]) <= 1.3 * max(sizes[100:400])


def test_representation(backend: Backend) -> None:
    monitor = rtamt.dense.Monitor("always[0:0.5](x > 1)", backend=backend)
    assert repr(monitor) == "<DenseMonitor of always[0:0.5](x > 1), horizon 0.5>"
    assert monitor.interpolation == "previous"


def test_a_subclass_with_another_update_is_refused() -> None:
    with pytest.raises(TypeError, match=r"^Doubled\.update would never be called"):
        type("Doubled", (rtamt.dense.Monitor,), {"update": lambda _, events: events})


any_formula = formulas(endless=True, dense=True).filter(lambda f: f.variables)


zeros = signals(INTEGERS)


TENTH = Fraction(1, 10)


def tenths(formula: Formula, unit: str = "s") -> Specification:
    """Return the formula with bounds in tenths of a second instead of halves."""

    def shorter(bounds: re.Match[str]) -> str:
        numbers = (Fraction(b) / 5 / UNITS[unit] for b in bounds.groups() if b != "inf")
        texts = [f"{number.numerator * 10**9 // number.denominator}e-9" for number in numbers]
        return f"[{':'.join([*texts, 'inf'][:2])}]"

    text = re.sub(r"\[([\d.]+):([\d.]+|inf)\]", shorter, str(formula))
    return parse(text, unit=unit)


def exact(whole: Signals, start: int = 0) -> dict[str, list[tuple[Fraction, float]]]:
    """Return the events at multiples of a tenth."""
    return {n: [(start + Fraction(t) / 5, v) for t, v in events] for n, events in whole.items()}


def sums(events: list[tuple[Fraction, float]]) -> list[tuple[float, float]]:
    """Return the events at sums of doubles, such as 0.7 + 0.1, which differs from 0.8."""
    steps = [events[0][0], *(y[0] - x[0] for x, y in itertools.pairwise(events))]
    times = itertools.accumulate(float(step) for step in steps)
    return [(time, value) for time, (_, value) in zip(times, events, strict=True)]


# Exactness. --------------------------------------------------------------------------------------
@given(formula=any_formula, whole=zeros, way=st.sampled_from(("nearest", "sums", "late")))
def test_times_in_tenths_give_what_rational_arithmetic_gives(
    formula: Formula, whole: Signals, way: str, backend: Backend
) -> None:
    spec = tenths(formula)
    rational = relevant(exact(whole, 1_700_000_000 if way == "late" else 0), spec.variables)
    steps = Definition(rational, step=TENTH).breakpoints(spec.formula)
    times: dict[str, list[tuple[float, float]]] = {
        name: sums(events) if way == "sums" else [(float(t), v) for t, v in events]
        for name, events in rational.items()
    }
    expected = [(float(time), value) for time, value in steps]
    assert bitwise(rtamt.dense.evaluate(spec, times, backend=backend)) == bitwise(expected)


@settings(max_examples=examples(40))
@given(formula=bounded, whole=zeros, shares=chunks(), start=st.sampled_from((0, 1_700_000_000)))
def test_chunks_do_not_matter_at_decimal_times(
    formula: Formula, whole: Signals, shares: list[list[float]], start: int, backend: Backend
) -> None:
    spec = tenths(formula)
    times = {n: [(float(t), v) for t, v in e] for n, e in exact(whole, start).items()}
    steps = play(rtamt.dense.Monitor(spec, backend=backend), chunked(times, shares))
    assert bitwise(steps) == bitwise(rtamt.dense.evaluate(spec, times, backend=backend))


@settings(max_examples=examples(40))
@given(formula=any_formula, whole=zeros)
def test_the_unit_in_which_times_are_written_does_not_matter(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    found = []
    for unit in ("s", "ms", "us", "ns", "ps"):
        scale = 1 / UNITS[unit]
        times = {n: [(float(t * scale), v) for t, v in e] for n, e in exact(whole).items()}
        steps = rtamt.dense.evaluate(tenths(formula, unit), times, backend=backend)
        found.append([(round(Fraction(t) / scale * 10), v, s) for t, v, s in bitwise(steps)])
    assert found[1:] == found[:-1]


def test_seven_tenths_and_a_tenth_are_eight_tenths(backend: Backend) -> None:
    gap = {"x": [(0, 1), (0.7, -1), (0.7 + 0.1, 1), (2, 1)]}
    text = "historically once[0:0.1](x > 0)"
    assert rtamt.dense.evaluate(text, gap, backend=backend) == [(0, 1)]
    late = {"x": [(1.7e9 + 0.1 * k, v) for k, v in ((0, 1.0), (7, -1.0), (8, 1.0), (20, 1.0))]}
    assert rtamt.dense.evaluate(text, late, backend=backend) == [(1.7e9, 1)]


# Readings of times. ------------------------------------------------------------------------------
doubles = st.one_of(
    st.floats(-4e9, 4e9),
    st.integers(-(10**10), 10**10).map(lambda k: k / 10),
    st.integers(-(10**12), 10**12).map(lambda k: (k + 0.5) / 10**9),
    st.integers(0, 10**7).map(lambda k: 1.7e9 + 0.1 * k),
    st.integers(0, 10**9).map(lambda k: 1.7e9 + k * 1e-9),
)


ticks = st.sampled_from(("1ns", "100ns", "1us", "7us", "30ms", Fraction(1, 3), 1, 10))


@pytest.mark.slow(backend="python")
@given(times=st.lists(doubles, min_size=1, max_size=8), resolution=ticks, data=st.data())
def test_a_time_is_the_tick_nearest_to_its_shortest_decimal_text(
    times: list[float], resolution: str | int | Fraction, data: st.DataObject, backend: Backend
) -> None:
    tick = rtamt.dense.Monitor("x > 0", resolution=resolution).resolution
    nearest = {round(Fraction(repr(time)) / tick): time for time in times}
    events = [(nearest[k], float(i % 2)) for i, k in enumerate(sorted(nearest))]
    expected = [float(k * tick) for k in sorted(nearest)]
    forms: list[Any] = [events, np.array(events), rtamt.dense.Events(*zip(*events, strict=True))]
    given_now = {"x": data.draw(st.sampled_from(forms))}
    whole = rtamt.dense.evaluate("x > 0", given_now, resolution=resolution, backend=backend)
    assert whole.times.tolist() == expected
    monitor = rtamt.dense.Monitor("x > 0", resolution=resolution, backend=backend)
    assert [t for t, _ in monitor.update(given_now) + monitor.finish()] == expected
    assert monitor.settled == expected[-1]


def test_integers_are_exact_whatever_their_size(backend: Backend) -> None:
    spec = parse("once[0:1](x > 0)", unit="ns")
    start = 2**60 + 1
    for form in (
        [(start, 1.0), (start + 1, -0.5), (start + 5, 2)],
        rtamt.dense.Events(np.array([start, start + 1, start + 5]), [1, -0.5, 2]),
        rtamt.dense.Events([start, start + 1, start + 5], [1, -0.5, 2]),
        np.array([[start, 2], [start + 1, -1], [start + 5, 4]]),
    ):
        steps = rtamt.dense.evaluate(spec, {"x": form}, backend=backend)
        assert len(steps) == 3  # 2 ns after the first event it is forgotten
        monitor = rtamt.dense.Monitor(spec, backend=backend)
        assert [v for _, v in monitor.update({"x": form})] == steps.values.tolist()[:2]
    assert rtamt.dense.Events([start, start + 1], [0, 1])[1:].given[0].tolist() == [start + 1]


def test_dates_come_back_as_dates(backend: Backend) -> None:
    first = np.datetime64("2026-03-01T12:00:00.1", "ms")
    times = first + np.array([0, 700, 800, 2000], "m8[ms]")
    values = [1.0, -1.0, 1.0, 1.0]
    pairs = list(zip(times, values, strict=True))
    for form in (
        rtamt.dense.Events(times, values),
        pairs,
        rtamt.dense.Events(pairs[0][0] + (times - first), values),
    ):
        steps = rtamt.dense.evaluate("once[0.05:0.15](x > 0)", {"x": form}, backend=backend)
        assert steps.times.dtype == "M8[ns]"
        dates: Any = steps.times
        assert (dates[:2] == [first, first + np.timedelta64(50, "ms")]).all()
        assert steps.values.tolist()[:2] == [-math.inf, 1]
        monitor = rtamt.dense.Monitor("once[0.05:0.15](x > 0)", backend=backend)
        again = monitor.update({"x": form}) + monitor.finish()
        assert again == list(steps)
        assert isinstance(again[0][0], np.datetime64)
        assert monitor.settled == times[-1]
    twin = pickle.loads(pickle.dumps(monitor))
    assert twin.settled == times[-1]
    by_number = {"x": [(t, v) for t, v in zip((0, 0.7, 0.8, 2), values, strict=True)]}
    numbers = rtamt.dense.evaluate("once[0.05:0.15](x > 0)", by_number, backend=backend)
    elapsed = (dates - first) / np.timedelta64(1, "s")
    assert elapsed.tolist() == numbers.times.tolist()
    assert steps.values.tolist() == numbers.values.tolist()


@pytest.mark.parametrize("twin", [copy.copy, lambda m: pickle.loads(pickle.dumps(m))])
def test_a_twin_counts_the_same_ticks(twin: Any, backend: Backend) -> None:  # noqa: ANN401
    monitor = rtamt.dense.Monitor("once[0:0.5](x > 0)", resolution="100ms", backend=backend)
    monitor.update({"x": [(0.04, 1)]})
    other = twin(monitor)
    assert other.resolution == TENTH
    for each in (monitor, other):
        assert each.update({"x": [(0.96, 1)]}) == [(0, 1)]
        assert each.settled == 1
