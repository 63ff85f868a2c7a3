"""Gymnasium's native CartPole, many at once: bare, recorded by Gymnasium, or monitored."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import worker
from gymnasium.wrappers.vector import RecordEpisodeStatistics

STEPS = 300
SPECS = {
    "upright": "always(abs(angle) < 0.2)",
    "slow": "always(abs(rate) < 50)",
    "calms": "always((abs(rate) > 4) implies eventually[0:20](abs(rate) < 1))",
    "returns": "always(eventually[0:100](abs(angle) < 0.05))",
}
SIGNALS = {"angle": "obs[2]", "rate": "obs[3]"}


def make(num: int) -> Any:  # noqa: ANN401
    return gym.make_vec(
        "CartPole-v1", num, vectorization_mode="vector_entry_point", max_episode_steps=10 * STEPS
    )


def actions(num: int, *, ends: bool) -> list[Any]:
    """Return random actions, under which poles keep falling, or actions that keep all poles up."""
    if ends:
        return list(np.random.default_rng(1).integers(0, 2, (STEPS, num)))
    env, chosen = make(num), []
    obs, _ = env.reset(seed=1)
    for _ in range(STEPS):
        chosen.append((obs @ np.array([0.1, 0.3, 1.0, 0.5]) > 0).astype(np.int64))
        obs, _, terminated, _, _ = env.step(chosen[-1])
        if terminated.any():
            msg = f"a pole fell at step {len(chosen)}"
            raise RuntimeError(msg)
    return chosen


def monitored(env: Any, count: int, **options: Any) -> Any:  # noqa: ANN401
    import rtamt_gym

    specs = dict(list(SPECS.items())[:count])
    read = {
        name: selector
        for name, selector in SIGNALS.items()
        if any(name in s for s in specs.values())
    }
    return rtamt_gym.VectorStlMonitor(env, specs, read, period=1, **options)


WRAPPED: dict[str, Callable[[Any], Any]] = {
    "bare": lambda env: env,
    "gymnasium": RecordEpisodeStatistics,
    "one": lambda env: monitored(env, 1),
    "four": lambda env: monitored(env, 4),
    "state": lambda env: monitored(env, 4, observe="state"),
    "obligations": lambda env: monitored(env, 4, observe="obligations"),
}


def steps(case: worker.Case) -> worker.Measure:
    """Return nanoseconds per step of all environments."""
    env = WRAPPED[case["who"]](make(case["num"]))
    chosen = actions(case["num"], ends=case["ends"])

    def measure() -> float:
        env.reset(seed=1)
        step = env.step
        begin = time.perf_counter_ns()
        for action in chosen:
            step(action)
        return (time.perf_counter_ns() - begin) / len(chosen)

    return measure


worker.serve({"steps": steps})
