"""When samples of a simulation are due, and whether the simulation keeps to it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NoReturn

from rtamt import StateError

__all__ = ["Clock"]

_TOLERANCE = 0.01
"""In timesteps; times are sums of timesteps, of which a double knows more."""


@dataclass(slots=True)
class Clock:
    """The times of samples, reckoned from the last one that was seen in time.

    Attributes:
        time: Time of that sample.
        sample: Its number.
        timestep: Time between samples.
    """

    time: float = math.nan
    sample: int = 0
    timestep: float = math.nan

    def start(self, now: float, timestep: float) -> None:
        """Sample 0 is now."""
        self.time, self.sample, self.timestep = now, 0, timestep

    def ahead(self, now: float, sample: int) -> float:
        """How many timesteps after the due time of a sample it is now."""
        return (now - self.time) / self.timestep - (sample - self.sample)

    def near(self, ahead: float, place: float) -> bool:
        """Whether a number of timesteps is that of a place."""
        return abs(ahead - place) < _TOLERANCE

    def check(self, now: float, sample: int) -> None:
        """Refuses a time that is not that of the sample.

        Raises:
            StateError: Saying what may have happened.
        """
        if not self.near(self.ahead(now, sample), 0.0):
            self.refuse(now, sample)
        self.time, self.sample = now, sample  # rounding does not add up

    def refuse(self, now: float, sample: int) -> NoReturn:
        """Says that a sample is missing or too many.

        Raises:
            StateError: Always.
        """
        due = self.time + (sample - self.sample) * self.timestep
        raise StateError(
            f"expected the time {due:.12g} s at sample {sample}, got {now:.12g} s: the simulation "
            "was stepped or reset by others, its timestep was changed, or it was unstable, so that "
            "MuJoCo reset it (data.warning); call reset()"
        )
