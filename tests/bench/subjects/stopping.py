"""Episodes of MuJoCo environments, judged at the end or stopped at a certain violation."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import worker

import rtamt
from rtamt_gym import simulate

Policy = Callable[[Any], Any]


def pendulum(seed: int) -> Policy:
    """Balance, move 0.5 m aside at 2 s, and return after a varying time."""
    leave, step = np.random.default_rng(seed).uniform(3.0, 30.0), 0

    def act(obs: Any) -> Any:  # noqa: ANN401
        nonlocal step
        step += 1
        target = 0.5 if 2.0 <= 0.04 * step < leave else 0.0
        return np.clip([obs @ (1.0, 12.0, 1.0, 2.0) - target], -3.0, 3.0)

    return act


def cheetah(seed: int) -> Policy:
    """Gallop: every joint swings at one frequency, with its own phase."""
    rng = np.random.default_rng(seed)
    phases, strength, step = rng.uniform(0.0, 2 * np.pi, 6), rng.uniform(0.2, 1.0), 0

    def act(_obs: Any) -> Any:  # noqa: ANN401
        nonlocal step
        step += 1
        return strength * np.sin(0.6 * step + phases)

    return act


def hopper(seed: int) -> Policy:
    """Twitch until it falls, which ends the episode."""
    rng = np.random.default_rng(seed)
    return lambda _obs: rng.uniform(-0.3, 0.3, 3)


CASES: dict[str, tuple[Callable[[int], Policy], dict[str, str], dict[str, Any]]] = {
    "InvertedPendulum-v5": (
        pendulum,
        {
            "upright": "always[0:40](abs(angle) < 0.15)",
            "returns": "always[0:30](cart > 0.2 implies eventually[0:10](cart < 0.1))",
        },
        {"cart": "obs[0]", "angle": "obs[1]"},
    ),
    "HalfCheetah-v5": (
        cheetah,
        {
            "upright": "always[0:50](abs(pitch) < 1.5)",
            "moves": "always[0:40](abs(v) < 0.1 implies eventually[0:1](abs(v) > 0.3))",
        },
        {"pitch": "obs[1]", "v": "obs[8]"},
    ),
    "Hopper-v5": (
        hopper,
        {"tall": "always[0:8](z > 0.9)", "straight": "always[0:8](abs(angle) < 0.15)"},
        {"z": "obs[0]", "angle": "obs[1]"},
    ),
}


def to_the_end(env: Any, name: str, seed: int) -> tuple[bool, int]:  # noqa: ANN401
    """Run a complete episode and evaluate it; return whether it was violated, and its steps."""
    make, specs, signals = CASES[name]
    policy, columns = make(seed), {variable: [] for variable in signals}
    places = [(columns[v].append, int(s[4:-1])) for v, s in signals.items()]
    obs, _ = env.reset(seed=seed)
    over, steps = False, 0
    for note, place in places:
        note(obs[place])
    while not over:
        obs, _, terminated, truncated, _ = env.step(policy(obs))
        over = terminated or truncated
        steps += 1
        for note, place in places:
            note(obs[place])
    period = env.unwrapped.dt
    return any(rtamt.evaluate(spec, columns, period)[0] < 0 for spec in specs.values()), steps


def stopped(env: Any, name: str, seed: int) -> tuple[bool, int]:  # noqa: ANN401
    """Run an episode until a violation is certain; return whether there was one, and its steps."""
    make, specs, signals = CASES[name]
    run = simulate(env, specs, signals, policy=make(seed), seed=seed)
    return run.verdict < 0, run.steps


def measure(case: worker.Case) -> worker.Measure:
    """Return violated episodes, simulated and wall time of both methods; verdicts must be equal."""
    name, episodes = case["env"], case["episodes"]
    env = gym.make(name, disable_env_checker=True)
    methods = (to_the_end, stopped)
    for method in methods:  # once before the clock runs: imports, parsers
        method(env, name, 0)

    def run() -> list[float]:
        violated, steps, wall = 0, [0, 0], [0.0, 0.0]
        for seed in range(episodes):
            verdicts = []
            for i, method in enumerate(methods):
                begin = time.perf_counter()
                verdict, count = method(env, name, seed)
                wall[i] += time.perf_counter() - begin
                steps[i] += count
                verdicts.append(verdict)
            if verdicts[0] != verdicts[1]:
                msg = f"episode {seed}: violated {verdicts[0]} offline, {verdicts[1]} online"
                raise AssertionError(msg)
            violated += verdicts[0]
        dt = float(env.unwrapped.dt)
        return [violated, steps[0] * dt, steps[1] * dt, *wall]

    return run


if __name__ == "__main__":
    worker.serve({"stopping": measure})
