"""Environments of three simulators, with specifications for them, and their rollouts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
from gymnasium.utils.env_checker import data_equivalence

from rtamt_gym import StlMonitor

Env = gym.Env[Any, Any]


@dataclass(frozen=True)
class Case:
    """An environment, its specifications, and the selectors of their signals."""

    env_id: str
    specs: str | dict[str, str]
    signals: dict[str, Any]

    def bare(self) -> Env:
        return gym.make(self.env_id)

    def monitored(self, **arguments: Any) -> Env:  # noqa: ANN401
        return StlMonitor(self.bare(), self.specs, self.signals, **arguments)


CASES = [
    Case(
        "CartPole-v1",
        "always(abs(theta) > 0.1 implies eventually[0:0.2](abs(theta) < 0.05))",
        {"theta": "obs[2]"},
    ),
    Case(
        "Pendulum-v1",
        {
            "calm": "always(abs(speed) < 7.5)",
            "effort": "always(u > 1 implies eventually[0:1](u < 1))",
            "paid": "eventually[0:5](cost > -0.1)",
        },
        {"speed": "obs[2]", "u": ("action[0]", 0.0), "cost": ("reward", 0.0)},
    ),
    Case(
        "HalfCheetah-v5",
        {
            "upright": "always(abs(pitch) < 1)",
            "runs": "eventually[0:2](always[0:0.5](v > 1))",
            "low": "always(vz < 3)",
        },
        {"pitch": "qpos[2]", "vz": "qvel[1]", "v": ("info['x_velocity']", 0.0)},
    ),
    Case(
        "highway_env:highway-fast-v0",
        {
            "safe": "always(crashed < 0.5)",
            "swift": "always(v < 0.2 implies eventually[0:5](v > 0.25))",
        },
        {"crashed": ("info['crashed']", 0.0), "v": "obs[0][3]"},
    ),
    Case(
        "highway_env:parking-v0",
        "eventually[0:10](abs(x - goal_x) < 0.05 and abs(y - goal_y) < 0.05)",
        {
            "x": "obs['achieved_goal'][0]",
            "y": "obs['achieved_goal'][1]",
            "goal_x": "obs['desired_goal'][0]",
            "goal_y": "obs['desired_goal'][1]",
        },
    ),
]

STEPS = 12


def rollout(env: Env, seed: int = 7, steps: int = STEPS) -> list[tuple[Any, ...]]:
    """Reset, then take random steps until the end of the episode or a limit."""
    obs, info = env.reset(seed=seed)
    # The reset info of highway-env holds a random action, which does not depend on the seed.
    info = {key: value for key, value in info.items() if key != "action"}
    return [(obs, info), *continued(env, seed, steps)]


def continued(env: Env, seed: int, steps: int) -> list[tuple[Any, ...]]:
    env.action_space.seed(seed)
    results: list[tuple[Any, ...]] = []
    for _ in range(steps):
        results.append(env.step(env.action_space.sample()))
        if results[-1][2] or results[-1][3]:
            break
    return results


def equal(left: object, right: object) -> bool:
    return data_equivalence(left, right, exact=True)


def restored(env: Env, original: Env) -> Env:
    """Return a copy of the environment in the state of the original.

    Gymnasium's MuJoCo environments pickle their constructor arguments, not their state.
    """
    simulation: Any = env.unwrapped
    if hasattr(simulation, "model"):
        source: Any = original.unwrapped
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(source.model, kind))
        mujoco.mj_getState(source.model, source.data, state, kind)
        mujoco.mj_setState(simulation.model, simulation.data, state, kind)
    return env
