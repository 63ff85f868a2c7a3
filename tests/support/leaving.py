"""Systems that call ``sys.exit``, which does not end a simulation."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

__all__ = ["LEAVING", "Leaving", "leaves_while_running", "leaving_policy"]


def leaves_while_running(x: float) -> Iterator[Mapping[str, float]]:
    """A system that leaves the program from some value on, after a sample."""
    yield {"y": x}
    if x >= 0.5:
        sys.exit(0)
    yield {"y": x}


LEAVING = ("reset", "step", "policy")
"""The places at which an episode of `Leaving` may leave the program."""


class Leaving(gym.Env[Any, Any]):
    """An environment of three steps that leaves the program in episodes of odd seeds.

    Args:
        where: The place: one of `LEAVING`, or ``"init"`` for every episode.
    """

    observation_space = spaces.Box(-9, 9, (1,), np.float64)
    action_space = spaces.Discrete(2)

    def __init__(self, where: str = "step") -> None:
        if where == "init":
            sys.exit(0)
        self._where = where
        self._odd = False
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401, ARG002
        self._odd, self._steps = bool((seed or 0) % 2), 0
        if self._odd and self._where == "reset":
            sys.exit(0)
        return np.array([float(self._odd)]), {}

    def step(self, action: Any) -> Any:  # noqa: ANN401, ARG002
        self._steps += 1
        if self._odd and self._where == "step":
            sys.exit(0)
        return np.array([float(self._odd)]), 0.0, self._steps == 3, False, {}


def leaving_policy(observation: Any) -> int:  # noqa: ANN401
    """A policy that leaves the program in the episodes of odd seeds."""
    if observation[0]:
        sys.exit()
    return 0
