"""Parquet files of records: a row for each simulation; the shapes of waveforms as metadata."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from rtamt import InputError
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.ranges import Parameter, Signal
from rtamt_gym.inputs.space import Space
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.results.fingerprint import Mixture, Reuse
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.runs.files import finished

__all__ = ["holds_run", "load", "read_space", "save", "written_space"]

_KEY = b"rtamt.record"
"""The key of the file's metadata under which all is kept that is no cell, as JSON."""

_TYPES: Final = {"number": pa.float64(), "whole": pa.int64(), "text": pa.string()}
"""The types of columns."""


def save(
    path: Path,
    columns: Mapping[str, list[Any]],
    kinds: Mapping[str, str],
    kept: Mapping[str, Any],
) -> None:
    """Writes a record.

    Args:
        path: The file.
        columns: The cells of each column.
        kinds: What they are, as `Record.kinds` says.
        kept: What is no cell, as JSON can write it: ``requirements`` and ``shapes``, and more.

    Raises:
        InputError: If the name of the file says that it is no Parquet file.
    """
    if path.suffix.lower() != ".parquet":
        raise InputError(
            f"cannot write {path}: expected a name that ends in .parquet, the format that holds "
            "all of a record; to_frame() has the columns for other formats"
        )
    arrays = {name: pa.array(cells, _TYPES[kinds[name]]) for name, cells in columns.items()}
    table = pa.table(arrays)
    pq.write_table(table.replace_schema_metadata({_KEY: json.dumps(kept)}), path)


def load(path: Path) -> tuple[list[Trial], dict[str, Any]]:
    """Reads the rows that `save` has written, and what it kept beside them.

    A folder gives the finished rows of its campaign.

    Raises:
        InputError: If the file does not hold a record.
    """
    if path.is_dir():
        rows_of, kept_too = finished(path, load)
        return [rows_of[number] for number in sorted(rows_of)], _of_folder(kept_too, path, rows_of)
    try:
        table = pq.read_table(path)
    except pa.ArrowInvalid as error:
        raise InputError(f"cannot read {path}: it is no Parquet file") from error
    metadata = table.schema.metadata or {}
    if _KEY not in metadata:
        raise InputError(
            f"{path} holds no record: only files that Record.save or Sweep.save has written do"
        )
    kept: dict[str, Any] = json.loads(metadata[_KEY])
    return [_row(cells, kept) for cells in table.to_pylist()], kept


def _of_folder(kept: dict[str, Any], path: Path, rows: Collection[int]) -> dict[str, Any]:
    """Return what a folder stores beside its rows, with what is known of their model."""
    unseen = kept.get("fingerprint", {}).get("unseen", ())
    mixtures = tuple(map(Mixture.read, kept.get("mixtures", ())))
    reuse = Reuse(str(path), len(rows), len(rows), mixtures, (), tuple(unseen))
    return {**kept, "reuse": reuse.plain()}


def holds_run(path: Path) -> bool:
    """Whether a Parquet file holds the samples of one run, as `Run.save` writes it."""
    try:
        return b"rtamt.run" in (pq.read_schema(path).metadata or {})
    except pa.ArrowInvalid as error:
        raise InputError(f"cannot read {path}: it is no Parquet file") from error


def written_space(space: Space) -> dict[str, Any]:
    """A space as JSON can write it; `read_space` reads it."""
    return {
        "duration": space.duration,
        "entries": [{"kind": type(each).__name__, **asdict(each)} for each in space],
    }


def read_space(kept: Mapping[str, Any]) -> Space:
    """Reads what `written_space` has written."""
    kinds: dict[str, Any] = {"Signal": Signal, "Parameter": Parameter}
    entries = [
        kinds[each["kind"]](**{key: value for key, value in each.items() if key != "kind"})
        for each in kept["entries"]
    ]
    return Space(entries, duration=kept["duration"])


def _row(cells: Mapping[str, Any], kept: Mapping[str, Any]) -> Trial:
    case: dict[str, float | Waveform] = {}
    for name, shape in kept["shapes"].items():
        if shape is None:
            if cells[name] is not None:
                case[name] = cells[name]
            continue
        values = [cells[f"{name}[{i}]"] for i in range(len(shape["times"]))]
        if values[0] is not None:
            case[name] = Waveform(shape["times"], values, shape["interpolation"])
    timed = kept.get("timed", True)  # version 1 does not say it
    return Trial.read(
        cells,
        Case(case),
        kept["requirements"],
        timed=timed,
        unconditional=kept.get("unconditional", ()),
    )
