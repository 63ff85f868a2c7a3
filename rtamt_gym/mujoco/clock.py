"""The times at which samples of a simulation are due, and a check of the simulation's time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rtamt import StateError

__all__ = ["StepClock"]

_TOLERANCE = 0.01
"""In timesteps; the time of a simulation is a sum of timesteps, which rounding changes by less."""


@dataclass(slots=True)
class StepClock:
    """The times of samples, counted from the last sample whose time was checked.

    Attributes:
        time: Time of that sample.
        sample: Number of that sample.
        timestep: Time between samples.
    """

    time: float = math.nan
    sample: int = 0
    timestep: float = math.nan

    def start(self, now: float, timestep: float) -> None:
        """Sets the time of sample 0."""
        self.time, self.sample, self.timestep = now, 0, timestep

    def ahead(self, now: float, sample: int) -> float:
        """How many timesteps ``now`` is after the due time of a sample."""
        return (now - self.time) / self.timestep - (sample - self.sample)

    def near(self, ahead: float, place: float) -> bool:
        """Whether a number of timesteps equals ``place``, up to rounding."""
        return abs(ahead - place) < _TOLERANCE

    def check(self, now: float, sample: int) -> None:
        """Refuses a time other than the sample's: a sample is missing, or one too many.

        Raises:
            StateError: With what may have happened.
        """
        if not self.near(self.ahead(now, sample), 0.0):
            due = self.time + (sample - self.sample) * self.timestep
            raise StateError(
                f"expected the time {due:.12g} s at sample {sample}, got {now:.12g} s: the "
                "simulation was stepped or reset by others, its timestep was changed, or it was "
                "unstable, so that MuJoCo reset it (data.warning); call reset()"
            )
        self.time, self.sample = now, sample  # rounding does not add up
