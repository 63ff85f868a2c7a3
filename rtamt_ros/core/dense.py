"""A requirement in dense time: each message is an event at its time."""

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
from rtamt_ros.core.report import RequirementHistory, RequirementReport
from rtamt_ros.core.requirements import SubscribedRequirement, unbounded
from rtamt_ros.core.settings import Settings

_Events = dict[str, list[tuple[float, float]]]


class DenseJudge:
    """The monitor of a requirement on events: a value lasts until the next message of its topic.

    A run starts when every input has a current value. Robustness is reported as soon as it is
    known: with arrival times at the next message or look, because silent topics keep their values;
    with stamps when every topic has a later message. `rtamt.dense.Monitor` computes robustness, and
    `rtamt.dense.EpisodeMonitor` computes bounds and verdict. If no online monitor can run the
    requirement, the episode monitor also computes the robustness of the run so far.

    Under ``stale_as="unknown"`` a run continues while inputs are stale: their values are unknown
    until their next message. `rtamt.dense.Monitor`, which needs every value, starts again when all
    inputs are back.

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
        spec = requirement.specification
        options: Any = {"semantics": settings.semantics}
        self.history = RequirementHistory(requirement, record)
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
                name: _named_monitor(spec, name, options)
                for name, formula in spec.formulas.items()
                if formula is not spec.formula
            }
        self.lateness = {"": 0, **self._latenesses()}
        self._read = {
            source: [
                (name, index)
                for name, (owner, index) in requirement.cells.items()
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
        self._since = 0  # older values count from here
        self._fresh = True
        self._last: dict[Input, int] = {}
        self._silent: set[Input] = set()
        self._gaps = self._in_gap = False
        self._why = ""
        self._jumps = 0
        self._robustness: tuple[float, int] | None = None
        self._verdict = Verdict.UNDECIDED

    def stop(self, why: str) -> None:
        """End the run; the next event with all inputs starts a new run.

        A certain violation counts, even if no report has shown it yet.
        """
        if self._origin is not None:
            self._decided()
            self._why = why
            self._origin = None

    def reset(self, now: int) -> RequirementReport:
        """End the run on request; the last values count from now on.

        With stamps the next run starts at the oldest of the last messages, as after a restart.
        """
        self.stop("")
        self.resume(now)
        return self.history.reset(now)

    def resume(self, now: int) -> None:
        """Let the last values count from now on in the next run."""
        self._since = now if self._silence else 0

    def event(self, source: Input, now: int) -> Sequence[RequirementReport]:
        """Return the reports after a new message."""
        if self._origin is None:
            return self._begin(now)
        if self._has_jumped():
            self.stop(source.why_jumped())
            return self._begin(now)
        return self._feed([source], now)

    def look(self, now: int) -> Sequence[RequirementReport]:
        """Return the reports of a time without a message."""
        if self.history.resumes(now) and not self._unknown:
            self.stop(self.history.why_suspended)
            return [self.history.suspended(now)]
        if self._is_absent(now):
            self.stop(self.history.why_gone(now))
            return [self.history.without_inputs(now)]
        if self._origin is None:
            return self._begin(now)
        return self._feed([], now)

    def _begin(self, now: int) -> Sequence[RequirementReport]:
        if self._is_absent(now):
            return []
        self._episode.reset()
        self._reset_monitors()
        self._silent, self._gaps, self._in_gap = set(), False, False
        self._has_jumped()
        if now < self._since:  # the clock jumped back
            self._since = 0
        times = [max(source.time, self._since) for source in self.inputs if source.time is not None]
        self._origin = min(times, default=now)
        self._robustness, self._last = None, {}
        self._verdict = Verdict.UNDECIDED
        self._fresh = True
        return self._feed(self.inputs, now)

    def _reset_monitors(self) -> None:
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
            # A clock may go back a little or repeat a time, and the last value may extend to now.
            time = max(time, self._since, self._last.get(source, time - 1) + 1)
            self._last[source] = time
            row = {name: values[index] for name, index in self._read[source]}
            for name, value in row.items():
                events[name] = [((time - origin) / 1e9, value)]
            rows.append((time, row))
        if self._unknown:
            rows += self._silence_of(sources, events, now)
        if self._silence:
            until = max(self._last.values()) + 1 if sources else now - 1
            self._extend(events, self.inputs, until)
        else:
            self._extend_constants(events)
        try:
            robustness = self._update(events)
        except InputError as error:  # a term is not a number
            self.stop("there was no robustness")
            return [self.history.failed(now, str(error))]
        self._record_events(rows)
        reports = self._with_stale_inputs(now) if self._silent else self._judged(robustness, now)
        self._record_verdicts(reports)
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

    def _with_stale_inputs(self, now: int) -> Sequence[RequirementReport]:
        """Return the report of a time with stale inputs in a run that continues."""
        ages = {source.name: source.age(now) for source in self.inputs if source in self._silent}
        self._decided()
        bounds = self._episode.bounds()
        return [self.history.without_values(now, ages, bounds, self._episode.verdict)]

    def _record_events(self, rows: list[tuple[int, dict[str, float]]]) -> None:
        """Record events; the first events of a run start its file."""
        if self._fresh:
            self._fresh = False
            self.history.begin(self._why)
            self._recorded = None
            if self._record is not None:
                self._record.begin()
        if self._record is not None:
            for time, row in rows:
                for event in row.items():
                    self._record.row(time, event)

    def _record_verdicts(self, reports: Sequence[RequirementReport]) -> None:
        """Record bounds and verdicts that changed."""
        if self._record is None:
            return
        for report in reports:
            state = report.lower, report.upper, report.verdict
            if state != self._recorded and report.verdict is not None:
                self._recorded = state
                row = report.lower, report.upper, int(report.verdict)
                self._record.verdict(report.time, row)

    def _extend_constants(self, events: _Events) -> None:
        """Extend defaults and unknown values as far as the other inputs."""
        constant = [
            source for source in self.inputs if source.time is None or source in self._silent
        ]
        times = [time for source, time in self._last.items() if source not in constant]
        if constant and times:
            self._extend(events, constant, min(times))

    def _extend(self, events: _Events, sources: Sequence[Input], until: int) -> None:
        """Extend values to a time; a new message lasts at least a nanosecond, so that it counts."""
        for source in sources:
            if self._last[source] < until:
                self._last[source] = until
                for name, value in self._last_values(source).items():
                    event = ((until - (self._origin or 0)) / 1e9, value)
                    events.setdefault(name, []).append(event)

    def _last_values(self, source: Input) -> dict[str, float]:
        """Return the values of an input; nan if they are unknown."""
        silent = source in self._silent
        return {
            name: math.nan if silent else source.values[index] for name, index in self._read[source]
        }

    def _update(self, events: _Events) -> Sequence[tuple[float, float]]:
        """Update the monitors; return the times whose robustness is now known, with it."""
        robustness = self._episode.update(events)
        if self._silent:
            self._gaps = self._in_gap = True
            return []
        if self._in_gap:  # all inputs are back
            self._in_gap = False
            self._reset_monitors()
            events = {
                name: [((self._last[source] - (self._origin or 0)) / 1e9, value)]
                for source in self.inputs
                for name, value in self._last_values(source).items()
            }
        for monitor in self._named.values():
            monitor.update(
                {name: rows for name, rows in events.items() if name in monitor.variables}
            )
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
            self.history.add_robustness(robustness, about)
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
            self.history.add_violation(self._time(self._episode.decided_at or 0.0))
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
        """Return by how many nanoseconds the requirement is later than each formula."""
        late = {
            name: monitor.horizon if isinstance(monitor, rtamt.dense.Monitor) else 0.0
            for name, monitor in self._named.items()
        }
        if self._monitor is not None:
            horizon = self._monitor.horizon
            late = {name: latency - horizon for name, latency in self._monitor.latencies.items()}
        return {name: round(seconds * 1e9) for name, seconds in late.items()}

    def _time(self, time: float) -> int:
        return (self._origin or 0) + round(time * 1e9)

    def _report(self, time: int) -> RequirementReport:
        robustness, about = self._robustness or (None, None)
        return self.history.judged(
            time,
            robustness,
            about,
            self._episode.bounds(),
            self._verdict,
            self._values(),
            may_rise=self._may_rise,
        )


def _named_monitor(
    specification: Specification, name: str, options: Mapping[str, Any]
) -> rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor:
    """Return the monitor of a named formula."""
    formula = specification.formulas[name]
    single = replace(specification, formula=formula, formulas={name: formula}, uses={})
    try:
        return rtamt.dense.Monitor(single, **options)
    except SpecificationError:  # an unbounded future inside the formula
        return rtamt.dense.EpisodeMonitor(single, **options)


def _value(monitor: rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor, name: str) -> float:
    return monitor.values[name] if isinstance(monitor, rtamt.dense.Monitor) else monitor.robustness
