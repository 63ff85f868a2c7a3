"""Stand-ins for robosuite and Meta-World with the parts that the adapters read."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

__all__ = ["install"]


class _Lift:
    """A task of robosuite: a cube rises by the action, and ends above 0.05."""

    control_timestep, action_spec = 0.1, (np.array([-1.0]), np.array([1.0]))

    def __init__(self, horizon: int = 8, seed: int | None = None, **made: Any) -> None:  # noqa: ANN401
        self.horizon, self.made = horizon, made
        self.rng = np.random.default_rng(seed)
        self.timestep, self.height = 0, 0.0
        self.sim = SimpleNamespace(
            model=SimpleNamespace(_model="model"), data=SimpleNamespace(_data="data")
        )

    def reset(self) -> dict[str, Any]:
        self.timestep, self.height = 0, float(self.rng.uniform(0.0, 0.01))
        return self._shown()

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, dict[str, Any]]:  # noqa: ANN401
        self.timestep += 1
        self.height += 0.02 * float(action[0])
        return self._shown(), self.height, self.timestep >= self.horizon, {"own": 1}

    def _shown(self) -> dict[str, Any]:
        shown = {"height": self.height, "place": np.array([self.height, 1.0])}
        if self.made.get("picture"):
            shown["picture"] = np.full((2, 3, 3), 200, np.uint8)
        return shown

    def _check_success(self) -> bool:
        return self.height > 0.05

    def close(self) -> None:
        self.horizon = 0


class _Door(gym.Env[Any, Any]):
    """Meta-World's door: opens along -x, and the flag is a band of 0.08 about the target."""

    observation_space = spaces.Box(-np.inf, np.inf, (39,), np.float64)
    action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)
    control_timestep = 0.0125

    def __init__(self, **made: Any) -> None:  # noqa: ANN401
        self.made = made
        self._target_pos = np.array([-0.3, 0.4, 0.1])

    def set_task(self, task: float) -> None:
        self._start = task

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self._x, self._count = self._start, 0
        return self._shown(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        self._x += 0.01 * float(action[0])
        self._count += 1
        done = abs(self._x - self._target_pos[0]) <= 0.08
        return self._shown(), 0.0, False, self._count == 80, {"success": float(done)}

    def _shown(self) -> Any:  # noqa: ANN401
        shown = np.zeros(39)
        shown[4] = self._x
        return shown


class _Pushes:
    """The scripted policy: opens the door further than the band."""

    def get_action(self, _observation: Any) -> Any:  # noqa: ANN401
        return np.array([-2.0, 0.0, 0.0, 0.0])


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the packages by the stand-ins, for one test."""
    robosuite: Any = ModuleType("robosuite")
    robosuite.make = lambda _task, **made: _Lift(**made)
    metaworld: Any = ModuleType("metaworld")
    policies: Any = ModuleType("metaworld.policies")
    metaworld.MT1 = lambda name, seed: SimpleNamespace(  # noqa: ARG005 - as the package has it
        train_classes={name: _Door}, train_tasks=[0.0, 0.02, 0.04]
    )
    policies.ENV_POLICY_MAP = {"door-open-v3": _Pushes}
    for module in (robosuite, metaworld, policies):
        monkeypatch.setitem(sys.modules, module.__name__, module)
