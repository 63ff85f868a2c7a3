"""Traces of the variables that specifications read, samples or events, and their gaps."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError
from rtamt.columns import median
from rtamt_gym.recorded.columns import NEAR
from rtamt_gym.recorded.recording import Floats, places_of
from rtamt_gym.recorded.times import Grid, TimeAxis
from rtamt_gym.results.extent import Extent, Gap, LateStart
from rtamt_gym.tables import counted, number, time_text

_NOW = 0, ""
"""From when on no variable is known."""

PERIODS = 1e-300, 1e300
"""The periods, in seconds, that rtamt takes."""


@dataclass(frozen=True, slots=True)
class PassedRows:
    """Rows between samples whose values no sample of a resampled trace has.

    Attributes:
        lower: The smallest such value of each variable at or before each sample, after the previous
            sample.
        upper: The largest such values.
        count: The number of such rows.
        place: The first of them.
    """

    lower: Mapping[str, Floats]
    upper: Mapping[str, Floats]
    count: int
    place: str

    def selected(self, rows: NDArray[np.intp]) -> PassedRows:
        """Return the values at some samples."""
        lower = {name: values[rows] for name, values in self.lower.items()}
        upper = {name: values[rows] for name, values in self.upper.items()}
        return replace(self, lower=lower, upper=upper)


@dataclass(frozen=True, slots=True)
class Trace:
    """Samples of the variables that specifications read.

    Attributes:
        source: Name of the file, for messages.
        columns: The values of each variable.
        samples: The number of samples.
        times: The times, or None.
        where: Returns the file and line of a sample, for messages.
        jitter: The part of the period by which a sample may lie off the grid, None for the default.
        if_events: Advice for errors that rows which are events, not samples, may cause.
        notes: Sentences to print about changes to the samples of the file.
        epoch: Time 0 in nanoseconds on the clock that recorded a bag; otherwise, 0.
        known_from: The first sample with a value of each variable that starts late, such as a topic
            of a bag; its earlier values are nan.
        unknown: The variables with unknown values, which are nan.
        defaults: The variables that have their default in part of the trace or in all of it.
        gap: The longest time between two records of one variable, if there are times.
        grid: The grid of the times, if it is already computed.
        start_known: Whether the trace of a requirement starts at the first sample at which all its
            variables have a value.
        passed: The rows between the samples of a resampled trace, if their values differ.
    """

    source: str
    columns: Mapping[str, Floats]
    samples: int
    times: TimeAxis | None
    where: Callable[[int], str]
    jitter: float | None = None
    if_events: str = ""
    notes: Sequence[str] = ()
    epoch: int = 0
    known_from: Mapping[str, int] = field(default_factory=dict)
    unknown: Collection[str] = ()
    defaults: Mapping[str, float] = field(default_factory=dict)
    gap: Gap | None = None
    grid: Grid | None = None
    start_known: bool = False
    passed: PassedRows | None = None

    def late_start(self, variables: Collection[str]) -> LateStart | None:
        """Return the start of a trace of variables; None if all start at the first sample."""
        firsts = {name: self.known_from.get(name, 0) for name in variables}
        first, begin = max(firsts.values(), default=0), min(firsts.values(), default=0)
        if not 0 < first < self.samples or self.times is None:
            return None
        late = [name for name, index in firsts.items() if index == first > begin]
        time, since = (self.start + float(self.times.since[index]) for index in (first, begin))
        return LateStart(time, since, tuple(late), first - begin, "sample")

    def with_beginning(self, variables: Collection[str]) -> Trace:
        """Return the trace from the first sample at which any of the variables has a value."""
        begin = min(self.known_from.get(name, 0) for name in variables)
        return replace(self.selected(np.arange(begin, self.samples)), known_from={})

    def known(self, variables: Collection[str]) -> Trace:
        """Return the trace from the first sample at which all of the variables have a value."""
        first, late = max(
            ((self.known_from.get(name, 0), name) for name in variables), default=_NOW
        )
        if first >= self.samples:
            raise InputError(
                f"{self.source}: expected a sample with a value of '{late}', got none: its first "
                "comes after the last sample"
            )
        if not first:
            return self
        return replace(self.selected(np.arange(first, self.samples)), known_from={})

    def selected(self, rows: NDArray[np.intp]) -> Trace:
        """Return some rows as samples."""
        times = self.times
        if times is not None:
            since = times.since[rows]
            start = times.start + float(since[0])
            times = replace(times, since=since - since[0], start=start, step=None)
        columns = {name: values[rows] for name, values in self.columns.items()}
        return replace(
            self,
            columns=columns,
            samples=len(rows),
            times=times,
            unknown=[name for name in self.unknown if np.isnan(columns[name]).any()],
            grid=None,
            passed=None if self.passed is None else self.passed.selected(rows),
            where=places_of(self.where, rows),
        )

    @property
    def start(self) -> float:
        """The time of the first sample in seconds; 0 for dates and without a column of times."""
        return 0.0 if self.times is None else self.times.start

    def period(self, *, timed: bool = False) -> Fraction | None:
        """Return the seconds between samples; None without times, or with one sample only."""
        if self.times is None or self.samples < 2:
            return None
        times, grid = self.times, self.grid or Grid(self.times, self.jitter)
        times.check_order(self.where)
        aside = [] if timed else [f"--period to leave the column '{times.column}' aside"]
        if grid.usual > 0 and not PERIODS[0] <= grid.usual <= PERIODS[1]:
            least, most = PERIODS
            raise InputError(
                f"{self.where(1)}: expected samples from {least:g} to {most:g} s apart, got "
                f"{grid.usual:.6g} s; give {_either(aside or ['the unit with --time-unit'])}"
            )
        times.check_unit(self.source)
        if grid.even:
            return grid.period
        index = grid.odd
        remedies = [f"--jitter {100 * NEAR:g}% to resample by holding values", *aside]
        if grid.even_between_holes:
            remedies.insert(0, f"--max-gap {_decimal(grid.usual)}s to take holes for unknown")
        remedies[:0] = filter(None, [self.if_events.removeprefix("give ")])
        raise InputError(
            f"{self.where(index + 1)}: expected samples at even distances, "
            f"got time {times.text(index + 1)} after {times.text(index)}, elsewhere "
            f"{grid.usual:.6g} s; give {_either(remedies)}"
        )

    def extent(self, period: Fraction | None) -> Extent:
        """Return how much of the trace was recorded, at a period."""
        if period is None and self.times is not None and self.samples == 1:
            return Extent(1, None, None, self.start, self.start, 1.0)
        if period is None:
            return Extent(self.samples)
        end = self.start + (self.samples - 1) * period.numerator / period.denominator
        return Extent(self.samples, None, period, self.start, end, float(period), self.gap)


@dataclass(frozen=True, slots=True)
class EventTrace:
    """Signals that hold each value until their next event, the last one to the end.

    Attributes:
        source: Name of the file, for messages.
        signals: Times and values of the events of each variable; the last event of each is at the
            end of the recording (`held`).
        span: The first and the last time of the recording, whatever was recorded then.
        events: The number of recorded events of all variables.
        notes: Sentences to print about changes that the reader made.
        epoch: Time 0 in nanoseconds on the clock that recorded a bag; otherwise, 0.
        max_gap: The longest time in seconds for which a value holds; None: any.
        defaults: The variables that have their default in part of the trace or in all of it.
        gap: The longest time between two events of one variable.
        step: The usual distance of two events of the most frequent variable, in seconds.
        unknown: The variables with events without a number, whose value is then unknown.
        start_known: As for `Trace`, with events in place of samples.
        absent: The variables without an event, which have their default throughout.
    """

    source: str
    signals: Mapping[str, tuple[Floats, Floats]]
    span: tuple[float, float]
    events: int
    notes: Sequence[str] = ()
    epoch: int = 0
    max_gap: Fraction | None = None
    defaults: Mapping[str, float] = field(default_factory=dict)
    gap: Gap | None = None
    step: float = 1.0
    unknown: Collection[str] = ()
    start_known: bool = False
    absent: Collection[str] = ()

    @property
    def tables(self) -> dict[str, Floats]:
        """The events of each variable as rows of time and value, which `rtamt` takes."""
        return {name: np.column_stack(events) for name, events in self.signals.items()}

    def late_start(self, variables: Collection[str]) -> LateStart | None:
        """Return the start of a trace of variables; None if all are known when recording starts.

        An event that still holds when the trace starts is kept.
        """
        lines = {name: self.signals[name][0] for name in variables}
        firsts = {name: float(times[0]) for name, times in lines.items()}
        time, begin = max(firsts.values(), default=-math.inf), min(firsts.values(), default=0.0)
        if time <= self.span[0]:
            return None
        late = [name for name, first in firsts.items() if first == time > begin]
        before = sum(int(times.searchsorted(time, "right")) - 1 for times in lines.values())
        return LateStart(time, begin, tuple(late), before)

    def tables_from(self, start: LateStart | None, names: Collection[str]) -> dict[str, Floats]:
        """Return the events of some variables from a start; all events if the start is None.

        The trace starts there even if all of these variables are known earlier.
        """
        tables = {name: np.column_stack(self.signals[name]) for name in names}
        if start is None:
            return tables
        for name, table in tables.items():
            index = int(table[:, 0].searchsorted(start.time, "right")) - 1
            cut = table[index:].copy()
            hole = len(cut) > 1 and _longer(cut[0, 0], cut[1, 0], self.max_gap)
            if cut[0, 0] < start.time:
                cut[0] = start.time, np.nan if hole else cut[0, 1]
            tables[name] = cut
        return tables

    def tables_with_beginning(self, start: LateStart, names: Collection[str]) -> dict[str, Floats]:
        """Return the events of variables, each unknown (nan) before its first event."""
        tables = {}
        for name in names:
            table = np.column_stack(self.signals[name])
            late = table[0, 0] > start.begin
            tables[name] = np.vstack([[start.begin, np.nan], table]) if late else table
        return tables

    def extent(self) -> Extent:
        """Return how much of the trace was recorded."""
        begin, end = self.span
        return Extent(None, self.events, None, begin, end, self.step, self.gap)


def held(
    signals: Mapping[str, tuple[Floats, Floats]],
    end: float,
    max_gap: Fraction | None,
    absent: Collection[str] = (),
) -> dict[str, tuple[Floats, Floats]]:
    """Append an event at the end of the recording to each variable that ends before it.

    The event has the last value of the variable, or nan, which is unknown, if it comes more than
    ``max_gap`` after the last event.
    """
    completed = {}
    for name, (times, values) in signals.items():
        completed[name] = times, values
        if times[-1] < end:
            silent = name not in absent and _longer(times[-1], end, max_gap)
            last = np.nan if silent else values[-1]
            completed[name] = np.append(times, end), np.append(values, last)
    return completed


def _longer(begin: float, end: float, most: Fraction | None) -> bool:
    """Return whether two times are farther apart than values hold, by their decimal texts."""
    if most is None:
        return False
    return Fraction(repr(float(end))) - Fraction(repr(float(begin))) > most


def outside_ranges(spec: rtamt.Specification, trace: Trace | EventTrace) -> dict[str, str]:
    """Return a text for each variable with values outside its declared range.

    Unknown values are not compared.
    """
    texts = {}
    for name, (low, high) in spec.ranges.items():
        values = _values(trace).get(name, np.zeros(0))
        outside = (values < low) | (values > high)
        if outside.any():
            index = int(outside.argmax())
            texts[name] = (
                f"{int(outside.sum())} of {len(values)} values of {name} are outside the declared "
                f"range [{number(low)}, {number(high)}], the first is "
                f"{number(float(values[index]))} {_place(trace, name, index)}"
            )
    return texts


def constant_note(trace: Trace | EventTrace) -> str:
    """Return the note on variables with one value in the whole trace, or an empty text."""
    constant = {}
    for name, values in _values(trace).items():
        known = values[~np.isnan(values)]
        if name not in trace.defaults and len(known) > 1 and known.min() == known.max():
            constant[name] = float(known[0])
    if not constant:
        return ""
    listed = ", ".join(f"{name} ({number(value)})" for name, value in constant.items())
    return f"constant over the whole trace: {listed}"


def _values(trace: Trace | EventTrace) -> Mapping[str, Floats]:
    if isinstance(trace, Trace):
        return trace.columns
    return {name: values for name, (_, values) in trace.signals.items()}


def _place(trace: Trace | EventTrace, name: str, at: int) -> str:
    """Return the time of a value as text; without times, its row."""
    if isinstance(trace, EventTrace):
        return f"at {time_text(float(trace.signals[name][0][at]), trace.step)}"
    if trace.times is None:
        return f"in {trace.where(at)}"
    step = 1.0 if trace.gap is None else trace.gap.usual
    return f"at {time_text(trace.start + float(trace.times.since[at]), step)}"


def _decimal(value: float) -> str:
    return np.format_float_positional(float(f"{value:.3g}"), trim="-")


def _either(remedies: Sequence[str]) -> str:
    """Return the remedies as a list in words."""
    *others, last = remedies
    return f"{', '.join(others)}{',' * (len(others) > 1)} or {last}" if others else last


@dataclass(frozen=True, slots=True)
class AsideTimes:
    """The distances of rows in seconds, next to a stated period.

    Attributes:
        usual: The median distance.
        smallest: The smallest distance.
        largest: The largest distance.
        place: The row before the first largest distance.
        length: The time from the first row to the last.
    """

    usual: float
    smallest: float
    largest: float
    place: str
    length: float

    @classmethod
    def of(cls, trace: Trace) -> AsideTimes | None:
        """Return the distances of a trace; None without two times."""
        grid, times = trace.grid, trace.times
        if grid is None or times is None:
            return None
        at = int(grid.steps.argmax())
        least, most = float(grid.steps.min()), float(grid.steps[at])
        return cls(grid.usual, least, most, trace.where(at), float(times.since[-1]))

    def meant(self, period: Fraction) -> str:
        """Return a question if a period in seconds equals the distances in milliseconds."""
        if self.smallest <= 0:
            return ""
        for unit, factor in (("ms", 10**3), ("us", 10**6)):
            if abs(self.usual * factor - float(period)) <= NEAR * float(period):
                return (
                    f"--period without a unit is in seconds; did you mean --period {period}{unit}?"
                )
        return ""

    def note(self, column: str, period: Fraction, samples: int) -> str:
        """Return the note on times that differ from the period; empty if they fit."""
        wanted, description = float(period), "in an order that does not increase"
        if self.smallest > 0:
            if max(self.largest - wanted, wanted - self.smallest) <= NEAR * wanted:
                return ""
            description = f"{number(self.usual)} s apart most of the time"
            if self.largest > 2 * self.usual:
                description += f", {number(self.largest)} s after {self.place}"
        note = (
            f"--period leaves the column '{column}' aside, which has the rows {description}: "
            f"{number(self.length)} s in all, not {number(float((samples - 1) * period))} s"
        )
        meant = self.meant(period)
        return f"{note}; {meant}" if meant else note


@dataclass(frozen=True, slots=True)
class Records:
    """When a variable was recorded.

    Attributes:
        times: The times, which increase; the last may be the end of the trace.
        steps: The distances of neighbours.
        usual: The median distance; None until it is computed.
    """

    times: Floats
    steps: Floats
    usual: float | None = None

    @staticmethod
    def of(times: Floats) -> Records:
        """Return the records at some times."""
        with np.errstate(over="ignore"):  # rtamt refuses times so far apart
            return Records(times, np.diff(times))

    def measured(self) -> Records:
        """Return the same records, with the median of their distances if there are two."""
        usual = median(self.steps) if len(self.steps) else None
        return replace(self, usual=usual)


def longest_gap(records: Mapping[str, Records], start: float = 0.0) -> Gap | None:
    """Return the longest time between two records of one variable, or None without two records.

    If several gaps are equally long, return the gap with the most usual steps.
    """
    longest: dict[int, tuple[float, float, Records, list[str]]] = {}
    for name, record in records.items():
        if not len(record.steps):
            continue
        if id(record) not in longest:
            index = int(record.steps.argmax())
            longest[id(record)] = (
                float(record.steps[index]),
                float(record.times[index]) + start,
                record,
                [],
            )
        longest[id(record)][3].append(name)
    if not longest:
        return None
    most = max(seconds for seconds, *_ in longest.values())
    longest_records = [record for record in longest.values() if record[0] == most]
    usuals = [_usual(record) for _, _, record, _ in longest_records]
    best = int(np.argmin(usuals))
    seconds, begin, _, _ = longest_records[best]
    names = [name for _, other, _, names in longest_records if other == begin for name in names]
    variables = "" if len(names) == len(records) else ", ".join(names)
    return Gap(seconds, begin, usuals[best], variables)


def _usual(records: Records) -> float:
    return median(records.steps) if records.usual is None else records.usual


def hole_note(records: Mapping[str, Records], most: float, start: float = 0.0) -> str:
    """Return the note on times without records, where variables are unknown; empty if none."""
    texts: dict[str, list[str]] = {}
    for name, record in records.items():
        # Times since 1970 in doubles are rounded to 0.24 us, and so are their steps.
        rounded = 2 * np.spacing(np.abs(record.times).max(initial=0.0))
        (holes,) = np.nonzero(record.steps > most + rounded)
        if not len(holes):
            continue
        longest = int(holes[record.steps[holes].argmax()])
        length = f"{number(float(record.steps[longest]))} s"
        after = f"after {time_text(float(record.times[longest]) + start, most)}"
        words = f"a hole of {length} {after}"
        if len(holes) > 1:
            words = f"{counted(len(holes), 'hole')}, the longest of {length} {after}"
        texts.setdefault(words, []).append(name)
    if not texts:
        return ""
    each_said = [
        words if _all(names, records) else f"{', '.join(names)}: {words}"
        for words, names in texts.items()
    ]
    return (
        f"values are unknown where nothing was recorded for more than {number(most)} s "
        f"({'; '.join(each_said)})"
    )


def _all(names: Sequence[str], records: Mapping[str, Records]) -> bool:
    return len(names) == len(records)
