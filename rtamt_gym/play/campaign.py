"""`run_campaign`: many runs on several processes or machines, with results that survive a kill.

`ParallelRunner` runs the cases of a campaign, or of a search, in other processes.
"""

from __future__ import annotations

import itertools
import math
import os
import sys
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from fractions import Fraction
from importlib import import_module
from typing import Any, Final, Literal
from uuid import uuid4

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from rtamt import InputError, InputTypeError, Verdict
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_choice, check_number
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.folder import Folder, digest
from rtamt_gym.play.loop import Task
from rtamt_gym.play.record import Record
from rtamt_gym.play.runner import CaseLike, Runner
from rtamt_gym.play.workers import Making, Setup, end_processes, run_chunk
from rtamt_gym.recorded.progress import progress as shown_progress
from rtamt_gym.results.provenance import Fingerprint, Provenance, listed
from rtamt_gym.results.trial import Trial

ClusterBackend = Literal["dask", "ray"]
"""The backends of joblib with workers on other machines."""

NumberedTrials = list[tuple[int, Trial]]
"""Trials with the numbers of their tasks."""


Wrap = Callable[[Runner], Any]
"""Returns an object that runs cases as the runner does, with ``run`` and ``close``."""

Enough = Callable[[Trial], bool]
"""Returns whether no rows after this one are needed."""


_SECONDS: Final = 1.0
"""The target duration of a chunk: a kill loses that much, and a chunk is saved in less time."""

_MOST: Final = 1000
"""The maximum number of tasks in a chunk."""

_SIDE_BY_SIDE = ("batch", "n_envs")
"""Options that set the number of simultaneous runs, and change no row."""


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
    worker gets about a second's work at once. `rtamt_gym.sweep` documents workers and folders.
    ``about`` is metadata that distinguishes the campaign in a folder from others; ``enough`` gets
    each row in the order of the tasks, and returns whether no more are needed.

    Ctrl-C raises its error with the attributes ``record``, the rows up to the first unfinished run,
    and ``lost``, the maximum number of further runs that had started.
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
            elsewhere = ParallelRunner(runner, n_jobs, backend, timeout)
            stack.callback(elsewhere.close)
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


def check_workers(
    n_jobs: int | None, backend: ClusterBackend | None, timeout: float | None
) -> float | None:
    """Check the options of `run_campaign` that select workers; return the timeout."""
    check_choice("backend", backend, (None, "dask", "ray"))
    if timeout is not None:
        timeout = check_number("timeout", timeout)
    if n_jobs is not None and (type(n_jobs) is not int or n_jobs == 0):
        raise InputError(
            "expected ",
            Argument("n_jobs"),
            f" as a whole number, or -1 for all cores, got {n_jobs!r}",
        )
    return timeout


class Chunks(Iterator[list[Task]]):
    """An iterator of task lists that grow until a list takes about a second.

    If cases run side by side, a chunk is one batch.
    """

    def __init__(self, tasks: Sequence[Task], runner: Runner) -> None:
        self._tasks = tasks
        self._batch = runner.batch
        self._workers = 1
        self._start = 0
        self._finished = 0
        self._wall = 0.0

    def share(self, workers: int) -> None:
        """Limit the size of chunks so that every worker gets a chunk."""
        self._workers = workers

    def learn(self, rows: NumberedTrials) -> None:
        """Estimate from finished tasks how long a task takes."""
        self._finished += len(rows)
        self._wall += sum(row.wall for _, row in rows)

    def __len__(self) -> int:
        """The number of remaining tasks."""
        return len(self._tasks) - self._start

    def __next__(self) -> list[Task]:
        if not len(self):
            raise StopIteration
        size = self._batch
        if self._batch == 1 and self._finished:
            size = min(_MOST, max(1, int(_SECONDS * self._finished / max(self._wall, 1e-9))))
        size = max(1, min(size, math.ceil(len(self) / self._workers)))
        self._start += size
        return list(self._tasks[self._start - size : self._start])


class Recipe:
    """The data that makes an equal runner in another process, and identifies campaigns.

    An environment is made again from its spec; everything else is pickled.
    """

    def __init__(
        self, runner: Runner, wrap: Wrap | None = None, fingerprint: Fingerprint | None = None
    ) -> None:
        self._fingerprint = fingerprint
        self._wrap = wrap
        self._system = runner.origin
        self._requirements = runner.requirements
        self._kind = type(runner)
        self._name, self._duration = runner.name, runner.duration
        self._options = runner.arguments
        spec = self._system.spec if isinstance(self._system, gym.Env) else None
        if spec is not None and all(
            wrapper.kwargs is not None for wrapper in spec.additional_wrappers
        ):
            self._system = spec

    def runner(self) -> Any:  # noqa: ANN401 - as `Wrap`
        """Make the runner."""
        system = self._system
        if isinstance(system, EnvSpec):
            system = gym.make(system)
        runner = self._kind(system, self._requirements, **self._options)
        if self._fingerprint is not None:
            there = replace(self._fingerprint, values={})  # a run changes the values of objects
            here = runner.fingerprint()
            if changes := there.common(here).changes(here.common(there)):
                raise InputError(f"{listed(changes)} since the run began, or on this machine")
        return runner if self._wrap is None else self._wrap(runner)

    def pickled(self, name: str) -> bytes:
        """Return the recipe as bytes, including functions of the main program and nested ones."""
        import cloudpickle

        try:
            recipe: bytes = cloudpickle.dumps(self)
        except Exception as error:
            raise InputTypeError(
                f"{name} cannot be sent to other processes: {type(error).__name__}: {error}; give "
                "the id of a registered environment, or a function that builds the parts that "
                "cannot be pickled"
            ) from error
        return recipe

    def identity(self, requirements: Mapping[str, str]) -> dict[str, Any]:
        """Return the identity of the rows of this runner, for JSON.

        A function, and an object that JSON cannot store, is represented by its name: the
        fingerprint of the runner covers its source and values.
        """
        system = self._system
        return {
            "system": self._name,
            "requirements": dict(requirements),
            "time limit": self._duration,
            "arguments of the system": _plain(system.kwargs) if isinstance(system, EnvSpec) else {},
            **{
                name: _plain(value)
                for name, value in self._options.items()
                if name not in _SIDE_BY_SIDE and value is not False  # same as the default
            },
        }


