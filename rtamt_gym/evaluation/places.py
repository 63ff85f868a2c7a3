"""One environment of a vector environment as a system."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rtamt_gym.simulation.systems import Signals, System, SystemEnd

__all__ = ["Place"]


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
