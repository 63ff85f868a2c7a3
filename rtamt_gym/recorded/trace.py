"""Reads traces from recordings: samples at even distances."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.columns import NEAR, Columns
from rtamt_gym.recorded.gaps import Records, hole_note, longest_gap
from rtamt_gym.recorded.grid import HOLE, Grid, Resampled, resampled
from rtamt_gym.recorded.invalid import check_valid
from rtamt_gym.recorded.names import check_near, needed_columns, recorded_variables
from rtamt_gym.recorded.recording import Floats, Recording, Rows, Wanted, selection_notes
from rtamt_gym.recorded.roles import RowTable
from rtamt_gym.recorded.same_time import one_record, same_as_before
from rtamt_gym.recorded.starts import take_default
from rtamt_gym.recorded.times import TIME, TimeAxis, TimeColumn, find_times, newest_first
from rtamt_gym.results.extent import Extent, Gap, LateStart

__all__ = ["EventTrace", "Trace", "held", "read_rows", "read_trace", "wanted_times"]

_NOW = 0, ""
"""From when on no variable is known."""

_LEAST, _MOST = 1e-300, 1e300
"""The periods, in seconds, that rtamt takes."""


@dataclass(frozen=True, slots=True)
class Trace:
    """Samples of the variables that specifications read.

    Attributes:
        source: Name of the file, for messages.
        columns: The values of each variable.
        samples: The number of samples.
        times: The times, or None.
        where: Gives the file and line of a sample, for messages.
        jitter: The part of the period by which a sample may lie off the grid, None for the usual.
        if_events: Advice for errors that rows which are events, not samples, may cause.
        notes: What was done to the samples that the file does not say, in sentences to print.
        epoch: What time 0 was in nanoseconds on the clock that recorded a bag; else 0.
        known_from: The first sample of each variable that has none before, as a topic of a bag that
            began late; its values before are nan.
        unknown: The variables of which some values are not known; these are nan.
        defaults: The variables that have their default in part of the trace or in all of it.
        gap: The longest time between two records of one variable, if there are times.
        grid: The grid beside the times, if it is known already.
        start_known: Whether samples count only from the first one on at which all variables of a
            requirement have a value.
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

    def late_start(self, variables: Collection[str]) -> LateStart | None:
        """The start of a trace of some variables; None if all have a value at the first sample."""
        firsts = {name: self.known_from.get(name, 0) for name in variables}
        first, begin = max(firsts.values(), default=0), min(firsts.values(), default=0)
        if not 0 < first < self.samples or self.times is None:
            return None
        late = [name for name, at in firsts.items() if at == first > begin]
        time, since = (self.start + float(self.times.since[at]) for at in (first, begin))
        return LateStart(time, since, tuple(late), first - begin, "sample")

    def with_beginning(self, variables: Collection[str]) -> Trace:
        """The trace from the first sample on at which one of some variables has a value.

        The others are unknown there, which is nan.
        """
        begin = min(self.known_from.get(name, 0) for name in variables)
        return replace(_taken(self, np.arange(begin, self.samples)), known_from={})

    def known(self, variables: Collection[str]) -> Trace:
        """The trace from the first sample on at which all of some variables have a value.

        Raises:
            InputError: If there is no such sample.
        """
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
        return replace(_taken(self, np.arange(first, self.samples)), known_from={})

    @property
    def start(self) -> float:
        """Time of the first sample; 0 without a column of times, or with one of dates."""
        return 0.0 if self.times is None else self.times.start

    def period(self) -> Fraction | None:
        """Seconds between samples; None without a column of times, or with one sample only.

        Raises:
            InputError: If the times do not increase at even distances that a period can have, or
                can hardly be seconds and nobody has said that they are.
        """
        if self.times is None or self.samples < 2:
            return None
        times, grid = self.times, self.grid or Grid(self.times, self.jitter)
        times.check_order(self.where)
        aside = f"--period to leave the column '{times.column}' aside"
        if grid.usual > 0 and not _LEAST <= grid.usual <= _MOST:
            raise InputError(
                f"{self.where(1)}: expected samples from {_LEAST:g} to {_MOST:g} s apart, got "
                f"{grid.usual:.6g} s; give {aside}"
            )
        times.check_unit(self.source)
        if grid.even:
            return grid.period
        at = grid.odd
        ways = [f"--jitter {100 * NEAR:g}% to resample by holding values", aside]
        if grid.even_between_holes:
            ways.insert(0, f"--max-gap {_decimal(grid.usual)}s to take holes for unknown")
        ways[:0] = filter(None, [self.if_events.removeprefix("give ")])
        raise InputError(
            f"{self.where(at + 1)}: expected samples at even distances, "
            f"got time {times.text(at + 1)} after {times.text(at)}, elsewhere {grid.usual:.6g} s; "
            f"give {_either(ways)}"
        )

    def extent(self, period: Fraction | None) -> Extent:
        """How much of the trace was recorded, at a period."""
        if period is None and self.times is not None and self.samples == 1:
            return Extent(1, None, None, self.start, self.start, 1.0)
        if period is None:
            return Extent(self.samples)
        end = self.start + float((self.samples - 1) * period)
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
        notes: What was read otherwise than it is written, in sentences to print.
        epoch: What time 0 was in nanoseconds on the clock that recorded a bag; else 0.
        max_gap: The longest time in seconds for which a value holds; None: any.
        defaults: The variables that have their default in part of the trace or in all of it.
        gap: The longest time between two events of one variable.
        step: The usual distance of two events of the most frequent variable, in seconds.
        unknown: The variables of which some events hold no number, which is not known then.
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
        """The start of a trace of some variables; None if all are known when the recording starts.

        An event that still holds when the trace starts is not left out.
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
        """The events of some variables from a start on; all if it is None.

        The trace starts there even if all of these variables are known earlier.
        """
        tables = {name: np.column_stack(self.signals[name]) for name in names}
        if start is None:
            return tables
        for name, table in tables.items():
            at = int(table[:, 0].searchsorted(start.time, "right")) - 1
            cut = table[at:].copy()
            hole = len(cut) > 1 and _longer(cut[0, 0], cut[1, 0], self.max_gap)
            if cut[0, 0] < start.time:
                cut[0] = start.time, np.nan if hole else cut[0, 1]
            tables[name] = cut
        return tables

    def tables_with_beginning(self, start: LateStart, names: Collection[str]) -> dict[str, Floats]:
        """The events of some variables, each of which is unknown, nan, before its first event."""
        tables = {}
        for name in names:
            table = np.column_stack(self.signals[name])
            late = table[0, 0] > start.begin
            tables[name] = np.vstack([[start.begin, np.nan], table]) if late else table
        return tables

    def extent(self) -> Extent:
        """How much of the trace was recorded."""
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

    Args:
        signals: Times and values of the events of each variable.
        end: The last time of the recording in seconds.
        max_gap: The longest time in seconds for which a value holds; None: any.
        absent: The variables without an event, whose default holds for any time.
    """
    found = {}
    for name, (times, values) in signals.items():
        found[name] = times, values
        if times[-1] < end:
            silent = name not in absent and _longer(times[-1], end, max_gap)
            last = np.nan if silent else values[-1]
            found[name] = np.append(times, end), np.append(values, last)
    return found


