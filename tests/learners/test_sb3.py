"""Stable-Baselines3's own functions read the wrappers; the program is from docs/learners.md."""

from __future__ import annotations

import csv
import json
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from programs import BOUND, LIMIT, Ride, cost_of, counts_of, run, score, shares_of, watched
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import SubprocVecEnv, VecEnv, VecNormalize
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from rtamt_gym import StlMonitor, StlReward
from rtamt_gym.learners.sb3 import SatisfactionCallback


def monitored(count: int, wrapper: type = StlMonitor, **arguments: Any) -> VecEnv:  # noqa: ANN401
    more = {key: arguments.pop(key) for key in ("vec_env_cls", "seed") if key in arguments}
    chosen = {
        "specs": "always(abs(x) < 0.12)",
        "signals": {"x": "obs[0]"},
        "at_termination": "failure",
        "cost": "violation",
    }
    return make_vec_env(
        "CartPole-v1",
        n_envs=count,
        env_kwargs={"max_episode_steps": LIMIT},
        wrapper_class=wrapper,
        wrapper_kwargs={**chosen, **arguments},
        **more,
    )


def learner(envs: VecEnv) -> Any:  # noqa: ANN401
    return PPO(
        "MlpPolicy", envs, n_steps=128, n_epochs=1, seed=1, device="cpu", stats_window_size=10_000
    )


def robustness_reward(ride: Ride) -> float:
    """Return the rewards of ``StlReward`` in an episode: after each step the minimum so far."""
    return sum(list(accumulate(ride.margins, min))[1:])


def test_what_the_program_of_the_page_evaluates_is_a_hand_count(tmp_path: Path) -> None:
    program, rides = run("Stable-Baselines3", tmp_path)
    trained = rides.ended(early=True, within=program["envs"])
    model, callback = program["model"], program["callback"]
    assert list(model.ep_success_buffer) == [ride.success for ride in trained][-100:]
    assert [log["l"] for log in model.ep_info_buffer] == [ride.steps for ride in trained][-100:]
    metrics = {**shares_of(trained[-100:]), **counts_of(trained), **cost_of(trained[-100:])}
    assert callback.training.metrics() == pytest.approx(metrics)
    own = {ride.env for ride in trained}
    # Evaluations read complete episodes: a violation does not end them.
    others = [ride for ride in rides.ended(early=False) if ride.env not in own]
    scores, last = [score(others[at : at + 20]) for at in (0, 20, 40, 60)], others[80:130]
    assert len(others) == 131  # one more for the worst episode, which is run again
    assert [steps for steps, _ in callback.evaluations] == [512, 1024, 1536, 2048]
    assert [found.success.satisfied for _, found in callback.evaluations] == [
        good for good, _ in scores
    ]
    said = json.loads((tmp_path / "runs" / "best.json").read_text(encoding="utf-8"))
    assert said["steps"] == 512 * (1 + scores.index(max(scores)))
    assert max(scores) > min(scores)
    assert program["found"].success.satisfied == sum(ride.success for ride in last) > 25
    assert program["found"].returns.tolist() == [ride.steps for ride in last]
    (events,) = (tmp_path / "runs").glob("PPO_1/events*")
    found = EventAccumulator(str(events)).Reload()
    rates = [event.value for event in found.Scalars("eval_stl/rate")]
    assert rates == pytest.approx([good / 20 for good, _ in scores])


def test_the_success_rate_that_is_logged_is_that_of_a_hand_count(tmp_path: Path) -> None:
    with watched() as rides:
        envs, test_env = monitored(2, seed=1), monitored(1, seed=2)
        model = learner(envs)
        model.set_logger(configure(str(tmp_path), ["csv"]))
        callback = EvalCallback(
            test_env, n_eval_episodes=40, eval_freq=128, deterministic=False, verbose=0
        )
        model.learn(256, callback=callback)
        model.logger.close()
    evaluated = rides.ended(early=True, within=test_env)
    with (tmp_path / "progress.csv").open(encoding="utf-8") as file:
        logged = [row["eval/success_rate"] for row in csv.DictReader(file)]
    (rate,) = filter(None, logged)
    assert float(rate) == sum(ride.success for ride in evaluated) / 40
    assert 0 < float(rate) < 1


@pytest.mark.parametrize("on_violation", ["terminate", "truncate", "report"])
@pytest.mark.parametrize("wrapper", [StlMonitor, StlReward])
def test_every_episode_is_counted_once_with_the_reward_of_the_learner(
    wrapper: type, on_violation: str
) -> None:
    arguments: dict[str, Any] = {"mode": "add"} if wrapper is StlReward else {}
    with watched() as rides:
        envs = monitored(3, wrapper, on_violation=on_violation, seed=1, **arguments)
        model = learner(envs)
        model.learn(1500)
        trained = rides.ended(early=on_violation != "report", within=envs)
        rewards, lengths = evaluate_policy(
            model, envs, n_eval_episodes=30, deterministic=False, return_episode_rewards=True
        )
    assert len(trained) > 80
    assert any(ride.outside for ride in trained)
    logs = list(model.ep_info_buffer)
    expected = [
        ride.steps + (robustness_reward(ride) if wrapper is StlReward else 0) for ride in trained
    ]
    assert [log["l"] for log in logs] == [ride.steps for ride in trained]
    assert [log["r"] for log in logs] == pytest.approx(expected, abs=2e-6)
    assert list(model.ep_success_buffer) == [ride.success for ride in trained]
    assert (len(rewards), len(lengths)) == (30, 30)


def test_processes_of_their_own_give_the_same_infos() -> None:
    envs = monitored(2, seed=1, vec_env_cls=SubprocVecEnv)
    observations: Any = envs.reset()
    rng = np.random.default_rng(1)
    margins = [[BOUND - abs(float(row[0]))] for row in observations]
    ends = 0
    while ends < 60:
        observations, rewards, dones, infos = envs.step(rng.integers(2, size=2))
        for index, (done, info) in enumerate(zip(dones, infos, strict=True)):
            row = info["terminal_observation"] if done else observations[index]
            margins[index].append(BOUND - abs(float(row[0])))
            assert info["robustness"] == min(margins[index])
            assert info["cost"] == float(margins[index][-1] <= 0)
            if done:
                # A step that ends in time with an upright pole inside.
                upright = abs(row[2]) <= 12 * np.pi / 180
                assert info["is_success"] == (upright and min(margins[index]) > 0)
                assert info["episode"]["l"] == len(margins[index]) - 1
                margins[index] = [BOUND - abs(float(observations[index][0]))]
                ends += 1
    assert rewards.shape == (2,)
    logged = [SatisfactionCallback(), SatisfactionCallback()]
    model = learner(envs).learn(256, callback=logged[0])
    assert len(evaluate_policy(model, envs, 4, return_episode_rewards=True)[0]) == 4
    envs.close()
    learner(monitored(2, seed=1)).learn(256, callback=logged[1])
    assert logged[0].training.metrics() == logged[1].training.metrics()
    assert logged[0].training.metrics()["spec/first_violation"] < 0.4  # seconds


def test_normalized_rewards_leave_the_logs_as_they_are() -> None:
    with watched() as rides:
        inner = monitored(2, seed=1)
        model = learner(VecNormalize(inner))
        model.learn(600)
    trained = rides.ended(early=True, within=inner)
    assert [log["r"] for log in model.ep_info_buffer] == [ride.steps for ride in trained]
    assert list(model.ep_success_buffer) == [ride.success for ride in trained]
    assert 0 < sum(model.ep_success_buffer) < len(trained)
