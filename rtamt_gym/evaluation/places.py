"""One environment of a vector environment as a system; what stands below a vector monitor."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from gymnasium.vector import VectorEnv, VectorWrapper

from rtamt_gym.simulation.systems import Signals, System, SystemEnd

__all__ = ["Place", "VectorTap"]


class Place(System):
    """One environment of a vector environment, whose steps all make together.

    Attributes:
        end: How the last step has ended the episode.
        error: What the last step has raised, if it did.
        reward: The sum of the rewards of the episode.

    Args:
        name: The name of the environment.
        period: Seconds between samples.
        limit: The time limit in steps.
    """

    observation: Any = None

    def __init__(self, name: str, period: Any, limit: int | None) -> None:  # noqa: ANN401
        self.name, self.period, self.limit = name, period, limit
        self.ended: SystemEnd = ""
        self.end: SystemEnd = ""
        self.error: Exception | None = None
        self.reward = 0.0
        self._values: list[float] = []

    def take(self, values: Any, reward: Any) -> None:  # noqa: ANN401
        """Takes a sample and the reward of its step; None at a reset."""
        self._values, self.end = values.tolist(), ""
        self.reward = 0.0 if reward is None else self.reward + float(reward)

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Has nothing to do: the signals of all environments are read together."""

    def start(self) -> list[float]:
        """Gives sample 0, which was taken before."""
        self.ended, self.error = "", None
        return self._values

    def advance(self) -> list[float]:
        """Gives the sample that was taken last, or raises what that step has raised."""
        if self.error is not None:
            raise self.error
        self.ended = self.end
        return self._values

    def close(self) -> None:
        """Has nothing to close."""


class VectorTap(VectorWrapper):
    """Stands between a vector monitor and its environment, and keeps what the monitor is shown.

    Attributes:
        shown: Observations and infos of the last reset.
        actions: The actions of the last step.
        result: What the last step has given.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self.shown: tuple[Any, Any] = None, {}
        self.actions: Any = None
        self.result: Any = None

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
        """Resets the environment."""
        obs, infos = self.shown = self.env.reset(**options)
        return obs, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:  # noqa: ANN401
        """Steps the environment."""
        self.actions = actions
        result = self.result = self.env.step(actions)
        return result
