"""A point in a corridor, the smallest task that needs a memory: one environment, and a vector."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

__all__ = ["Corridor", "VectorCorridor"]


class Corridor(gym.Env[np.ndarray, np.ndarray]):
    """A point x in [-1, 1], which an action moves by ``stride * action``. The reward is 0.

    The point starts anywhere. The observation is x, which does not show earlier positions: a policy
    that must visit both ends needs more than the observation. ``info["x"]`` is the observed x.
    """

    def __init__(self, stride: float = 0.1) -> None:
        """Set the distance that an action of 1 moves the point."""
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._stride = stride
        self._x = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Put the point anywhere."""
        super().reset(seed=seed, options=options)
        self._x = self.np_random.uniform(-1.0, 1.0)
        return self._observation()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Move the point; walls stop it at -1 and 1."""
        x = self._x + self._stride * min(max(float(action[0]), -1.0), 1.0)
        self._x = min(max(x, -1.0), 1.0)
        obs, info = self._observation()
        return obs, 0.0, False, False, info

    def _observation(self) -> tuple[np.ndarray, dict[str, Any]]:
        obs = np.array([self._x], np.float32)
        return obs, {"x": float(obs[0])}


class VectorCorridor(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """A vector of corridors; each equals a `Corridor` with a ``TimeLimit``.

    The autoreset mode is ``DISABLED``: ``reset(options={"reset_mask": mask})`` starts new episodes
    in the corridors of the mask. A list of seeds has a seed for each corridor.
    """

    def __init__(self, num: int, stride: float = 0.1, steps: int = 50) -> None:
        """Create ``num`` corridors with episodes of ``steps`` steps."""
        single = Corridor(stride)
        self.metadata = {"autoreset_mode": AutoresetMode.DISABLED}
        self.num_envs = num
        self.single_observation_space = single.observation_space
        self.single_action_space = single.action_space
        self.observation_space = batch_space(self.single_observation_space, num)
        self.action_space = batch_space(self.single_action_space, num)
        self._stride, self._limit = stride, steps
        self._x = np.zeros(num)
        self._steps = np.zeros(num, np.int64)
        self._random = [np.random.default_rng() for _ in range(num)]

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Put the points of the mask anywhere; without a mask, all points."""
        seeds = seed if isinstance(seed, list) else [seed] * self.num_envs
        if isinstance(seed, int):
            seeds = [seed + k for k in range(self.num_envs)]
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_))
        for k in np.flatnonzero(mask):
            if seeds[k] is not None:
                self._random[k] = np.random.default_rng(seeds[k])
            self._x[k] = self._random[k].uniform(-1.0, 1.0)
        self._steps[mask] = 0
        return self._observation()

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Move the points; walls stop them at -1 and 1."""
        x = self._x + self._stride * np.clip(actions[:, 0].astype(np.float64), -1.0, 1.0)
        self._x = np.clip(x, -1.0, 1.0)
        self._steps += 1
        obs, infos = self._observation()
        never = np.zeros(self.num_envs, np.bool_)
        return obs, np.zeros(self.num_envs), never, self._steps >= self._limit, infos

    def _observation(self) -> tuple[NDArray[np.float32], dict[str, Any]]:
        obs = self._x[:, None].astype(np.float32)
        has_x = np.ones(self.num_envs, np.bool_)
        return obs, {"x": obs[:, 0].astype(np.float64), "_x": has_x}
