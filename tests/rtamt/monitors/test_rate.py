"""Rates of change: every way to judge samples uses the values of differences."""

import copy
import itertools
import math
import pickle
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rtamt
import rtamt.export.fmu
from rtamt import (
    EpisodeMonitor,
    InputError,
    Monitor,
    SpecificationError,
    UncertainValue,
    VectorEpisodeMonitor,
    VectorMonitor,
)
from rtamt_arrays.inputs import program_of

inf, nan = math.inf, math.nan

BACKENDS: list[Literal["native", "python"]] = ["native", "python"]
SPEC = "always[0:{}](rate(x) <= 3 or y > 0) and once(abs(rate(y)) > 1) since rate(x) < 2"
VALUES = st.sampled_from([-inf, -4.0, -0.0, 0.0, 0.1, 2.0, 7.5, inf])
TRACES = st.lists(st.tuples(VALUES, VALUES), min_size=1, max_size=9)


def rates(values: list[float], period: float) -> list[float]:
    """Return the rates, by their definition."""
    found = [0.0]
    for before, value in itertools.pairwise(values):
        found.append(0.0 if value == before else (value - before) / period)
    return found


def rewritten(spec: str) -> str:
    return spec.replace("rate(x)", "dx").replace("rate(y)", "dy")


@pytest.mark.parametrize(("period", "bound"), [(None, 2), ("100ms", 0.2), (2, 4)])
@settings(max_examples=30)
@given(trace=TRACES)
def test_rates_are_differences(
    period: str | float | None, bound: float, trace: list[tuple[float, float]]
) -> None:
    spec = SPEC.format(bound)
    seconds = {None: 1.0, "100ms": 0.1}.get(period, 2.0)  # type: ignore[arg-type]
    x, y = (list(values) for values in zip(*trace, strict=True))
    data = {"x": x, "y": y}
    with_rates = {**data, "dx": rates(x, seconds), "dy": rates(y, seconds)}
    expected = rtamt.evaluate(rewritten(spec), with_rates, period)
    judged = rtamt.judge(rewritten(spec), with_rates, period)
    for backend in BACKENDS:
        found = rtamt.evaluate(spec, data, period, backend=backend)
        assert found.tobytes() == expected.tobytes()
        many = rtamt.evaluate(spec, {"x": [x], "y": [y]}, period, backend=backend)
        assert many[0].tobytes() == expected.tobytes()
        ours = rtamt.judge(spec, data, period, backend=backend)
        assert (ours.robustness, ours.lower, ours.upper, ours.verdict) == (
            judged.robustness,
            judged.lower,
            judged.upper,
            judged.verdict,
        )


@pytest.mark.parametrize("backend", BACKENDS)
@settings(max_examples=30)
@given(trace=TRACES, cut=st.integers(0, 9))
def test_monitors_agree_with_evaluate(
    backend: Literal["native", "python"], trace: list[tuple[float, float]], cut: int
) -> None:
    spec, table = SPEC.format(2), np.array(trace)
    expected = rtamt.evaluate(spec, table)
    late = Monitor(spec).latency
    monitor, twin = Monitor(spec, backend=backend), Monitor(spec, backend=backend)
    found = [monitor.update(*row) for row in trace]
    assert np.array(found[late:]).tobytes() == expected[: len(trace) - late].tobytes() or (
        len(trace) <= late
    )
    blocks = [twin.update_many(table[:cut]), twin.update_many(table[cut:])]
    assert np.concatenate(blocks).tolist() == pytest.approx(found, nan_ok=True)
    episode = EpisodeMonitor(spec, backend=backend, history=True)
    entries = VectorMonitor(spec, 2, backend=backend)
    episodes = VectorEpisodeMonitor(spec, 2, backend=backend)
    for i, row in enumerate(trace):
        if i == cut:
            episode, entries, episodes = copy.copy(episode), copy.copy(entries), copy.copy(episodes)
        episode.update({"x": row[0], "y": row[1]})
        late_ones = entries.update([row, row], mask=[True, i > 0])
        episodes.update([row, row], mask=[True, i > 0])
        assert late_ones[0] == found[i] or math.isnan(found[i])
        assert episodes.robustness[0] == episode.robustness
        assert (episodes.lower[0], episodes.upper[0]) == (episode.lower, episode.upper)
    assert episode.robustness == expected[0]
    if len(trace) > 1:  # its first sample is the second one
        assert episodes.robustness[1] == rtamt.evaluate(spec, table[1:])[0]
    steps = episode.explain().steps
    assert steps[0].value == expected[0]


