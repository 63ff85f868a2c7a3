"""Evaluations of the callback of Stable-Baselines3, against the learner's own environments."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from experiments import script
from programs import LIMIT, Ride, shares_of, watched
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecFrameStack, VecNormalize

from rtamt import InputError
from rtamt_gym import StlMonitor, VectorStlMonitor, evaluate_policy
from rtamt_gym.learners import sb3
from rtamt_gym.learners.sb3 import SatisfactionCallback
from rtamt_gym.results.intervals import clopper_pearson

EPISODES = 15


def plain() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1", max_episode_steps=LIMIT)


def monitored(bound: float = 0.12) -> gym.Env[Any, Any]:
    specs, signals = f"always(abs(x) < {bound})", {"x": "obs[0]"}
    return StlMonitor(plain(), specs, signals, at_termination="failure")


def learner(envs: VecEnv, folder: Path | None = None, **more: Any) -> Any:  # noqa: ANN401
    model: Any = PPO("MlpPolicy", envs, n_steps=64, n_epochs=2, seed=1, device="cpu", **more)
    if folder is not None:
        model.set_logger(configure(str(folder), ["csv"]))
    return model


def callback(folder: Path, env: Any = monitored, **more: Any) -> SatisfactionCallback:  # noqa: ANN401
    chosen = {"eval_freq": 256, "episodes": EPISODES, "path": folder / "best"}
    return SatisfactionCallback(env, **{**chosen, **more})


def rides_of(model: Any, around: Any, statistics: Path | None) -> list[Ride]:  # noqa: ANN401
    """Return the episodes of a model in the learner's own wrappers, on the seeds of evaluations."""
    venv: VecEnv = DummyVecEnv([plain])
    if statistics is not None:
        venv = VecNormalize.load(str(statistics), venv)
        venv.training = False
    venv = around(venv)
    rides = []
    for seed in range(10_000, 10_000 + EPISODES):
        with watched() as seen:
            venv.seed(seed)
            obs: Any = venv.reset()
            done = False
            while not done:
                actions, _ = model.predict(obs, deterministic=True)
                obs, _, dones, _ = venv.step(actions)
                done = bool(dones[0])
        rides.append(seen.started[0])
    return rides


@pytest.mark.parametrize("wrapped", [False, True], ids=["bare", "normalised and stacked"])
def test_the_best_model_is_what_its_file_says_in_the_wrappers_of_the_learner(
    tmp_path: Path,
    *,
    wrapped: bool,
) -> None:
    def around(venv: VecEnv) -> VecEnv:
        return VecFrameStack(venv, 2) if wrapped else venv

    inner = make_vec_env(monitored, 2, seed=1)
    model = learner(around(VecNormalize(inner)) if wrapped else inner, tmp_path)
    used = callback(tmp_path)
    model.learn(1024, callback=used)
    model.logger.close()
    said = json.loads((tmp_path / "best.json").read_text(encoding="utf-8"))
    best = PPO.load(tmp_path / "best.zip", device="cpu")
    statistics = tmp_path / "best_vecnormalize.pkl"
    assert statistics.exists() == wrapped
    rides = rides_of(best, around, statistics if wrapped else None)
    good = sum(ride.success for ride in rides)
    shares = shares_of(rides)
    low, high = clopper_pearson(good, EPISODES)
    expected = {"rate": good / EPISODES, "low": low, "high": high}
    expected |= {"spec/rate": good / EPISODES, "spec/low": low, "spec/high": high}
    expected |= {key: value for key, value in shares.items() if "robustness" in key}
    expected |= {key: value for key, value in shares.items() if "first" in key}
    expected["return"] = float(np.mean([ride.steps for ride in rides]))
    steps = said["steps"]
    assert said == pytest.approx({**expected, "steps": steps, "seed": 10_000, "episodes": EPISODES})
    with (tmp_path / "progress.csv").open(encoding="utf-8") as file:
        logged = {
            int(row["time/total_timesteps"]): row
            for row in csv.DictReader(file)
            if row["eval_stl/rate"]
        }
    assert list(logged) == [256, 512, 768, 1024] == [number for number, _ in used.evaluations]
    row = logged[steps]
    assert {key: float(row[f"eval_stl/{key}"]) for key in expected} == pytest.approx(expected)
    scores = {
        number: (float(row["eval_stl/rate"]), float(row["eval_stl/return"]))
        for number, row in logged.items()
    }
    assert max(scores, key=lambda number: scores[number]) == steps
    assert {made.policy for _, made in used.evaluations} == {"PPO"}
    assert len(set(scores.values())) > 1


def weights(model: Any) -> list[np.ndarray]:  # noqa: ANN401
    return [part.detach().numpy() for part in model.policy.state_dict().values()]


