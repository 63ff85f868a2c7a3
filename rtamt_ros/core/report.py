"""What a monitor says of a requirement at one time."""

from __future__ import annotations

from collections.abc import Mapping
from math import copysign
from types import MappingProxyType
from typing import NamedTuple

from rtamt import Verdict
from rtamt_ros.middleware import Level

__all__ = ["RequirementReport", "counted", "holds", "seconds"]

_NO_VALUES: Mapping[str, float] = MappingProxyType({})


class RequirementReport(NamedTuple):
    """What a monitor says of a requirement at one time.

    Attributes:
        name: The name of the requirement.
        time: Nanoseconds of the clock of ROS: the time of the last sample; in dense time the one up
            to which the robustness is known. The time of the look while there is neither.
        level: How bad it is.
        problem: Why there is no robustness, or what is wrong with an input; empty if all is well.
        robustness: None while nothing can be said: an input has not come, or the latency has not
            passed since the start. nan while an input is stale.
        about: The time that the robustness is about: `time` less the latency. None without a
            robustness.
        lower: The least robustness since the last start, over all continuations and ends; nan while
            an input is stale, unless its values count as unknown; None before the first sample.
        upper: The greatest.
        verdict: The verdict since the last start; UNDECIDED while an input is stale, unless its
            values count as unknown; None before the first sample.
        values: The robustness of every named formula of the requirement, nan until its own latency
            has passed; empty while there is nothing to say.
        asked: For each implication that the requirement asks at every sample the samples of the run
            at which its left side holds for certain; None where they are not counted.
        worst: The least robustness since the node was started or reset; None before the first.
        worst_time: The time that it is about.
        stale: The inputs that are stale.
        waiting: The inputs that have not come.
        violations: Runs of the monitor since then in which a violation was certain.
        violated_at: The time at which the first of them was.
        missed: Samples that were judged so late that the next was due; their values are right.
        out_of_order: Messages left out because they are older than the one before.
        errors: Messages left out because a field was nan, or was not there.
        restarts: How often the monitor began anew, after a gap or a jump of the clock.
        restarted_because: Why it did so last.
        resets: How often it was told to begin anew, which is no restart.
        reset_at: When it was told so last; None: never.
        unrecorded: Why samples are no longer recorded, where they were to be.
    """

    name: str
    time: int
    level: Level
    problem: str = ""
    robustness: float | None = None
    about: int | None = None
    lower: float | None = None
    upper: float | None = None
    verdict: Verdict | None = None
    values: Mapping[str, float] = _NO_VALUES
    asked: tuple[int, ...] | None = None
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
    restarted_because: str = ""
    resets: int = 0
    reset_at: int | None = None
    unrecorded: str = ""

    @property
    def text(self) -> str:
        """All of it in one line, ``"holds so far, robustness 0.5"`` or ``"odom stale 0.4 s"``."""
        parts = [self._robustness_text(), self.problem]
        if self.violations:
            times, at = counted(self.violations, "time"), seconds(self.violated_at or 0, 3)
            since = "start" if self.reset_at is None else "the reset"
            parts.append(f"violated {times} since {since}, first at {at}")
        if self.restarts:
            last = "" if self.restarts == 1 else ", the last"
            times = counted(self.restarts, "time")
            parts.append(f"restarted {times}{last} because {self.restarted_because}")
        if self.reset_at is not None:
            times, at = counted(self.resets, "time"), seconds(self.reset_at, 3)
            parts.append(f"reset {times}, {'the last ' if self.resets > 1 else ''}at {at}")
        if self.missed:
            parts.append(f"{counted(self.missed, 'sample')} late")
        if self.unrecorded:
            parts.append(f"nothing is recorded any more: {self.unrecorded}")
        return "; ".join(part for part in parts if part)

    def _robustness_text(self) -> str:
        robustness, violated = self.robustness, self.verdict is Verdict.VIOLATED
        if self.verdict is None or robustness != robustness:  # noqa: PLR0124 - nan
            return ""
        if robustness is None:
            return "violated, robustness not known yet" if violated else "robustness not known yet"
        said = "holds" if violated else "holds so far"
        if not holds(robustness):
            said = "violated" if violated else "does not hold"
            said = "not yet" if self.level < Level.ERROR else said
        elif self.verdict is Verdict.SATISFIED:
            said = "satisfied"
        at = ""
        if self.about is not None and self.about != self.time:
            at = f" at {seconds(self.about, 3)}"
        return f"{said}, robustness {robustness:.4g}{at}"


def holds(robustness: float) -> bool:
    """`rtamt.holds` for one number, in a hundredth of the time."""
    return copysign(1.0, robustness) > 0


def seconds(nanoseconds: float, digits: int = 1) -> str:
    """A duration or a time for a reader: ``0.4 s``."""
    return f"{nanoseconds / 1e9:.{digits}f} s"


def counted(count: int, what: str) -> str:
    """A number of things for a reader: ``2 samples``."""
    return f"{count} {what}{'' if count == 1 else 's'}"
