"""The settings of a node: how it samples, and when an input is stale."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from rtamt import InputError
from rtamt.errors import Argument

StaleAs = Literal["restart", "unknown"]
"""The effect of a stale input: the run ends, or continues with unknown values."""

Publishers = Literal["any", "one"]
"""The number of publishers that a topic may have while a run continues."""

_SECOND = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """The settings of a node.

    Attributes:
        period: Nanoseconds between samples; in dense time, between checks for stale inputs.
        dense: Whether to monitor in dense time: each message is an event, and nothing is sampled.
        stamps: Whether the time of a message is its stamp, if it is set, and not its arrival.
        stale: Seconds without a message after which an input is stale; inf for never. None for five
            periods, at least half a second.
        stale_of: The same for single topics, named as in the specification.
        stale_as: The effect of a stale input. ``"restart"``: the run ends, and the next one starts
            when every input is current again. ``"unknown"``: the run continues with unknown values;
            bounds and verdict hold for all values.
        semantics: As for `rtamt.Monitor`.
        align: As for `rtamt.Monitor`; not in dense time.
        record: A CSV file for times, variables and robustness of every sample, or of every event in
            dense time. ``rtamt monitor`` computes the same robustness from it. Each further run has
            its own file, ``NAME-2.csv``, and so has each of several requirements,
            ``NAME-REQUIREMENT.csv``.
        publishers: ``"one"``: there is no run while a topic has several publishers. ``"any"``: a
            run continues, with a warning.
        combined: A topic for one message per sample with all requirements, as
            `rtamt_ros.core.publishing.Combined` describes; empty for none.

    Raises:
        InputError: If a time is not positive, or if `align` or `combined` is set in dense time.
    """

    period: int = 100_000_000
    dense: bool = False
    stamps: bool = False
    stale: float | None = None
    stale_of: Mapping[str, float] = field(default_factory=dict)
    stale_as: StaleAs = "restart"
    semantics: str = "standard"
    align: str | None = None
    record: Path | None = None
    combined: str = ""
    publishers: Publishers = "any"

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.period <= 0 or self.period != int(self.period):
            raise InputError(
                f"expected a whole number of nanoseconds as the period, got {self.period}"
            )
        if self.dense and self.align is not None:
            raise InputError(
                Argument("align"), " cannot be set in dense time, which has no samples to round to"
            )
        if self.dense and self.combined:
            raise InputError(
                Argument("combined"),
                " cannot be set in dense time, where requirements are known up to different times",
            )
        for topic, seconds in {"": self.stale, **self.stale_of}.items():
            if seconds is not None and not seconds > 0:
                where = f" of {topic}" if topic else ""
                raise InputError(
                    f"expected seconds above 0 until an input is stale{where}, got {seconds}; inf "
                    "is never"
                )

    @property
    def gap(self) -> int:
        """The nanoseconds from which a delay is a gap: five periods, at least half a second."""
        return max(5 * self.period, _SECOND // 2)

    def stale_after(self, topic: str) -> float:
        """Return the nanoseconds without a message after which an input is stale."""
        seconds = self.stale_of.get(topic, self.stale)
        if seconds is None:
            return self.gap
        return seconds if math.isinf(seconds) else round(seconds * _SECOND)
