"""`run_campaign`: many runs, on several processes or machines, that a kill does not lose."""

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
"""Takes a row; says whether no more are needed."""


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
    """Runs a case with its seed for each task; keeps a row of each.

    The record does not depend on how many workers there are, or which run is over first.

    Several tasks go to a worker at once, about a second's work, or as many as run side by side.

    Args:
        runner: Runs the cases. Other processes make it anew from what it was made of.
        tasks: The case of each run, and its seed (None for a system without seeds).
        n_jobs: How many runs, or batches of lanes, run at once, each in a process of its own;
            -1: as many as there are cores. None: one after the other in this process, unless
            ``backend`` or ``timeout`` is given.
        backend: The backend of joblib that has the workers. None: this machine.
            ``"dask"``: the workers of the present Dask client; ``"ray"``: the workers of Ray.
        timeout: The seconds that a run may take. One that takes longer is ended, whatever it does,
            and has a ``TimeoutError`` in its row; so is a run that ends its process twice,
            with a ``ChildProcessError``. A first run may have code to compile.
        folder: Where finished runs are kept. A campaign that was interrupted, by whatever, goes on
            there with the runs that it does not have. The folder stores hashes and versions of what
            runs, `Runner.fingerprint`, and is refused if they have changed.
        accept_changed: Whether to use the runs in the folder although the model has changed since;
            the record states it, in ``provenance.reuse``.
        about: What is kept with the record, as JSON can write it, and tells the campaign from
            others.
        what: Names the campaign on the bar of progress.
        progress: Whether to show a bar on a terminal, after a second, if tqdm is installed.
        enough: Is given each row in the order of the tasks, as soon as all before it are there, and
            says whether they are enough: then no more runs are made. None: all are made.

    Returns:
        A row for each task, in their order, up to the one that was enough.

    Raises:
        KeyboardInterrupt: On Ctrl-C, with the attributes ``record``, the rows up to the first run
            that is not over, and ``lost``, how many more runs had begun at most.
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
                if elsewhere is not None:  # else its workers would be waited for
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
    """Makes attributes of an interrupt, which `run_campaign` documents.

    Args:
        rows: The rows by the number of their task.
        take: Adds rows to them.
        order: Shows rows in order.
        record_of: The record of the first rows.
        open_tasks: How many tasks behind the first ones have begun at most.
    """
    try:
        yield
    except KeyboardInterrupt as pressed:
        if finished := getattr(pressed, "finished", []):  # of a chunk that was run here
            take(finished)
        order.over()
        # Runs that are over early may be short ones: those behind one that is not do not count.
        count = next(i for i in itertools.count() if i not in rows)
        carried: Any = pressed
        carried.record, carried.lost = record_of(count), open_tasks(count)
        raise


class _Order:
    """Shows rows in the order of their tasks, and counts those that are needed.

    Attributes:
        count: How many were shown.
    """

    def __init__(self, rows: Mapping[int, Trial], tasks: int, enough: Enough | None) -> None:
        self._rows = rows
        self._enough = enough
        self._found = False
        self.count = tasks if enough is None else 0

    def over(self) -> bool:
        """Shows the rows that have come; whether they are enough."""
        if self._enough is None:
            return False
        while not self._found and self.count in self._rows:
            self._found = self._enough(self._rows[self.count])
            self.count += 1
        return self._found


class _Note:
    """What the bar of progress says: violations, the least robustness, time saved, failures."""

    def __init__(self, duration: float | None, rows: Iterable[Trial]) -> None:
        self._duration = duration
        self._violated = 0
        self._failed = 0
        self._least = math.inf
        self._saved = 0.0
        self.take(rows)

    def take(self, rows: Iterable[Trial]) -> None:
        """Counts violations, the least robustness and the time saved by stops of finished runs."""
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
