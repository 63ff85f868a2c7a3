"""All requirements of a node: what messages and the clock do to them.

To change what a node does with a message or a tick of the clock, change `Judges.take` or
`Judges.look`; ``sampled.py`` and ``dense.py`` here judge samples and events.

To add a number or a note about a requirement: a field of `RequirementReport`, an entry of ``_told``
in ``publishing.py``, and its words in `RequirementReport.text`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rtamt import Specification
from rtamt_ros.core.dense import DenseJudge
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.record import CsvRecord
from rtamt_ros.core.report import RequirementReport, seconds
from rtamt_ros.core.requirements import SubscribedRequirement, requirements_of
from rtamt_ros.core.sampled import SampledJudge
from rtamt_ros.core.settings import Settings


class Judges:
    """Judges every requirement of some specifications.

    On samples, several threads may `take` messages while one takes `look` after look; the time of a
    message is read where no look reads its own meanwhile. All requirements are sampled at the same
    times, a period apart. In dense time all calls come one after the other.

    Args:
        specifications: What to judge.
        settings: How.

    Raises:
        SpecificationError: If a monitor cannot run a requirement, or a topic has no class of
            messages or two.

    Attributes:
        inputs: What the requirements read.
        topics: The topics that are read, and the inputs of each.
        requirements: What is judged.
        settings: How.
        lateness: For each requirement and named formula of it, the nanoseconds by which what its
            value is about lies before `RequirementReport.time`; on samples for the result too,
            which is the formula ``""``.
    """

    def __init__(self, specifications: Sequence[Specification], settings: Settings) -> None:
        self.settings = settings
        self.requirements = requirements_of(specifications, settings)
        read = (source for requirement in self.requirements for source in requirement.inputs)
        self.inputs = list(dict.fromkeys(read))
        self.topics: dict[str, list[Input]] = {}
        for source in self.inputs:
            self.topics.setdefault(source.topic, []).append(source)
        self._records = [self._record(requirement) for requirement in self.requirements]
        recorded = list(zip(self.requirements, self._records, strict=True))
        dense = settings.dense
        self._sampled = [SampledJudge(of, settings, to) for of, to in recorded if not dense]
        self._dense = [DenseJudge(of, settings, to) for of, to in recorded if dense]
        self._judges: list[SampledJudge | DenseJudge] = [*self._sampled, *self._dense]
        self.lateness = {
            (judge.account.name, formula): late
            for judge in self._judges
            for formula, late in judge.lateness.items()
        }
        self._now = 0
        self._point: int | None = None  # the last that was judged

    @property
    def files(self) -> list[Path]:
        """The files that the next samples are written to."""
        return [record.path for record in self._records if record is not None]

    @property
    def reports(self) -> tuple[RequirementReport, ...]:
        """The last report of every requirement of which there is one."""
        last = [judge.account.last for judge in self._judges]
        return tuple([each for each in last if each is not None])

    def take(self, topic: str, message: Any, time: int, now: int) -> Sequence[RequirementReport]:  # noqa: ANN401
        """Take a message, at the time that counts; in dense time, the reports that it brings."""
        dense = self.settings.dense
        if dense and now > 0:
            self._follow_clock(now, now)
        taken = {each for each in self.topics[topic] if each.take(message, time, now)}
        reports: list[RequirementReport] = []
        if dense:
            for source in taken:
                source.gather()
                source.settle(now)
            for judge in self._dense:
                for source in judge.inputs:
                    if source in taken:
                        reports += judge.event(source, now)
        return reports

    def look(self, due: int, now: int) -> Sequence[RequirementReport]:
        """The reports of a time: on samples, of every point that came since the last look.

        Args:
            due: The last point of the grid that has come; dense time has none.
            now: What the clock shows.
        """
        if now <= 0:
            return [each.account.without_clock() for each in self._judges]
        if self.settings.dense:
            self._follow_clock(now, now)
            return [report for judge in self._dense for report in judge.look(now)]
        period = self.settings.period
        if due > now:  # the clock was set back since
            due -= -((now - due) // period) * period
        self._follow_clock(now, due)
        for source in self.inputs:
            source.gather()
        reports: list[RequirementReport] = []
        points, gap = self._points(due)
        for point in points:
            self._point = point
            for source in self.inputs:
                source.settle(point)
            reports += [each.sample(point, late=point < due, gap=gap) for each in self._sampled]
        return reports

    def _points(self, due: int) -> tuple[Sequence[int], str]:
        """The points since the last that was judged; why it is the last alone, after a gap."""
        last, period = self._point, self.settings.period
        if last is None:
            return [due], ""
        if due - last > self.settings.gap:
            return [due], f"nothing was sampled for {seconds(due - last)}"
        return range(last + period, due + 1, period), ""

    def reset(self, now: int) -> Sequence[RequirementReport]:
        """Begin all runs anew, as somebody asks for; the reports until they do.

        What is due by now and was not judged yet belongs to no run.
        """
        if self._point is not None and now > self._point:
            self._point = now - (now - self._point) % self.settings.period
        return [judge.reset(now) for judge in self._judges]

    def standing(self) -> Sequence[RequirementReport]:
        """The reports while a simulated clock stands still; the monitors go on when it does."""
        return [judge.account.standing() for judge in self._judges]

    def _follow_clock(self, now: int, time: int) -> None:
        """Forget what came after a time to which the clock went back.

        Args:
            now: What the clock shows.
            time: Of what is judged now: that of messages which came before a simulated clock began.
        """
        back = self._now - now
        if not self._now:
            for source in self.inputs:
                source.came_before_the_clock(time)
        elif back > self.settings.period:
            for source in self.inputs:
                source.forget_after(now)
            for judge in self._judges:
                judge.stop(f"the clock went back by {seconds(back)}")
            self._now, self._point = now, None
        self._now = max(self._now, now)

    def flush(self) -> None:
        """Put on the disk what was recorded."""
        for record in self._records:
            if record is not None:
                record.flush()

    def close(self) -> None:
        """End the records."""
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
            return CsvRecord(path, ("variable", "value"))
        columns = (*requirement.specification.variables, "robustness")
        return CsvRecord(path, columns)
