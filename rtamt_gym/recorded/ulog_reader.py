"""Reads recorded traces from logs of PX4, ULog, by pyulog: a column for each field of a topic."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pyulog import ULog
from pyulog.exceptions import ULogException

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.arrays import ArrayRecording, at_instants
from rtamt_gym.recorded.columns import Columns, SameTime
from rtamt_gym.recorded.readers import refusing
from rtamt_gym.recorded.recording import Recording, Rows, Wanted
from rtamt_gym.recorded.times import TIME, check_rising, one_record
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
            with redirect_stdout(io.StringIO()):  # pyulog prints what it says here too
                log = ULog(file)
        except (ULogException, ValueError, LookupError) as error:
            why = str(error).partition("(")[2].rstrip(")") or str(error)
            raise InputError(f"{shown(path)}: expected a ULog file; {why}") from None
    if log.file_corruption:
        raise InputError(f"{shown(path)}: expected a whole ULog file; bytes of it are no messages")
    if not log.data_list:
        raise InputError(f"{shown(path)}: expected a ULog file with data; it holds none")
    yield ULogRecording(log, path, columns.same_time, cut=file.cut)


class _Bytes:
    """A file that knows whether it ended within what was asked for.

    pyulog asks for the header of a message, and then for its rest; it closes what it has read.

    Attributes:
        cut: Whether it did.
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


class _Field(NamedTuple):
    """The values of a field, and the microseconds of each."""

    topic: str
    times: NDArray[np.uint64]
    values: NDArray[Any]


class ULogRecording(Recording):
    """The fields of a log's topics, and the column ``time`` of the times at which one has a value.

    A field is called ``topic.field``; where a topic has several instances, ``topic.0.field`` is the
    field of the first, and that name is there for a single one too. Times are seconds since the
    start of the autopilot. A field that has no value at a time where another one has is an empty
    cell there; one that is nan holds no number.

    Args:
        log: The log, read.
        source: The name of the file, for messages.
        same_time: Which of several different records of a field at one time counts; None: the last.
        cut: Whether the file ends within a message.
    """

    def __init__(
        self, log: ULog, source: str, same_time: SameTime | None = None, *, cut: bool = False
    ) -> None:
        self.source, self._same_time = shown(source), same_time or "last"
        self._fields = _fields(log)
        self._lines = [data.data[_STAMP] for data in log.data_list if _STAMP in data.data]
        self.names: Sequence[str] = [TIME, *self._fields]
        self._notes = _dropouts(log)
        if cut:
            self._notes.append(
                f"the log ends within a message, after {number(log.last_timestamp / 1e6)} s; what "
                "came before is read"
            )

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted fields."""
        names = [name for name in (*wanted.numbers, *wanted.texts) if name != TIME]
        fields = {name: self._fields[name] for name in names or list(self._fields)[:1]}
        ordered, notes = self._in_order(fields)
        lines = [name.times for name in ordered.values()]
        micros = np.unique(np.concatenate([*lines, *([self._ends()] if wanted.ends else [])]))
        arrays, invalid = at_instants(micros, {n: (f.times, f.values) for n, f in ordered.items()})
        rows = ArrayRecording(self.source, {TIME: micros / 1e6, **arrays}, invalid).read(wanted)
        return replace(rows, unit="s", sparse=True, notes=[*rows.notes, *self._notes, *notes])

    def _ends(self) -> NDArray[np.uint64]:
        """Return the first and the last time of all topics."""
        stamped = [times[times > 0] for times in self._lines]
        ends = [end for times in stamped if len(times) for end in (times.min(), times.max())]
        return np.array([min(ends), max(ends)], np.uint64)

    def _in_order(self, fields: Mapping[str, _Field]) -> tuple[dict[str, _Field], list[str]]:
        """Return the fields with times that increase, and what was left out for that."""
        ordered: dict[str, _Field] = {}
        left_out: dict[str, None] = {}
        notes: list[str] = []
        for name, (topic, times, values) in fields.items():
            stamped = _stamped(times)
            if not stamped.any():
                raise InputError(
                    f"{self.source}: expected records of {topic} with a time, got none"
                )
            check_rising(times[stamped] / 1e6, f"{self.source}, {topic}")
            micros, numbers = times[stamped], np.asarray(values[stamped], np.float64)
            places, note = one_record(micros, numbers, self._same_time, f"'{name}'", micros / 1e6)
            notes += filter(None, [note])
            ordered[name] = _Field(topic, micros[places], numbers[places])
            if not stamped.all():
                left = counted(int((~stamped).sum()), "record")
                left_out[f"{topic}: {left} without a time"] = None
        return ordered, [*notes, *([f"left out: {', '.join(left_out)}"] if left_out else [])]


def _stamped(times: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Return which records have a time of their own: 0 stands for none.

    The first record is at 0 if the next one follows within two usual steps: the log starts there.
    """
    stamped = times > 0
    if len(times) > 2 and stamped[1:].all():
        stamped[0] = times[0] > 0 or times[1] <= 2 * np.median(np.diff(times[1:].astype(float)))
    return stamped


def _fields(log: ULog) -> dict[str, _Field]:
    """Return the fields of all topics by name."""
    instances: dict[str, dict[int, list[Any]]] = {}
    for data in log.data_list:
        instances.setdefault(data.name, {}).setdefault(data.multi_id, []).append(data)
    fields = {}
    for topic, several in instances.items():
        for instance, parts in several.items():
            for name, field in _joined(topic, parts).items():
                if len(several) == 1:
                    fields[f"{topic}.{name}"] = field
                    fields[f"{topic}.{instance}.{name}"] = field
                else:
                    fields[f"{topic}.{instance}.{name}"] = field._replace(
                        topic=f"{topic}.{instance}"
                    )
    return {shown(name): field for name, field in fields.items()}


def _joined(topic: str, parts: Sequence[Any]) -> dict[str, _Field]:
    """Return the fields of an instance, whose topic a logger may have subscribed several times."""
    parts = [part.data for part in parts if _STAMP in part.data]
    if not parts:
        return {}
    times = np.concatenate([part[_STAMP] for part in parts])
    # One part is checked in its own order; several parts may overlap.
    order = np.argsort(times, kind="stable") if len(parts) > 1 else np.arange(len(times))
    names = [name for name in parts[0] if name != _STAMP and all(name in part for part in parts)]
    return {
        name: _Field(topic, times[order], np.concatenate([part[name] for part in parts])[order])
        for name in names
    }


def _dropouts(log: ULog) -> list[str]:
    """Return what is to say of data that the autopilot could not write."""
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
