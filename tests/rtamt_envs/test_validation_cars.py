"""Chasing cars against the second model, algebra and a robustness in NumPy."""

import functools
import math

import numpy as np
import pytest
from models import chasing, requirements
from models.judged import evaluated, monitored, observed
from numpy.typing import NDArray

pytestmark = pytest.mark.slow

Floats = NDArray[np.float64]
TIMES = np.linspace(0.0, 100.0, 2001)


def waveforms(case: int) -> Floats:
    """Return the action of each step, the waveform at its end: 10 or 21 points, some at corners."""
    rng = np.random.default_rng(case)
    times = np.linspace(0, 100, 21 if case % 2 else 10)
    values = rng.uniform(0, 1, (2, len(times)))
    if case % 3 == 2:
        values = rng.choice([0.0, 1.0], (2, len(times)))
    return np.stack([np.interp(TIMES[1:], times, column) for column in values], -1)


def knots(actions: Floats) -> tuple[Floats, Floats]:
    """Return times and values at the knots of the actions; the first step holds its own."""
    values = np.concatenate([actions[:1], actions])
    bent = np.abs(np.diff(values, n=2, axis=0)).max(1) > 1e-12
    keep = np.concatenate([[True], bent, [True]])
    return TIMES[keep], values[keep]


@functools.cache
def inputs() -> Floats:
    return np.array([waveforms(case) for case in range(12)])


@functools.cache
def traces() -> Floats:
    return observed("ChasingCars", inputs())


def test_positions_are_those_of_the_second_model() -> None:
    # Both are exact between events, about 2000 of them in a run; DOP853 at 1e-12 has an error of
    # 1e-10.
    for actions, trace in zip(inputs()[:3], traces()[:3], strict=True):
        times, values = knots(actions)
        rows = chasing.solve(times, values[:, 0], values[:, 1], TIMES)
        np.testing.assert_allclose(trace, rows, rtol=0, atol=1e-9)


def test_full_throttle_gives_parabolas() -> None:
    actions = np.tile([1.0, 0.0], (1, 2000, 1))
    rows = observed("ChasingCars", actions)[0]
    for i in range(5):
        since = np.maximum(TIMES - i * math.sqrt(10), 0)
        np.testing.assert_allclose(rows[:, i], 10 * i - since**2 / 2, rtol=0, atol=1e-9)


def test_full_throttle_and_brake_give_an_exponential() -> None:
    # v1' = -1 - v1: y1 = 1 - t - exp(-t).
    actions = np.ones((1, 2000, 2))
    rows = observed("ChasingCars", actions)[0]
    np.testing.assert_allclose(rows[:, 0], 1 - TIMES - np.exp(-TIMES), rtol=0, atol=1e-9)


def test_robustness_of_every_requirement_is_that_of_numpy() -> None:
    for trace in traces():
        found = evaluated("ChasingCars", trace)
        assert found == {name: rule(trace) for name, rule in requirements.CHASING.items()}


def test_monitors_decide_as_numpy() -> None:
    for case in (0, 5):
        found = monitored("ChasingCars", inputs()[case])
        for name, rule in requirements.CHASING.items():
            expected = rule(traces()[case])
            assert found[name] == ("VIOLATED" if expected < 0 else "SATISFIED", expected), name
