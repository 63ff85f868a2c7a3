"""CSV files of samples or events, in the format that ``rtamt monitor`` reads."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import numpy as np

from rtamt import InputError


class CsvRecord:
    """A file for each run of a monitor: ``run.csv``, ``run-2.csv``, ``run-3.csv``.

    Numbers of existing files are skipped. Times are dates of the ROS clock, to the nanosecond. If a
    file cannot be written, the record ends and the monitor continues.

    Args:
        path: The file of the first run.
        columns: The columns after the time.
        companion: The columns after the time of a second file for each run, ``run-verdicts.csv``;
            empty for no second file.

    Raises:
        InputError: If the folder does not exist, or the path is a folder.

    Attributes:
        error: Why the record has ended; empty before.
    """

    def __init__(self, path: Path, columns: Sequence[str], companion: Sequence[str] = ()) -> None:
        if not path.parent.is_dir():
            raise InputError(f"record: there is no folder {path.parent}")
        if path.is_dir():
            raise InputError(f"record: expected a file, {path} is a folder")
        self._path = path
        self._columns = ("time", *columns)
        self._companion = companion
        self._verdicts: CsvRecord | None = None
        self._file: IO[str] | None = None
        self._write: Callable[[Sequence[object]], object] = _nowhere
        self.error = ""

    @property
    def path(self) -> Path:
        """The file of the next run."""
        numbered = (self._path.with_stem(f"{self._path.stem}-{n}") for n in itertools.count(2))
        paths = itertools.chain((self._path,), numbered)
        files = ((path, *self._second(path)) for path in paths)
        return next(path for path, *second in files if not any(map(Path.is_file, (path, *second))))

    def _second(self, path: Path) -> list[Path]:
        """Return the second file of a run, if there is one."""
        return [path.with_stem(f"{path.stem}-verdicts")] if self._companion else []

    def begin(self) -> None:
        """Start the file of the next run."""
        self.close()
        if self.error:
            return
        with self._ending():
            path = self.path
            self._file = path.open("w", encoding="utf-8", newline="")
            for second in self._second(path):
                self._verdicts = CsvRecord(second, self._companion)
                self._verdicts.begin()
            self._write = csv.writer(self._file, lineterminator="\n").writerow
            self._write(self._columns)

    def row(self, time: int, values: Iterable[object]) -> None:
        """Write a row with a time in nanoseconds."""
        with self._ending():
            self._write((f"{np.datetime64(time, 'ns')}Z", *values))

    def verdict(self, time: int, values: Iterable[object]) -> None:
        """Write a row of the second file."""
        if self._verdicts is not None:
            self._verdicts.row(time, values)
            self.error = self.error or self._verdicts.error

    def flush(self) -> None:
        """Write the rows to disk."""
        if self._verdicts is not None:
            self._verdicts.flush()
        if self._file is not None:
            with self._ending():
                self._file.flush()

    def close(self) -> None:
        """Close the file of this run."""
        if self._verdicts is not None:
            self._verdicts.close()
            self._verdicts = None
        file, self._file, self._write = self._file, None, _nowhere
        if file is not None:
            with self._ending():
                file.close()

    @contextmanager
    def _ending(self) -> Iterator[None]:
        """End the record if the system refuses to write."""
        try:
            yield
        except OSError as error:
            file, self._file, self._write = self._file, None, _nowhere
            self.error = self.error or f"{self._path}: {error.strerror or error}"
            with suppress(OSError):  # the buffer cannot be written either
                if file is not None:
                    file.close()


VERDICTS = "lower", "upper", "verdict"
"""The columns about the run up to a time; the verdict is -1, 0 or 1."""


def _nowhere(_row: Sequence[object]) -> None:
    """Ignore a row of a record that has ended."""
