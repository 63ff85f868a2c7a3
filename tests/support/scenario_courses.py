"""Episodes of scenarios for tests. As a program, it prints the numbers of `courses` of all."""

import json
import sys
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rtamt_envs import SCENARIOS
from rtamt_envs.environment import ScenarioEnv
from rtamt_envs.scenario import Scenario

__all__ = ["course", "courses", "made", "middle", "random_actions", "read_signals"]

Floats = NDArray[np.float64]


def made(name: str, **options: Any) -> ScenarioEnv:  # noqa: ANN401 - those of gym.make
    """Return the bare environment of a scenario."""
    env = gym.make(f"rtamt/{name}-v0", **options).unwrapped
    assert isinstance(env, ScenarioEnv)
    return env


def random_actions(scenario: Scenario, shape: tuple[int, ...], seed: int) -> Floats:
    """Return actions within their bounds, shape (*shape, actions)."""
    low = np.array([each.low for each in scenario.actions])
    high = np.array([each.high for each in scenario.actions])
    return np.random.default_rng(seed).uniform(low, high, (*shape, len(low)))


def read_signals(scenario: Scenario) -> dict[str, str]:
    """Return the signals of a requirement, because wrappers raise an error for others."""
    read = {name for each in scenario.specifications.values() for name in each.variables}
    return {name: signal for name, signal in scenario.signals.items() if name in read}


def middle(scenario: Scenario) -> dict[str, float]:
    """Return the middle of the range of each parameter."""
    return {each.name: 0.5 * (each.low + each.high) for each in scenario.parameters}


def course(
    env: ScenarioEnv, actions: Floats, seed: int = 0, options: dict[str, Any] | None = None
) -> Floats:
    """Return the observations of an episode under these actions, from the reset on."""
    first, _ = env.reset(seed=seed, options=options)
    return np.array([first, *(env.step(action)[0] for action in actions)])


def courses(name: str) -> list[str]:
    """Return all numbers of episodes: random, constant, at bounds, and with the baseline."""
    env = made(name)
    changing = course(env, random_actions(env.scenario, (150,), 6))
    actions = random_actions(env.scenario, (3,), 7).repeat(100, axis=0)
    held = course(env, actions, options=middle(env.scenario))
    entries: Any = gym.make_vec(f"rtamt/{name}-v0", 2).unwrapped
    ends = {each.name: [each.low, each.high] for each in env.scenario.parameters}
    first, _ = entries.reset(seed=8, options=ends)
    low, high = entries.single_action_space.low, entries.single_action_space.high
    chosen = random_actions(env.scenario, (12, 2), 9).repeat(50, axis=0)
    extreme = entries.rollout(np.where(chosen < 0.5 * (low + high), low, high))
    entries.reset(seed=10, options=ends)
    one = np.array([np.append(low[:-1], high[-1:]), np.append(high[:-1], low[-1:])])
    opposite = entries.rollout(np.array([one, one[::-1]]).repeat(200, axis=0))
    entries.reset(seed=11)
    baseline = entries.rollout(600)
    seen = (changing, held, first, extreme, opposite, baseline)
    return [float(value).hex() for value in np.concatenate([each.ravel() for each in seen])]


if __name__ == "__main__":
    sys.stdout.write(json.dumps({name: courses(name) for name in SCENARIOS}))
