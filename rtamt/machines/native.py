"""The machines in C++, from encoded programs."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

import rtamt._native as _native  # noqa: PLR0402 - `from` would hide which module is absent
from rtamt.errors import StateError
from rtamt.inputs.arrays import Floats
from rtamt.inputs.batch import BatchReader, Entries
from rtamt.inputs.clock import Clock, Ticks, Times
from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import Given
from rtamt.inputs.samples import SampleReader
from rtamt.machines.batch import BatchOutcomes, EntryColumn, VerdictLogFunctions, spread
from rtamt.machines.clocks import OperatorClock
from rtamt.machines.dense.episode import (
    PythonDenseEpisodeMachine,
    PythonDenseSigns,
    bound_worlds,
    everywhere,
)
from rtamt.machines.dense.episode import dense_values as python_dense_values
from rtamt.machines.dense.rows import declared_of
from rtamt.machines.dense.runs import Runs
from rtamt.machines.protocols import (
    DenseSigns,
    End,
    EpisodeBatch,
    EpisodeRun,
    EpisodeRuns,
    SampleRuns,
    TraceSet,
    World,
)
from rtamt.machines.terms import RefusesRanges
from rtamt.program.dense_lowering import DenseProgram, RegionProgram
from rtamt.program.encoding import (
    DiscreteRow,
    FormulaRow,
    clock_of,
    encoded_dense,
    encoded_discrete,
    encoded_episode,
    encoded_regions,
    encoded_terms,
)
from rtamt.program.placement import Placement, neutral_registers, place, variants_of
from rtamt.program.program import Program

read_only = _native.read_only
fold_pairs = _native.fold_pairs
find_runs = _native.negative_runs


def discrete_machine(
    program: Program, reader: SampleReader, observed: Sequence[int]
) -> _native.DiscreteMachine:
    late = [
        (register, program.latencies[register] or 0) for register in (program.result, *observed)
    ]
    return _native.DiscreteMachine(*encoded_discrete(program), late, reader)


def episode_machine(program: Program, reader: SampleReader) -> _native.EpisodeMachine:
    return _native.EpisodeMachine(*encoded_episode(program), reader, neutral_registers(program))


def episode_run(program: Program, columns: Sequence[Floats], n: int, end: End) -> EpisodeRun | None:
    """Judge a trace of known samples; None if a value or a term is nan."""
    run = _judging_machine(program).judge(columns, n, end)
    return None if run is None else EpisodeRun(*run)


def judge_traces(program: Program, traces: TraceSet, end: End, threads: int) -> EpisodeRuns:
    """Judge many traces of known samples in several threads, without the interpreter's lock."""
    terms, formulas, initial, streams, variables = encoded_episode(program)
    return EpisodeRuns(
        *_native.judge_traces(
            *(terms, formulas, initial, streams, len(variables), *traces, end, threads)
        )
    )


