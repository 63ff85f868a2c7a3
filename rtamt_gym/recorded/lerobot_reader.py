"""Reads data sets of LeRobot, version 3: a folder with an episode for each trace."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.arrow_columns import floats_of
from rtamt_gym.recorded.arrow_reader import ArrowRecording, is_list, is_scalar
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import part_of
from rtamt_gym.recorded.readers import refusing
from rtamt_gym.recorded.recording import Floats, Recording, Rows, Wanted
from rtamt_gym.tables import number

EPISODE: Final = "episode_index"
_TASK, _TASK_INDEX, _TIME = "task", "task_index", "timestamp"

_TOLERANCE: Final = 1e-4
"""How far LeRobot lets a time lie off the frames, in seconds (its ``tolerance_s``)."""

_SLOWER: Final = 0.01
"""The part by which the usual step of the times may differ from the one of the frame rate."""


@dataclass(frozen=True, slots=True)
class _Episode:
    """An episode: its file, its number of rows and its tasks."""

    file: Path
    length: int
    tasks: Sequence[str]


@dataclass(frozen=True, slots=True)
class _DataSet:
    """The description of a data set.

    Attributes:
        period: Seconds between frames.
        features: The description of each column.
        episodes: The episodes by their index.
        tasks: The text of each task by its index.
    """

    period: Fraction
    features: Mapping[str, Mapping[str, Any]]
    episodes: Mapping[int, _Episode]
    tasks: Mapping[int, str]


def traces_in(path: str) -> tuple[str, dict[str, dict[str, Sequence[str]]]]:
    """Return the key column of episodes, and its texts with the tasks of each episode."""
    episodes = _data_set(path).episodes.items()
    return EPISODE, {
        str(index): {_TASK: episode.tasks} if episode.tasks else {} for index, episode in episodes
    }


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open an episode of a data set."""
    part = part_of(path)
    data = _data_set(path if part is None else part.file)
    if part is None:
        raise InputError(
            f"{shown(path)}: expected an episode, got a data set without episodes"
            if not data.episodes
            else f"{shown(path)}: expected one trace, got {len(data.episodes)} episodes; give "
            f"--where {EPISODE}={next(iter(data.episodes))}"
        )
    if part.key != EPISODE or not part.value.isdecimal() or int(part.value) not in data.episodes:
        raise InputError(
            f"{shown(path)}: expected an episode of the data set, got {part.key}={part.value}; it "
            f"has {len(data.episodes)} episodes"
        )
    yield LeRobotRecording(path, data, int(part.value), columns)