@pytest.mark.parametrize("kind", [PPO, DQN])
def test_training_goes_on_as_without_evaluations(kind: Any, tmp_path: Path) -> None:  # noqa: ANN401
    trained = []
    for used in (None, callback(tmp_path, eval_freq=100)):
        envs = VecNormalize(make_vec_env(monitored, 2, seed=1))
        few = {"n_steps": 64} if kind is PPO else {"learning_starts": 50, "buffer_size": 999}
        model = kind("MlpPolicy", envs, seed=1, device="cpu", **few)
        model.learn(384, callback=used)
        trained.append(weights(model))
    assert used is not None
    assert [steps for steps, _ in used.evaluations] == [100, 200, 300, 384]
    assert all(np.array_equal(a, b) for a, b in zip(*trained, strict=True))


def test_an_environment_of_every_kind_gives_the_same_evaluation(tmp_path: Path) -> None:
    requirement = {"specs": "always(abs(x) < 0.12)", "signals": {"x": "obs[0]"}}
    given: list[tuple[Any, dict[str, Any]]] = [
        (monitored, {}),
        (monitored(), {}),
        (make_vec_env(monitored, 2), {}),
        (plain, {**requirement, "at_termination": "failure"}),
    ]
    found = []
    for env, more in given:
        model = learner(make_vec_env(plain, 2, seed=1))  # a training without requirements
        used = callback(tmp_path, env, path=None, **more)
        model.learn(256, callback=used)
        assert used.training.episodes == 0
        assert used.evaluations[0][1].policy == "PPO"
        found.append([(row.seed, row.outcomes) for row in used.evaluations[0][1].record])
    assert found[0] == found[1] == found[2] == found[3]
    assert not list(tmp_path.iterdir())


def test_training_stops_at_a_policy_that_meets_the_target(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeds: list[int] = []

    def seen(*arguments: Any, **more: Any) -> Any:  # noqa: ANN401
        made = evaluate_policy(*arguments, **more)
        seeds.extend(row.seed or 0 for row in made.record)
        return made

    monkeypatch.setattr(sb3, "evaluate_policy", seen)
    model = learner(make_vec_env(monitored, 4, seed=1))
    used = callback(tmp_path, target=0.7, margin=0.2, alpha=0.1, seed=500)
    model.learn(20_000, callback=used)
    assert model.num_timesteps < 20_000
    steps, last = used.evaluations[-1]
    assert steps == model.num_timesteps
    assert used.confirmed is not None
    assert used.confirmed.decision == "meets 0.7"
    assert used.best.evaluation is last
    # The evaluations share their seeds with no other test.
    shared = list(range(500, 500 + EPISODES))
    own = [seed for seed in seeds if seed not in shared]
    assert len(seeds) - len(own) == EPISODES * len(used.evaluations)
    assert own == list(range(500 + EPISODES, 500 + EPISODES + len(own)))
    assert len(own) >= used.confirmed.episodes
    said = json.loads((tmp_path / "best.json").read_text(encoding="utf-8"))
    assert said["steps"] == steps
    test = used.confirmed
    assert said["confirmed"] == f"meets 0.7: {test.satisfied} of {test.episodes} episodes"
    loaded = PPO.load(tmp_path / "best.zip", device="cpu")
    assert all(np.array_equal(a, b) for a, b in zip(weights(loaded), weights(model), strict=True))


def test_what_cannot_be_evaluated_is_refused_before_training() -> None:
    def refused(model: Any, used: SatisfactionCallback) -> str:  # noqa: ANN401
        with pytest.raises(InputError) as caught:
            model.learn(64, callback=used)
        assert model.num_timesteps == 0
        return str(caught.value)

    envs = make_vec_env(monitored, 2, seed=1)
    trained_in = (
        "expected a separate environment for evaluations, got the training environment; pass the "
        "function that makes it"
    )
    assert refused(learner(envs), SatisfactionCallback(envs)) == trained_in
    corridors = script("corridor").VectorCorridor(2)
    many = VectorStlMonitor(corridors, "always(x < 2)", {"x": ("info['x']", 0.0)}, period=1)
    around = script("vec_env").GymnasiumVecEnv(many, seed=1)
    assert refused(learner(around), SatisfactionCallback(many)) == trained_in
    assert refused(learner(envs), SatisfactionCallback(monitored, seed=2, episodes=10)) == (
        "expected seeds that training does not use, got 2 to 11 for evaluations, and 1 to 2 for "
        "the environments of the model; give another seed="
    )
    with pytest.raises(InputError) as caught:
        SatisfactionCallback(target=0.9)
    assert str(caught.value) == (
        "expected an environment to evaluate in, which target=0.9 needs, got none; give the "
        "function that makes the training environment"
    )
