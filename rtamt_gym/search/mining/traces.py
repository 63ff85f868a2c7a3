"""Traces for mining: recorded traces, runs of simulations and runs of a sweep."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

import rtamt
from rtamt import InputError, InputTypeError, RtamtError
from rtamt_gym.checks.names import listing
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.progress import progress
from rtamt_gym.recorded.readers import is_bag
from rtamt_gym.recorded.trace import EventTrace
from rtamt_gym.recorded.trace_files import read_ruled
from rtamt_gym.tables import counted

if TYPE_CHECKING:
    from rtamt_gym.play.history import SimulatedTrace
    from rtamt_gym.play.run import Run
    from rtamt_gym.results.trial import RunEnd
    from rtamt_gym.search.sweeps.sweep import Sweep


TraceLike = Any
"""Columns by name, a data frame, an array, the path of a file, or a `Run`."""
Traces = TraceLike | Iterable[TraceLike]
"""One trace or several, or a `Sweep`, whose simulations run again."""


@dataclass(frozen=True)
class Samples:
    """A trace of samples.

    Attributes:
        name: The name in messages.
        source: The trace as passed; for a sweep, the `Row`.
        reading: The evaluation options, with the period in seconds and the end mode.
        notes: Changes to the trace that its file does not show, in sentences.
        stopped: Whether the trace is a run that stopped at a verdict.
    """

    name: str
    source: object
    signals: Any
    reading: EvaluationOptions
    n: int | None = None
    start: float = 0.0
    notes: tuple[str, ...] = ()
    stopped: bool = False

    def judge(self, spec: rtamt.Specification) -> rtamt.Judgement:
        """Judge the trace; an error names it."""
        with _naming(self.name):
            options = self._options(spec)
            return rtamt.judge(spec, self.signals, end=self.reading.end, n=self.n, **options)

    def explain(self, spec: rtamt.Specification) -> rtamt.Explanation:
        """Return which sub-formulas and samples decided the robustness."""
        with _naming(self.name):
            options = self._options(spec)
            return rtamt.explain(spec, self.signals, n=self.n, start=self.start, **options)

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples, or None."""
        return self.reading.seconds

    def _options(self, spec: rtamt.Specification) -> dict[str, Any]:
        return self.reading.from_monitors({"": spec})[""]


@contextmanager
def _naming(name: str) -> Iterator[None]:
    try:
        yield
    except RtamtError as error:
        if name not in getattr(error, "__notes__", []):
            error.add_note(name)
        raise


def samples_of(
    traces: Traces,
    spec: rtamt.Specification,
    reading: EvaluationOptions,
    *,
    shown: bool,
) -> tuple[list[Samples], tuple[str, ...]]:
    """Return the traces, and notes on them for readers of the result.

    Without a period each trace has its own; without an end, a run that its system ended is
    ``"complete"``. ``shown`` is whether to show a bar during simulations.
    """
    samples: list[Samples] = []
    notes: list[str] = []
    for value in [traces] if _is_one(traces) else _listed(traces):
        if _is_a(value, "sweep", "Sweep"):
            sweep = cast("Sweep", value)
            samples += _of_sweep(sweep, spec, reading, shown=shown)
            if failed := len(sweep.record.failed()):
                verb = "is" if failed == 1 else "are"
                count = f"{counted(failed, 'simulation')} of {len(sweep.record)}"
                notes.append(f"{count} failed and {verb} left out")
        elif _is_a(value, "run", "Run"):
            run = cast("Run", value)
            name = run.label or f"run {len(samples)}"
            samples.append(_of_run(run, name, reading))
        elif isinstance(value, str | os.PathLike):
            samples.append(_of_file(os.fspath(value), value, spec, reading))
        elif isinstance(value, Mapping | np.ndarray) or hasattr(value, "columns"):
            name = f"trace {len(samples)}"
            _check_columns(name, value, spec)
            samples.append(Samples(name, value, value, reading))
        else:
            raise InputTypeError(
                "expected a trace as columns by name, a data frame, a path, or a Run, got "
                f"{type(value).__name__} {value!r:.60}"
            )
    if not samples:
        raise InputError("expected at least one trace, got none")
    return samples, (*notes, *notes_on(samples))


def notes_on(traces: Sequence[Samples]) -> tuple[str, ...]:
    """Return notes on the traces for readers of the result."""
    names: dict[str, list[str]] = {}
    for trace in traces:
        for note in trace.notes:
            names.setdefault(note, []).append(trace.name)
    notes = []
    for note, (first, *others) in names.items():
        suffix = f" (and {counted(len(others), 'other trace')})" if others else ""
        notes.append(f"{first}: {note}{suffix}")
    if stopped := [trace.name for trace in traces if trace.stopped]:
        notes.append(
            f"{counted(len(stopped), 'run')} of {len(traces)} ended at a verdict or an error, such "
            f'as {stopped[0]}; simulate(..., stop="end") goes on after a verdict'
        )
    return tuple(notes)