def _longer(begin: float, end: float, most: Fraction | None) -> bool:
    """Whether two times are farther apart than values hold, by their decimal texts."""
    if most is None:
        return False
    return Fraction(repr(float(end))) - Fraction(repr(float(begin))) > most


def read_trace(
    recording: Recording,
    variables: Sequence[str],
    columns: Columns | None = None,
    *,
    if_events: str = "",
    period: Fraction | None = None,
    timed: bool = False,
    table: bool = False,
) -> Trace:
    """Reads samples of the variables, and their times if there is a column of times.

    Args:
        recording: The file.
        variables: The variables that are needed.
        columns: How the columns are read.
        if_events: Advice for errors that rows which are events, not samples, may cause.
        period: Seconds between samples where the times are left aside.
        timed: Whether a specification has time bounds, which need times or a period.
        table: Whether the file is one table, whose rows may belong to several objects.

    Raises:
        InputError: If a column is missing, a value is not a number, there is no sample, rows belong
            to several objects, or times are in a column that was not recognised.

    Example:
        >>> from rtamt_gym.recorded.csv_reader import CsvRecording
        >>> trace = read_trace(CsvRecording(["time,x", "0,5", "0.5,4"], "trace.csv"), ["x"])
        >>> trace.columns["x"].tolist(), trace.period()
        ([5.0, 4.0], Fraction(1, 2))
    """
    columns = columns or Columns()
    read = {columns.column(name) for name in variables}
    about_times = {
        "--max-gap": columns.max_gap,
        "--jitter": columns.jitter,
        "--time-unit": columns.time_unit,
    }
    option = next((name for name, value in about_times.items() if value is not None), None)
    needed = period is None and (timed or option is not None)
    time = find_times(recording, columns, read=read, needed=needed)
    if time is None and option is not None:
        raise InputError(
            f"{recording.source}: expected a column of times, which {option} speaks of; the "
            f"columns are {listed(recording.names, TIME)}; give --time COLUMN"
        )
    check_near(recording.source, recording.names, variables, columns)
    there = recorded_variables(recording.names, variables, columns)
    numbers = needed_columns(recording, there, columns, if_events)
    empty = "; " + "; ".join(filter(None, ("give --missing hold or --missing unknown", if_events)))
    gaps = () if columns.missing == "raise" else numbers
    wanted = Wanted(numbers, gaps=gaps, nan=bool(gaps), empty=empty)
    rows = read_rows(recording, wanted_times(wanted, time, columns))
    rules = RowTable(recording, columns, read, time)
    if table:
        rules.check_objects(rows, {n: ~np.isnan(each) for n, each in rows.numbers.items()})
        rules.check_clocks(rows)
    if table and timed and time is None and period is None:
        rules.check_times(rows)
    check_valid(rows, columns)
    values = {name: rows.numbers[columns.column(name)] for name in there}
    notes, defaults = [*rows.notes, *selection_notes(rows, columns.where)], {}
    for name in variables:
        if name not in there:
            values[name] = np.full(rows.count, columns.starts[name])
            near = "" if name in columns.defaults else nearest(name, recording.names)
            why = f"there is no such column{near}"
            notes.append(take_default(recording.source, name, columns, why))
            defaults[name] = columns.starts[name]
    times = None if time is None else TimeAxis.of(rows, time.name, columns)
    if times is not None and period is None:
        times.check_distances(rows)
    if times is not None and newest_first(times.since):
        times.check_order(rows.where)
    trace = Trace(
        recording.source,
        values,
        rows.count,
        times,
        rows.where,
        columns.jitter,
        if_events,
        notes,
        defaults=defaults,
    )
    if period is None:
        trace = _one_row_a_time(trace, columns)
    trace = _measured(trace, columns, None if period is None else float(period))
    return _on_grid(_filled(trace, columns), columns, absent=defaults)