def test_state_has_the_sample_before() -> None:
    monitor = Monitor("rate(x) > 0", 0.5)
    assert [monitor.update(x) for x in (3, 4)] == [0.0, 2.0]
    twin = pickle.loads(pickle.dumps(monitor))
    assert monitor.update(7) == twin.update(7) == 6.0
    with pytest.raises(InputError):
        twin.update(nan)
    with pytest.raises(InputError, match=r"expected 1 value \(x\), got 2"):
        twin.update(1, 2)
    with pytest.raises(InputError, match=r"unknown variable 'rate\(x\)'"):
        twin.update({"x": 1, "rate(x)": 2})
    assert twin.update(8) == 2.0
    twin.reset()
    assert twin.update(9) == 0.0
    assert (twin.variables, twin.latency) == (("x",), 0)
    with pytest.raises(InputError, match=r"expected an array of shape \(n, 1\)"):
        twin.update_many([[1, 2]])
    with pytest.raises(InputError, match=r"expected an array of shape \(1, 1\)"):
        VectorMonitor("rate(x) > 0", 1).update([[1, 2]])


def test_defaults_and_held_values_do_not_change() -> None:
    held = Monitor("rate(x)", nan="hold")
    assert [held.update(x) for x in (1, nan, 4)] == [0, 0, 3]
    data = {"x": [1, nan, 4]}
    assert rtamt.evaluate("rate(x)", data, nan="hold").tolist() == [0, 0, 3]
    kept = Monitor("input float x = 2\nrate(x)")
    assert [kept.update(**sample) for sample in ({}, {"x": 5}, {})] == [0, 3, 0]


def test_rates_of_unknown_values_are_unknown() -> None:
    spec, unknown = "rate(x) <= 3", [1.0, nan, 2.0, 4.0]
    bounds = [(3.0, 3.0), (-inf, inf), (-inf, inf), (1.0, 1.0)]
    for at, expected in enumerate(bounds):
        wanted = f"eventually[{at}:{at}]({spec})"
        judged = rtamt.judge(wanted, {"x": unknown}, nan="unknown")
        assert (judged.lower, judged.upper) == expected
        assert judged.unknown == ("x",)
        episode = EpisodeMonitor(wanted, nan="unknown")
        entries = VectorEpisodeMonitor(wanted, 1, nan="unknown")
        for x in unknown:
            episode.update(x)
            entries.update([[x]])
        assert episode.bounds() == (entries.lower[0], entries.upper[0]) == expected
    first = EpisodeMonitor(spec)
    first.update(UncertainValue(0, 9))
    assert first.bounds() == (3, 3)  # there is no sample before it


@settings(max_examples=30)
@given(
    low=st.tuples(VALUES, VALUES), high=st.tuples(VALUES, VALUES), part=st.tuples(VALUES, VALUES)
)
def test_rates_of_bounded_values_have_bounds(
    low: tuple[float, float], high: tuple[float, float], part: tuple[float, float]
) -> None:
    ends = [
        sorted(each, key=lambda x: (x, math.copysign(1, x)))
        for each in zip(low, high, part, strict=True)
    ]
    spec = "next(rate(x) >= 0 and rate(x) <= 2)"
    data = {"x": UncertainValue([each[0] for each in ends], [each[-1] for each in ends])}
    judged = rtamt.judge(spec, data, 0.5, end="complete")
    inside = rtamt.evaluate(spec, {"x": [each[1] for each in ends]}, 0.5)[0]
    assert judged.lower <= inside <= judged.upper
    episode = EpisodeMonitor(spec, 0.5)
    for least, _, most in ends:
        episode.update(UncertainValue(least, most))
    episode.finish()
    assert episode.bounds() == (judged.lower, judged.upper)