class LeRobotRecording(ArrowRecording):
    """The columns of an episode; ``task`` is the text of the task of each row.

    An element of a feature has the name ``observation.state[0]``, and also
    ``observation.state.shoulder_pan.pos`` if the data set names its elements.
    """

    def __init__(self, path: str, data: _DataSet, index: int, columns: Columns) -> None:
        self._data, self._index, self._columns = data, index, columns
        self._episode = episode = data.episodes[index]
        schema = _schema(str(episode.file), _stamps([episode.file]))
        fields = [field for field in schema if is_list(field.type) or is_scalar(field.type)]
        lists = [field.name for field in fields if is_list(field.type)]
        lengths = {name: _length(episode.file, name, data.features.get(name)) for name in lists}
        if data.tasks and _TASK_INDEX in schema.names and _TASK not in schema.names:
            fields.append(pa.field(_TASK, pa.string()))
        super().__init__(fields, self._rows, path, "s", lengths, None)
        for name, count in lengths.items():
            for i, element in enumerate(_element_names(data.features[name])[:count]):
                position = shown(f"{name}.{element}")
                if position not in self._places:
                    self._places[position] = name, schema.field(name).type.value_type, i
        self.names = [*self._places]

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns; times that agree with the frame rate are made exact."""
        rows = super().read(wanted)
        times = rows.times
        if times is None or wanted.time != _TIME or wanted.where.keys() - {EPISODE, _TASK}:
            return rows
        since = times.astype(np.float64) - float(times[0])
        frames = _frames(len(since), self._data.period)
        if np.isfinite(since).all() and float(np.abs(since - frames).max()) <= _TOLERANCE:
            return replace(rows, times=float(times[0]) + frames, step=self._data.period)
        self._check_rate(since)
        return rows

    def _check_rate(self, since: Floats) -> None:
        """Check that the times have the frame rate of the data set, apart from single gaps."""
        step = float(np.median(np.diff(since))) if len(since) > 1 else math.nan
        period = float(self._data.period)
        if self._columns.time is None and abs(step - period) > _SLOWER * period:
            raise InputError(
                f"{self.source}: expected frames {number(period)} s apart, by the fps in "
                f"meta/info.json, got rows {number(step)} s apart in the column '{_TIME}'. Give "
                f"--time {_TIME} to use the column, or correct fps."
            )

    def _rows(self, names: list[str]) -> pa.Table:
        """Return some columns of the episode."""
        stored = [_TASK_INDEX if name == _TASK else name for name in names]
        table, starts = _columns_of(
            *(str(self._episode.file), tuple(dict.fromkeys(stored))), _stamps([self._episode.file])
        )
        start, count = starts.get(self._index, (0, 0))
        if count != self._episode.length:
            raise InputError(
                f"{self.source}: expected {self._episode.length} rows in one piece, by "
                f"meta/episodes, got {count} in {shown(str(self._episode.file))}"
            )
        part = table.slice(start, count)
        for name in self._lengths.keys() & {*part.column_names}:
            wrong = pc.not_equal(pc.list_value_length(part[name]), self._lengths[name])
            if pc.any(wrong).as_py():
                row = wrong.to_pylist().index(True)
                raise InputError(
                    f"{self.source}, row {row + 1}, column '{name}': expected a list of "
                    f"{self._lengths[name]}, by meta/info.json, got {len(part[name][row])}"
                )
        if _TASK in names:
            tasks = self._data.tasks
            texts = [tasks.get(index) for index in part[_TASK_INDEX].to_pylist()]
            part = part.append_column(_TASK, pa.array(texts, pa.string()))
        return part.select(names)


def _frames(count: int, period: Fraction) -> Floats:
    """Return the times of frames in seconds since the first."""
    return np.arange(float(count)) * period.numerator / period.denominator


def _length(file: Path, name: str, feature: Mapping[str, Any] | None) -> int:
    """Return the number of elements in a column of lists, from the description of the data set."""
    shape = None if feature is None else feature.get("shape")
    if not (isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int)):
        raise InputError(
            f"{shown(str(file))}, column '{name}': expected a feature with a shape of one number "
            f"in meta/info.json, got {shape!r}"
        )
    return shape[0]


def _element_names(feature: Mapping[str, Any]) -> list[str]:
    """Return the names of the elements of a feature; an empty list for a feature without names.

    They are a list, an object with a list under its only key, or an object of indices.
    """
    names = feature.get("names")
    if isinstance(names, dict) and len(names) == 1 and isinstance(next(iter(names.values())), list):
        (names,) = names.values()
    if isinstance(names, dict) and sorted(map(str, names.values())) == sorted(
        map(str, range(len(names)))
    ):
        names = sorted(names, key=names.__getitem__)
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return []
    return names if len({*names}) == len(names) else []


def _data_set(path: str) -> _DataSet:
    """Return the description of a data set; read it again if its files change."""
    files = [Path(path) / "meta/info.json", *sorted(Path(path).glob("meta/**/*.parquet"))]
    return _described(path, _stamps(files))


_Stamps = tuple[tuple[int, int], ...]


def _stamps(files: Sequence[Path]) -> _Stamps:
    """Return the sizes and the times of files, to detect changes."""
    return tuple((stat.st_size, stat.st_mtime_ns) for stat in (file.stat() for file in files))


@lru_cache(maxsize=4)
def _described(path: str, stamps: _Stamps) -> _DataSet:
    del stamps
    folder, where = Path(path), shown(f"{path}/meta/info.json")
    with refusing(f"{path}/meta/info.json", "the description of a LeRobot data set"):
        info = json.loads((folder / "meta/info.json").read_text(encoding="utf-8"))
    if not isinstance(info, dict) or not isinstance(info.get("features"), dict):
        raise InputError(f"{where}: expected the features of a LeRobot data set, got none")
    version = info.get("codebase_version")
    if not str(version).startswith("v3."):
        raise InputError(
            f"{where}: expected codebase_version v3.0, got {version!r}. Convert the data set with "
            "LeRobot, or judge the files in its folder data as tables."
        )
    fps = info.get("fps")
    if isinstance(fps, bool) or not isinstance(fps, int | float) or not 0 < fps < math.inf:
        raise InputError(f"{where}: expected frames per second as fps, got {fps!r}")
    features = {
        name: feature for name, feature in info["features"].items() if isinstance(feature, dict)
    }
    template = info.get("data_path") or _DATA
    return _DataSet(1 / Fraction(repr(fps)), features, _episodes(folder, template), _tasks(folder))


_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"


def _episodes(folder: Path, template: str) -> dict[int, _Episode]:
    files = sorted(folder.glob("meta/episodes/*/*.parquet"))
    if not files:
        raise InputError(f"{shown(str(folder))}: expected Parquet files in meta/episodes, got none")
    names = [EPISODE, "length", "data/chunk_index", "data/file_index"]
    episodes = {}
    for file in files:
        table = _table(str(file), [*names, "tasks"])
        if {*names} - {*table.column_names}:
            raise InputError(
                f"{shown(str(file))}: expected the columns {', '.join(names)}, got "
                f"{', '.join(table.column_names) or 'none of them'}"
            )
        tasks = table["tasks"].to_pylist() if "tasks" in table.column_names else []
        rows = zip(*(table[name].to_pylist() for name in names), strict=True)
        for row, (index, length, chunk, number_) in enumerate(rows):
            with refusing(str(folder / "meta/info.json"), "the path of a data file as data_path"):
                path = PurePosixPath(template.format(chunk_index=chunk, file_index=number_))
            if path.is_absolute() or ".." in path.parts:
                raise InputError(
                    f"{shown(str(folder))}: expected data_path below the folder, got {template!r}"
                )
            episodes[index] = _Episode(folder / path, length, tasks[row] or () if tasks else ())
    return dict(sorted(episodes.items()))


def _tasks(folder: Path) -> dict[int, str]:
    """Return the text of each task; it is the only column of texts, whatever its name."""
    file = folder / "meta/tasks.parquet"
    if not file.exists():
        return {}
    table = _table(str(file))
    with refusing(str(file), "a whole Parquet file"):
        texts = [
            f.name
            for f in table.schema
            if pa.types.is_string(f.type) or pa.types.is_large_string(f.type)
        ]
        return dict(zip(table[_TASK_INDEX].to_pylist(), table[texts[0]].to_pylist(), strict=True))


def _table(file: str, names: Sequence[str] | None = None) -> pa.Table:
    """Return some columns of a file; missing names are omitted."""
    # pq.read_table would import pandas.
    with refusing(file, "a whole Parquet file"), pq.ParquetFile(file) as opened:
        known = opened.schema_arrow.names
        wanted = None if names is None else [name for name in names if name in known]
        return opened.read(columns=wanted)


@lru_cache(maxsize=8)
def _schema(file: str, stamps: _Stamps) -> pa.Schema:
    """Return the names and types of the columns of a file."""
    del stamps
    with refusing(file, "a whole Parquet file"), pq.ParquetFile(file) as opened:
        return opened.schema_arrow


@lru_cache(maxsize=2)
def _columns_of(
    file: str, names: tuple[str, ...], stamps: _Stamps
) -> tuple[pa.Table, dict[int, tuple[int, int]]]:
    """Return columns of a file, and the first row and the number of rows of each episode.

    The number is 0 for an episode with separated rows.
    """
    del stamps
    table = _table(file, [*dict.fromkeys((*names, EPISODE))])
    with refusing(file, "a whole Parquet file"):
        index = floats_of(table[EPISODE]).astype(np.int64)
    values, first, counts = np.unique(index, return_index=True, return_counts=True)
    starts = {}
    for value, start, count in zip(values.tolist(), first.tolist(), counts.tolist(), strict=True):
        together = bool((index[start : start + count] == value).all())
        starts[value] = start, count if together else 0
    return table, starts
