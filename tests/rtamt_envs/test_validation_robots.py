"""The robots against the integral of their velocity and SciPy's solver; requests against NumPy."""

import itertools
import math

import numpy as np
import pytest
from models import requirements, unicycle
from models.judged import evaluated, observed
from numpy.typing import NDArray
from rtamt_envs import scenario_of
from rtamt_envs.mobile_robot import OBSTACLES
from scipy.integrate import solve_ivp

pytestmark = pytest.mark.slow

Floats = NDArray[np.float64]


def commands(name: str, entries: int, pieces: int, each: int, seed: int = 0) -> Floats:
    """Random commands in their bounds, held for some samples: (environments, steps, actions)."""
    low, high = np.transpose([(a.low, a.high) for a in scenario_of(name).actions])
    drawn = np.random.default_rng(seed).uniform(low, high, (entries, pieces, len(low)))
    return drawn.repeat(each, axis=1)


def room(x: float, y: float) -> float:
    """Return metres between the robot at (x, y) and the nearest obstacle."""
    near = [x, 10 - x, y, 7 - y]
    near += [math.dist((x, y), np.clip((x, y), box[:2], box[2:])) for box in OBSTACLES]
    return min(near) - 0.2


def test_the_mobile_robot_drives_the_integral_of_its_twist_and_stops_at_walls() -> None:
    actions = commands("MobileRobot", 4, 15, 20)
    stopped = 0
    for rows in observed("MobileRobot", actions, noise=0.2, lag=0.3):
        for before, after in itertools.pairwise(rows):
            x, y, heading = unicycle.move(tuple(before[:3]), after[3], after[4], 0.1)
            expected = np.array([x, y, math.remainder(heading, 2 * math.pi)])
            if abs(room(x, y)) < 1e-9:
                continue  # rounding decides
            if room(x, y) <= 0:
                expected, stopped = before[:3], stopped + 1
            np.testing.assert_allclose(after[:3], expected, rtol=0, atol=1e-12)
            np.testing.assert_allclose(after[7], room(after[0], after[1]), rtol=0, atol=1e-12)
    assert stopped > 20


def test_the_mobile_robot_follows_its_commands_with_a_first_order_lag() -> None:
    actions = commands("MobileRobot", 1, 6, 10, seed=1)
    rows = observed("MobileRobot", actions, noise=0.0, lag=0.7)[0]
    twist = np.zeros(2)
    for k, command in enumerate(actions[0]):
        twist = solve_ivp(
            lambda _, v, c=command: (c - v) / 0.7, (0, 0.1), twist, rtol=1e-11, atol=1e-12
        ).y[:, -1]
        np.testing.assert_allclose(rows[k + 1, 3:5], twist, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(rows[k + 1, 5:7], command)


def test_the_service_robots_solve_their_equation_and_stop_at_walls() -> None:
    actions = commands("TwoServiceRobots", 3, 12, 25, seed=2)
    stopped = 0
    for case, rows in zip(
        actions, observed("TwoServiceRobots", actions, noise=0.0, lag=0.4), strict=True
    ):
        place, velocity = rows[0, :4], np.zeros(4)
        for k, command in enumerate(case):
            run = solve_ivp(
                lambda _, y, c=command: np.concatenate([y[4:], (c - y[4:]) / 0.4]),
                (0, 0.1),
                np.concatenate([place, velocity]),
                rtol=1e-11,
                atol=1e-12,
            ).y[:, -1]
            place = np.clip(run[:4], 0.3, np.tile([8 - 0.3, 6 - 0.3], 2))
            out = place != run[:4]
            velocity = np.where(out, 0, run[4:])
            stopped += int(out.sum())
            np.testing.assert_allclose(rows[k + 1, :4], place, rtol=0, atol=1e-7)
    assert stopped > 20


def _near(x: Floats, y: Floats, place: tuple[float, float]) -> Floats:
    return 0.3 - np.hypot(x - place[0], y - place[1])


def _first_then(first: Floats, then: Floats) -> float:
    return float(
        requirements.eventually(np.minimum(first, requirements.eventually(then, 0, 300)), 0, 300)[0]
    )


def test_robustness_of_the_robots_is_that_of_numpy() -> None:
    for rows in observed("MobileRobot", commands("MobileRobot", 6, 30, 20, seed=3)):
        x, y = rows[:, 0], rows[:, 1]
        found = evaluated("MobileRobot", rows)
        assert found["follows"] == np.min(0.5 - np.abs(rows[:, 5] - rows[:, 3]))
        assert found["clear"] == np.min(rows[:, 7] - 0.1)
        visits = _first_then(_near(x, y, (8.8, 5.6)), _near(x, y, (6.2, 1.0)))
        np.testing.assert_allclose(found["visits"], visits, rtol=0, atol=1e-12)
    for rows in observed("TwoServiceRobots", commands("TwoServiceRobots", 6, 30, 20, seed=4)):
        x1, y1, x2, y2 = rows[:, :4].T
        found = evaluated("TwoServiceRobots", rows)
        expected = {
            "apart": float(np.min(np.hypot(x1 - x2, y1 - y2) - 0.8)),
            "serves1": _first_then(_near(x1, y1, (7, 5)), _near(x1, y1, (1, 1))),
            "serves2": _first_then(_near(x2, y2, (7, 1)), _near(x2, y2, (1, 5))),
        }
        assert set(found) == set(expected)
        for name, value in expected.items():
            np.testing.assert_allclose(found[name], value, rtol=0, atol=1e-12)


def test_the_four_signals_have_the_robustness_of_the_paper() -> None:
    for options, value in (
        ({}, 3),
        ({"height": 2}, 1),
        ({"limit": 1}, -2),
        ({"height": 4, "limit": 1}, -1),
    ):
        request = np.zeros((1, 150, 1))
        request[0, 19:39] = options.get("height", 6)
        rows = observed("RequestGrant", request, **options)[0]
        req, gnt = rows.T
        granted = np.concatenate([np.zeros(40), np.minimum(req, options.get("limit", 8))[:-40]])
        np.testing.assert_array_equal(gnt, granted)
        answered = requirements.eventually(gnt - 3, 0, 50)
        expected = float(np.min(requirements.implies(req - 3, answered)[:101]))
        assert evaluated("RequestGrant", rows) == {"granted": expected}
        assert expected == value