def test_explanations_show_both_samples() -> None:
    found = rtamt.explain("always(rate(x) + y <= 3)", {"x": [0, 1, 5], "y": [0, 0, 0]})
    assert [tuple(cause) for cause in found.causes] == [("x", 1, 1), ("x", 2, 5), ("y", 2, 0)]
    assert "rate(x) + y <= 3" in str(found)
    found = rtamt.explain("rate(x) > 3", {"x": [4, 9]})
    assert [tuple(cause) for cause in found.causes] == [("x", 0, 4)]


def test_infinite_values_have_rates() -> None:
    x = [inf, inf, 1, -inf, -inf, 5]
    assert rtamt.evaluate("rate(x)", {"x": x}).tolist() == [0, 0, -inf, -inf, 0, inf]


def test_reset_reads_the_value_of_a_rate_late() -> None:
    first = {
        "rate(x) > 0": set(),
        "next(rate(x) > 0)": {"x"},
        "next(next(rate(x) > 0))": set(),
        "always(rate(x) > 0)": {"x"},
    }
    for spec, variables in first.items():
        assert EpisodeMonitor(spec).program.read_first() == variables


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: rtamt.parse("rate(x + y) > 0"), "expected a variable in rate(x), got 'x + y'"),
        (lambda: rtamt.parse("rate(rate(x)) > 0"), "got 'rate(x)'"),
        (lambda: rtamt.parse("const float c = 2\nrate(c) > 0"), "got '2'"),
        (lambda: rtamt.parse("rate(x > 1) > 0"), "expected a term as operand of 'rate'"),
        (lambda: rtamt.dense.Monitor("rate(x) > 0"), "does not support 'rate(x)'"),
        (lambda: rtamt.dense.judge("rate(x) > 0", {"x": [(0, 1)]}), "dense time"),
        (lambda: rtamt.check("rate(x) > 0"), "symbolic checking does not support 'rate(x)'"),
        (
            lambda: rtamt.export.fmu.export_fmu("rate(x) > 0", "m.fmu", period=1),
            "an exported monitor does not",
        ),
        (lambda: program_of("rate(x) > 0", None, None, online=False), "rtamt_arrays does not"),
        (lambda: rtamt.equivalent("rate(x) > 0", "x > 0"), "symbolic checking does not support"),
    ],
)
def test_rates_that_are_refused(call: Callable[[], object], text: str) -> None:
    with pytest.raises(SpecificationError) as raised:
        call()
    assert text in str(raised.value)


def test_rate_names_a_variable_too() -> None:
    assert rtamt.evaluate("rate > rate(rate)", {"rate": [1, 3]}).tolist() == [1, 1]
    assert str(rtamt.parse("rate( x )>0").formula) == "rate(x) > 0"


@pytest.mark.parametrize("backend", BACKENDS)
def test_monitors_with_rates_state_the_back_end_that_runs(
    backend: Literal["native", "python"],
) -> None:
    rate, plain = "always(rate(x) <= 1)", "always(x <= 1)"
    for text, runs in ((rate, "python"), (plain, backend)):
        assert Monitor(text, backend=backend).backend == runs
        assert EpisodeMonitor(text, backend=backend).backend == runs
        assert VectorMonitor(text, 2, backend=backend).backend == runs
        assert VectorEpisodeMonitor(text, 2, backend=backend).backend == runs
