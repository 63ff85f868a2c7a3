"""Reads traces from files: samples or events, and the period under which they are judged."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from fractions import Fraction
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError, ParseError, RtamtError
from rtamt.columns import median, names_objects
from rtamt.errors import nearest, shown
from rtamt_gym.checks.names import listed
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import NEAR, UNITS, Columns
from rtamt_gym.recorded.event_rows import read_events, sampled_events
from rtamt_gym.recorded.names import (
    check_recorded,
    find_times,
    long_columns,
    starts_of,
    take_default,
    with_columns,
)
from rtamt_gym.recorded.parts import part_of
from rtamt_gym.recorded.readers import FORMATS, Format, format_of, open_recording
from rtamt_gym.recorded.recording import Floats, Recording, Rows, Wanted, selection_notes
from rtamt_gym.recorded.roles import RowTable, counts_rows, has_time_bounds
from rtamt_gym.recorded.times import (
    HOLE,
    TIME,
    Grid,
    Resampled,
    TimeAxis,
    newest_first,
    one_record,
    raw_steps,
    resampled,
    rises,
    same_as_before,
    simple,
)
from rtamt_gym.recorded.trace import (
    PERIODS,
    AsideTimes,
    EventTrace,
    PassedRows,
    Records,
    Trace,
    hole_note,
    longest_gap,
)
from rtamt_gym.results.extent import Gap
from rtamt_gym.tables import counted

DROPPED_ROW = (
    "--missing drop leaves out the row before this one, so a formula that counts rows may reach "
    "too far. Give --missing unknown, or --one-trace if the rows that stay follow each other."
)


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
            counts=any(map(counts_rows, specs.values())),
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


def read_trace(
    recording: Recording,
    variables: Sequence[str],
    columns: Columns | None = None,
    *,
    if_events: str = "",
    period: Fraction | None = None,
    timed: bool = False,
    counts: bool = False,
    table: bool = False,
) -> Trace:
    """Read samples of the variables, and their times if there is a column of times.

    A stated period replaces the times. Time bounds need times or a period, and rows of one table
    may belong to several objects.

    Example:
        >>> from rtamt_gym.recorded.csv_reader import CsvRecording
        >>> trace = read_trace(CsvRecording(["time,x", "0,5", "0.5,4"], "trace.csv"), ["x"])
        >>> trace.columns["x"].tolist(), trace.period()
        ([5.0, 4.0], Fraction(1, 2))
    """
    columns = columns or Columns()
    about_times = {
        "--max-gap": columns.max_gap,
        "--jitter": columns.jitter,
        "--time-unit": columns.time_unit,
    }
    option = next((name for name, value in about_times.items() if value is not None), None)
    needed = period is None and (timed or option is not None)
    roles = RowTable.of(recording, variables, columns, needed=needed)
    if roles.time is None and option is not None:
        raise InputError(
            f"{recording.source}: expected a column of times, which {option} needs; the "
            f"columns are {listed(recording.names, TIME)}; give --time COLUMN"
        )
    there, numbers = roles.assign(variables, if_events)
    wanted = roles.with_times(wanted_samples(numbers, columns, if_events))
    rows = roles.rows(wanted)
    if table:
        roles.check_rows(rows, {n: ~np.isnan(cells) for n, cells in rows.numbers.items()}, there)
    if table and timed and roles.time is None and period is None:
        roles.check_times(rows)
    roles.check_valid(rows)
    values = {name: rows.numbers[columns.column(name)] for name in there}
    notes, defaults = [*rows.notes, *selection_notes(rows.count, columns.where)], {}
    for name in variables:
        if name not in there:
            values[name] = np.full(rows.count, columns.starts[name])
            near = "" if name in columns.defaults else nearest(name, recording.names)
            why = f"the column is missing{near}"
            notes.append(take_default(recording.source, name, columns, why))
            defaults[name] = columns.starts[name]
    times, step = None, ""
    if roles.time is not None:
        times, step = _axis(recording, rows, wanted, columns, even=period is None)
        columns = _with_room(columns, times)
    trace = Trace(
        recording.source,
        values,
        rows.count,
        times,
        rows.where,
        columns.jitter,
        if_events + step,
        notes,
        defaults=defaults,
    )
    if period is None:
        trace = _one_row_a_time(trace, columns)
    trace = _measured(trace, columns, None if period is None else float(period))
    counted_rows = table and counts and roles.time is None and not columns.one_trace
    if counted_rows:
        roles.check_selection(rows)
    trace = _filled(trace, columns, counted_rows=counted_rows)
    return _on_grid(trace, columns, absent=defaults)


def _axis(
    recording: Recording, rows: Rows, wanted: Wanted, columns: Columns, *, even: bool
) -> tuple[TimeAxis, str]:
    """Return the times of rows, and advice if the only two rows may have a gap between them."""
    times, advice = TimeAxis.of(rows, str(wanted.time), columns), ""
    if even:
        times.check_distances(rows)
        if (step := _step_of_others(recording, rows, wanted, times, columns)) is not None:
            own = f"{float(times.since[1]):.12g}s"
            times = replace(times, step=step)
            advice = f", --period {own} for this trace alone if {own} is its step"
            if _states(columns):
                advice = ", the condition in the requirement instead of --where"
    if newest_first(times.since):
        times.check_order(rows.where)
    return times, advice


def _states(columns: Columns) -> list[str]:
    """Return the columns of ``--where`` that do not name objects."""
    return [name for name in columns.where if not names_objects(name, texts=True)]


def _with_room(columns: Columns, times: TimeAxis) -> Columns:
    """Return the options with room for the rounding of times in ``max_gap``."""
    if columns.max_gap is None:
        return columns
    return replace(columns, max_gap=columns.max_gap + Fraction(2 * times.precision))


def _step_of_others(
    recording: Recording, rows: Rows, wanted: Wanted, times: TimeAxis, columns: Columns
) -> Fraction | None:
    """Return the usual step of other rows of the table if the only two rows are farther apart."""
    if rows.count != 2 or rows.times is None:
        return None
    step = recording.usual_step(wanted)
    if (states := _states(columns)) and not columns.by:
        where = {name: text for name, text in columns.where.items() if name not in states}
        every = recording.read(replace(wanted, numbers=(), gaps=(), cells=(), where=where)).times
        step = None if every is None or not rises(every) else median(raw_steps(every))
    if step is None or float(raw_steps(rows.times)[0]) < HOLE * step:
        return None
    seconds = step * times.unit / UNITS["s"]
    return simple(seconds, 1e-9 * seconds)


def _one_row_a_time(trace: Trace, columns: Columns) -> Trace:
    """Return the trace with one row for each time: equal values at one time are one value."""
    if trace.times is None:
        return trace
    same = same_as_before(trace.times.since)
    if not same.any() or (np.diff(trace.times.since)[~same] < 0).any():
        return trace  # decreasing times are an error later
    first = np.append(True, ~same)
    group, notes = np.cumsum(first) - 1, [*trace.notes]
    merged = {}
    for name, values in trace.columns.items():
        (there,) = np.nonzero(~np.isnan(values))
        phrase = f"{trace.source}, column '{columns.column(name)}'"
        since, seconds = trace.times.since[there], trace.times.seconds[there]
        places = there[one_record(since, values[there], columns.same_time, phrase, notes, seconds)]
        merged[name] = np.full(int(first.sum()), np.nan)
        merged[name][group[places]] = values[places]
    return replace(trace.selected(np.nonzero(first)[0]), columns=merged, notes=notes)


def _measured(trace: Trace, columns: Columns, period: float | None) -> Trace:
    """Return the trace with its longest gap, a note on holes, and its grid if it needs one."""
    times = trace.times
    if times is None or trace.samples < 2:
        return trace
    if period is not None and columns.missing == "raise":
        steps = np.diff(times.since)
        index = int(steps.argmax())
        if period - float(steps.min()) <= NEAR * period >= float(steps[index]) - period:
            gap = Gap(float(steps[index]), trace.start + float(times.since[index]), period)
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
        there = ~np.isnan(values)
        if not there.all():
            there[-1] = True  # a value lasts to the end
            records[name] = Records.of(times.since[there])
    hole = hole_note(records, columns.most, trace.start)
    notes = [*trace.notes, *([hole] if hole else [])]
    return replace(trace, notes=notes, gap=longest_gap(records, trace.start), grid=grid)


def _filled(trace: Trace, columns: Columns, *, counted_rows: bool = False) -> Trace:
    """Return the trace after the treatment of empty cells, which are nan.

    If a formula counts its rows, no row between them may be omitted.
    """
    empty = {name: np.isnan(values) for name, values in trace.columns.items()}
    counts = {name: int(here.sum()) for name, here in empty.items() if here.any()}
    if not counts:
        return trace
    if columns.missing == "unknown":
        counts_text = ", ".join(
            f"{name}: {count}, the first in {trace.where(int(empty[name].argmax()))}"
            for name, count in counts.items()
        )
        note = f"empty cells are unknown samples ({counts_text})"
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
        counts_text = ", ".join(f"{name}: {count}" for name, count in filled.items() if count)
        note = f"empty cells hold the value before ({counts_text})" if counts_text else ""
        late = [name for name in counts if empty[name][0]]
        default_notes = [
            take_default(trace.source, name, columns, "its first cell is empty") for name in late
        ]
        defaults = {**trace.defaults, **{name: columns.starts[name] for name in late}}
        notes = [*trace.notes, *filter(None, [note]), *default_notes]
        return replace(trace, columns=held, notes=notes, defaults=defaults)
    return _without_empty(trace, empty, counted_rows=counted_rows)


def _without_empty(
    trace: Trace, empty: Mapping[str, NDArray[np.bool_]], *, counted_rows: bool
) -> Trace:
    """Return the trace without rows in which a cell is empty."""
    (rows,) = np.nonzero(~np.any([*empty.values()], axis=0))
    if not len(rows):
        raise InputError(f"{trace.source}: expected a row without an empty cell, got none")
    if counted_rows and (np.diff(rows) > 1).any():
        row = int(rows[(np.diff(rows) > 1).argmax() + 1])
        raise InputError(f"{trace.where(row)}: {DROPPED_ROW}")
    left_out = trace.samples - len(rows)
    note = f"{left_out} row{'s' * (left_out > 1)} with an empty cell left out"
    selected = trace.selected(rows)
    if len(rows) == 2 and trace.times is not None and (trace.grid is None or trace.grid.rises):
        usual = (trace.grid or Grid(trace.times, trace.jitter)).usual
        if selected.times is not None and selected.times.since[1] >= HOLE * usual:
            step = simple(usual, 1e-9 * usual)  # the row between them is missing
            selected = replace(selected, times=replace(selected.times, step=step))
    times = selected.times
    # The grid serves the note on a period that contradicts the remaining times.
    grid = Grid(times, trace.jitter) if times is not None and selected.samples > 1 else None
    return replace(selected, notes=[*trace.notes, note], grid=grid)


def _next(there: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the index of the next value at or after each index; the last index without a value."""
    places = np.where(there, np.arange(len(there)), len(there) - 1)
    return np.minimum.accumulate(places[::-1])[::-1]


