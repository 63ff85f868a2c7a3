"""Judges recorded traces one after the other or in processes; each trace by itself."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Final, Protocol, TypeVar

import rtamt
from rtamt import InputError, SpecificationError, Verdict
from rtamt.errors import shown
from rtamt.internal import explain_dense_verdict, explain_verdict
from rtamt.typing import End
from rtamt_gym.commands.collection import without_collection
from rtamt_gym.commands.judged import Judged, failure_of
from rtamt_gym.commands.traces import TracesAsked, read_trace_of
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded import judge
from rtamt_gym.recorded.judge import TraceJudgement
from rtamt_gym.recorded.parts import split_name
from rtamt_gym.recorded.progress import progress, silence
from rtamt_gym.recorded.trace import EventTrace, Trace, outside_ranges
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.outcome import Failure, Outcome
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import number, shorten

_T = TypeVar("_T")


Seen = Mapping[str, Sequence[int]]
"""The observations on a trace: numbers by requirement."""


class Watch(Protocol):
    """Observes traces while they are read, with a copy in each process."""

    @property
    def ready(self) -> bool:
        """Whether copies are complete; until then, only this object observes traces."""

    def see(self, judged: Judged, row: Trial) -> Seen:
        """Return observations on a trace; copies see some traces only, in order."""

    def take(self, row: Trial, observed: Seen) -> None:
        """Record the observations on a trace, in the order of the traces."""


def judge_file(request: TracesAsked, path: str, *, formulas: bool) -> Judged:
    """Judge a trace; errors are failures of the requirements."""
    judged = Judged(path)
    specs = _read(request, judged)
    with progress("judging", len(specs), " requirements") as advance:
        for name, spec in specs.items():
            try:
                reading = request.reading.about(name)
                judged.judgements[name] = _judge(spec, judged, reading, formulas=formulas)
            except Exception as error:  # noqa: BLE001 - the others are to be judged
                judged.failures[name] = failure_of(error)
            advance(1)
    return judged


def read_file(request: TracesAsked, path: str) -> Judged:
    """Read a trace without judging it."""
    judged = Judged(path)
    _read(request, judged)
    return judged


def _read(request: TracesAsked, judged: Judged) -> Mapping[str, rtamt.Specification]:
    """Read a trace, and return the requirements that can be judged on it.

    If a column, a topic or a field is missing or bad, the requirements that do not read it are
    judged without it.
    """
    try:
        judged.trace, judged.period = read_trace_of(request, judged.path)
    except Exception as error:  # noqa: BLE001 - other traces are to be judged
        judged.failures = dict.fromkeys(request.specs, failure_of(error))
        if not isinstance(error, InputError | SpecificationError) or judged.path == "-":
            return {}
    else:
        return request.specs
    refused = _refused(request, judged.path)
    readable = {name: spec for name, spec in request.specs.items() if name not in refused}
    if not (refused and readable):
        return {}
    try:
        judged.trace, judged.period = read_trace_of(request.having(readable), judged.path)
    except Exception:  # noqa: BLE001 - the error that all have together stays
        return {}
    judged.failures = refused
    return readable


def _refused(request: TracesAsked, path: str) -> dict[str, Failure]:
    """Return the failures of the requirements with columns that cannot be read."""
    parts: dict[tuple[str, ...], dict[str, rtamt.Specification]] = {}
    for name, spec in request.specs.items():
        parts.setdefault(tuple(sorted(spec.variables)), {})[name] = spec
    refused: dict[str, Failure] = {}
    for part in parts.values():
        try:
            read_trace_of(request.having(part), path)
        except Exception as error:  # noqa: BLE001 - the others are to be judged
            refused |= dict.fromkeys(part, failure_of(error))
    return refused


def judge_files(
    request: TracesAsked,
    paths: Sequence[str],
    *,
    workers: int,
    explain: Sequence[Verdict],
    watch: Watch | None = None,
) -> list[Trial]:
    """Judge traces; rows have the order of the names for any number of workers.

    Args:
        request: The requirements, and how traces are judged.
        paths: The names of the traces.
        workers: The number of processes.
        explain: The verdicts that are explained. If there are any, the outcomes also contain the
            time of decision, which costs as much as the verdict.
        watch: Observes each trace while it is read; None for no observations.
    """
    job, rows, grouped = _Job(request, explain, watch), list[Trial](), dict[int, Trial]()

    def done(row: Trial, observed: Seen) -> None:
        rows.append(row)
        if watch is not None:
            watch.take(row, observed)

    with progress("judging", len(paths), " traces") as advance:
        if request.columns.by and watch is None:
            from rtamt_gym.commands import group_judging

            with without_collection():
                for number, judged in group_judging.judged_groups(request, paths):
                    grouped[number] = row_of(request, judged, explain=explain)
                    advance(1)
        single = [path for i, path in enumerate(paths) if i not in grouped]
        while (left := len(single) - len(rows)) > 0:
            if workers > 1 and left > 1 and (watch is None or watch.ready):
                for row, observed in _in_processes(job, single[len(rows) :], workers, advance):
                    done(row, observed)
                break
            done(*job.done(single[len(rows)]))
            advance(1)
    others = iter(rows)
    return [grouped[i] if i in grouped else next(others) for i in range(len(paths))]


def _in_processes(
    job: _Job, paths: Sequence[str], workers: int, advance: Callable[[int], None]
) -> list[tuple[Trial, Seen]]:
    """Run a job for each trace in processes.

    If a process dies, for example for lack of memory, the trace that ended it is not known. The
    possible traces are then sent one by one, and the first trace without a row is judged alone. It
    is a failure only if its own process dies too.
    """
    rows: list[tuple[Trial, Seen]] = []
    usual = max(1, min(_CHUNK, len(paths) // (32 * workers)))
    size, until = usual, len(paths)
    while len(rows) < len(paths):
        left = paths[len(rows) : until]
        many = min(workers, len(left))
        try:
            with ProcessPoolExecutor(many, _context(), _begin_worker, (job,)) as pool:
                for row in _begin(pool, _row_of_file, left, size):
                    rows.append(row)
                    advance(1)
            size, until = usual, len(paths)
        except BrokenProcessPool:
            if until == len(rows) + 1:  # it was alone
                rows.append((job.lost(left[-1]), {}))
                advance(1)
                size, until = 1, min(len(paths), len(rows) + usual * workers)
            elif size > 1:
                size, until = 1, min(len(paths), len(rows) + usual * workers)
            else:
                until = len(rows) + 1
    return rows


_CHUNK: Final = 16
"""The maximum number of traces that a process gets at once."""


def _context() -> BaseContext:
    """Return how processes start: by a fork, which is fastest, if this process has one thread.

    Otherwise, a fork would copy locks that other threads hold. A fork server that has imported this
    module replaces it if the system has one.
    """
    with suppress(OSError):
        if len([*Path("/proc/self/task").iterdir()]) == 1:
            return get_context("fork")
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload([__name__, *_READERS])
    return context


_READERS: Final = ("rtamt_gym.recorded.trace_files", "rtamt_gym.recorded.csv_reader")
"""Modules of the most frequent format, which would otherwise be imported with the first trace."""


def _begin(
    pool: ProcessPoolExecutor, task: Callable[[str], _T], paths: Sequence[str], size: int = 1
) -> Iterator[_T]:
    """Start the processes, which ignore interrupts from the start."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return pool.map(task, paths, chunksize=size)
    finally:
        signal.signal(signal.SIGINT, before)


