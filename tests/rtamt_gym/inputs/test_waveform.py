"""Waveforms: their values, the value of a step, and errors."""

import pickle
from collections.abc import Callable
from fractions import Fraction
from itertools import accumulate
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from rtamt import InputError, InputTypeError
from rtamt_gym import Signal, Space, Waveform
from rtamt_gym.inputs.case import LEAST_POINTS, WaveformInterpolation

INTERPOLATIONS: tuple[WaveformInterpolation, ...] = ("hold", "linear", "pchip")

numbers = st.floats(-1e3, 1e3) | st.sampled_from([0.0, -0.0, 1.0, 1e-300, -1e300])


@st.composite
def waveforms(
    draw: st.DrawFn, kinds: tuple[WaveformInterpolation, ...] = INTERPOLATIONS
) -> Waveform:
    """Waveforms with uneven times."""
    kind = draw(st.sampled_from(kinds))
    values = draw(st.lists(numbers, min_size=LEAST_POINTS[kind], max_size=6))
    gaps = draw(
        st.lists(st.fractions(Fraction(1, 50), 9), min_size=len(values), max_size=len(values))
    )
    return Waveform([float(t - gaps[0]) for t in accumulate(gaps)], values, kind)


instants = st.floats(-1, 60) | st.fractions(0, 60, max_denominator=100).map(float)


@given(waveforms(), st.lists(instants, max_size=20))
def test_values_match_calls_and_stay_in_range(waveform: Waveform, others: list[float]) -> None:
    times = [*others, *waveform.times, *(np.nextafter(t, -1.0) for t in waveform.times)]
    at = waveform.at(np.array(times).reshape(-1, 1))[:, 0]
    assert at.tobytes() == np.array([waveform(t) for t in times]).tobytes()
    assert min(waveform.values) <= at.min() <= at.max() <= max(waveform.values)
    assert waveform.at(waveform.times).tolist() == list(waveform.values)
    assert waveform(1e9) == waveform.values[-1]
    assert waveform(-1e9) == waveform.values[0]


REFERENCES: dict[str, Callable[[Waveform, list[float]], Any]] = {
    "hold": lambda w, ts: [[v for t0, v in zip(w.times, w.values) if t0 <= t][-1] for t in ts],  # noqa: B905 - they are as many
    "linear": lambda w, ts: np.interp(ts, w.times, w.values),
    "pchip": lambda w, ts: PchipInterpolator(w.times, w.values)(ts),
}


@pytest.mark.parametrize("kind", INTERPOLATIONS)
@given(data=st.data(), shares=st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_waveforms_match_numpy_and_scipy(
    kind: WaveformInterpolation, data: st.DataObject, shares: list[float]
) -> None:
    small = st.floats(-100, 100).filter(lambda v: v == 0 or abs(v) > 1e-9)
    drawn = data.draw(waveforms((kind,)))
    values = [data.draw(small) for _ in drawn.values]
    waveform = Waveform(drawn.times, values, kind)
    times = [share * waveform.times[-1] for share in shares]
    expected = REFERENCES[kind](waveform, times)
    assert np.allclose(waveform.at(times), expected, rtol=1e-12, atol=1e-11)


@given(waveforms(), st.fractions(Fraction(1, 200), 2, max_denominator=200), st.integers(0, 40))
def test_steps_get_values_at_start_or_end(waveform: Waveform, period: Fraction, count: int) -> None:
    ahead = 0 if waveform.interpolation == "hold" else 1
    expected = [waveform(float((i + ahead) * period)) for i in range(count)]
    assert waveform.from_steps(period, count).tolist() == expected
    assert waveform.from_steps(float(period), count).tolist() == expected
    step = waveform.stepper(period)
    assert [step(i) for i in range(count)] == expected


@given(
    st.fractions(Fraction(1, 1000), 1, max_denominator=1000),
    st.integers(1, 30),
    st.integers(1, 60),
)
def test_pieces_start_exactly_at_steps(period: Fraction, points: int, length: int) -> None:
    duration = float(period * points * length)
    space = Space([Signal("u", 0, 1, points=points)], duration=duration)
    waveform = space.case(np.arange(points) / points)["u"]
    assert isinstance(waveform, Waveform)
    steps = waveform.from_steps(float(period), points * length)
    assert steps.tolist() == [value for value in waveform.values for _ in range(length)]


def test_rounding_stays_in_range() -> None:
    just_before = float(np.nextafter(1.0, 0.0))  # the cubic alone differs from 0.1 by 2e-16 there
    for sign in (1, -1):
        waveform = Waveform([0, 1, 2], [sign * 0.9, sign * 0.1, sign * 0.6], "pchip")
        assert waveform(just_before) == sign * 0.1
        assert waveform.at([just_before]).tolist() == [sign * 0.1]


def test_times_are_nearest_fractions() -> None:
    waveform = Waveform([0, 0.1 + 0.2], [0, 1])
    assert waveform.times == (0.0, 0.3)
    assert waveform.from_steps(0.1, 5).tolist() == [0, 0, 0, 1, 1]


def test_step_500_is_at_five_seconds() -> None:
    waveform = Waveform([0, 5, 0.1 + 0.2 + 9], [1, 2, 3])
    assert waveform.times == (0.0, 5.0, 9.3)
    steps = waveform.from_steps(0.01, 1000)
    assert np.flatnonzero(np.diff(steps)).tolist() == [499, 929]


def test_periods_of_large_terms_are_exact() -> None:
    period = Fraction(999_999_999_989, 10**12)
    waveform = Waveform([0, float(period * 9000), 1e9], [1, 2, 3])
    assert np.flatnonzero(np.diff(waveform.from_steps(period, 10_000))).tolist() == [8999]


@given(waveforms())
def test_equal_waveforms(waveform: Waveform) -> None:
    again = pickle.loads(pickle.dumps(waveform))
    assert again == waveform
    assert hash(again) == hash(waveform)
    assert again(1.5) == waveform(1.5)
    longer = Waveform([*waveform.times, 1e3], [*waveform.values, 0], waveform.interpolation)
    assert longer != waveform


ERRORS: list[tuple[tuple[Any, ...], type[Exception], str]] = [
    (([0, 1], [1]), InputError, "expected as many values as times, got 1 and 2"),
    (
        ([], []),
        InputError,
        "expected 1 or more control points with interpolation='hold', got 0",
    ),
    (
        ([0], [1], "linear"),
        InputError,
        "expected 2 or more control points with interpolation='linear', got 1",
    ),
    (
        ([0, 2, 2], [1, 2, 3]),
        InputError,
        "expected times that increase, got 2 and then 2",
    ),
    (
        ([0], [1], "cubic"),
        InputError,
        "expected interpolation='hold', 'linear' or 'pchip', got 'cubic'",
    ),
    (([0], [np.nan]), InputError, "expected values as finite numbers, got nan among them"),
    (([np.inf], [1]), InputError, "expected times as finite numbers, got inf among them"),
    (([0], ["1"]), InputTypeError, "expected values as numbers, got '1' among them"),
    ((0, 1), InputTypeError, "expected times as several numbers, got 0"),
    (
        ([0, 1], [-1e308, 1e308], "linear"),
        InputError,
        "expected values with finite differences",
    ),
]


@pytest.mark.parametrize(("arguments", "kind", "message"), ERRORS)
def test_waveform_errors(arguments: tuple[Any, ...], kind: type[Exception], message: str) -> None:
    with pytest.raises(kind) as caught:
        Waveform(*arguments)
    assert str(caught.value) == message
