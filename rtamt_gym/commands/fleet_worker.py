"""Judges a batch of files on a worker, in a process that a crash or a hang may end.

A file is read once: its bytes are hashed and judged from a private copy, unless it is too large for
that. Then its size and time are compared before and after.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NamedTuple

import rtamt
from rtamt import InputError
from rtamt_gym.checks.extras import names_extra
from rtamt_gym.commands.judging import judge_file, row_of
from rtamt_gym.commands.traces import TracesAsked
from rtamt_gym.play.loop import Task
from rtamt_gym.play.workers import Setup, run_chunk
from rtamt_gym.recorded.contained import LIMIT
from rtamt_gym.results.trial import Trial

COPIED: Final = 1 << 26
"""The bytes up to which a local file is judged from a copy in memory."""

_BLOCK: Final = 1 << 20


class Mark(NamedTuple):
    """The state of a file, which shows a change without opening it.

    Attributes:
        size: Its size in bytes.
        mtime: When it changed, in nanoseconds since 1970; -1 for a URL.
        etag: The version of a URL that its server states; empty for a local file.
    """

    size: int
    mtime: int
    etag: str


class KnownFile(NamedTuple):
    """The state and the hash of a file with a row in the folder of results."""

    mark: Mark
    sha256: str


FileTask = tuple[str, KnownFile | None]
"""A path, and the state of the file when it was judged; None before that."""

FileRow = dict[str, Any]
"""The row of a file; ``{"path": ..., "same": True}`` if the stored row is still valid."""


@dataclass(frozen=True)
class FleetJob:
    """The job for each file, and the version of rtamt that makes it."""

    request: TracesAsked
    verify: bool
    version: str

    def runner(self) -> FileRunner:
        """Return an object that judges files, in the process of a worker."""
        return FileRunner(self)


class FileRunner:
    """Judges files one after the other."""

    def __init__(self, job: FleetJob) -> None:
        self._job, self._copies = job, _Copies()

    def close(self) -> None:
        """Remove the copies."""
        self._copies.close()

    def run(self, tasks: Sequence[FileTask], *_: object, **__: object) -> Iterator[tuple[int, Any]]:
        """Yield the number of each task and the row of its file."""
        for i, (path, known) in enumerate(tasks):
            begin = time.perf_counter()
            row = _row(self._job, self._copies, path, known)
            yield i, row if "same" in row else {**row, "wall": time.perf_counter() - begin}


def version() -> str:
    """Return the part of the version that workers and coordinator must share."""
    return ".".join(rtamt.__version__.split(".")[:2])


def judge_batch(name: str, job: bytes, stated: str, tasks: Sequence[FileTask]) -> list[FileRow]:
    """Judge files in a watched process of this worker; return their rows.

    Args:
        name: The name of the run, whose process is used again.
        job: A pickled `FleetJob`.
        stated: The version of the coordinator.
        tasks: The files.
    """
    if stated != version():
        raise InputError(
            f"the worker on {platform.node()} has rtamt {rtamt.__version__}, and the coordinator "
            f"has {stated}. Install the same version on both."
        )
    largest = max((known.mark.size if known else _size(path) for path, known in tasks), default=0)
    setup = Setup(name, job, round(LIMIT + largest / 1e6, 1), threads=1, path=tuple(sys.path))
    numbered: Any = [Task(i, task, None) for i, task in enumerate(tasks)]  # type: ignore[arg-type]
    rows: dict[int, Any] = dict(run_chunk(setup, numbered))
    worker = f"{platform.node()}:{os.getpid()}"
    return [{**_plain(tasks[i][0], rows[i]), "worker": worker} for i in range(len(tasks))]


def _size(path: str) -> int:
    try:
        return 0 if "://" in path else Path(path).stat().st_size
    except OSError:
        return 0


def _plain(path: str, row: FileRow | Trial) -> FileRow:
    """Return a row; if the process of the file ended, an error row."""
    if not isinstance(row, Trial):
        return row
    why = row.error.partition(": ")[2].replace("the run", "the reader", 1)
    try:
        mark = mark_of(path)
    except Exception:  # noqa: BLE001 - the reason of the row stays
        mark = Mark(-1, -1, "")
    return error_row(path, mark, f"{path}: {why.replace('the run', 'the reader')}", wall=row.wall)


def error_row(
    path: str, mark: Mark | None, error: str, *, retry: bool = False, wall: float = 0.0
) -> FileRow:
    """Return the row of a file that could not be judged."""
    return {
        "path": path,
        "mark": mark or Mark(-1, -1, ""),
        "sha256": "",
        "verdict": "failed",
        "error": error,
        "retry": retry,
        "wall": wall,
    }


def _files_of(path: str) -> tuple[Any, str]:
    """Return the file system of a URL, and the path in it."""
    fsspec = import_module("fsspec")
    system, place = fsspec.core.url_to_fs(path)
    return system, place


def mark_of(path: str) -> Mark:
    """Return the state of a file; raise OSError if it does not exist."""
    if "://" not in path:
        status = Path(path).stat()
        return Mark(status.st_size, status.st_mtime_ns, "")
    system, place = _files_of(path)
    system.invalidate_cache()
    info = system.info(place)
    stated = (info.get(key) for key in ("ETag", "etag", "mtime", "LastModified", "created"))
    return Mark(int(info.get("size") or 0), -1, str(next(filter(None, stated), "")))


def exists(path: str) -> bool:
    """Return whether a file exists; True if its file system cannot be reached."""
    try:
        mark_of(path)
    except FileNotFoundError:
        return False
    except Exception:  # noqa: BLE001 - whatever a file system raises without a network
        return True
    return True


def _row(job: FleetJob, copies: _Copies, path: str, known: KnownFile | None) -> FileRow:
    """Return the row of a file."""
    mark: Mark | None = None
    try:
        mark = mark_of(path)
        same = known is not None and known.mark == mark
        if same and not job.verify:
            return {"path": path, "same": True}
        with copies.copied(path, mark) as (copy, sha256):
            if known is not None and same and known.sha256 == sha256:
                return {"path": path, "same": True}
            row = _judged(job, path, copy)
        if copy == path and mark_of(path) != mark:
            return error_row(path, mark, f"{path}: it changed while it was judged", retry=True)
    except Exception as error:  # noqa: BLE001 - one file; the others are to be judged
        # A file that cannot be opened now may be there next time.
        text = f"{path}: {type(error).__name__}: {error}"
        return error_row(path, mark, text, retry=True)
    return {**row, "path": path, "mark": mark, "sha256": sha256}


class _Copies:
    """A folder for private copies of files, in memory where there is such a folder.

    A process that is killed leaves its folder behind; the next one removes it.
    """

    def __init__(self) -> None:
        memory = Path("/dev/shm")  # noqa: S108 - the names below are unique
        self._root = memory if os.access(memory, os.W_OK) else Path(tempfile.gettempdir())
        self._remove_left()
        self.folder = Path()
        self._lock = -1
        while not self.folder.name or not self.folder.exists():
            self.folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=self._root))
            self._lock = os.open(self.folder, os.O_RDONLY)
            fcntl.flock(self._lock, fcntl.LOCK_EX)

    def close(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)
        os.close(self._lock)

    def _remove_left(self) -> None:
        for folder in self._root.glob(f"{_PREFIX}*"):
            with suppress(OSError):
                opened = os.open(folder, os.O_RDONLY)
                try:
                    fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(folder, ignore_errors=True)
                finally:
                    os.close(opened)

    @contextmanager
    def copied(self, path: str, mark: Mark) -> Iterator[tuple[str, str]]:
        """Yield the path of a copy of a file, or its own path, and the hash of its bytes."""
        file, local = Path(path), "://" not in path
        data = _read(file, mark) if local else None
        if local and data is None:
            yield path, _hash(file)
            return
        copy, hashed = self.folder / file.name, hashlib.sha256()
        try:
            if data is not None:
                hashed.update(data)
                copy.write_bytes(data)
            else:
                system, place = _files_of(path)
                with system.open(place, "rb") as source, copy.open("wb") as target:
                    while block := source.read(_BLOCK):
                        hashed.update(block)
                        target.write(block)
            yield str(copy), hashed.hexdigest()
        finally:
            copy.unlink(missing_ok=True)


_PREFIX: Final = "rtamt-files-"


def _read(file: Path, mark: Mark) -> bytes | None:
    """Return the bytes of a local file; None for a folder, and for a file that is too large."""
    with suppress(IsADirectoryError):
        return None if mark.size > COPIED else file.read_bytes()
    return None


def _hash(path: Path) -> str:
    """Return the hash of a file, or of all files in a folder."""
    hashed = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if file.is_file():
            with file.open("rb") as source:
                while block := source.read(_BLOCK):
                    hashed.update(block)
    return hashed.hexdigest()


def _judged(job: FleetJob, path: str, copy: str) -> FileRow:
    """Return the outcomes of a file that is read from a copy."""
    row = row_of(job.request, judge_file(job.request, copy, formulas=False), explain=())

    def named(text: str) -> str:
        return text if copy == path else text.replace(copy, path)

    cells: FileRow = {}
    for name in job.request.specs:
        outcome = row.outcomes.get(name)
        if outcome is None:
            cells[f"verdict({name})"] = "ERROR"
            continue
        cells[f"verdict({name})"] = outcome.verdict.name
        cells[f"robustness({name})"] = float(outcome.robustness)
        cells[f"lower({name})"] = float(outcome.lower)
        cells[f"upper({name})"] = float(outcome.upper)
        cells[f"triggers({name})"] = outcome.trigger_count
    errors = dict.fromkeys(failure.message for failure in row.failures.values())
    outside = [f"{name}: {text}" for name, text in row.outside.items()]
    return {
        "verdict": row.word,
        "error": named("\n".join(errors)),
        "retry": any(map(names_extra, errors)),
        "described": named(row.described).removeprefix(f"{path}: "),
        "notes": named("\n".join([*row.notes, *outside])),
        **cells,
    }


def pickled(job: FleetJob) -> bytes:
    """Return a job as bytes."""
    return pickle.dumps(job)