@dataclass(frozen=True, slots=True)
class _Job:
    """The job for each trace; `judge_files` documents the arguments."""

    request: TracesAsked
    explain: Sequence[Verdict]
    watch: Watch | None

    def done(self, path: str) -> tuple[Trial, Seen]:
        """Return the outcomes of a trace, and the observations on it."""
        judged = judge_file(self.request, path, formulas=False)
        row = row_of(self.request, judged, explain=self.explain)
        return row, {} if self.watch is None else self.watch.see(judged, row)

    def lost(self, path: str) -> Trial:
        """Return the row of a trace after its process died."""
        name = shown(path)
        failure = Failure(f"{name}: the process that judged it died, perhaps for lack of memory")
        return Trial.of_trace(name, "", dict.fromkeys(self.request.specs, failure))


_jobs: list[_Job] = []
"""The job of this process if it is a worker; it is sent once, not with every trace."""


def _begin_worker(*job: _Job) -> None:
    """Leave bars and interrupts to the parent process."""
    silence()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where that is not inherited
    _jobs[:] = job


def _row_of_file(path: str) -> tuple[Trial, Seen]:
    return _jobs[0].done(path)


def row_of(request: TracesAsked, judged: Judged, *, explain: Sequence[Verdict]) -> Trial:
    """Return the outcomes of a trace as a row; verdicts in ``explain`` are explained."""
    cells: dict[str, Outcome | Failure] = {}
    for name, spec in request.specs.items():
        if name in judged.failures:
            cells[name] = judged.failures[name]
            continue
        try:
            cells[name] = _outcome(spec, judged, name, request, explain)
        except Exception as error:  # noqa: BLE001 - the others are to be judged
            cells[name] = failure_of(error)
    if judged.trace is None:
        return Trial.of_trace(shown(judged.path), "", cells)
    extent = judge.extent_of(judged.trace, judged.period)
    notes = [*judged.trace.notes]
    timed = any(spec.timed for spec in request.specs.values())
    untimed = isinstance(judged.trace, Trace) and judged.trace.times is None
    if timed and untimed and judged.period is None:
        notes.append("there is no column of times, so bounds count samples")
    for name, judgement in judged.judgements.items():
        notes += filter(None, [judgement.note_of_end(name if len(request.specs) > 1 else "")])
    notes += _late_starts(judged.judgements, several=len(request.specs) > 1)
    described = f"{judged.trace.source}: {extent.text}"
    row = Trial.of_trace(shown(judged.path), described, cells, notes, extent)
    shortest = row.judged_extent or extent
    if request.min_duration is not None and shortest.shorter(request.min_duration):
        short = (
            f"it lasts {number(shortest.length or 0.0)} s, which is shorter than "
            f"{number(float(request.min_duration))} s (--min-duration)"
        )
        row = replace(row, notes=(*row.notes, short))
    outside = {}
    for name, spec in request.specs.items():
        if name in judged.judgements and (texts := outside_ranges(spec, judged.trace)):
            outside[name] = "; ".join(texts.values())
    return replace(row, outside=outside) if outside else row


