"""Reads recorded traces from archives that `numpy.savez` has written, an array for each column."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.arrays import ArrayRecording, columns_in
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.foreign import refusing
from rtamt_gym.recorded.recording import Recording

__all__ = ["open_file"]

_WHAT: Final = "an archive of numpy.savez, whose arrays are numbers"


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Opens an archive of arrays.

    Raises:
        InputError: If it is no such archive, or holds pickled objects.
        OSError: If there is no such file.
    """
    # Opened here, because NumPy leaves a file open that it cannot read.
    with Path(path).open("rb") as file, refusing(path, _WHAT):
        archive = np.load(file, allow_pickle=False)
        if isinstance(archive, np.ndarray):
            raise InputError(f"{shown(path)}: expected {_WHAT}")
        with archive:
            arrays = dict(columns_in({name: archive[name] for name in archive.files}))
    yield ArrayRecording(path, arrays, decimal=columns.decimal)
