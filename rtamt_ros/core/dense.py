"""A requirement in dense time: messages are events at their times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import rtamt
from rtamt import InputError, Specification, SpecificationError, Verdict
from rtamt.machines.state import moved
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.record import CsvRecord
from rtamt_ros.core.report import Account, RequirementReport
from rtamt_ros.core.requirements import SubscribedRequirement, unbounded
from rtamt_ros.core.settings import Settings

_Events = dict[str, list[tuple[float, float]]]


class DenseJudge:
    """Judges a requirement on events: a value lasts until the next message of its topic.

    A run starts when every input has a value and none is stale. The robustness of a time is
    reported as soon as it is known: with receive times at the next message or look, because silent
    topics have kept their values; with stamps when every topic has a later one.
    `rtamt.dense.Monitor` gives the robustness. If it cannot wait for the requirement,
    `rtamt.dense.EpisodeMonitor` gives the robustness of the run so far. Bounds and verdict always
    come from `rtamt.dense.EpisodeMonitor`.

    Under ``stale_as="unknown"`` a run continues while inputs are stale: their values are unknown
    until their next message. `rtamt.dense.Monitor`, which needs every value, starts again when all
    are there.

    Attributes:
        account: The history of the requirement.
        inputs: The inputs of the requirement.
        lateness: As in `Judges`, for this requirement.
    """

    def __init__(
        self,
        requirement: SubscribedRequirement,
        settings: Settings,
        record: CsvRecord | None = None,
    ) -> None:
        spec = requirement.specification
        options: Any = {"semantics": settings.semantics}
        self.account = Account(requirement, record)
        self.inputs = requirement.inputs
        self._unknown = settings.stale_as == "unknown"
        self._episode = rtamt.dense.EpisodeMonitor(
            spec, nan="unknown" if self._unknown else "raise", **options
        )
        self._monitor: rtamt.dense.Monitor | None = None
        self._named: dict[str, rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor] = {}
        try:
            self._monitor = rtamt.dense.Monitor(spec, **options)
        except SpecificationError:  # an unbounded future inside the formula
            self._named = {
                name: _alone(spec, name, options)
                for name, formula in spec.formulas.items()
                if formula is not spec.formula
            }
        self.lateness = {"": 0, **self._latenesses()}
        self._read = {
            source: [
                (name, place)
                for name, (owner, place) in requirement.cells.items()
                if owner is source
            ]
            for source in self.inputs
        }
        outermost = unbounded(spec)
        self._may_rise = self._monitor is None or outermost == "eventually"
        self._about_run = bool(outermost) and self._monitor is not None
        self._silence = not settings.stamps
        self._record = record
        self._recorded: tuple[float | None, float | None, Verdict | None] | None = None
        self._origin: int | None = None
        self._since = 0  # older messages count from here
        self._fresh = True
        self._last: dict[Input, int] = {}
        self._silent: set[Input] = set()
        self._gaps = self._apart = False
        self._why = ""
        self._jumps = 0
        self._robustness: tuple[float, int] | None = None
        self._verdict = Verdict.UNDECIDED

    def stop(self, why: str) -> None:
        """End the run; the next event with all inputs starts another.

        A certain violation counts, even if no report has shown it yet.
        """
        if self._origin is not None:
            self._decided()
            self._why = why
            self._origin = None

    def reset(self, now: int) -> RequirementReport:
        """End the run on request; held values count from now on.

        With stamps the next run starts at the oldest held message, as after a restart.
        """
        self.stop("")
        self.resume(now)
        return self.account.reset(now)

    def resume(self, now: int) -> None:
        """Let held values count from now on in the next run."""
        self._since = now if self._silence else 0

    def event(self, source: Input, now: int) -> Sequence[RequirementReport]:
        """Return the reports that a new message causes."""
        if self._origin is None:
            return self._begin(now)
        if self._has_jumped():
            self.stop(source.why_jumped())
            return self._begin(now)
        return self._feed([source], now)

    def look(self, now: int) -> Sequence[RequirementReport]:
        """Return the reports of a time without a message."""
        if self.account.resumes(now) and not self._unknown:
            self.stop(self.account.why_suspended)
            return [self.account.suspended(now)]
        if self._is_absent(now):
            self.stop(self.account.why_gone(now))
            return [self.account.without(now)]
        if self._origin is None:
            return self._begin(now)
        return self._feed([], now)

    def _begin(self, now: int) -> Sequence[RequirementReport]:
        if self._is_absent(now):
            return []
        self._episode.reset()
        self._forget()
        self._silent, self._gaps, self._apart = set(), False, False
        self._has_jumped()
        if now < self._since:  # the clock went back
            self._since = 0
        times = [max(source.time, self._since) for source in self.inputs if source.time is not None]
        self._origin = min(times, default=now)
        self._robustness, self._last = None, {}
        self._verdict = Verdict.UNDECIDED
        self._fresh = True
        return self._feed(self.inputs, now)

    def _forget(self) -> None:
        """Reset the monitors of robustness."""
        for monitor in (self._monitor, *self._named.values()):
            if monitor is not None:
                monitor.reset()

    def _is_absent(self, now: int) -> bool:
        if self._unknown:
            return any(source.is_awaited() for source in self.inputs)
        return any(source.is_gone(now) for source in self.inputs)

    def _has_jumped(self) -> bool:
        before, self._jumps = self._jumps, sum(source.jumps for source in self.inputs)
        return before != self._jumps

    def _feed(self, sources: Sequence[Input], now: int) -> Sequence[RequirementReport]:
        origin = self._origin or 0
        events: _Events = {}
        rows: list[tuple[int, dict[str, float]]] = []
        for source in sources:
            time, values = source.time, source.values
            if time is None:  # a default
                time = origin
            # A clock may go back a little or repeat a time, and the last value may last until now.
            time = max(time, self._since, self._last.get(source, time - 1) + 1)
            self._last[source] = time
            row = {name: values[place] for name, place in self._read[source]}
            for name, value in row.items():
                events[name] = [((time - origin) / 1e9, value)]
            rows.append((time, row))
        if self._unknown:
            rows += self._silence_of(sources, events, now)
        if self._silence:
            until = max(self._last.values()) + 1 if sources else now - 1
            self._extend(events, self.inputs, until)
        else:
            self._extend_lasting(events)
        try:
            robustness = self._update(events)
        except InputError as error:  # a term is not a number
            self.stop("there was no robustness")
            return [self.account.failed(now, str(error))]
        self._keep(rows)
        reports = self._without(now) if self._silent else self._judged(robustness, now)
        self._keep_verdicts(reports)
        return reports

    def _silence_of(
        self, sources: Sequence[Input], events: _Events, now: int
    ) -> list[tuple[int, dict[str, float]]]:
        """Make the values of newly stale inputs unknown; return the rows of a record."""
        before, rows = self._silent, []
        self._silent = {source for source in self.inputs if source.is_stale(now)}
        for source in self.inputs:
            if source in self._silent and (source in sources or source not in before):
                time = max(now - source.age(now) + int(source.stale_after), self._last[source]) + 1
                self._last[source] = time
                row = {name: math.nan for name, _ in self._read[source]}
                for name in row:
                    events.setdefault(name, []).append(
                        ((time - (self._origin or 0)) / 1e9, math.nan)
                    )
                rows.append((time, row))
        return rows

    def _without(self, now: int) -> Sequence[RequirementReport]:
        """Return the report of a time at which inputs are stale in a run that continues."""
        ages = {source.name: source.age(now) for source in self.inputs if source in self._silent}
        self._decided()
        bounds = self._episode.bounds()
        return [self.account.without_values(now, ages, bounds, self._episode.verdict)]

    def _keep(self, rows: list[tuple[int, dict[str, float]]]) -> None:
        """Count a run at its first events, and record the events."""
        if self._fresh:
            self._fresh = False
            self.account.begin(self._why)
            self._recorded = None
            if self._record is not None:
                self._record.begin()
        if self._record is not None:
            for time, row in rows:
                for event in row.items():
                    self._record.row(time, event)

    def _keep_verdicts(self, reports: Sequence[RequirementReport]) -> None:
        """Record bounds and verdicts that changed."""
        if self._record is None:
            return
        for report in reports:
            state = report.lower, report.upper, report.verdict
            if state != self._recorded and report.verdict is not None:
                self._recorded = state
                row = report.lower, report.upper, int(report.verdict)
                self._record.verdict(report.time, row)

    def _extend_lasting(self, events: _Events) -> None:
        """Extend defaults and unknown values as far as the other inputs."""
        lasting = [
            source for source in self.inputs if source.time is None or source in self._silent
        ]
        stamped = [time for source, time in self._last.items() if source not in lasting]
        if lasting and stamped:
            self._extend(events, lasting, min(stamped))

    def _extend(self, events: _Events, sources: Sequence[Input], until: int) -> None:
        """Extend values to a time; a new message lasts a nanosecond, so that it counts."""
        for source in sources:
            if self._last[source] < until:
                self._last[source] = until
                for name, value in self._held(source).items():
                    same = ((until - (self._origin or 0)) / 1e9, value)
                    events.setdefault(name, []).append(same)

    def _held(self, source: Input) -> dict[str, float]:
        """Return the values of an input; nan if they are unknown."""
        silent = source in self._silent
        return {n: math.nan if silent else source.values[place] for n, place in self._read[source]}

    def _update(self, events: _Events) -> Sequence[tuple[float, float]]:
        """Take events; return the robustness of times that they settle."""
        robustness = self._episode.update(events)
        if self._silent:
            self._gaps, self._apart = True, True
            return []
        if self._apart:  # all inputs are back
            self._apart = False
            self._forget()
            events = {
                name: [((self._last[source] - (self._origin or 0)) / 1e9, value)]
                for source in self.inputs
                for name, value in self._held(source).items()
            }
        for monitor in self._named.values():
            monitor.update({name: its for name, its in events.items() if name in monitor.variables})
        if self._monitor is not None:
            news = self._monitor.update(events)
            if self._gaps and self._about_run:
                # The monitor judges the time since the last gap; the bounds judge the whole run.
                return [(time, moved(value, *self._episode.bounds())) for time, value in news]
            return news
        if math.isnan(robustness) or (self._robustness or (None,))[0] == robustness:
            return []
        return [(self._episode.settled, robustness)]

    def _judged(self, news: Sequence[tuple[float, float]], now: int) -> Sequence[RequirementReport]:
        decided = self._decided()
        settled = (self._monitor or self._episode).settled
        if math.isinf(settled):  # no robustness is known yet
            return [self._report(now)] if decided else []
        time = self._time(settled)
        reports = []
        for start, robustness in news:
            about = self._time(start)
            self._robustness = robustness, about
            self.account.found(robustness, about)
            reports.append(self._report(time))
        if not news:
            report = self._report(time)
            return [report] if decided else []
        return reports

    def _decided(self) -> bool:
        """Return whether the verdict on the run is new, and count a violation."""
        before, self._verdict = self._verdict, self._episode.verdict
        if self._verdict is before:
            return False
        if self._verdict is Verdict.VIOLATED:
            # decided_at is None only for a verdict that an end decides; a run has no end.
            self.account.violated(self._time(self._episode.decided_at or 0.0))
        return True

    def _values(self) -> Mapping[str, float]:
        """Return the robustness of every named formula; nan where it is not known yet."""
        if self._monitor is not None:
            return self._monitor.values
        spec = self._episode.specification
        return {
            name: self._episode.robustness
            if formula is spec.formula
            else _value(self._named[name], name)
            for name, formula in spec.formulas.items()
        }

    def _latenesses(self) -> dict[str, int]:
        """Return the nanoseconds by which each formula lies before the requirement."""
        late = {
            name: each.horizon if isinstance(each, rtamt.dense.Monitor) else 0.0
            for name, each in self._named.items()
        }
        if self._monitor is not None:
            horizon = self._monitor.horizon
            late = {name: each - horizon for name, each in self._monitor.latencies.items()}
        return {name: round(each * 1e9) for name, each in late.items()}

    def _time(self, time: float) -> int:
        return (self._origin or 0) + round(time * 1e9)

    def _report(self, time: int) -> RequirementReport:
        robustness, about = self._robustness or (None, None)
        return self.account.judged(
            time,
            robustness,
            about,
            self._episode.bounds(),
            self._verdict,
            self._values(),
            may_rise=self._may_rise,
        )


def _alone(
    specification: Specification, name: str, options: Mapping[str, Any]
) -> rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor:
    """Return the monitor of a named formula."""
    formula = specification.formulas[name]
    alone = replace(specification, formula=formula, formulas={name: formula}, uses={})
    try:
        return rtamt.dense.Monitor(alone, **options)
    except SpecificationError:  # an unbounded future inside the formula
        return rtamt.dense.EpisodeMonitor(alone, **options)


def _value(monitor: rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor, name: str) -> float:
    return monitor.values[name] if isinstance(monitor, rtamt.dense.Monitor) else monitor.robustness
