"""TorchRL reads what the wrappers give; the program is that of docs/learners.md."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from programs import BOUND, run

from rtamt_gym import StlMonitor


def test_the_tensors_of_a_rollout_are_those_of_a_hand_count(tmp_path: Path) -> None:
    program, rides = run("TorchRL", tmp_path)
    rollout = program["rollout"]
    done = rollout["done"].squeeze(-1).numpy()
    outside = abs(rollout["observation"][:, 0].double().numpy()) >= BOUND
    assert rollout["cost"].tolist() == outside.astype(float).tolist()
    # The checks of the environment, before the rollout, have ended no episode.
    ended = rides.ended(early=False)
    assert rollout["stl_success"].numpy()[done].tolist() == [ride.success for ride in ended]
    assert rollout["robustness"].numpy()[done].tolist() == [min(ride.margins) for ride in ended]
    assert rollout["stl_violated"].numpy()[done].tolist() == [
        ride.fell or ride.outside > 0 for ride in ended
    ]
    assert not rollout["stl_success"].numpy()[~done].any()
    assert 0 < rollout["stl_success"].sum() < len(ended)


def test_its_own_reader_takes_the_floats_as_they_are() -> None:
    import torch
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
