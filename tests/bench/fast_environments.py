"""Steps per second of EnvPool and PufferLib with CartPole, bare and with a vector monitor.

Run `python tests/bench/fast_environments.py` in an environment with both packages, as listed in
`tests/learners/envpool.txt` and `pufferlib.txt`. Subjects take turns in one process, and a figure
is the best of its rounds. Steps are counted per environment. Actions are random, so poles fall and
the figures include the ends of episodes, but no policy. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

STEPS = 200
SPECS = {
    "upright": "always(abs(angle) < 0.2)",
    "slow": "always(abs(rate) < 50)",
    "calms": "always((abs(rate) > 4) implies eventually[0:20](abs(rate) < 1))",
    "returns": "always(eventually[0:100](abs(angle) < 0.05))",
}
SIGNALS = {"angle": "obs[2]", "rate": "obs[3]"}
HELD = {"at_termination": "failure", "period": 1}


def envpool_bare(num: int) -> Any:  # noqa: ANN401
    """Return EnvPool's CartPole on two threads."""
    import envpool

    return envpool.make_gymnasium("CartPole-v1", num_envs=num, seed=1, num_threads=2)


def puffer_bare(num: int) -> Any:  # noqa: ANN401
    """Return Gymnasium's CartPole in PufferLib, in this process."""
    import pufferlib.emulation
    import pufferlib.vector

    def make() -> Any:  # noqa: ANN401
        return pufferlib.emulation.GymnasiumPufferEnv(gym.make("CartPole-v1").unwrapped)

    return pufferlib.vector.make(make, num_envs=num, backend=pufferlib.vector.Serial)


def gymnasium_bare(num: int) -> Any:  # noqa: ANN401
    """Return Gymnasium's own vectorized CartPole."""
    return gym.make_vec("CartPole-v1", num, vectorization_mode="vector_entry_point")


def monitored(env: Any, count: int) -> Any:  # noqa: ANN401
    """Return the environment with a number of requirements."""
    from rtamt_gym import VectorStlMonitor

    return VectorStlMonitor(env, dict(list(SPECS.items())[:count]), SIGNALS, **HELD)


def rewarded(env: Any) -> Any:  # noqa: ANN401
    """Return the environment with the rewards of one requirement."""
    from rtamt_gym import VectorStlReward

    return VectorStlReward(env, SPECS["upright"], SIGNALS, mode="add", **HELD)


def shared(env: Any) -> Any:  # noqa: ANN401
    """Return the same environment, with rewards in PufferLib's array."""
    from rtamt_gym.wrappers import SharedBuffers

    return SharedBuffers(rewarded(env))


KINDS: dict[str, Callable[[int], Any]] = {
    "EnvPool": envpool_bare,
    "PufferLib, Serial": puffer_bare,
    "Gymnasium, native": gymnasium_bare,
}


def steps_a_second(env: Any, num: int, actions: Any) -> float:  # noqa: ANN401
    """Return environment steps per second in one round."""
    env.reset()
    begin = time.perf_counter()
    for action in actions:
        env.step(action)
    return num * len(actions) / (time.perf_counter() - begin)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    rounds: int = parser.parse_args().rounds
    warnings.simplefilter("ignore")
    print("| environments | steps a second, bare | one | four | reward of one |")
    print("|---|---|---|---|---|")
    for kind, make in KINDS.items():
        for num in (64, 1024) if kind != "PufferLib, Serial" else (64,):
            actions = np.random.default_rng(1).integers(0, 2, (STEPS, num))
            reward = shared if kind.startswith("PufferLib") else rewarded
            envs = [
                make(num),
                monitored(make(num), 1),
                monitored(make(num), 4),
                reward(make(num)),
            ]
            best = [0.0] * len(envs)
            for _ in range(rounds):
                for k, env in enumerate(envs):
                    best[k] = max(best[k], steps_a_second(env, num, actions))
            cells = " | ".join(f"{speed / 1e3:,.0f} k" for speed in best)
            print(f"| {kind}, {num:,} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
