"""A small environment, its policies, and an independent loop that counts like an evaluation."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

import rtamt

SPECS = {"low": "always(x < 1)", "early": "eventually[0:3](x > 0.5)"}
SIGNALS = {"x": "obs[0]"}


class Walk(gym.Env[Any, Any]):
    """A walk by its own steps and by the policy, which terminates far from the start.

    Args:
        steps: The time limit.
        goal: The distance at which it terminates.
        cursed: A seed whose episode raises an error at its second step.
    """

    observation_space = spaces.Box(-100.0, 100.0, (2,), np.float32)
    action_space = spaces.Discrete(3)
    control_timestep = 0.5

    def __init__(self, steps: int = 12, goal: float = 3.0, cursed: int | None = None) -> None:
        self._steps, self._goal, self._cursed = steps, goal, cursed

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401
        super().reset(seed=seed, options=options)
        self._seed, self._count = seed, 0
        self._x = float(self.np_random.uniform(-1, 1))
        return self._shown(), {}

    def step(self, action: Any) -> Any:  # noqa: ANN401
        self._count += 1
        if self._seed is not None and self._seed == self._cursed and self._count == 2:
            raise ValueError("a cursed step")
        self._x += float(self.np_random.normal(0, 0.3)) + 0.4 * (int(action) - 1)
        over = abs(self._x) > self._goal
        return self._shown(), self._x, over, not over and self._count >= self._steps, {}

    def _shown(self) -> Any:  # noqa: ANN401
        return np.array([self._x, self._count], np.float32)


class Model:
    """A recurrent model: its action depends on the number of steps in its memory."""

    def predict(
        self,
        observation: Any,  # noqa: ANN401
        state: Any = None,  # noqa: ANN401
        episode_start: Any = None,  # noqa: ANN401
        deterministic: bool = False,  # noqa: FBT001, FBT002 - as Stable-Baselines3 has it
    ) -> tuple[Any, Any]:
        assert deterministic
        batch = np.atleast_2d(observation)
        memory = np.zeros(len(batch)) if state is None else np.where(episode_start, 0.0, state)
        assert np.shape(episode_start) == (len(batch),)
        actions = (batch[:, 0] + np.sin(memory) > 0).astype(np.int64) + (memory % 3 == 2)
        return actions if np.ndim(observation) > 1 else actions[0], memory + 1


def acts() -> Any:  # noqa: ANN401
    """`Model`, written as a function of one episode."""
    memory = 0

    def act(obs: Any) -> int:  # noqa: ANN401
        nonlocal memory
        action = int(obs[0] + np.sin(float(memory)) > 0) + (memory % 3 == 2)
        memory += 1
        return action

    return act


def by_hand(env: Any, seed: int, specs: dict[str, str]) -> dict[str, Any]:  # noqa: ANN401
    """Play an episode of `Model` in a loop; judge its samples at the end."""
    obs, _ = env.reset(seed=seed)
    act = acts()
    xs, total, over, cut = [float(obs[0])], 0.0, False, False
    while not (over or cut):
        obs, reward, over, cut, _ = env.step(act(obs))
        xs.append(float(obs[0]))
        total += reward
    found: dict[str, Any] = {"return": total, "steps": len(xs) - 1, "terminated": over}
    for name, text in specs.items():
        monitor = rtamt.EpisodeMonitor(text, period=0.5)
        for x in xs:
            monitor.update(x)
        monitor.finish("complete" if over else "cut")
        found[name] = monitor.robustness, monitor.verdict
    return found
