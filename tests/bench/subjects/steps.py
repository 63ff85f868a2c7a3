"""Gymnasium's CartPole and Pendulum for 5,000 steps, bare or with a monitor."""

from __future__ import annotations

import time
from typing import Any

import gymnasium as gym
import numpy as np
import worker

STEPS, PART = 5_000, 1_000
SIGNALS = {
    "CartPole-v1": {"angle": "obs[2]", "rate": "obs[3]"},
    "Pendulum-v1": {"angle": "obs[0]", "rate": "obs[2]"},
}
SPECS = {
    "bounded": "always(abs(angle) < 50)",
    "slow": "always(abs(rate) < 50)",
    "calms": "always((abs(rate) > 40) implies eventually[0:20](abs(rate) < 10))",
    "stays": "always(eventually[0:200] always[0:50] (abs(angle) < 50))",
}


def make(name: str) -> Any:  # noqa: ANN401
    return gym.make(name, max_episode_steps=2 * STEPS, disable_env_checker=True)


def actions(name: str) -> list[Any]:
    """Return actions that keep the pole up; zero torques for the pendulum."""
    if name == "Pendulum-v1":
        return [np.zeros(1, dtype=np.float32)] * STEPS
    env, chosen = make(name), []
    obs, _ = env.reset(seed=1)
    for _ in range(STEPS):
        chosen.append(int(obs @ (0.1, 0.3, 1.0, 0.5) > 0))
        obs, _, terminated, _, _ = env.step(chosen[-1])
        if terminated:
            msg = f"the pole fell at step {len(chosen)}"
            raise RuntimeError(msg)
    return chosen


class Naive(gym.Wrapper):
    """A minimal wrapper of a peer's monitor: it computes the value and adds no information."""

    def __init__(self, env: Any) -> None:  # noqa: ANN401
        super().__init__(env)
        import sentil

        self.monitor, self.time = sentil.OnlineMonitor("always (abs(angle) < 50)"), 0.0

    def step(self, action: Any) -> Any:  # noqa: ANN401
        obs, reward, terminated, truncated, info = self.env.step(action)
        self.time += 1.0
        info["robustness"] = self.monitor.update_packed(self.time, [float(obs[2])]).value
        return obs, reward, terminated, truncated, info


def wrapped(name: str, who: str) -> Any:  # noqa: ANN401
    env = make(name)
    if who == "bare":
        return env
    if who == "naive":
        return Naive(env)
    import rtamt_gym

    specs = SPECS if who == "four" else SPECS["bounded"]
    signals = SIGNALS[name] if who == "four" else {"angle": SIGNALS[name]["angle"]}
    return rtamt_gym.StlMonitor(env, specs, signals, period=1)


def steps(case: worker.Case) -> worker.Measure:
    """Return nanoseconds per step: of the first 1,000 steps, of the last 1,000, of all."""
    env, chosen = wrapped(case["env"], case["who"]), actions(case["env"])

    def timed(some: list[Any]) -> float:
        step = env.step
        begin = time.perf_counter_ns()
        for action in some:
            step(action)
        return (time.perf_counter_ns() - begin) / len(some)

    def measure() -> list[float]:
        env.reset(seed=1)
        middle = STEPS - 2 * PART
        early, between, late = (
            timed(chosen[:PART]),
            timed(chosen[PART:-PART]),
            timed(chosen[-PART:]),
        )
        return [early, late, ((early + late) * PART + between * middle) / STEPS]

    return measure


def episode(_case: worker.Case) -> worker.Measure:
    """Return nanoseconds for a monitor from a specification and from text, a wrapper, its reset."""
    import rtamt
    import rtamt_gym

    text = SPECS["calms"]
    parsed, bare = rtamt.parse(text), make("CartPole-v1")
    signals = {"rate": "obs[3]"}
    monitored = rtamt_gym.StlMonitor(bare, parsed, signals, period=1)
    seed = {"seed": None}

    def each(call: Any, times: int = 200) -> float:  # noqa: ANN401
        begin = time.perf_counter_ns()
        for _ in range(times):
            call()
        return (time.perf_counter_ns() - begin) / times

    def measure() -> list[float]:
        return [
            each(lambda: rtamt.EpisodeMonitor(parsed).reset()),
            each(lambda: rtamt.EpisodeMonitor(text).reset()),
            each(lambda: rtamt_gym.StlMonitor(bare, parsed, signals, period=1)),
            each(lambda: bare.reset(**seed)),
            each(lambda: monitored.reset(**seed)),
        ]

    return measure


worker.serve({"steps": steps, "episode": episode})
