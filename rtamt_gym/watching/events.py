"""The trace of one group in dense time, and the monitors of its requirements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import rtamt
from rtamt import InputError, Verdict
from rtamt.typing import End, NanPolicy
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.recorded.recording import Floats, RawTimes
from rtamt_gym.results.extent import Extent
from rtamt_gym.tables import number
from rtamt_gym.watching.clock import ClockRules, StreamClock
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.rows import RowFault
from rtamt_gym.watching.states import (
    GroupTrace,
    RowValues,
    StreamRules,
    VerdictState,
    instant_verdict,
)
from rtamt_gym.watching.values import without_place


class EventState(VerdictState):
    """A requirement on the events of one trace.

    If its variables start at different times, two traces are judged: one from the first value, with
    unknown values of the other variables, and one from the time when all variables have values. The
    worse verdict counts, as in a file.
    """

    def __init__(self, rules: StreamRules, name: str, absent: Sequence[str]) -> None:
        spec, options = rules.specs[name], rules.reading
        super().__init__(name)
        nan = "unknown" if options.nan == "unknown" else "raise"
        self._keywords: dict[str, Any] = {"semantics": options.semantics, "nan": nan}
        self._spec = viewed(spec, options.view)
        self.monitor = rtamt.dense.EpisodeMonitor(self._spec, **self._keywords)
        declared = {*absent} & spec.defaults.keys()
        names = [v for v in self.monitor.variables if v not in declared] or self.monitor.variables
        self._places = {v: rules.variables.index(v) for v in names}
        self._started = False
        self._before: rtamt.dense.EpisodeMonitor | None = None
        self.decided_at: float | None = None
        self.begin = math.nan
        """The time at which the trace of the verdict starts."""
        self._instants: rtamt.dense.Monitor | None = None
        self.changes = 0
        if rules.by_step and spec.horizon < math.inf:
            self._instants = rtamt.dense.Monitor(spec, semantics=options.semantics)
            self._by_instant = True

    def update(self, time: float, row: RowValues, known: Sequence[bool]) -> None:
        """Update the monitors with the values of the known variables from a time on."""
        present = [known[place] for place in self._places.values()]
        if not any(present):
            return
        if not all(present) and self._before is None:
            keywords = {**self._keywords, "nan": "unknown"}
            self._before = rtamt.dense.EpisodeMonitor(self._spec, **keywords)
            self.begin = time
        events = {
            name: [(time, row[place] if known[place] else math.nan)]
            for name, place in self._places.items()
        }
        if self._before is not None:
            self._before.update(events)
        if all(present):
            if not self._started and self._before is None:
                self.begin = time
            self._started = True
            self.monitor.update(events)

    def instants(
        self, time: float, row: RowValues, known: Sequence[bool]
    ) -> list[tuple[float, float]]:
        """Return the breakpoints of the robustness that the values settle."""
        if self._instants is None or not all(known[place] for place in self._places.values()):
            return []
        return self._instants.update({n: [(time, row[place])] for n, place in self._places.items()})

    @property
    def _counted(self) -> rtamt.dense.EpisodeMonitor:
        """The monitor whose verdict counts."""
        before = self._before
        if before is not None and (not self._started or before.verdict < self.monitor.verdict):
            return before
        return self.monitor

    def decide(self, time: float) -> bool:
        """Note a decision; return whether the values up to a time have decided the verdict."""
        counted = self._counted
        verdict = counted.verdict
        if not self._started and verdict is not Verdict.VIOLATED:
            verdict = Verdict.UNDECIDED  # the trace with all values has not started
        if verdict is self.verdict or self.verdict:
            return False
        self.verdict = verdict
        self.decided_at = time if self._before is not None else counted.decided_at
        return True

    def bounds(self) -> tuple[float, float, float]:
        """Return the robustness and its bounds."""
        counted, other = self._counted, self._before
        if self.verdict or self.monitor.finished or other is None:
            return counted.robustness, counted.lower, counted.upper
        if not self._started:
            return math.nan, -math.inf, math.inf
        lower = min(self.monitor.lower, other.lower)
        return counted.robustness, lower, max(self.monitor.upper, other.upper)

    def finish(self, end: End, *, early: bool) -> None:
        """End the trace."""
        if not self._started and early:
            return
        if not self._started:
            raise InputError(f"{self.name}: expected events of every variable that it reads")
        self.monitor.finish(end)
        if self._before is not None:
            self._before.finish(end)
        verdict = self._counted.verdict
        if verdict is not self.verdict:
            self.verdict, self.reason = verdict, f"the end of the trace ({end})"


_FIRST = 512
"""The number of times that are checked for a plausible unit."""

_SURE = 64
"""The times up to which each shows whether all are seconds; after it, each power of two does."""

_TICK = 1e-9
"""The resolution of dense time in seconds."""


class EventGroup(GroupTrace):
    """The events of one group."""

    def __init__(
        self,
        rules: StreamRules,
        columns: Columns,
        clock: ClockRules,
        group: str | None,
        absent: Sequence[str],
    ) -> None:
        super().__init__(rules, columns, clock, group)
        self._clock_rules: ClockRules = clock
        self._states = [EventState(rules, name, absent) for name in rules.specs]
        self._kept: list[tuple[float, RowValues]] = []
        self._held: list[float] = []
        self._pending: list[float] = []
        self._raw: RawTimes | None = None
        self._fed = False
        self._time = self._judged = 0.0
        self._first: RawTimes = np.zeros(0, np.int64)
        self._changes: list[tuple[float, RowValues]] = []
        """The values from the row before on, with their times."""
        self._late: list[str] = []
        """The variables that still have their default, because no event came."""

    def lose(self) -> None:
        """Note that a line was left out: values are unknown from the last row to the next."""
        self._gap = True

    def feed(self, values: Floats, raw: RawTimes | None, lines: Sequence[int]) -> None:
        """Take in rows, as `SampledGroup.feed` does."""
        assert raw is not None, "events have times"  # noqa: S101 - for mypy
        for at, row in enumerate(values.tolist()):
            try:
                self._row(row, raw[at : at + 1], lines[at])
            except RowFault as fault:
                fault.row = at
                raise
            except InputError as error:
                raise RowFault(at, without_place(error), skippable=False) from error
            if self.stopped:
                self.stop_line = lines[at]
                return

    def _row(self, row: list[float], raw: RawTimes, line: int) -> None:
        if self._clock is None:
            self._clock = self._begin(raw, line)
            self._take_defaults(row)
        elif self._raw is not None:
            if self._check_back(self._raw, raw):
                self._merge(row)
                self._count_empty(row)
                return
            self._flush()
            if self.stopped:
                return
        time = self._clock.start + float(self._clock.since(raw)[0])
        if not math.isfinite(time):
            raise RowFault(0, f"expected a finite time, got {raw[0]}")
        if not self._clock.certain and len(self._first) < _FIRST:
            self._clock = self._checked_clock(self._clock, raw, line)
            time = self._clock.start + float(self._clock.since(raw)[0])
        if self._gap and self.samples:
            self._forget_values(time, len(row))
            self._held = [math.nan] * len(row)  # until the next event of each variable
        self._gap = False
        self._raw, self._time, self._fed = raw, time, False
        self._pending = row
        self._count_empty(row)
        if not any(map(self._is_no_event, row)):
            self._flush()

    def _count_empty(self, row: RowValues) -> None:
        """Count the empty cells of a row."""
        for name, value in zip(self._rules.variables, row, strict=True):
            if math.isnan(value):
                self._missing[name] += 1
                if self._is_no_event(value):
                    self._rules.notes.no_events[name] += 1

    def _take_defaults(self, row: RowValues) -> None:
        """Take the defaults of the variables without an event in the first row, or refuse them."""
        starts = self._columns.starts
        for name, value in zip(self._rules.variables, row, strict=True):
            if self._is_no_event(value) and name in starts:
                self._default_note(name, "its first cell is empty")
                self._late.append(name)

    def _begin(self, raw: RawTimes, line: int) -> StreamClock:
        """Return the clock that starts with the first row."""
        starts, variables = self._columns.starts, self._rules.variables
        self._held = [starts.get(name, math.nan) for name in variables]
        self._known = [name in starts for name in variables]
        try:
            return StreamClock(self._clock_rules, raw, [line])
        except InputError as error:
            raise RowFault(0, without_place(error)) from None

    def _forget_values(self, time: float, width: int) -> None:
        """Count values as unknown between the last row and a time, after a bad line."""
        after = max(self._judged + _TICK, math.nextafter(self._judged, math.inf))
        if after < time:
            unknown = [math.nan] * width
            self._changes.append((after, unknown))
            self._keep(after, unknown)
            for state in self._states:
                state.update(after, unknown, self._known)

    def _checked_clock(self, clock: StreamClock, raw: RawTimes, line: int) -> StreamClock:
        """Return the clock after a check that the first times can be seconds; more show more."""
        self._first = np.concatenate([self._first, raw]) if len(self._first) else raw
        count = len(self._first)
        if count == 1 or (count > _SURE and count & (count - 1)):
            return clock
        try:
            if count == 2:  # they may decide the unit
                return StreamClock(self._clock_rules, self._first, [line, line])
            self._clock_rules.axis(self._first, [line] * count)
        except InputError as error:
            raise RowFault(0, without_place(error), skippable=False) from None
        return clock

    def _is_no_event(self, value: float) -> bool:
        return math.isnan(value) and self._columns.missing != "unknown"

    def _merge(self, row: RowValues) -> None:
        """Add the values of a further row at the time of the last."""
        for place, value in enumerate(row):
            old = self._pending[place]
            if self._is_no_event(value) or old == value or (old != old and value != value):  # noqa: PLR0124
                continue
            if not self._is_no_event(old):
                raise self._two_values(self._rules.variables[place], old, value)
            self._pending[place] = value

    def _flush(self) -> None:
        """Judge the values at the time of the last row, which is complete."""
        if self._fed or self._raw is None:
            return
        for place, value in enumerate(self._pending):
            if not self._is_no_event(value):
                if math.isnan(value):
                    name = self._rules.variables[place]
                    self._rules.notes.add_unknown_event(name, self._time)
                self._held[place], self._known[place] = value, True
                name = self._rules.variables[place]
                if name in self._late:
                    self._late.remove(name)
                    if self._time > self._clock_start:
                        why = f"its first event comes at {number(self._time)} s"
                        self._rules.notes.add_default(self._default_note(name, why))
        row = [*self._held]
        self._keep(self._time, row)
        for state in self._states:
            state.update(self._time, row, self._known)
        self._judged, self._fed = self._time, True
        self.samples += 1
        self._changes.append((self._time, row))
        self._look(row)
        del self._changes[:-1]

    def _keep(self, time: float, row: RowValues) -> None:
        """Keep a row for the count of triggers, once all variables have a value."""
        evidence = self._rules.evidence
        if not evidence.counted or not evidence.add(1):
            self._kept.clear()
        elif all(self._known):
            self._kept.append((time, row))

    def _judge_all(self, spec: rtamt.Specification, end: End) -> rtamt.Judgement:
        """Judge a requirement on all rows again, with its triggers."""
        places = {name: self._rules.variables.index(name) for name in spec.variables}
        events = {
            name: [(time, row[place]) for time, row in self._kept] for name, place in places.items()
        }
        reading = self._rules.reading
        nan: NanPolicy = "unknown" if reading.nan == "unknown" else "raise"
        return rtamt.dense.judge(spec, events, end, semantics=reading.semantics, nan=nan)

    @property
    def _clock_start(self) -> float:
        return math.inf if self._clock is None else self._clock.start

    def _values_at(self, time: float) -> RowValues:
        """Return the values at a time since the row before."""
        near = time + max(_TICK / 2, math.ulp(time))
        rows = [row for begin, row in self._changes if begin <= near]
        return rows[-1] if rows else self._changes[0][1]

    def _look(self, row: RowValues) -> None:
        rules = self._rules
        for state in self._states:
            decided = state.decide(self._time)
            if decided:
                rules.undecided -= 1
                at = self._time if state.decided_at is None else state.decided_at
                values = self._values_at(at)
                state.reason = rules.values_text(state.monitor.variables, values)
            if not rules.by_step:
                if decided or rules.every or self.samples == 1:
                    rules.emit(self._line(state))
                continue
            if self.samples == 1:
                rules.emit(self._line(state))
            self._emit_instants(state, state.instants(self._time, row, self._known))
        self._end_row(row, self._states)

    def _emit_instants(self, state: EventState, points: list[tuple[float, float]]) -> None:
        for time, robustness in points:
            verdict = instant_verdict(robustness)
            if verdict is state.last_instant and not self._rules.every:
                continue
            state.changes += verdict is not state.last_instant
            state.last_instant = verdict
            line = Line(
                *(state.name, self.group, time, None, verdict),
                *(robustness, robustness, robustness),
                decided_at=self._time,
            )
            self._rules.emit(line)
            if verdict is Verdict.VIOLATED and self._rules.stop == "violation":
                return

    def _line(self, state: EventState) -> Line:
        return Line(
            *(state.name, self.group, self._judged, None, state.verdict),
            *state.bounds(),
            decided_at=state.decided_at,
            reason=state.reason,
        )

    def finish(self, end: End, *, early: bool = False) -> list[Line]:
        """End the trace; return the final line of each requirement."""
        if not self.stopped:
            self._flush()
        self._rules.undecided -= sum(not state.verdict for state in self._states)
        if not self.samples:
            return []
        if self._gap:
            end = "open"
        for name in self._late:
            self._rules.notes.add_default(self._default_note(name, "it has no event"))
        if self._clock is not None and len(self._first) > 1:
            try:
                self._clock_rules.axis(self._first, [0] * len(self._first))
            except InputError as error:
                raise InputError(without_place(error)) from None
            length = self._judged - self._clock.start
            self._rules.notes.add_unit(self._clock.unit_note(self._first, length))
        if self._kept and self._rules.evidence.counted:
            self._rules.evidence.finish(lambda _, spec: self._judge_all(spec, end))
        lines = []
        for state in self._states:
            state.finish(end, early=early)
            counts: Mapping[str, int] | None = None
            if self._rules.by_step:
                counts = {"changes": state.changes}
            missing = self._missing_of(state.monitor.variables)
            line = self._line(state)._replace(end=end, final=True, instants=counts)
            lines.append(line._replace(missing=missing))
        return lines

    def newest(self) -> list[Line]:
        """Return the newest line of each requirement; an empty list before the first."""
        return [self._line(state) for state in self._states] if self.samples else []

    @property
    def begun(self) -> bool:
        """Whether a row has come."""
        return self._raw is not None

    @property
    def seconds(self) -> float | None:
        """The time of the last row; None before there is one."""
        return None if self._raw is None else self._time

    def extent(self) -> Extent:
        """Return the extent of the trace so far."""
        start = max(state.begin for state in self._states)
        return Extent(None, self.samples, None, start, self._judged, 1.0)
