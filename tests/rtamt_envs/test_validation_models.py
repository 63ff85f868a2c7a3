"""The models of tests/support/models agree with algebra and with other solvers."""

import math

import numpy as np
import pytest
from models import chasing, condenser, elevator, requirements, transmission, unicycle
from numpy.typing import NDArray
from scipy.integrate import RK45, solve_ivp

pytestmark = pytest.mark.slow

Floats = NDArray[np.float64]


def pieces(rng: np.random.Generator, low: float, high: float, count: int, each: int) -> Floats:
    return np.repeat(rng.uniform(low, high, count), each)


def test_transmission_reproduces_the_two_values_of_simulink() -> None:
    rows = transmission.fixed_step(np.full(3000, 100.0), np.zeros(3000))
    assert rows[2000, 0] == pytest.approx(120.21327149261522, abs=1e-10)
    assert rows[:, 1].max() == pytest.approx(4768.277187862124, abs=1e-10)


def test_transmission_in_fixed_steps_converges_with_order_one_to_the_adaptive_solution() -> None:
    # The right side jumps when the car starts or shifts, or the engine reaches its minimum speed.
    # The steps of the formula of fifth order do not end there, so it is of first order there.
    rng = np.random.default_rng(3)
    throttle, brake = pieces(rng, 0, 100, 2, 500), pieces(rng, 0, 325, 2, 500)
    exact = transmission.solve(throttle, brake)
    errors = [
        np.abs(transmission.fixed_step(throttle, brake, halvings=k) - exact).max(0)
        for k in range(3)
    ]
    speed, rpm, gear = np.transpose(errors)
    np.testing.assert_allclose(speed[:-1] / speed[1:], 2, rtol=0.01)
    assert np.all(rpm[:-1] / rpm[1:] > 1.8)
    assert speed[0] < 2e-3
    assert not gear.any()


def test_transmission_is_the_same_to_another_adaptive_solver() -> None:
    rng = np.random.default_rng(4)
    throttle, brake = pieces(rng, 0, 100, 2, 500), pieces(rng, 0, 325, 2, 500)
    first, second = (
        transmission.solve(throttle, brake, **options)
        for options in ({}, {"method": RK45, "rtol": 1e-10})
    )
    np.testing.assert_allclose(first[:, 0], second[:, 0], atol=1e-6)
    np.testing.assert_allclose(first[:, 1], second[:, 1], atol=1e-3)
    np.testing.assert_array_equal(first[:, 2], second[:, 2])


def test_cars_at_full_throttle_are_parabolas() -> None:
    # y1 = -t^2/2; every follower leaves at gap 15, sqrt(10) s after the car before it.
    times = np.linspace(0.0, 100.0, 2001)
    ends = np.array([0.0, 100.0])
    rows = chasing.solve(ends, np.ones(2), np.zeros(2), times)
    for i in range(5):
        since = np.maximum(times - i * math.sqrt(10), 0)
        np.testing.assert_allclose(rows[:, i], 10 * i - since**2 / 2, rtol=0, atol=1e-8)


def test_condenser_is_the_same_to_two_implicit_solvers() -> None:
    steam = pieces(np.random.default_rng(5), 3.99, 4.01, 20, 175)
    first, second = (condenser.solve(steam, method=method) for method in ("LSODA", "Radau"))
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-6)


def test_elevator_is_the_same_to_its_series_and_to_an_implicit_solver() -> None:
    command = elevator.square(0.8, 1.75, 130)[None]
    np.testing.assert_allclose(
        elevator.solve(command), elevator.solve_stiff(command), rtol=0, atol=1e-9
    )


def test_unicycle_solves_its_equations() -> None:
    for speed, turn in ((0.7, 1.3), (-0.4, 0.0), (0.2, -5.0)):
        run = solve_ivp(
            lambda _, y, v=speed, w=turn: [v * math.cos(y[2]), v * math.sin(y[2]), w],
            (0, 0.1),
            [1.0, 2.0, 0.5],
            rtol=1e-12,
            atol=1e-12,
        )
        np.testing.assert_allclose(
            unicycle.move((1.0, 2.0, 0.5), speed, turn, 0.1), run.y[:, -1], rtol=0, atol=1e-10
        )


def test_elevator_without_faults_follows_commands_as_the_map_says() -> None:
    # Rows: 0.2, 0.4, 0.6, 0.8 Hz; columns: amplitudes 1, 1.25, 1.5, 1.75 cm.
    waves = [
        elevator.square(frequency, amplitude, 1001)
        for frequency in (0.2, 0.4, 0.6, 0.8)
        for amplitude in (1, 1.25, 1.5, 1.75)
    ]
    positions = elevator.solve(np.array(waves))[:, :-1]
    found = [requirements.follows(*pair) for pair in zip(waves, positions, strict=True)]
    assert np.reshape(found, (4, 4)).round(3).tolist() == [
        [0.99, 0.488, -0.014, -0.517],
        [0.998, 0.498, 0.005, -0.495],
        [1.073, 0.594, 0.115, -0.363],
        [0.635, 0.056, -0.533, -0.85],
    ]
