"""TorchRL reads the results of the wrappers; the program is an example."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from programs import BOUND, Ride, Rides, counts_of, play, run, score, shares_of, watched

from rtamt_gym import StlMonitor


@pytest.fixture(scope="module")
def program_and_rides(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[dict[str, Any], Rides, Path]:
    folder = tmp_path_factory.mktemp("torchrl")
    return *run("TorchRL", folder), folder


def trained(program: dict[str, Any], rides: Rides) -> tuple[list[Ride], list[Ride]]:
    """Return the episodes of the rollouts, and the episodes of the evaluations."""
    own = program["env"].unwrapped
    ended = rides.ended(early=False)
    inside = [ride for ride in ended if ride.env is own]
    return inside, [ride for ride in ended if ride.env is not own]


def test_the_tensors_of_a_rollout_are_those_of_a_hand_count(
    program_and_rides: tuple[dict[str, Any], Rides, Path],
) -> None:
    program, rides, _ = program_and_rides
    rollout = program["rollout"]
    done = rollout["done"].squeeze(-1).numpy()
    outside = abs(rollout["observation"][:, 0].double().numpy()) >= BOUND
    assert rollout["cost"].tolist() == outside.astype(float).tolist()
    ended = trained(program, rides)[0][-done.sum() :]
    assert rollout["stl_success"].numpy()[done].tolist() == [ride.success for ride in ended]
    assert rollout["robustness"].numpy()[done].tolist() == [min(ride.margins) for ride in ended]
    assert rollout["stl_violated"].numpy()[done].tolist() == [
        ride.fell or ride.outside > 0 for ride in ended
    ]
    assert not rollout["stl_success"].numpy()[~done].any()
    assert 0 < rollout["stl_success"].sum() < len(ended)


def test_the_metrics_of_training_are_those_of_a_hand_count(
    program_and_rides: tuple[dict[str, Any], Rides, Path],
) -> None:
    program, rides, _ = program_and_rides
    # The checks of the environment, before the rollouts, have ended no episode.
    ended, _ = trained(program, rides)
    metrics = {**shares_of(ended[-100:]), **counts_of(ended)}
    assert program["training"].metrics() == pytest.approx(metrics)
    assert len(ended) > 100


def test_the_weights_that_are_kept_are_those_that_satisfy_most(
    program_and_rides: tuple[dict[str, Any], Rides, Path],
) -> None:
    program, rides, folder = program_and_rides
    _, evaluated = trained(program, rides)
    rounds = [evaluated[at : at + 20] for at in range(0, len(evaluated), 20)]
    assert len(rounds) == 4
    scores = [score(found) for found in rounds]
    program["network"].load_state_dict(torch.load(folder / "best.pt"))
    with watched() as again:
        for seed in range(10_000, 10_020):
            play(program["make_env"](), seed, program["act"])
    assert score(again.started) == max(scores) > min(scores)


def test_its_own_reader_takes_the_floats_as_they_are() -> None:
    from torchrl.envs import GymWrapper, default_info_dict_reader

    monitored: gym.Env[Any, Any] = StlMonitor(
        gym.make("CartPole-v1"), "always(abs(x) < 2)", {"x": "obs[0]"}, cost="violation"
    )
    env = GymWrapper(monitored)
    env.set_info_dict_reader(default_info_dict_reader(["robustness", "stl_upper", "cost"]))
    env.set_seed(1)
    rollout = env.rollout(5)["next"]
    positions = rollout["observation"][:, 0].double().numpy()
    first = abs(float(env.reset(seed=1)["observation"][0]))
    assert rollout["cost"].tolist() == [0.0] * 5
    least = np.minimum.accumulate([2 - first, *(2 - abs(positions))])[1:]
    assert rollout["robustness"].dtype == torch.float64
    assert rollout["stl_upper"].tolist() == pytest.approx(least)


def test_its_own_reader_still_takes_no_bool() -> None:
    from torchrl.envs import GymWrapper, default_info_dict_reader

    monitored: gym.Env[Any, Any] = StlMonitor(
        gym.make("CartPole-v1"), "always(abs(x) < 2)", {"x": "obs[0]"}
    )
    env = GymWrapper(monitored)
    env.set_info_dict_reader(default_info_dict_reader(["stl_violated"]))
    with pytest.raises(AttributeError, match="'bool' object has no attribute 'dtype'"):
        env.reset()
