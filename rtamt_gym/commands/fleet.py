"""Judges many files into a folder of results, on this machine or on the workers of a cluster.

Only the coordinator writes results. A task is a batch of files worth about a second of work.
"""

from __future__ import annotations

import argparse
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import fields
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from uuid import uuid4

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.commands.fleet_folder import FleetFolder
from rtamt_gym.commands.fleet_worker import (
    FileRow,
    FileTask,
    FleetJob,
    error_row,
    exists,
    judge_batch,
    pickled,
    version,
)
from rtamt_gym.commands.specs import identified_texts
from rtamt_gym.commands.traces import TracesAsked
from rtamt_gym.play.workers import end_processes
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.names import with_columns
from rtamt_gym.recorded.parts import file_of
from rtamt_gym.recorded.progress import progress
from rtamt_gym.results.matrix import RESULTS
from rtamt_gym.results.warnings import exit_code
from rtamt_gym.tables import counted, number, shorten

if TYPE_CHECKING:
    import pyarrow as pa

_SECONDS: Final = 1.0
"""The target duration of a batch: a kill loses that much."""

_FIRST: Final = 20
"""The files of the first batches."""

_MOST: Final = 5000
"""The maximum number of files in a batch."""

_AGAIN: Final = 3
"""How often a batch is sent if its workers are lost."""

_WORST: Final = 10
"""The files that the summary lists."""

_REFUSED: Final = (
    *("--json", "--junit", "--markdown", "--out", "--plot", "--write-mcap", "--mutants", "--all"),
    *("--require-triggered", "--require-answered", "--undecided", "--violated-episodes"),
    *("--occurrences", "--write-occurrences", "--clip", "--by"),
    *("--strict-ranges", "--min-duration"),
)
"""The options of reports that need all outcomes in memory."""


def run_fleet(options: argparse.Namespace, request: TracesAsked, paths: Sequence[str]) -> int:
    """Judge files into a folder, print a summary, and return the exit code."""
    for option in _REFUSED:
        if getattr(options, option.strip("-").replace("-", "_"), None):
            raise InputError(
                f"expected --results or {option}, got both: the folder holds the outcomes as "
                "Parquet. Leave one of them out."
            )
    table, same = judge_into(
        request,
        paths,
        options.results,
        processes=options.workers,
        backend=options.backend,
        scheduler=options.scheduler,
        verify=options.verify,
    )
    return _summary(request, options.results, table, len(paths), same)


def judge_into(
    request: TracesAsked,
    paths: Sequence[str],
    results: Path,
    *,
    processes: int,
    backend: str | None,
    scheduler: str | None,
    verify: bool,
) -> tuple[pa.Table, int]:
    """Judge files into a folder; return its rows, and the number of unchanged files."""
    if scheduler is not None and backend is None:
        raise InputError(
            "expected ",
            Argument("backend", "dask"),
            " or ",
            Argument("backend", "ray"),
            " with ",
            Argument("scheduler"),
            f" {scheduler}, got none",
        )
    if several := next((path for path in paths if path == "-" or file_of(path) != path), ""):
        raise InputError(
            f"expected files with one trace each, got {several!r}. Judge the traces of this file "
            "without a folder of results."
        )
    check_packages(backend, paths)
    job = FleetJob(request, verify, version())
    with FleetFolder(results, identity_of(request), [*request.specs]) as folder:
        known = folder.known()
        tasks: list[FileTask] = [(path, known.get(path)) for path in paths]
        same = 0
        with (
            progress("judging", len(tasks), " files") as advance,
            workers_of(backend, scheduler, processes) as (count, submit),
        ):
            for rows in _results(job, tasks, count, submit):
                folder.add(row for row in rows if "same" not in row)
                same += sum("same" in row for row in rows)
                advance(len(rows))
        return folder.finish(_gone(folder, {*paths})), same


def identity_of(request: TracesAsked) -> dict[str, Any]:
    """Return everything that a row depends on except its file."""
    reading = request.reading
    plain, used = Columns(), with_columns(request.specs, request.columns)
    columns = {field.name: getattr(used, field.name) for field in fields(plain)}
    options = {
        **{name: str(getattr(reading, name)) for name in _READING},
        "columns": {k: repr(v) for k, v in columns.items() if v != getattr(plain, k)},
        "constants": repr(dict(request.constants)),
    }
    specification = {name: str(spec.standalone()) for name, spec in request.specs.items()}
    return {"specification": specification, **options, "version of rtamt": version()}


_READING: Final = ("end", "view", "semantics", "align", "period", "dense", "stages")


def _gone(folder: FleetFolder, listed: set[str]) -> list[str]:
    """Return the paths in the folder of files that no longer exist."""
    return [path for path in folder.paths() if path not in listed and not exists(path)]


