"""Judged traces: the bounds, signs and values of a formula on a recording, and its evidence."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any, ClassVar, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import SpecificationError
from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import EventsLike, Given, Until, are_dates
from rtamt.inputs.samples import SampleReader
from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.operators import Bounds
from rtamt.machines.backend import BACKENDS
from rtamt.machines.bounds import TraceBounds, needed_samples
from rtamt.machines.dense.episode import DenseOutlook
from rtamt.machines.dense.rows import rows_of, unknown_of, values_between
from rtamt.machines.dense.runs import Runs, clipped, joint
from rtamt.machines.offline import result_alone
from rtamt.machines.protocols import DenseSigns, End, SampleRuns, TraceSet
from rtamt.machines.segments import PlaceNumbers, PlaceRuns, Segments, UnseenPlace
from rtamt.machines.state import moved, verdict_of
from rtamt.machines.walk import Keys, number_of
from rtamt.monitors.evidence import (
    DenseTriggerCount,
    TraceRegisters,
    TriggerCount,
)
from rtamt.monitors.options import Compiled, CompiledEvents
from rtamt.program.algebra import ordered
from rtamt.program.dense_lowering import RegionProgram
from rtamt.program.implications import (
    Counted,
    InstantRuns,
    Reads,
    Routes,
    TraceSpan,
    body_reads,
    implications,
    unanswered,
    with_one_body,
)
from rtamt.program.instructions import Window
from rtamt.program.interface import STANDARD, Interface
from rtamt.program.memory import episode_numbers
from rtamt.program.placement import place
from rtamt.program.program import Program

_Columns = list[NDArray[np.float64]]
_C = TypeVar("_C", bound=Compiled | CompiledEvents)

_MAX_SHORT: Final = 8192
"""The number of samples up to which the machine is faster than columns; half for each unknown."""

_MAX_NUMBERS: Final = 1 << 16
"""The maximum number of numbers in the memory of the machine."""


class _Trace(Generic[_C]):
    """A recording with an end mode.

    ``step`` is the number of places of an instant: in dense time, itself and the time after it.
    """

    step: ClassVar[int]
    start = 0
    """The instant of place 0."""
    tick: Fraction | None
    """Seconds from one instant to the next; None if times are numbers of samples."""

    def __init__(self, compiled: _C, end: End) -> None:
        self._compiled, self.end = compiled, end
        self.formula = compiled.specification.formula
        self.hides = reads_hidden(self.formula, compiled.interface)

    @property
    def last(self) -> int:
        """The last recorded place that matters."""
        raise NotImplementedError

    @property
    def extent(self) -> TraceSpan:
        """The places of the trace."""
        return TraceSpan(self.last, self.end == "complete", self.end == "cut", dense=self.step > 1)

    @property
    def unit(self) -> str:
        """The unit of durations."""
        return "samples" if self.tick is None else "s"

    def seconds(self, place: int) -> float:
        """Return the time of a place, as a whole number if it is one."""
        time = (self.start + place // self.step) * (1 if self.tick is None else self.tick)
        return int(time) if time.denominator == 1 else float(time)

    def reads(self) -> Mapping[Formula, Reads]:
        """Return where the formula reads its implications."""
        return formula_reads(self._compiled, self.extent)

    def body_reads(self) -> Mapping[Formula, InstantRuns]:
        """Return where the formula reads each of its bodies."""
        return _body_reads(self._compiled, self.extent)

    def bounds_of(self, formula: Node) -> Bounds:
        """Return the bounds of an operator in samples or ticks."""
        return self._compiled.bounds(formula)


class SampleTrace(_Trace[Compiled]):
    """A trace of samples.

    ``columns`` are the smallest and largest values of every variable, one list if all are known.
    With ``by_columns`` implications are evaluated from the columns alone, without the bounds of the
    formula, because the verdict is known.
    """

    step: ClassVar = 1

    def __init__(
        self,
        compiled: Compiled,
        end: End,
        columns: tuple[_Columns, _Columns],
        n: int,
        *,
        by_columns: bool = False,
    ) -> None:
        super().__init__(compiled, end)
        self.tick = compiled.period
        self._columns, self._n, self._by_columns = columns, n, by_columns
        self._by_machine = False  # the machine has judged the trace

    def judge(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Return robustness and bounds, and the bounds of the complete trace.

        The native machine of `EpisodeMonitor` judges short traces; columns judge all others.
        """
        least, greatest = self._columns
        run = None
        episode_run = BACKENDS[self._compiled.backend].episode_run
        if episode_run is not None and greatest is least and is_short(self._program, self._n):
            # None after an error: the sample with the error may not matter, so use the columns.
            run = episode_run(self._program, least, self._n, self.end)
        if run is not None or self.hides:  # columns are read later; the caller may write to them
            low = [column.copy() for column in least]
            high = low if greatest is least else [column.copy() for column in greatest]
            self._columns = low, high
        if run is not None:
            self._decided_at, self._by_machine = run.decided_at, True
            return (run.robustness, run.lower, run.upper), (run.complete, run.complete)
        bounds = self.bounds
        complete, ends = bounds.bounds("complete"), bounds.bounds(self.end)
        robustness = moved(bounds.robustness(), *ends)
        # Free the computed columns, which are as long as the trace.
        self.bounds = bounds.until(bounds.n)
        if not self.hides:
            self._columns = [], []
        return (robustness, *ends), complete

    @property
    def _program(self) -> Program:
        return self._compiled.program

    def times(self, samples: PlaceNumbers) -> NDArray[Any]:
        """Return the times of samples."""
        return scaled(samples, self.tick)

    @functools.cached_property
    def bounds(self) -> TraceBounds:
        """The bounds of the formula."""
        machines = BACKENDS[self._compiled.backend]
        reader = SampleReader(self._program, self._compiled.nan, bounds=True)
        return TraceBounds.of(self._program, reader, machines, self._columns, self._n)

    @property
    def n(self) -> int:
        """The number of samples that matter."""
        return self._n if self._by_columns else needed_samples(self._program, self._n)

    @property
    def last(self) -> int:
        """The last sample that matters."""
        return self.n - 1

    @functools.cached_property
    def _decided_at(self) -> int | None:
        return _first_decided(self.bounds)

    def decided_at(self) -> int | None:
        """Return the first sample at which the open end is decided."""
        return self._decided_at

    def early_end(self) -> str:
        """Return an empty text: all variables have the same number of samples."""
        return ""

    def opposite(self, left: Formula) -> _SampleSigns:
        """Return the signs of the negation of a left side, by standard semantics."""
        compiled = self._compiled
        if not (self.hides or self._by_columns):
            # The negation, as the whole formula may have no other predicates.
            program = opposite_program(compiled, compiled.interface, left)
            counted = self._counter(program) if self._by_machine else None
            return _SampleSigns(lambda: self.bounds.part(program), self.end, self.last, counted)
        program = opposite_program(compiled, STANDARD, left)
        bounds = self._bounds_of(program, everywhere=True)
        return _SampleSigns(lambda: bounds, self.end, bounds.n - 1)

    def _counter(self, program: Program) -> Callable[[InstantRuns], Counted | None] | None:
        """Return a function that counts failures in C++; None if only columns can count them."""
        functions = BACKENDS[self._compiled.backend].trace_runs
        if functions is None or not counts_alone(program):
            return None
        column = dict(zip(self._program.variables, self._columns[0], strict=True))
        alone, n = result_alone(program), np.array([self._n], np.int64)
        traces = TraceSet([column[name] for name in alone.variables], _FIRST, n)

        def count(instants: InstantRuns) -> Counted | None:
            runs = _sample_runs(instants, self.last)
            samples, starts, first = functions.count_failures(alone, traces, runs, 1)
            if samples[0] < 0:
                return None
            return int(samples[0]), int(starts[0]), int(first[0]) if samples[0] else None

        return count

    def satisfied_without(self, answered: Sequence[Formula]) -> bool:
        """Return whether the verdict is SATISFIED with ``false`` as right sides of implications."""
        program = self._compiled.part(unanswered(self.formula, answered))
        bounds = self._bounds_of(program) if self._by_columns else self.bounds.part(program)
        return verdict_of(*bounds.bounds(self.end)) == 1

    def triggers(self, text: str, counted: Counted, *, vacuous: bool) -> TriggerCount:
        """Return how often an implication was triggered, in samples."""
        return TriggerCount(text, *counted, vacuous)

    def registers(self) -> TraceRegisters:
        """Return the registers of the formula, for an end that is not complete."""
        bounds, end, exact = self.bounds, self.end, self.bounds.split.exact

        def undecided(register: int) -> PlaceRuns:
            return bounds.undecided(register, end)

        def reach(register: int) -> tuple[Node, int, int | None]:
            node, window = exact.sources[register], exact.window(register)
            inner = window.args[-1]
            hi = window.hi
            if exact.sources[inner] is node:  # a late window without an end shifts another window
                instruction = exact.instructions[inner]
                hi = None if isinstance(instruction, Window) and instruction.hi is None else hi
            return node, window.lo or 0, hi

        return TraceRegisters(bounds.split.formulas, undecided, reach)

    def segments(self, formula: Formula, *, standard: bool = False) -> Segments:
        """Return the values of a part of the formula; by standard semantics for left sides."""
        values = self._part(formula, standard=standard).recorded(self.end)
        find_runs = BACKENDS[self._compiled.backend].find_runs
        return Segments(None, self._n - 1, *values, find_runs)

    def around_end(self, formula: Formula) -> tuple[tuple[Keys, Keys], tuple[Keys, Keys]]:
        """Return both bounds of a part of the formula at every sample, and after the trace."""
        return self._part(formula).around_end(self.end)

    def unseen_violation(self, body: Formula, instants: InstantRuns) -> UnseenPlace | None:
        """Return the first sample after the trace at which a body fails, or None."""
        if self.end != "cut" or instants[-1][1] < self._n:
            return None
        part = self._part(with_one_body(self.formula, body), standard=False, everywhere=False)
        if verdict_of(*part.bounds(self.end)) != -1:
            return None
        upper = self._part(body.always()).operand_beyond(self.end)
        for first, final in instants:
            begin = max(first, self._n)
            failing = np.flatnonzero(upper[min(begin - self._n, len(upper) - 1) :] < 0)
            if begin <= final and len(failing) and (sample := begin + int(failing[0])) <= final:
                key = upper[min(sample - self._n, len(upper) - 1)]
                return UnseenPlace(sample, number_of(int(key)))
        return None

    def _part(
        self, formula: Formula, *, standard: bool = False, everywhere: bool = True
    ) -> TraceBounds:
        program = self._compiled.part(formula, STANDARD if standard else None)
        return self._bounds_of(program, everywhere=everywhere)

    def _bounds_of(self, program: Program, *, everywhere: bool = False) -> TraceBounds:
        """Return the bounds of a program that reads some of the variables."""
        machines, n = BACKENDS[self._compiled.backend], self.n
        column = dict(zip(self._program.variables, zip(*self._columns, strict=True), strict=True))
        pairs = [column[name] for name in program.variables]
        lower = upper = [low[:n] for low, _ in pairs]
        if any(low is not high for low, high in pairs):
            upper = [high[:n] for _, high in pairs]
        reader = SampleReader(program, self._compiled.nan, bounds=True)
        return TraceBounds.of(program, reader, machines, (lower, upper), n, everywhere=everywhere)


