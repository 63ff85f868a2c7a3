"""Reads recorded traces from measurements in MDF by asammdf, a channel for each column."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF

from rtamt.errors import shown
from rtamt_gym.recorded.arrays import ArrayRecording
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.foreign import refusing
from rtamt_gym.recorded.recording import Recording, Rows, Wanted
from rtamt_gym.recorded.times import TIME

__all__ = ["MdfRecording", "open_file"]


@contextmanager
def open_file(path: str, _columns: Columns) -> Iterator[Recording]:
    """Opens a measurement.

    Raises:
        InputError: If it is none.
        OSError: If there is no such file.
    """
    with Path(path).open("rb") as raw:
        with refusing(path, "a whole MDF file"):
            # As bytes of a file, because asammdf fails again when it closes a path it cannot read.
            file = MDF(raw)
            recording = MdfRecording(file, path)
        with file:
            yield recording


class MdfRecording:
    """The channels of a measurement, and the column ``time`` of the times at which one has a value.

    A channel that has no value at a time where another one has is an empty cell there. A sample
    that its invalidation bit marks as not valid, and one that is nan, holds no number.

    Args:
        file: The open file.
        source: Its name, for messages.
    """

    def __init__(self, file: MDF, source: str) -> None:
        self.source, self._path = shown(source), source
        self._file = file
        groups: list[Any] = file.groups
        self._places: list[tuple[str, int, int]] = [
            (shown(channel.name), group, index)
            for group, each in enumerate(groups)
            for index, channel in enumerate(each.channels)
            if index != file.masters_db.get(group)
        ]
        self.names: Sequence[str] = [TIME, *(name for name, _, _ in self._places)]
        self.dates: Sequence[str] = ()

    def read(self, wanted: Wanted) -> Rows:
        """Reads the wanted channels."""
        names = dict.fromkeys([*wanted.numbers, *wanted.texts])
        signals: dict[str, Any] = {}
        for name, group, index in self._places:
            if name in names or (not names and not signals):
                # Else invalid samples are left out, and the one before them seems to hold.
                with refusing(self._path, "a whole MDF file"):
                    signals[name] = self._file.get(
                        group=group, index=index, ignore_invalidation_bits=True
                    )
        times = np.unique(np.concatenate([s.timestamps for s in signals.values()] or [np.zeros(0)]))
        arrays, invalid = {TIME: times}, {}
        for name, signal in signals.items():
            samples = np.asarray(signal.samples)
            if samples.dtype.kind in "biuf":
                places = np.searchsorted(times, signal.timestamps)
                bits = signal.invalidation_bits
                wrong = np.isnan(samples.astype(np.float64))
                if bits is not None:
                    wrong |= np.asarray(bits, bool)
                values = np.full(len(times), np.nan)
                values[places] = np.where(wrong, np.nan, samples)
                samples = values
                invalid[name] = np.zeros(len(times), bool)
                invalid[name][places] = wrong
            arrays[name] = samples
        marked = ArrayRecording(self.source, arrays, invalid)
        return replace(marked.read(wanted), unit="s", sparse=True)