def _results(
    job: FleetJob, tasks: Sequence[FileTask], count: int, submit: Callable[..., Any]
) -> Iterator[list[FileRow]]:
    """Yield the rows of each batch as soon as a worker has finished it."""
    name, sent = uuid4().hex, pickled(job)
    batches = _Batches(tasks, count)
    run = partial(judge_batch, name, sent, job.version)
    running: dict[Any, tuple[Sequence[FileTask], int]] = {}
    again: deque[tuple[Sequence[FileTask], int]] = deque()
    try:
        while running or again or batches.left:
            while len(running) < 2 * count and (again or batches.left):
                batch, tries = again.popleft() if again else (batches.take(), 1)
                running[submit(run, batch)] = batch, tries
            for future in wait_for_any([*running]):
                batch, tries = running.pop(future)
                try:
                    rows = future.result()
                except InputError:
                    raise
                except Exception as error:
                    if is_lost(error):
                        raise InputError(
                            f"the scheduler is lost: {error}. Try again: finished files are kept."
                        ) from error
                    if tries < _AGAIN:
                        again.append((batch, tries + 1))
                        continue
                    text = f"{type(error).__name__}: {shorten(' '.join(str(error).split()), 200)}"
                    rows = [
                        error_row(path, None, f"{path}: its worker was lost: {text}", retry=True)
                        for path, _ in batch
                    ]
                batches.learn(rows)
                yield rows
    finally:
        for future in running:
            with suppress(Exception):
                future.cancel()
        end_processes(name)


