"""Dense time is counted: exact on decimal times, whatever their unit, their form and the chunks."""

import copy
import itertools
import math
import pickle
import re
from fractions import Fraction
from typing import Any, Literal

import numpy as np
import pytest
from dense_oracle import Definition
from dense_signals import INTEGERS, Signals, bitwise, chunked, chunks, play, relevant, signals
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import formulas

from rtamt import DenseMonitor, Events, Formula, Specification, evaluate_dense, parse
from rtamt.language.interval import UNITS

Backend = Literal["native", "python"]
any_formula = formulas(endless=True, dense=True).filter(lambda f: f.variables)
bounded = formulas(dense=True).filter(lambda f: f.variables)
zeros = signals(INTEGERS)
TENTH = Fraction(1, 10)


def tenths(formula: Formula, unit: str = "s") -> Specification:
    """The formula with bounds that are multiples of a tenth of a second in place of a half."""

    def shorter(bounds: re.Match[str]) -> str:
        numbers = (Fraction(b) / 5 / UNITS[unit] for b in bounds.groups() if b != "inf")
        texts = [f"{number.numerator * 10**9 // number.denominator}e-9" for number in numbers]
        return f"[{':'.join([*texts, 'inf'][:2])}]"

    text = re.sub(r"\[([\d.]+):([\d.]+|inf)\]", shorter, str(formula))
    return parse(text, unit=unit)


def exact(whole: Signals, start: int = 0) -> dict[str, list[tuple[Fraction, float]]]:
    """The events at multiples of a tenth."""
    return {n: [(start + Fraction(t) / 5, v) for t, v in events] for n, events in whole.items()}


def sums(events: list[tuple[Fraction, float]]) -> list[tuple[float, float]]:
    """The events at sums of doubles, such as 0.7 + 0.1, which is no double of 0.8."""
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
    assert bitwise(evaluate_dense(spec, times, backend=backend)) == bitwise(expected)


@settings(max_examples=examples(40))
@given(formula=bounded, whole=zeros, shares=chunks(), start=st.sampled_from((0, 1_700_000_000)))
def test_chunks_do_not_matter_at_decimal_times(
    formula: Formula, whole: Signals, shares: list[list[float]], start: int, backend: Backend
) -> None:
    spec = tenths(formula)
    times = {n: [(float(t), v) for t, v in e] for n, e in exact(whole, start).items()}
    steps = play(DenseMonitor(spec, backend=backend), chunked(times, shares))
    assert bitwise(steps) == bitwise(evaluate_dense(spec, times, backend=backend))


@settings(max_examples=examples(40))
@given(formula=any_formula, whole=zeros)
def test_the_unit_in_which_times_are_written_does_not_matter(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    found = []
    for unit in ("s", "ms", "us", "ns", "ps"):
        scale = 1 / UNITS[unit]
        times = {n: [(float(t * scale), v) for t, v in e] for n, e in exact(whole).items()}
        steps = evaluate_dense(tenths(formula, unit), times, backend=backend)
        found.append([(round(Fraction(t) / scale * 10), v, s) for t, v, s in bitwise(steps)])
    assert found[1:] == found[:-1]


def test_seven_tenths_and_a_tenth_are_eight_tenths(backend: Backend) -> None:
    gap = {"x": [(0, 1), (0.7, -1), (0.7 + 0.1, 1), (2, 1)]}
    text = "historically once[0:0.1](x > 0)"
    assert evaluate_dense(text, gap, backend=backend) == [(0, 1)]
    late = {"x": [(1.7e9 + 0.1 * k, v) for k, v in ((0, 1.0), (7, -1.0), (8, 1.0), (20, 1.0))]}
    assert evaluate_dense(text, late, backend=backend) == [(1.7e9, 1)]


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
    tick = DenseMonitor("x > 0", resolution=resolution).resolution
    nearest = {round(Fraction(repr(time)) / tick): time for time in times}
    events = [(nearest[k], float(i % 2)) for i, k in enumerate(sorted(nearest))]
    expected = [float(k * tick) for k in sorted(nearest)]
    forms: list[Any] = [events, np.array(events), Events(*zip(*events, strict=True))]
    given_now = {"x": data.draw(st.sampled_from(forms))}
    whole = evaluate_dense("x > 0", given_now, resolution=resolution, backend=backend)
    assert whole.times.tolist() == expected
    monitor = DenseMonitor("x > 0", resolution=resolution, backend=backend)
    assert [t for t, _ in monitor.update(given_now) + monitor.finish()] == expected
    assert monitor.settled == expected[-1]


def test_integers_are_exact_whatever_their_size(backend: Backend) -> None:
    spec = parse("once[0:1](x > 0)", unit="ns")
    start = 2**60 + 1
    for form in (
        [(start, 1.0), (start + 1, -0.5), (start + 5, 2)],
        Events(np.array([start, start + 1, start + 5]), [1, -0.5, 2]),
        Events([start, start + 1, start + 5], [1, -0.5, 2]),
        np.array([[start, 2], [start + 1, -1], [start + 5, 4]]),
    ):
        steps = evaluate_dense(spec, {"x": form}, backend=backend)
        assert len(steps) == 3  # 2 ns after the first event it is forgotten
        monitor = DenseMonitor(spec, backend=backend)
        assert [v for _, v in monitor.update({"x": form})] == steps.values.tolist()[:2]
    assert Events([start, start + 1], [0, 1])[1:].given[0].tolist() == [start + 1]


def test_dates_come_back_as_dates(backend: Backend) -> None:
    first = np.datetime64("2026-03-01T12:00:00.1", "ms")
    times = first + np.array([0, 700, 800, 2000], "m8[ms]")
    values = [1.0, -1.0, 1.0, 1.0]
    pairs = list(zip(times, values, strict=True))
    for form in (Events(times, values), pairs, Events(pairs[0][0] + (times - first), values)):
        steps = evaluate_dense("once[0.05:0.15](x > 0)", {"x": form}, backend=backend)
        assert steps.times.dtype == "M8[ns]"
        dates: Any = steps.times
        assert (dates[:2] == [first, first + np.timedelta64(50, "ms")]).all()
        assert steps.values.tolist()[:2] == [-math.inf, 1]
        monitor = DenseMonitor("once[0.05:0.15](x > 0)", backend=backend)
        again = monitor.update({"x": form}) + monitor.finish()
        assert again == list(steps)
        assert isinstance(again[0][0], np.datetime64)
        assert monitor.settled == times[-1]
    twin = pickle.loads(pickle.dumps(monitor))
    assert twin.settled == times[-1]
    by_number = {"x": [(t, v) for t, v in zip((0, 0.7, 0.8, 2), values, strict=True)]}
    numbers = evaluate_dense("once[0.05:0.15](x > 0)", by_number, backend=backend)
    elapsed = (dates - first) / np.timedelta64(1, "s")
    assert elapsed.tolist() == numbers.times.tolist()
    assert steps.values.tolist() == numbers.values.tolist()


@pytest.mark.parametrize("twin", [copy.copy, lambda m: pickle.loads(pickle.dumps(m))])
def test_a_twin_counts_the_same_ticks(twin: Any, backend: Backend) -> None:  # noqa: ANN401
    monitor = DenseMonitor("once[0:0.5](x > 0)", resolution="100ms", backend=backend)
    monitor.update({"x": [(0.04, 1)]})
    other = twin(monitor)
    assert other.resolution == TENTH
    for each in (monitor, other):
        assert each.update({"x": [(0.96, 1)]}) == [(0, 1)]
        assert each.settled == 1
