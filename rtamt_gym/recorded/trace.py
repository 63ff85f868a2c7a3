"""Reads traces from recordings: samples at even distances, or events at any time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.checks.names import nearest
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Floats, Recording, Rows, Wanted

__all__ = ["TIME", "VALUE", "VARIABLE", "EventTrace", "Trace", "read_events", "read_trace"]

TIME = "time"
"""The column with the time of a sample or an event, in seconds."""

VARIABLE, VALUE = "variable", "value"
"""The columns that a recording has, beside the time, where each row is one event."""

_JITTER = 0.01
"""The fraction of the period by which the distance of two samples may differ from it."""

_LEAST, _MOST = 1e-300, 1e300
"""The periods, in seconds, that rtamt takes."""


@dataclass(frozen=True, slots=True)
class Trace:
    """Samples of the variables that specifications read.

    Attributes:
        source: Name of the file, for messages.
        columns: The values of each variable.
        samples: The number of samples.
        times: The column of times, or None.
        where: Gives the file and line of a sample, for messages.
        if_events: Advice for errors that rows which are events, not samples, may cause.
        notes: What was done to the samples that the file does not say, in sentences to print.
    """

    source: str
    columns: Mapping[str, Floats]
    samples: int
    times: Floats | None
    where: Callable[[int], str]
    if_events: str = ""
    notes: Sequence[str] = ()

    @property
    def start(self) -> float:
        """Time of the first sample; 0 without a column of times."""
        return 0.0 if self.times is None else float(self.times[0])

    def period(self) -> Fraction | None:
        """Seconds between samples; None without a column of times, or with one sample only.

        Raises:
            InputError: If the times do not increase at even distances that a period can have.
        """
        if self.times is None or self.samples < 2:
            return None
        with np.errstate(over="ignore"):  # steps past all floats are refused here
            steps = np.diff(self.times)
        usual = float(np.median(steps))
        if usual > 0 and not _LEAST <= usual <= _MOST:
            raise InputError(
                f"{self.where(1)}: expected samples from {_LEAST:g} to {_MOST:g} s apart, got "
                f"{usual:.6g} s; give --period to leave the column '{TIME}' aside"
            )
        if usual <= 0 or (odd := np.abs(steps - usual) > _JITTER * usual).any():
            at = int((steps <= 0).argmax() if usual <= 0 else odd.argmax())
            before, after = self.times[at], self.times[at + 1]
            rest = "" if usual <= 0 else f", elsewhere {usual:.6g} s"
            way_out = f"resample the trace, or give --period to leave the column '{TIME}' aside"
            if self.if_events and (steps > 0).all():
                way_out = f"{self.if_events}, {way_out}"
            raise InputError(
                f"{self.where(at + 1)}: expected samples at even distances, "
                f"got time {after:.6g} after {before:.6g}{rest}; {way_out}"
            )
        mean = float(self.times[-1] - self.times[0]) / (self.samples - 1)
        # The period is known no better than the rounded times (0.1 + 0.2 = 0.30000000000000004).
        blur = max(1e-9 * mean, 2 * math.ulp(float(np.abs(self.times).max())) / (self.samples - 1))
        return _simple(mean, blur)


@dataclass(frozen=True, slots=True)
class EventTrace:
    """Signals that hold each value until their next event.

    Attributes:
        source: Name of the file, for messages.
        signals: Times and values of the events of each variable.
    """

    source: str
    signals: Mapping[str, tuple[Floats, Floats]]

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
    named = columns or Columns()
    needed = list(map(named.column, variables))
    _check_names(recording, needed, if_events)
    present = [v for v in dict.fromkeys((*needed, TIME)) if v in recording.names]
    rows = _read(recording, Wanted(present, empty=if_events and f"; {if_events}"))
    values = {name: rows.numbers[named.column(name)] for name in variables}
    times = rows.numbers.get(TIME)
    return Trace(recording.source, values, len(rows.lines), times, rows.where, if_events)


def read_events(
    recording: Recording, variables: Sequence[str], _columns: Columns | None = None
) -> EventTrace:
    """Reads events of the variables.

    A row holds an event of each variable whose cell is not empty. If the columns are ``time``,
    ``variable`` and ``value``, a row is one event.

    Raises:
        InputError: If a column or a variable is missing, a value is not a number, or the times of
            a variable do not increase.

    Example:
        >>> from rtamt_gym.recorded.csv_reader import CsvRecording
        >>> wide = ["time,x,y", "0,5,1", "0.2,4,"]
        >>> long = ["time,variable,value", "0,x,5", "0,y,1", "0.2,x,4"]
        >>> for lines in (wide, long):
        ...     signals = read_events(CsvRecording(lines, "trace.csv"), ["x", "y"]).signals
        ...     print({name: values.tolist() for name, (_, values) in signals.items()})
        {'x': [5.0, 4.0], 'y': [1.0]}
        {'x': [5.0, 4.0], 'y': [1.0]}
    """
    if {VARIABLE, VALUE} <= {*recording.names} and not {*variables} <= {*recording.names}:
        return _read_long(recording, variables)
    _check_names(recording, (*variables, TIME))
    rows = _read(recording, Wanted(list(dict.fromkeys((TIME, *variables))), gaps=variables))
    _check_order(rows, np.arange(len(rows.lines)))
    signals = {}
    for name in variables:
        (given,) = np.nonzero(~np.isnan(rows.numbers[name]))
        if not len(given):
            raise InputError(f"{recording.source}: expected events of '{name}', got none")
        signals[name] = rows.numbers[TIME][given], rows.numbers[name][given]
    return EventTrace(recording.source, signals)


def _read_long(recording: Recording, variables: Sequence[str]) -> EventTrace:
    """Reads events from rows of which each is one event."""
    _check_names(recording, (TIME, VARIABLE, VALUE))
    rows = _read(recording, Wanted((TIME, VALUE), (VARIABLE,)))
    named = np.array(rows.texts[VARIABLE])
    known = list(dict.fromkeys(rows.texts[VARIABLE]))
    signals = {}
    for name in variables:
        if name not in known:
            raise InputError(
                f"{recording.source}: no events of '{name}', which the specification reads; "
                f"the variables are {', '.join(known)}{nearest(name, known)}"
            )
        (given,) = np.nonzero(named == name)
        _check_order(rows, given, f" of '{name}'")
        signals[name] = rows.numbers[TIME][given], rows.numbers[VALUE][given]
    return EventTrace(recording.source, signals)


def _read(recording: Recording, wanted: Wanted) -> Rows:
    rows = recording.read(wanted)
    if not rows.lines:
        raise InputError(f"{rows.source}: expected at least one sample below the line of names")
    infinite = ~np.isfinite(rows.numbers.get(TIME, np.zeros(1)))
    if infinite.any():
        at = int(infinite.argmax())
        raise InputError(
            f"{rows.where(at)}, column '{TIME}': expected a finite number, "
            f"got {rows.numbers[TIME][at]}"
        )
    return rows


def _check_order(rows: Rows, given: NDArray[np.intp], what: str = "") -> None:
    times = rows.numbers[TIME][given]
    late = times[1:] <= times[:-1]
    if late.any():
        at = int(late.argmax())
        raise InputError(
            f"{rows.where(int(given[at + 1]))}: expected times{what} that increase, "
            f"got {times[at + 1]:.15g} after {times[at]:.15g}"
        )


def _check_names(recording: Recording, needed: Sequence[str], if_events: str = "") -> None:
    source, names = recording.source, recording.names
    if all(map(_is_number, names)):
        raise InputError(
            f"{source}, line 1: expected the names of the columns, got {', '.join(names)}; "
            f"write a line of names first, such as {','.join(dict.fromkeys((TIME, *needed)))}"
        )
    for name in needed:
        if name not in names:
            hint = nearest(name, names)
            if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
                hint = "; columns are separated by commas"
            if if_events and {VARIABLE, VALUE} <= set(names):
                hint = f"; {if_events}"
            reader = "--dense" if name in (TIME, VALUE, VARIABLE) else "the specification"
            raise InputError(
                f"{source}: no column '{name}', which {reader} reads; "
                f"the columns are {', '.join(names)}{hint}"
            )
        if names.count(name) > 1:
            raise InputError(f"{source}, line 1: expected one column '{name}', got two")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _simple(value: float, blur: float) -> Fraction:
    """A fraction with a small denominator within ``blur`` of a value."""
    near = Fraction(value)
    for power in range(1, 12):
        simple = near.limit_denominator(10**power)
        if abs(simple - near) <= blur:
            return simple
    return near