class _Batches:
    """Lists of files that grow until a list takes about a second."""

    def __init__(self, tasks: Sequence[FileTask], workers: int) -> None:
        self._tasks, self._workers = tasks, workers
        self._start = 0
        self._seconds: float | None = None
        self._begin = time.monotonic()

    @property
    def left(self) -> int:
        """The number of files that no list contains yet."""
        return len(self._tasks) - self._start

    def take(self) -> Sequence[FileTask]:
        """Return the next files."""
        size = _FIRST
        if self._seconds is not None:
            size = max(1, min(_MOST, int(_SECONDS / max(self._seconds, 1e-5))))
        size = max(1, min(size, -(-self.left // self._workers)))
        self._start += size
        return self._tasks[self._start - size : self._start]

    def learn(self, rows: Sequence[FileRow]) -> None:
        """Estimate the time per file from finished files; an unchanged file counts 0.1 ms."""
        mean = sum(row.get("wall", 1e-4) for row in rows) / max(1, len(rows))
        self._seconds = mean if self._seconds is None else (self._seconds + mean) / 2


def _summary(request: TracesAsked, folder: Path, table: pa.Table, count: int, same: int) -> int:
    """Print a summary of the rows of existing files; return the exit code."""
    import pyarrow.compute as pc

    there = table.filter(pc.invert(table["gone"]))
    words = {row["values"]: row["counts"] for row in pc.value_counts(there["verdict"]).to_pylist()}
    lines = [
        f"{counted(there.num_rows, 'file')}: "
        + (", ".join(f"{words[word]} {word}" for word in _WORDS if word in words) or "no rows"),
        f"judged {count - same}, unchanged {same}, gone {table.num_rows - there.num_rows}",
    ]
    bad = there.filter(pc.is_in(there["verdict"], value_set=_array(("violated", "failed"))))
    for row in bad.slice(0, _WORST).to_pylist():
        cells = [
            f"{name} {number(row[f'robustness({name})'])}"
            for name in request.specs
            if row[f"verdict({name})"] == "VIOLATED"
        ]
        text = shorten(row["error"] or ", ".join(cells), 100)
        lines.append(f"  {row['verdict']}: {row['path']}" + (f": {text}" if text else ""))
    if bad.num_rows > _WORST:
        lines.append(f"  and {bad.num_rows - _WORST} more")
    lines += _triggered(there, [*request.specs])
    lines += _noted(there)
    lines += [*identified_texts(request.specs), *request.ignored]
    lines.append(f"results: {folder / RESULTS}")
    print(*lines, sep="\n", flush=True)
    return exit_code(words.keys())


def _triggered(table: pa.Table, names: Sequence[str]) -> Iterator[str]:
    """Yield a line about each requirement that not every file triggers."""
    for name in names:
        counts = [count for count in table[f"triggers({name})"].to_pylist() if count is not None]
        triggered = sum(count > 0 for count in counts)
        if triggered < len(counts):
            never = "" if triggered else "never "
            yield f"{never}triggered: {name} in {triggered} of {counted(len(counts), 'file')}"


def _noted(table: pa.Table) -> Iterator[str]:
    """Yield a line about the files with notes, with the first note."""
    rows = table.select(["path", "notes"]).to_pylist()
    noted = [row for row in rows if row["notes"]]
    if noted:
        note = shorten(noted[0]["notes"].partition("\n")[0], 100)
        yield (
            f"notes on {counted(len(noted), 'file')}, in the column notes of the results, such as "
            f"{noted[0]['path']}: {note.removeprefix(noted[0]['path'] + ': ')}"
        )


_WORDS: Final = ("violated", "undecided", "satisfied", "failed")


def _array(texts: Sequence[str]) -> Any:  # noqa: ANN401 - of pyarrow
    import pyarrow as pa

    return pa.array(texts)


_WAIT: Final = 60
"""The seconds until a scheduler must have a worker."""


def check_packages(backend: str | None, paths: Sequence[str]) -> None:
    """Raise an error if a package of the cluster or of a URL is missing."""
    if backend is not None:
        try:
            import_module(_PACKAGES[backend])
        except ModuleNotFoundError as error:
            raise naming_extra(error, f"backend={backend!r}", backend) from None
    urls = {path.partition("://")[0] for path in paths if "://" in path}
    if not urls:
        return
    try:
        fsspec = import_module("fsspec")
    except ModuleNotFoundError as error:
        raise naming_extra(error, "a URL", "urls") from None
    for protocol in sorted({name for url in urls for name in url.split("::")}):
        try:
            fsspec.get_filesystem_class(protocol)
        except (ImportError, ValueError) as error:
            raise InputError(
                f"cannot open URLs with {protocol}:// ({error}). Install the package of this file "
                "system, or copy the files."
            ) from None


_PACKAGES: Final = {"dask": "distributed", "ray": "ray"}
"""The package of each backend."""


@contextmanager
def workers_of(
    backend: str | None, scheduler: str | None, processes: int
) -> Iterator[tuple[int, Callable[..., Any]]]:
    """Yield the number of workers, and a function that sends a task to one."""
    if backend is None:
        with ThreadPoolExecutor(processes) as pool:
            yield processes, pool.submit
        return
    if backend == "dask":
        yield from _dask(scheduler)
        return
    yield from _ray(scheduler)


def _dask(scheduler: str | None) -> Iterator[tuple[int, Callable[..., Any]]]:
    from distributed import Client

    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"cannot reach a Dask scheduler at {scheduler}: {error}. Start one with dask "
            "scheduler, and give its address, such as tcp://host:8786, as ",
            Argument("scheduler"),
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_WAIT)
        except TimeoutError:
            raise InputError(
                f"no worker has come to the scheduler {client.scheduler.address} in {_WAIT} s. "
                "Start workers with dask worker ADDRESS, and try again."
            ) from None
        count = sum(client.nthreads().values())
        yield count, partial(client.submit, pure=False)


def _ray(scheduler: str | None) -> Iterator[tuple[int, Callable[..., Any]]]:
    import ray

    try:
        if not ray.is_initialized():
            ray.init(scheduler, log_to_driver=False)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InputError(
            f"cannot reach Ray at {scheduler}: {error}. Start it with ray start --head, and give "
            "its address, such as host:6379, as ",
            Argument("scheduler"),
        ) from error
    remote = ray.remote(max_retries=0)(lambda run, batch: run(batch))
    count = max(1, int(ray.cluster_resources().get("CPU", 1)))
    yield count, lambda run, batch: _RayFuture(remote.remote(run, batch))


class _RayFuture:
    """A result of Ray with the methods of a future."""

    def __init__(self, reference: Any) -> None:  # noqa: ANN401 - Ray is optional
        self.reference = reference

    def hex(self) -> str:
        """Return the name of the result."""
        return str(self.reference.hex())

    def result(self) -> list[FileRow]:
        """Return the result, or raise its error."""
        import ray

        try:
            rows: list[FileRow] = ray.get(self.reference)
        except ray.exceptions.RayTaskError as error:
            raise error.cause from error
        return rows

    def cancel(self) -> None:
        """End the task."""
        import ray

        ray.cancel(self.reference, force=True)


def wait_for_any(futures: Sequence[Any]) -> Sequence[Any]:
    """Return futures that are done, and wait for one."""
    if hasattr(futures[0], "hex"):  # of Ray
        import ray

        done, _ = ray.wait([future.reference for future in futures], num_returns=1)
        return [future for future in futures if future.reference in done]
    if type(futures[0]).__module__.startswith("distributed"):
        import distributed

        return list(distributed.wait([*futures], return_when="FIRST_COMPLETED").done)
    return list(wait(futures, return_when=FIRST_COMPLETED).done)


def is_lost(error: Exception) -> bool:
    """Return whether an error means that the scheduler is lost."""
    return not _LOST.isdisjoint(kind.__name__ for kind in type(error).__mro__)


_LOST: Final = frozenset(
    ["CancelledError", "FutureCancelledError", "CommClosedError", "RaySystemError"]
)
"""The names of errors of Dask and Ray without a scheduler."""
