"""A requirement on samples: the last values, once per period."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    Monitor,
    Specification,
    SpecificationError,
    Verdict,
)
from rtamt.machines.state import moved
from rtamt.program.implications import implications
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.record import CsvRecord
from rtamt_ros.core.report import RequirementHistory, RequirementReport, holds
from rtamt_ros.core.requirements import SubscribedRequirement, unbounded
from rtamt_ros.core.settings import Settings


class Formulas:
    """The robustness of the named formulas of a requirement that no online monitor can run.

    `Monitor` computes it after the latency of the formula. If the formula itself has an unbounded
    future inside, `EpisodeMonitor` computes its robustness as if the run ended now.

    Attributes:
        values: The robustness of every named formula after the last sample.
        latencies: The number of samples by which each value is late.
    """

    def __init__(
        self, specification: Specification, variables: Sequence[str], options: Mapping[str, Any]
    ) -> None:
        self.values: dict[str, float] = {}
        self._monitors: dict[str, tuple[Monitor | EpisodeMonitor, list[int]]] = {}
        self._result: list[str] = []
        for name, formula in specification.formulas.items():
            if formula is specification.formula:
                self._result.append(name)
                continue
            monitor = _monitor(
                replace(specification, formula=formula, formulas={}, uses={}), options
            )
            indices = [variables.index(variable) for variable in monitor.variables]
            self._monitors[name] = monitor, indices
        self.latencies = dict.fromkeys(self._result, 0) | {
            name: monitor.latency if isinstance(monitor, Monitor) else 0
            for name, (monitor, _) in self._monitors.items()
        }

    def update(self, sample: Sequence[float], robustness: float) -> None:
        """Update the formulas with a sample; ``robustness`` is that of the requirement."""
        self.values = dict.fromkeys(self._result, robustness)
        for name, (monitor, indices) in self._monitors.items():
            self.values[name] = monitor.update(*[sample[index] for index in indices])

    def reset(self) -> None:
        """Forget every sample."""
        for monitor, _ in self._monitors.values():
            monitor.reset()


def _monitor(specification: Specification, options: Mapping[str, Any]) -> Monitor | EpisodeMonitor:
    try:
        return Monitor(specification, **options)
    except SpecificationError:  # an unbounded future inside the formula
        return EpisodeMonitor(specification, **options)


class TriggerCounts:
    """The number of triggers of implications that a requirement checks at every sample.

    These are implications in ``always(p implies q)``, also if several of these are joined by
    ``and``. The counts are the same as from `rtamt.judge` on the whole trace. A sample counts when
    the latency of the left side has passed.

    Attributes:
        counts: The triggers of each implication, in the order of the text. None if they cannot be
            counted: there are no such implications, or others too; a left side has an unbounded
            future; or a value was unknown.
    """

    def __init__(
        self, specification: Specification, variables: Sequence[str], options: Mapping[str, Any]
    ) -> None:
        self._monitors: list[tuple[Monitor, list[int]]] = []
        formula = specification.formula
        triggered = list(dict.fromkeys(_always_implications(specification, formula, always=False)))
        self._countable = bool(triggered) and {*triggered} == {*implications(formula)}
        for implication in implications(formula) if self._countable else ():
            left = replace(
                specification, formula=cast("Formula", implication.args[0]), formulas={}, uses={}
            )
            try:
                monitor = Monitor(left, **options)
            except SpecificationError:  # an unbounded future
                self._countable = False
                break
            indices = [variables.index(name) for name in monitor.variables]
            self._monitors.append((monitor, indices))
        self.reset()

    def reset(self) -> None:
        """Forget every sample."""
        self.counts: tuple[int, ...] | None = None
        if self._countable:
            self.counts = (0,) * len(self._monitors)
        for monitor, _ in self._monitors:
            monitor.reset()

    def update(self, sample: Sequence[float]) -> None:
        """Update the counts with a sample."""
        if self.counts is not None:
            values = [
                monitor.update(*[sample[index] for index in indices])
                for monitor, indices in self._monitors
            ]
            # A value is nan until the latency of the left side has passed.
            triggers = [value == value and holds(value) for value in values]  # noqa: PLR0124
            self.counts = tuple(map(sum, zip(self.counts, triggers, strict=True)))

    def stop(self) -> None:
        """Stop counting, because values are unknown."""
        self.counts = None


def _always_implications(
    specification: Specification, formula: Formula, *, always: bool
) -> list[Formula]:
    """Return the implications that a formula checks at every sample."""
    name = "" if formula.op is None else formula.op.name
    parts = cast("Sequence[Formula]", formula.args)
    if name == "and":
        return [
            implication
            for part in parts
            for implication in _always_implications(specification, part, always=always)
        ]
    if not always and unbounded(specification, formula) == "always":
        return _always_implications(specification, parts[0], always=True)
    return [formula] if always and name == "implies" else []


class SampledJudge:
    """The monitor of a requirement on the last values, once per period.

    `Monitor` computes robustness; if no online monitor can run the requirement, `EpisodeMonitor`
    and, for named formulas, `Formulas` do.

    Under ``stale_as="unknown"`` a run continues while inputs are stale: their values are unknown to
    `EpisodeMonitor`, so bounds and verdict are about the whole run. `Monitor` and `Formulas`, which
    need every value, start again when all inputs are back.

    Attributes:
        history: The history of the requirement.
        inputs: The inputs of the requirement.
        lateness: As in `Judges`, for this requirement.
    """

    def __init__(
        self,
        requirement: SubscribedRequirement,
        settings: Settings,
        record: CsvRecord | None = None,
    ) -> None:
        self.history = RequirementHistory(requirement, record)
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
        outermost = unbounded(requirement.specification)
        self._may_rise = self._monitor is None or outermost == "eventually"
        self._about_run = bool(outermost) and self._monitor is not None
        order = {source: number for number, source in enumerate(self.inputs)}
        cells = [requirement.cells[name] for name in self._episode.variables]
        self._cells = [(order[source], index) for source, index in cells]
        named = requirement.specification.formulas
        result = [
            name for name, formula in named.items() if formula is requirement.specification.formula
        ]
        self._result = result[:1]
        self._only = result[0] if len(named) == len(result) == 1 else ""
        self._formulas: Formulas | None = None
        if named and self._monitor is None:
            self._formulas = Formulas(requirement.specification, self._episode.variables, options)
        self._triggers: TriggerCounts | None = None
        if settings.combined:
            standard = {"period": options["period"], "align": options["align"]}
            self._triggers = TriggerCounts(
                requirement.specification, self._episode.variables, standard
            )
        self.lateness = {"": self._latency}
        if by_name := self._formulas or self._monitor:
            for name, samples in by_name.latencies.items():
                self.lateness[name] = samples * settings.period
        self._record = record
        self._why = ""
        self._running = self._interrupted = False
        self._fresh = self._decided = False
        self._gaps = False
        self._jumps = 0

    def stop(self, why: str) -> None:
        """End the run; the next look with all inputs starts a new run."""
        if self._running:
            self._why = why
            self._running = False

    def reset(self, now: int) -> RequirementReport:
        """End the run on request; the next sample starts a new run."""
        self.stop("")
        return self.history.reset(now)

    def interrupt(self) -> None:
        """End the run after a time in which nothing was evaluated."""
        self._interrupted |= self._running
        self._running = False

    def sample(self, time: int, *, late: bool = False) -> RequirementReport:
        """Return the report of a time; the inputs have the last values up to it.

        Args:
            time: The time of the sample.
            late: Whether the next sample is due too.
        """
        if self.history.resumes(time):
            return self.history.suspended(time)
        jumps = 0
        for source in self.inputs:
            if source.is_awaited() if self._unknown else source.is_gone(time):
                self.stop(self.history.why_gone(time))
                return self.history.without_inputs(time)
            jumps += source.jumps
        if jumps != self._jumps:
            self._jumps = jumps
            self.stop(max(self.inputs, key=lambda source: source.jumped_at).why_jumped())
        if self._interrupted:
            self._why = self.history.why_suspended
        if not self._running:
            self._begin()
        self.history.missed += late
        return self._judged(time)

    def _begin(self) -> None:
        self._episode.reset()
        for monitor in (self._monitor, self._formulas, self._triggers):
            if monitor is not None:
                monitor.reset()
        self._running = self._fresh = True
        self._interrupted = False
        self._decided = self._gaps = False

    def _judged(self, time: int) -> RequirementReport:
        sample, stale = self._sample(time)
        try:
            robustness = self._update_episode(sample) if stale else self._update(sample)
        except InputError as error:  # a term is not a number
            self.stop("there was no robustness")
            return self.history.failed(time, str(error))
        if self._fresh:
            self._fresh = False
            self.history.begin(self._why)
            if self._record is not None:
                self._record.begin()
        bounds, verdict = self._episode.bounds(), self._episode.verdict
        if self._record is not None:
            self._record.row(time, (*sample, robustness, *bounds, int(verdict)))
        known, about = None, time - self._latency
        if robustness == robustness:  # noqa: PLR0124 - not nan: the latency has passed
            known = robustness
            self.history.add_robustness(robustness, about)
        if not self._decided and verdict:
            self._decided = True
            if verdict is Verdict.VIOLATED:
                self.history.add_violation(time)
        if stale:
            ages = {source.name: source.age(time) for source in stale}
            return self.history.without_values(time, ages, bounds, verdict)
        return self.history.judged(
            time,
            known,
            None if known is None else about,
            bounds,
            verdict,
            self._values(robustness),
            may_rise=self._may_rise,
            asked=None if self._triggers is None else self._triggers.counts,
        )

    def _sample(self, now: int) -> tuple[list[float], list[Input]]:
        """Return the values of a time, nan where they are unknown, and the stale inputs."""
        stale = [source for source in self.inputs if source.is_stale(now)] if self._unknown else []
        values = [source.values for source in self.inputs]
        if not stale:
            return [values[number][index] for number, index in self._cells], stale
        for source in stale:
            number = self.inputs.index(source)
            values[number] = [math.nan] * len(values[number])
        return [values[number][index] for number, index in self._cells], stale

    def _update_episode(self, sample: Sequence[float]) -> float:
        """Update the episode monitor with a sample that has unknown values; return nan."""
        self._episode.update(*sample)
        if self._triggers is not None:
            self._triggers.stop()
        self._gaps = True
        for monitor in (self._monitor, self._formulas):
            if monitor is not None:
                monitor.reset()
        return math.nan

    def _update(self, sample: Sequence[float]) -> float:
        """Update the monitors with a sample; return its robustness."""
        if self._triggers is not None:
            self._triggers.update(sample)
        if self._monitor is None:
            robustness = self._episode.update(*sample)
            if self._formulas is not None:
                self._formulas.update(sample, robustness)
            return robustness
        robustness = self._monitor.update(*sample)
        self._episode.update(*sample)
        if self._gaps and self._about_run and robustness == robustness:  # noqa: PLR0124 - not nan
            # The monitor judges the samples since the last gap; the bounds judge the whole run.
            return moved(robustness, *self._episode.bounds())
        return robustness

    def _values(self, robustness: float) -> Mapping[str, float]:
        """Return the robustness of every named formula; nan where it is not known yet."""
        if self._only:  # ten times as fast as Monitor.values
            return {self._only: robustness}
        if self._formulas is not None:
            return self._formulas.values
        values = {} if self._monitor is None else self._monitor.values
        return {**values, **dict.fromkeys(self._result, robustness)} if self._gaps else values