def _on_grid(trace: Trace, columns: Columns, *, absent: Collection[str]) -> Trace:
    """Return the trace, resampled if an option allows it and its samples lie off the grid."""
    named = _with_unknown(trace, columns)
    if trace.times is None or trace.samples < 2:
        return named
    if trace.jitter is None and columns.max_gap is None:
        return named
    grid = trace.grid or Grid(trace.times, trace.jitter)
    if grid.even or not grid.rises or not PERIODS[0] <= grid.usual <= PERIODS[1]:
        return named  # period() refuses uneven times
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
    on_grid = trace.selected(new.rows)
    times = replace(trace.times, since=since, step=new.period)
    notes = [*trace.notes, *_resampled_notes(trace, grid, new, columns.most)]
    # A sample in a hole, or before an unknown row, has no value.
    hole = new.held & (np.append(grid.steps, 0.0)[new.rows] > columns.most)
    after = np.minimum(new.rows + 1, trace.samples - 1)
    resampled_values = dict(on_grid.columns)
    for name in resampled_values.keys() - {*absent} if columns.max_gap is not None else ():
        unknown = hole | (new.held & np.isnan(trace.columns[name][after]))
        resampled_values[name] = np.where(unknown, np.nan, resampled_values[name])
    passed = _passed_rows(trace, new.rows)
    if passed is not None:
        rows = counted(passed.count, "row")
        notes.append(f"left out between samples: {rows} with another value, first {passed.place}")
    return _with_unknown(
        replace(on_grid, columns=resampled_values, times=times, notes=notes, passed=passed), columns
    )


