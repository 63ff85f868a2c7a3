"""The monitors of all requirements of a node, which this package calls judges.

To change the reaction of a node to a message or a tick of the clock, change `Judges.take` or
`Judges.look`; ``sampled.py`` and ``dense.py`` here evaluate samples and events.

To add a number or a note about a requirement: a field of `RequirementReport`, an entry of
``_numbers`` in ``publishing.py``, and its words in `RequirementReport.text`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import repeat, starmap
from pathlib import Path
from typing import Any

from rtamt import InputError, Specification
from rtamt_ros.core.dense import DenseJudge
from rtamt_ros.core.record import VERDICTS, CsvRecord
from rtamt_ros.core.report import RequirementReport, Suspension, seconds
from rtamt_ros.core.requirements import SubscribedRequirement, requirements_of
from rtamt_ros.core.sampled import SampledJudge
from rtamt_ros.core.settings import Settings
from rtamt_ros.core.topics import Topic


class Judges:
    """The judges of every requirement of some specifications.

    On samples, several threads may call `take` while one calls `look`; the caller reads the time of
    a message and the time of a look one after the other. All requirements share the sample times,
    which are a period apart. In dense time, only one call may run at a time.

    Attributes:
        inputs: The inputs of all requirements.
        topics: The topics of the inputs, by name.
        requirements: The requirements.
        settings: The settings.
        lateness: For each requirement and formula, how many nanoseconds the time of its value lies
            before `RequirementReport.time`. On samples the formula ``""`` is the result.
    """

    def __init__(self, specifications: Sequence[Specification], settings: Settings) -> None:
        self.settings = settings
        self.requirements = requirements_of(specifications, settings)
        sources = (source for requirement in self.requirements for source in requirement.inputs)
        self.inputs = list(dict.fromkeys(sources))
        self.topics: dict[str, Topic] = {}
        for source in self.inputs:
            if source.topic not in self.topics:
                self.topics[source.topic] = Topic(source.topic, settings)
            self.topics[source.topic].add(source)
        self._records = [self._record(requirement) for requirement in self.requirements]
        recorded = zip(self.requirements, repeat(settings), self._records, strict=False)
        self._sampled = [] if settings.dense else list(starmap(SampledJudge, recorded))
        self._dense = list(starmap(DenseJudge, recorded)) if settings.dense else []
        self._judges: list[SampledJudge | DenseJudge] = [*self._sampled, *self._dense]
        self.lateness = {
            (judge.history.name, formula): late
            for judge in self._judges
            for formula, late in judge.lateness.items()
        }
        self._now = 0
        self._point: int | None = None  # the last evaluated point

    @property
    def files(self) -> list[Path]:
        """The files of the next samples."""
        return [record.path for record in self._records if record is not None]

    @property
    def reports(self) -> tuple[RequirementReport, ...]:
        """The last report of each requirement that has one."""
        reports = [judge.history.last for judge in self._judges]
        return tuple([report for report in reports if report is not None])

    def take(
        self,
        topic: str,
        message: Any,  # noqa: ANN401 - the classes of ROS have no types
        time: int,
        came: int,
        now: int | None = None,
    ) -> Sequence[RequirementReport]:
        """Pass a message to its inputs; in dense time, return the reports after it.

        Args:
            topic: The name of its topic.
            message: The message.
            time: Its stamp or its arrival.
            came: Its arrival.
            now: The time of the clock, which is later if the message waited in a queue; None for
                the arrival.
        """
        now = came if now is None else now
        dense = self.settings.dense
        if dense and now > 0:
            self._follow_clock(now, now)
        reports: list[RequirementReport] = []
        for sources in self.topics[topic].take(message, time, came):
            if dense:
                for source in sources:
                    source.gather()
                    source.settle(now)
                for judge in self._dense:
                    for source in judge.inputs:
                        if source in sources:
                            reports += judge.event(source, now)
        return reports

    def look(self, due: int, now: int) -> Sequence[RequirementReport]:
        """Return the reports of a time; on samples, of every point since the last look.

        Args:
            due: The last point of the grid; unused in dense time.
            now: The time of the clock.
        """
        if now <= 0:
            return [judge.history.without_clock() for judge in self._judges]
        if self.settings.dense:
            self._follow_clock(now, now)
            self._resume_after_gap(now)
            self._judge(now)
            return [report for judge in self._dense for report in judge.look(now)]
        period = self.settings.period
        if due > now:  # the clock jumped back
            due -= -((now - due) // period) * period
        self._follow_clock(now, due)
        for source in self.inputs:
            source.gather()
        reports: list[RequirementReport] = []
        points = self._points(due)
        for point in points:
            self._judge(point)
            for source in self.inputs:
                source.settle(point)
            reports += [judge.sample(point, late=point < due) for judge in self._sampled]
        return reports

    def _judge(self, time: int) -> None:
        """Set the time of a sample, or of a look in dense time."""
        self._point = time
        for topic in self.topics.values():
            topic.evidence.judge(time)

    def _points(self, due: int) -> Sequence[int]:
        """Return the points to evaluate; after a gap only the last point."""
        last, period = self._point, self.settings.period
        if last is None or self._resume_after_gap(due):
            return [due]
        return range(last + period, due + 1, period)

    def _resume_after_gap(self, now: int) -> bool:
        """Return whether nothing was evaluated during a gap; runs on samples end then."""
        gap, last = self.settings.gap, self._point
        if last is None or now - last <= gap:
            return False
        for judge in self._judges:
            suspension = Suspension(now - last, now, self.settings.period, gap)
            judge.history.suspend(suspension)
        for judge in self._sampled:
            judge.interrupt()
        self._judge(now)
        return True

    def reset(self, now: int) -> Sequence[RequirementReport]:
        """Start all runs again on request; return the reports until they start.

        Points that are due but not evaluated yet belong to no run.
        """
        if self._point is not None and now > self._point:
            self._point = now - (now - self._point) % self.settings.period
        return [judge.reset(now) for judge in self._judges]

    def resume(self, arrivals: Mapping[str, Sequence[tuple[Any, int, int]]], now: int) -> None:
        """Take the last messages of earlier monitors; the runs start at ``now``.

        Args:
            arrivals: The messages of each topic, with their times and arrivals.
            now: The time of the clock.
        """
        for topic, messages in arrivals.items():
            for message, time, came in messages:
                self.topics[topic].restore(message, time, came)
        if self.settings.dense:
            for source in self.inputs:
                source.gather()
                source.settle(now)
            for judge in self._dense:
                judge.resume(now)

    def standing(self) -> Sequence[RequirementReport]:
        """Return the reports while a simulated clock stands still."""
        return [judge.history.with_still_clock() for judge in self._judges]

    def _follow_clock(self, now: int, time: int) -> None:
        """Drop messages from after ``now`` if the clock went back.

        Messages from before the start of a simulated clock get ``time``.
        """
        back = self._now - now
        if not self._now:
            for source in self.inputs:
                source.came_before_the_clock(time)
        elif back > self.settings.period:
            for topic in self.topics.values():
                topic.forget_after(now)
            for judge in self._judges:
                judge.stop(f"the clock went back by {seconds(back)}")
            self._now, self._point = now, None
        self._now = max(self._now, now)

    def flush(self) -> None:
        """Write the records to disk."""
        for record in self._records:
            if record is not None:
                record.flush()

    def close(self) -> None:
        """Close the records."""
        for record in self._records:
            if record is not None:
                record.close()

    def _record(self, requirement: SubscribedRequirement) -> CsvRecord | None:
        path = self.settings.record
        if path is None:
            return None
        if len(self.requirements) > 1:
            path = path.with_stem(f"{path.stem}-{requirement.name}")
        if self.settings.dense:
            return CsvRecord(path, ("variable", "value"), VERDICTS)
        results = "robustness", *VERDICTS
        variables = requirement.specification.variables
        for name in variables:
            if name in ("time", *results):
                raise InputError(
                    f"record: the variable '{name}' has the name of a column of the record. Give "
                    "the variable another name, or record nothing."
                )
        return CsvRecord(path, (*variables, *results))
