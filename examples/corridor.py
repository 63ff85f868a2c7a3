"""A corridor with a point in it, the smallest task that needs a memory."""

from typing import Any

import gymnasium as gym
import numpy as np

__all__ = ["Corridor"]


class Corridor(gym.Env[np.ndarray, np.ndarray]):
    """A point x in [-1, 1] is moved by ``stride * action``; the observation is x, the reward is 0.

    It starts anywhere. Where it has been cannot be seen from x: a policy that is to visit both
    ends needs more than the observation. ``info["x"]`` is x as it is observed.
    """

    def __init__(self, stride: float = 0.1) -> None:
        """Sets how far an action of 1 moves the point."""
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._stride = stride
        self._x = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Puts the point anywhere."""
        super().reset(seed=seed, options=options)
        self._x = self.np_random.uniform(-1.0, 1.0)
        return self._observed()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Moves the point; walls stop it at -1 and 1."""
        moved = self._x + self._stride * min(max(float(action[0]), -1.0), 1.0)
        self._x = min(max(moved, -1.0), 1.0)
        obs, info = self._observed()
        return obs, 0.0, False, False, info

    def _observed(self) -> tuple[np.ndarray, dict[str, Any]]:
        obs = np.array([self._x], np.float32)
        return obs, {"x": float(obs[0])}
