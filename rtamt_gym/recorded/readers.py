"""The formats of recorded traces: one row for each, and one module that reads it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from importlib import import_module
from pathlib import Path

from rtamt import InputError
from rtamt_gym.recorded.recording import Recording

__all__ = ["READERS", "open_recording"]

READERS = {
    ".csv": "rtamt_gym.recorded.csv_reader",
    ".parquet": "rtamt_gym.recorded.parquet_reader",
}
"""For each extension of a file name the module that reads such files. Its function
``open_file(path)`` is a context manager that gives a `Recording`."""


@contextmanager
def open_recording(path: str) -> Iterator[Recording]:
    """Opens a file of recorded values with the reader of its extension.

    A name with another extension, or with none, is read as CSV; ``-`` is CSV on stdin.

    Raises:
        OSError: If there is no such file.
        InputError: If the file is not in the format of its reader.
        ModuleNotFoundError: If the reader needs a package that is not installed.
    """
    extension = Path(path).suffix
    reader = import_module(READERS.get(extension, READERS[".csv"]))
    opened: AbstractContextManager[Recording] = reader.open_file(path)
    try:
        with opened as recording:
            yield recording
    except UnicodeDecodeError:
        message = f"{'stdin' if path == '-' else path}: expected UTF-8 text"
        if path != "-" and extension not in READERS:
            message += f", or a name that ends in {' or '.join(READERS)}"
        raise InputError(message) from None
