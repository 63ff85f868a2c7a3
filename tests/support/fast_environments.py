"""Stand-ins for fast vector environments, in the forms of EnvPool and PufferLib.

PufferLib 3 must be built from source, so its shared arrays are simulated here: environments write
observations, rewards and flags into arrays of the learner. `tests/learners` has EnvPool and
PufferLib 2 themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

Make = Callable[[], gym.Env[Any, Any]]


class Pool(gym.Env[Any, Any]):
    """EnvPool's form: many CartPoles in one ``gym.Env``, reset in the step after the last."""

    def __init__(self, num_envs: int, batch_size: int | None = None, players: int = 1) -> None:
        envs = gym.make_vec("CartPole-v1", num_envs, vectorization_mode="vector_entry_point")
        self.config = {
            "num_envs": num_envs,
            "batch_size": batch_size or num_envs,
            "max_num_players": players,
        }
        self.all_env_ids = np.arange(num_envs)
        self.is_async = batch_size is not None
        self.observation_space = envs.single_observation_space
        self.action_space = envs.single_action_space
        self._envs = envs
        self._elapsed = np.zeros(num_envs, np.int32)
        self._done = np.zeros(num_envs, np.bool_)

    def reset(self) -> tuple[Any, dict[str, Any]]:  # type: ignore[override]  # as EnvPool has it
        obs, _ = self._envs.reset(seed=5)
        self._elapsed[:] = 0
        return obs, {"elapsed_step": self._elapsed.copy()}

    def step(self, action: Any) -> Any:  # noqa: ANN401
        obs, rewards, terminated, truncated, _ = self._envs.step(action)
        self._elapsed = np.where(self._done, 0, self._elapsed + 1).astype(np.int32)
        self._done = terminated | truncated
        info = {"elapsed_step": self._elapsed.copy(), "env_id": self.all_env_ids}
        return obs, rewards.astype(np.float32), terminated, truncated, info

    def send(self, action: Any) -> None:  # noqa: ANN401
        raise NotImplementedError

    def recv(self) -> None:
        raise NotImplementedError


@dataclass
class Emulated:
    """An environment of Gymnasium as PufferLib stores it."""

    env: gym.Env[Any, Any]
    num_agents: int = 1


class Shared:
    """PufferLib's form: arrays that the environments write and the learner reads."""

    emulated: Any
    driver_env: Any
    single_observation_space: spaces.Box
    single_action_space: spaces.Space[Any]

    def __init__(self, num: int) -> None:
        space = self.single_observation_space
        self.num_agents = self.agents_per_batch = num
        self.agent_ids = np.arange(num)
        self.observations = np.zeros((num, *space.shape), space.dtype)
        self.rewards = np.zeros(num, np.float32)
        self.terminals = np.zeros(num, np.bool_)
        self.truncations = np.zeros(num, np.bool_)
        self.masks = np.ones(num, np.bool_)
        self.infos: list[dict[str, Any]] = []
        self.closed = False

    def recv(self) -> tuple[Any, ...]:
        flags = self.terminals, self.truncations
        return self.observations, self.rewards, *flags, self.infos, self.agent_ids, self.masks

    def close(self) -> None:
        self.closed = True


class SharedEnvironments(Shared):
    """Environments of Gymnasium that are reset in the step after their last."""

    emulated = "as a namespace"

    def __init__(self, makes: Sequence[Make], agents: int = 1) -> None:
        self.envs = [make() for make in makes]
        self.driver_env = Emulated(self.envs[0], agents)
        space: Any = self.envs[0].observation_space
        self.single_observation_space = space
        self.single_action_space = self.envs[0].action_space
        super().__init__(len(makes))

    def async_reset(self, seed: int | list[int] = 42) -> None:
        for i, env in enumerate(self.envs):
            self._begin(i, env, seed + i if isinstance(seed, int) else seed[i])
        self.infos = []

    def send(self, actions: NDArray[Any]) -> None:
        self.infos = []
        for i, env in enumerate(self.envs):
            if self.terminals[i] or self.truncations[i]:
                self._begin(i, env, None)
                continue
            obs, reward, terminated, truncated, _ = env.step(actions[i])
            self.observations[i], self.rewards[i] = obs, float(reward)
            self.terminals[i], self.truncations[i] = terminated, truncated
            if terminated or truncated:
                self.infos.append({"ended": i})

    def _begin(self, i: int, env: gym.Env[Any, Any], seed: int | None) -> None:
        self.observations[i] = env.reset(seed=seed)[0]
        self.rewards[i] = 0
        self.terminals[i] = self.truncations[i] = False


class NativeCounters(Shared):
    """Native environments: entry i counts from i, and is reset in the step that reaches 4."""

    emulated = False
    single_observation_space = spaces.Box(-9, 9, (1,))
    single_action_space = spaces.Discrete(2)

    def __init__(self, num: int) -> None:
        super().__init__(num)
        self.driver_env = self

    def __repr__(self) -> str:
        return "<NativeCounters>"

    def async_reset(self, seed: int | None = None) -> None:  # noqa: ARG002
        self.observations[:, 0] = self.agent_ids
        self.rewards[:] = 0
        self.terminals[:] = False

    def send(self, actions: NDArray[Any]) -> None:  # noqa: ARG002
        self.observations += 1
        self.rewards[:] = self.observations[:, 0]
        self.terminals[:] = self.observations[:, 0] == 4
        self.observations[self.terminals, 0] = self.agent_ids[self.terminals]
