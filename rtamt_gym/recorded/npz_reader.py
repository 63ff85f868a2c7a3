"""Reads recorded traces from archives that `numpy.savez` has written, an array for each column."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rtamt import InputError
from rtamt_gym.recorded.arrays import ArrayRecording, columns_in
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Recording

__all__ = ["open_file"]


@contextmanager
def open_file(path: str, _columns: Columns) -> Iterator[Recording]:
    """Opens an archive of arrays.

    Raises:
        InputError: If it is no such archive, or holds pickled objects.
        OSError: If there is no such file.
    """
    try:
        # Opened here, because NumPy leaves a file open that it cannot read.
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = dict(columns_in({name: archive[name] for name in archive.files}))
    except (ValueError, zipfile.BadZipFile, TypeError, EOFError):  # TypeError: an array alone
        raise InputError(
            f"{path}: expected an archive of numpy.savez, whose arrays are numbers"
        ) from None
    yield ArrayRecording(path, arrays)