def _passed_rows(trace: Trace, rows: NDArray[np.intp]) -> PassedRows | None:
    """Return the rows between samples whose values differ from the samples, or None."""
    sampled_rows = np.unique(rows)
    if len(sampled_rows) == trace.samples:
        return None
    starts = np.append(0, sampled_rows[:-1] + 1)  # the last part ends at the last row
    again = np.append(False, rows[1:] == rows[:-1])
    lower, upper = dict[str, Floats](), dict[str, Floats]()
    other = np.zeros(trace.samples, bool)
    owners = sampled_rows[
        np.minimum(np.searchsorted(sampled_rows, np.arange(trace.samples)), len(sampled_rows) - 1)
    ]
    for name, column in trace.columns.items():
        values = np.where(np.isnan(column), column[owners], column)  # ignore empty cells
        differs = (values != values[owners]) & ~np.isnan(values)
        if not differs.any():
            continue
        other |= differs
        part = np.searchsorted(sampled_rows, rows)
        for ends, fold, unknown in ((lower, np.minimum, -np.inf), (upper, np.maximum, np.inf)):
            known = np.where(np.isnan(values), unknown, values)
            end, own = fold.reduceat(known, starts)[part], known[rows]
            ends[name] = np.where(again | (end == own), own, end)
    if not lower:
        return None
    return PassedRows(lower, upper, int(other.sum()), trace.where(int(other.argmax())))