def _one_row_a_time(trace: Trace, columns: Columns) -> Trace:
    """The trace with one row for each time: equal values at one time are one value.

    Raises:
        InputError: If different values of a variable have one time and nobody has chosen one.
    """
    if trace.times is None:
        return trace
    same = same_as_before(trace.times.since)
    if not same.any() or (np.diff(trace.times.since)[~same] < 0).any():
        return trace  # the second is refused later
    first = np.append(True, ~same)
    group, seconds, notes = np.cumsum(first) - 1, trace.times.seconds, [*trace.notes]
    merged = {}
    for name, values in trace.columns.items():
        (given,) = np.nonzero(~np.isnan(values))
        what = f"{trace.source}, column '{columns.column(name)}'"
        kept, note = one_record(
            trace.times.since[given], values[given], columns.same_time, what, seconds[given]
        )
        notes += filter(None, [note])
        merged[name] = np.full(int(first.sum()), np.nan)
        merged[name][group[given[kept]]] = values[given[kept]]
    return replace(_taken(trace, np.nonzero(first)[0]), columns=merged, notes=notes)


def _measured(trace: Trace, columns: Columns, period: float | None) -> Trace:
    """The trace with its longest gap, a note on holes, and its grid unless it is at the period."""
    times = trace.times
    if times is None or trace.samples < 2:
        return trace
    if period is not None and columns.missing == "raise":
        steps = np.diff(times.since)
        at = int(steps.argmax())
        if period - float(steps.min()) <= NEAR * period >= float(steps[at]) - period:
            gap = Gap(float(steps[at]), trace.start + float(times.since[at]), period)
            return replace(trace, gap=gap)
    grid = Grid(times, trace.jitter)
    if not grid.rises:
        return replace(trace, grid=grid)  # period() refuses it
    if columns.max_gap is not None and columns.most < grid.usual * (1 - NEAR):
        unit = f"; {times.unit_note}" if times.unit_note else ""
        raise InputError(
            f"{trace.source}: expected --max-gap of a step at least, got {columns.most:g} s where "
            f"samples are {grid.usual:.6g} s apart{unit}"
        )
    rows = Records(times.since, grid.steps, grid.usual)
    records = dict.fromkeys(trace.columns, rows) or {"": rows}
    for name, values in trace.columns.items() if columns.missing != "raise" else ():
        given = ~np.isnan(values)
        if not given.all():
            given[-1] = True  # a value lasts to the end
            records[name] = Records.of(times.since[given])
    hole = hole_note(records, columns.most, trace.start)
    notes = [*trace.notes, *([hole] if hole else [])]
    return replace(trace, notes=notes, gap=longest_gap(records, trace.start), grid=grid)


