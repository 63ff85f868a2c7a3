"""The folder of a campaign: finished runs in small Parquet files, so that it can continue later.

A file with its final name is complete, whenever the program or the machine dies.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final, Self

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.record import (
    CAMPAIGN,
    PARTS,
    RECORD,
    Record,
    finished,
    part_name,
    part_number,
    parts,
    read_campaign,
)
from rtamt_gym.results.codec import plain, read_fields
from rtamt_gym.results.provenance import Fingerprint, Mixture, Reuse, check_unchanged
from rtamt_gym.results.trial import Trial

WRITING: Final = "writing-"
"""The prefix of the name of an incomplete file."""

_CALLER: Final = "a campaign with folder="
"""The feature that needs pyarrow, for messages."""


class LockedFolder:
    """A folder that one process at a time writes; a file with its final name is complete."""

    path: Path
    _lock: IO[str]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the lock, so that another process may use the folder."""
        self._lock.close()

    def _delete_unfinished(self) -> None:
        """Delete the files that a process left when it was killed."""
        for left in self.path.glob(f"{WRITING}*"):
            left.unlink()

    def _write(
        self,
        name: str,
        write: Callable[[Path], object],
        called: Callable[[Path], str] | None = None,
    ) -> None:
        """Write a file that gets its name when it is complete and on the disk."""
        unfinished = self.path / f"{WRITING}{name}"
        write(unfinished)
        to_disk(unfinished)
        unfinished.replace(self.path / (name if called is None else called(unfinished)))
        to_disk(self.path)


