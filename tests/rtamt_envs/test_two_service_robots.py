"""Two service robots: closed solutions, the baseline, and the two as agents."""

from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray
from rtamt_envs.two_service_robots import HEIGHT, RADIUS, STATIONS, WIDTH, parallel_env
from scenario_courses import course, made

import rtamt
from rtamt_gym import ParallelStlMonitor, StlMonitor, simulate

QUIET = {"noise": 0.0}
AGENTS = ["robot_1", "robot_2"]


@pytest.mark.parametrize("lag", [0.0, 0.05, 0.4, 1.0])
def test_velocities_follow_their_commands_as_first_order_systems_do(lag: float) -> None:
    command = np.array([0.4, 0.1, 0.3, -0.2])
    seen = course(
        made("TwoServiceRobots", parameters={"lag": lag, **QUIET}), np.tile(command, (50, 1))
    )
    times = np.arange(51)[:, None] / 10
    late = lag * (1 - np.exp(-times / lag)) if lag else 0.0
    np.testing.assert_allclose(seen[:, :4], [1, 1, 1, 5] + command * (times - late), rtol=1e-12)


def test_walls_stop_a_robot_and_the_other_robot_does_not() -> None:
    env = made("TwoServiceRobots", parameters={"lag": 0.4, **QUIET})
    towards, away = [-1.0, 1.0, -1.0, 1.0], np.array([0.5, -0.4, 0.3, -0.2])
    seen = course(env, np.repeat([towards, away], [100, 40], axis=0))
    corner = np.array([RADIUS, HEIGHT - RADIUS] * 2)
    np.testing.assert_array_equal(seen[100, :4], corner)
    times = np.arange(41)[:, None] / 10  # from rest, as at the start
    late = 0.4 * (1 - np.exp(-times / 0.4))
    np.testing.assert_allclose(seen[100:, :4], corner + away * (times - late), rtol=1e-12)
    towards, away = [1.0, -1.0, 1.0, -1.0], -away
    seen = course(env, np.repeat([towards, away], [100, 40], axis=0))
    corner = np.array([WIDTH - RADIUS, RADIUS] * 2)
    np.testing.assert_allclose(seen[100:, :4], corner + away * (times - late), rtol=1e-12)


def test_a_station_is_served_within_20_cm_and_then_the_other_is_next() -> None:
    env = made("TwoServiceRobots")
    seen = [env.reset(seed=0)[0]]
    seen += [env.step(env.baseline())[0] for _ in range(600)]
    for robot in range(2):
        served = 0
        for before, after in pairwise(seen):
            place = after[2 * robot : 2 * robot + 2]
            goal, following = (each[4 + 2 * robot : 6 + 2 * robot] for each in (before, after))
            near = np.hypot(*(goal - place)) <= 0.2
            pair = STATIONS[2 * robot : 2 * robot + 2]
            expected = pair[(pair != goal).any(axis=1)][0] if near else goal
            np.testing.assert_array_equal(following, expected)
            served += near
        assert served >= 4


def judged(parameters: dict[str, float], seed: int = 0) -> dict[str, float]:
    """Return the robustness of each requirement under the baseline."""
    env = gym.make("rtamt/TwoServiceRobots-v0", parameters=parameters)
    inner: Any = env.unwrapped
    run = simulate(env, inner.requirements, policy=inner.baseline, seed=seed, stop="end")
    return {name: float(each.robustness[-1]) for name, each in run.histories.items()}


def test_the_baseline_keeps_apart_and_serves_all_stations() -> None:
    for seed in range(6):
        assert min(judged({"noise": 0.05}, seed).values()) > 0


@pytest.mark.parametrize("setting", [{"caution": 0.0}, {"caution": 1.0}, {"lag": 1.0}])
def test_robots_that_give_way_too_late_come_too_close_and_serve_all_the_same(
    setting: dict[str, float],
) -> None:
    found = judged(setting)
    assert found["apart"] < 0 < min(found["serves1"], found["serves2"])