def _filled(trace: Trace, columns: Columns) -> Trace:
    """The trace without empty cells, which are nan: they hold the value before, go, or stay."""
    empty = {name: np.isnan(values) for name, values in trace.columns.items()}
    counts = {name: int(here.sum()) for name, here in empty.items() if here.any()}
    if not counts:
        return trace
    if columns.missing == "unknown":
        each = ", ".join(
            f"{name}: {count}, the first in {trace.where(int(empty[name].argmax()))}"
            for name, count in counts.items()
        )
        note = f"empty cells are unknown samples ({each})"
        return replace(trace, notes=[*trace.notes, note], unknown=tuple(counts))
    if columns.missing == "hold":
        held = dict(trace.columns)
        for name in counts:
            values = trace.columns[name]
            if empty[name][0] and name not in columns.starts:
                raise InputError(
                    f"{trace.where(0)}, column '{name}': expected a number to hold, got an empty "
                    "cell; give --missing unknown"
                )
            last = np.maximum.accumulate(np.where(empty[name], 0, np.arange(trace.samples)))
            first = columns.starts.get(name, np.nan)
            held[name] = np.where(np.isnan(values[last]), first, values[last])
            if trace.times is not None and columns.max_gap is not None:
                after = _next(~empty[name])
                since = trace.times.since
                hole = ~np.isnan(values[last]) & (since[after] - since[last] > columns.most)
                hole &= empty[name]
                held[name][hole] = np.nan
        filled = {n: count - int(np.isnan(held[n]).sum()) for n, count in counts.items()}
        each = ", ".join(f"{name}: {count}" for name, count in filled.items() if count)
        note = f"empty cells hold the value before ({each})" if each else ""
        late = [name for name in counts if empty[name][0]]
        said = [
            take_default(trace.source, name, columns, "its first cell is empty") for name in late
        ]
        defaults = {**trace.defaults, **{name: columns.starts[name] for name in late}}
        notes = [*trace.notes, *filter(None, [note]), *said]
        return replace(trace, columns=held, notes=notes, defaults=defaults)
    (rows,) = np.nonzero(~np.any([*empty.values()], axis=0))
    if not len(rows):
        raise InputError(f"{trace.source}: expected a row without an empty cell, got none")
    left_out = trace.samples - len(rows)
    note = f"{left_out} row{'s' * (left_out > 1)} with an empty cell left out"
    return replace(_taken(trace, rows), notes=[*trace.notes, note])


