"""What a verdict in dense time stands on; see `rtamt.monitors.asked`."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import Given, are_dates
from rtamt.inputs.samples import NanPolicy
from rtamt.language.formula import Formula
from rtamt.language.specification import Specification
from rtamt.machines.backend import BACKENDS, BackendName
from rtamt.machines.dense.rows import dense_of
from rtamt.machines.protocols import End
from rtamt.machines.readout import verdict_of
from rtamt.monitors.asked import Evidence, Signs, asked_text, found_rows, reads_hidden
from rtamt.program.dense_regions import RegionProgram, compile_regions
from rtamt.program.implications import Reads, Routes, TraceSpan, unanswered
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
        trace: The first and the last tick of the trace.
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
        trace: tuple[int, int],
        reader: EventReader,
        backend: BackendName,
    ) -> None:
        self.specification = specification
        self.formula = specification.formula
        self.hides = reads_hidden(specification.formula, interface)
        self.resolution = regions.resolution
        self._regions = regions
        self._interface, self._end, self._backend = interface, end, backend
        self._given = dict(zip(regions.program.variables, given, strict=True))
        self._reader, self._trace = reader, trace
        last = 2 * (trace[1] - trace[0])
        self.extent = TraceSpan(last, end == "complete", end == "cut", dense=True)

    def time(self, position: int) -> float:
        """The time of a position, of the kind of the events' times."""
        column = next(iter(self._given.values()))  # dates do not mix with numbers
        return self._reader.time(self._trace[0] + position // 2, are_dates(column.times))

    def reads(self) -> Mapping[Formula, Reads]:
        """Where the formula reads its implications."""
        return _routes(self._regions).reads(self.extent)

    def opposite(self, left: Formula) -> Signs:
        """The signs of the opposite of a left side, by standard semantics."""
        whole = self._reader
        regions, reader = _opposite(
            self._regions, left, self._backend, whole.nan, whole.max_gap, whole.unknown
        )
        given = [self._given[name] for name in regions.program.variables]
        made = BACKENDS[self._backend].dense_signs
        return made(regions, reader, given, self._trace, self._end)

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


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def _routes(regions: RegionProgram) -> Routes:
    return Routes(regions.program.specification.formula, dense_of(regions).bounds)


@functools.lru_cache(maxsize=512)
def _opposite(
    whole: RegionProgram,
    left: Formula,
    backend: BackendName,
    nan: NanPolicy,
    max_gap: int | None,
    unknown: bool,  # noqa: FBT001 - a key of the cache
) -> tuple[RegionProgram, EventReader]:
    """The program of the opposite of a left side, and what reads its events.

    It has the variables of the left side, or if there are none of the whole formula.
    """
    specification = whole.program.specification
    opposite = specification.with_result(~left)
    if not left.variables:
        opposite = _with_result(specification, ~left)
    regions = compile_regions(opposite, whole.resolution, interface=STANDARD)
    dense = dense_of(regions)
    reader = EventReader(dense, nan, max_gap, bounds=True)
    reader.unknown = unknown
    return regions, reader.with_clock(BACKENDS[backend].clock(dense))


@functools.lru_cache(maxsize=512)
def _with_result(specification: Specification, formula: Formula) -> Specification:
    other = specification.with_result(formula)
    return replace(other, formulas={**other.formulas, "#": specification.formula})


def dense_evidence(question: DenseQuestion, *, satisfied: bool) -> Evidence[DenseAsked]:
    """What the verdict on a trace in dense time stands on."""
    rows, vacuous = found_rows(question, satisfied=satisfied)
    asked, (seconds, ticks_in) = [], question.resolution.as_integer_ratio()
    for text, (ticks, occasions, position), its in rows:
        first = None if position is None else question.time(position)
        asked.append(DenseAsked(text, ticks * seconds / ticks_in, occasions, first, its))
    return Evidence.of(asked, satisfied=satisfied, vacuous=vacuous)
