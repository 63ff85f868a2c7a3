"""Reads traces from recordings: samples at even distances."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.recorded.columns import NEAR, Columns
from rtamt_gym.recorded.grid import Grid, resampled
from rtamt_gym.recorded.names import (
    needed_columns,
    recorded_variables,
)
from rtamt_gym.recorded.recording import Floats, Recording, Rows, Wanted
from rtamt_gym.recorded.starts import default_note
from rtamt_gym.recorded.times import TimeAxis, find_times

__all__ = ["EventTrace", "Trace", "read_rows", "read_trace"]

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
        times, grid = self.times, Grid(self.times, self.jitter)
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
        rest = "" if grid.usual <= 0 else f", elsewhere {grid.usual:.6g} s"
        ways = [aside]
        if grid.rises:
            ways.insert(0, f"--jitter {100 * NEAR:g}% to resample by holding values")
            ways[:0] = filter(None, [self.if_events.removeprefix("give ")])
        raise InputError(
            f"{self.where(at + 1)}: expected samples at even distances, "
            f"got time {times.text(at + 1)} after {times.text(at)}{rest}; "
            f"give {_either(ways)}"
        )


@dataclass(frozen=True, slots=True)
class EventTrace:
    """Signals that hold each value until their next event.

    Attributes:
        source: Name of the file, for messages.
        signals: Times and values of the events of each variable.
        notes: What was read otherwise than it is written, in sentences to print.
        epoch: What time 0 was in nanoseconds on the clock that recorded a bag; else 0.
    """

    source: str
    signals: Mapping[str, tuple[Floats, Floats]]
    notes: Sequence[str] = ()
    epoch: int = 0

    @property
    def tables(self) -> dict[str, Floats]:
        """The events of each variable as rows of time and value, which `rtamt` takes."""
        return {name: np.column_stack(events) for name, events in self.signals.items()}

    @property
    def events(self) -> int:
        """The number of events of all variables."""
        return sum(len(times) for times, _ in self.signals.values())

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last time at which every variable has a value."""
        ends = [(float(times[0]), float(times[-1])) for times, _ in self.signals.values()]
        return max(first for first, _ in ends), min(last for _, last in ends)

    @property
    def step(self) -> float:
        """The usual distance of two events of the most frequent variable, in seconds."""
        with np.errstate(over="ignore"):  # rtamt refuses times so far apart
            gaps = [float(np.median(np.diff(t))) for t, _ in self.signals.values() if len(t) > 1]
        return min(gaps, default=1.0)


def read_trace(
    recording: Recording,
    variables: Sequence[str],
    columns: Columns | None = None,
    *,
    if_events: str = "",
) -> Trace:
    """Reads samples of the variables, and their times if there is a column of times.

    Args:
        recording: The file.
        variables: The variables that are needed.
        columns: How the columns are read.
        if_events: Advice for errors that rows which are events, not samples, may cause.

    Raises:
        InputError: If a column is missing, a value is not a number, or there is no sample.

    Example:
        >>> from rtamt_gym.recorded.csv_reader import CsvRecording
        >>> trace = read_trace(CsvRecording(["time,x", "0,5", "0.5,4"], "trace.csv"), ["x"])
        >>> trace.columns["x"].tolist(), trace.period()
        ([5.0, 4.0], Fraction(1, 2))
    """
    columns = columns or Columns()
    time = find_times(recording, columns)
    if time is None and (columns.jitter is not None or columns.time_unit is not None):
        option = "--time-unit" if columns.jitter is None else "--jitter"
        raise InputError(
            f"{recording.source}: expected a column of times, which {option} speaks of; the "
            f"columns are {', '.join(recording.names)}; give --time COLUMN"
        )
    there = recorded_variables(recording.names, variables, columns)
    needed = needed_columns(recording, there, columns, if_events)
    empty = "; " + "; ".join(filter(None, ("give --missing hold or --missing drop", if_events)))
    gaps = () if columns.missing == "raise" else needed
    rows = read_rows(recording, Wanted(needed, gaps=gaps, nan=bool(gaps), empty=empty, time=time))
    values = {name: rows.numbers[columns.column(name)] for name in there}
    notes = [*rows.notes]
    for name in variables:
        if name not in there:
            values[name] = np.full(rows.count, columns.starts[name])
            why = f"there is no such column{nearest(name, recording.names)}"
            notes.append(default_note(name, columns.starts[name], why))
    times = None if time is None else TimeAxis.of(rows, time, columns)
    trace = Trace(
        recording.source,
        values,
        rows.count,
        times,
        rows.where,
        columns.jitter,
        if_events,
        notes,
    )
    return _on_grid(_filled(trace, columns))


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
                    "cell; give --missing drop"
                )
            last = np.maximum.accumulate(np.where(empty[name], 0, np.arange(trace.samples)))
            first = columns.starts.get(name, np.nan)
            held[name] = np.where(np.isnan(values[last]), first, values[last])
        each = ", ".join(f"{name}: {count}" for name, count in counts.items())
        note = f"empty cells hold the value before ({each})"
        late = [
            default_note(name, columns.starts[name], "its first cell is empty")
            for name in counts
            if empty[name][0]
        ]
        return replace(trace, columns=held, notes=[*trace.notes, note, *late])
    (rows,) = np.nonzero(~np.any([*empty.values()], axis=0))
    if not len(rows):
        raise InputError(f"{trace.source}: expected a row without an empty cell, got none")
    left_out = trace.samples - len(rows)
    note = f"{left_out} row{'s' * (left_out > 1)} with an empty cell left out"
    return replace(_taken(trace, rows), notes=[*trace.notes, note])


def _on_grid(trace: Trace) -> Trace:
    """The trace, resampled if that is asked for and its samples lie off the grid."""
    if trace.jitter is None or trace.times is None or trace.samples < 2:
        return trace
    grid = Grid(trace.times, trace.jitter)
    if grid.even or not grid.rises or not _LEAST <= grid.usual <= _MOST:
        return trace  # period() refuses what is not even
    trace.times.check_unit(trace.source)
    new = resampled(trace.times, grid)
    if new is None:
        raise InputError(
            f"{trace.where(int(grid.steps.argmax()) + 1)}: expected a gap that can be resampled "
            f"every {grid.usual:.6g} s, got {float(grid.steps.max()):.6g} s; cut the trace there"
        )
    period = float(new.period)
    note = (
        f"resampled every {period:.6g} s by holding values: {new.off} of {trace.samples} rows lay "
        f"more than {100 * trace.jitter:g}% of that off the grid; the longest gap, "
        f"{new.gap:.6g} s, follows {trace.where(new.at)}"
    )
    since = np.arange(float(len(new.rows))) * new.period.numerator / new.period.denominator
    taken = _taken(trace, new.rows)
    times = replace(trace.times, since=since, step=new.period)
    return replace(taken, times=times, notes=[*trace.notes, note])


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
        where=lambda sample: trace.where(int(rows[sample])),
    )


def read_rows(recording: Recording, wanted: Wanted) -> Rows:
    """The wanted columns of a recording.

    Raises:
        InputError: If it has no row.
    """
    rows = recording.read(wanted)
    if not rows.count:
        raise InputError(f"{rows.source}: expected at least one sample below the line of names")
    return rows


def _either(ways: Sequence[str]) -> str:
    """The ways out in words."""
    *others, last = ways
    return f"{', '.join(others)}{',' * (len(others) > 1)} or {last}" if others else last
