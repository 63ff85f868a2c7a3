"""Count successes by hand and as learners see them, for every end mode of an episode.

``always(abs(x) < 1)`` on CartPole, the same 40 episodes of each policy everywhere: from their
trajectories, without this project; in the ``EvalCallback`` of Stable-Baselines3; in the infos of a
vector environment of monitored environments; and in the infos of a monitored vector environment.
Needs Stable-Baselines3: ``pip install -c .ci/constraints.txt stable-baselines3``.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from rtamt_gym import StlMonitor, VectorStlMonitor

EPISODES, ENTRIES = 40, 4
SPEC, SIGNALS = "always(abs(x) < 1)", {"x": "obs[0]"}

Env = gym.Env[Any, Any]
Policy = Callable[[Any, np.random.Generator], int]


def at_random(_obs: Any, rng: np.random.Generator) -> int:  # noqa: ANN401
    return int(rng.integers(2))


def balance(obs: Any, _rng: np.random.Generator) -> int:  # noqa: ANN401
    """Move the cart below the pole, at any position of the cart."""
    return int(obs[2] + 0.3 * obs[3] > 0)


def lapse(obs: Any, rng: np.random.Generator) -> int:  # noqa: ANN401
    """Balance, but skip four of ten steps."""
    return at_random(obs, rng) if rng.random() < 0.4 else balance(obs, rng)


class Driven(gym.Wrapper[Any, Any, Any, Any]):
    """Episodes of given seeds under a policy of its own; it ignores the actions."""

    def __init__(self, policy: Policy, seeds: list[int]) -> None:
        super().__init__(gym.make("CartPole-v1"))
        self._policy, self._seeds, self._count = policy, seeds, 0

    def reset(self, **_arguments: Any) -> Any:  # noqa: ANN401
        seed = self._seeds[self._count % len(self._seeds)]
        self._count += 1
        self._rng = np.random.default_rng(seed)
        self._obs, info = self.env.reset(seed=seed)
        return self._obs, info

    def step(self, _action: object) -> Any:  # noqa: ANN401
        self._obs, *result = self.env.step(self._policy(self._obs, self._rng))
        return self._obs, *result


def trajectories(policy: Policy) -> list[tuple[list[float], bool]]:
    """Return the positions of every episode, and whether the pole fell, without a monitor."""
    env, episodes = Driven(policy, list(range(EPISODES))), []
    for _ in range(EPISODES):
        positions, over = [float(env.reset()[0][0])], False
        while not over:
            obs, _, terminated, truncated, _ = env.step(None)
            positions.append(float(obs[0]))
            over = terminated or truncated
        episodes.append((positions, bool(terminated)))
    return episodes


def by_hand(
    episodes: list[tuple[list[float], bool]], at_termination: str, at_truncation: str
) -> int:
    """Return whether the cart stayed within 1 m and the end counts as a success."""
    return sum(
        max(map(abs, positions)) < 1
        and (at_termination != "failure" if fell else at_truncation != "open")
        for positions, fell in episodes
    )


def in_eval_callback(policy: Policy, options: dict[str, Any]) -> float:
    env = StlMonitor(Monitor(Driven(policy, list(range(EPISODES)))), SPEC, SIGNALS, **options)
    callback = EvalCallback(
        DummyVecEnv([lambda: env]), n_eval_episodes=EPISODES, eval_freq=1, verbose=0
    )
    model = PPO("MlpPolicy", gym.make("CartPole-v1"), device="cpu")
    model.set_logger(configure(None, []))
    callback.init_callback(model)
    callback.on_step()
    return float(np.sum(callback._is_success_buffer))


def entries(policy: Policy) -> list[Callable[[], Env]]:
    seeds = [list(range(entry, EPISODES, ENTRIES)) for entry in range(ENTRIES)]
    return [lambda own=own: Driven(policy, own) for own in seeds]  # type: ignore[misc]


def in_infos(envs: gym.vector.VectorEnv[Any, Any, Any]) -> int:
    """Return the successes of the first episodes of each entry, as many as the count by hand."""
    envs.reset()
    ended = np.zeros(ENTRIES, int)
    successes = 0
    while ended.min() < EPISODES // ENTRIES:
        *_, terminated, truncated, infos = envs.step(np.zeros(ENTRIES, int))
        last = (terminated | truncated) & (ended < EPISODES // ENTRIES)
        if last.any():
            successes += int(infos["is_success"][last].sum())
        ended += terminated | truncated
    return successes


def main() -> None:
    print(f"{SPEC} on CartPole-v1, {EPISODES} episodes: successes")
    for policy in (at_random, lapse, balance):
        episodes = trajectories(policy)
        left = sum(max(map(abs, positions)) >= 1 for positions, _ in episodes)
        fell = sum(fell for _, fell in episodes)
        print(f"\n{policy.__name__}: {fell} fell, {left} left the 1 m around the middle")
        print("at_termination at_truncation   hand  EvalCallback  SyncVectorEnv  VectorStlMonitor")
        for ending, cut in product(("complete", "cut", "failure"), ("cut", "complete", "open")):
            options = {"at_termination": ending, "at_truncation": cut}
            monitored = [
                lambda make=make: StlMonitor(make(), SPEC, SIGNALS, **options)  # noqa: B023
                for make in entries(policy)
            ]
            counts = (
                by_hand(episodes, ending, cut),
                in_eval_callback(policy, options),
                in_infos(gym.vector.SyncVectorEnv(monitored)),
                in_infos(
                    VectorStlMonitor(
                        gym.vector.SyncVectorEnv(entries(policy)), SPEC, SIGNALS, **options
                    )
                ),
            )
            print(
                f"{ending:14} {cut:13} {counts[0]:6} {counts[1]:13.0f} "
                f"{counts[2]:14} {counts[3]:17}"
            )


if __name__ == "__main__":
    main()
