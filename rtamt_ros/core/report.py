"""The reports of a requirement, and the history that they summarize."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import copysign
from types import MappingProxyType
from typing import Any, NamedTuple

from rtamt import Verdict
from rtamt.inputs.stamps import AHEAD
from rtamt_ros.core.inputs import TopicEvidence
from rtamt_ros.core.record import CsvRecord
from rtamt_ros.core.requirements import SubscribedRequirement
from rtamt_ros.middleware import Level

_NO_VALUES: Mapping[str, float] = MappingProxyType({})


class RequirementReport(NamedTuple):
    """The state of a requirement at one time.

    Attributes:
        name: The name of the requirement.
        time: Nanoseconds of the ROS clock: the time of the last sample, or in dense time the time
            up to which robustness is known; without a sample, the time of the look.
        level: The severity.
        problem: Why there is no robustness, or what is wrong with an input; otherwise empty.
        robustness: None while an input is missing or the latency has not passed; nan while an input
            is stale.
        about: The time of the robustness: `time` minus the latency. None without a robustness.
        lower: The minimum robustness of the run over all continuations and ends. nan while an input
            is stale, unless stale values count as unknown; None before the first sample.
        upper: The maximum, likewise.
        verdict: The verdict on the run. UNDECIDED while an input is stale, unless stale values
            count as unknown; None before the first sample.
        values: The robustness of every named formula, nan until its latency has passed.
        asked: The number of triggers in the run of each implication under an outer ``always``; None
            if they are not counted.
        worst: The minimum robustness since the start or reset of the node; None before the first.
        worst_time: The time of `worst`.
        stale: The stale inputs.
        waiting: The inputs that have neither a message nor a default that counts.
        defaults: The inputs with a default that counts, as texts: ``limit = 0.5``.
        violations: The number of runs since the start or reset with a certain violation.
        violated_at: The time of the first certain violation.
        missed: The number of samples evaluated after the next was due; their values are right.
        out_of_order: The number of messages left out because an earlier message is newer.
        strays: The number of messages left out because their stamps are out of line.
        ahead: The number of messages whose stamps are ahead of the clock.
        errors: The number of messages left out because a field was nan or missing.
        restarts: The number of runs that followed a gap or a jump of the clock.
        restarted_because: The reason for the last restart.
        resets: The number of resets on request.
        reset_at: The time of the last reset; None before.
        late_arrivals: The number of messages that arrived before a sample and were taken after its
            evaluation.
        lost: The known number of messages that were sent but never taken.
        losses: A text for each topic: the number of lost messages, or why it is unknown.
        unrecorded: Why the record has ended; empty while it continues.
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
    defaults: tuple[str, ...] = ()
    violations: int = 0
    violated_at: int | None = None
    missed: int = 0
    out_of_order: int = 0
    strays: int = 0
    ahead: int = 0
    errors: int = 0
    restarts: int = 0
    restarted_because: str = ""
    resets: int = 0
    reset_at: int | None = None
    late_arrivals: int = 0
    lost: int = 0
    losses: tuple[str, ...] = ()
    unrecorded: str = ""

    @property
    def loses(self) -> bool:
        """Whether messages were lost."""
        return self.lost > 0

    @property
    def text(self) -> str:
        """The report in one line: ``"holds so far, robustness 0.5"``, ``"odom stale 0.4 s"``."""
        parts = [self._robustness_text(), self.problem]
        if self.defaults:
            parts.append(f"by default {', '.join(self.defaults)}")
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
        if self.lost:
            parts.append(f"lost messages: {', '.join(self.losses)}")
        if self.late_arrivals:
            parts.append(f"{counted(self.late_arrivals, 'message')} taken late")
        if self.strays:
            parts.append(f"{counted(self.strays, 'message')} out of line left out")
        if self.unrecorded:
            parts.append(f"the record has ended: {self.unrecorded}")
        return "; ".join(part for part in parts if part)

    def _robustness_text(self) -> str:
        robustness, violated = self.robustness, self.verdict is Verdict.VIOLATED
        if self.verdict is None or robustness != robustness:  # noqa: PLR0124 - nan
            return ""
        if robustness is None:
            return "violated, robustness not known yet" if violated else "robustness not known yet"
        words = "holds" if violated else "holds so far"
        if not holds(robustness):
            words = "violated" if violated else "does not hold"
            words = "not yet" if self.level < Level.ERROR else words
        elif self.verdict is Verdict.SATISFIED:
            words = "satisfied"
        at = ""
        if self.about is not None and self.about != self.time:
            at = f" at {seconds(self.about, 3)}"
        return f"{words}, robustness {robustness:.4g}{at}"


def holds(robustness: float) -> bool:
    """Return `rtamt.holds` of a number, a hundred times as fast."""
    return copysign(1.0, robustness) > 0


def seconds(nanoseconds: float, digits: int = 1) -> str:
    """Return a duration or a time as a text: ``0.4 s``."""
    return f"{nanoseconds / 1e9:.{digits}f} s"


