"""What a verdict in dense time stands on; see `rtamt.monitors.asked`."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import Given, are_dates
from rtamt.language.formula import Formula
from rtamt.language.specification import Specification
from rtamt.machines.backend import BACKENDS, BackendName
from rtamt.machines.dense.outlook import recorded
from rtamt.machines.dense.rows import dense_of, rows_between
from rtamt.machines.dense.runs import Runs
from rtamt.machines.protocols import End
from rtamt.machines.readout import verdict_of
from rtamt.monitors.asked import Counted, Evidence, Signs, asked_text, found_rows, reads_hidden
from rtamt.program.dense_regions import RegionProgram, compile_regions
from rtamt.program.implications import InstantRuns, Reads, TraceSpan, reads, unanswered
from rtamt.program.interface import STANDARD, Interface

__all__ = ["DenseAsked", "DenseQuestion", "dense_evidence"]


@dataclass(frozen=True, slots=True)
class DenseAsked:
    """How often an implication was put to the test on a trace in dense time.

    It is put to the test at the recorded instants at which the formula reads it and its left side
    holds for certain. ``str`` gives it in words, as in ``asked 2x, first at time
    1.5``.

    Attributes:
        text: The implication as text.
        duration: How long it was put to the test, in seconds; a single instant lasts 0 s.
        occasions: The number of times at which that began; the begin of the trace counts.
        first: The first of them, as the times of the events are; None if there is none. It may be
            put to the test right after that time.
        vacuous: Whether the verdict is SATISFIED and would be so with ``false`` as the right side
            of this implication, so that no answer mattered.
    """

    text: str
    duration: float
    occasions: int
    first: float | None
    vacuous: bool

    def __str__(self) -> str:
        first = None if self.first is None else f"time {_shown(self.first)}"
        return asked_text(self.occasions, first, vacuous=self.vacuous)


def _shown(time: object) -> str:
    return f"{time:.12g}" if isinstance(time, float | int) else str(time)


class DenseQuestion:
    """A trace in dense time that was judged.

    Args:
        specification: The specification.
        interface: The semantics of the verdict.
        end: The reading of the end.
        regions: The program of the verdict.
        given: For each variable the times and values of its events.
        reader: Counts their times.
        backend: The back-end.
    """

    def __init__(
        self,
        specification: Specification,
        interface: Interface,
        end: End,
        regions: RegionProgram,
        given: Sequence[Given],
        reader: EventReader,
        backend: BackendName,
    ) -> None:
        self.specification = specification
        self.formula = specification.formula
        self.hides = reads_hidden(specification.formula, interface)
        self._bounds = dense_of(regions).bounds
        self._interface = interface
        self._end: End = end
        self._backend: BackendName = backend
        self.resolution = regions.resolution
        self._given = dict(zip(regions.program.variables, given, strict=True))
        self._terms = BACKENDS[backend].term_columns, BACKENDS[backend].term_ranges
        self._reader = reader.with_clock(BACKENDS[backend].clock(dense_of(regions)))
        ends = [self._reader.clock.ticks(column.times[[0, -1]], "") for column in given]
        self._begin = max(int(first) for first, _ in ends)
        self._last = min(int(last) for _, last in ends)
        self._dated = any(are_dates(column.times) for column in given)
        last = 2 * (self._last - self._begin)
        self.extent = TraceSpan(last, end == "complete", end == "cut", dense=True)

    def time(self, position: int) -> float:
        """The time of a position, of the kind of the events' times."""
        return self._reader.time(self._begin + position // 2, self._dated)

    def reads(self) -> Mapping[Formula, Reads]:
        """Where the formula reads its implications."""
        return reads(self.formula, self._bounds, self.extent)

    def opposite(self, left: Formula) -> Signs:
        """The signs of the opposite of a left side, by standard semantics."""
        regions = _opposite(self.specification, self.resolution, left)
        given = [self._given[name] for name in regions.program.variables]
        reader = self._reader.of(dense_of(regions))
        counted = reader.counted(given, [-math.inf] * len(given), None)
        trace = self._begin, self._last
        rows = rows_between(regions, counted, trace, reader, self._terms)
        last = self.extent.last
        return _DenseSigns(*recorded(regions.program, rows, last, self._end), last)

    def satisfied_without(self, answered: Sequence[Formula]) -> bool:
        """Whether the verdict is SATISFIED with ``false`` as the right side of implications."""
        regions, given = self._changed(unanswered(self.formula, answered), self._interface)
        make = BACKENDS[self._backend].dense_episode_machine
        machine = make(regions, self._reader.of(dense_of(regions)))
        machine.run(given)
        machine.finish(self._end)
        return verdict_of(machine.lower, machine.upper) == 1

    def _changed(self, formula: Formula, interface: Interface) -> tuple[RegionProgram, list[Given]]:
        """The program of another formula over the same variables, which make up the trace."""
        specification = _with_result(self.specification, formula)
        regions = compile_regions(specification, self.resolution, interface=interface)
        return regions, [self._given[name] for name in regions.program.variables]


@functools.lru_cache(maxsize=512)
def _opposite(specification: Specification, resolution: Fraction, left: Formula) -> RegionProgram:
    """The program of the opposite of a formula, with its own variables if it has any."""
    opposite = specification.with_result(~left)
    if not left.variables:
        opposite = _with_result(specification, ~left)
    return compile_regions(opposite, resolution, interface=STANDARD)


@functools.lru_cache(maxsize=512)
def _with_result(specification: Specification, formula: Formula) -> Specification:
    other = specification.with_result(formula)
    return replace(other, formulas={**other.formulas, "#": specification.formula})


class _Spans(NamedTuple):
    """Runs of instants, in order; of the recorded ones (`rtamt.program.implications`).

    Attributes:
        begins: The first one of each run.
        ends: The last one.
    """

    begins: NDArray[np.int64]
    ends: NDArray[np.int64]

    @classmethod
    def of(cls, true: NDArray[np.bool_], starts: NDArray[np.int64] | None, last: int) -> _Spans:
        """The runs at which something is so.

        Args:
            true: Whether it is so, for each of the runs that begin at ``starts``.
            starts: In order; None: at each instant from 0 on.
            last: The last instant.
        """
        changes = np.flatnonzero(true[1:] != true[:-1]) + 1
        if true[0]:
            changes = np.concatenate([np.zeros(1, np.int64), changes])
        places = changes if starts is None else starts[changes]
        begins, after = places[::2], places[1::2]
        if len(after) < len(begins):
            after = np.append(after, last + 1)
        return cls(begins, after - 1)

    def within(self, instants: InstantRuns) -> _Spans:
        """The parts of the runs that lie in others."""
        if not len(self.begins):
            return self
        if len(instants) == 1:
            ((first, final),) = instants
            if first <= self.begins[0] and self.ends[-1] <= final:
                return self
        begins, ends = [], []
        for first, final in instants:
            low = int(np.searchsorted(self.ends, first))
            high = int(np.searchsorted(self.begins, final, "right"))
            begins.append(np.maximum(self.begins[low:high], first))
            ends.append(np.minimum(self.ends[low:high], final).astype(np.int64))
        if not begins:
            return _Spans(self.begins[:0], self.ends[:0])
        return _Spans(np.concatenate(begins), np.concatenate(ends))

    def cover(self, instants: InstantRuns, last: int) -> bool:
        """Whether all of some instants are in them, and none is after the last recorded one."""
        if instants and instants[-1][1] > last:
            return False
        found = self.within(instants)
        length = int(np.sum(found.ends - found.begins + 1))
        return length == sum(int(final) - first + 1 for first, final in instants)


class _DenseSigns(NamedTuple):
    least: Runs
    greatest: Runs
    last: int

    def fails_at(self, instants: InstantRuns) -> Counted:
        fails = _Spans.of(np.signbit(self.greatest.last), self.greatest.starts, self.last)
        begins, ends = fails.within(instants)
        ticks = int(np.sum((ends + 1) // 2 - begins // 2))  # the odd positions
        return Counted(ticks, len(begins), int(begins[0]) if len(begins) else None)

    def holds_at(self, instants: InstantRuns) -> bool:
        found = _Spans.of(~np.signbit(self.least.last), self.least.starts, self.last)
        return found.cover(instants, self.last)


def dense_evidence(question: DenseQuestion, *, satisfied: bool) -> Evidence[DenseAsked]:
    """What the verdict on a trace in dense time stands on."""
    rows, vacuous = found_rows(question, satisfied=satisfied)
    asked = []
    for text, (ticks, occasions, position), its in rows:
        first = None if position is None else question.time(position)
        asked.append(DenseAsked(text, float(ticks * question.resolution), occasions, first, its))
    return Evidence.of(asked, satisfied=satisfied, vacuous=vacuous)