def _late_starts(judgements: Mapping[str, TraceJudgement], *, several: bool) -> list[str]:
    """Describe the traces that start late because of some of their variables.

    Requirements with the same start share a sentence.
    """
    starts: dict[str, list[str]] = {}
    for name, judgement in judgements.items():
        if judgement.late_start is not None and judgement.late_start.of:
            starts.setdefault(judgement.late_start.text, []).append(name)
    return [
        f"{shorten(', '.join(names), 60)}: {text}" if several else text
        for text, names in starts.items()
    ]


def matrix_of(request: TracesAsked, rows: Sequence[Trial]) -> Matrix:
    """Return the rows, with the formulas of the requirements."""
    texts = {name: str(spec.standalone()) for name, spec in request.specs.items()}
    return Matrix(rows, texts, provenance=Provenance.of(request.specs))


def failure_lines(matrix: Matrix) -> list[str]:
    """Return the lines on failures for standard error.

    Messages that differ only in the trace within one file are printed once.
    """
    alike: dict[str, tuple[str, Failure, list[str]]] = {}
    for message, (failure, traces) in matrix.failures().items():
        file, _ = split_name(traces[0])
        entry = alike.setdefault(message.replace(traces[0], file), (message, failure, []))
        entry[2].extend(traces)
    lines = []
    for message, failure, traces in alike.values():
        where = "" if len(matrix.rows) == 1 or traces[0] in message else f"{traces[0]}: "
        more = f" (and {len(traces) - 1} more)" if len(traces) > 1 else ""
        lines.append(f"{failure.traceback}rtamt: error: {where}{message}{more}\n")
    return lines


def reasons_of(request: TracesAsked, judged: Judged) -> dict[str, str]:
    """Return which predicate, time and values decided each verdict, in a phrase.

    The result leaves out undecided requirements, unknown values, verdicts on a trace without its
    start, and verdicts that do not depend on a single value of the trace.
    """
    reasons = {}
    for name, judgement in judged.judgements.items():
        late = judgement.late_start
        counted = late is not None and late.counted
        decided = judgement.verdict is not Verdict.UNDECIDED
        if decided and not counted and not judgement.from_start.unknown:
            verdict = judgement.verdict
            explanation = _explained(request.specs[name], judged, request.reading, verdict)
            if explanation is not None:
                reasons[name] = explanation.reason
    return reasons


