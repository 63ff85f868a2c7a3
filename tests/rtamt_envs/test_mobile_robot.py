"""The mobile robot against complex exponentials, scans of its map, and closed solutions."""

import cmath
import math
import subprocess
import sys
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rtamt_envs.mobile_robot import (
    HEIGHT,
    OBSTACLES,
    RADIUS,
    ROUTE,
    SCENARIO,
    WIDTH,
    clearance,
    drive,
    next_point,
    unicycle,
)
from scenario_courses import course, made, random_actions

from rtamt_gym import simulate

X, Y, HEADING, V, W, CMD_V, CMD_W, CLEARANCE = range(8)
QUIET = {"noise": 0.0}

speeds = st.floats(-1, 1)
turns = st.floats(-2, 2) | st.floats(-1e-3, 1e-3)
angles = st.floats(-math.pi, math.pi, exclude_min=True)


def on_the_circle(x: float, y: float, heading: float, v: float, w: float, t: float) -> complex:
    """Return the position after a constant twist, by the integral of exp(i (heading + w t))."""
    if abs(w) < 1e-6:
        return complex(x, y) + v * t * cmath.exp(1j * (heading + w * t / 2))
    return complex(x, y) + v * (cmath.exp(1j * (heading + w * t)) - cmath.exp(1j * heading)) / (
        1j * w
    )


@given(speeds, speeds, angles, speeds, turns, st.floats(0.01, 1))
def test_a_constant_twist_is_an_arc_of_a_circle(
    x: float, y: float, heading: float, v: float, w: float, t: float
) -> None:
    place = on_the_circle(x, y, heading, v, w, t)
    *found, turned = unicycle(x, y, heading, v, w, t)
    assert complex(*found) == pytest.approx(place, abs=1e-9)
    assert -math.pi <= turned <= math.pi
    assert cmath.exp(1j * turned) == pytest.approx(cmath.exp(1j * (heading + w * t)), abs=1e-12)


@given(angles, speeds, turns)
def test_two_halves_of_a_step_are_one(heading: float, v: float, w: float) -> None:
    half = unicycle(*unicycle(1.0, 2.0, heading, v, w, 0.05), v, w, 0.05)
    assert half[:2] == pytest.approx(unicycle(1.0, 2.0, heading, v, w, 0.1)[:2], abs=1e-14)


def test_clearance_is_the_distance_to_the_nearest_point_of_a_wall() -> None:
    lines = [
        (0, 0, WIDTH, 0),
        (0, HEIGHT, WIDTH, HEIGHT),
        (0, 0, 0, HEIGHT),
        (WIDTH, 0, WIDTH, HEIGHT),
    ]
    for left, low, right, high in OBSTACLES:
        lines += [(left, low, right, low), (left, high, right, high)]
        lines += [(left, low, left, high), (right, low, right, high)]
    share = np.linspace(0, 1, 7001)[:, None]
    points = np.concatenate([(1 - share) * line[:2] + share * line[2:] for line in np.array(lines)])
    rng = np.random.default_rng(0)
    free = 0
    for x, y in rng.uniform([0, 0], [WIDTH, HEIGHT], (200, 2)):
        scanned = np.hypot(points[:, 0] - x, points[:, 1] - y).min() - RADIUS
        inside = ((OBSTACLES[:, :2] < (x, y)) & ((x, y) < OBSTACLES[:, 2:])).all(axis=1).any()
        assert clearance(x, y) == pytest.approx(-RADIUS if inside else scanned, abs=1e-3)
        free += not inside
    assert 100 < free < 200


def test_without_lag_and_noise_the_twist_is_the_command() -> None:
    actions = random_actions(SCENARIO, (100,), 0) * [0.2, 1.0]
    seen = course(made("MobileRobot", parameters=QUIET), actions)
    np.testing.assert_array_equal(seen[1:, [CMD_V, CMD_W]], actions)
    np.testing.assert_array_equal(seen[1:, [V, W]], actions)
    np.testing.assert_array_equal(seen[0, [V, W, CMD_V, CMD_W]], 0.0)
    pose = complex(1.2, 1.2), 0.0
    for row, (v, w) in zip(seen[1:], actions, strict=True):
        place, heading = pose
        pose = on_the_circle(place.real, place.imag, heading, v, w, 0.1), heading + 0.1 * w
        assert complex(row[X], row[Y]) == pytest.approx(pose[0], abs=1e-12)


@pytest.mark.parametrize("lag", [0.05, 0.3, 2.0])
def test_a_step_of_the_command_is_followed_as_a_first_order_system_does(lag: float) -> None:
    env = made("MobileRobot", parameters={"lag": lag, **QUIET})
    seen = course(env, np.tile([0.5, -1.0], (40, 1)))
    rise = 1 - np.exp(-np.arange(41) / 10 / lag)
    np.testing.assert_allclose(seen[:, V], 0.5 * rise, rtol=1e-12)
    np.testing.assert_allclose(seen[:, W], -rise, rtol=1e-12)


