"""An environment with the interface of highway-env: a vehicle with constant speed."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

__all__ = ["SPEED", "RoadEnv"]

SPEED = 25.0
"""Meters per second."""


class RoadEnv(gym.Env[Any, Any]):
    """An action makes ``simulation_frequency // policy_frequency`` steps of the physics.

    ``time`` grows by ``1 / policy_frequency`` per action, as in highway-env. The observation is the
    distance since the reset. ``reset(options={"config": {...}})`` changes the configuration.
    """

    observation_space = spaces.Box(0.0, np.inf, (1,), np.float64)
    action_space = spaces.Discrete(1)

    def __init__(self, policy: float, simulation: float = 15) -> None:
        self.config = {"policy_frequency": policy, "simulation_frequency": simulation}
        self.time, self.steps, self.distance = 0.0, 0, 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.config |= (options or {}).get("config", {})
        self.time, self.steps, self.distance = 0.0, 0, 0.0
        return np.zeros(1), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401, ARG002
        policy, simulation = self.config["policy_frequency"], self.config["simulation_frequency"]
        self.time += 1 / policy
        for _ in range(int(simulation // policy)):
            self.distance += SPEED / simulation
            self.steps += 1
        return np.array([self.distance]), 0.0, False, self.distance >= 100.0, {}