def _is_one(traces: Traces) -> bool:
    """Return whether the argument is one trace or a sweep, and not a sequence of traces."""
    one = isinstance(traces, Mapping | np.ndarray | str | os.PathLike)
    simulated = _is_a(traces, "run", "Run") or _is_a(traces, "sweep", "Sweep")
    return one or simulated or hasattr(traces, "columns")


def _listed(traces: Any) -> list[Any]:  # noqa: ANN401
    if not isinstance(traces, Iterable):
        raise InputTypeError(f"expected traces or runs, got {type(traces).__name__} {traces!r:.60}")
    return list(traces)


def _check_columns(name: str, trace: object, spec: rtamt.Specification) -> None:
    """Raise InputError for a mapping without a variable, such as traces by name."""
    variables = {re.split(r"[.\[]", variable)[0] for variable in spec.variables} | {*spec.variables}
    if not isinstance(trace, Mapping) or not variables or variables & trace.keys():
        return
    several = any(
        isinstance(value, Mapping) or hasattr(value, "columns") for value in trace.values()
    )
    hint = "; several traces are a sequence: list(traces.values())" if several else ""
    raise InputError(
        f"{name}: expected columns by name, {listing(spec.variables)} among them, got "
        f"{listing(trace)}{hint}"
    )


def _is_a(trace: object, module: str, name: str) -> bool:
    """Return whether the argument is a `Run` or a `Sweep`, without an import of Gymnasium."""
    room = {"run": "play", "sweep": "search.sweeps"}[module]
    loaded = sys.modules.get(f"rtamt_gym.{room}.{module}")
    return loaded is not None and isinstance(trace, getattr(loaded, name))


def _of_run(run: Run, name: str, reading: EvaluationOptions) -> Samples:
    if run.first_sample:
        raise InputError(
            f"{name}: expected the samples of a whole episode, got those from sample "
            f"{run.first_sample} on"
        )
    if "align" not in reading.given:
        reading = reading.having(align=run.align)
    return Samples(
        name,
        run,
        run.signals,
        _of_episode(reading, run.period, run.ended),
        n=run.steps + 1,
        stopped=run.ended in {"violation", "decided", "error"},
    )


def _of_file(
    path: str,
    source: object,
    spec: rtamt.Specification,
    reading: EvaluationOptions,
) -> Samples:
    if not Path(path).suffix and path != "-" and not Path(path).exists():
        raise InputError(
            f"the file {path!r} does not exist; for a system write mine(requirement, "
            f"sweep({path!r}, ...), ranges)"
        )
    if Path(path).is_dir() and not is_bag(path):
        raise InputError(f'{path} is a folder; write sorted(Path("{path}").glob("*.csv"))')
    trace, seconds = read_ruled(path, {"": spec}, reading, Columns())
    assert not isinstance(trace, EventTrace), "there is no dense time"  # noqa: S101 - for mypy
    return Samples(
        path,
        source,
        trace.columns,
        reading.having(period=seconds),
        trace.samples,
        trace.start,
        tuple(trace.notes),
    )


def _of_episode(
    reading: EvaluationOptions, period: Fraction | None, ended: RunEnd
) -> EvaluationOptions:
    """Return the options with the period of a run, and complete if its system ended it."""
    if reading.period is None:
        reading = reading.having(period=period)
    if "end" not in reading.given and ended == "terminated":
        reading = reading.having(end="complete")
    return reading


def _of_sweep(
    sweep: Sweep,
    spec: rtamt.Specification,
    reading: EvaluationOptions,
    *,
    shown: bool,
) -> list[Samples]:
    """Run the simulations of a sweep again, each to its end; return the samples of each."""
    runner = sweep.under({"mined": spec})
    rows = {i: row for i, row in enumerate(sweep.record) if not row.error}
    simulated: dict[int, SimulatedTrace] = {}
    ended: dict[int, RunEnd] = {}
    cases = [row.case for row in rows.values()]
    seeds = [row.seed for row in rows.values() if row.seed is not None]
    with progress(f"runs of {runner.name}", len(rows) if shown else 0, "run") as advance:
        for index, row in runner.run(cases, seeds or None, keep=simulated.__setitem__):
            if row.error:
                raise InputError(f"run {list(rows)[index]} failed when run again: {row.error}")
            ended[index] = row.ended
            advance(1)
    return [
        Samples(
            f"run {number}",
            row,
            simulated[index].signals,
            _of_episode(reading, simulated[index].period, ended[index]),
            simulated[index].samples,
        )
        for index, (number, row) in enumerate(rows.items())
    ]