class _SampleSigns:
    """The signs of a program on a trace, up to the last sample that matters.

    ``counted`` counts the failures without the bounds, if it can; all values are known then.
    """

    def __init__(
        self,
        part: Callable[[], TraceBounds],
        end: End,
        last: int,
        counted: Callable[[InstantRuns], Counted | None] | None = None,
    ) -> None:
        self._bounds, self._end, self._last, self._counted = part, end, last, counted

    @functools.cached_property
    def _part(self) -> TraceBounds:
        return self._bounds()

    @functools.cached_property
    def _fails(self) -> NDArray[np.bool_]:
        return self._part.fails(self._end)

    def fails_at(self, instants: InstantRuns) -> Counted:
        if self._counted is not None and (counted := self._counted(instants)) is not None:
            return counted
        length = occasions = 0
        first = None
        for begin, final in instants:  # no run touches the next
            flags = self._fails[begin : int(min(final, self._last)) + 1]
            count = int(np.count_nonzero(flags))
            if not count:
                continue
            if first is None:
                first = begin + int(flags.argmax())
            length += count
            occasions += int(np.count_nonzero(flags[1:] > flags[:-1])) + int(flags[0])
        return length, occasions, first

    def holds_at(self, instants: InstantRuns) -> bool:
        if instants[-1][1] > self._last:
            return False
        if self._counted is not None and (counted := self._counted(instants)) is not None:
            return not counted[0]
        holds = self._part.holds(self._end)
        return all(bool(holds[begin : int(final) + 1].all()) for begin, final in instants)


