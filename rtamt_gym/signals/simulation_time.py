"""The time of a simulation, as its simulator counts it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import gymnasium as gym
from gymnasium.wrappers import TimeLimit

__all__ = ["SimulationClock", "StepCount", "clock_of"]


class SimulationClock(Protocol):
    """The time of a simulation.

    Attributes:
        what: Its name, for messages.
    """

    what: ClassVar[str]

    def read(self) -> float:
        """Return the time in seconds."""


@dataclass(frozen=True, slots=True)
class _DataTime:
    """The time of MuJoCo, which each step of the physics advances."""

    simulation: Any
    what: ClassVar[str] = "data.time"

    def read(self) -> float:
        return float(self.simulation.data.time)


@dataclass(frozen=True, slots=True)
class _RoadTime:
    """The time of highway-env's roads, whose physics steps `steps` counts.

    highway-env's own ``time`` grows by ``1 / policy_frequency`` an action, whatever the physics do.
    """

    simulation: Any
    what: ClassVar[str] = "its physics steps"

    def read(self) -> float:
        return float(self.simulation.steps / self.simulation.config["simulation_frequency"])


@dataclass(frozen=True, slots=True)
class StepCount:
    """The steps that the innermost `TimeLimit` counts, each as long as the environment states."""

    limit: Any
    period: float
    what: ClassVar[str] = "the steps that its TimeLimit counts"

    @classmethod
    def of(cls, env: Any, period: float) -> StepCount | None:  # noqa: ANN401
        """Return the count of an environment, or None without a `TimeLimit`."""
        limit: Any = None
        while isinstance(env, gym.Wrapper):
            if isinstance(env, TimeLimit):
                limit = env
            env = env.env
        if limit is None or not isinstance(getattr(limit, "_elapsed_steps", None), int | None):
            return None
        return cls(limit, period)

    def read(self) -> float:
        """Return the time in seconds."""
        return (self.limit._elapsed_steps or 0) * self.period  # noqa: SLF001 - no public count


def clock_of(simulation: Any) -> SimulationClock | None:  # noqa: ANN401 - an environment without wrappers
    """Return the time of a simulation of MuJoCo or highway-env; None for all others."""
    mujoco = sys.modules.get("mujoco")  # a simulation of it has loaded it
    if mujoco is not None and isinstance(getattr(simulation, "data", None), mujoco.MjData):
        return _DataTime(simulation)
    config = getattr(simulation, "config", None)
    if (
        isinstance(config, Mapping)
        and {"policy_frequency", "simulation_frequency"} <= config.keys()
        and isinstance(getattr(simulation, "steps", None), int)
    ):
        return _RoadTime(simulation)
    return None
