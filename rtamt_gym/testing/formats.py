"""The contract of a format of recorded traces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.event_rows import read_events
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.trace import Trace, read_trace
from rtamt_gym.testing.claims import claim

__all__ = ["ColumnTable", "check_trace_format"]

ColumnTable = Mapping[str, NDArray[Any]]
"""Columns by name; the first is ``time``, in seconds."""

_N = 50
_PERIOD = 1 / 8
_EMPTY = (3, 4, 9)


def check_trace_format(
    extension: str, write: Callable[[Path, ColumnTable], object], folder: Path, *, gaps: bool = True
) -> None:
    """Checks that files of an extension are read as the formats of this package are.

    A trace comes back to the last bit, column by column, with its period and as events of dense
    time; a column that is not there, an empty cell and a file of another format are refused by
    name, and empty cells are held or dropped where that is asked for.

    Args:
        extension: The end of the names of such files, such as ``".npz"``.
        write: Writes a table to a path; nan is an empty cell.
        folder: Where to write, such as pytest's ``tmp_path``.
        gaps: Whether the format has empty cells.

    Raises:
        AssertionError: If the contract is not kept.
        InputError: If there is no format of this extension.

    Example:
        >>> import tempfile
        >>> def write(path, table):
        ...     np.savez(path, **table)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     check_trace_format(".npz", write, Path(folder))
    """
    table = {
        "time": np.arange(_N) * _PERIOD,
        "speed": np.sin(np.arange(_N)),
        "gear": np.arange(_N) % 5,
    }
    path = folder / f"Trace{extension}"
    write(path, table)
    _check_whole(path, table)
    with open_recording(str(path)) as recording:
        said = _refusal(lambda: read_trace(recording, ["sped"]))
    claim("'sped'" in said, f"expected an error that names the column 'sped', got {said!r}")
    if gaps:
        path = folder / f"gaps{extension}"
        column = table["speed"].copy()
        column[list(_EMPTY)] = np.nan
        write(path, {**table, "speed": column})
        _check_gaps(path, table)
    _check_others(folder, extension)


def _read(path: Path, *variables: str, missing: Any = "raise") -> Trace:  # noqa: ANN401
    columns = Columns(missing=missing)
    with open_recording(str(path), columns) as recording:
        return read_trace(recording, variables, columns)


def _check_whole(path: Path, table: ColumnTable) -> None:
    for names in (["gear", "speed"], ["speed"]):
        trace = _read(path, *names)
        claim(trace.samples == _N, f"expected {_N} samples of {path.name}, got {trace.samples}")
        claim(list(trace.columns) == names, f"expected {names}, got {list(trace.columns)}")
        for name, values in trace.columns.items():
            claim(values.dtype == np.float64, f"expected {name} as doubles, got {values.dtype}")
            _same(values, table[name], f"column {name!r} of {path.name}")
        period = trace.period()
        claim(period == _PERIOD, f"expected a period of {_PERIOD} s, got {period}")
        claim(not trace.notes, f"expected no notes on a whole trace, got {list(trace.notes)}")
    with open_recording(str(path)) as recording:
        times, values = read_events(recording, ["speed"]).signals["speed"]
    _same(times, table["time"], f"the times of events of {path.name}")
    _same(values, table["speed"], f"the events of {path.name}")


def _check_gaps(path: Path, table: ColumnTable) -> None:
    said = _refusal(lambda: _read(path, "speed", "gear"))
    for words in (path.name, "column 'speed'", "--missing hold"):
        claim(words in said, f"expected an error about an empty cell with {words!r}, got {said!r}")
    held = table["speed"].copy()
    for row in _EMPTY:
        held[row] = held[row - 1]
    whole = _read(path, "speed", "gear", missing="hold").columns
    _same(whole["speed"], held, "empty cells that hold")
    kept = np.delete(np.arange(_N), _EMPTY)
    dropped = _read(path, "speed", "gear", missing="drop").columns
    _same(dropped["gear"], table["gear"][kept], "rows without those that have an empty cell")
    with open_recording(str(path)) as recording:
        times, _ = read_events(recording, ["speed", "gear"]).signals["speed"]
    _same(times, table["time"][kept], "the times of events without empty cells")


def _check_others(folder: Path, extension: str) -> None:
    try:
        _read(folder / f"absent{extension}", "speed")
        claim(
            holds=False, what=f"expected OSError where there is no file of {extension}, got a trace"
        )
    except OSError:
        pass
    path = folder / f"noise{extension}"
    path.write_bytes(bytes(range(128, 256)) * 8)
    said = _refusal(lambda: _read(path, "speed"))
    claim(path.name in said, f"expected an error that names {path.name}, got {said!r}")


def _refusal(call: Callable[[], object]) -> str:
    """The message of the error that a call must raise."""
    try:
        call()
    except InputError as error:
        return str(error)
    except Exception as error:
        raise AssertionError(f"expected InputError, got {type(error).__name__}: {error}") from error
    raise AssertionError("expected InputError, got none")


def _same(found: NDArray[Any], expected: NDArray[Any], what: str) -> None:
    same = len(found) == len(expected) and np.array_equal(found, expected)
    claim(same, f"expected {what} as they were written, {expected[:12]}..., got {found[:12]}...")
