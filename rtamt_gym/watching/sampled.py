"""The trace of one group, of samples at even distances."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

import rtamt
from rtamt import InputError, Verdict
from rtamt.typing import End
from rtamt_gym.checks.names import listing
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Floats, RawTimes
from rtamt_gym.recorded.roles import counts_rows
from rtamt_gym.recorded.times import HOLE
from rtamt_gym.recorded.trace_files import DROPPED_ROW, check_bounds
from rtamt_gym.results.extent import Extent
from rtamt_gym.tables import number, time_text
from rtamt_gym.watching.clock import (
    DRIFT,
    ClockRules,
    StepCounter,
    StreamClock,
    on_grid,
    plain_times,
)
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.rows import RowFault
from rtamt_gym.watching.states import (
    GroupTrace,
    RowValues,
    SampledState,
    StreamRules,
    instant_verdict,
)
from rtamt_gym.watching.values import without_place

_UNKNOWN = 1_000_000
"""The maximum number of successive samples that bad lines may leave out."""


class SampledGroup(GroupTrace):
    """The samples of one group.

    Args:
        rules: How traces are judged.
        columns: How empty cells count.
        clock: How times are read; None without a column of times.
        group: The name of the group; None without groups.
        lost: Whether rows may be missing after a bad line.
    """

    def __init__(
        self,
        rules: StreamRules,
        columns: Columns,
        clock: ClockRules | None,
        group: str | None,
        *,
        lost: bool,
    ) -> None:
        super().__init__(rules, columns, clock, group)
        self._lost = lost
        self._period = rules.reading.seconds
        self._stated = self._period is not None
        self._timed_specs = any(spec.timed for spec in rules.specs.values())
        self._states: list[SampledState] = []
        self._first: tuple[RowValues, RawTimes, int] | None = None
        self._two: RawTimes = np.zeros(0)
        """The first two times, which set the period."""
        self._held: RowValues | None = None
        self._last_raw: RawTimes | None = None
        self._last_row: RowValues = ()
        self._last = 0.0
        self._steps = StepCounter("" if clock is None else clock.source)
        self._kept: list[Floats] = []
        self._newest: tuple[float, bool] | None = None
        """The time of the newest row, and whether it has an empty cell, if rows are left out."""
        self._begins = self._left_out = False
        """Whether a full row has come, and an empty one after it, if rows are left out."""
        self._all_steps = StepCounter(self._steps.source)
        """The distances of all rows, if rows with an empty cell are left out."""
        if self._stated or clock is None:
            self._start()

    def lose(self) -> None:
        """Note that a line was left out: one unknown sample, or with times a gap."""
        self._gap = self._clock_rules is not None and not self._stated
        self._held = None if self._held is None else [math.nan] * len(self._held)
        if not self._gap:
            self._steps.lose()
            self._take(np.full((1, len(self._rules.variables)), math.nan), ())

    def feed(self, values: Floats, raw: RawTimes | None, lines: Sequence[int]) -> None:
        """Take in rows.

        Args:
            values: The values of the variables, shape (rows, variables).
            raw: The times; None without a column of times.
            lines: The lines of the rows.

        Raises:
            RowFault: At a row that cannot be judged, after all rows before it were judged.
        """
        fault, drops = None, self._columns.missing == "drop"
        if drops and raw is None:
            fault = self._fault_of_left_out(values)
        elif drops and raw is not None and not self._stated:
            fault = self._fault_of_dropped(values, raw)
            if len(raw):
                self._all_steps.add(plain_times(raw), lines)
        count = len(values) if fault is None else fault.row
        self._feed_rows(values[:count], None if raw is None else raw[:count], lines[:count])
        if fault is not None and not self.stopped:
            raise fault

    def _feed_rows(self, values: Floats, raw: RawTimes | None, lines: Sequence[int]) -> None:
        if not len(values):
            return
        empty = np.isnan(values)
        values, kept = self._filled(values, empty)
        if kept is None:
            chosen, raw_times = lines, raw
        else:
            raw_times = None if raw is None else raw[kept]
            chosen = [lines[i] for i in kept.tolist()]
        try:
            if len(values):
                self._feed(values, raw_times, chosen)
        except RowFault as fault:
            if kept is not None:
                fault.row = int(kept[fault.row])
            self._note_empty(empty[: fault.row], lines)
            raise
        count = bisect_right(lines, self.stop_line) if self.stopped else len(lines)
        self._note_empty(empty[:count], lines)

    def _note_empty(self, empty: np.ndarray, lines: Sequence[int]) -> None:
        """Count the empty cells of rows that were taken in."""
        if not empty.any():
            return
        notes, variables, missing = self._rules.notes, self._rules.variables, self._columns.missing
        for name, count in zip(variables, empty.sum(axis=0).tolist(), strict=True):
            if count:
                self._missing[name] += count
                notes.held[name] += count if missing == "hold" else 0
        if missing == "drop":
            notes.dropped += int(empty.any(axis=1).sum())
        elif missing == "unknown":
            notes.add_unknown(variables, empty, lines)

    def _feed(self, values: Floats, raw: RawTimes | None, lines: Sequence[int]) -> None:
        if raw is None or self._clock_rules is None:
            self._take(values, lines)
            return
        at = 0
        if self._clock is None and self._stated:
            self._clock = StreamClock(self._clock_rules, raw[:1], lines)
        while self._clock is None and at < len(values):
            self._begin(values[at].tolist(), raw[at : at + 1], lines[at], at)
            at += 1
        if at < len(values) and not self.stopped:
            try:
                self._timed(values[at:], raw[at:], lines[at:])
            except RowFault as fault:
                fault.row += at
                raise

    def _begin(self, row: RowValues, raw: RawTimes, line: int, at: int) -> None:
        """Take in the first row, and with the second the period."""
        assert self._clock_rules is not None, "there are times"  # noqa: S101 - for mypy
        if self._first is None:
            try:
                self._clock_rules.axis(raw, [line])
            except InputError as error:
                raise RowFault(at, without_place(error)) from None
            self._first = row, raw, line
            return
        before, first, first_line = self._first
        if self._gap:
            raise RowFault(
                at,
                "expected the period from the first two rows, but a bad line lies between them; "
                "give --period",
                skippable=False,
            )
        both = np.concatenate([first, raw])
        if (first.dtype.kind in "mM") != (raw.dtype.kind in "mM"):
            raise RowFault(at, "expected times like the first, got numbers and dates")
        if self._same_row(first, before, row, raw, at):
            return
        lines = [first_line, line]
        clock = StreamClock(self._clock_rules, both, lines)
        self._period = clock.period(self._clock_rules.source, lines, timed=self._timed_specs)
        reading = self._rules.reading.having(period=self._period)
        check_bounds(self._rules.specs, reading, clock.unit_doubt)
        self._clock, self._first, self._two = clock, None, both
        self._start()
        self._last, self._last_raw, self._last_row = float(clock.since(raw)[0]), raw, row
        self._take(np.array([before, row]), [line])

    def _timed(self, values: Floats, raw: RawTimes, lines: Sequence[int]) -> None:
        """Take in rows with times, after the clock is known."""
        clock, period = self._clock, self._period
        assert clock is not None and period is not None  # noqa: S101, PT018 - for mypy
        try:
            since = clock.since(raw)
        except InputError as error:
            raise RowFault(0, str(error)) from None
        finite = np.isfinite(since)
        count = len(values) if finite.all() else int(finite.argmin())
        if self._stated:
            previous = since[:1] if self._last_raw is None else np.array([self._last])
            back = np.diff(np.concatenate([previous, since])) < 0
            good = count if not back.any() else min(count, int(back.argmax()))
        else:
            near = on_grid(
                *(since, self._last, self.samples, float(period), clock.precision(raw, since)),
                counted=self._timed_specs,
            )
            good = count if near.all() else min(count, int(near.argmin()))
        if good:
            self._gap = False
            before = self.samples
            stopped = self._take(values[:good], lines)
            taken = self.samples - before
            self._last = float(since[taken - 1])
            self._last_raw, self._last_row = raw[taken - 1 : taken], values[taken - 1].tolist()
            if self._stated:
                self._steps.add(since[:taken], lines[:taken])
            if stopped:
                return
        if good == len(values):
            return
        if good == count:
            raise RowFault(good, f"expected a finite time, got {raw[good]}")
        self._odd_row(
            values[good].tolist(), raw[good : good + 1], float(since[good]), good, lines[good]
        )
        if good + 1 < len(values) and not self.stopped:
            try:
                self._timed(values[good + 1 :], raw[good + 1 :], lines[good + 1 :])
            except RowFault as fault:
                fault.row += good + 1
                raise

    def _odd_row(self, row: RowValues, raw: RawTimes, since: float, at: int, line: int) -> None:
        """Judge a row off the grid: at the time of the row before, or after a gap."""
        assert self._last_raw is not None, "a row came before"  # noqa: S101 - for mypy
        if self._same_row(self._last_raw, self._last_row, row, raw, at):
            return
        period = float(self._period or 1)
        steps = round((since - self._last) / period)
        off = abs(since - self._last - steps * period)
        if self._lost and self._gap and 2 <= steps <= _UNKNOWN and off <= 0.05 * period:
            self._gap = False
            self._last, self._last_raw, self._last_row = since, raw, row
            self._take(np.array([*[[math.nan] * len(row)] * (steps - 1), row]), [line])
            return
        start = 0.0 if self._clock is None else self._clock.start
        if self._timed_specs and abs(since - self._last - period) <= DRIFT * period:
            place = time_text(start + since, period)
            raise RowFault(
                at,
                f"expected samples {period:.6g} s apart, as the first two are, but the later rows "
                f"drift from it: {place} is sample {self.samples}. Give --period {period:.6g}s to "
                "count rows, --period TIME for another step, or --dense to read the times.",
                skippable=False,
            )
        text = f"{time_text(start + since, period)} after {time_text(start + self._last, period)}"
        aside = "" if self._timed_specs else ", or --period to leave the times aside"
        raise RowFault(
            at,
            f"expected samples {period:.6g} s apart, as the first two are, got {text}; give "
            f"--dense to take rows as events at any time{aside}",
        )

    def _same_row(
        self, before: RawTimes, last: RowValues, row: RowValues, raw: RawTimes, at: int
    ) -> bool:
        """Return whether a row has the time of the row before it, and the same values."""
        try:
            if not self._check_back(before, raw):
                return False
            for name, old, new in zip(self._rules.variables, last, row, strict=True):
                if old != new and not (math.isnan(old) and math.isnan(new)):
                    raise self._two_values(name, old, new)
        except RowFault as fault:
            fault.row = at
            raise
        return True

    def _fault_of_left_out(self, values: Floats) -> RowFault | None:
        """Return the fault of the first counted row after a row that is left out, or None."""
        if self._columns.one_trace or not any(map(counts_rows, self._rules.specs.values())):
            return None
        for row, gap in enumerate(map(any, np.isnan(values).tolist())):
            if not gap and self._left_out:
                return RowFault(row, DROPPED_ROW, skippable=False)
            self._left_out = gap and self._begins
            self._begins |= not gap
        return None

    def _fault_of_dropped(self, values: Floats, raw: RawTimes) -> RowFault | None:
        """Return the fault of a row that is left out next to another row at its time, or None.

        A file has the values of both in one sample.
        """
        empty = map(any, np.isnan(values).tolist())
        for row, (time, gap) in enumerate(zip(plain_times(raw).tolist(), empty, strict=True)):
            before, self._newest = self._newest, (time, gap)
            if before is not None and before[0] == time and (gap or before[1]):
                return RowFault(
                    row,
                    f"expected the values of one time in one row, got two rows at {raw[row]}, of "
                    "which one has an empty cell. Write one row, or give --dense.",
                    skippable=False,
                )
        return None

    def _filled(self, values: Floats, empty: np.ndarray) -> tuple[Floats, np.ndarray | None]:
        """Return the rows after the treatment of empty cells, and their places if some are left."""
        if self._columns.missing == "hold":
            self._held = self._hold(values, empty)
        if self._columns.missing == "drop" and empty.any():
            (kept,) = np.nonzero(~empty.any(axis=1))
            return values[kept], kept
        return values, None

    def _hold(self, values: Floats, empty: np.ndarray) -> RowValues:
        """Fill empty cells with the value before."""
        held = self._held
        if empty.any():
            for row, (cells, gaps) in enumerate(zip(values, empty, strict=True)):
                for index in np.nonzero(gaps)[0].tolist():
                    name = self._rules.variables[index]
                    start = self._columns.starts.get(name)
                    value = start if held is None else held[index]
                    if value is None:
                        raise RowFault(
                            row,
                            f"column '{self._columns.column(name)}': expected a number to hold, "
                            "got an empty cell; give --missing unknown",
                        )
                    if held is None:
                        self._note_default(row, name)
                    cells[index] = value
                held = cells.tolist()
        last: RowValues = values[-1].tolist()
        return last

    def _note_default(self, row: int, name: str) -> None:
        """Note that a variable has its default at the first row, or refuse the default."""
        try:
            note = self._default_note(name, "its first cell is empty")
        except InputError as error:
            raise RowFault(row, str(error), skippable=False) from None
        self._rules.notes.add_default(note)

    def _start(self) -> None:
        self._states = [SampledState(self._rules, name, self._period) for name in self._rules.specs]

    def _take(self, values: Floats, lines: Sequence[int]) -> bool:
        """Update the monitors with samples of some lines; return whether the stream stops."""
        before = self.samples
        if self._rules.evidence.add(len(values)):
            self._kept.append(values)
        else:
            self._kept.clear()
        try:
            stopped = self._update(values)
            if stopped and lines:
                self.stop_line = lines[min(self.samples - before, len(lines)) - 1]
        except InputError as error:  # as of a term without a value, sqrt(-1)
            at = max(state.monitor.samples for state in self._states) - before
            self.samples = min(state.monitor.samples for state in self._states)
            raise RowFault(at, str(error), skippable=False) from None
        return stopped

    def _update(self, values: Floats) -> bool:
        states, at = self._states, 0
        rules = self._rules
        if self.samples and not (rules.every or rules.by_step or rules.show):
            at = self._update_quietly(values)
            decided = any(state.monitor.verdict is not state.verdict for state in states)
            if decided and self._look(values[at - 1].tolist()):
                return True
        for row in values[at:].tolist():
            for state in states:
                state.update(*state.pick(row))
            self.samples += 1
            if self._look(row):
                return True
        return False

    def _update_quietly(self, values: Floats) -> int:
        """Update the monitors with samples without lines; return how many were taken.

        The last of them may have decided a verdict.
        """
        states, taken = self._states, 0
        if all(state.verdict for state in states):
            for state in states:
                deque(state.updates(values), maxlen=0)
            taken = len(values)
        elif len(states) == 1:
            monitor = states[0].monitor
            for taken, _ in enumerate(states[0].updates(values), 1):  # noqa: B007 - counts
                if monitor.verdict:
                    break
        self.samples += taken
        return taken

    def _look(self, row: RowValues) -> bool:
        """Emit the lines of the last sample; return whether the stream stops."""
        rules, sample = self._rules, self.samples - 1
        for state in self._states:
            decided = state.decide(sample, row)
            rules.undecided -= decided
            if not rules.by_step:
                if decided or rules.every or not sample:
                    rules.emit(self._line(state, sample))
                continue
            settled = state.take_instant(sample, row)
            if settled is not None and (settled[2] or rules.every):
                rules.emit(self._instant_line(state, settled[0], settled[1]))
            elif settled is None and not sample:
                rules.emit(self._line(state, sample))
        self._end_row(row, self._states)
        return self.stopped

    def _time(self, sample: int) -> float | None:
        if self._period is None:
            return None if self._first is None else self._start_time
        return self._start_time + sample * self._period.numerator / self._period.denominator

    @property
    def _start_time(self) -> float:
        if self._clock is not None:
            return self._clock.start
        if self._first is not None and self._clock_rules is not None:
            return self._clock_rules.axis(self._first[1], [self._first[2]]).start
        return 0.0

    def _line(self, state: SampledState, sample: int) -> Line:
        monitor = state.monitor
        at = state.decided_at
        time = None if at is None else (at if self._period is None else self._time(at))
        return Line(
            state.name,
            self.group,
            self._time(sample),
            sample,
            state.verdict,
            monitor.robustness,
            monitor.lower,
            monitor.upper,
            decided_at=time,
            reason=state.reason,
        )

    def _instant_line(self, state: SampledState, at: int, robustness: float) -> Line:
        verdict = instant_verdict(robustness)
        time = self._time(at)
        return Line(
            *(state.name, self.group, time, at, verdict, robustness, robustness, robustness),
            decided_at=self.samples - 1 if time is None else self._time(self.samples - 1),
        )

    def finish(self, end: End, *, early: bool = False) -> list[Line]:
        """End the trace; return the final line of each requirement."""
        if self._first is not None:
            row = self._first[0]
            timed = [name for name, spec in self._rules.specs.items() if spec.timed]
            if timed and early:
                self._rules.undecided -= len(self._rules.specs)
                return [self._open_line(name) for name in self._rules.specs]
            if timed and self._clock_rules is not None:
                raise InputError(
                    f"{self._clock_rules.source}: expected at least two rows to read the period "
                    f"from, which {listing(timed)} needs, got one. Give --period in seconds."
                )
            self._start()
            self._take(np.array([row]), ())
        rules = self._rules
        open_ = (
            sum(not state.verdict for state in self._states) if self._states else len(rules.specs)
        )
        rules.undecided -= open_
        if not self.samples and self._missing and not early:
            raise InputError("expected a row without an empty cell, got none")
        if not self.samples:
            return []
        self._check_steps()
        if self._gap:
            end = "open"
        self._note_times()
        if self._kept and rules.evidence.counted:
            rules.evidence.finish(lambda name, spec: self._judge_all(name, spec, end))
        lines = []
        for state in self._states:
            state.finish(end)
            line = self._line(state, self.samples - 1)
            counts = state.counts(self.samples, end)
            missing = self._missing_of(state.monitor.variables)
            lines.append(line._replace(end=end, final=True, instants=counts, missing=missing))
        return lines

    def _check_steps(self) -> None:
        """Note the period of a group; raise InputError if the only two rows may have a gap."""
        if self.group is not None and len(self._two) and self._period is not None:
            self._rules.periods.add(self.group, self._period, self.samples)
        steps = self._all_steps.times()
        if steps is None or self.samples != 2 or not len(self._two):
            return
        first, second = plain_times(self._two).tolist()
        if second - first >= HOLE * steps.usual:
            raise InputError(
                f"{self._steps.source}: expected samples at even distances, got time "
                f"{self._two[1]} after {self._two[0]}, with rows between them that are left out. "
                "Give --missing unknown for unknown samples, or --dense for events."
            )

    def _judge_all(self, name: str, spec: rtamt.Specification, end: End) -> rtamt.Judgement:
        """Judge a requirement on all samples again, with its triggers."""
        values = np.concatenate(self._kept)[: self.samples]
        places = {variable: self._rules.variables.index(variable) for variable in spec.variables}
        columns = {variable: values[:, place] for variable, place in places.items()}
        keywords = self._rules.keywords(name, self._period)
        return rtamt.judge(spec, columns, end=end, n=self.samples, **keywords)

    def _note_times(self) -> None:
        if self._clock is not None and self._period is not None and not self._stated:
            length = float((self.samples - 1) * self._period)
            self._rules.notes.add_unit(self._clock.unit_note(self._two, length))
            if self._drifts:
                note = (
                    f"rows drift from the period of the first two, {number(float(self._period))} s:"
                    f" {number(self._last)} s in all, not {number(length)} s"
                )
                self._rules.notes.add_period(note, self.group)
        aside = self._steps.times()
        if aside is not None and self._clock_rules is not None and self._period is not None:
            note = aside.note(self._clock_rules.column, self._period, self.samples)
            self._rules.notes.add_period(note, self.group)

    @property
    def _drifts(self) -> bool:
        """Whether the last row is far from its place on the grid of the first two."""
        if self._period is None or self._stated or self._clock is None:
            return False
        return abs(self._last - (self.samples - 1) * self._period) > self._period / 2

    def _open_line(self, name: str) -> Line:
        """Return the final line of a trace of one row, which does not have a period."""
        infinite = -math.inf, math.inf
        return Line(
            *(name, self.group, self._start_time, 0, Verdict.UNDECIDED, math.nan, *infinite),
            end="open",
            final=True,
        )

    def newest(self) -> list[Line]:
        """Return the newest line of each requirement; an empty list before the first."""
        return (
            [self._line(state, self.samples - 1) for state in self._states] if self.samples else []
        )

    @property
    def begun(self) -> bool:
        """Whether a row has come."""
        return bool(self.samples) or self._first is not None

    @property
    def seconds(self) -> float | None:
        """The time of the last sample; None before there is one, or without times."""
        return self._time(self.samples - 1) if self.samples else None

    def extent(self) -> Extent:
        """Return the extent of the trace so far."""
        if self._period is None:
            return Extent(self.samples)
        start, end = self._time(0), self._time(self.samples - 1)
        if self._drifts:  # without a period, the length is that of the times
            end = self._start_time + self._last
            return Extent(self.samples, None, None, start, end, float(self._period))
        return Extent(self.samples, None, self._period, start, end, float(self._period))

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples."""
        return self._period
