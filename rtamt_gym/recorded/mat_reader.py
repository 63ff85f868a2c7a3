"""Reads recorded traces from files of MATLAB by SciPy, a vector for each column."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from scipy.io import loadmat

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.arrays import ArrayRecording, columns_in
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.foreign import refusing
from rtamt_gym.recorded.recording import Recording

__all__ = ["open_file"]


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Opens a file of MATLAB; a field of a structure is a column with a dotted name.

    Raises:
        InputError: If it is no such file, or of version 7.3, which SciPy does not read.
        OSError: If there is no such file.
    """
    with Path(path).open("rb") as file, refusing(path, "a whole MATLAB file"):
        try:
            data: dict[str, Any] = loadmat(file, simplify_cells=True)
        except NotImplementedError:
            raise InputError(
                f"{shown(path)}: expected a MATLAB file of version 7 or before, got 7.3; "
                "save it with save(..., '-v7')"
            ) from None
        own = {name: value for name, value in data.items() if not name.startswith("__")}
        arrays = dict(columns_in(own))
    yield ArrayRecording(path, arrays, decimal=columns.decimal)
