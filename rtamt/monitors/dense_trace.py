"""A judged trace in dense time."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import EventsLike, Given, Until, are_dates
from rtamt.inputs.samples import NanPolicy
from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.operators import Bounds
from rtamt.language.specification import Specification
from rtamt.machines.backend import BACKENDS, BackendName
from rtamt.machines.dense.outlook import DenseOutlook, with_robustness
from rtamt.machines.dense.rows import RegionRows, rows_of, unknown_of, values_between
from rtamt.machines.dense.runs import Runs, clipped, joint
from rtamt.machines.protocols import DenseSigns, End
from rtamt.machines.readout import verdict_of
from rtamt.machines.segments import PlaceNumbers, Segments, UnseenPlace
from rtamt.monitors.options import CompiledEvents
from rtamt.monitors.triggers import DenseTriggerCount, reads_hidden
from rtamt.monitors.unrecorded import TraceClock, TraceRegisters
from rtamt.program.algebra import ordered
from rtamt.program.bodies import body_reads, with_one_body
from rtamt.program.dense_lowering import RegionProgram, compile_regions
from rtamt.program.implications import Counted, InstantRuns, Reads, Routes, TraceSpan, unanswered
from rtamt.program.interface import STANDARD, Interface


class DenseTrace:
    """A trace in dense time with a verdict, which its machine computes."""

    def __init__(
        self,
        compiled: CompiledEvents,
        end: End,
        signals: Mapping[str, EventsLike],
        until: Until | None = None,
    ) -> None:
        self._compiled, self._end = compiled, end
        self._regions, self._reader = compiled.program, compiled.reader()
        self._machines = BACKENDS[compiled.backend]
        self._events = self._reader.whole(signals)
        if until is not None:
            self._events = self._reader.held(self._events, until)
        self.formula = compiled.specification.formula
        self.hides = reads_hidden(self.formula, compiled.interface)
        machine = self._machines.dense_episode_machine(self._regions, self._reader)
        machine.run(self._events)
        self._decided = verdict_of(machine.lower, machine.upper) != 0
        self.complete = machine.complete()
        machine.finish(end)
        self.values = machine.robustness, machine.lower, machine.upper
        self._span = machine.span

    def unknown(self) -> tuple[str, ...]:
        """Return the variables with a value that is not known."""
        return unknown_of(self._events, self._reader)

    def decided_at(self) -> float | None:
        """Return the time of the first tick at which the open end is decided."""
        if not self._decided:
            return None
        again = self._machines.dense_episode_machine(self._regions, self._reader)
        again.run(self._events, decided=True)
        return again.decided_at

    def early_end(self) -> str:
        """Return how a variable ends the trace before others do; empty if none does."""
        return self._reader.early_end(self._events)

    @property
    def extent(self) -> TraceSpan:
        """The places of the trace."""
        last = 2 * (self._span[1] - self._span[0])
        return TraceSpan(last, self._end == "complete", self._end == "cut", dense=True)

    def reads(self) -> Mapping[Formula, Reads]:
        """Return where the formula reads its implications."""
        return _routes(self._regions).reads(self.extent)

    def opposite(self, left: Formula) -> DenseSigns:
        """Return the signs of the negation of a left side, by standard semantics."""
        whole = self._reader
        regions, reader = _opposite(
            self._regions, left, self._compiled.backend, whole.nan, whole.max_gap, whole.unknown
        )
        events = self._events_of(regions)
        return self._machines.dense_signs(regions, reader, events, self._span, self._end)

    def satisfied_without(self, answered: Sequence[Formula]) -> bool:
        """Return whether the verdict is SATISFIED with ``false`` as right side of implications."""
        specification = _with_result(
            self._compiled.specification, unanswered(self.formula, answered)
        )
        regions = compile_regions(
            specification, self._regions.resolution, interface=self._compiled.interface
        )
        machine = self._machines.dense_episode_machine(regions, self._reader.of(regions))
        machine.run(self._events_of(regions))
        machine.finish(self._end)
        return verdict_of(machine.lower, machine.upper) == 1

    def triggers(self, text: str, counted: Counted, *, vacuous: bool) -> DenseTriggerCount:
        """Return how often an implication was triggered, in seconds."""
        ticks, occasions, position = counted
        seconds, ticks_in = self._regions.resolution.as_integer_ratio()
        first = None
        if position is not None:
            dated = are_dates(self._events[0].times)  # dates do not mix with numbers
            first = self._reader.time(self._span[0] + position // 2, dated)
        return DenseTriggerCount(text, ticks * seconds / ticks_in, occasions, first, vacuous)

    def registers(self) -> TraceRegisters:
        """Return the registers of the formula, for an end that is not complete."""
        rows, last, begin = self._rows(self._regions), self.extent.last, self._span[0]
        cut = self._end == "cut"
        outlook = DenseOutlook(self._regions.program, rows, last, cut=cut)
        program = outlook.program

        def reach(register: int) -> tuple[Node, int, int | None]:
            window = program.window(register)
            hi = None if window.endless else window.hi
            return program.sources[register], window.lo or 0, hi

        clock = TraceClock(self._regions.resolution, begin, step=2)
        return TraceRegisters(program, clock, last, last, cut, outlook.undecided, reach)

    def body_reads(self) -> Mapping[Formula, InstantRuns]:
        """Return where the formula reads each of its bodies."""
        return body_reads(self.formula, self.bounds_of, self.extent)

    def bounds_of(self, formula: Node) -> Bounds:
        """Return the bounds of an operator in ticks."""
        return self._regions.bounds(formula)

    def segments(self, formula: Formula, *, standard: bool = False) -> Segments:
        """Return the values of a part of the formula, by standard semantics as left sides are."""
        last = self.extent.last
        runs = self._runs(formula, standard=standard)
        if all(bound is runs[0] for bound in runs):
            known = clipped(runs[0], 0, last)
            values = ordered(known.last)
            return Segments.of(known.starts, last, values, values, values)
        both = joint([clipped(bound, 0, last) for bound in runs])
        return Segments.of(both.starts, last, *map(ordered, both.values))

    def unseen_violation(self, body: Formula, instants: InstantRuns) -> UnseenPlace | None:
        """Return the first place after the trace at which a body fails that fails at none of it."""
        last = self.extent.last
        if self._end != "cut" or instants[-1][1] <= last:
            return None
        _, _, body_runs = self._runs(with_one_body(self.formula, body))
        if not np.signbit(body_runs.last[0]):  # at the first instant
            return None
        _, _, upper = self._runs(body)
        for first, final in instants:
            later = clipped(upper, max(first, last + 1))
            failing = np.flatnonzero(np.signbit(later.last))
            if first <= final and len(failing) and (tick := int(later.starts[failing[0]])) <= final:
                return UnseenPlace(tick, float(later.last[failing[0]]))
        return None

    def times(self, ticks: PlaceNumbers) -> NDArray[Any]:
        """Return the times of ticks after the start, as the times of the events are."""
        dated = are_dates(self._events[0].times)  # dates do not mix with numbers
        return self._reader.times(self._span[0] + ticks, dated)

    def _runs(self, formula: Formula, *, standard: bool = False) -> tuple[Runs, Runs, Runs]:
        """Return robustness and bounds of a part of the formula."""
        regions = self._regions_of(formula, STANDARD if standard else self._compiled.interface)
        rows = self._rows(regions)
        return with_robustness(regions.program, rows, self.extent.last, self._end)

    def _rows(self, regions: RegionProgram) -> list[RegionRows]:
        """Return the terms of a program over the trace."""
        reader = self._reader.of(regions)
        counted = reader.counted(self._events_of(regions))
        terms = self._machines.term_columns, self._machines.term_ranges
        return rows_of(regions.program, values_between(counted, self._span), reader, terms)

    def _regions_of(self, formula: Formula, interface: Interface) -> RegionProgram:
        """Return the program of a part, with the variables of the formula if it has none."""
        specification = self._compiled.specification.with_result(formula)
        if not formula.variables:
            specification = _with_result(self._compiled.specification, formula)
        return compile_regions(specification, self._regions.resolution, interface=interface)

    def _events_of(self, regions: RegionProgram) -> list[Given]:
        """Return the events of the variables of another program."""
        events = dict(zip(self._regions.program.variables, self._events, strict=True))
        return [events[name] for name in regions.program.variables]


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def _routes(regions: RegionProgram) -> Routes:
    return Routes(regions.program.specification.formula, regions.bounds)


@functools.lru_cache(maxsize=512)
def _opposite(
    whole: RegionProgram,
    left: Formula,
    backend: BackendName,
    nan: NanPolicy,
    max_gap: int | None,
    unknown: bool,  # noqa: FBT001 - a key of the cache
) -> tuple[RegionProgram, EventReader]:
    """Return the program of the negation of a left side, and the reader of its events.

    It has the variables of the left side or, without any, those of the whole formula.
    """
    specification = whole.program.specification
    opposite = specification.with_result(~left)
    if not left.variables:
        opposite = _with_result(specification, ~left)
    regions = compile_regions(opposite, whole.resolution, interface=STANDARD)
    dense = regions
    reader = EventReader(dense, nan, max_gap, bounds=True)
    reader.unknown = unknown
    return regions, reader.with_clock(BACKENDS[backend].clock(dense))


@functools.lru_cache(maxsize=512)
def _with_result(specification: Specification, formula: Formula) -> Specification:
    other = specification.with_result(formula)
    return replace(other, formulas={**other.formulas, "#": specification.formula})
