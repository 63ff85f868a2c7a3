"""Reads floating car data of SUMO, XML, by expat: each vehicle, person or container is a trace."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.checks.names import listed
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.recorded.arrays import ArrayRecording
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import part_of
from rtamt_gym.recorded.readers import refusing
from rtamt_gym.recorded.recording import Floats, Recording, Rows, Wanted
from rtamt_gym.recorded.times import TIME, Grid, TimeAxis

ID, OBJECT = "id", "object"
"""The columns with the name of an object, and with its kind: vehicle, person or container."""

_ROOTS: Final = ("fcd-export", "emission-export")
_WHOLE: Final = "floating car data of SUMO (--fcd-output)"
_EXPECTED: Final = f"expected {_WHOLE}"

_Attributes = Mapping[str, str]


class _Objects(NamedTuple):
    """The objects of a file.

    Attributes:
        kinds: The kinds of each object, by its name; there are several if kinds share the name.
        names: The attributes of each kind.
        step: The distance of the steps in seconds, including steps without an object; None for
            uneven steps or a single step.
    """

    kinds: Mapping[str, Sequence[str]]
    names: Mapping[str, Sequence[str]]
    step: Fraction | None


class _Table(NamedTuple):
    """Columns of a file, with the rows of an object and kind next to each other.

    Attributes:
        columns: The cells of each column.
        empty: The empty cells of each column.
        rows: The first row and the number of rows of each object and kind.
    """

    columns: Mapping[str, NDArray[Any]]
    empty: Mapping[str, NDArray[np.bool_]]
    rows: Mapping[tuple[str, str], tuple[int, int]]


def traces_in(path: str) -> tuple[str, dict[str, dict[str, Sequence[str]]]]:
    """Return the key column of objects, and its texts with the kinds of each object."""
    return ID, {name: {OBJECT: kinds} for name, kinds in _objects(path, _stamp(path)).kinds.items()}


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open the rows of an object."""
    part = part_of(path)
    file = path if part is None else part.file
    objects = _objects(file, _stamp(file))
    if part is None or part.key != ID or part.value not in objects.kinds:
        names = listed([*objects.kinds], "" if part is None else part.value)
        raise InputError(
            f"{shown(path)}: expected an object, "
            + (f"got the file of {names}; give --where {ID}=NAME" if objects.kinds else "got none")
        )
    kinds = objects.kinds[part.value]
    kind = columns.where.get(OBJECT, kinds[0])
    if len(kinds) > 1 and OBJECT not in columns.where:
        raise InputError(
            f"{shown(path)}: expected one object, got a {' and a '.join(kinds)} of this name; give "
            f"{' or '.join(f'--where {OBJECT}={kind}' for kind in kinds)}"
        )
    if kind not in kinds:
        raise InputError(f"{shown(path)}: expected a {kind}, got a {kinds[0]}")
    yield SumoRecording(path, file, part.value, kind, objects.names[kind])


