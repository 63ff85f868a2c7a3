"""Robustness and bounds over dense time in Python: at the start of an episode, and everywhere.

The machine is `rtamt.machines.episode.machine` over the regions of dense time. Position 0 is the
start of the trace. The last seen position is the earliest of the variables' last events.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, assert_never

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.inputs.event_reader import Dated, EventReader, TimedColumn
from rtamt.inputs.events import EventsLike, Given, GivenLike
from rtamt.machines.dense.regions import (
    AtBegin,
    RegionConstant,
    RegionFuture,
    RegionPast,
    RegionPointwise,
    RegionPredicate,
    RegionSliding,
    RegionStream,
)
from rtamt.machines.dense.rows import (
    EventMachine,
    RegionRows,
    TraceValues,
    rows_of,
    together,
    values_between,
)
from rtamt.machines.dense.runs import Positions, Runs, clipped, joint
from rtamt.machines.protocols import OPEN_WORLDS, End, World, worlds_of
from rtamt.machines.segments import FOREVER, PlaceRuns
from rtamt.machines.state import StateFields, moved, verdict_of
from rtamt.machines.terms import FindRanges, Registers, term_ranges
from rtamt.program.algebra import FOLDS, FUNCTIONS
from rtamt.program.dense_lowering import MAX_TICKS, RegionProgram
from rtamt.program.implications import Counted, InstantRuns
from rtamt.program.instructions import Const, Load, Map, Window
from rtamt.program.placement import Placement, place, variants_of
from rtamt.program.program import Program


class Regions(StateFields):
    """The registers of a program, at all positions or only at the start."""

    STATE = ("t", "_first", "_keepers")
    t: int
    _first: Registers

    def __init__(self, placement: Placement) -> None:
        self.program = placement.program
        self._initial = placement.initial
        self._axes = {register: axis for axis, register in enumerate(placement.unknowns)}
        self.streams: dict[int, RegionStream] = {}
        for register in placement.streams:
            self.streams[register] = self._made(register)
        self._folds = {
            register: AtBegin(window, [self.streams[a] for a in window.args])
            for register in placement.initial
            if isinstance(window := self.program.instructions[register], Window)
        }
        self._keepers: list[Any] = [*self.streams.values(), *self._folds.values()]
        self.unknowns = np.zeros((len(World), len(self._axes)))
        self.reset()

    def _made(self, register: int) -> RegionStream:
        instruction = self.program.instructions[register]
        corners = (2,) * len(self._axes)
        if isinstance(instruction, Const):
            return RegionConstant(corners, instruction.value)
        if register < self.program.terms:
            return RegionPredicate(corners)
        match self.program.formula(register):
            case Map(function, args):
                return RegionPointwise(FOLDS[function], [self.streams[a] for a in args])
            case Window(_, lo, hi, args) as window:
                streams = [self.streams[a] for a in args]
                if hi is None:
                    return RegionFuture(window, self._axes.get(register), streams)
                if lo is None:
                    return RegionPast(window, hi, streams)
                return RegionSliding(window, lo, hi, streams)
            case _ as never:
                assert_never(never)

    def advance(self, positions: Positions, terms: Sequence[Floats], t: int) -> None:
        """Take the terms at new positions; all positions up to t have been seen."""
        if self.t < 0:
            self._first = [float(values[0]) for values in terms]
        self.t = t
        for register, stream in self.streams.items():
            if isinstance(stream, RegionPredicate):
                stream.take(positions, terms[register])
            runs = stream.settle(t)
            if runs is None:
                continue
            if isinstance(stream, RegionFuture):
                axis = self._axes[register]
                for keeper in self._keepers:
                    keeper.substitute(axis, runs.last[..., 0])
            stream.append(runs, t)
        for fold in self._folds.values():
            fold.settle()
        for stream in self.streams.values():
            stream.trim()

    def unfold(self, rows: RegionRows, t: int, worlds: Sequence[World]) -> None:
        """Take a whole trace, of which only predicates settle, and compute all runs."""
        self.t = t
        for register, stream in self.streams.items():
            if isinstance(stream, RegionPredicate):
                stream.take(rows.positions, rows.terms[register])
            if isinstance(stream, RegionPredicate | RegionConstant) and (runs := stream.settle(t)):
                stream.append(runs, t)
            for world in worlds:
                stream.look(world, t, self.unknowns)

    def look(self, worlds: int) -> list[float]:
        """Return the robustness at the start in the first worlds."""
        known = list(World)[:worlds]
        for stream in self.streams.values():
            for world in known:
                stream.look(world, self.t, self.unknowns)
        values: dict[int, list[float]] = {}
        for register in self._initial:
            values[register] = self._at_zero(register, values, known)
        return values[self.program.result]

    def _at_zero(
        self, register: int, values: dict[int, list[float]], worlds: Sequence[World]
    ) -> list[float]:
        match self.program.instructions[register]:
            case Const(value):
                return [value] * len(worlds)
            case Window():
                fold = self._folds[register]
                return [fold.value(world, self.t, self.unknowns) for world in worlds]
            case Map(function, args) if register >= self.program.terms:
                choose = FUNCTIONS[function].apply
                return [choose(*x) for x in zip(*(values[a] for a in args), strict=True)]
            case Load() | Map():
                seen = self.t >= 0
                return [self._first[register] if seen else world.unseen for world in worlds]
            case _ as never:
                assert_never(never)

    def seen(self, register: int, world: World) -> Runs:
        """Return all runs of a stream in a world, if nothing has settled."""
        return self.streams[register].seen(world, 0, self.unknowns)

    def reset(self) -> None:
        self.t = -1
        self._first = []
        for keeper in self._keepers:
            keeper.reset()


class RegionRegisters(Protocol):
    """The registers of a program, in Python (`Regions`) or C++."""

    @property
    def t(self) -> int: ...
    def advance(self, positions: Positions, terms: Sequence[Floats], t: int) -> None: ...
    def look(self, worlds: int) -> Sequence[float]: ...
    def reset(self) -> None: ...
    def state(self) -> Any: ...  # noqa: ANN401 - of the back-end
    def restore(self, state: Any) -> None: ...  # noqa: ANN401


class PythonDenseEpisodeMachine(EventMachine[RegionRows]):
    """Bounds the robustness at the start of a trace, from events in chunks of any size.

    From the first unknown value on, twins of the last registers continue from their state: they
    take the largest values of all terms, and the others the smallest, as in
    `rtamt.machines.episode.machine`.
    """

    STATE = (
        *EventMachine.STATE,
        "robustness",
        "lower",
        "upper",
        "_decided",
        "_readings",
        "_greatest",
    )
    robustness: float
    lower: float
    upper: float
    _decided: int | None
    _greatest: list[RegionRegisters]

    def __init__(
        self,
        regions: RegionProgram,
        reader: EventReader,
        make: Callable[[Placement], RegionRegisters] = Regions,
        find: FindRanges = term_ranges,
    ) -> None:
        super().__init__(regions.program, reader)
        self._program = regions
        self._make = make
        self._find = find
        self._programs = variants_of(regions.program)
        self._readings = [make(place(program)) for program in self._programs]
        self.reset()

    @property
    def settled(self) -> float:
        return self.reader.time(self._end, self._dated)

    @property
    def span(self) -> tuple[int, int]:
        return int(self._declared.begin(self._first)), int(self._end)

    @property
    def decided_at(self) -> float | None:
        if self._decided is None:
            return None
        return self.reader.time(self._declared.begin(self._first) + self._decided, self._dated)

    @property
    def _end(self) -> float:
        """The last tick at which all variables are known."""
        end = self._declared.end(self._last)
        return end if end >= self._declared.begin(self._first) else -math.inf

    def update(self, *events: Mapping[str, EventsLike], **named: EventsLike) -> float:
        self._take(*self._read(events, named))
        return self.robustness

    def run(self, given: Sequence[GivenLike], *, decided: bool = False) -> None:
        """Read a whole trace, with times as the caller passed them."""
        columns, dated = self.reader.counted(given, self._last, self._dated)
        self._take(columns, dated, decided=decided)
        if math.isinf(self._end):
            self.reader.refuse_end(self._first, self._last, self._dated)

    def complete(self) -> tuple[float, float]:
        """Return the bounds of the complete trace."""
        bounds = [reading.look(1)[0] for reading in self._all()]
        return bounds[0], bounds[-1]

    def _all(self) -> list[RegionRegisters]:
        """Return the registers for the lower bound, for the robustness, and for the upper bound."""
        return [*self._readings, *self._greatest]

    def _take(self, columns: Sequence[TimedColumn], dated: Dated, *, decided: bool = True) -> None:
        before = self._end
        begin, end, rows = self._extend(columns, dated)
        if len(rows) > len(self._readings) and not self._greatest:
            self._greatest = [self._twin()]
            self._greatest[0].restore(self._readings[-1].state())
        if begin <= end and end != before:
            known = -1 if math.isinf(before) else int(before - begin)
            if decided and self._decided is None:
                self._decide(rows, known, int(end - begin))
            else:
                self._go(rows, known, int(end - begin))

    def _rows(self, begin: int, end: int, dated: Dated) -> list[RegionRows]:
        """Return the terms at all new times for each of the registers; changes nothing."""
        trace = TraceValues(begin, end, *together(self._waiting, begin, end), dated)
        rows = rows_of(self._program.program, trace, self.reader, self._find)
        if self._greatest and len(rows) == len(self._readings):
            rows.append(rows[-1])
        length = end - begin + self._program.reach
        if length >= MAX_TICKS:
            self.reader.refuse_length(length)
        return rows

    def _twin(self) -> RegionRegisters:
        return self._make(place(self._programs[-1]))

    def _decide(self, rows: Sequence[RegionRows], known: int, ticks: int) -> None:
        """Advance from a known tick to another, and search for the tick of the decision."""
        low, high, state = known, ticks, self._states()
        self._go(rows, known, ticks)
        if verdict_of(self.lower, self.upper) == 0:
            return
        final = self._states(), (self.robustness, self.lower, self.upper)
        while high - low > 1:  # bounds never widen
            middle = (low + high) // 2
            self._restore(state)
            self._go(rows, low, middle)
            if verdict_of(self.lower, self.upper) == 0:
                low, state = middle, self._states()
            else:
                high = middle
        self._decided = high
        after, (self.robustness, self.lower, self.upper) = final
        self._restore(after)

    def _states(self) -> list[Any]:
        return [reading.state() for reading in self._all()]

    def _restore(self, states: Sequence[Any]) -> None:
        for reading, state in zip(self._all(), states, strict=True):
            reading.restore(state)

    def _go(self, rows: Sequence[RegionRows], known: int, ticks: int) -> None:
        for reading, terms in zip(self._all(), rows, strict=True):
            reading.advance(*terms.between(2 * known, 2 * ticks), 2 * ticks)
        self._conclude()

    def _conclude(self) -> None:
        values = [reading.look(len(OPEN_WORLDS)) for reading in self._all()]
        self.lower, self.upper = values[0][World.LOWER], values[-1][World.UPPER]
        self.robustness = values[len(self._readings) - 1][World.NOW]
        if self._readings[0].t < 0:
            self.robustness = math.nan

    def finish(self, end: End = "complete") -> float:
        if self.finished:
            return self.robustness
        if math.isinf(self._end):
            self.reader.refuse_end(self._first, self._last, self._dated)
        low, high = worlds_of(end)
        values = [reading.look(high + 1) for reading in self._all()]
        self.lower, self.upper = values[0][low], values[-1][high]
        self.robustness = moved(self.robustness, self.lower, self.upper)
        self.finished = True
        return self.robustness

    def reset(self) -> None:
        super().reset()
        self._decided = None
        for reading in self._readings:
            reading.reset()
        self._greatest = []
        self._conclude()

    def restore(self, state: list[Any]) -> None:
        self._greatest = [self._twin() for _ in state[self.STATE.index("_greatest")]]
        super().restore(state)


def dense_values(
    regions: RegionProgram,
    reader: EventReader,
    given: Sequence[Given],
    trace: tuple[int, int],
    end: End,
    beyond: bool = False,  # noqa: FBT001, FBT002 - an argument of a back-end
    find: FindRanges = term_ranges,
) -> tuple[Runs, Runs, Runs]:
    """Return robustness, lower and upper bound of the result on a trace and after it.

    They are one object if the values are known. The bounds may start at the first position at which
    they may differ from the robustness. The last run lasts for ever. A result that is a predicate
    may have no run after the trace. Without ``beyond``, values after the trace are not read, and a
    result that does not look ahead has no bounds of its own.
    """
    values = values_between(reader.counted(given), trace)
    rows, last = rows_of(regions.program, values, reader, find), 2 * (trace[1] - trace[0])
    return with_robustness(regions.program, rows, last, end, beyond=beyond)


def with_robustness(
    program: Program, rows: Sequence[RegionRows], last: int, end: End, *, beyond: bool = False
) -> tuple[Runs, Runs, Runs]:
    """Return the values of `dense_values` from the terms."""
    low, high = bound_worlds(program, end, beyond=beyond)
    worlds = {World.NOW, low, high}
    if any(window.hi is None or window.endless for window in program.windows):
        worlds |= {low.opened, high.opened}
    programs = variants_of(program)
    # With uncertain values the last rows are the largest terms of the last program.
    variant = {0: programs[0], len(programs) - 1: programs[-1], len(rows) - 1: programs[-1]}
    if program.result < program.terms and not isinstance(
        program.instructions[program.result], Const
    ):
        runs = {
            i: dict.fromkeys(
                (World.NOW, low, high), Runs(rows[i].positions, (rows[i].terms[v.result],))
            )
            for i, v in variant.items()
        }
    else:
        runs = {}
        for i, v in variant.items():
            regions = Regions(everywhere(v))
            regions.unfold(rows[i], last, sorted(worlds))
            runs[i] = {world: regions.seen(v.result, world) for world in {World.NOW, low, high}}
    return runs[len(programs) - 1][World.NOW], runs[0][low], runs[len(rows) - 1][high]


def bound_worlds(program: Program, end: End, *, beyond: bool = False) -> tuple[World, World]:
    """Return the worlds of the lower and the upper bound."""
    return worlds_of(end if beyond or _looks_ahead(program) else "complete")


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def _looks_ahead(program: Program) -> bool:
    return any(window.ahead for window in program.windows)


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def everywhere(program: Program) -> Placement:
    """Return a placement in which all registers are streams, except for terms of terms."""
    every = tuple(range(len(program.instructions)))
    read = {a for r in every[program.terms :] for a in program.formula(r).args} | {program.result}
    streams = tuple(r for r in every if r >= program.terms or r in read)
    return Placement(program, (), streams, ())


class DenseOutlook:
    """The bounds of all registers of ``program`` on a trace."""

    def __init__(self, program: Program, rows: Sequence[RegionRows], last: int, end: End) -> None:
        self.last = last
        low, high = self._worlds = worlds_of(end)
        worlds = sorted({World.NOW, low.opened, high.opened, low, high})
        self._readings = []
        programs = variants_of(program)
        greatest = programs[-1:] * (len(rows) - len(programs))
        for variant, terms in zip((*programs, *greatest), rows, strict=True):
            self.program = variant
            regions = Regions(everywhere(variant))
            regions.unfold(terms, last, worlds)
            self._readings.append(regions)

    def undecided(self, register: int) -> PlaceRuns:
        """Return the positions at which a register may have either sign."""
        low, high = self._worlds
        worst = self._readings[0].seen(register, low)
        best = self._readings[-1].seen(register, high)
        runs = joint([worst, best])
        differ = np.signbit(runs.values[0]) != np.signbit(runs.values[1])
        return PlaceRuns.where(differ, runs.starts, FOREVER)


class PythonDenseSigns:
    """The certain signs of a formula at the positions of a whole trace."""

    def __init__(
        self,
        regions: RegionProgram,
        reader: EventReader,
        given: Sequence[Given],
        trace: tuple[int, int],
        end: End,
        find: FindRanges = term_ranges,
    ) -> None:
        last = self._last = 2 * (trace[1] - trace[0])
        _, *bounds = dense_values(regions, reader, given, trace, end, find=find)
        self._least, self._greatest = (clipped(bound, 0, last) for bound in bounds)

    def fails_at(self, instants: InstantRuns) -> Counted:
        greatest = self._greatest
        fails = PlaceRuns.where(np.signbit(greatest.last), greatest.starts, self._last)
        runs = fails.within(instants)
        return runs.length(2), len(runs.first), int(runs.first[0]) if len(runs.first) else None

    def holds_at(self, instants: InstantRuns) -> bool:
        if instants[-1][1] > self._last:
            return False
        holds = PlaceRuns.where(~np.signbit(self._least.last), self._least.starts, self._last)
        length = sum(int(final) - first + 1 for first, final in instants)
        return holds.within(instants).length(1) == length
