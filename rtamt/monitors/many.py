"""`judge_many`: the verdicts on many recorded traces in one call.

`TraceBatch` judges traces together in the machine; `judge_many` splits its data into traces, and
judges traces that the machine cannot judge one by one.
"""

from __future__ import annotations

import functools
import itertools
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any, Final, Literal, NamedTuple, Unpack, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError, InputTypeError, RtamtError, alternatives, brief, is_one_of
from rtamt.inputs.arrays import Floats, kind_of
from rtamt.inputs.frames import named_columns, warn_of_times
from rtamt.inputs.groups import (
    Groups,
    TraceRows,
    groups_of,
    periods_of,
    refusals,
    seconds_of,
    table_of,
)
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import Formula
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification
from rtamt.machines.backend import BACKENDS
from rtamt.machines.bounds import needed_samples
from rtamt.machines.offline import result_alone
from rtamt.machines.protocols import End, EpisodeRuns, SampleRuns, TraceSet
from rtamt.machines.state import verdicts_of
from rtamt.monitors.evaluation import trace_between
from rtamt.monitors.evidence import text_of, texts_of
from rtamt.monitors.judgement import Judgement, judge_compiled
from rtamt.monitors.judgements import JudgedRows, Judgements, TriggerColumns
from rtamt.monitors.options import (
    Compiled,
    SampleOptions,
    Spec,
    checked_end,
    compiled,
    listed_in_signature,
)
from rtamt.monitors.traces import (
    counts_alone,
    formula_reads,
    is_short,
    opposite_program,
    reads_hidden,
    recorded_runs,
)
from rtamt.program.implications import InstantRuns, TraceSpan, implications, unanswered
from rtamt.program.interface import STANDARD
from rtamt.program.memory import limit_beyond
from rtamt.program.program import Program
from rtamt.program.timing import Period

Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


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
        known, class_of = np.unique(lengths, return_inverse=True)
        short = np.array([n > 0 and is_short(program, n) for n in known.tolist()], bool)
        return short[class_of]

    def _triggers(
        self, traces: TraceSet, satisfied: Booleans
    ) -> tuple[list[TriggerColumns], Booleans]:
        """Return the triggers of each implication, and the vacuity of all together.

        It is `rtamt.monitors.judgement.evidence_of` for many traces.
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
            # The formula may read an instant after the trace, which is unknown.
            within = np.array(
                [not e or e[-1][1] <= x.last for e, x in zip(every, extents, strict=True)]
            )[class_of]
            irrelevant = ~known | ((row.count == 0) & within & (not self._hides))
            redundant &= irrelevant
            answers = row.samples.copy()
            differ = np.array([a != b for a, b in zip(every, needed, strict=True)])[class_of]
            if (others := np.flatnonzero(differ & satisfied)).size:
                part = traces.select(others)
                seen = [
                    recorded_runs(runs, x.last) for runs, x in zip(needed, extents, strict=True)
                ]
                answers[others] = self._count(program, part, seen, class_of[others])[0]
            vacuous &= answers == 0
            self._check_without((implication,), traces, vacuous, vacuous & ~irrelevant)
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
        # The machine takes this program, because it took a larger one.
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


Errors = Literal["raise", "keep"]

_CHUNK: Final = 1 << 22
"""The number of values of an iterator that are judged together."""


@listed_in_signature(SampleOptions)
def judge_many(
    spec: Spec,
    traces: Iterable[TraceColumns] | TraceColumns,
    period: Period | None = None,
    end: End = "cut",
    *,
    lengths: ArrayLike | None = None,
    by: str | Sequence[str] | None = None,
    time: str | None = None,
    errors: Errors = "raise",
    threads: int | None = None,
    **options: Unpack[SampleOptions],
) -> Judgements:
    """Return the verdicts on many recorded traces of unequal length, as `judge` gives for each.

    The specification is compiled once, and all cores judge traces of up to 8,192 samples in C++;
    longer traces, and traces with missing values, are judged one by one. Implications whose left
    side looks ahead, and the Python back-end, are as slow as calls of `judge`.

    Args:
        spec: Text, a formula, or a parsed specification.
        traces: The traces, in one of three forms: an iterable of traces as for `judge`, read in
            chunks; with ``lengths``, the values of all traces one after another, as a mapping of
            names to 1-D arrays or an array of shape (samples, variables); with ``by``, a data frame
            or a mapping of columns, whose rows belong to several objects.
        period: As for `judge`, the same for all traces.
        end: As for `judge`.
        lengths: The number of samples of each trace; their sum is the length of the columns.
        by: The column, or the columns, that identify a trace. The rows of a trace need not be next
            to each other, and stay in order. Groups come in the order of their first rows.
        time: The column of times, in seconds or in the unit of its name, or of dates; only with
            ``by``. In each group they must increase, and their distance is the period of the
            group, so that a formula with bounds needs two rows. Default: ``period`` counts.
        errors: ``"raise"`` stops at the first trace that cannot be judged; ``"keep"`` collects
            these errors in the result.
        threads: The number of threads. Default: the number of cores that this process may use.
        **options: As for `judge`.

    Raises:
        SpecificationError: As for `judge`.
        InputError: As for `judge`, with the number of the trace or the name of the group; and on
            lengths that do not fit.
        InputTypeError: As for `judge`, and on a single trace in place of several.

    Example:
        >>> import rtamt
        >>> rows = {
        ...     "car": ["a", "a", "b", "a", "b", "c"],
        ...     "speed": [3, 9, 4, 2, 5, 11],
        ... }
        >>> result = rtamt.judge_many("always(speed < 8)", rows, by="car")
        >>> result
        <Judgements of 3 traces: 2 violated, 1 satisfied, 0 undecided, 0 errors, end='cut'>
        >>> for car, verdict, margin in zip(
        ...     result.keys["car"], result.verdict, result.robustness, strict=True
        ... ):
        ...     print(car, rtamt.Verdict(verdict).name, margin)
        a VIOLATED -1.0
        b SATISFIED 3.0
        c VIOLATED -3.0
        >>> columns = {"speed": [3.0, 9.0, 2.0, 4.0, 5.0, 11.0]}
        >>> rtamt.judge_many("always(speed < 8)", columns, lengths=[3, 2, 1]).verdict.tolist()
        [-1, 1, -1]
        >>> runs = ({"speed": [speed, 2 * speed]} for speed in range(2, 6))
        >>> rtamt.judge_many("always(speed < 8)", runs).robustness.tolist()
        [4.0, 2.0, -0.0, -2.0]
    """
    mode = checked_end(end)
    if not is_one_of(errors, get_args(Errors)):
        raise InputError(f"expected errors={alternatives(get_args(Errors))}, got {brief(errors)}")
    if by is None and time is not None:
        raise InputError("expected by=, the columns that identify a trace, with time=; got none")
    if time is not None and period is not None:
        raise InputError("expected time= or period=, got both; the times give the period")
    if by is not None and lengths is not None:
        raise InputError("expected by= or lengths=, got both; each defines the ends of traces")
    count = _thread_count(threads)

    def batch(seconds: Period | None) -> TraceBatch:
        program = compiled(judge_many, spec, seconds, options, online=False)
        return TraceBatch(program, mode, count)

    if by is not None and time is not None:
        work = _Work(as_specification(spec), mode, errors)
        return work.of_timed_table(traces, _names(by), time, batch)
    same = batch(period)
    work = _Work(same.compiled.specification, mode, errors)
    if by is not None:
        return work.of_table(traces, _names(by), same)
    if lengths is not None:
        return work.of_ragged(cast("TraceColumns", traces), lengths, same)
    return work.of_traces(traces, same)


class _Part(NamedTuple):
    """Some of the traces: their numbers, their lengths and their judgements."""

    places: NDArray[np.intp]
    samples: NDArray[np.int64]
    rows: JudgedRows


class _Work:
    """A call of `judge_many`: the options, and the rows so far."""

    def __init__(self, specification: Specification, end: End, errors: Errors) -> None:
        self._specification, self._end, self._keep = specification, end, errors == "keep"
        self._texts = texts_of(specification.formula)
        self._groups: Groups | None = None  # of joined traces
        self._parts: list[_Part] = []
        self._errors: dict[int, RtamtError] = {}
        self._done = 0

    def of_traces(self, traces: object, batch: TraceBatch) -> Judgements:
        """Judge the traces of an iterable."""
        if (
            isinstance(traces, Mapping | str)
            or named_columns(traces) is not traces
            or (hasattr(traces, "keys") or not isinstance(traces, Iterable))
        ):
            raise InputTypeError(
                f"expected an iterable of traces, got {kind_of(traces)}; pass by= for a table of "
                "several objects, lengths= for joined traces, or call judge for one trace"
            )
        chunk: list[TraceColumns] = []
        values = 0
        for trace in cast("Iterable[TraceColumns]", traces):
            chunk.append(trace)
            values += _size(trace)
            if values >= _CHUNK:
                self._judge_chunk(chunk, batch)
                chunk, values = [], 0
        if chunk:
            self._judge_chunk(chunk, batch)
        return self._result()

    def _judge_chunk(self, chunk: list[TraceColumns], batch: TraceBatch) -> None:
        period = batch.compiled.period
        columns: list[list[Floats]] = []
        lengths = np.zeros(len(chunk), np.int64)
        for i, trace in enumerate(chunk):
            # Traces with errors or unknown values are judged alone.
            try:
                lower, upper, n = trace_between(batch.reader, trace, None, period)
            except RtamtError:
                continue
            if upper is lower:
                lengths[i] = n
                columns.append(lower)
        joined = [np.concatenate(parts) for parts in zip(*columns, strict=True)]
        begins = np.cumsum(lengths) - lengths
        places = np.arange(len(chunk)) + self._done
        self._take(batch, TraceSet(joined, begins, lengths), places, chunk.__getitem__, {})

    def of_ragged(self, data: TraceColumns, lengths: ArrayLike, batch: TraceBatch) -> Judgements:
        """Judge traces that are joined."""
        sizes = np.asarray(lengths)
        if sizes.ndim != 1 or (sizes.size and sizes.dtype.kind not in "iu"):
            raise InputError(
                f"expected a whole number of samples per trace as lengths=, got {kind_of(lengths)}"
            )
        if not sizes.size:
            return self._result()
        if sizes.min() < 0:
            raise InputError(f"expected lengths of 0 or more, got {sizes.min()}")
        sizes = sizes.astype(np.int64)
        total = int(sizes.sum())
        columns, count = _columns(data, total, batch)
        if count != total:
            raise InputError(
                f"expected lengths with the sum {count}, the samples of the columns, got {total}"
            )
        self._groups = Groups({}, None, np.cumsum(sizes) - sizes, sizes)
        self._take_joined(batch, data, columns, np.arange(len(sizes)))
        return self._result()

    def of_table(self, data: object, by: Sequence[str], batch: TraceBatch) -> Judgements:
        """Judge the groups of a table, at one period."""
        table = table_of(data)
        self._groups = groups = groups_of(table, by)
        if len(groups.lengths):
            columns = _grouped_columns(table, groups, batch)
            self._take_joined(batch, data, columns, np.arange(len(groups.lengths)))
        return self._result()

    def of_timed_table(
        self,
        data: object,
        by: Sequence[str],
        time: str,
        batch_of: Callable[[Fraction | None], TraceBatch],
    ) -> Judgements:
        """Judge the groups of a table, each at the period of its times."""
        table = table_of(data)
        self._groups = groups = groups_of(table, by)
        if not len(groups.lengths):
            return self._result()
        times = seconds_of(table, time)
        times = times if groups.order is None else times[groups.order]
        periods = periods_of(times, groups, even=self._specification.timed)
        same: dict[object, list[int]] = {}
        for position, period in enumerate(periods):
            same.setdefault(period, []).append(position)
        inputs: list[Floats] | None = None
        for known, places in same.items():
            try:
                batch = self._batch_at(known, batch_of)
            except RtamtError as error:
                for position in places:
                    self._fail(position, error)
                continue
            reader = batch.reader
            if inputs is None:
                inputs = _grouped_columns(table, groups, batch)[: len(reader.variables)]
            columns = [*inputs, *reader.rates.of_columns(inputs)]
            self._take_joined(batch, data, columns, np.array(places), timed=False)
        return self._result()

    def _batch_at(
        self, period: object, batch_of: Callable[[Fraction | None], TraceBatch]
    ) -> TraceBatch:
        """Return the batch at a period; raise the error of the times, or of its bounds."""
        if isinstance(period, RtamtError):
            raise period
        if period is None and self._specification.timed:
            raise InputError(
                "expected two rows or more to read the period from their times, got 1; pass "
                "period= in place of time="
            )
        return batch_of(cast("Fraction | None", period))

    def _take_joined(
        self,
        batch: TraceBatch,
        data: object,
        columns: Sequence[Floats],
        places: NDArray[np.intp],
        *,
        timed: bool = True,
    ) -> None:
        """Judge some of the groups of ``data``, whose values are in columns in their order.

        A group whose rows in a frame are not one trace, or have times that are ignored, is refused.
        """
        assert self._groups is not None  # noqa: S101 - joined traces have groups
        traces = TraceSet(columns, self._groups.begins, self._groups.lengths).select(places)
        rows = TraceRows(self._groups.order, traces.begins, traces.lengths)
        reader, stated = batch.reader, batch.compiled.period is not None
        timed = timed and self._specification.timed
        errors = refusals(data, reader.variables, rows, timed=timed and not stated)
        if timed and stated:
            warn_of_times(data, reader.variables, reader.program.seconds, rows.steps)
        refused = dict(errors if self._keep else itertools.islice(errors, 1))
        names = batch.reader.variables

        def trace(i: int) -> TraceColumns:
            begin, n = int(traces.begins[i]), int(traces.lengths[i])
            if not names:
                return np.zeros((n, 0))
            columns = zip(names, traces.columns, strict=False)  # rates follow
            return {name: column[begin : begin + n] for name, column in columns}

        for rate in traces.columns[len(names) :]:
            rate[traces.begins[traces.lengths > 0]] = 0.0  # no sample before it
        self._take(batch, traces, places, trace, refused)

    def _take(
        self,
        batch: TraceBatch,
        traces: TraceSet,
        places: NDArray[np.intp],
        trace: Callable[[int], TraceColumns],
        refused: Mapping[int, InputError],
    ) -> None:
        """Judge traces together, and those that are left out one by one."""
        rows = batch.judge(traces)
        places_refused = np.array([*refused], np.intp)
        rows.place(places_refused, JudgedRows.empty(len(refused), self._texts))
        for i in np.flatnonzero(rows.left_out).tolist():
            if i in refused:
                self._fail(int(places[i]), refused[i])
                continue
            try:
                rows.put(i, batch.judge_alone(trace(i)))
            except RtamtError as error:
                self._fail(int(places[i]), error)
        self._parts.append(_Part(places, traces.lengths, rows))
        self._done += len(places)

    def _fail(self, place: int, error: RtamtError) -> None:
        """Store the error of a trace, or raise it with the name of the trace."""
        if not self._keep:
            keys = {} if self._groups is None else self._groups.keys
            group = ", ".join(f"{name}={values[place]}" for name, values in keys.items())
            raise error.at(f"group {group}" if group else f"trace {place}") from None
        self._errors[place] = error

    def _result(self) -> Judgements:
        """Return the columns of all traces."""
        groups = self._groups
        keys = {} if groups is None else groups.keys
        count = self._done if groups is None else len(groups.lengths)
        rows = JudgedRows.empty(count, self._texts)
        samples = np.zeros(count, np.int64) if groups is None else groups.lengths
        for part in self._parts:
            samples[part.places] = part.samples
            rows.place(part.places, part.rows)
        verdict = verdicts_of(rows.lower, rows.upper)
        verdict[[*self._errors]] = 0
        return Judgements(
            *(keys, samples, verdict, rows.robustness, rows.lower, rows.upper, rows.decided_at),
            rows.complete,
            *(rows.triggers, rows.vacuous),
            dict(sorted(self._errors.items())),
            self._end,
            text_of(self._specification.formula),
        )


def _size(trace: object) -> int:
    """Return the approximate number of values of a trace, for the size of a chunk."""
    if isinstance(trace, Mapping):
        return sum(len(c) if hasattr(c, "__len__") else 1 for c in trace.values())
    return int(getattr(trace, "size", 0)) or 1000


def _columns(data: TraceColumns, total: int, batch: TraceBatch) -> tuple[list[Floats], int]:
    """Return the columns of joined traces, and their length."""
    n = None if batch.reader.variables else total
    return batch.reader.columns(data, n=n, extra=True)


def _grouped_columns(table: Mapping[str, Any], groups: Groups, batch: TraceBatch) -> list[Floats]:
    """Return the columns of a table in the order of its groups."""
    total = int(groups.lengths.sum())
    columns, rows = _columns(table, total, batch)
    if rows != total:
        raise InputError(f"expected columns of the {total} rows of the keys, got {rows}")
    if groups.order is None:
        return columns
    inputs = [column[groups.order] for column in columns[: len(batch.reader.variables)]]
    return inputs + batch.reader.rates.of_columns(inputs)


def _names(by: str | Sequence[str]) -> list[str]:
    names = [by] if isinstance(by, str) else [*by]
    if not names or len({*names}) < len(names):
        raise InputError(f"expected different columns as by=, got {brief(by)}")
    return names


def _thread_count(threads: object) -> int:
    """Return the number of threads; None means the cores that this process may use."""
    if threads is None:
        affinity = getattr(os, "sched_getaffinity", None)
        return (os.cpu_count() or 1) if affinity is None else len(affinity(0))
    if isinstance(threads, bool) or not isinstance(threads, int | np.integer) or threads < 1:
        raise InputError(f"expected a positive number of threads, got {brief(threads)}")
    return int(threads)