class Folder(LockedFolder):
    """The folder of one campaign, which one process at a time holds."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        identity: Mapping[str, Any],
        about: Mapping[str, Any],
        requirements: Mapping[str, str],
        system: str,
        fingerprint: Fingerprint,
        *,
        accept_changed: bool,
    ) -> None:
        self.path = Path(path)
        self._about = about
        self._requirements = requirements
        self._system = system
        self._fingerprint = fingerprint
        self._mixtures: tuple[Mixture, ...] = ()
        self._notes: list[str] = []
        same_campaign = self._check(json.loads(json.dumps(identity)))
        stored = self._compare(accept_changed=accept_changed) if same_campaign else None
        description: dict[str, Any] = {
            "system": system,
            "requirements": dict(requirements),
            "also": about,
            "identity": identity,
            "fingerprint": plain(fingerprint if stored is None else stored),
            "mixtures": plain(self._mixtures),
        }
        text = json.dumps(description, indent=1) + "\n"
        self.path.mkdir(parents=True, exist_ok=True)
        self._lock = locked(self.path)
        try:
            self._delete_unfinished()
            if stored is None:
                self._write(CAMPAIGN, lambda path: path.write_text(text, encoding="utf-8"))
            self._number = max(map(part_number, self.path.glob(PARTS)), default=0)
        except BaseException:
            self.close()
            raise

    def reuse(self, reused: int, total: int) -> Reuse:
        """Return the number of results from the folder, for the provenance of a record."""
        mixtures = self._mixtures if reused else ()
        notes, unseen = tuple(self._notes), self._fingerprint.unseen
        return Reuse(str(self.path), reused, total, mixtures, notes, unseen)

    def rows(self) -> dict[int, Trial]:
        """Return the finished runs, by task number."""
        return finished(self.path, _CALLER)

    def parts(self) -> Iterator[tuple[list[int], list[Trial], dict[str, Any]]]:
        """Yield the task numbers, the runs and the metadata of each file."""
        return parts(self.path, _CALLER)

    def add(self, rows: Sequence[tuple[int, Trial]], also: Mapping[str, Any] | None = None) -> None:
        """Write finished runs with their task numbers; a kill afterwards loses no run."""
        record = Record((row for _, row in rows), self._requirements, self._system)
        numbers = [number for number, _ in rows]
        self._number += 1
        self._write(
            "part.parquet",
            lambda path: record.write(path, _CALLER, {**(also or {}), "tasks": numbers}),
            lambda path: part_name(self._number, path),
        )

    def finish(self, record: Record, also: Mapping[str, Any] | None = None) -> None:
        """Replace the parts by one file of all runs, with further metadata."""
        metadata = {**self._about, **(also or {})}
        if also is not None or not (self.path / RECORD).exists():
            self._write(RECORD, lambda path: record.write(path, _CALLER, metadata))
        for part in self.path.glob(PARTS):
            part.unlink()

    def _check(self, identity: Mapping[str, Any]) -> bool:
        """Return whether the folder holds this campaign; raise InputError for other files."""
        if not self.path.exists():
            return False
        if not self.path.is_dir():
            raise InputError(
                "expected ", Argument("folder"), f" as a folder, got the file {self.path}"
            )
        if not (self.path / CAMPAIGN).exists():
            others = [path.name for path in self.path.iterdir() if not is_own(path.name)]
            if others:
                raise InputError(
                    "expected ",
                    Argument("folder"),
                    f" as a new folder or the folder of a campaign, got {self.path}, "
                    f"which holds {listing(sorted(others)[:3])}",
                )
            return False
        stored = read_campaign(self.path)["identity"]
        for key in dict.fromkeys([*identity, *stored]):
            if identity.get(key) != stored.get(key):
                raise InputError(
                    f"{self.path} holds another campaign: its {key} {differing(stored, key)}, not "
                    f"{short_text(identity.get(key))}; give another folder, or remove this one"
                )
        return True

    def _compare(self, *, accept_changed: bool) -> Fingerprint | None:
        """Return the stored fingerprint if it is unchanged; None if the new one must be stored."""
        stored, now = read_campaign(self.path), self._fingerprint
        self._mixtures = tuple(read_fields(Mixture, item) for item in stored.get("mixtures", ()))
        then = Fingerprint.read(stored.get("fingerprint"))
        changes = [] if then is None else then.changes(now)
        if then is not None and not changes:
            self._notes = then.notes(now)
            return then
        count = len(self.rows())
        if count:
            if not accept_changed:
                check_unchanged(str(self.path), changes, "give a new folder")
            self._mixtures += (Mixture(count, tuple(changes)),)
        return None


def digest(tasks: Iterable[tuple[Case, int | None]]) -> str:
    """Return a text that identifies the tasks."""
    hashed = hashlib.sha256()
    for case, seed in tasks:
        hashed.update(f"{case.to_json()} {seed}\n".encode())
    return hashed.hexdigest()[:32]


def locked(path: Path, activity: str = "the campaign") -> IO[str]:
    """Lock a folder; the system releases the lock however the process ends.

    The error about another process names the ``activity``.
    """
    name = path / "lock"
    try:
        opened = os.open(name, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError as error:
        if not name.is_symlink():
            raise
        raise InputError(f"expected a file as the lock of a folder, got the link {name}") from error
    if not stat.S_ISREG(os.fstat(opened).st_mode):
        os.close(opened)
        raise InputError(f"expected a file as the lock of a folder, got {name}")
    lock = os.fdopen(opened, "r+", encoding="utf-8")
    try:
        import fcntl
    except ModuleNotFoundError:  # not on Windows
        return lock
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        lock.close()
        raise InputError(
            f"another process runs {activity} in {path}; wait for it, or end it"
        ) from error
    return lock


def is_own(name: str) -> bool:
    """Return whether a file is the lock of a folder, or not written to its end."""
    return name == "lock" or name.startswith(WRITING)


def differing(identity: Mapping[str, Any], key: str) -> str:
    """Return the stored value of a key of an identity, for messages."""
    return f"is {short_text(identity[key])}" if key in identity else "is missing"


def short_text(value: Any) -> str:  # noqa: ANN401 - as in JSON
    """Return a value as short JSON, for messages."""
    text = json.dumps(value)
    return text if len(text) <= 200 else f"{text[:197]}..."


def to_disk(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    with suppress(OSError):  # a folder on Windows
        opened = os.open(path, os.O_RDONLY)
        try:
            os.fsync(opened)
        finally:
            os.close(opened)
