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
from rtamt.machines.dense.episode import DenseOutlook
from rtamt.machines.dense.rows import rows_of, unknown_of, values_between
from rtamt.machines.dense.runs import Runs, clipped, joint
from rtamt.machines.protocols import DenseSigns, End
from rtamt.machines.segments import PlaceNumbers, Segments, UnseenPlace
from rtamt.machines.state import verdict_of
from rtamt.monitors.options import CompiledEvents
from rtamt.monitors.triggers import DenseTriggerCount, reads_hidden
from rtamt.monitors.unrecorded import TraceClock, TraceRegisters
from rtamt.program.algebra import ordered
from rtamt.program.dense_lowering import RegionProgram, compile_regions
from rtamt.program.implications import (
    Counted,
    InstantRuns,
    Reads,
    Routes,
    TraceSpan,
    body_reads,
    unanswered,
    with_one_body,
)
from rtamt.program.interface import STANDARD, Interface


class DenseTrace:
    """A trace in dense time with a verdict; the machine computes it."""

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
        """Return a text about the variable that ends the trace before the others, or empty."""
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
        regions, reader = self._part(~left, STANDARD)
        events = self._events_of(regions)
        return self._machines.dense_signs(regions, reader, events, self._span, self._end)

    def satisfied_without(self, answered: Sequence[Formula]) -> bool:
        """Return whether the verdict is SATISFIED with ``false`` as right sides of implications."""
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
        reader, last, begin = self._reader, self.extent.last, self._span[0]
        values = values_between(reader.counted(self._events), self._span)
        terms = self._machines.term_columns, self._machines.term_ranges
        rows = rows_of(self._regions.program, values, reader, terms)
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
        return _body_reads(self._regions, self.extent)

    def bounds_of(self, formula: Node) -> Bounds:
        """Return the bounds of an operator in ticks."""
        return _bounds(self._regions, formula)

    def segments(self, formula: Formula, *, standard: bool = False) -> Segments:
        """Return the values of a part of the formula, for left sides by standard semantics."""
        last = self.extent.last
        runs = self._runs(formula, standard=standard)
        robustness, *bounds = runs
        find_runs, begin = self._machines.find_runs, int(bounds[0].starts[0])
        if begin > last or all(bound is robustness for bound in bounds):
            known = clipped(robustness, 0, last)
            values = ordered(known.last)
            return Segments(known.starts, last, values, values, values, find_runs)
        known = clipped(robustness, 0, begin - 1)
        open_end = joint([clipped(part, begin, last) for part in runs])
        starts = np.concatenate([known.starts, open_end.starts])
        robust, lower, upper = (
            ordered(np.concatenate([known.last, column])) for column in open_end.values
        )
        return Segments(starts, last, robust, lower, upper, find_runs)

    def unseen_violation(self, body: Formula, instants: InstantRuns) -> UnseenPlace | None:
        """Return the first place after the trace at which a body fails, or None."""
        last = self.extent.last
        if self._end != "cut" or instants[-1][1] <= last:
            return None
        robustness, _, upper = self._runs(with_one_body(self.formula, body))
        at_start = robustness if upper.starts[0] > 0 else upper
        if not np.signbit(at_start.last[0]):
            return None
        _, _, upper = self._runs(body, beyond=True)
        for first, final in instants:
            later = clipped(upper, max(first, last + 1))
            failing = np.flatnonzero(np.signbit(later.last))
            if first <= final and len(failing) and (tick := int(later.starts[failing[0]])) <= final:
                return UnseenPlace(tick, float(later.last[failing[0]]))
        return None

    def times(self, ticks: PlaceNumbers) -> NDArray[Any]:
        """Return the times of ticks after the start, of the kind of the events' times."""
        dated = are_dates(self._events[0].times)  # dates do not mix with numbers
        return self._reader.times(self._span[0] + ticks, dated)

    def _runs(
        self, formula: Formula, *, standard: bool = False, beyond: bool = False
    ) -> tuple[Runs, Runs, Runs]:
        """Return robustness and bounds of a part of the formula."""
        part = self._part(formula, STANDARD if standard else self._compiled.interface)
        events = self._events_of(part[0])
        return self._machines.dense_values(*part, events, self._span, self._end, beyond)

    def _part(self, formula: Formula, interface: Interface) -> tuple[RegionProgram, EventReader]:
        reader = self._reader
        options = reader.nan, reader.max_gap, reader.unknown
        return _part(self._regions, formula, interface, self._compiled.backend, *options)

    def _events_of(self, regions: RegionProgram) -> list[Given]:
        """Return the events of the variables of another program."""
        events = dict(zip(self._regions.program.variables, self._events, strict=True))
        return [events[name] for name in regions.program.variables]


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def _routes(regions: RegionProgram) -> Routes:
    return Routes(regions.program.specification.formula, regions.bounds)


@functools.lru_cache(maxsize=512)  # many traces have one length
def _body_reads(regions: RegionProgram, extent: TraceSpan) -> Mapping[Formula, InstantRuns]:
    formula = regions.program.specification.formula
    return body_reads(formula, functools.partial(_bounds, regions), extent)


@functools.lru_cache(maxsize=512)
def _bounds(regions: RegionProgram, formula: Node) -> Bounds:
    return regions.bounds(formula)


@functools.lru_cache(maxsize=512)
def _part(
    whole: RegionProgram,
    formula: Formula,
    interface: Interface,
    backend: BackendName,
    nan: NanPolicy,
    max_gap: int | None,
    unknown: bool,  # noqa: FBT001 - a key of the cache
) -> tuple[RegionProgram, EventReader]:
    """Return the program of a part of the formula, and the reader of its events.

    It has the variables of the part; if the part has no variables, all variables of the formula.
    """
    specification = whole.program.specification
    part = specification.with_result(formula)
    if not formula.variables:
        part = _with_result(specification, formula)
    regions = compile_regions(part, whole.resolution, interface=interface)
    reader = EventReader(regions, nan, max_gap, bounds=True)
    reader.unknown = unknown
    return regions, reader.with_clock(BACKENDS[backend].clock(regions))


@functools.lru_cache(maxsize=512)
def _with_result(specification: Specification, formula: Formula) -> Specification:
    other = specification.with_result(formula)
    return replace(other, formulas={**other.formulas, "#": specification.formula})
