"""Vector environments, with and without monitors, and comparisons of their trajectories."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from rtamt_gym import StlMonitor

Envs = gym.vector.VectorEnv[Any, Any, Any]
Make = Callable[[], gym.Env[Any, Any]]
MODES = list(AutoresetMode)
ANGLE = {"theta": "obs[2]"}
TEXT = "always(abs(theta) > 0.1 implies eventually[0:0.2](abs(theta) < 0.05))"


def make_pole() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1", max_episode_steps=15)


def make_monitored_pole() -> gym.Env[Any, Any]:
    return StlMonitor(make_pole(), TEXT, ANGLE, on_violation="report")


def sync(makes: Sequence[Make], mode: AutoresetMode) -> Envs:
    return SyncVectorEnv(list(makes), autoreset_mode=mode)


def both(
    one: Callable[..., gym.Env[Any, Any]],
    many: Callable[..., Any],
    makes: Sequence[Make],
    autoreset: AutoresetMode,
    /,
    *arguments: Any,  # noqa: ANN401 - those of the wrappers
    **options: Any,  # noqa: ANN401
) -> tuple[Any, SyncVectorEnv]:
    """Return environments wrapped together, and the same wrapped one by one."""

    def wrapped(make: Make) -> gym.Env[Any, Any]:
        return one(make(), *arguments, **options)

    singles = SyncVectorEnv([partial(wrapped, make) for make in makes], autoreset_mode=autoreset)
    return many(sync(makes, autoreset), *arguments, **options), singles


def native(num: int) -> Envs:
    """Return Gymnasium's own vector environment: one random generator for all."""
    return gym.make_vec("CartPole-v1", num, vectorization_mode="vector_entry_point")


def trajectory(envs: Envs, steps: int, seed: int = 7) -> list[tuple[Any, ...]]:
    """Reset and take random steps; environments of `DISABLED` are reset at their end."""
    envs.action_space.seed(seed)
    shown: list[tuple[Any, ...]] = [envs.reset(seed=seed)]
    for _ in range(steps):
        shown.append(envs.step(envs.action_space.sample()))
        ended = np.logical_or(shown[-1][2], shown[-1][3])
        if envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED and ended.any():
            shown.append(envs.reset(options={"reset_mask": ended}))
    return shown


def difference(left: object, right: object, at: str = "") -> str:
    """Return the first difference of two trajectories, also in types; empty if they are equal."""
    if isinstance(left, dict) and isinstance(right, dict):
        if left.keys() != right.keys():
            return f"{at}: {sorted(left.keys() ^ right.keys())} in one of them alone"
        parts = [difference(left[key], right[key], f"{at}[{key!r}]") for key in left]
    elif isinstance(left, list | tuple) and isinstance(right, list | tuple):
        if len(left) != len(right):
            return f"{at}: {len(left)} and {len(right)} elements"
        pairs = enumerate(zip(left, right, strict=True))
        parts = [difference(a, b, f"{at}[{i}]") for i, (a, b) in pairs]
    else:
        same = data_equivalence(left, right, exact=True)
        return "" if same else f"{at}: {left!r} and {right!r}"
    return next(filter(None, parts), "")
