"""`run_campaign`: many runs on several processes or machines, with results that survive a kill."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from rtamt import Verdict
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.folder import Folder, digest
from rtamt_gym.play.loop import Task
from rtamt_gym.play.parallel_runner import (
    Chunks,
    NumberedTrials,
    ParallelRunner,
    Recipe,
    check_workers,
)
from rtamt_gym.play.record import Record
from rtamt_gym.play.runner import CaseLike, Runner
from rtamt_gym.recorded.progress import progress as shown_progress
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.trial import Trial

if TYPE_CHECKING:
    from rtamt_gym.play.parallel_runner import ClusterBackend


Enough = Callable[[Trial], bool]
"""Returns whether no rows after this one are needed."""


def run_campaign(
    runner: Runner,
    tasks: Iterable[tuple[CaseLike, int | None]],
    *,
    n_jobs: int | None = None,
    backend: ClusterBackend | None = None,
    timeout: float | None = None,
    folder: str | os.PathLike[str] | None = None,
    accept_changed: bool = False,
    about: Mapping[str, Any] | None = None,
    what: str = "campaign",
    progress: bool = False,
    enough: Enough | None = None,
) -> Record:
    """Run a case with its seed for each task; return a record with a row for each.

    The record depends neither on the number of workers nor on the order in which runs finish. A
    worker gets about a second's work at once, or as many tasks as run side by side.

    Args:
        runner: Runs the cases. Other processes make it again.
        tasks: The case of each run, and its seed (None for a system without seeds).
        n_jobs: How many runs, or batches, run at once, each in its own process; -1: one for each
            core. None: one after the other in this process, unless ``backend`` or ``timeout`` is
            given.
        backend: ``"dask"``: the workers of the current Dask client; ``"ray"``: Ray's workers.
            None: this machine.
        timeout: The seconds that a run may take. A longer run is ended and has a ``TimeoutError``
            in its row; a run that ends its process twice has a ``ChildProcessError``. The first
            run may have code to compile.
        folder: Stores finished runs. An interrupted campaign continues there. The folder also
            stores hashes and versions of the code that runs, `Runner.fingerprint`; if they have
            changed, it is an error.
        accept_changed: Whether to use the runs in the folder although the model has changed;
            ``provenance.reuse`` of the record states it.
        about: Metadata of the record for JSON, which distinguishes the campaign from others.
        what: The name of the campaign on the progress bar.
        progress: Whether to show a bar on a terminal, after a second, if tqdm is installed.
        enough: Called with each row in the order of the tasks; returns whether no more are needed.

    Returns:
        A row for each task, in their order, up to the row that was enough.

    Raises:
        KeyboardInterrupt: On Ctrl-C, with the attributes ``record``, the rows up to the first
            unfinished run, and ``lost``, the maximum number of further runs that had started.
        InputError: If an argument is wrong, the folder holds another campaign, or another process
            cannot make the system.
        InputTypeError: If the system cannot be sent to another process.
    """
    listed = [Task(i, Case(case), seed) for i, (case, seed) in enumerate(tasks)]
    timeout = check_workers(n_jobs, backend, timeout)
    if listed:
        runner.check(listed[0].case)
    requirements = {name: str(spec.standalone()) for name, spec in runner.requirements.items()}
    fingerprint = runner.fingerprint()
    with ExitStack() as stack:
        store = None
        if folder is not None:
            about = {**(about or {})}
            identity = {
                **Recipe(runner).identity(requirements),
                **about,
                "number of runs": len(listed),
                "runs": digest(task[1:] for task in listed),
            }
            described = (identity, about, requirements, runner.name, fingerprint)
            store = stack.enter_context(Folder(folder, *described, accept_changed=accept_changed))
        rows = _Rows(store, len(listed), enough)
        stored = frozenset(rows.trials)
        todo = [] if rows.over() else [task for task in listed if task.number not in stored]
        chunks = Chunks(todo, runner)
        elsewhere = None
        if n_jobs is None and backend is None and timeout is None:
            results: Iterator[NumberedTrials] = (_run_here(runner, chunk) for chunk in chunks)
        else:
            elsewhere = stack.enter_context(ParallelRunner(runner, n_jobs, backend, timeout))
            results = stack.enter_context(elsewhere.spread(chunks))
        note = _Note(runner.duration, rows.trials.values())
        bar = shown_progress(what, len(listed) if progress else 0, "run")
        advance = stack.enter_context(bar)
        advance(len(stored), str(note))

        def record_of(count: int) -> Record:
            reuse = None if store is None else store.reuse(len(stored & {*range(count)}), count)
            provenance = Provenance.of(runner.requirements, fingerprint, reuse)
            trials = (rows.trials[i] for i in range(count))
            return Record(trials, requirements, runner.name, provenance)

        try:
            for finished in results:
                rows.take(finished)
                chunks.learn(finished)
                note.take(row for _, row in finished)
                advance(len(finished), str(note))
                if rows.over():
                    if elsewhere is not None:  # do not wait for its workers
                        elsewhere.close()
                    break
            record = record_of(rows.count)
            if store is not None:
                store.finish(record)
        except KeyboardInterrupt as pressed:
            rows.take(getattr(pressed, "finished", []))  # of a chunk that ran in this process
            rows.over()
            # Runs that finish early may be short: stop at the first unfinished run.
            count = next(i for i in itertools.count() if i not in rows.trials)
            started = len(listed) - len(chunks) - count
            carried: Any = pressed
            carried.record = record_of(count)
            carried.lost = started if elsewhere is not None else min(runner.batch, started)
            raise
        return record


class _Rows:
    """The rows of a campaign by task number, some of them from its folder.

    Attributes:
        trials: The rows.
        count: The number of rows that ``enough`` has seen, in the order of tasks; all without it.
    """

    def __init__(self, store: Folder | None, tasks: int, enough: Enough | None) -> None:
        self.trials: dict[int, Trial] = {} if store is None else store.rows()
        self._store, self._enough = store, enough
        self._done = False
        self.count = tasks if enough is None else 0

    def take(self, finished: NumberedTrials) -> None:
        """Add rows, and store them."""
        if self._store is not None and finished:
            self._store.add(finished)
        self.trials.update(finished)

    def over(self) -> bool:
        """Return whether the rows are enough."""
        if self._enough is None:
            return False
        while not self._done and self.count in self.trials:
            self._done = self._enough(self.trials[self.count])
            self.count += 1
        return self._done


class _Note:
    """The note of the progress bar: violations, minimum robustness, time saved, failures."""

    def __init__(self, duration: float | None, rows: Iterable[Trial]) -> None:
        self._duration = duration
        self._violated = self._failed = 0
        self._smallest, self._saved = math.inf, 0.0
        self.take(rows)

    def take(self, rows: Iterable[Trial]) -> None:
        """Count finished runs."""
        for row in rows:
            self._failed += bool(row.error)
            outcomes = row.outcomes.values()
            self._violated += any(outcome.verdict is Verdict.VIOLATED for outcome in outcomes)
            self._smallest = min([self._smallest, *(outcome.robustness for outcome in outcomes)])
            if row.ended in {"violation", "decided"} and self._duration is not None:
                self._saved += self._duration - row.simulated

    def __str__(self) -> str:
        failed = f"{self._failed} failed" if self._failed else ""
        if self._smallest == math.inf:
            return failed
        saved = f", {self._saved:.0f} s of simulation saved" if self._saved else ""
        text = f"{self._violated} violated, minimum robustness {self._smallest:.3g}{saved}"
        return f"{text}, {failed}" if failed else text


def _run_here(runner: Runner, tasks: Sequence[Task]) -> NumberedTrials:
    """Run tasks in this process; an interrupt carries the finished ones."""
    seeds: Any = [task.seed for task in tasks] if runner.takes_seeds else None
    finished: NumberedTrials = []
    try:
        for index, row in runner.run([task.case for task in tasks], seeds):
            finished.append((tasks[index].number, row))
    except KeyboardInterrupt as pressed:
        carried: Any = pressed
        carried.finished = finished
        raise
    return finished
