"""An environment that replays numbers, for tests that must know every sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

INF = math.inf


class Replay(gym.Env[Any, Any]):
    """Observes the given numbers in order; the last one ends the episode.

    Args:
        values: The numbers.
        end: How the episode ends: ``"terminated"``, ``"truncated"`` or not at all.
    """

    observation_space = spaces.Box(-INF, INF, (1,), np.float64)
    action_space = spaces.Box(-1.0, 1.0, (1,), np.float64)

    def __init__(self, values: Sequence[float], end: str = "terminated") -> None:
        self.values = values
        self.end = end
        self.at = 0
        self.info: dict[str, Any] = {"own": 1}

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.at = 0
        return self._observation(), self.info

    def step(self, action: object) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ARG002
        self.at += 1
        last = self.at == len(self.values) - 1
        terminated, truncated = last and self.end == "terminated", last and self.end == "truncated"
        return self._observation(), float(self.at), terminated, truncated, self.info

    def _observation(self) -> Any:  # noqa: ANN401
        return np.array([self.values[self.at]], np.float64)


X = {"x": "obs[0]"}


def shaping_options(mode: str, *names: str) -> dict[str, Any]:
    """Modes, with priorities if needed: safety, target and comfort in this order.

    The mode ``"verdict"`` needs a bonus or a penalty.
    """
    if mode == "verdict":
        return {"mode": mode, "bonus": 2.0, "penalty": 1.0}
    if mode != "hierarchical":
        return {"mode": mode}
    ranks = ("safety", "target", "comfort")
    return {"mode": mode, "priorities": dict(zip(names, ranks, strict=False))}


def run(env: gym.Env[Any, Any], action: float = 0.5) -> list[dict[str, Any]]:
    """Return the infos of one episode; the last one has the kind of its end."""
    _, info = env.reset(seed=1)
    infos = [info]
    terminated = truncated = False
    while not (terminated or truncated):
        _, _, terminated, truncated, info = env.step(np.array([action]))
        infos.append(info)
    infos[-1] = {**info, "terminated": terminated, "truncated": truncated}
    return infos
