"""`run_campaign`: many runs on several processes or machines, with results that survive a kill."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from rtamt import Verdict
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.folder import Folder, digest
from rtamt_gym.play.process import SearchTask
from rtamt_gym.play.record import Record
from rtamt_gym.play.runner import CaseLike, Runner
from rtamt_gym.play.workers import Chunks, Elsewhere, NumberedTrials, Recipe, check_workers
from rtamt_gym.recorded.progress import progress as shown_progress
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.trial import Trial

if TYPE_CHECKING:
    from rtamt_gym.play.workers import ClusterBackend


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

    The record does not depend on the number of workers, or on which run is over first. A worker
    gets about a second's work at once, or as many tasks as run side by side.

    Args:
        runner: Runs the cases. Other processes make it again.
        tasks: The case of each run, and its seed (None for a system without seeds).
        n_jobs: How many runs, or batches, run at once, each in its own process; -1: one for each
            core. None: one after the other in this process, unless ``backend`` or ``timeout`` is
            given.
        backend: ``"dask"``: the workers of the present Dask client; ``"ray"``: those of Ray. None:
            this machine.
        timeout: The seconds that a run may take. A longer run is ended and has a ``TimeoutError``
            in its row; a run that ends its process twice has a ``ChildProcessError``. The first
            run may have code to compile.
        folder: Stores finished runs. An interrupted campaign continues there. The folder stores
            hashes and versions of what runs, `Runner.fingerprint`, and is refused if they have
            changed.
        accept_changed: Whether to use the runs in the folder although the model has changed;
            ``provenance.reuse`` of the record states it.
        about: Metadata of the record for JSON, which distinguishes the campaign from others.
        what: The name of the campaign on the progress bar.
        progress: Whether to show a bar on a terminal, after a second, if tqdm is installed.
        enough: Gets each row in the order of the tasks, and returns whether no more are needed.

    Returns:
        A row for each task, in their order, up to the one that was enough.

    Raises:
        KeyboardInterrupt: On Ctrl-C, with the attributes ``record``, the rows up to the first run
            that is not over, and ``lost``, the maximum number of further runs that had started.
        InputError: If an argument is wrong, the folder holds another campaign, or another process
            cannot make the system.
        InputTypeError: If the system cannot be sent to another process.
    """
    listed: list[SearchTask] = [(i, Case(case), seed) for i, (case, seed) in enumerate(tasks)]
    timeout = check_workers(n_jobs, backend, timeout)
    if listed:
        runner.check(listed[0][1])
    requirements = {name: str(spec.standalone()) for name, spec in runner.requirements.items()}
    rows: dict[int, Trial] = {}
    fingerprint = runner.fingerprint()
    with ExitStack() as stack:
        kept = None
        if folder is not None:
            about = {**(about or {})}
            identity = {
                **Recipe(runner).identity(requirements),
                **about,
                "number of runs": len(listed),
                "runs": digest(task[1:] for task in listed),
            }
            of = (folder, identity, about, requirements, runner.name, fingerprint)
            kept = stack.enter_context(Folder(*of, accept_changed=accept_changed))
            rows = kept.rows()
        stored = frozenset(rows)
        order = _Order(rows, len(listed), enough)
        left = [] if order.over() else [task for task in listed if task[0] not in rows]
        chunks = Chunks(left, runner)
        elsewhere = None
        if n_jobs is None and backend is None and timeout is None:
            over: Iterator[NumberedTrials] = (_run_here(runner, chunk) for chunk in chunks)
        else:
            elsewhere = stack.enter_context(Elsewhere(runner, n_jobs, backend, timeout))
            over = stack.enter_context(elsewhere.spread(chunks))
        note = _Note(runner.duration, rows.values())
        bar = shown_progress(what, len(listed) if progress else 0, "run")
        advance = stack.enter_context(bar)
        advance(len(rows), str(note))

        def record_of(count: int) -> Record:
            reused = len(stored & {*range(count)})
            reuse = None if kept is None else kept.reuse(reused, count)
            made_of = Provenance.of(runner.requirements, fingerprint, reuse)
            return Record((rows[i] for i in range(count)), requirements, runner.name, made_of)

        take = partial(_take, rows, kept)
        most = runner.batch if elsewhere is None else len(listed)

        def open_tasks(count: int) -> int:
            return min(most, len(listed) - len(chunks) - count)

        stack.enter_context(_carrying(rows, take, order, record_of, open_tasks))
        for finished in over:
            take(finished)
            chunks.learn(finished)
            note.take(row for _, row in finished)
            advance(len(finished), str(note))
            if order.over():
                if elsewhere is not None:  # do not wait for its workers
                    elsewhere.close()
                break
        record = record_of(order.count)
        if kept is not None:
            kept.finish(record)
        return record


