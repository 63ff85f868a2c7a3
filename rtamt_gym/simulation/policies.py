"""Environments by their id and policies that need no training, for the command line."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from rtamt import InputError
from rtamt_gym.simulation.systems import Policy

__all__ = ["POLICIES", "SeededPolicy", "import_highway", "make"]

SeededPolicy = Callable[[int], Policy]
"""Makes the policy of an episode from the seed of the episode."""


def make(env_id: str, max_steps: int | None = None) -> gym.Env[Any, Any]:
    """Makes the environment of an id; the user need not import highway-env first.

    Args:
        env_id: The id that `gymnasium.make` takes.
        max_steps: Time limit in steps; None: the environment's own.

    Raises:
        InputError: If there is no such environment (names the nearest), or it cannot be made.
    """
    name = env_id.rpartition(":")[2].rpartition("-v")[0]
    if ":" not in env_id and not _known(name) and find_spec("highway_env"):
        import_highway()
    try:
        return gym.make(env_id, max_episode_steps=max_steps, disable_env_checker=True)
    except (gym.error.Error, ModuleNotFoundError) as error:
        hint = ""
        if isinstance(error, gym.error.NameNotFound) and not find_spec("highway_env"):
            hint = "; the environments of highway-env need pip install '.[highway]'"
        raise InputError(f"cannot make {env_id}: {error}{hint}") from error


def import_highway() -> None:
    """Registers the environments of highway-env."""
    # Without this, pygame prints a greeting on stdout.
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import_module("highway_env")


def _known(name: str) -> bool:
    return any(spec.id.rpartition("-v")[0] == name for spec in gym.registry.values())


def _random(space: spaces.Space[Any]) -> SeededPolicy:
    def make_policy(seed: int) -> Policy:
        space.seed(seed)
        return lambda _obs: space.sample()

    return make_policy


def _zero(space: spaces.Space[Any]) -> SeededPolicy:
    match space:
        case spaces.Box():
            action: Any = np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
        case spaces.Discrete():
            action = int(space.start)
        case spaces.MultiDiscrete() | spaces.MultiBinary():
            action = np.zeros(space.shape, space.dtype)
        case _:
            raise InputError(f"--policy zero: expected a space of numbers, got {space}")
    return lambda _seed: lambda _obs: action


POLICIES: Mapping[str, Callable[[spaces.Space[Any]], SeededPolicy]] = {
    "random": _random,
    "zero": _zero,
}
"""Policies that need no training, by name: what makes them for a space of actions."""
