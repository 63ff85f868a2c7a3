"""The terms of a formula over the regions of a trace, from events that wait."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple, NoReturn

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.inputs.between import Between
from rtamt.inputs.clock import Ticks
from rtamt.inputs.event_reader import Dated, EventReader, TimedColumn
from rtamt.inputs.events import Given, not_known
from rtamt.inputs.samples import in_between
from rtamt.machines.dense.runs import Positions
from rtamt.machines.dense.waiting import Waiting, together, values_at
from rtamt.machines.ranges import FindRanges
from rtamt.machines.terms import FindTerms
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.dense_regions import RegionProgram
from rtamt.program.polarity import positive
from rtamt.program.program import Program

__all__ = [
    "FindBoth",
    "RegionRows",
    "TraceValues",
    "dense_of",
    "readings_of",
    "rows_between",
    "rows_of",
    "terms_of",
    "unknown_of",
]

FindBoth = tuple[FindTerms, FindRanges]
"""Evaluates terms of values that are known, and of those that are not."""


class RegionRows(NamedTuple):
    """The terms from some positions on.

    Attributes:
        positions: The positions, increasing.
        terms: For every term its value from each position to the next.
    """

    positions: Positions
    terms: Sequence[Floats]

    def between(self, begin: int, end: int) -> RegionRows:
        """Those after a position, up to another one."""
        first, after = self.positions.searchsorted((begin, end), "right")
        if after - first == len(self.positions):
            return self
        return RegionRows(self.positions[first:after], [a[first:after] for a in self.terms])


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def readings_of(program: Program) -> tuple[Program, ...]:
    """The program without negations; if it has neutral predicates, with -0.0 and with 0.0."""
    known = positive(program)
    return (known.reading(-0.0), known.reading(0.0)) if program.neutral else (known,)


def dense_of(regions: RegionProgram) -> DenseProgram:
    """The program for a reader of its events."""
    return DenseProgram(regions.program, regions.resolution)


def rows_of(
    regions: RegionProgram, given: Sequence[Given], reader: EventReader, terms: FindBoth
) -> tuple[int, int, list[RegionRows]]:
    """The first tick of a whole trace, its last position, and the terms.

    Args:
        regions: The program.
        given: The events of its variables, which a machine has taken in before.
        reader: Counts their times, as the machine's reader does.
        terms: Evaluates terms.

    Returns:
        The terms are those of each of `readings_of`, the least ones, and the greatest ones of the
        last of them if not all values are known.
    """
    columns, dated = reader.counted(given, [-math.inf] * len(given), None)
    begin = max(int(ticks[0]) for ticks, _ in columns)
    last = min(int(ticks[-1]) for ticks, _ in columns)
    return (
        begin,
        2 * (last - begin),
        rows_between(regions, (columns, dated), (begin, last), reader, terms),
    )


def rows_between(
    regions: RegionProgram,
    counted: tuple[Sequence[TimedColumn], Dated],
    trace: tuple[int, int],
    reader: EventReader,
    terms: FindBoth,
) -> list[RegionRows]:
    """The terms of `rows_of` on a trace from one tick to another, of events that were counted."""
    columns, dated = counted
    begin, last = trace
    events = [Waiting() for _ in columns]
    for waiting, column in zip(events, columns, strict=True):
        waiting.extend(column)
    ticks, at_ticks = together(events, begin, last)
    if not len(ticks) or ticks[0] > begin:  # the trace begins with an event of another variable
        ticks = np.concatenate([[begin], ticks])
        at_ticks = [values_at(ticks, waiting.upto(last)) for waiting in events]
    values = TraceValues(ticks, at_ticks, dated)
    found = terms_of(readings_of(regions.program), terms, reader, values)
    return [RegionRows(2 * (values.ticks - begin), each) for each in found]


def unknown_of(given: Sequence[Given], reader: EventReader) -> tuple[str, ...]:
    """The variables that are not known somewhere in a whole trace."""
    if reader.max_gap is None and not any(
        values.ndim > 1 or np.isnan(values).any() for _, values, _ in given
    ):
        return ()
    columns, _ = reader.counted(given, [-math.inf] * len(given), None)
    begin = max(int(ticks[0]) for ticks, _ in columns)
    last = min(int(ticks[-1]) for ticks, _ in columns)
    found = []
    for name, (ticks, values) in zip(reader.variables, columns, strict=True):
        first, after = ticks.searchsorted((begin, last), "right")
        if not_known(values[first - 1 : after]).any():
            found.append(name)
    return tuple(found)


class TraceValues(NamedTuple):
    """The values of all variables at some ticks, each numbers or pairs of ends."""

    ticks: Ticks
    values: Sequence[Floats]
    dated: Dated


class _Refusal(NamedTuple):
    """Raises the errors of terms at the ticks of a trace."""

    reader: EventReader
    trace: TraceValues

    def refuse(self, values: Sequence[float | Between], i: int) -> NoReturn:
        self.reader.refuse(values, (int(self.trace.ticks[i]), self.trace.dated))

    def refuse_between(
        self, lower: Iterable[float], upper: Iterable[float], sample: int
    ) -> NoReturn:
        self.refuse([in_between(*ends) for ends in zip(lower, upper, strict=True)], sample)


def terms_of(
    programs: Sequence[Program], terms: FindBoth, reader: EventReader, trace: TraceValues
) -> list[list[Floats]]:
    """The least terms of programs and, if not all values are known, the greatest of the last."""
    find, ranges = terms
    refusal = _Refusal(reader, trace)
    lower = [v if v.ndim == 1 else np.ascontiguousarray(v[:, 0]) for v in trace.values]
    if not any(not_known(v).any() for v in trace.values):
        return [find(program, lower, refusal.refuse) for program in programs]
    upper = [v if v.ndim == 1 else np.ascontiguousarray(v[:, 1]) for v in trace.values]
    found = [
        ranges(program, refusal, range(program.terms), lower, upper, len(trace.ticks))
        for program in programs
    ]
    return [*(least for least, _ in found), found[-1][1]]
