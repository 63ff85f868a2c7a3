"""The loop of CleanRL reads the results of the wrappers; the program is an example."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
import torch
from gymnasium.vector import SyncVectorEnv
from programs import LIMIT, Rides, counts_of, play, run, score, shares_of, watched

from rtamt_gym import StlMonitor


@pytest.fixture(scope="module")
def program_and_rides(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[dict[str, Any], Rides, Path]:
    folder = tmp_path_factory.mktemp("cleanrl")
    return *run("CleanRL", folder), folder


def test_returns_successes_and_costs_of_the_loop_are_those_of_a_hand_count(
    program_and_rides: tuple[dict[str, Any], Rides, Path],
) -> None:
    program, rides, _ = program_and_rides
    ended = rides.ended(early=False, within=program["envs"])
    assert program["successes"] == [ride.success for ride in ended]
    assert program["episode_costs"] == [ride.outside for ride in ended]
    assert program["returns"] == [ride.steps for ride in ended]
    assert 0 < sum(program["successes"]) < len(ended)
    assert max(program["episode_costs"]) > 1
    metrics = {**shares_of(ended[-100:]), **counts_of(ended)}
    assert program["training"].metrics() == pytest.approx(metrics)


def test_the_weights_that_are_kept_are_those_that_satisfy_most(
    program_and_rides: tuple[dict[str, Any], Rides, Path],
) -> None:
    program, rides, folder = program_and_rides
    own = {ride.env for ride in rides.ended(early=False, within=program["envs"])}
    evaluated = [ride for ride in rides.ended(early=False) if ride.env not in own]
    rounds = [evaluated[at : at + 20] for at in range(0, len(evaluated), 20)]
    assert len(rounds) == program["iterations"]
    scores = [score(found) for found in rounds]
    program["actor"].load_state_dict(torch.load(folder / "best.pt"))
    with watched() as again:
        for seed in range(10_000, 10_020):
            play(program["make_env"](), seed, program["act"])
    assert score(again.started) == max(scores) > min(scores)


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
