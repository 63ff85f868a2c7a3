"""How a node samples, and when an input is stale."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from rtamt import InputError
from rtamt.errors import Argument

StaleAs = Literal["restart", "unknown"]
"""What a stale input does to a run: it ends it, or its values are not known in it."""

_SECOND = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How a node samples, and when an input is stale.

    Attributes:
        period: Nanoseconds between samples. In dense time, those between looks for stale inputs.
        dense: Whether to monitor in dense time: a message is an event at its time, and nothing is
            sampled.
        stamps: Whether the time of a message is the one in its header, where it has one that is
            set; else it is the time at which it came.
        stale: Seconds without a message after which an input is stale; inf: never. None: five
            periods, and at least half a second.
        stale_of: The same for single topics, named as in the specification.
        stale_as: What a stale input does. ``"restart"``: the run ends, and the next begins when
            every input is there again. ``"unknown"``: the run goes on, and nothing is known of the
            input meanwhile; bounds and verdict hold for whatever it was.
        semantics: As for `rtamt.Monitor`.
        align: As for `rtamt.Monitor`; dense time has no samples to round to.
        record: A CSV file for times, variables and robustness of every sample, or in dense time for
            every event: ``rtamt monitor`` finds the same robustness. A run of the monitor after a
            restart has a file of its own, ``NAME-2.csv``; of several requirements each has,
            ``NAME-REQUIREMENT.csv``.
        combined: A topic for one message a sample with what is known of all requirements, as
            `rtamt_ros.core.publishing.Combined` says; empty: none.

    Raises:
        InputError: On a period or a time that is not positive, or on `align` or `combined` in dense
            time.
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

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.period <= 0 or self.period != int(self.period):
            raise InputError(
                f"expected a whole number of nanoseconds as the period, got {self.period}"
            )
        if self.dense and self.align is not None:
            raise InputError(
                "expected ", Argument("align"), " or dense time, which has no samples to round to"
            )
        if self.dense and self.combined:
            raise InputError(
                "expected ",
                Argument("combined"),
                " or dense time, where requirements are known up to times of their own",
            )
        for topic, seconds in {"": self.stale, **self.stale_of}.items():
            if seconds is not None and not seconds > 0:
                of = f" of {topic}" if topic else ""
                raise InputError(
                    f"expected seconds until an input is stale{of}, more than 0, got {seconds}; "
                    "inf is never"
                )

    @property
    def gap(self) -> int:
        """Nanoseconds that are no delay but a gap: five periods, and at least half a second."""
        return max(5 * self.period, _SECOND // 2)

    def stale_after(self, topic: str) -> float:
        """Nanoseconds without a message after which an input is stale; inf: never."""
        seconds = self.stale_of.get(topic, self.stale)
        if seconds is None:
            return self.gap
        return seconds if math.isinf(seconds) else round(seconds * _SECOND)
