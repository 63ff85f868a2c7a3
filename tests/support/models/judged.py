"""Runs of a scenario in entries, and its requirements by `rtamt.evaluate` and by `simulate`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rtamt_envs import scenario_of
from rtamt_envs.vector import ScenarioVectorEnv

import rtamt
from rtamt_gym import simulate

Floats = NDArray[np.float64]


def observed(name: str, actions: Floats, seed: int = 0, **options: Any) -> Floats:  # noqa: ANN401 - parameters
    """Return observations (entries, steps + 1, observations) under actions (entries, steps,
    actions).
    """
    entries = gym.make_vec(f"rtamt/{name}-v0", num_envs=len(actions))
    assert isinstance(entries, ScenarioVectorEnv)
    first, _ = entries.reset(seed=seed, options=options)
    rest = entries.rollout(np.ascontiguousarray(actions.swapaxes(0, 1)))
    return np.concatenate([first[:, None], rest.swapaxes(0, 1)], axis=1)


def evaluated(name: str, trace: Floats) -> dict[str, float]:
    """Return the robustness of every requirement at sample 0 of a recorded trace."""
    found = scenario_of(name)
    columns = {each.name: trace[:, i] for i, each in enumerate(found.observations)}
    return {
        key: float(rtamt.evaluate(spec, columns, found.period)[0])
        for key, spec in found.specifications.items()
    }


def monitored(name: str, actions: Floats) -> dict[str, tuple[str, float]]:
    """Return the verdict and the robustness of every requirement in a run of the environment."""
    env = gym.make(f"rtamt/{name}-v0")
    found = scenario_of(name)
    steps = iter(actions)
    run = simulate(
        env,
        dict(found.specifications),
        dict(found.signals),
        policy=lambda _: next(steps),
        seed=0,
        stop="end",
    )
    return {
        key: (course.verdict.name, float(course.final)) for key, course in run.histories.items()
    }
