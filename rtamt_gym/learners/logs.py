"""Logs of training: the metrics against steps, from CSV files and event files of TensorBoard.

To add a format: a row of `_READERS`.
"""

from __future__ import annotations

import csv
import struct
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.tables import counted

StepCurve = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Steps, which increase, and the value at each."""

_STEPS: Final = (
    *("time/total_timesteps", "global_step", "total_timesteps", "timesteps", "num_steps"),
    *("steps", "step"),
)
"""The columns of a CSV file that count the steps of training; the first that exists counts."""


@dataclass(frozen=True)
class TrainingLog:
    """The metrics of one training by key, as ``stl/satisfied``, and the folder of its log."""

    name: str
    curves: Mapping[str, StepCurve]


def training_logs(folder: Path, notes: list[str] | None = None) -> list[TrainingLog]:
    """Return the logs in a folder and in all folders in it, each folder with files as one log.

    Where a CSV file and an event file have one key, the CSV file counts. A link to a file or folder
    in the same folder, as W&B makes them, is not another log. Sentences about what is left out are
    appended to ``notes``.

    Raises:
        InputError: If the folder has no log, or no log has metrics of satisfaction.
    """
    if not folder.is_dir():
        raise InputError(f"{shown(str(folder))}: expected a folder with logs of training")
    logs, seen = list[TrainingLog](), 0
    notes = [] if notes is None else notes
    before = len(notes)
    folders = {folder, *(path for path in folder.rglob("*") if path.is_dir())}
    for subfolder in sorted(path for path in folders if not _is_link(path, folder)):
        curves: dict[str, StepCurve] = {}
        for pattern, read in _READERS.items():
            for path in sorted(p for p in subfolder.glob(pattern) if not _is_link(p, folder)):
                seen += 1
                curves = {**read(path, notes), **curves}
        metrics = {key: curve for key, curve in curves.items() if "stl/" in key and len(curve[0])}
        if metrics:
            logs.append(TrainingLog(str(subfolder), metrics))
    if not logs:
        reason = f"got {seen} without them" if seen else f"found no {' and no '.join(_READERS)}"
        raise InputError(
            f"{shown(str(folder))}: expected logs with metrics such as stl/satisfied, {reason}. "
            + (notes[before] if notes[before:] else _ADVICE)
        )
    return logs


def _is_link(path: Path, folder: Path) -> bool:
    """Return whether a path leads to another place in a folder."""
    root, real = folder.resolve(), path.resolve()
    return real != root / path.relative_to(folder) and real.is_relative_to(root)


def _of_csv(path: Path, notes: list[str]) -> dict[str, StepCurve]:
    """Read a CSV file with the metrics of one step in a row; cells may be empty."""
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.reader(file)
        lines = [(reader.line_num, row) for row in reader]
    names = lines[0][1] if lines else []
    metrics = {name for name in names if "stl/" in name}
    if not metrics:
        return {}
    counter = next((name for name in _STEPS if name in names), None)
    if fault := _fault_of_csv(names, counter, len(lines)):
        notes.append(f"{shown(str(path))}: left out, because {fault}")
        return {}
    column, points = names.index(counter or ""), defaultdict[str, list[tuple[float, float]]](list)
    bad: list[str] = []

    def number(line: int, name: str, cell: str) -> float | None:
        value = read_floats([cell]) if cell.strip() else None
        if value is None and cell.strip() and name in {counter, *metrics}:
            bad.append(f"line {line}, {shown(name)}: {shown(repr(cell))}")
        return None if value is None else value[0]

    for line, row in lines[1:]:
        step = number(line, names[column], row[column]) if column < len(row) else None
        for name, cell in zip(names, row, strict=False):
            value = number(line, name, cell) if step is not None else None
            if step is not None and value is not None:
                points[name].append((step, value))
    if bad:
        cells = counted(len(bad), "cell")
        notes.append(f"{shown(str(path))}: {cells} without a number left out, first {bad[0]}")
    return _curves(points)


def _fault_of_csv(names: Sequence[str], counter: str | None, rows: int) -> str:
    """Return why a CSV file with metrics has no curves; empty if it can have some."""
    if len(names) == 1 and ";" in names[0]:
        return "its cells are separated by ';'; separate them by ','"
    if counter is None:
        return f"no column counts steps; name one {' or '.join(map(repr, _STEPS[:2]))}"
    return "it has no rows below the names" if rows < 2 else ""


def _of_events(path: Path, _: list[str]) -> dict[str, StepCurve]:
    """Read the scalars of an event file of TensorBoard; a record that is cut off is left out."""
    points = defaultdict[str, list[tuple[float, float]]](list)
    data, start = path.read_bytes(), 0
    while start + 12 <= len(data):
        (length,) = struct.unpack_from("<Q", data, start)
        end = start + 12 + length
        if end + 4 > len(data):
            break
        step, summary = 0, b""
        for field, value in _fields(data[start + 12 : end]):
            if field == 2 and isinstance(value, int):
                step = value
            elif field == 5 and isinstance(value, bytes):
                summary = value
        for field, entry in _fields(summary):
            if field == 1 and isinstance(entry, bytes) and (scalar := _scalar(entry)):
                points[scalar[0]].append((float(step), scalar[1]))
        start = end + 4
    return _curves(points)


def _scalar(entry: bytes) -> tuple[str, float] | None:
    """Return the name and the value of an entry of a summary; None if it is not a number."""
    name, number = "", None
    for field, value in _fields(entry):
        if field == 1 and isinstance(value, bytes):
            name = value.decode("utf-8", "replace")
        elif field == 2 and isinstance(value, bytes) and len(value) == 4:
            (number,) = struct.unpack("<f", value)
        elif field == 8 and isinstance(value, bytes):
            number = _of_tensor(value)
    return None if number is None else (name, number)


def _of_tensor(tensor: bytes) -> float | None:
    """Return the only value of a tensor of floats; None for another tensor."""
    for field, value in _fields(tensor):
        if field in (4, 5) and isinstance(value, bytes) and len(value) == 4:
            return float(struct.unpack("<f", value)[0])
    return None


def _fields(message: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Yield the fields of a message of Protocol Buffers: numbers, and all others as bytes."""
    start = 0
    while start < len(message):
        key, start = _varint(message, start)
        match key & 7:
            case 0:
                number, start = _varint(message, start)
                yield key >> 3, number
                continue
            case 1:
                length = 8
            case 2:
                length, start = _varint(message, start)
            case 5:
                length = 4
            case _:
                return
        yield key >> 3, message[start : start + length]
        start += length


def _varint(message: bytes, start: int) -> tuple[int, int]:
    value = shift = 0
    while start < len(message):
        byte = message[start]
        value |= (byte & 127) << shift
        start, shift = start + 1, shift + 7
        if byte < 128:
            break
    return value, start


def _curves(points: Mapping[str, list[tuple[float, float]]]) -> dict[str, StepCurve]:
    """Return the points of each key as a curve; the last of several points at one step counts."""
    curves = {}
    for name, pairs in points.items():
        by_step = dict(sorted(pairs, key=lambda pair: pair[0]))
        curves[name] = np.array([*by_step]), np.array([*by_step.values()])
    return curves


_ADVICE: Final = "Log the metrics of rtamt_gym.learners.metrics with keys that start with stl/."

_READERS: Final[Mapping[str, Callable[[Path, list[str]], dict[str, StepCurve]]]] = {
    "*.csv": _of_csv,
    "events.out.tfevents.*": _of_events,
}
"""The readers of files by the pattern of their names; the first has priority."""
