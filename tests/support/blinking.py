"""Environments with a flag of success, with and without repeatable seeds."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces


class Blink(gym.Env[Any, Any]):
    """Ten steps of 0.1 s; the flag is true from step 3 on, for a number of steps equal to the seed.

    Args:
        keys: The keys of info with the flag.
        ends: Whether the first success ends the episode.
    """

    observation_space = spaces.Box(0.0, 12.0, (1,), np.float64)
    action_space = spaces.Discrete(2)
    control_timestep = 0.1

    def __init__(self, keys: tuple[str, ...] = ("success",), *, ends: bool = False) -> None:
        self.keys, self.ends = keys, ends
        self.at, self.length = 0, 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.at, self.length = 0, int(self.np_random.integers(12))
        return self._observation(), {}

    def step(self, _action: object) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.at += 1
        done = self.flags(self.length)[self.at]
        info = dict.fromkeys(self.keys, done)
        return self._observation(), 0.0, self.ends and bool(done), self.at == 10, info

    def _observation(self) -> Any:  # noqa: ANN401
        return np.array([self.length], np.float64)

    @staticmethod
    def flags(length: int) -> list[int]:
        """Return the flag at every sample."""
        return [int(3 <= at < 3 + length) for at in range(11)]


class Wild(Blink):
    """An environment that ignores the seed, and counts its resets."""

    resets = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        self.resets += 1
        shown = super().reset(seed=seed, options=options)
        self.length = self.resets % 12
        return self._observation(), shown[1]


for name, kind in (("Blink-v0", Blink), ("Wild-v0", Wild)):
    if name not in gym.registry:
        gym.register(name, f"blinking:{kind.__name__}")
