"""Reads recorded traces from logs of PX4, ULog, by pyulog: a column for each field of a topic."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
from pyulog import ULog
from pyulog.exceptions import ULogException

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import refusing
from rtamt_gym.recorded.recording import Recording
from rtamt_gym.recorded.topics import TopicField, TopicRecording, cut_note, named_fields
from rtamt_gym.tables import counted, number

_STAMP = "timestamp"
_HEADER = 3
"""Bytes before every message of a log: how long it is, and its type."""


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open a log."""
    with Path(path).open("rb") as raw, refusing(path, "a ULog file"):
        file = _Bytes(raw)
        try:
            with redirect_stdout(io.StringIO()):  # pyulog also prints its messages
                log = ULog(file)
        except (ULogException, ValueError, LookupError) as error:
            why = str(error).partition("(")[2].rstrip(")") or str(error)
            raise InputError(f"{shown(path)}: expected a ULog file; {why}") from None
    if log.file_corruption:
        raise InputError(
            f"{shown(path)}: expected a complete ULog file; parts of it are not messages"
        )
    if not log.data_list:
        raise InputError(f"{shown(path)}: expected a ULog file with data; it holds none")
    notes = _dropouts(log)
    if file.cut:
        notes.append(cut_note(log.last_timestamp / 1e6))
    lines = [data.data[_STAMP] for data in log.data_list if _STAMP in data.data]
    yield TopicRecording(path, _fields(log), lines, notes, columns.same_time)


class _Bytes:
    """A file that records whether it ended within a read.

    pyulog reads the header of a message, then its rest, and closes the file.

    Attributes:
        cut: Whether the file ended within a read.
    """

    def __init__(self, raw: io.BufferedReader) -> None:
        self.cut = False
        self.seek, self.tell, self.close = raw.seek, raw.tell, raw.close
        self._read = raw.read

    def read(self, size: int) -> bytes:
        """Return the next bytes."""
        data = self._read(size)
        self.cut |= len(data) < size and not (size == _HEADER and not data)
        return data


def _fields(log: ULog) -> dict[str, TopicField]:
    """Return the fields of all topics by name."""
    instances: dict[str, dict[int, list[Any]]] = {}
    for data in log.data_list:
        instances.setdefault(data.name, {}).setdefault(data.multi_id, []).append(data)
    return named_fields(
        {
            topic: {instance: _joined(topic, parts) for instance, parts in several.items()}
            for topic, several in instances.items()
        }
    )


def _joined(topic: str, parts: Sequence[Any]) -> dict[str, TopicField]:
    """Return the fields of an instance; a logger may have subscribed to its topic several times."""
    parts = [part.data for part in parts if _STAMP in part.data]
    if not parts:
        return {}
    times = np.concatenate([part[_STAMP] for part in parts])
    # One part is checked in its own order; several parts may overlap.
    order = np.argsort(times, kind="stable") if len(parts) > 1 else np.arange(len(times))
    names = [name for name in parts[0] if name != _STAMP and all(name in part for part in parts)]
    return {
        name: TopicField(topic, times[order], np.concatenate([part[name] for part in parts])[order])
        for name in names
    }


def _dropouts(log: ULog) -> list[str]:
    """Return the notes on data that the autopilot could not write."""
    if not log.dropouts:
        return []
    total = sum(dropout.duration for dropout in log.dropouts)
    longest = max(log.dropouts, key=lambda dropout: dropout.duration)
    after = f"after {number(longest.timestamp / 1e6)} s"
    text = f"{number(total / 1e3)} s, {after}"
    if len(log.dropouts) > 1:
        text = (
            f"{counted(len(log.dropouts), 'time')}, {number(total / 1e3)} s in all, the longest "
            f"{number(longest.duration / 1e3)} s {after}"
        )
    return [f"the autopilot lost data: {text}; values hold meanwhile, unless --max-gap says less"]