def _resampled_notes(trace: Trace, grid: Grid, new: Resampled, most: float) -> list[str]:
    """Return the notes on a resampled trace, without its unknown values."""
    every = f"resampled every {float(new.period):.6g} s"
    if new.off or most == math.inf:
        note = (
            f"{every} by holding values: {new.off} of {trace.samples} rows lay more than "
            f"{100 * grid.jitter:g}% of that off the grid; the longest gap, {new.gap:.6g} s, "
            f"follows {trace.where(new.at)}"
        )
        return [note]
    steps = np.where(grid.steps <= most, grid.steps, 0.0)
    index = int(steps.argmax())
    if steps[index] <= HOLE * grid.usual:
        return []
    where = trace.where(index)
    return [
        f"{every}: values hold in shorter gaps, the longest of {steps[index]:.6g} s after {where}"
    ]


def _with_unknown(trace: Trace, columns: Columns) -> Trace:
    """Return the trace with the names of the variables that have unknown values."""
    if columns.max_gap is None:
        return trace
    names = [name for name, values in trace.columns.items() if np.isnan(values).any()]
    return replace(trace, unknown=names)


def wanted_samples(numbers: Sequence[str], columns: Columns, if_events: str) -> Wanted:
    """Return the columns of numbers to read."""
    empty = "; " + "; ".join(
        filter(
            None, ("give --missing unknown, or --missing hold if the value before holds", if_events)
        )
    )
    gaps = () if columns.missing == "raise" else numbers
    return Wanted(numbers, gaps=gaps, nan=bool(gaps), empty=empty)