def _next(given: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The place of the next value that is given at each place or behind it; the last if none is."""
    places = np.where(given, np.arange(len(given)), len(given) - 1)
    return np.minimum.accumulate(places[::-1])[::-1]


def _on_grid(trace: Trace, columns: Columns, *, absent: Collection[str]) -> Trace:
    """The trace, resampled if that is asked for and its samples lie off the grid.

    Args:
        trace: The trace.
        columns: How far samples may lie off, and for how long values hold.
        absent: The variables that have their default throughout.
    """
    named = _with_unknown(trace, columns)
    if trace.times is None or trace.samples < 2:
        return named
    if trace.jitter is None and columns.max_gap is None:
        return named
    grid = trace.grid or Grid(trace.times, trace.jitter)
    if grid.even or not grid.rises or not _LEAST <= grid.usual <= _MOST:
        return named  # period() refuses what is not even
    if trace.jitter is None and not grid.even_between_holes:
        return named
    trace.times.check_unit(trace.source)
    new = resampled(trace.times, grid)
    if new is None:
        raise InputError(
            f"{trace.where(int(grid.steps.argmax()) + 1)}: expected a gap that can be resampled "
            f"every {grid.usual:.6g} s, got {float(grid.steps.max()):.6g} s; cut the trace there"
        )
    since = np.arange(float(len(new.rows))) * new.period.numerator / new.period.denominator
    taken = _taken(trace, new.rows)
    times = replace(trace.times, since=since, step=new.period)
    notes = [*trace.notes, *_resampled_notes(trace, grid, new, columns.most)]
    # A sample in a hole has no value, and neither has one between two rows, the second unknown.
    hole = new.held & (np.append(grid.steps, 0.0)[new.rows] > columns.most)
    after = np.minimum(new.rows + 1, trace.samples - 1)
    made = dict(taken.columns)
    for name in made.keys() - {*absent} if columns.max_gap is not None else ():
        unknown = hole | (new.held & np.isnan(trace.columns[name][after]))
        made[name] = np.where(unknown, np.nan, made[name])
    return _with_unknown(replace(taken, columns=made, times=times, notes=notes), columns)


def _resampled_notes(trace: Trace, grid: Grid, new: Resampled, most: float) -> list[str]:
    """Says what a trace has on the grid that its rows do not say, but for what is unknown."""
    every = f"resampled every {float(new.period):.6g} s"
    if new.off or most == math.inf:
        said = (
            f"{every} by holding values: {new.off} of {trace.samples} rows lay more than "
            f"{100 * grid.jitter:g}% of that off the grid; the longest gap, {new.gap:.6g} s, "
            f"follows {trace.where(new.at)}"
        )
        return [said]
    steps = np.where(grid.steps <= most, grid.steps, 0.0)
    at = int(steps.argmax())
    if steps[at] <= HOLE * grid.usual:
        return []
    where = trace.where(at)
    return [f"{every}: values hold in shorter gaps, the longest of {steps[at]:.6g} s after {where}"]


def _with_unknown(trace: Trace, columns: Columns) -> Trace:
    """The trace with the names of the variables of which values are not known."""
    if columns.max_gap is None:
        return trace
    names = [name for name, values in trace.columns.items() if np.isnan(values).any()]
    return replace(trace, unknown=names)


def _taken(trace: Trace, rows: NDArray[np.intp]) -> Trace:
    """Some rows of a trace as samples."""
    times = trace.times
    if times is not None:
        since = times.since[rows]
        times = replace(
            times, since=since - since[0], start=times.start + float(since[0]), step=None
        )
    return replace(
        trace,
        columns={name: values[rows] for name, values in trace.columns.items()},
        samples=len(rows),
        times=times,
        grid=None,
        where=lambda sample: trace.where(int(rows[sample])),
    )


def wanted_times(wanted: Wanted, time: TimeColumn | None, columns: Columns) -> Wanted:
    """Return the columns to read with those of times, in the rows that ``--where`` selects."""
    timed = replace(wanted, where=columns.where, date_order=columns.date_order)
    return timed if time is None else replace(timed, time=time.name, part=time.part)


def read_rows(recording: Recording, wanted: Wanted) -> Rows:
    """The wanted columns of a recording.

    Raises:
        InputError: If it has no row.
    """
    rows = recording.read(wanted)
    if not rows.count:
        raise InputError(f"{rows.source}: expected at least one sample below the line of names")
    return rows


def _decimal(value: float) -> str:
    return np.format_float_positional(float(f"{value:.3g}"), trim="-")


def _either(ways: Sequence[str]) -> str:
    """The ways out in words."""
    *others, last = ways
    return f"{', '.join(others)}{',' * (len(others) > 1)} or {last}" if others else last