def is_short(program: Program, n: int) -> bool:
    """Return whether the episode machine takes a program, and is faster than columns."""
    unknowns = _unknowns(program)
    return unknowns is not None and n <= _MAX_SHORT >> unknowns


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def _unknowns(program: Program) -> int | None:
    """Return the unknowns of the episode machine; None if it does not take the program."""
    try:
        placement = place(program)
    except SpecificationError:
        return None
    fits = not program.neutral and episode_numbers(placement).total() <= _MAX_NUMBERS
    return len(placement.unknowns) if fits else None


_FIRST: Final = np.zeros(1, np.int64)


@functools.lru_cache(maxsize=512)  # many traces have one length
def _sample_runs(instants: InstantRuns, last: int) -> SampleRuns:
    """Return the recorded instants as runs for one trace."""
    pairs = np.array(recorded_runs(instants, last), np.int64).reshape(-1, 2)
    first, final = np.ascontiguousarray(pairs.T)
    return SampleRuns(np.array([0, len(pairs)], np.int64), first, final, _FIRST)


def recorded_runs(instants: InstantRuns, last: int) -> InstantRuns:
    """Return the instants of runs up to the last recorded one."""
    return tuple((first, min(final, last)) for first, final in instants if first <= last)


def counts_alone(program: Program) -> bool:
    """Return whether the sign of a program at a sample is known without later samples."""
    return program.latency == 0 and not program.neutral


