"""The loop of CleanRL reads what the wrappers give; the program is that of docs/learners.md."""

from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.vector import SyncVectorEnv
from programs import LIMIT, run, watched

from rtamt_gym import StlMonitor


def test_returns_successes_and_costs_of_the_loop_are_those_of_a_hand_count(tmp_path: Path) -> None:
    program, rides = run("CleanRL", tmp_path)
    ended = rides.ended(early=False)
    assert program["successes"] == [ride.success for ride in ended]
    assert program["episode_costs"] == [ride.outside for ride in ended]
    assert program["returns"] == [ride.steps for ride in ended]
    assert 0 < sum(program["successes"]) < len(ended)
    assert max(program["episode_costs"]) > 1


def test_the_last_info_under_the_default_reset_is_that_of_the_step() -> None:
    def make() -> gym.Env[Any, Any]:
        env = gym.make("CartPole-v1", max_episode_steps=LIMIT)
        env = StlMonitor(
            env,
            "always(abs(x) < 0.12)",
            {"x": "obs[0]"},
            at_termination="failure",
            on_violation="report",
            cost="violation",
        )
        return gym.wrappers.RecordEpisodeStatistics(env)

    with watched() as rides:
        envs = SyncVectorEnv([make] * 3)
        envs.reset(seed=2)
        envs.action_space.seed(2)
        successes, returns, cost = [], [], 0.0
        for _ in range(300):
            _, _, terminated, truncated, infos = envs.step(envs.action_space.sample())
            done = terminated | truncated
            cost += float(infos["cost"].sum())
            if done.any():
                successes += infos["is_success"][done].tolist()
                returns += infos["episode"]["r"][done].tolist()
        envs.close()
    ended = rides.ended(early=False)
    assert successes == [ride.success for ride in ended]
    assert returns == [ride.steps for ride in ended]
    assert cost == sum(ride.outside for ride in rides.started)
    assert 0 < sum(successes) < len(ended)
