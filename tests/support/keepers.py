"""A wrapper that counts episodes, and an environment for it."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from replay import Replay


class Fresh(Replay):
    """An environment with a new info at every step, so that wrappers can write into it."""

    def step(self, action: object) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        *rest, info = super().step(action)
        return *rest, dict(info)


class Monitor(gym.Wrapper[Any, Any, Any, Any]):
    """A wrapper with the attributes of Stable-Baselines3's `Monitor`."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.rewards: list[float] = []
        self.needs_reset = True
        self.total_steps = 0
        self.rows: list[dict[str, Any]] = []
        self.episode_returns: list[float] = []

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
        self.rewards, self.needs_reset = [], False
        return self.env.reset(**arguments)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:  # noqa: ANN401
        assert not self.needs_reset
        obs, reward, terminated, truncated, info = self.env.step(action)
        self.rewards.append(float(reward))
        if terminated or truncated:
            self.needs_reset = True
            row = {"r": sum(self.rewards), "l": len(self.rewards)}
            self.rows.append(row)
            self.episode_returns.append(row["r"])
            info = {**info, "episode": row}
        self.total_steps += 1
        return obs, reward, terminated, truncated, info
