"""A recorded trace with the period under which requirements are judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from fractions import Fraction
from importlib import import_module

import rtamt
from rtamt import InputError, ParseError, RtamtError
from rtamt.errors import shown
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.event_rows import read_events, sampled_events
from rtamt_gym.recorded.names import (
    check_recorded,
    find_times,
    long_columns,
    starts_of,
    with_columns,
)
from rtamt_gym.recorded.parts import part_of
from rtamt_gym.recorded.readers import FORMATS, Format, format_of, open_recording
from rtamt_gym.recorded.recording import Floats, Recording, Wanted
from rtamt_gym.recorded.roles import RowTable, has_time_bounds
from rtamt_gym.recorded.sample_rows import read_trace
from rtamt_gym.recorded.times import TimeAxis
from rtamt_gym.recorded.trace import AsideTimes, EventTrace, Trace


def read_ruled(
    path: str,
    specs: Mapping[str, rtamt.Specification],
    reading: EvaluationOptions,
    columns: Columns,
) -> tuple[Trace | EventTrace, Fraction | None]:
    """Read a trace and its period: the stated period, the period of its samples, or None."""
    row = format_of(path)
    columns = checked_columns(path, row, columns)
    _check_absent(columns, dense=reading.dense)
    if row.bag:
        read: tuple[Trace | EventTrace, Fraction | None] = import_module(row.module).read_bag(
            path, specs, reading, columns
        )
        return read
    columns = with_columns(specs, columns)
    variables = list(dict.fromkeys(v for spec in specs.values() for v in spec.variables))
    if (starts := starts_of(specs, columns)) != columns.starts:
        columns = replace(columns, starts=starts)
    table = row.table and columns.wide is None
    with _opened(path, columns, row) as recording:
        if not (reading.dense and long_columns(recording.names, variables, columns)):
            for spec in specs.values():
                check_recorded(recording.source, recording.names, spec.variables, columns)
        if reading.dense:
            return read_events(recording, variables, columns, table=table), None
        if row.clocks and reading.seconds is not None:
            groups = [spec.variables for spec in specs.values()]
            events = read_events(recording, variables, columns)
            return sampled_events(events, groups, reading.seconds, columns), reading.seconds
        trace = read_trace(
            recording,
            variables,
            columns,
            if_events=_IF_CLOCKS if row.clocks else IF_EVENTS,
            period=reading.seconds,
            timed=any(map(has_time_bounds, specs.values())),
            table=table,
        )
    return _with_period(trace, specs, reading, columns)


def _with_period(
    trace: Trace,
    specs: Mapping[str, rtamt.Specification],
    reading: EvaluationOptions,
    columns: Columns,
) -> tuple[Trace, Fraction | None]:
    """Return a trace with its period: the stated period, the period of its times, or None."""
    if reading.seconds is not None:
        aside = AsideTimes.of(trace)
        check_bounds(specs, reading, "" if aside is None else aside.meant(reading.seconds))
        return _under(trace, reading.seconds), reading.seconds
    timed = any(spec.timed for spec in specs.values())
    period = trace.period(timed=timed)
    if period is None and trace.times is not None:
        period = trace.times.step  # a format may state it even for one sample
    if period is not None and trace.times is not None:
        check_bounds(specs, reading.having(period=period), trace.times.unit_doubt)
    trace = _noted(trace, columns)
    if period is None and trace.times is not None and timed:
        raise InputError(
            f"{trace.source}: expected at least two samples to read the period from, got one; "
            "give --period in seconds"
        )
    return trace, period


def read_row_times(
    path: str, variables: Sequence[str], columns: Columns
) -> tuple[Floats, Callable[[int], str]]:
    """Return the time of each row of a trace in a table in seconds, and the place of a row.

    With ``wide`` these are the rows of all objects.
    """
    row = format_of(path)
    columns = checked_columns(path, row, columns)
    wide = columns.wide is not None
    read = () if wide else {columns.column(name) for name in variables}
    with _opened(path, replace(columns, wide=None), row) as recording:
        roles = RowTable(recording, columns, read, find_times(recording, columns, read=read))
        time = roles.time
        if time is None:
            raise InputError(f"{recording.source}: expected a column of times, got none")
        rows = roles.rows(Wanted([]))
    if not wide:
        return TimeAxis.of(rows, time.name, columns).seconds, rows.where
    from rtamt_gym.recorded.wide import find_instants

    assert rows.times is not None, "wanted"  # noqa: S101 - for mypy
    instants, _, places = find_instants(rows.times)
    axis = TimeAxis.of(replace(rows, times=instants), time.name, columns)
    return axis.seconds[places], rows.where


IF_EVENTS = "give --dense to take rows as events at any time"
_IF_CLOCKS = "give --period TIME to sample columns, or --dense to take records as events"


def checked_columns(path: str, row: Format, columns: Columns) -> Columns:
    """Check that the options fit the format; return them for one trace of the file."""
    if (part := part_of(path)) is not None:
        others = {name: text for name, text in columns.where.items() if name not in part.values}
        columns = replace(columns, where=others, by=(*part.values,))
    if columns.where and not (row.table or row.several):
        raise InputError(
            f"{shown(path)}: expected a table for --where, which selects rows, got {row.name}"
        )
    if columns.one_trace and row.several and not row.table:
        raise InputError(
            f"{shown(path)}: expected a table for --one-trace, got {row.name}, which names the "
            "trace of each row. Leave --one-trace out."
        )
    if columns.stale is not None and not row.bag:
        raise InputError(f"{shown(path)}: expected --stale for a bag, got it for a table")
    if columns.wide is not None:
        if not row.table:
            raise InputError(f"{shown(path)}: expected a table for --wide, got {row.name}")
        if columns.missing == "raise":  # values of absent objects are unknown
            columns = replace(columns, missing="unknown")
    return columns


def _check_absent(columns: Columns, *, dense: bool) -> None:
    """Check that no value of an absent object is held."""
    if columns.wide is None or columns.missing not in ("hold", "drop"):
        return
    holding = {
        "--dense": dense,
        "--jitter": columns.jitter is not None,
        "--max-gap": columns.max_gap is not None,
    }
    option = next((name for name, holds in holding.items() if holds), "")
    if columns.missing == "drop" and not option:
        return  # the samples at which all objects exist
    combined = f" with {option}, which holds values" if columns.missing == "drop" else ""
    raise InputError(
        f"expected --missing unknown with --wide, got {columns.missing}{combined}. An absent "
        "object has no value."
    )


@contextmanager
def _opened(path: str, columns: Columns, row: Format) -> Iterator[Recording]:
    """Open a file, the rows of a table that are a trace, or a table as a trace of objects."""
    opened: AbstractContextManager[Recording] = open_recording(path, columns, row)
    if row.table and len(columns.by) > (1 if row.choice else 0):
        from rtamt_gym.recorded.groups import open_group

        opened = open_group(path, columns)
    with opened as recording:
        if columns.wide is None:
            yield recording
        else:
            from rtamt_gym.recorded.wide import WideRecording

            yield WideRecording(recording, columns, as_text=row is FORMATS[0])


def _noted(trace: Trace, columns: Columns) -> Trace:
    """Return the trace with notes on its times."""
    notes = [] if trace.times is None else [trace.times.unit_note]
    if trace.gap is not None and trace.gap.long and columns.max_gap is None:
        notes.append("" if columns.missing == "unknown" else trace.gap.note)
    return replace(trace, notes=[*trace.notes, *filter(None, notes)])


def check_bounds(
    specs: Mapping[str, rtamt.Specification], reading: EvaluationOptions, doubt: str
) -> None:
    """Raise the error about a bound that does not fit the period, with a doubt about its unit."""
    for spec in specs.values() if doubt else ():
        try:
            rtamt.EpisodeMonitor(spec, reading.period, align=reading.align)
        except ParseError as error:
            if "multiple of the period" not in error.reason:
                return  # the monitors report it
            place = error.text, error.line, error.column
            raise ParseError(error.reason, *place, doubt) from None
        except RtamtError:
            return


def _under(trace: Trace, period: Fraction) -> Trace:
    """Return the trace under a stated period, with a note if its times show another one."""
    aside, times = AsideTimes.of(trace), trace.times
    note = aside.note(times.column, period, trace.samples) if aside and times else ""
    return replace(trace, notes=[*trace.notes, note], gap=None) if note else trace