def counted(count: int, noun: str) -> str:
    """Return a count as a text: ``2 samples``."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


_NAN = float("nan")
_NOTHING = None, None, None, None, None, _NO_VALUES, None
"""The fields of a report from `robustness` to `asked` before the first sample."""
_UNKNOWN = _NAN, None, _NAN, _NAN, Verdict.UNDECIDED, _NO_VALUES, None
"""These fields while a known state is no longer current."""


class Suspension:
    """A time in which nothing was evaluated, such as SIGSTOP or an overload of the computer.

    Just after it, an input may be stale only because its messages still wait in a queue.

    Args:
        duration: Its duration in nanoseconds.
        now: Its end in nanoseconds.
        period: The nanoseconds after it in which waiting messages may arrive at once.
        gap: The nanoseconds after it in which an input may be stale for this reason.
    """

    def __init__(self, duration: int, now: int, period: int, gap: int) -> None:
        self._duration = duration
        self._since: dict[TopicEvidence, tuple[int, int]] = {}
        self.counts_until = now + period
        self.until = now + gap

    def add(self, topics: Iterable[TopicEvidence]) -> Suspension:
        """Count the messages of topics since the last sample; return itself."""
        for topic in topics:
            taken, lost = topic.since
            self._since[topic] = topic.taken - taken, topic.loss.lost - lost
        return self

    @property
    def text(self) -> str:
        """The reason for a restart."""
        parts = [f"nothing was evaluated for {self._duration / 1e9:.1f} s"]
        for topic, (taken, lost) in self._since.items():
            count = topic.taken - taken
            words = "message" if count == 1 else "messages"
            missing = f"{topic.loss.lost - lost} were lost"
            missing = "loss unknown" if topic.loss.unknown else missing
            if count:
                parts.append(f"{count} {words} of {topic.topic} came at once, {missing}")
        return "; ".join(parts)


class RequirementHistory:
    """The history of a requirement since the start or reset of the node; it makes the reports.

    Attributes:
        last: The last report.
        missed: As in `RequirementReport`.
        restarts: As in `RequirementReport`.
        resets: As in `RequirementReport`.
        why_suspended: The reason for the last suspension.
    """

    def __init__(self, requirement: SubscribedRequirement, record: CsvRecord | None = None) -> None:
        self.name = requirement.name
        self.inputs = requirement.inputs
        self.last: RequirementReport | None = None
        self.why_suspended = ""
        self._suspension: Suspension | None = None
        self._topics = tuple(dict.fromkeys(source.evidence for source in self.inputs))
        self._loss_state: list[object] = []
        self._losses: tuple[str, ...] = ()
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
        """Start a run; ``why`` is the reason for the end of the last run."""
        if self._began and not self._waits_for_run:
            self.restarts += 1
            self._why = why
        self._began, self._waits_for_run = True, False

    def reset(self, now: int) -> RequirementReport:
        """Return the report of a reset, with the last state; the next run is not a restart."""
        was = "nothing was evaluated yet"
        if self.last is not None:
            last = self.last._replace(violations=self._violations, violated_at=self._violated_at)
            was = f"was: {last.text}"
        self.resets += 1
        self._reset_at = now
        self._waits_for_run = True
        self._worst = self._worst_time = self._violated_at = None
        self._violations = 0
        unknown = _UNKNOWN if self._began else _NOTHING
        return self._report(now, Level.WARN, f"new run; {was}", unknown)

    def add_robustness(self, robustness: float, about: int) -> None:
        """Update the minimum with a robustness and its time."""
        if self._worst is None or robustness < self._worst:
            self._worst, self._worst_time = robustness, about

    def add_violation(self, time: int) -> None:
        """Count a certain violation, once per run."""
        self._violations += 1
        if self._violated_at is None:
            self._violated_at = time

    def without_clock(self) -> RequirementReport:
        """Return the report before the start of a simulated clock."""
        return self._report(0, Level.WARN, "waiting for the clock")

    def with_still_clock(self) -> RequirementReport:
        """Return the report while a simulated clock stands still."""
        time = self.last.time if self.last is not None else 0
        unknown = _UNKNOWN if self._began else _NOTHING
        return self._report(time, Level.STALE, "the clock stands still", unknown)

    def why_gone(self, now: int) -> str:
        """Return the reason for the end of a run with missing or stale inputs."""
        for source in self.inputs:
            if source.blocked:
                return f"there were {source.several}"
        gone = [source.name for source in self.inputs if source.is_gone(now)]
        return f"{', '.join(gone)} {'was' if len(gone) == 1 else 'were'} stale"

    def without_inputs(self, now: int) -> RequirementReport:
        """Return the report while inputs are missing or stale."""
        waiting = [source for source in self.inputs if source.is_awaited() and not source.blocked]
        stale = [source for source in self.inputs if source.is_stale(now)]
        parts = []
        if waiting:
            parts.append("waiting for " + ", ".join(source.name for source in waiting))
        parts += [f"{source.name} stale {seconds(source.age(now))}" for source in stale]
        parts += [source.error for source in (*waiting, *stale) if source.error]
        level = Level.ERROR if any(source.error for source in waiting) else Level.WARN
        return self._report(
            now,
            Level.STALE if stale else level,
            "; ".join(parts),
            _UNKNOWN if self._began else _NOTHING,
            stale=tuple(source.name for source in stale),
            waiting=tuple(source.name for source in waiting),
        )

    def without_values(
        self, time: int, ages: Mapping[str, int], bounds: tuple[float, float], verdict: Verdict
    ) -> RequirementReport:
        """Return the report of a sample with stale inputs, in a run that continues.

        Args:
            time: The time of the sample.
            ages: The stale inputs, with the nanoseconds since their last message.
            bounds: The bounds of the run.
            verdict: The verdict on the run.
        """
        parts = [f"{name} stale {seconds(age)}" for name, age in ages.items()]
        parts += [source.error for source in self.inputs if source.error]
        return self._report(
            time,
            Level.STALE,
            "; ".join(parts),
            (_NAN, None, *bounds, verdict, _NO_VALUES, None),
            stale=tuple(ages),
        )

    def suspend(self, suspension: Suspension) -> None:
        """Add a time in which nothing was evaluated."""
        self._suspension = suspension.add(self._topics)

    def resumes(self, now: int) -> bool:
        """Return whether inputs may be stale only because nothing was evaluated for a while."""
        suspension = self._suspension
        if suspension is None:
            return False
        if now <= suspension.counts_until:
            before, self.why_suspended = self.why_suspended, suspension.text
            self._why = self.why_suspended if self._why == before else self._why
        if now >= suspension.until:
            self._suspension = None
            return False
        return any(source.is_stale(now) for source in self.inputs)

    def suspended(self, now: int) -> RequirementReport:
        """Return the report just after a suspension."""
        unknown = _UNKNOWN if self._began else _NOTHING
        stale = tuple(source.name for source in self.inputs if source.is_stale(now))
        waiting = tuple(
            source.name for source in self.inputs if source.is_awaited() and not source.blocked
        )
        text = self.why_suspended
        if waiting:
            text = f"{text}; waiting for {', '.join(waiting)}"
        return self._report(now, Level.STALE, text, unknown, stale, waiting)

    def failed(self, time: int, reason: str) -> RequirementReport:
        """Return the report of a sample without a robustness, such as of ``sqrt(-1)``."""
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
        """Return the report of a sample with all inputs.

        With ``may_rise`` a negative robustness is not an error, as for a goal without a deadline.
        """
        errors = [source.error for source in self.inputs if source.error]
        problem = "; ".join(errors) if errors else ""
        level = Level.WARN if problem or self._violations else Level.OK
        if robustness is None:
            level = Level.ERROR if verdict is Verdict.VIOLATED else level
        elif not holds(robustness) and (verdict is Verdict.VIOLATED or not may_rise):
            level = Level.ERROR
        fields = robustness, about, *bounds, verdict, values, asked
        return self._report(time, level, problem, fields)

    def _report(
        self,
        time: int,
        level: Level,
        problem: str,
        fields: tuple[Any, ...] = _NOTHING,
        stale: tuple[str, ...] = (),
        waiting: tuple[str, ...] = (),
    ) -> RequirementReport:
        """Return a report; ``fields`` are those from `robustness` to `asked`."""
        out_of_order = strays = ahead = errors = 0
        defaults: tuple[str, ...] = ()
        for source in self.inputs:
            if source.several:
                problem = f"{problem}; {source.several}" if problem else source.several
                level = max(level, Level.WARN)
            if (order := source.order) is not None:
                out_of_order += order.late
                strays += order.strays
                ahead += order.ahead
                if source.time is not None and order.offset > AHEAD:
                    size = round(order.offset / 1e9, 1)
                    words = f"stamps of {source.name} are {size:g} s ahead of the clock"
                    problem = f"{problem}; {words}" if problem else words
                    level = max(level, Level.WARN)
            if source.time is None and source.is_default():
                defaults += (f"{source.name} = {source.default:g}",)
            errors += source.errors
        late = lost = 0
        state: list[object] = []
        for topic in self._topics:
            late += topic.late
            lost += topic.loss.lost
            state += topic.loss.lost, topic.loss.unknown
        if state != self._loss_state:
            self._loss_state = state
            self._losses = tuple([topic.text for topic in self._topics])
        unrecorded = "" if self._record is None else self._record.error
        # Keywords for the fields would take half the time of an evaluation.
        self.last = RequirementReport._make(
            (
                self.name,
                time,
                max(level, Level.WARN) if unrecorded else level,
                problem,
                *fields,
                self._worst,
                self._worst_time,
                stale,
                waiting,
                defaults,
                self._violations,
                self._violated_at,
                self.missed,
                out_of_order,
                strays,
                ahead,
                errors,
                self.restarts,
                self._why,
                self.resets,
                self._reset_at,
                late,
                lost,
                self._losses,
                unrecorded,
            )
        )
        return self.last