def test_noise_grows_with_the_twist() -> None:
    env = made("MobileRobot", parameters={"noise": 0.2})
    turning = course(env, np.tile([0.0, 1.5], (4000, 1)))
    np.testing.assert_array_equal(turning[:, V], 0.0)
    assert (turning[1:, W] / 1.5).mean() == pytest.approx(1.0, abs=0.01)
    assert (turning[1:, W] / 1.5).std() == pytest.approx(0.2, rel=0.05)
    np.testing.assert_array_equal(turning[:, [X, Y]], 1.2)
    circles = course(env, np.tile([0.5, 1.5], (4000, 1)))[1:, [V, W]]
    assert (circles[:, 0] / 0.5).std() == pytest.approx(0.2, rel=0.05)
    assert abs(np.cov(circles.T / [[0.1], [0.3]])[0, 1]) < 0.05


def test_a_wall_keeps_the_pose_and_not_the_twist() -> None:
    ahead, back = np.tile([1.0, 0.05], (60, 1)), np.tile([-1.0, 0.0], (5, 1))
    seen = course(made("MobileRobot", parameters=QUIET), np.concatenate([ahead, back]))
    stuck = next(i for i in range(60) if (seen[i, :3] == seen[i + 1, :3]).all())
    assert 10 < stuck < 50
    assert 0 < seen[stuck, CLEARANCE] < 0.1
    np.testing.assert_array_equal(seen[stuck:61, :3], np.tile(seen[stuck, :3], (61 - stuck, 1)))
    np.testing.assert_array_equal(seen[stuck:61, [V, W]], [[1.0, 0.05]] * (61 - stuck))
    assert np.hypot(*(seen[-1] - seen[stuck])[:2]) == pytest.approx(0.5)


def test_the_robot_never_touches_a_wall() -> None:
    for seed in range(10):
        env = made("MobileRobot", parameters={"noise": 0.5, "lag": 0.2})
        seen = course(env, random_actions(SCENARIO, (60,), seed).repeat(10, axis=0), seed)
        assert seen[:, CLEARANCE].min() > 0
        assert seen[:, CLEARANCE].min() < 0.1  # it would


def judged(parameters: dict[str, float], seed: int = 0) -> dict[str, float]:
    """Return the robustness of each requirement under the baseline."""
    env = gym.make("rtamt/MobileRobot-v0", parameters=parameters)
    inner: Any = env.unwrapped
    run = simulate(env, inner.requirements, policy=inner.baseline, seed=seed, stop="end")
    return {name: float(each.robustness[-1]) for name, each in run.histories.items()}


def test_the_baseline_meets_all_requirements_wherever_it_begins() -> None:
    places, headings = (0.6, 2.4), (-3.1, 0.0, 1.5)
    for seed, (x, y, heading) in enumerate(product(places, places, headings)):
        start = {"start_x": x, "start_y": y, "start_heading": heading}
        assert min(judged(start, seed).values()) > 0, start


def test_a_robot_that_lags_breaks_what_follows_demands_before_it_hits_anything() -> None:
    slow, slower = judged({"lag": 0.8}), judged({"lag": 2.0})
    assert slow["follows"] < 0 < min(slow["clear"], slow["visits"])
    assert slower["follows"] < slow["follows"]
    assert slower["clear"] < slow["clear"]


def test_the_model_runs_on_plain_arrays() -> None:
    given_, noise = SCENARIO.defaults, np.zeros((31, 2))
    state, seen = np.zeros(SCENARIO.state), np.zeros(len(SCENARIO.observations))
    SCENARIO.start(given_, noise[0], state, seen)
    for row in noise[1:]:
        SCENARIO.step(np.array([0.5, 0.2]), given_, row, state, seen)
    env = made("MobileRobot", parameters=QUIET)
    np.testing.assert_array_equal(seen, course(env, np.tile([0.5, 0.2], (30, 1)))[-1])


def test_the_model_is_there_without_gymnasium() -> None:
    code = "import sys; sys.modules['gymnasium'] = None\n"
    code += "from rtamt_envs import scenario_of; print(scenario_of('MobileRobot').id)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "rtamt/MobileRobot-v0\n"


def test_whoever_drives_to_the_next_point_drives_as_the_baseline() -> None:
    env = made("MobileRobot", parameters=QUIET)
    inner: Any = env.unwrapped
    seen, _ = env.reset(seed=0)
    point = 0
    for _ in range(400):
        point = next_point(seen[0], seen[1], point)
        command = drive(*seen[:3], *ROUTE[point])
        np.testing.assert_array_equal(command, inner.baseline(seen))
        seen, *_ = env.step(np.array(command))
    assert point == len(ROUTE) - 1
