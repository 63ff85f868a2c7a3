"""Reads recorded traces from measurements in MDF by asammdf, a channel for each column."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from asammdf import MDF
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.arrays import ArrayRecording, at_instants, check_records
from rtamt_gym.recorded.columns import Columns, SameTime
from rtamt_gym.recorded.readers import refusing
from rtamt_gym.recorded.recording import Floats, Recording, Rows, Wanted
from rtamt_gym.recorded.times import (
    TIME,
    check_rising,
    common_instants,
    one_record,
)

_DOMAINS: Final[Mapping[int | None, str]] = {2: "angle", 3: "distance", 4: "row numbers"}
"""What the master channel of a group of MDF 4 may count other than time."""


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open a measurement."""
    with Path(path).open("rb") as raw:
        with refusing(path, "a whole MDF file"):
            # Pass an open file, because asammdf fails again when it closes an unreadable path.
            file = MDF(raw)
            recording = MdfRecording(file, path, columns.same_time)
        with file:
            yield recording


class MdfRecording(Recording):
    """The channels of a measurement, and the column ``time`` with the times of all values.

    If a channel has no value at a time of another channel, its cell is empty. A sample that is nan,
    or that its invalidation bit marks as invalid, holds no number. A channel with names of numbers
    holds the numbers.

    A channel name that occurs in several groups is also there as ``GROUP.NAME``, where the group is
    the name of its acquisition, or ``group3`` if the acquisitions of these groups have no unique
    names.
    """

    def __init__(self, file: MDF, source: str, same_time: SameTime | None = None) -> None:
        self.source, self._path = shown(source), source
        self._file, self._same_time = file, same_time
        groups: list[Any] = file.groups
        channels = [
            (shown(channel.name), group, index)
            for group, part in enumerate(groups)
            for index, channel in enumerate(part.channels)
            if index != file.masters_db.get(group)
        ]
        self._places = [*channels, *_qualified(channels, groups)]
        self.names: Sequence[str] = [TIME, *(name for name, _, _ in self._places)]

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted channels."""
        names = {name for name in wanted.names if name != TIME}
        signals: dict[str, Any] = {}
        notes: list[str] = []
        for name, group, index in self._places:
            if name in names or (not names and not signals):
                # Otherwise, asammdf omits invalid samples, and the sample before seems to hold.
                with refusing(self._path, "a whole MDF file"):
                    signals[name] = self._signal(name, group, index, notes)
        lines = [signal.times for signal in signals.values()]
        own = wanted.time in (None, TIME)
        times = common_instants([*lines, self._ends()] if wanted.ends and own else lines)
        arrays, invalid = at_instants(times, signals)
        rows = ArrayRecording(self.source, {TIME: times, **arrays}, invalid).read(wanted)
        check_records(rows, wanted)
        unit = rows.unit or ("s" if own else "")
        return replace(rows, unit=unit, sparse=True, notes=[*rows.notes, *notes])

    def _ends(self) -> Floats:
        """Return the first and the last time of all groups that have times and records."""
        masters = []
        for group in range(len(self._file.groups)):
            if self._other_master(group):
                continue
            with refusing(self._path, "a whole MDF file"):
                masters.append(np.asarray(self._file.get_master(group), np.float64))
        ends = [end for times in masters if len(times) for end in (times.min(), times.max())]
        return np.unique([min(ends), max(ends)] if ends else [])

    def _other_master(self, group: int) -> str:
        """Return the quantity on the axis of a group; empty for time."""
        index = self._file.masters_db.get(group)
        if index is None:
            return "nothing"
        master: Any = self._file.groups[group].channels[index]
        domain = _DOMAINS.get(getattr(master, "sync_type", None))
        return f"{domain} ('{shown(master.name)}')" if domain else ""

    def _signal(self, name: str, group: int, index: int, notes: list[str]) -> _Signal:
        """Read a channel; notes on it are appended."""
        if other := self._other_master(group):
            raise InputError(
                f"{self.source}, channel '{name}': expected records over time, got records over "
                f"{other}. Export the channel with times."
            )
        read = partial(self._file.get, group=group, index=index, ignore_invalidation_bits=True)
        signal = read()
        samples, times = np.asarray(signal.samples), np.asarray(signal.timestamps, np.float64)
        phrase = f"{self.source}, channel '{name}'"
        if samples.dtype.kind in "SUO":
            numbers = np.asarray(read(raw=True).samples)
            if numbers.dtype.kind in "biuf":
                notes.append(f"'{name}' names its values: the numbers behind the names are read")
                samples = numbers
        check_rising(times, phrase)
        if samples.dtype.kind not in "biuf":
            return _Signal(times, samples)
        values = samples.astype(np.float64)
        bits = signal.invalidation_bits
        if bits is not None:
            values[np.asarray(bits, bool)] = np.nan
        places = one_record(times, values, self._same_time, phrase, notes)
        return _Signal(times[places], values[places])


class _Signal(NamedTuple):
    """Samples of a channel; nan is a sample without a number."""

    times: Floats
    values: NDArray[Any]


def _qualified(
    channels: Sequence[tuple[str, int, int]], groups: Sequence[Any]
) -> Iterator[tuple[str, int, int]]:
    """Yield the channels that have the same name in several groups, with the group in the name."""
    counts = Counter(name for name, _, _ in channels)
    acquired = [shown(getattr(part.channel_group, "acq_name", "") or "") for part in groups]
    for name, group, index in channels:
        if counts[name] > 1:
            its = [acquired[other] for part, other, _ in channels if part == name]
            own = all(its) and len({*its}) == len(its)
            yield f"{acquired[group] if own else f'group{group}'}.{name}", group, index