def _take(rows: dict[int, Trial], kept: Folder | None, finished: NumberedTrials) -> None:
    if kept is not None:
        kept.add(finished)
    rows.update(finished)


@contextmanager
def _carrying(
    rows: Mapping[int, Trial],
    take: Callable[[NumberedTrials], None],
    order: _Order,
    record_of: Callable[[int], Record],
    open_tasks: Callable[[int], int],
) -> Iterator[None]:
    """Add the attributes to an interrupt that `run_campaign` documents."""
    try:
        yield
    except KeyboardInterrupt as pressed:
        if finished := getattr(pressed, "finished", []):  # the chunk ran in this process
            take(finished)
        order.over()
        # Runs that are over early may be short ones: stop at the first that is not over.
        count = next(i for i in itertools.count() if i not in rows)
        carried: Any = pressed
        carried.record, carried.lost = record_of(count), open_tasks(count)
        raise


class _Order:
    """Passes rows to ``enough`` in the order of their tasks, and counts them."""

    def __init__(self, rows: Mapping[int, Trial], tasks: int, enough: Enough | None) -> None:
        self._rows = rows
        self._enough = enough
        self._found = False
        self.count = tasks if enough is None else 0

    def over(self) -> bool:
        """Pass the new rows on; return whether they are enough."""
        if self._enough is None:
            return False
        while not self._found and self.count in self._rows:
            self._found = self._enough(self._rows[self.count])
            self.count += 1
        return self._found


class _Note:
    """The note of the progress bar: violations, minimum robustness, time saved, failures."""

    def __init__(self, duration: float | None, rows: Iterable[Trial]) -> None:
        self._duration = duration
        self._violated = 0
        self._failed = 0
        self._least = math.inf
        self._saved = 0.0
        self.take(rows)

    def take(self, rows: Iterable[Trial]) -> None:
        """Count violations, the minimum robustness and the time saved by stops."""
        for row in rows:
            self._failed += bool(row.error)
            outcomes = row.outcomes.values()
            self._violated += any(each.verdict is Verdict.VIOLATED for each in outcomes)
            self._least = min([self._least, *(each.robustness for each in outcomes)])
            if row.ended in {"violation", "decided"} and self._duration is not None:
                self._saved += self._duration - row.simulated

    def __str__(self) -> str:
        failed = f"{self._failed} failed" if self._failed else ""
        if self._least == math.inf:
            return failed
        saved = f", {self._saved:.0f} s of simulation saved" if self._saved else ""
        told = f"{self._violated} violated, least robustness {self._least:.3g}{saved}"
        return f"{told}, {failed}" if failed else told


def _run_here(runner: Runner, tasks: Sequence[SearchTask]) -> NumberedTrials:
    seeds: Any = [seed for _, _, seed in tasks] if runner.takes_seeds else None
    finished: NumberedTrials = []
    try:
        for index, row in runner.run([case for _, case, _ in tasks], seeds):
            finished.append((tasks[index][0], row))
    except KeyboardInterrupt as pressed:
        carried: Any = pressed
        carried.finished = finished
        raise
    return finished
