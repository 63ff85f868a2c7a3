"""Environments that a case drives: one in the form of a scenario, and one with attributes."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

__all__ = ["Plant", "Windy"]


class Plant(gym.Env[Any, Any]):
    """Two integrators of the actions; parameters are options of the reset, as in a scenario."""

    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)
    action_space = spaces.Box(-2.0, 2.0, (2,), np.float64)
    action_names = ("left", "right")
    signals = {"x": "obs[0]", "y": "obs[1]"}  # noqa: RUF012 - as an environment has it
    control_timestep = 0.1

    def __init__(self) -> None:
        self.parameters = {"gain": 1.0, "from": math.inf}
        self.taken: list[list[float]] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.parameters = {"gain": 1.0, "from": math.inf} | (options or {})
        self.at = self.np_random.normal(size=2)
        self.time = 0.0
        self.taken = []
        return self.at.copy(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        self.taken.append(np.asarray(action).tolist())
        gain = self.parameters["gain"] if self.time < self.parameters["from"] else 0.0
        self.at = self.at + 0.1 * gain * np.asarray(action)
        self.time += 0.1
        return self.at.copy(), 0.0, False, False, {}

    def baseline(self, obs: Any) -> Any:  # noqa: ANN401
        return np.clip(-obs, -1, 1)


class Sky:
    """An object that an attribute may be part of."""

    clouds = 0.5


class Windy(gym.Env[Any, Any]):
    """An environment whose attributes are numbers of several kinds."""

    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space: spaces.Space[Any] = spaces.Box(-2.0, 2.0, (1,), np.float64)
    wind = 3  # an attribute of the class until it is set
    calm = False
    label = "windy"

    def __init__(self) -> None:
        self.sky = Sky()
        self.seen: list[object] = []

    @property
    def fixed(self) -> float:
        """An attribute that cannot be set."""
        return 1.0

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 - it has none
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.drawn = 0.5
        return np.zeros(1), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        self.seen = [self.wind, self.calm, self.sky.clouds]
        if action[0] > 1:
            raise ZeroDivisionError("gust")
        return np.zeros(1), 0.0, False, False, {}
