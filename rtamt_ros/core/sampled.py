"""A requirement on samples: the last values, once a period."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rtamt import EpisodeMonitor, InputError, Monitor, SpecificationError, Verdict
from rtamt.machines.readout import moved
from rtamt_ros.core.account import Account
from rtamt_ros.core.asked import AskedCounts
from rtamt_ros.core.formulas import Formulas
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.record import CsvRecord
from rtamt_ros.core.report import RequirementReport, seconds
from rtamt_ros.core.requirements import SubscribedRequirement, unbounded
from rtamt_ros.core.settings import Settings

__all__ = ["SampledJudge"]


class SampledJudge:
    """Judges a requirement on the last values, once a period.

    `Monitor` gives the robustness, or `EpisodeMonitor` if no monitor can wait for the requirement.
    `Formulas` does the same for every named formula.

    Under ``stale_as="unknown"`` a run goes on while inputs are stale: `EpisodeMonitor` takes their
    values for unknown, so that bounds and verdict are about the whole run. `Monitor` and
    `Formulas`, which need every value, begin anew when all inputs are there again.

    Args:
        requirement: What to judge.
        settings: The period, the semantics and `align`.
        record: Where the samples go.

    Attributes:
        account: The history of the requirement.
        inputs: What it reads.
        lateness: As in `Judges`, for this requirement.

    Raises:
        SpecificationError: If a monitor cannot run the requirement.
    """

    def __init__(
        self,
        requirement: SubscribedRequirement,
        settings: Settings,
        record: CsvRecord | None = None,
    ) -> None:
        self.account = Account(requirement, record)
        self.inputs = requirement.inputs
        options: Any = {
            "period": f"{settings.period}ns",
            "semantics": settings.semantics,
            "align": settings.align,
        }
        self._unknown = settings.stale_as == "unknown"
        self._episode = EpisodeMonitor(
            requirement.specification, **options, nan="unknown" if self._unknown else "raise"
        )
        self._monitor: Monitor | None = None
        try:
            self._monitor = Monitor(requirement.specification, **options)
        except SpecificationError:  # an unbounded future inside the formula
            self._latency = 0
        else:
            self._latency = self._monitor.latency * settings.period
        whole = unbounded(requirement.specification)
        self._may_rise = self._monitor is None or whole == "eventually"
        self._about_run = bool(whole) and self._monitor is not None
        order = {source: at for at, source in enumerate(self.inputs)}
        cells = [requirement.cells[name] for name in self._episode.variables]
        self._places = [(order[source], place) for source, place in cells]
        named = requirement.specification.formulas
        result = [name for name, of in named.items() if of is requirement.specification.formula]
        self._result = result[:1]
        self._alone = result[0] if len(named) == len(result) == 1 else ""
        self._formulas: Formulas | None = None
        if named and self._monitor is None:
            self._formulas = Formulas(requirement.specification, self._episode.variables, options)
        self._asked: AskedCounts | None = None
        if settings.combined:
            standard = {"period": options["period"], "align": options["align"]}
            self._asked = AskedCounts(requirement.specification, self._episode.variables, standard)
        self.lateness = {"": self._latency}
        if by_name := self._formulas or self._monitor:
            for name, samples in by_name.latencies.items():
                self.lateness[name] = samples * settings.period
        self._record = record
        self._why = ""
        self._running = False
        self._fresh = self._decided = False
        self._gaps = False
        self._jumps = 0

    def stop(self, why: str) -> None:
        """End the run; the next look at which every input is there begins another."""
        if self._running:
            self._why = why
            self._running = False

    def reset(self, now: int) -> RequirementReport:
        """End the run as somebody asks for another, which begins with the next sample."""
        self.stop("")
        return self.account.reset(now)

    def sample(self, time: int, *, late: bool = False, gap: str = "") -> RequirementReport:
        """The report of a time, one period after the last; the inputs hold what came by then.

        Args:
            time: Of the sample.
            late: Whether the next one is due too.
            gap: Why it is not one period after the last; empty if it is.
        """
        jumps = 0
        for source in self.inputs:
            if source.is_awaited() if self._unknown else source.is_gone(time):
                self.stop(self.account.why_gone(time))
                return self.account.without(time)
            jumps += source.jumps
        if jumps != self._jumps:
            self._jumps = jumps
            back = max(self.inputs, key=lambda source: source.went_back)
            self.stop(f"the stamps of {back.name} went back by {seconds(back.went_back)}")
        if gap:
            self.stop(gap)
        if not self._running:
            self._begin()
        self.account.missed += late
        return self._judged(time)

    def _begin(self) -> None:
        self._episode.reset()
        for each in (self._monitor, self._formulas, self._asked):
            if each is not None:
                each.reset()
        self._running = self._fresh = True
        self._decided = self._gaps = False

    def _judged(self, time: int) -> RequirementReport:
        sample, stale = self._sample(time)
        try:
            robustness = self._apart(sample) if stale else self._step(sample)
        except InputError as error:  # a term is no number
            self.stop("there was no robustness")
            return self.account.failed(time, str(error))
        if self._fresh:
            self._fresh = False
            self.account.begin(self._why)
            if self._record is not None:
                self._record.begin()
        if self._record is not None:
            self._record.row(time, (*sample, robustness))
        known, about = None, time - self._latency
        if robustness == robustness:  # noqa: PLR0124 - not nan: the latency has passed
            known = robustness
            self.account.found(robustness, about)
        if not self._decided and self._episode.verdict:
            self._decided = True
            if self._episode.verdict is Verdict.VIOLATED:
                self.account.violated(time)
        if stale:
            what = {each.name: each.age(time) for each in stale}
            return self.account.without_values(
                time, what, self._episode.bounds(), self._episode.verdict
            )
        return self.account.judged(
            time,
            known,
            None if known is None else about,
            self._episode.bounds(),
            self._episode.verdict,
            self._values(robustness),
            may_rise=self._may_rise,
            asked=None if self._asked is None else self._asked.counts,
        )

    def _sample(self, now: int) -> tuple[list[float], list[Input]]:
        """The values of a time, and the inputs of which they are not known and nan."""
        stale = [each for each in self.inputs if each.is_stale(now)] if self._unknown else []
        held = [source.values for source in self.inputs]
        if not stale:
            return [held[at][place] for at, place in self._places], stale
        for source in stale:
            at = self.inputs.index(source)
            held[at] = [math.nan] * len(held[at])
        return [held[at][place] for at, place in self._places], stale

    def _apart(self, sample: Sequence[float]) -> float:
        """Takes values of which some are not known, with which there is no robustness."""
        self._episode.update(*sample)
        if self._asked is not None:
            self._asked.stop()
        self._gaps = True
        for each in (self._monitor, self._formulas):
            if each is not None:
                each.reset()
        return math.nan

    def _step(self, sample: Sequence[float]) -> float:
        if self._asked is not None:
            self._asked.update(sample)
        if self._monitor is None:
            robustness = self._episode.update(*sample)
            if self._formulas is not None:
                self._formulas.update(sample, robustness)
            return robustness
        robustness = self._monitor.update(*sample)
        self._episode.update(*sample)
        if self._gaps and self._about_run and robustness == robustness:  # noqa: PLR0124 - not nan
            # It judges the samples since the last gap: what was before it counts too.
            return moved(robustness, *self._episode.bounds())
        return robustness

    def _values(self, robustness: float) -> Mapping[str, float]:
        """The robustness of every named formula, nan where it is not known yet."""
        if self._alone:  # in a tenth of the time that the monitor takes to list its values
            return {self._alone: robustness}
        if self._formulas is not None:
            return self._formulas.values
        values = {} if self._monitor is None else self._monitor.values
        return {**values, **dict.fromkeys(self._result, robustness)} if self._gaps else values
