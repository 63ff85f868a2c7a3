"""Systems that fail in half of their space."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium as gym
from gymnasium.envs.classic_control import CartPoleEnv

__all__ = ["HalfCart", "half"]


def half(x: float) -> Iterator[Mapping[str, float]]:
    """A system that fails up to 0.5, after a sample."""
    yield {"z": x}
    if x <= 0.5:
        raise ValueError("no step of the solver is small enough to go on " * 9)


class HalfCart(CartPoleEnv):
    """A cart that fails at high gravity."""

    def step(self, action: Any) -> Any:  # noqa: ANN401
        if self.gravity > 5:
            raise ValueError("too heavy")
        stepped: Any = super().step(action)  # type: ignore[no-untyped-call]
        return stepped


# The search for examples imports this file under another name.
if "HalfCart-v0" not in gym.registry:
    gym.register("HalfCart-v0", "failing_systems:HalfCart", max_episode_steps=5)