def split(joint: NDArray[np.float64]) -> dict[str, list[float]]:
    x1, y1, x2, y2, next_x1, next_y1, next_x2, next_y2 = joint.tolist()
    return {
        "robot_1": [x1, y1, next_x1, next_y1, x2, y2],
        "robot_2": [x2, y2, next_x2, next_y2, x1, y1],
    }


def test_agents_see_and_do_what_the_joint_environment_does() -> None:
    noisy = {"noise": 0.1}
    agents = parallel_env(parameters=noisy)
    joint = gym.make("rtamt/TwoServiceRobots-v0", parameters=noisy)
    rng = np.random.default_rng(0)
    assert agents.possible_agents == AGENTS
    for options in ({}, {"lag": 0.7}):
        given = {"parameters": options} if options else None
        seen, _ = agents.reset(seed=5, options=given)
        expected, _ = joint.reset(seed=5, options=options)
        assert {agent: row.tolist() for agent, row in seen.items()} == split(expected)
        truncated = False
        while not truncated:
            assert agents.agents == AGENTS
            action = rng.uniform(-1, 1, 4)
            seen, rewards, ended, cut, _ = agents.step(
                {"robot_2": action[2:], "robot_1": action[:2]}
            )
            expected, _, terminated, truncated, _ = joint.step(action)
            assert {agent: row.tolist() for agent, row in seen.items()} == split(expected)
            np.testing.assert_array_equal(agents.state(), expected)
            assert rewards == dict.fromkeys(AGENTS, 0.0)
            assert ended == dict.fromkeys(AGENTS, terminated)
            assert cut == dict.fromkeys(AGENTS, truncated)
            for agent, row in seen.items():
                assert agents.observation_space(agent).contains(row)
        assert agents.agents == []


@pytest.mark.parametrize("seed", range(4))
def test_agents_are_judged_together_as_the_joint_environment_is(seed: int) -> None:
    agents = parallel_env()
    monitored = ParallelStlMonitor(agents, agents.requirements)
    joint = gym.make("rtamt/TwoServiceRobots-v0")
    single = StlMonitor(joint, agents.requirements)
    infos, info = monitored.reset(seed=seed)[1], single.reset(seed=seed)[1]
    rng = np.random.default_rng(seed)
    pull = rng.uniform(-1, 1, 4)
    while "is_success" not in info:
        for each in infos.values():
            assert each["robustness"] == info["robustness"]
            assert each["stl_upper"] == info["stl_upper"]
        action = np.clip(pull + rng.uniform(-1, 1, 4), -1, 1)
        infos = monitored.step({"robot_1": action[:2], "robot_2": action[2:]})[4]
        info = single.step(action)[4]
    assert all(each["stl_episode"] == info["stl_episode"] for each in infos.values())
    assert monitored.agents == []


def test_agents_are_drawn_and_closed_as_the_joint_environment_is() -> None:
    agents = parallel_env(render_mode="rgb_array")
    joint = gym.make("rtamt/TwoServiceRobots-v0", render_mode="rgb_array")
    agents.reset(seed=5)
    joint.reset(seed=5)
    np.testing.assert_array_equal(agents.render(), joint.render())
    agents.close()


def test_wrong_calls_say_what_is_expected() -> None:
    env = parallel_env()
    still = dict.fromkeys(AGENTS, np.zeros(2))
    with pytest.raises(rtamt.StateError, match=r"^no episode runs; call reset\(\) first$"):
        env.step(still)
    env.reset(seed=0)
    with pytest.raises(
        rtamt.InputError,
        match=r"^expected an action of robot_1 and robot_2, got actions of robot_1, robot_3$",
    ):
        env.step({"robot_1": np.zeros(2), "robot_3": np.zeros(2)})
    with pytest.raises(rtamt.InputError, match="has no parameter 'leg'"):
        env.reset(options={"parameters": {"leg": 1.0}})
    with pytest.raises(
        rtamt.InputError,
        match=r"^'lag' is a parameter; write options={'parameters': {'lag': 0.5}}$",
    ):
        env.reset(options={"lag": 0.5})
    first = env.step(still)[0]
    env.reset(seed=0)
    again = env.step(still)[0]
    np.testing.assert_array_equal(first["robot_1"], again["robot_1"])
