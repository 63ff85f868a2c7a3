"""Stable-Baselines3 accepts the results of the wrappers."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES, Env

from rtamt import InputError
from rtamt_gym import StlMonitor, StlReward
from rtamt_gym.judging.end_warnings import UnseenEndWarning
from rtamt_gym.systems.policies import policy_of

KEYS = ("robustness", "stl_lower", "stl_upper", "stl_violated", "cost", "reward")
"""The keys of every last info."""


def shaped(**arguments: Any) -> Env:  # noqa: ANN401
    return StlReward(
        gym.make("CartPole-v1", max_episode_steps=60),
        {"upright": "always(abs(theta) < 0.2)", "near": "eventually[0:0.4](abs(x) < 1)"},
        {"theta": "obs[2]", "x": "obs[0]"},
        cost="first",
        **{"mode": "potential", "observe": "state", **arguments},
    )


# The checker requires that compute_reward returns the reward of a goal environment, without its
# past.
STEPWISE = [case for case in CASES if "parking" not in case.env_id]


@pytest.mark.parametrize("case", STEPWISE, ids=lambda case: case.env_id.split(":")[-1])
@pytest.mark.filterwarnings("ignore::UserWarning")  # advice about environments of others
def test_its_checker_finds_no_fault(case: Any) -> None:  # noqa: ANN401
    from stable_baselines3.common.env_checker import check_env

    env = StlReward(case.bare(), case.specs, case.signals, mode="add")
    check_env(env, skip_render_check=True)
    if len(env.observation_space.shape or ()) < 2:
        env = StlReward(case.bare(), case.specs, case.signals, mode="add", observe="state")
        check_env(env, skip_render_check=True)


def test_its_monitor_writes_the_flat_keys_of_every_episode(tmp_path: Path) -> None:
    from stable_baselines3.common.monitor import Monitor

    path = tmp_path / "run.monitor.csv"
    env = Monitor(shaped(on_violation="report"), str(path), info_keywords=KEYS)
    lasts = []
    for seed in range(3):
        env.reset(seed=seed)
        env.action_space.seed(seed)
        ended = False
        while not ended:
            _, _, terminated, truncated, info = env.step(env.action_space.sample())
            ended = terminated or truncated
        assert {key: info["episode"][key] for key in KEYS} == {key: info[key] for key in KEYS}
        lasts.append(info)
    env.close()
    with path.open(encoding="utf-8") as file:
        file.readline()
        rows = list(csv.DictReader(file))
    for row, info in zip(rows, lasts, strict=True):
        assert float(row["robustness"]) == info["robustness"]
        assert row["stl_violated"] == str(info["stl_violated"])
        assert float(row["cost"]) == info["cost"]


@pytest.mark.parametrize("kind", ["box", "dictionary"])
def test_a_learner_trains_on_the_state_of_the_monitor_and_counts_successes(kind: str) -> None:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    def make() -> Env:
        if kind == "box":
            return shaped(mode="terminal")
        env = gym.make("highway_env:parking-v0", config={"duration": 10})
        return StlReward(
            env,
            "eventually[0:2](abs(x - goal_x) < 0.5)",
            {"x": "obs['achieved_goal'][0]", "goal_x": "obs['desired_goal'][0]"},
            mode="add",
            observe="state",
            on_violation="truncate",
            cost="latched",
        )

    from stable_baselines3.common.monitor import Monitor

    envs = DummyVecEnv([lambda: Monitor(make(), info_keywords=KEYS) for _ in range(2)])
    policy = "MlpPolicy" if kind == "box" else "MultiInputPolicy"
    learner = PPO(policy, envs, n_steps=64, batch_size=32, n_epochs=1, seed=1, device="cpu")
    learner.learn(256)
    assert set(KEYS) <= learner.ep_info_buffer[-1].keys()
    # Certain successes and failures, divided by all complete episodes.
    assert set(learner.ep_success_buffer) <= {True, False}
    assert len(learner.ep_success_buffer) > 0
    envs.close()


def test_a_truncation_by_the_monitor_is_a_time_limit_to_a_learner() -> None:
    from stable_baselines3.common.vec_env import DummyVecEnv

    envs = DummyVecEnv(
        [
            lambda: StlMonitor(
                gym.make("CartPole-v1"),
                "always(abs(theta) < 0.1)",
                {"theta": "obs[2]"},
                on_violation="truncate",
            )
        ]
    )
    envs.seed(3)
    envs.reset()
    done = False
    while not done:
        _, _, dones, infos = envs.step(np.array([1]))
        done = bool(dones[0])
    assert infos[0]["TimeLimit.truncated"] is True
    assert infos[0]["stl_violated_by"] == "spec"
    assert abs(infos[0]["terminal_observation"][2]) >= 0.1
    envs.close()


@pytest.mark.parametrize("name", ["A2C", "PPO", "DQN", "SAC", "TD3", "DDPG"])
def test_a_saved_model_acts_on_the_command_line_as_it_predicts(name: str, tmp_path: Path) -> None:
    import stable_baselines3

    env = gym.make("Pendulum-v1" if name in {"SAC", "TD3", "DDPG"} else "CartPole-v1")
    replay = {"buffer_size": 50} if name in {"DQN", "SAC", "TD3", "DDPG"} else {}
    model = getattr(stable_baselines3, name)("MlpPolicy", env, seed=3, device="cpu", **replay)
    model.save(tmp_path / "best")
    act = policy_of(f"sb3:{tmp_path / 'best.zip'}", env)(0)
    env.observation_space.seed(5)
    for _ in range(20):
        obs = np.clip(env.observation_space.sample(), -5, 5)
        assert np.array_equal(act(obs), model.predict(obs, deterministic=True)[0])


def test_a_saved_model_that_learned_from_goals_needs_no_memory_to_act(tmp_path: Path) -> None:
    from stable_baselines3 import SAC, HerReplayBuffer

    env = gym.make("highway_env:parking-v0")
    model = SAC(
        "MultiInputPolicy",
        env,
        buffer_size=50,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 2},
        seed=1,
        device="cpu",
    )
    model.save(tmp_path / "goals")
    obs, _ = env.reset(seed=1)
    assert env.action_space.contains(policy_of(f"sb3:{tmp_path / 'goals'}", env)(0)(obs))


def limited(*, outside: bool) -> Any:  # noqa: ANN401
    """Return a monitored pole with a time limit, in the `Monitor` of Stable-Baselines3."""
    from stable_baselines3.common.monitor import Monitor

    pole = gym.make("CartPole-v1").unwrapped
    inner = pole if outside else gym.wrappers.TimeLimit(pole, 9)
    env: Any = StlMonitor(inner, "always(abs(x) < limit)", {"x": "obs[0]"}, constants={"limit": 1})
    return Monitor(gym.wrappers.TimeLimit(env, 9) if outside else env)


@pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.OpenEndWarning")
def test_successes_of_unseen_ends_are_missing_and_the_monitor_warns() -> None:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    def counts(*, outside: bool) -> tuple[int, int]:
        model = PPO(
            "MlpPolicy", DummyVecEnv([lambda: limited(outside=outside)]), n_steps=64, seed=1
        )
        model.learn(64)
        return len(model.ep_info_buffer or ()), len(model.ep_success_buffer or ())

    episodes, successes = counts(outside=False)
    assert episodes == successes == 7  # of 9 steps: no pole falls within them
    with pytest.warns(UnseenEndWarning) as told:
        episodes, successes = counts(outside=True)
    assert (episodes, successes, len(told)) == (7, 0, 1)


@pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.UnseenEndWarning")
def test_constants_change_by_the_calls_of_the_page() -> None:
    from stable_baselines3.common.vec_env import DummyVecEnv

    envs = DummyVecEnv([lambda: limited(outside=True)] * 2)
    envs.env_method("set_wrapper_attr", "constants", {"limit": 0.5}, indices=[1])
    assert envs.get_attr("constants") == [{"limit": 1.0}, {"limit": 0.5}]
    envs.reset()
    margins = [info["robustness"] for info in envs.reset_infos]
    assert 0.9 < margins[0] <= 1.0
    assert 0.4 < margins[1] <= 0.5
    envs.set_options({"constants": {"limit": 2.0}})
    envs.reset()
    assert envs.get_attr("constants") == [{"limit": 2.0}] * 2
    envs.set_attr("constants", {"limit": 0.2})
    with pytest.raises(InputError, match="which changes no specification"):
        envs.reset()
