"""All requirements of a node: what messages and the clock do to them."""

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

__all__ = ["Judges"]


class Judges:
    """Judges every requirement of some specifications.

    On samples, several threads may `take` messages while one takes `look` after look. In dense time
    all calls come one after the other.

    Args:
        specifications: What to judge.
        settings: How.

    Raises:
        SpecificationError: If a monitor cannot run a requirement, or a topic has no class of
            messages or two.

    Attributes:
        inputs: What the requirements read, each its own.
        topics: The topics that are read, and the inputs of each.
        requirements: What is judged.
        settings: How.
    """

    def __init__(self, specifications: Sequence[Specification], settings: Settings) -> None:
        self.settings = settings
        self.requirements = requirements_of(specifications, settings)
        self.inputs = [source for each in self.requirements for source in each.inputs]
        self.topics: dict[str, list[Input]] = {}
        for source in self.inputs:
            self.topics.setdefault(source.topic, []).append(source)
        self._records = [self._record(each) for each in self.requirements]
        make: type[SampledJudge | DenseJudge] = DenseJudge if settings.dense else SampledJudge
        self._judges = [
            make(each, settings, record)
            for each, record in zip(self.requirements, self._records, strict=True)
        ]
        self._now = 0

    @property
    def files(self) -> list[Path]:
        """The files that the next samples are written to."""
        return [record.path for record in self._records if record is not None]

    @property
    def reports(self) -> tuple[RequirementReport, ...]:
        """The last report of every requirement of which there is one."""
        last = (each.account.last for each in self._judges)
        return tuple(each for each in last if each is not None)

    def take(self, topic: str, message: Any, time: int, now: int) -> Sequence[RequirementReport]:  # noqa: ANN401
        """Take a message, at the time that counts; in dense time, the reports that it brings."""
        if self.settings.dense and now > 0:
            self._follow_clock(now)
        taken = {each for each in self.topics[topic] if each.take(message, time, now)}
        reports: list[RequirementReport] = []
        for judge in self._judges if taken and self.settings.dense else ():
            for source in judge.inputs:
                if source in taken and isinstance(judge, DenseJudge):
                    reports += judge.event(source, now)
        return reports

    def look(self, now: int) -> Sequence[RequirementReport]:
        """The reports of a time: on samples, those that are due."""
        if now <= 0:
            return [each.account.without_clock() for each in self._judges]
        self._follow_clock(now)
        reports: list[RequirementReport] = []
        for judge in self._judges:
            found = judge.look(now)
            if isinstance(found, RequirementReport):
                reports.append(found)
            elif found is not None:
                reports += found
        return reports

    def standing(self) -> Sequence[RequirementReport]:
        """The reports while a simulated clock stands still; the monitors go on when it does."""
        return [each.account.standing() for each in self._judges]

    def _follow_clock(self, now: int) -> None:
        back = self._now - now
        if not self._now:
            for source in self.inputs:
                source.came_before_the_clock(now)
        elif back > self.settings.period:
            for source in self.inputs:
                source.forget_after(now)
            for judge in self._judges:
                judge.stop(f"the clock went back by {seconds(back)}")
            self._now = now
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
