"""The history of a requirement since the node was started or reset: its reports are made of it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from rtamt import Verdict
from rtamt_ros.core.record import CsvRecord
from rtamt_ros.core.report import RequirementReport, holds, seconds
from rtamt_ros.core.requirements import SubscribedRequirement
from rtamt_ros.middleware import Level

__all__ = ["Account"]

_NAN = float("nan")
_NO_VALUES: Mapping[str, float] = MappingProxyType({})
_NOTHING = None, None, None, None, None, _NO_VALUES, None
"""The fields of a report from `robustness` to `asked` while nothing was known yet."""
_UNKNOWN = _NAN, None, _NAN, _NAN, Verdict.UNDECIDED, _NO_VALUES, None
"""What is reported in place of what is no longer known."""


class Account:
    """Counts what happens to a requirement, and makes its reports.

    Args:
        requirement: The requirement.
        record: Where its samples go.

    Attributes:
        last: The last report.
        missed: As in `RequirementReport`.
        restarts: As in `RequirementReport`.
        resets: As in `RequirementReport`.
    """

    def __init__(self, requirement: SubscribedRequirement, record: CsvRecord | None = None) -> None:
        self.name = requirement.name
        self.inputs = requirement.inputs
        self.last: RequirementReport | None = None
        self.missed = self.restarts = self.resets = 0
        self._record = record
        self._began = self._waits_for_run = False
        self._reset_at: int | None = None
        self._why = ""
        self._worst: float | None = None
        self._worst_time: int | None = None
        self._violations = 0
        self._violated_at: int | None = None

    def begin(self, why: str) -> None:
        """A run begins; why the one before has ended."""
        if self._began and not self._waits_for_run:
            self.restarts += 1
            self._why = why
        self._began, self._waits_for_run = True, False

    def reset(self, now: int) -> RequirementReport:
        """The report of a time at which somebody asks for a new run; it says what is forgotten.

        The run that begins next is no restart.
        """
        was = "nothing was judged yet"
        if self.last is not None:
            last = self.last._replace(violations=self._violations, violated_at=self._violated_at)
            was = f"was: {last.text}"
        self.resets += 1
        self._reset_at = now
        self._waits_for_run = True
        self._worst = self._worst_time = self._violated_at = None
        self._violations = 0
        unknown = _UNKNOWN if self._began else _NOTHING
        return self._report(now, Level.WARN, f"begins anew; {was}", unknown)

    def found(self, robustness: float, about: int) -> None:
        """A robustness is known."""
        if self._worst is None or robustness < self._worst:
            self._worst, self._worst_time = robustness, about

    def violated(self, time: int) -> None:
        """The violation is certain; once a run."""
        self._violations += 1
        if self._violated_at is None:
            self._violated_at = time

    def without_clock(self) -> RequirementReport:
        """The report before a simulated clock has begun."""
        return self._report(0, Level.WARN, "waiting for the clock")

    def standing(self) -> RequirementReport:
        """The report while a simulated clock stands still: nothing is known of the time since."""
        time = self.last.time if self.last is not None else 0
        unknown = _UNKNOWN if self._began else _NOTHING
        return self._report(time, Level.STALE, "the clock stands still", unknown)

    def why_gone(self, now: int) -> str:
        """Why a run ends whose inputs have not come or are stale."""
        gone = [each.name for each in self.inputs if each.is_gone(now)]
        return f"{', '.join(gone)} {'was' if len(gone) == 1 else 'were'} stale"

    def without(self, now: int) -> RequirementReport:
        """The report while inputs have not come or are stale."""
        waiting = [each for each in self.inputs if each.is_awaited()]
        stale = [each for each in self.inputs if each.is_stale(now)]
        what = ["waiting for " + ", ".join(each.name for each in waiting)] if waiting else []
        what += [f"{each.name} stale {seconds(each.age(now))}" for each in stale]
        what += [each.error for each in (*waiting, *stale) if each.error]
        level = Level.ERROR if any(each.error for each in waiting) else Level.WARN
        return self._report(
            now,
            Level.STALE if stale else level,
            "; ".join(what),
            _UNKNOWN if self._began else _NOTHING,
            stale=tuple(each.name for each in stale),
            waiting=tuple(each.name for each in waiting),
        )

    def without_values(
        self, time: int, ages: Mapping[str, int], bounds: tuple[float, float], verdict: Verdict
    ) -> RequirementReport:
        """The report of a sample in a run that goes on without the values of stale inputs.

        Args:
            time: Of the sample.
            ages: The stale inputs, and for how many nanoseconds nothing came.
            bounds: The least and the greatest robustness of the run.
            verdict: Its verdict.
        """
        what = [f"{name} stale {seconds(age)}" for name, age in ages.items()]
        what += [each.error for each in self.inputs if each.error]
        return self._report(
            time,
            Level.STALE,
            "; ".join(what),
            (_NAN, None, *bounds, verdict, _NO_VALUES, None),
            stale=tuple(ages),
        )

    def failed(self, time: int, reason: str) -> RequirementReport:
        """The report of values that have no robustness, such as ``sqrt(-1)``."""
        return self._report(time, Level.ERROR, reason, _UNKNOWN)

    def judged(
        self,
        time: int,
        robustness: float | None,
        about: int | None,
        bounds: tuple[float, float],
        verdict: Verdict,
        values: Mapping[str, float],
        *,
        may_rise: bool,
        asked: tuple[int, ...] | None = None,
    ) -> RequirementReport:
        """The report of a time at which the monitor has all it needs.

        A negative robustness is no error while it may still rise, as it may for a goal without an
        end.
        """
        errors = [source.error for source in self.inputs if source.error]
        problem = "; ".join(errors) if errors else ""
        level = Level.WARN if problem or self._violations else Level.OK
        if robustness is None:
            level = Level.ERROR if verdict is Verdict.VIOLATED else level
        elif not holds(robustness) and (verdict is Verdict.VIOLATED or not may_rise):
            level = Level.ERROR
        found = robustness, about, *bounds, verdict, values, asked
        return self._report(time, level, problem, found)

    def _report(
        self,
        time: int,
        level: Level,
        problem: str,
        found: tuple[Any, ...] = _NOTHING,
        stale: tuple[str, ...] = (),
        waiting: tuple[str, ...] = (),
    ) -> RequirementReport:
        """The report, with what is found: its fields from the robustness to `asked`."""
        out_of_order = errors = 0
        for source in self.inputs:
            out_of_order += source.out_of_order
            errors += source.errors
        unrecorded = "" if self._record is None else self._record.error
        # By name its 24 fields take half of the time of a judgement.
        self.last = RequirementReport._make(
            (
                self.name,
                time,
                max(level, Level.WARN) if unrecorded else level,
                problem,
                *found,
                self._worst,
                self._worst_time,
                stale,
                waiting,
                self._violations,
                self._violated_at,
                self.missed,
                out_of_order,
                errors,
                self.restarts,
                self._why,
                self.resets,
                self._reset_at,
                unrecorded,
            )
        )
        return self.last