def _explanation(
    spec: rtamt.Specification, judged: Judged, name: str, reading: EvaluationOptions
) -> str:
    judgement = judged.judgements[name]
    unknown = judgement.from_start.unknown
    if unknown:
        return f"not explained: values of {', '.join(unknown)} are not known"
    head, late = "", judgement.late_start
    if late is not None and late.counted:
        head = f"{judgement}\nfrom {number(late.time)} s on it is {late.verdict}:\n"
    verdict = judgement.from_start.verdict
    explanation = _explained(spec, judged, reading, verdict)
    if not head and explanation is not None and verdict is not Verdict.UNDECIDED:
        bound = "upper" if verdict is Verdict.VIOLATED else "lower"
        if explanation.robustness != judgement.found.robustness:
            head = f"{judgement}\nunder --end {reading.end} its {bound} bound decides:\n"
    return f"{head}{explanation or 'not explained: the verdict rests on no single value'}"


def _explained(
    spec: rtamt.Specification, judged: Judged, reading: EvaluationOptions, verdict: Verdict
) -> rtamt.Explanation | rtamt.dense.Explanation | None:
    """Return the explanation of a verdict on a trace with known values.

    Under ``cut`` and ``open`` it follows the bound that decides; see `explain_verdict`. An
    undecided verdict is explained as if the trace were complete.
    """
    requirement, trace = judge.viewed(spec, reading.view), judged.trace
    end: End = "complete" if verdict is Verdict.UNDECIDED else reading.end
    violated = verdict is Verdict.VIOLATED
    if isinstance(trace, EventTrace):
        tables, semantics = trace.tables, reading.semantics
        if end == "complete":
            return rtamt.dense.explain(requirement, tables, semantics=semantics)
        return explain_dense_verdict(
            requirement, tables, end, violated=violated, semantics=semantics
        )
    assert trace is not None, "it was judged"  # noqa: S101 - for mypy
    trace = trace.known(requirement.variables)
    options = reading.having(period=judged.period).from_monitors({"": requirement})[""]
    n, start = trace.samples, trace.start
    if end == "complete":
        return rtamt.explain(requirement, trace.columns, n=n, start=start, **options)
    return explain_verdict(
        *(requirement, trace.columns), end=end, violated=violated, n=n, start=start, **options
    )


def _judge(
    spec: rtamt.Specification, judged: Judged, reading: EvaluationOptions, *, formulas: bool
) -> TraceJudgement:
    assert judged.trace is not None, "it was read"  # noqa: S101 - for mypy
    return judge.judge(spec, judged.trace, judged.period, reading, formulas=formulas)


def _outcome(
    spec: rtamt.Specification,
    judged: Judged,
    name: str,
    request: TracesAsked,
    explain: Sequence[Verdict],
) -> Outcome:
    judgement = judged.judgements[name]
    explanation, occurrences = "", None
    if judgement.verdict in explain:
        explanation = _explanation(spec, judged, name, request.reading)
    if request.occurrences and judged.trace is not None:
        from rtamt_gym.recorded.occurrences import occurrences_of

        occurrences = occurrences_of(
            spec, judged.trace, judged.period, request.reading.about(name), judgement
        )
    result = judgement.found
    return Outcome(
        result.robustness,
        result.lower,
        result.upper,
        result.verdict,
        judgement.decided if explain else None,
        text=str(judgement) if explain else "",
        not_recorded=judgement.not_recorded,
        way_out=judgement.way_out,
        explanation=explanation,
        triggers=result.triggers,
        vacuous=result.vacuous,
        defaults=_defaults(spec, judged),
        unknown=result.unknown,
        progress=judgement.progress,
        late_start=judgement.late_start,
        occurrences=occurrences,
    )


def _defaults(spec: rtamt.Specification, judged: Judged) -> dict[str, float]:
    """Return the variables of a requirement that have their default in the trace."""
    defaults = {} if judged.trace is None else judged.trace.defaults
    return {name: value for name, value in defaults.items() if name in spec.variables}
