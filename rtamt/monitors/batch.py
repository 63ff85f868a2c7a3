"""Many traces of one specification, judged in one call of a machine."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.arrays import Floats
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import Formula
from rtamt.machines.backend import BACKENDS
from rtamt.machines.bounds import needed_samples
from rtamt.machines.offline import result_alone
from rtamt.machines.protocols import End, EpisodeRuns, SampleRuns, TraceSet
from rtamt.machines.state import verdicts_of
from rtamt.monitors.judgement import Judgement, judge_compiled
from rtamt.monitors.judgements import TriggerColumns
from rtamt.monitors.options import Compiled
from rtamt.monitors.sample_trace import (
    counts_alone,
    formula_reads,
    is_short,
    opposite_program,
    recorded_runs,
)
from rtamt.monitors.triggers import reads_hidden, text_of, texts_of
from rtamt.program.implications import InstantRuns, TraceSpan, implications, unanswered
from rtamt.program.interface import STANDARD
from rtamt.program.memory import limit_beyond
from rtamt.program.program import Program

Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


class JudgedRows(NamedTuple):
    """The judgements of many traces; `rtamt.monitors.Judgements` describes the numbers.

    A trace that is left out has no row, and is to be judged alone.
    """

    robustness: Floats
    lower: Floats
    upper: Floats
    complete: NDArray[np.int8]
    decided_at: Integers
    vacuous: Booleans
    triggers: tuple[TriggerColumns, ...]
    left_out: Booleans

    @classmethod
    def empty(cls, count: int, texts: Sequence[str]) -> JudgedRows:
        """Return rows without judgements."""
        robustness, lower, upper = (np.full(count, np.nan) for _ in range(3))
        triggers = [
            TriggerColumns(
                *(text, np.zeros(count, np.int64), np.zeros(count, np.int64)),
                *(np.full(count, -1, np.int64), np.zeros(count, bool)),
            )
            for text in texts
        ]
        return cls(
            *(robustness, lower, upper, np.zeros(count, np.int8), np.full(count, -1, np.int64)),
            *(np.zeros(count, bool), tuple(triggers), np.ones(count, bool)),
        )

    def place(self, places: NDArray[np.intp], rows: JudgedRows) -> None:
        """Write other rows to some places."""
        for mine, its in zip(self._arrays(), rows._arrays(), strict=True):
            mine[places] = its

    def put(self, place: int, judged: Judgement) -> None:
        """Write the judgement of a trace that was judged alone."""
        decided = judged.decided_at
        numbers: list[float] = [
            *(judged.robustness, judged.lower, judged.upper, judged.complete),
            *(-1 if decided is None else decided, judged.vacuous),
        ]
        for part in judged.triggers:
            first = -1 if part.first is None else part.first
            numbers += [part.samples, part.count, first, part.vacuous]
        for array, number in zip(self._arrays(), (*numbers, False), strict=True):
            array[place] = number

    def _arrays(self) -> list[NDArray[Any]]:
        parts = [a for t in self.triggers for a in (t.samples, t.count, t.first, t.vacuous)]
        return [*self[:6], *parts, self.left_out]


class TraceBatch:
    """A specification for many traces of samples, with a reader of them."""

    def __init__(self, compiled: Compiled, end: End, threads: int) -> None:
        self.compiled, self._end, self._threads = compiled, end, threads
        self.formula = compiled.specification.formula
        self.reader = SampleReader(compiled.program, compiled.nan, bounds=True)
        self._hides = reads_hidden(self.formula, compiled.interface)
        self._functions = BACKENDS[compiled.backend].trace_runs

    @functools.cached_property
    def fast(self) -> bool:
        """Whether the machine judges many traces; otherwise, each is judged alone."""
        return self._functions is not None and all(map(counts_alone, self._lefts))

    @functools.cached_property
    def _lefts(self) -> list[Program]:
        """The negations of the left sides of the implications."""
        compiled = self.compiled
        interface = STANDARD if self._hides else compiled.interface
        # Named formulas would be in the program too, and may need the whole future.
        return [
            result_alone(opposite_program(compiled, interface, implication.args[0]))
            for implication in implications(self.formula)
        ]

    def judge(self, traces: TraceSet) -> JudgedRows:
        """Judge traces of known values.

        Traces with a nan, and traces that are too long for the machine, are left out.
        """
        program = self.compiled.program
        rows = JudgedRows.empty(len(traces.lengths), texts_of(self.formula))
        if not len(traces.lengths):
            return rows
        limit_beyond(program, int(traces.lengths.min()))
        if not self.fast or self._functions is None:
            return rows
        places = np.flatnonzero(self._short(program, traces.lengths))
        if not len(places):
            return rows
        runs = self._functions.judge(program, traces.select(places), self._end, self._threads)
        if runs.refused.any():
            places = places[~runs.refused]
            runs = EpisodeRuns(*(array[~runs.refused] for array in runs))  # type: ignore[arg-type]
        satisfied = verdicts_of(runs.lower, runs.upper) == 1
        triggers, vacuous = self._triggers(traces.select(places), satisfied)
        left_out = np.zeros(len(places), bool)
        for row in triggers:
            left_out |= row.samples < 0
        complete = verdicts_of(runs.complete, runs.complete)
        judged = JudgedRows(
            *(runs.robustness, runs.lower, runs.upper, complete, runs.decided_at),
            *(vacuous, tuple(triggers), left_out),
        )
        rows.place(places, judged)
        return rows

    def judge_alone(self, trace: TraceColumns) -> Judgement:
        """Judge a trace of any values, as `judge` does."""
        return judge_compiled(self.compiled, self._end, trace, None)

    def _short(self, program: Program, lengths: Integers) -> Booleans:
        """Return which traces the machine judges faster than columns."""
        return _by_length(lengths, lambda n: n > 0 and is_short(program, n)).astype(bool)

    def _triggers(
        self, traces: TraceSet, satisfied: Booleans
    ) -> tuple[list[TriggerColumns], Booleans]:
        """Return the triggers of each implication, and the vacuity of all together.

        It is `rtamt.monitors.implications.evidence_of` for many traces.
        """
        counted = implications(self.formula)
        none = np.zeros(len(satisfied), bool)
        if not counted or not len(satisfied):
            return [*JudgedRows.empty(0, texts_of(self.formula)).triggers], none
        extents, class_of = self._extents(traces.lengths)
        reads = [formula_reads(self.compiled, extent) for extent in extents]
        rows: list[TriggerColumns] = []
        redundant = ~none
        for implication, program in zip(counted, self._lefts, strict=True):
            every = [known[implication].all for known in reads]
            needed = [known[implication].needed for known in reads]
            seen = [recorded_runs(runs, x.last) for runs, x in zip(every, extents, strict=True)]
            counts = self._count(program, traces, seen, class_of)
            row = TriggerColumns(text_of(implication), *counts, satisfied.copy())
            vacuous, known = row.vacuous, np.array([bool(runs) for runs in every])[class_of]
            # An instant beyond the trace may be read, and nothing is known of it.
            within = np.array(
                [not e or e[-1][1] <= x.last for e, x in zip(every, extents, strict=True)]
            )[class_of]
            idle = ~known | ((row.count == 0) & within & (not self._hides))
            redundant &= idle
            answers = row.samples.copy()
            differ = np.array([a != b for a, b in zip(every, needed, strict=True)])[class_of]
            if (others := np.flatnonzero(differ & satisfied)).size:
                part = traces.select(others)
                seen = [
                    recorded_runs(runs, x.last) for runs, x in zip(needed, extents, strict=True)
                ]
                answers[others] = self._count(program, part, seen, class_of[others])[0]
            vacuous &= answers == 0
            self._check_without((implication,), traces, vacuous, vacuous & ~idle)
            rows.append(row)
        vacuous = satisfied & np.logical_and.reduce([row.vacuous for row in rows])
        if len(rows) > 1:
            self._check_without(counted, traces, vacuous, vacuous & ~redundant)
        return rows, vacuous

    def _check_without(
        self,
        answered: Sequence[Formula],
        traces: TraceSet,
        vacuous: Booleans,
        unsure: Booleans,
    ) -> None:
        """Set the vacuity of unsure traces: the verdict with false right sides is SATISFIED."""
        chosen = np.flatnonzero(unsure)
        if not chosen.size:
            return
        program = self.compiled.part(unanswered(self.formula, answered))
        assert self._functions is not None  # noqa: S101 - fast
        # The machine takes every program that is smaller than one that it took.
        part = self._for(program, traces.select(chosen))
        runs = self._functions.judge(program, part, self._end, self._threads)
        vacuous[chosen] = verdicts_of(runs.lower, runs.upper) == 1

    def _for(self, program: Program, traces: TraceSet) -> TraceSet:
        """Return the traces with the columns that another program reads."""
        places = [self.compiled.program.variables.index(name) for name in program.variables]
        return traces._replace(columns=[traces.columns[position] for position in places])

    def _count(
        self,
        program: Program,
        traces: TraceSet,
        instants: Sequence[InstantRuns],
        class_of: Integers,
    ) -> tuple[Integers, Integers, Integers]:
        assert self._functions is not None  # noqa: S101 - fast
        ends = np.cumsum([0, *map(len, instants)])
        pairs = [run for runs in instants for run in runs]
        first, last = np.array(pairs, np.int64).reshape(-1, 2).T
        runs = SampleRuns(
            ends.astype(np.int64), np.ascontiguousarray(first), np.ascontiguousarray(last), class_of
        )
        return self._functions.count_failures(
            program, self._for(program, traces), runs, self._threads
        )

    def _extents(self, lengths: Integers) -> tuple[list[TraceSpan], Integers]:
        """Return the extents of all lengths, and the number of each trace's extent."""
        program, end = self.compiled.program, self._end
        known, class_of = np.unique(lengths, return_inverse=True)
        extents = []
        for n in known.tolist():
            last = needed_samples(program, n) - 1
            extents.append(TraceSpan(last, end == "complete", end == "cut"))
        return extents, class_of.astype(np.int64)


def _by_length(lengths: Integers, function: Callable[[int], bool]) -> NDArray[np.bool_]:
    known, class_of = np.unique(lengths, return_inverse=True)
    return np.array([function(n) for n in known.tolist()], bool)[class_of]
