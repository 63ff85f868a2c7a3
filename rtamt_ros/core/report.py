"""What a monitor says of a requirement at one time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rtamt import Verdict
from rtamt_ros.middleware import Level

__all__ = ["Report"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What a monitor says of a requirement at one time.

    Attributes:
        name: The name of the requirement.
        time: Nanoseconds of the clock of ROS: the time of the last sample; in dense time the one up
            to which the robustness is known. The time of the look while there is neither.
        level: How bad it is.
        text: One line: ``"satisfied so far"``, ``"waiting for odom"``, ``"odom stale 0.4 s"``.
        robustness: None while nothing can be said: an input has not come, or the latency has not
            passed since the start. nan while an input is stale.
        about: The time that the robustness is about: `time` less the latency. None without a
            robustness.
        values: The robustness of every named formula of the requirement, under the same rule.
        lower: The least robustness since the last start, over all continuations; nan while an input
            is stale; None before the first sample.
        upper: The greatest.
        verdict: The verdict since the last start; UNDECIDED while an input is stale; None before
            the first sample.
        worst: The least robustness since the node was started; None before the first.
        worst_time: The time that it is about.
        stale: The inputs that are stale.
        waiting: The inputs that have not come.
        violations: Runs of the monitor in which a violation was certain.
        violated_at: The time at which the first of them was.
        missed: Samples for which the timer came too late, and which have the values held then.
        out_of_order: Messages left out because they are older than the one before.
        errors: Messages left out because a field was nan, or was not there.
        restarts: How often the monitor began anew, after a gap or a jump of the clock.
    """

    name: str
    time: int
    level: Level
    text: str
    robustness: float | None = None
    about: int | None = None
    values: Mapping[str, float | None] = field(default_factory=dict)
    lower: float | None = None
    upper: float | None = None
    verdict: Verdict | None = None
    worst: float | None = None
    worst_time: int | None = None
    stale: tuple[str, ...] = ()
    waiting: tuple[str, ...] = ()
    violations: int = 0
    violated_at: int | None = None
    missed: int = 0
    out_of_order: int = 0
    errors: int = 0
    restarts: int = 0
