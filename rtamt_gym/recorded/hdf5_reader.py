"""Reads HDF5 files in the layout of robomimic by h5py: each demonstration is a trace."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.columns import unit_of_times
from rtamt.errors import shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.arrays import ArrayRecording
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import part_of
from rtamt_gym.recorded.readers import refusing
from rtamt_gym.recorded.recording import Recording, Rows, Wanted
from rtamt_gym.recorded.times import TIME
from rtamt_gym.tables import number

DEMO, MASK = "demo", "mask"
"""The key of a demonstration, and of the filters of robomimic that contain it."""

_WHOLE: Final = "a whole HDF5 file"
_LONGEST: Final = 1000
"""The most elements of a row that are columns."""


def traces_in(path: str) -> tuple[str, dict[str, dict[str, Sequence[str]]]]:
    """Return the key of demonstrations, and their names with the filters of each."""
    with _opened(path) as file, refusing(path, _WHOLE):
        demos = sorted(_demos(path, file), key=_natural)
        masks: dict[str, list[str]] = {name: [] for name in demos}
        group = file.get(MASK)
        for name in group if isinstance(group, h5py.Group) else ():
            for member in np.asarray(group[name]).astype(str).tolist():
                masks.setdefault(member, []).append(name)
    return DEMO, {name: {MASK: masks[name]} for name in demos}


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open a demonstration."""
    part = part_of(path)
    with _opened(path if part is None else part.file) as file:
        with refusing(path, _WHOLE):
            demos = _demos(path, file)
            if part is None or part.key != DEMO or part.value not in demos:
                raise InputError(
                    f"{shown(path)}: expected a demonstration; give --where {DEMO}=NAME, which is "
                    f"one of {listed(demos)}"
                )
            period = _period(path, file["data"])
            recording = DemoRecording(path, file["data"][part.value], period, columns)
        yield recording


class DemoRecording(Recording):
    """The arrays of a demonstration, and the column ``time`` if the control rate is known.

    An element of a row has the name ``obs.eef_pos[0]``. Images and arrays with more dimensions are
    not read.
    """

    def __init__(
        self, path: str, group: h5py.Group, period: Fraction | None, columns: Columns
    ) -> None:
        self.source, self._path, self._group = shown(path), path, group
        self._places: dict[str, tuple[str, int | None]] = {}
        group.visititems(self._visit)
        self._own = [name for name in self._places if unit_of_times(name) is not None]
        self._period, self._columns = period, columns
        self.names: Sequence[str] = [*self._places]
        if period is not None and not self._own:
            self.names = [TIME, *self._places]

    def _visit(self, name: str, item: object) -> None:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "biufSOU":
            return
        if item.external or item.is_virtual:  # its values are in other files
            return
        dotted = shown(name.replace("/", "."))
        if item.ndim == 1:
            self._places[dotted] = name, None
        elif item.ndim == 2 and item.shape[1] <= _LONGEST:
            self._places |= {f"{dotted}[{i}]": (name, i) for i in range(item.shape[1])}

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns."""
        where = {name: text for name, text in wanted.where.items() if name != MASK}
        wanted = replace(wanted, where=where)
        with refusing(self._path, _WHOLE):
            arrays = {name: self._array(name) for name in wanted.names if name in self._places}
            arrays = arrays or {name: self._array(name) for name in [*self._places][:1]}
        times = np.zeros(0)
        if TIME in self.names and TIME not in self._places and self._period is not None:
            count = max(map(len, arrays.values()), default=0)
            times = np.arange(float(count)) * self._period.numerator / self._period.denominator
            arrays = {TIME: times, **arrays}
        rows = ArrayRecording(self._path, arrays).read(wanted)
        if wanted.time == TIME and len(times) and not where:
            return replace(rows, unit="s", step=self._period)
        self._check_rate(wanted.time, rows)
        return rows

    def _array(self, name: str) -> NDArray[Any]:
        position, index = self._places[name]
        item = self._group[position]
        if h5py.check_string_dtype(item.dtype) is not None:
            return np.array(item.asstr()[()] if index is None else item.asstr()[:, index], str)
        return np.asarray(item[()] if index is None else item[:, index])

    def _check_rate(self, name: str | None, rows: Rows) -> None:
        """Check that a column of times has the control rate, unless ``--time`` names it."""
        if name is None or self._period is None or self._columns.time or rows.count < 2:
            return
        times = rows.times
        step = math.nan
        if times is not None and times.dtype.kind in "iuf":
            step = float(np.median(np.diff(times.astype(np.float64))))
        if not abs(step - float(self._period)) <= 0.01 * float(self._period):
            raise InputError(
                f"{self.source}: expected one time axis, got the column '{name}' with rows "
                f"{number(step)} apart and control_freq with {number(float(self._period))} s. "
                f"Give --time {name} to use the column."
            )


def _demos(path: str, file: h5py.File) -> list[str]:
    """Return the names of the demonstrations; links to other files are omitted."""
    demos = []
    if "data" in file and _is_group(file, "data"):
        demos = [name for name in file["data"] if _is_group(file["data"], name)]
    if not demos:
        raise InputError(
            f"{shown(path)}: expected the layout of robomimic, with a group for each demonstration "
            f"in 'data', got {listed([*file]) or 'an empty file'}"
        )
    return demos


def _is_group(parent: h5py.Group, name: str) -> bool:
    hard = isinstance(parent.get(name, getlink=True), h5py.HardLink)
    return hard and isinstance(parent[name], h5py.Group)


def _period(path: str, data: h5py.Group) -> Fraction | None:
    """Return the seconds between rows from the control rate of the environment, or None."""
    name = "env_args" if "env_args" in data.attrs else "env_info"  # of robomimic, of robosuite
    if name not in data.attrs:
        return None
    try:
        described = json.loads(data.attrs[name])
    except (TypeError, ValueError):
        raise InputError(f"{shown(path)}: expected JSON as {name} of 'data'") from None
    if name == "env_args" and isinstance(described, dict):
        described = described.get("env_kwargs", {})
    rate = described.get("control_freq") if isinstance(described, dict) else 0
    if rate is None:
        return None
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0 < rate < math.inf:
        raise InputError(
            f"{shown(path)}: expected a rate above 0 Hz as control_freq in {name}, got {rate!r}; "
            "give --period"
        )
    return 1 / Fraction(repr(rate))


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a sort key that puts ``demo_2`` before ``demo_10``."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", name)]


@contextmanager
def _opened(path: str) -> Iterator[h5py.File]:
    with Path(path).open("rb"):
        pass  # the error of h5py for a missing file has no name
    with refusing(path, _WHOLE):
        file = h5py.File(path, "r")
    with file:
        yield file
