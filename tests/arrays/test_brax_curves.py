"""The recipe of docs/training.md for Brax: its curves against the sums of Brax itself."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import Env, State
from brax.training.agents.ppo import networks
from brax.training.agents.ppo import train as ppo
from programs import recipes
from scipy.stats import beta
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from rtamt_arrays.jax.brax import training_wrapper
from rtamt_gym.learners.logs import training_logs

EPISODES = 128


class Drift(Env):  # type: ignore[misc]  # Brax is untyped
    """A point that actions push; Brax sums its steps outside the requirement."""

    dt = np.float32(0.1)
    observation_size = 1
    action_size = 1
    backend = "none"

    def reset(self, rng: Any) -> State:  # noqa: ANN401
        obs = jax.random.uniform(rng, (1,), minval=-1.0, maxval=1.0)
        return State(obs, obs, jnp.zeros(()), jnp.zeros(()), {"outside": jnp.zeros(())}, {})

    def step(self, state: State, action: Any) -> State:  # noqa: ANN401
        obs = state.pipeline_state + 0.4 * action
        metrics = {**state.metrics, "outside": (obs[0] >= 1.5).astype(obs.dtype)}
        return state.replace(pipeline_state=obs, obs=obs, reward=-obs[0], metrics=metrics)


@pytest.mark.filterwarnings("ignore:jax.device_put_replicated is deprecated:DeprecationWarning")
def test_curves_of_brax_are_its_own_sums(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    evaluations: list[tuple[int, dict[str, Any]]] = []
    small = partial(
        networks.make_ppo_networks, policy_hidden_layer_sizes=(8,), value_hidden_layer_sizes=(8,)
    )

    def train(env: Env, *, progress_fn: Any, **options: Any) -> None:  # noqa: ANN401
        def progress(steps: int, metrics: dict[str, Any]) -> None:
            evaluations.append((steps, metrics))
            progress_fn(steps, metrics)

        ppo.train(
            env,
            progress_fn=progress,
            **options,
            num_evals=4,
            episode_length=20,
            num_envs=16,
            batch_size=16,
            num_minibatches=2,
            unroll_length=10,
            num_updates_per_batch=4,
            learning_rate=3e-2,
            network_factory=small,
            seed=1,
        )

    wrap = training_wrapper("always(x < 1.5)", {"x": "obs[0]"})
    program = recipes()["Brax"].replace("1_000_000", "15_000")
    names = {"ppo": SimpleNamespace(train=train), "env": Drift(), "wrap": wrap}
    exec(program, names)  # noqa: S102 - our own page
    assert len(evaluations) == 4
    events = EventAccumulator("runs/brax/seed1").Reload()
    curves = {
        tag: [(event.step, event.value) for event in events.Scalars(tag)]
        for tag in events.Tags()["scalars"]
    }
    rates = []
    for at, (steps, metrics) in enumerate(evaluations):
        # A violation ends its episode, so that the sum of an episode is 0 or 1.
        good = round(EPISODES * (1 - float(metrics["eval/episode_outside"])))
        rates.append(good / EPISODES)
        low = beta.ppf(0.025, good, EPISODES - good + 1) if good else 0.0
        high = beta.ppf(0.975, good + 1, EPISODES - good) if good < EPISODES else 1.0
        expected = {
            "eval_stl/rate": good / EPISODES,
            "eval_stl/low": low,
            "eval_stl/high": high,
            "eval_stl/return": float(metrics["eval/episode_reward"]),
        }
        assert {tag: points[at][0] for tag, points in curves.items()} == dict.fromkeys(
            expected, steps
        )
        got = {tag: points[at][1] for tag, points in curves.items()}
        assert got == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert len({*rates}) > 1
    (log,) = training_logs(Path("runs"))
    for tag, points in curves.items():
        assert [*zip(*map(np.ndarray.tolist, log.curves[tag]), strict=True)] == points