def _first_decided(bounds: TraceBounds) -> int | None:
    """Return the first sample at which the open end is decided; None if it never is."""
    low, high = 0, 1  # undecided after low samples, or none; decided after high samples

    def decided(n: int) -> bool:
        return verdict_of(*bounds.until(n).bounds("open")) != 0

    if not decided(bounds.n):
        return None
    while high < bounds.n and not decided(high):
        low, high = high, 2 * high
    high = min(high, bounds.n)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if decided(middle) else (middle, high)
    return high - 1


class DenseTrace(_Trace[CompiledEvents]):
    """A trace in dense time."""

    step: ClassVar = 2

    def __init__(
        self,
        compiled: CompiledEvents,
        end: End,
        signals: Mapping[str, EventsLike],
        until: Until | None = None,
    ) -> None:
        super().__init__(compiled, end)
        self.tick = compiled.program.resolution
        self._regions, self._reader = compiled.program, compiled.reader()
        self._machines = BACKENDS[compiled.backend]
        self._events = self._reader.whole(signals)
        if until is not None:
            self._events = self._reader.held(self._events, until)
        machine = self._machines.dense_episode_machine(self._regions, self._reader)
        machine.run(self._events)
        self._decided = verdict_of(machine.lower, machine.upper) != 0
        self.complete = machine.complete()
        machine.finish(end)
        self.values = machine.robustness, machine.lower, machine.upper
        self._span = machine.span
        self.start = self._span[0]

    @property
    def last(self) -> int:
        """The position of the last tick."""
        return 2 * (self._span[1] - self._span[0])

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

    def opposite(self, left: Formula) -> DenseSigns:
        """Return the signs of the negation of a left side, by standard semantics."""
        regions, reader = self._part(~left, STANDARD)
        events = self._events_of(regions)
        return self._machines.dense_signs(regions, reader, events, self._span, self.end)

    def satisfied_without(self, answered: Sequence[Formula]) -> bool:
        """Return whether the verdict is SATISFIED with ``false`` as right sides of implications."""
        regions = self._compiled.part(unanswered(self.formula, answered), whole=True)
        machine = self._machines.dense_episode_machine(regions, self._reader.of(regions))
        machine.run(self._events_of(regions))
        machine.finish(self.end)
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
        reader = self._reader
        values = values_between(reader.counted(self._events), self._span)
        rows = rows_of(self._regions.program, values, reader, self._machines.term_ranges)
        outlook = DenseOutlook(self._regions.program, rows, self.last, self.end)
        program = outlook.program

        def reach(register: int) -> tuple[Node, int, int | None]:
            window = program.window(register)
            hi = None if window.endless else window.hi
            return program.sources[register], window.lo or 0, hi

        return TraceRegisters(program, outlook.undecided, reach)

    def segments(self, formula: Formula, *, standard: bool = False) -> Segments:
        """Return the values of a part of the formula, for left sides by standard semantics."""
        last = self.last
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
        last = self.last
        if self.end != "cut" or instants[-1][1] <= last:
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
        regions, reader = self._part(formula, STANDARD if standard else None)
        events = self._events_of(regions)
        return self._machines.dense_values(regions, reader, events, self._span, self.end, beyond)

    def _part(
        self, formula: Formula, interface: Interface | None = None
    ) -> tuple[RegionProgram, EventReader]:
        return _part(self._compiled, formula, interface, self._reader.unknown)

    def _events_of(self, regions: RegionProgram) -> list[Given]:
        """Return the events of the variables of another program."""
        events = dict(zip(self._regions.program.variables, self._events, strict=True))
        return [events[name] for name in regions.program.variables]


