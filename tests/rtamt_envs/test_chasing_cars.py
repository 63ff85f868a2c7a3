"""Chasing cars: closed solutions, guards within a period, and the error of Euler steps."""

import gymnasium as gym
import numpy as np
import pytest
from interpreted import compiled_and_interpreted
from numpy.typing import NDArray
from rtamt_envs import chasing_cars
from rtamt_envs.chasing_cars import SCENARIO
from rtamt_envs.vector import ScenarioVectorEnv
from scipy.integrate import solve_ivp

import rtamt

Floats = NDArray[np.float64]
PERIOD = 0.05
TIMES = np.arange(2001) * PERIOD


def runs(actions: Floats, **options: float) -> Floats:
    """Return the positions of environments: (k + 1, n, 5) under actions (k, n, 2)."""
    env = gym.make_vec("rtamt/ChasingCars-v0", actions.shape[1])
    assert isinstance(env, ScenarioVectorEnv)
    first, _ = env.reset(seed=0, options=options)
    return np.concatenate([first[None], env.rollout(actions)])


def run(throttle: Floats | float, brake: Floats | float, steps: int = 2000, **gap: float) -> Floats:
    """Return the positions of one run, (steps + 1, 5)."""
    actions = np.empty((steps, 1, 2))
    actions[:, 0, 0], actions[:, 0, 1] = throttle, brake
    return runs(actions, **gap)[:, 0]


def random_inputs(entries: int, seed: int) -> Floats:
    """Return inputs of instance 1: 10 control points each, joined by lines."""
    rng = np.random.default_rng(seed)
    points = np.linspace(0, 100, 10)
    columns = [np.interp(TIMES[1:], points, row) for row in rng.random((2 * entries, 10))]
    return np.stack(columns, axis=1).reshape(2000, entries, 2)


def begun(speeds: list[float], modes: list[float], gap: float) -> tuple[Floats, Floats]:
    """Return a state in an episode without throttle and brake, and an observation to fill."""
    state = np.zeros(SCENARIO.state)
    state[:5] = gap * np.arange(5)
    state[5:10] = speeds
    state[10:15] = modes
    state[chasing_cars._HAS_ACTION] = 1.0
    return state, np.empty(5)


def coast(state: Floats, observation: Floats, steps: int) -> Floats:
    """Take steps without throttle and brake."""
    rows = []
    for _ in range(steps):
        SCENARIO.step(np.zeros(2), SCENARIO.defaults, np.zeros(0), state, observation)
        rows.append(observation.copy())
    return np.array(rows)


def test_followers_keep_their_distance_from_the_start() -> None:
    np.testing.assert_array_equal(run(0.0, 0.0), np.tile([0.0, 10, 20, 30, 40], (2001, 1)))


@pytest.mark.parametrize(("throttle", "brake"), [(1.0, 1.0), (0.3, 0.02), (0.7, 0.5), (1.0, 1e-4)])
def test_car_1_has_its_closed_solution_under_held_inputs(throttle: float, brake: float) -> None:
    way = TIMES + np.expm1(-brake * TIMES) / brake
    assert run(throttle, brake)[:, 0] == pytest.approx(-throttle / brake * way, rel=1e-9, abs=1e-11)


def test_inputs_go_in_lines_and_the_first_is_held() -> None:
    y = run(np.array([1.0, 0.0, 0.0]), 0.0, 3)[:, 0]
    h = PERIOD
    first, second = -h * h / 2, -h * h - (h * h / 2 - h * h / 6)
    assert y == pytest.approx([0, first, first + second, first + second - 1.5 * h * h], rel=1e-14)


def test_car_1_obeys_inputs_that_change_all_the_way_within_a_period() -> None:
    inputs = np.random.default_rng(3).integers(0, 2, (60, 2)).astype(float)
    y = run(inputs[:, 0], inputs[:, 1], 60)[:, 0]
    expected, state, before = [0.0], np.zeros(2), inputs[0]
    for now in inputs:
        ways = (before, now - before)

        def slope(s: float, state: Floats, ways: tuple[Floats, Floats] = ways) -> Floats:
            throttle, brake = ways[0] + s * ways[1]
            return PERIOD * np.array([state[1], -throttle - brake * state[1]])

        state = solve_ivp(slope, (0, 1), state, "DOP853", rtol=1e-13, atol=1e-16).y[:, -1]
        expected.append(state[0])
        before = now
    assert y == pytest.approx(expected, rel=1e-13, abs=1e-15)


def test_a_follower_chases_then_gives_way_then_chases() -> None:
    speed = np.sqrt(8)  # the time from gap 14 to gap 10, and the speed then
    away = speed + 5 / speed  # the time at which the gap is 15
    t = TIMES[:121]
    chased, kept = t - speed, t - away
    expected = np.where(
        chased < 0,
        14 - t * t / 2,
        np.where(kept < 0, 10 + speed * chased, 15 - speed * kept - kept**2 / 2),
    )
    until = away + 1.5
    y2 = run(0.0, 0.0, 120, gap=14.0)[:, 1]
    assert y2[t < until] == pytest.approx(expected[t < until], rel=1e-14)


