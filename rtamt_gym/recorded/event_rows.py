"""Reads events at any time from recordings, and samples signals with different times."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.names import (
    TimeColumn,
    check_names,
    check_near,
    check_recorded,
    long_columns,
    recorded_variables,
    take_default,
)
from rtamt_gym.recorded.recording import Floats, Recording, Rows, Wanted, selection_notes
from rtamt_gym.recorded.roles import RowTable
from rtamt_gym.recorded.times import TIME, TimeAxis, one_record
from rtamt_gym.recorded.trace import EventTrace, Records, Trace, held, hole_note, longest_gap
from rtamt_gym.tables import number

_NAN = "; give --missing drop to read nan as no event"


def read_events(
    recording: Recording,
    variables: Sequence[str],
    columns: Columns | None = None,
    *,
    table: bool = False,
) -> EventTrace:
    """Read events of the variables.

    A row holds an event of each variable with a value in its cell. If the columns are ``time``,
    ``variable`` and ``value``, a row is one event.

    Example:
        >>> from rtamt_gym.recorded.csv_reader import CsvRecording
        >>> wide = ["time,x,y", "0,5,1", "0.2,4,"]
        >>> long = ["time,variable,value", "0,x,5", "0,y,1", "0.2,x,4"]
        >>> for lines in (wide, long):
        ...     signals = read_events(CsvRecording(lines, "trace.csv"), ["x", "y"]).signals
        ...     print({name: values.tolist() for name, (_, values) in signals.items()})
        {'x': [5.0, 4.0], 'y': [1.0, 1.0]}
        {'x': [5.0, 4.0], 'y': [1.0, 1.0]}
    """
    columns = columns or Columns()
    if columns.jitter is not None:
        raise InputError("expected --jitter or --dense, which reads events at any time")
    roles = RowTable.of(recording, variables, columns)
    if (pair := long_columns(recording.names, variables, columns)) is not None:
        return _read_long(
            recording, variables, columns, roles.time or TimeColumn(TIME), pair, table=table
        )
    if roles.time is None and table:
        wanted = roles.with_times(Wanted((), cells=recording.names[:1]))
        rows = recording.read(wanted)
        if rows.count:
            roles.check_times(rows)
    time = roles.time or TimeColumn(TIME)
    roles = replace(roles, time=time)
    check_names(recording, time.columns)
    there, needed = roles.assign(variables)
    nan = columns.missing != "raise"
    wanted = Wanted(needed, gaps=needed, nan=nan, empty=_NAN, ends=True)
    rows = roles.rows(wanted)
    if table:
        filled = {name: ~np.isnan(values) for name, values in rows.numbers.items()}
        roles.check_rows(rows, filled, there)
    roles.check_valid(rows)
    axis = _event_times(rows, time, columns)
    axis.check_order(rows.where)
    times = axis.seconds

    def records() -> Iterator[_Records]:
        for name in there:
            column = columns.column(name)
            unknown = rows.invalid.get(column, np.ones(rows.count, bool))
            yield _Records(name, f"column '{column}'", times, rows.numbers[column], unknown)

    return _events(rows, records(), variables, columns, axis)


class _Records(NamedTuple):
    """The records of a variable, with nan where there is no number.

    Attributes:
        name: The variable.
        label: Its name in the file, for messages.
        times: The times in seconds.
        values: The values.
        unknown: Which records without a number are events, if their values are unknown then.
    """

    name: str
    label: str
    times: Floats
    values: Floats
    unknown: NDArray[np.bool_]

    def events(self, source: str, columns: Columns, notes: list[str]) -> tuple[Floats, Floats]:
        """Return the events, one for each instant; a note on others is appended."""
        there = ~np.isnan(self.values)
        if columns.missing == "unknown":
            there |= self.unknown
        if not there.any() and self.name not in columns.starts:
            raise InputError(f"{source}: expected events of '{self.name}', got none")
        at, values = self.times, self.values
        if not there.all():
            at, values = at[there], values[there]
        places = one_record(at, values, columns.same_time, f"{source}, {self.label}", notes)
        return (at, values) if len(places) == len(at) else (at[places], values[places])


def _events(
    rows: Rows,
    records: Iterable[_Records],
    variables: Sequence[str],
    columns: Columns,
    axis: TimeAxis,
) -> EventTrace:
    """Return the trace, with defaults from its first row; values hold to its last row."""
    times, notes, signals = axis.seconds, [*rows.notes], {}
    begin, end = float(times.min()), float(times.max())
    empty = []
    for own in records:
        count = int(np.isnan(own.values).sum())
        if count and not rows.sparse and columns.missing != "unknown":
            empty.append(f"{own.name}: {count}")
        signals[own.name] = own.events(rows.source, columns, notes)
    if empty:
        notes.append(f"empty cells are not events: the value before holds ({', '.join(empty)})")
    notes += selection_notes(rows.count, columns.where)
    completed, defaults, none = {}, {}, []
    for name in variables:
        at, values = signals.get(name, (times[:0], times[:0]))
        start = columns.starts.get(name)
        if start is not None and not (len(at) and at[0] <= begin):
            why = "it has no event"
            if len(at):
                why = f"its first event comes at {number(float(at[0]))} s"
                at, values = np.append(begin, at), np.append(start, values)
            else:
                at, values = np.array([begin]), np.array([start])
                none.append(name)
            notes.append(take_default(rows.source, name, columns, why))
            defaults[name] = start
        completed[name] = at, values
    # Times since 1970 in doubles are rounded to 0.24 us, so steps of 0.1 s are not exactly that.
    rounded = Fraction(2 * float(np.spacing(max(abs(begin), abs(end)))))
    max_gap = None if columns.max_gap is None else columns.max_gap + rounded
    trace = EventTrace(
        rows.source,
        held(completed, end, max_gap, none),
        (begin, end),
        sum(len(at) for at, _ in signals.values()),
        notes,
        max_gap=max_gap,
        defaults=defaults,
        start_known=columns.start == "known",
        absent=none,
    )
    recorded, wrong = _recorded(signals, end, columns)
    if wrong:
        note = f"events without a number are unknown ({'; '.join(wrong)})"
        trace = replace(trace, notes=[*trace.notes, note])
    trace = measured(trace, recorded, columns)
    gap = trace.gap.note if trace.gap and trace.gap.long and columns.max_gap is None else ""
    return replace(trace, notes=[*trace.notes, *filter(None, [axis.unit_note, gap])])


def _recorded(
    signals: Mapping[str, tuple[Floats, Floats]], end: float, columns: Columns
) -> tuple[dict[str, Floats], list[str]]:
    """Return when each variable was recorded, up to the end, and the unknown events in words."""
    recorded, wrong = {}, []
    for name, (at, values) in signals.items():
        absent = np.isnan(values) if columns.missing == "unknown" else np.False_
        recorded[name] = at[~absent] if absent.any() else at
        if len(recorded[name]) and recorded[name][-1] < end:
            recorded[name] = np.append(recorded[name], end)
        if absent.any():
            first = number(float(at[absent][0]))
            wrong.append(f"{name}: {int(absent.sum())}, the first at {first} s")
    return recorded, wrong


def measured(trace: EventTrace, recorded: Mapping[str, Floats], columns: Columns) -> EventTrace:
    """Return the trace with its longest gap and a note on holes."""
    merged: dict[int, Records] = {}
    for times in recorded.values():
        if id(times) not in merged:
            merged[id(times)] = Records.of(times).measured()
    records = {name: merged[id(times)] for name, times in recorded.items()}
    usual = [record.usual for record in merged.values() if record.usual is not None]
    hole = hole_note(records, columns.most)
    some = columns.missing == "unknown" or columns.max_gap is not None
    unknown = [
        name for name, (_, values) in trace.signals.items() if some and np.isnan(values).any()
    ]
    return replace(
        trace,
        notes=[*trace.notes, *([hole] if hole else [])],
        gap=longest_gap(records),
        step=min(usual, default=1.0),
        unknown=unknown,
    )


def _read_long(
    recording: Recording,
    variables: Sequence[str],
    columns: Columns,
    time: TimeColumn,
    pair: tuple[str, str],
    *,
    table: bool,
) -> EventTrace:
    """Read events from rows that hold one event each: a name and a value."""
    named_by, value = pair
    check_names(recording, (*time.columns, *pair))
    nan = columns.missing != "raise"
    wanted = Wanted((value,), (named_by,), gaps=(value,), nan=nan, empty=_NAN)
    roles = RowTable(recording, columns, pair, time)
    try:
        rows = roles.rows(wanted)
    except InputError:
        if not table:
            raise
        rows = _read_variables(roles, variables, roles.with_times(wanted))
    named = np.array(rows.texts[named_by])
    if table:
        filled = {name: named == columns.column(name) for name in variables}
        roles.check_objects(rows, filled)
    axis = _event_times(rows, time, columns)
    times, known = axis.seconds, [*dict.fromkeys(rows.texts[named_by])]
    check_recorded(recording.source, known, variables, columns)
    check_near(recording.source, known, variables, columns)

    def records() -> Iterator[_Records]:
        for name in recorded_variables(known, variables, columns):
            called = columns.column(name)
            if called not in known:
                raise InputError(
                    f"{recording.source}: no events of '{called}', which the specification reads; "
                    f"the variables are {', '.join(known)}{nearest(called, known)}"
                )
            (own,) = np.nonzero(named == called)
            axis.check_order(rows.where, own, f" of '{called}'")
            values = rows.numbers[value][own]
            yield _Records(name, f"'{called}'", times[own], values, np.ones(len(own), bool))

    return _events(rows, records(), variables, columns, axis)


def _read_variables(roles: RowTable, variables: Sequence[str], wanted: Wanted) -> Rows:
    """Read rows that hold one event each; values of variables that are not read may be texts."""
    (value,), (named_by,) = wanted.numbers, wanted.texts
    rows = roles.rows(replace(wanted, numbers=(), gaps=()))
    named, values = np.array(rows.texts[named_by]), np.full(rows.count, np.nan)
    notes = [*rows.notes]
    for called in dict.fromkeys(map(roles.columns.column, variables)):
        own = named == called
        if own.any():
            where = {**wanted.where, named_by: called}
            read = roles.recording.read(replace(wanted, texts=(), where=where))
            values[own] = read.numbers[value]
            notes += [note for note in read.notes if note not in notes]
    return replace(rows, numbers={value: values}, notes=notes)


def _event_times(rows: Rows, time: TimeColumn, columns: Columns) -> TimeAxis:
    axis = TimeAxis.of(rows, time.name, columns)
    axis.check_distances(rows)
    axis.check_unit(rows.source)
    return axis


_MOST: Final = 10_000_000
"""The most samples that a bag is turned into."""

Stamps = NDArray[np.int64]


def sampled(
    trace: EventTrace,
    recorded: Mapping[str, Floats],
    groups: Sequence[Collection[str]],
    period: Fraction,
    columns: Columns,
) -> Trace:
    """Sample events at the multiples of a period, from the start of the recording to its end.

    A sample has the values of the last events at or before its time. The first sample is the first
    at which any variable has a value, or the start of the recording if a specification reads no
    variable. The recorded times of each variable count from the start of the recording.
    """
    begin, step = trace.span[0], period * 10**9
    zero, end = (round(time * 1e9) for time in trace.span)
    # Whole nanoseconds, so rounding down loses no event.
    stamps = {n: np.rint(times * 1e9).astype(np.int64) for n, (times, _) in trace.signals.items()}
    known = {name: math.ceil((int(times[0]) - zero) / step) for name, times in stamps.items()}
    first = min(min((known[name] for name in group), default=0) for group in groups)
    count = int((end - zero) / step) + 1 - first
    if not 0 < count <= _MOST:
        got = f"{count}, one every" if count > 0 else "none at the multiples of"
        advice = "longer --period" if count > 0 else "shorter --period"
        raise InputError(
            f"{trace.source}: expected 1 to {_MOST} samples, got {got} {float(period):g} s in "
            f"{(end - zero) / 1e9:.6g} s; give a {advice}, or --dense"
        )
    after = np.arange(first, first + count, dtype=object) * step.numerator // step.denominator
    places: Stamps = after.astype(np.int64)
    sampled_at = {
        name: _held(stamps[name], values, zero + places)
        for name, (_, values) in trace.signals.items()
    }
    records = {name: Records.of(times) for name, times in recorded.items()}
    notes = [*trace.notes]
    if hole := hole_note(records, columns.most, begin):
        notes.append(hole)
        for name, record in records.items():
            sampled_at[name][_in_holes(record, places / 1e9, columns.most)] = np.nan
    since: Floats = np.arange(float(count)) * period.numerator / period.denominator
    start = begin + float(first * period)
    times = TimeAxis(columns.time or "log", since, start, 1e-9, certain=True, step=period)
    late = {name: time - first for name, time in known.items() if time > first}
    return Trace(
        trace.source,
        sampled_at,
        count,
        times,
        lambda sample: f"{trace.source}, at {start + since[sample]:.9g} s",
        notes=notes,
        epoch=trace.epoch,
        known_from=late,
        unknown=[
            name
            for name, values in sampled_at.items()
            if np.isnan(values[late.get(name, 0) :]).any()
        ],
        defaults=trace.defaults,
        gap=longest_gap(records, begin),
        start_known=columns.start == "known",
    )


def sampled_events(
    trace: EventTrace, groups: Sequence[Collection[str]], period: Fraction, columns: Columns
) -> Trace:
    """Sample the events of a log or a measurement, with a note."""
    note = (
        f"sampled every {number(float(period))} s: a value holds until the next record of its "
        "column"
    )
    events = {n: times for n, (times, _) in trace.signals.items() if n not in trace.absent}
    recorded = {name: times - trace.span[0] for name, times in events.items()}
    trace = replace(trace, notes=[*trace.notes, note])
    samples = sampled(trace, recorded, groups, period, replace(columns, time=columns.time or TIME))
    return replace(samples, notes=[*dict.fromkeys(samples.notes)])


def _held(times: Stamps, values: Floats, places: Stamps) -> Floats:
    """Return the last value at or before each place; nan before the first."""
    index = np.searchsorted(times, places, side="right") - 1
    return np.where(index >= 0, values[index], np.nan)


def _in_holes(records: Records, at: Floats, most: float) -> NDArray[np.bool_]:
    """Return which times lie between two records that are farther apart than values hold."""
    last = len(records.steps) - 1
    if last < 0:
        return np.zeros(len(at), bool)
    index = np.clip(np.searchsorted(records.times, at, side="right") - 1, 0, last)
    inside = (at > records.times[index]) & (at < records.times[index + 1])
    return np.asarray(inside & (records.steps[index] > most))