JudgedTrace = SampleTrace | DenseTrace


@functools.lru_cache(maxsize=512)  # many traces have the same parts
def _part(
    compiled: CompiledEvents,
    formula: Formula,
    interface: Interface | None,
    unknown: bool,  # noqa: FBT001 - a key of the cache
) -> tuple[RegionProgram, EventReader]:
    regions = compiled.part(formula, interface)
    reader = compiled._replace(program=regions).reader()
    reader.unknown = unknown
    return regions, reader.with_clock(BACKENDS[compiled.backend].clock(regions))


@functools.lru_cache(maxsize=512)
def _routes(compiled: Compiled | CompiledEvents) -> Routes:
    return Routes(compiled.specification.formula, compiled.bounds)


@functools.lru_cache(maxsize=512)  # many traces have one length
def formula_reads(
    compiled: Compiled | CompiledEvents, extent: TraceSpan
) -> Mapping[Formula, Reads]:
    """Return where a formula reads its implications on traces of one extent."""
    return _routes(compiled).reads(extent)


@functools.lru_cache(maxsize=512)  # many traces have one length
def _body_reads(
    compiled: Compiled | CompiledEvents, extent: TraceSpan
) -> Mapping[Formula, InstantRuns]:
    return body_reads(compiled.specification.formula, compiled.bounds, extent)


@functools.lru_cache(maxsize=512)
def opposite_program(compiled: Compiled, interface: Interface, left: Formula) -> Program:
    """Return the program of the negation of a formula, with the variables of a specification."""
    return compiled.part(~left, interface)


@functools.lru_cache(maxsize=512)
def reads_hidden(formula: Formula, interface: Interface) -> bool:
    """Return whether a left side has a predicate that counts 0 by the semantics of the verdict."""
    lefts = (implication.args[0].nodes() for implication in implications(formula))
    return any(
        interface.reading(node) == "zero"
        for nodes in lefts
        for node in nodes
        if node.op is not None and node.op.holds is not None
    )


def scaled(count: PlaceNumbers, tick: Fraction | None) -> NDArray[Any]:
    """Return whole numbers of ticks in seconds; unchanged without a tick."""
    if tick is None:
        return count
    if len(count) and abs(int(count.max())) * tick.numerator >= 2**53:
        return np.array([float(ticks * tick) for ticks in count.tolist()])
    return count * tick.numerator / np.float64(tick.denominator)