def _plain(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if value is None or isinstance(value, str | int | float):
        return value
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, Fraction):
        return str(value)
    return getattr(value, "__qualname__", type(value).__qualname__)


class ParallelRunner:
    """Runs cases on several processes or machines; the rows equal the runner's own rows.

    The options are the options of `run_campaign`; ``wrap`` is called with the runner of each
    process.
    """

    def __init__(
        self,
        runner: Runner,
        n_jobs: int | None,
        backend: ClusterBackend | None,
        timeout: float | None,
        wrap: Wrap | None = None,
    ) -> None:
        try:
            import_module("joblib")
        except ModuleNotFoundError as error:
            raise naming_extra(error, "n_jobs=") from error
        if Making.now:
            raise InputError(
                "a module starts workers during its import, and workers import it too; put the "
                'call below if __name__ == "__main__":'
            )
        self._runner = runner
        self._n_jobs, self._backend, self._timeout = n_jobs, backend, timeout
        self._name = uuid4().hex
        recipe = Recipe(runner, wrap, runner.fingerprint())
        self._recipe = recipe.pickled(runner.name)

    def close(self) -> None:
        """End the processes; no more cases can be run."""
        end_processes(self._name)

    def run(
        self,
        cases: Iterable[CaseLike],
        seeds: Sequence[int] | None = None,
        *,
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """Run cases as `Runner.run` does; a caller that stops early ends the processes."""
        listed = [Case(case) for case in cases]
        listed_seeds: Sequence[int | None] = [None] * len(listed) if seeds is None else seeds
        tasks = list(map(Task, range(len(listed)), listed, listed_seeds))
        chunks = Chunks(tasks, self._runner)
        with self.spread(chunks, above) as results:
            for rows in results:
                chunks.learn(rows)
                yield from rows

    @contextmanager
    def spread(
        self, chunks: Chunks, above: Mapping[str, float] | None = None
    ) -> Iterator[Iterator[NumberedTrials]]:
        """Yield the rows of each chunk as soon as a worker has run it."""
        with chosen_workers(self._backend, self._n_jobs) as (count, threads):
            chunks.share(count)
            path = tuple(sys.path)
            setup = Setup(self._name, self._recipe, self._timeout, threads, path, above)
            with closing(_parallel(setup, chunks, count)) as results:
                try:
                    yield results
                except BaseException:  # the threads would wait for their processes
                    self.close()
                    raise


@contextmanager
def chosen_workers(backend: ClusterBackend | None, n_jobs: int | None) -> Iterator[tuple[int, int]]:
    """Select a backend of joblib; yield its workers and how many threads each may start.

    Without a backend the workers are threads, and each watches a process.
    """
    import joblib

    if backend == "ray":
        _register_ray()
    jobs = n_jobs or (1 if backend is None else -1)
    try:
        config = joblib.parallel_config(backend=backend or "threading", n_jobs=jobs)
    except (ValueError, ImportError) as error:
        raise InputError(f"cannot use backend={backend!r}: {error}") from error
    with config:
        count = max(1, joblib.effective_n_jobs(jobs))
        yield count, max(1, joblib.cpu_count() // count) if backend is None else 1


def _parallel(setup: Setup, chunks: Chunks, count: int) -> Generator[NumberedTrials]:
    """Yield the rows of chunks in the order of completion."""
    import joblib

    parallel: Any = joblib.Parallel(
        n_jobs=count, batch_size=1, pre_dispatch="2*n_jobs", return_as="generator_unordered"
    )
    with warnings.catch_warnings():
        # After an interrupt joblib warns about results that nobody has fetched.
        warnings.filterwarnings("ignore", category=UserWarning, module="joblib")
        yield from parallel(joblib.delayed(run_chunk)(setup, chunk) for chunk in chunks)


def _register_ray() -> None:
    """Make Ray a backend of joblib, and start or join a cluster as its own variables set it."""
    import joblib

    try:
        import ray
        from ray.util.joblib.ray_backend import RayBackend
    except ModuleNotFoundError as error:
        raise InputError(f"cannot use backend='ray': {error}; pip install ray") from error

    class _Backend(RayBackend):  # type: ignore[misc]  # not typed
        # joblib refuses generators for process pools, where a task is lost with its process
        # without an error; an actor of Ray that dies raises one.
        supports_return_generator = True

    joblib.register_parallel_backend("ray", _Backend)
    if not ray.is_initialized():
        ray.init()