class SumoRecording(Recording):
    """The attributes of an object, and the column ``time``."""

    def __init__(
        self, path: str, file: str, name: str, kind: str, attributes: Sequence[str]
    ) -> None:
        self.source, self._path, self._file = shown(path), path, file
        self._name, self._kind = name, kind
        self.names: Sequence[str] = [TIME, OBJECT, *attributes]

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted attributes of the object."""
        stored = [name for name in wanted.names if name in self.names]
        table = _table(self._file, tuple(sorted(stored or [TIME])), _stamp(self._file))
        start, count = table.rows[self._name, self._kind]
        own = slice(start, start + count)
        arrays = {name: column[own] for name, column in table.columns.items()}
        empty = {name: cells[own] for name, cells in table.empty.items() if cells[own].any()}
        recording = ArrayRecording(self._path, arrays, None, None, empty)
        rows = recording.read(wanted)
        known = _objects(self._file, _stamp(self._file)).step
        return replace(rows, unit="s", step=known if wanted.time == TIME else None)


def _stamp(path: str) -> tuple[int, int]:
    stat = Path(path).stat()
    return stat.st_size, stat.st_mtime_ns


@lru_cache(maxsize=4)
def _objects(path: str, stamp: tuple[int, int]) -> _Objects:
    """Return the objects of a file in the order of their first rows."""
    del stamp
    kinds: dict[str, dict[str, None]] = {}
    names: dict[str, dict[str, None]] = {}

    def row(time: str, kind: str, attributes: _Attributes) -> None:
        del time
        kinds.setdefault(attributes[ID], {})[kind] = None
        known = names.setdefault(kind, {})
        if not attributes.keys() <= known.keys():
            known.update(dict.fromkeys(attributes))

    times: list[str] = []
    _parse(path, row, times)
    return _Objects(
        {name: [*several] for name, several in kinds.items()},
        {kind: [*known] for kind, known in names.items()},
        _step(path, times),
    )


def _step(path: str, texts: Sequence[str]) -> Fraction | None:
    """Return the distance of the steps of a file in seconds; None if they are uneven."""
    if len(texts) < 2:
        return None
    rows = Rows(
        {},
        {},
        len(texts),
        lambda row: f"{shown(path)}, step {row + 1}",
        shown(path),
        _seconds(path, texts),
        unit="s",
    )
    grid = Grid(TimeAxis.of(rows, TIME, Columns()), None)
    if grid.even:
        return grid.period
    return grid.fitted if grid.even_between_holes else None


@lru_cache(maxsize=1)
def _table(path: str, names: tuple[str, ...], stamp: tuple[int, int]) -> _Table:
    """Return some columns of a file."""
    del stamp
    cells: dict[str, list[str]] = {name: [] for name in names}
    places: dict[tuple[str, str], int] = {}
    owners: list[int] = []
    attributes_of = [(name, cells[name].append) for name in names if name not in (TIME, OBJECT)]
    times, objects = cells.get(TIME), cells.get(OBJECT)

    def row(time: str, kind: str, attributes: _Attributes) -> None:
        owners.append(places.setdefault((attributes[ID], kind), len(places)))
        if times is not None:
            times.append(time)
        if objects is not None:
            objects.append(kind)
        for name, append in attributes_of:
            append(attributes.get(name, ""))

    _parse(path, row)
    owner = np.array(owners, np.intp)
    order = np.argsort(owner, kind="stable")
    counts = np.bincount(owner, minlength=len(places))
    starts = np.cumsum(counts) - counts
    columns = {name: _cells(path, name, texts)[order] for name, texts in cells.items()}
    return _Table(
        columns,
        {name: np.array([not text for text in cells[name]], bool)[order] for name in cells},
        {key: (int(starts[index]), int(counts[index])) for key, index in places.items()},
    )


def _cells(path: str, name: str, texts: Sequence[str]) -> NDArray[Any]:
    """Return cells as numbers if all that are not empty are numbers, with nan in empty cells."""
    if name == TIME:
        return _seconds(path, texts)
    numbers = read_floats([text or "nan" for text in texts])
    return np.array(texts) if numbers is None else np.asarray(numbers, np.float64)


def _seconds(path: str, texts: Sequence[str]) -> Floats:
    """Return times in seconds; SUMO may write them as ``1:02:03:04.5``, days before hours."""
    read = read_floats(texts)
    if read is not None:
        return np.asarray(read, np.float64)
    seconds = []
    for text in texts:
        parts = read_floats(text.split(":"))
        if parts is None or len(parts) > 4:
            raise InputError(f"{shown(path)}: expected a time of a timestep, got {text!r}")
        scales = (86400.0, 3600.0, 60.0, 1.0)[-len(parts) :]
        seconds.append(sum(part * scale for part, scale in zip(parts, scales, strict=True)))
    return np.array(seconds)


_Row = Callable[[str, str, _Attributes], None]


def _parse(path: str, row: _Row, times: list[str] | None = None) -> None:
    """Call a function with the time, the kind and the attributes of each object of each step."""
    parser = expat.ParserCreate()
    level, time = 0, ""

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal level, time
        if level == 0 and tag not in _ROOTS:
            raise InputError(f"{shown(path)}: {_EXPECTED}, got XML with <{tag}>")
        if level == 1 and tag == "timestep":
            time = attributes.get("time", "")
            if time and times is not None:
                times.append(time)
        if level == 2:
            if ID not in attributes or not time:
                raise InputError(
                    f"{shown(path)}, line {parser.CurrentLineNumber}: {_EXPECTED}, got <{tag}> "
                    f"without {'a time' if ID in attributes else 'an id'}"
                )
            row(time, tag, attributes)
        level += 1

    def end(tag: str) -> None:
        nonlocal level
        del tag
        level -= 1

    def refuse(*declared: object) -> None:
        raise InputError(f"{shown(path)}: {_EXPECTED}, got the declaration of {declared[0]}")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = refuse
    opened = gzip.open if path.lower().endswith(".gz") else open
    with opened(path, "rb") as file, refusing(path, f"{_WHOLE} in whole"):
        parser.ParseFile(file)
