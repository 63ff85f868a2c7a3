"""The steam condenser: tables, the step of the setpoint, convergence, balance at rest."""

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray
from rtamt_envs import steam_condenser
from rtamt_envs.steam_condenser import SCENARIO
from rtamt_envs.vector import ScenarioVectorEnv
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]
PERIOD = 0.01
START = np.array([90.0, 80.0, 90.0, 107.8880952381, 0, 0, 0, 0, 0, 0])


def runs(steam: Floats, **options: float) -> Floats:
    """Return the observations of environments: (k + 1, n, 6) under flows of steam (k, n)."""
    env = gym.make_vec("rtamt/SteamCondenser-v0", steam.shape[1])
    assert isinstance(env, ScenarioVectorEnv)
    first, _ = env.reset(seed=0, options=options)
    return np.concatenate([first[None], env.rollout(steam[..., None])])


def rates(steam: float, setpoint: float, state: Floats) -> Floats:
    filled = np.empty(10)
    steam_condenser._rates(steam, setpoint, state, filled)
    return filled


def exact(state: Floats, steam: float, setpoint: float, seconds: float) -> Floats:
    """Return the state after some time, by a method of order 8 with tight tolerances."""
    found: Floats = solve_ivp(
        lambda _, state: rates(steam, setpoint, state),
        (0.0, seconds),
        state,
        "DOP853",
        rtol=1e-12,
        atol=1e-12,
    ).y[:, -1]
    return found


def test_a_halved_step_has_a_sixteenth_of_the_error() -> None:
    """In the smooth part of the tables: below 90 kPa."""
    begin = START - np.array([5.0, 0, 5.0, *[0] * 7])
    errors = []
    for steps in (50, 100, 200):
        state, step = begin, 0.5 / steps
        for _ in range(steps):
            first = rates(4.0, 87.0, state)
            second = rates(4.0, 87.0, state + step / 2 * first)
            third = rates(4.0, 87.0, state + step / 2 * second)
            fourth = rates(4.0, 87.0, state + step * third)
            state = state + step / 6 * (first + 2 * second + 2 * third + fourth)
        errors.append(np.abs(state - exact(begin, 4.0, 87.0, 0.5))[3])
        if steps == 50:  # the scenario's own step
            held = np.array([*begin, 200.0])
            for _ in range(steps):
                SCENARIO.step(np.array([4.0]), np.array([87.0]), np.zeros(0), held, np.empty(6))
            assert held[:10] == pytest.approx(state, rel=1e-13)
    assert [a / b for a, b in pairwise(errors)] == pytest.approx([16, 16], rel=0.15)


def test_tables_go_in_lines_through_their_points() -> None:
    table = steam_condenser._CONDENSATION
    read = [steam_condenser._between(table, 50.0 + 10 * i) for i in range(7)]
    assert read == pytest.approx(table, rel=1e-15)
    between = 0.25 * 93.4854 + 0.75 * 96.6870
    assert steam_condenser._between(table, 87.5) == pytest.approx(between, rel=1e-15)
    below, above = (steam_condenser._between(table, p) for p in (45.0, 115.0))
    assert below == pytest.approx(81.3167 - 0.5 * (85.9258 - 81.3167))
    assert above == pytest.approx(102.2923 + 0.5 * (102.2923 - 99.6059))


def test_the_setpoint_steps_at_two_seconds() -> None:
    steam = np.full((400, 1), 4.0)
    low, high = runs(steam)[:, 0], runs(steam, setpoint=88.0)[:, 0]
    np.testing.assert_array_equal(low[:200], high[:200])
    np.testing.assert_array_equal(low[:, 1], [90.0] * 200 + [87.0] * 201)
    np.testing.assert_array_equal(high[:, 1], [90.0] * 200 + [88.0] * 201)
    assert low[200, 0] == high[200, 0]
    assert (low[202:, 3] > high[202:, 3]).all()  # more water at once
    assert low[-1, 0] < high[-1, 0] - 0.5


def test_the_condensate_is_the_steam_when_the_pressure_rests() -> None:
    reading, setpoint, temperature, flow, heat, p = runs(np.full((20_000, 1), 4.0))[-1, 0]
    evaporation = np.interp(p, np.arange(50, 111, 10), steam_condenser._EVAPORATION)
    assert heat / evaporation == pytest.approx(4.0, rel=1e-6)
    assert heat / 4.2 == pytest.approx((temperature - 60) * flow, rel=1e-6)
    assert reading == pytest.approx(p, rel=1e-9)
    assert setpoint < p < setpoint + 0.5