def test_a_follower_that_is_too_near_brakes_until_it_is_far_behind() -> None:
    keeping = chasing_cars._KEEPING
    state, observation = begun([2.5, 0.5, 0, 0, 0], [0, keeping, keeping, keeping, keeping], 10.0)
    state[1] = 5.15  # the gap falls by 2 m/s, to 5 at 0.075 s
    rows = coast(state, observation, 20)
    t = TIMES[1:21]
    braked = np.maximum(t - 0.075, 0)
    expected = 5.15 + 0.5 * np.minimum(t, 0.075) + 0.5 * np.expm1(-braked)
    assert rows[:, 1] == pytest.approx(expected, rel=1e-14)
    assert state[11] == chasing_cars._BRAKING
    state[0], state[5] = state[1] - 19.9, -2.0  # car 1 drives off: the gap grows to 20
    speed, y = state[6], state[1]
    coast(state, observation, 1)
    assert state[11] == chasing_cars._BRAKING
    coast(state, observation, 1)
    assert state[11] == chasing_cars._CHASING
    ahead = -state[6]  # it brakes until the gap is 20, then v' = 1
    assert -ahead > speed * np.exp(-0.1)
    assert y - observation[1] < 0.1 * speed + 0.1**2 / 2


def test_many_guards_are_met_in_one_period() -> None:
    speed = 200.0
    keeping = chasing_cars._KEEPING
    state, observation = begun([0, speed, 0, 0, 0], [0, keeping, keeping, keeping, keeping], 14.0)
    coast(state, observation, 1)
    chased = 10 / (np.sqrt(speed * speed + 10) + speed)  # from gap 15 to gap 10
    left = PERIOD - 1 / speed - chased
    assert 0 < left < 5 / speed
    assert observation[1] == pytest.approx(10 + (speed + chased) * left, rel=1e-13)
    assert state[6] == pytest.approx(speed + chased, rel=1e-15)
    assert state[11] == keeping


def least(name: str, y: Floats) -> list[float]:
    """Return the robustness of a requirement in each environment."""
    spec = SCENARIO.specifications[name]
    entries = [
        {f"y{car + 1}": row for car, row in enumerate(entry)} for entry in y.transpose(1, 2, 0)
    ]
    return [float(rtamt.evaluate(spec, entry, PERIOD)[0]) for entry in entries]


def test_the_baseline_meets_every_requirement() -> None:
    y = run(0.5, 1.0)
    assert min(least(name, y[:, None])[0] for name in SCENARIO.specifications) > 0.2
    action = np.empty(2)
    SCENARIO.baseline(3.0, y[60], SCENARIO.defaults, action)
    assert action.tolist() == [0.5, 1.0]


def _euler(actions: Floats, step: float) -> Floats:
    """Return the positions by the forward Euler method, guards checked before each step."""
    entries = actions.shape[1]
    y, v = np.tile(10.0 * np.arange(5), (entries, 1)), np.zeros((entries, 5))
    chasing, keeping = np.ones((entries, 4), bool), np.zeros((entries, 4), bool)
    rows = [y]
    for action in actions:
        for _ in range(round(PERIOD / step)):
            gaps = np.diff(y, axis=1)
            near, far = chasing & (gaps <= 10), keeping & (gaps >= 15)
            braking = ~chasing & ~keeping
            chasing = (chasing & ~near) | far | (braking & (gaps >= 20))
            keeping = (keeping & ~far & ~(gaps <= 5)) | near
            pull = np.where(chasing, 1.0, np.where(keeping, 0.0, -v[:, 1:]))
            ways = np.where(keeping, v[:, 1:], -v[:, 1:])
            push = -action[:, :1] - action[:, 1:] * v[:, :1]
            y, v = (
                y + step * np.concatenate([v[:, :1], ways], axis=1),
                v + step * np.concatenate([push, pull], axis=1),
            )
        rows.append(y)
    return np.array(rows)


def test_euler_steps_violate_what_holds() -> None:
    inputs = random_inputs(60, 0)
    exact = runs(inputs)
    steps = _euler(inputs, PERIOD)
    assert np.abs(steps - exact)[..., 0].max() < 0.5  # car 1 is smooth
    violations = [sum(value < 0 for value in least("CC5", y)) for y in (exact, steps)]
    assert violations[0] <= 3
    assert violations[1] >= 50
    finer = _euler(inputs[:, :10], PERIOD / 5)
    assert np.abs(finer - exact[:, :10])[..., 1:].max() > 2.0


@pytest.mark.slow
def test_all_modes_give_the_same_numbers_without_numba() -> None:
    program = (
        "import numpy as np\n"
        "from rtamt_envs import chasing_cars as cars\n"
        "state, seen = np.zeros(cars.SCENARIO.state), np.empty(5)\n"
        "state[:5], state[5:10] = [0, 5.15, 15, 25, 41], [2.5, 0.5, 0, 1, 1]\n"
        "state[11:15], state[cars._HAS_ACTION] = cars._KEEPING, 1.0\n"
        "rest = np.zeros(2), cars.SCENARIO.defaults, np.zeros(0), state, seen\n"
        "for step in range(400):\n"
        "    if step == 300:\n"
        "        state[0], state[5] = state[1] - 19.9, -2.0\n"
        "    cars.SCENARIO.step(*rest)\n"
        "    print(*map(float.hex, seen.tolist()), *map(int, state[11:15]))\n"
    )
    compiled, interpreted = compiled_and_interpreted(program)
    modes = {mode for line in compiled.splitlines() for mode in line.split()[5:]}
    assert modes == {"0", "1", "2"}
    assert compiled == interpreted