def count_failures(
    program: Program, traces: TraceSet, runs: SampleRuns, threads: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Count in each trace the samples of its runs at which a program without latency fails.

    Return the number of samples, -1 if a value or a term of the trace is nan, the number of starts,
    and the first sample or -1.
    """
    rows, terms, variables, result = encoded_discrete(program)
    ends, first, last, class_of = runs
    return _native.count_failures(
        *(rows, terms, len(variables), result, *traces, class_of, ends, first, last, threads)
    )


@functools.lru_cache(maxsize=64)  # programs are cached, and differ by identity
def _judging_machine(program: Program) -> _native.EpisodeMachine:
    """Return a machine that judges a trace of its own in each call."""
    return episode_machine(program, SampleReader(program))


def episode_monitor_set(
    machines: Sequence[Any],
    places: Sequence[Sequence[int]],
    reads: Sequence[Any],
    decided: Callable[[int], object] | None,
    seen: Callable[[list[float]], object] | None,
    number: type[float],
) -> _native.EpisodeMonitorSet | None:
    """Return the C++ set of machines; None if a machine is not in C++."""
    if not all(isinstance(machine, _native.EpisodeMachine) for machine in machines):
        return None
    return _native.EpisodeMonitorSet(machines, places, reads, decided, seen, number)


def dense_machine(
    program: DenseProgram, reader: EventReader, observed: Sequence[int]
) -> _native.DenseMachine:
    declared = declared_of(program.program).before
    return _native.DenseMachine(*encoded_dense(program), declared, observed, reader)


def _regions(placement: Placement) -> _native.DenseRegions:
    return _native.DenseRegions(*encoded_regions(placement))


class NativeClock(Clock):
    """Counts the frequent times in C++."""

    __slots__ = ("_encoded",)

    def __init__(self, dense: DenseProgram) -> None:
        super().__init__(dense)
        self._encoded = clock_of(self.tick)

    def nearest_ones(self, times: Times, name: str) -> Ticks:
        ticks = _native.ticks(self._encoded, times)
        return super().nearest_ones(times, name) if ticks is None else ticks


def dense_episode_on_regions(
    program: RegionProgram, reader: EventReader
) -> PythonDenseEpisodeMachine:
    """Return the machine in Python on registers in C++."""
    counting = reader.with_clock(NativeClock(program))
    return PythonDenseEpisodeMachine(program, counting, _regions, term_ranges)


def dense_episode_machine(
    program: RegionProgram, reader: EventReader
) -> _native.DenseEpisodeMachine | PythonDenseEpisodeMachine:
    if reader.unknown:  # the machine in C++ takes numbers
        return dense_episode_on_regions(program, reader)
    readings = [
        (encoded_terms(variant), encoded_regions(place(variant)))
        for variant in variants_of(program.program)
    ]
    variables, clock = program.program.variables, clock_of(program.tick)
    declared = declared_of(program.program).before
    return _native.DenseEpisodeMachine(readings, variables, clock, declared, program.reach, reader)


def dense_signs(
    program: RegionProgram,
    reader: EventReader,
    given: Sequence[Given],
    trace: tuple[int, int],
    end: End,
) -> DenseSigns:
    if reader.unknown:  # the machine in C++ takes numbers
        return PythonDenseSigns(program, reader, given, trace, end, term_ranges)
    return _native.DenseSigns(*_encoded_signs(program), reader, given, *trace, end)


def dense_values(
    program: RegionProgram,
    reader: EventReader,
    given: Sequence[Given],
    trace: tuple[int, int],
    end: End,
    beyond: bool = False,  # noqa: FBT001, FBT002 - as in Python
) -> tuple[Runs, Runs, Runs]:
    def in_python() -> tuple[Runs, Runs, Runs]:
        return python_dense_values(program, reader, given, trace, end, beyond, term_ranges)

    if reader.unknown or not _has_one_variant(program):  # in C++ a place has one value
        return in_python()
    encoded = _encoded_signs(program)
    try:
        machine = _native.DenseSigns(*encoded, reader, given, *trace, end, numbers=True)
    except ValueError:  # a term is not a number
        return in_python()

    def result(world: World) -> Runs:
        starts, values = machine.result(world)
        return Runs(starts, (values,))

    low, high = bound_worlds(program.program, end, beyond=beyond)
    now = result(World.NOW)
    return (now, now, now) if low == high else (now, result(low), result(high))


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def _has_one_variant(program: RegionProgram) -> bool:
    return len(variants_of(program.program)) == 1


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def _encoded_signs(
    program: RegionProgram,
) -> tuple[tuple[DiscreteRow, ...], tuple[FormulaRow, ...], int, tuple[float, int, int]]:
    (known,) = variants_of(program.program)
    rows, clock = encoded_regions(everywhere(known)).rows, clock_of(program.tick)
    return encoded_terms(known), rows, known.result, clock


def discrete_batch(program: Program, num: int, reader: BatchReader) -> _native.DiscreteBatch:
    return _native.DiscreteBatch(*encoded_discrete(program), program.latency or 0, num, reader)


def episode_batch(program: Program, num: int, reader: BatchReader) -> _native.EpisodeBatch:
    return _native.EpisodeBatch(*encoded_episode(program), num, reader, neutral_registers(program))


def clock_batch(clocks: Sequence[OperatorClock], parts: int, num: int) -> _native.ClockBatch:
    return _native.ClockBatch(clocks, parts, num)


def term_ranges(
    program: Program,
    reader: RefusesRanges,
    observed: Sequence[int],
    lower: Sequence[Floats],
    upper: Sequence[Floats],
    n: int,
) -> tuple[list[Floats], list[Floats]]:
    rows, variables = encoded_terms(program), len(program.variables)
    return _native.term_ranges(rows, variables, observed, reader, lower, upper, n)


def _feed(
    batches: Sequence[EpisodeBatch],
    columns: Sequence[tuple[int, ...]],
    table: Floats,
    mask: Entries | None,
) -> None:
    while (fed := _native.feed_batches(batches, tuple(columns), table, mask)) < len(batches):
        # It reads rare forms of samples, or refuses them.
        batches[fed].update(table[:, list(columns[fed])], mask)
        batches, columns = batches[fed + 1 :], columns[fed + 1 :]
        if not batches:
            return


def _finish(batches: Sequence[EpisodeBatch], mask: Entries | None, end: End) -> None:
    if not _native.finish_batches(batches, mask, end):
        batches[0].finish(mask, end)  # refuses


def _forget(
    mask: Entries | None,
    settled_at: NDArray[np.int64],
    violated: Entries,
    failed: Entries,
    first: NDArray[np.int64],
    violated_at: NDArray[np.int64],
) -> None:
    specs, num = settled_at.shape
    _native.forget_verdicts(mask, specs, num, settled_at, violated, failed, first, violated_at)


def _outcomes(
    batches: Sequence[EpisodeBatch],
    entries: NDArray[np.int64],
    failed: Entries,
    settled_at: NDArray[np.int64],
) -> BatchOutcomes:
    return BatchOutcomes(*_native.outcomes_of_batches(batches, entries, failed, settled_at))


def _spread(columns: list[EntryColumn], entries: NDArray[np.int64], num: int) -> None:
    while (done := _native.spread_entries(columns, entries, num)) < len(columns):
        spread(columns[done : done + 1], entries, num)  # of another dtype or layout
        columns = columns[done + 1 :]


VERDICT_LOGS = VerdictLogFunctions(
    _feed,
    _native.least_of_batches,
    _finish,
    _native.note_verdicts,
    _forget,
    _outcomes,
    _spread,
    _native.reset_batches,
)


def are_own(batches: Sequence[EpisodeBatch]) -> bool:
    """Return whether these functions can read the batches."""
    return set(map(type, batches)) == {_native.EpisodeBatch}


def refuse_running() -> NoReturn:
    """Raise the error of a call on a machine that runs in another thread."""
    msg = (
        "the monitor is running in another thread; wait until that call returns, "
        "or make a monitor for each thread"
    )
    raise StateError(msg)
