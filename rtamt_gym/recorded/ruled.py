"""A recorded trace with the period under which requirements are judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from importlib import import_module

import rtamt
from rtamt import InputError
from rtamt_gym.judging.reading import Reading
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.event_rows import read_events
from rtamt_gym.recorded.names import are_long, check_recorded
from rtamt_gym.recorded.readers import format_of, open_recording
from rtamt_gym.recorded.starts import starts_of
from rtamt_gym.recorded.trace import EventTrace, Trace, read_trace

__all__ = ["read_ruled"]


def read_ruled(
    path: str, specs: Mapping[str, rtamt.Specification], reading: Reading, columns: Columns
) -> tuple[Trace | EventTrace, Fraction | None]:
    """Reads a trace, and its period: as given, else found in its samples, or None.

    Raises:
        InputError: If the trace cannot be read, or is too short to have a period.
        OSError: If there is no such file.
    """
    if reading.dense:
        columns.check_dense()
    row = format_of(path)
    if row.bag:
        read: tuple[Trace | EventTrace, Fraction | None] = import_module(row.module).read_bag(
            path, specs, reading, columns
        )
        return read
    if columns.stale is not None:
        raise InputError(f"{path}: expected --stale for a bag, got it for a table")
    variables = list(dict.fromkeys(v for spec in specs.values() for v in spec.variables))
    columns = replace(columns, starts=starts_of(specs, columns))
    with open_recording(path, columns) as recording:
        if not (reading.dense and are_long(recording.names, variables)):
            for spec in specs.values():
                check_recorded(recording.source, recording.names, spec.variables, columns)
        if reading.dense:
            return read_events(recording, variables, columns), None
        if_events = "give --dense to take rows as events at any time"
        trace = read_trace(recording, variables, columns, if_events=if_events)
    if reading.period is not None:
        return trace, reading.seconds
    period = trace.period()
    timed = any(spec.timed for spec in specs.values())
    if period is None and trace.times is not None and timed:
        raise InputError(
            f"{trace.source}: expected at least two samples to read the period from, got one; "
            "give --period in seconds"
        )
    return trace, period
