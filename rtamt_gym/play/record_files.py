"""The files of records: Parquet with a row for each simulation, and the folder of a campaign."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from rtamt import InputError
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.inputs.space import Parameter, Signal, Space
from rtamt_gym.results.provenance import Fingerprint, Mixture, Reuse, file_hash
from rtamt_gym.results.trial import Trial

CAMPAIGN: Final = "campaign.json"
"""Identifies the campaign of a folder."""

PARTS: Final = "part-*.parquet"
"""Finished runs, until all are finished: ``part-000001-0123456789abcdef.parquet`` and so on.

The name contains the first 16 digits of the SHA-256 of the file; names of older files do not.
"""

RECORD: Final = "record.parquet"
"""All runs, once the campaign is finished."""

_PART: Final = re.compile(r"part-(\d+)(?:-([0-9a-f]{16}))?\.parquet")

_REMOVE: Final = "remove it, and its runs are made again, or give another folder"

_OTHER: Final = "give another folder, or remove this one"

_KEY = b"rtamt.record"
"""The key of the file's metadata, which stores as JSON everything that is not a cell."""

_FIELDS: Final[dict[str, type]] = {
    "system": str,
    "requirements": dict,
    "also": dict,
    "identity": dict,
}
"""The required fields of ``campaign.json``."""


def save_record(
    path: Path,
    columns: Mapping[str, list[Any]],
    kinds: Mapping[str, str],
    metadata: Mapping[str, Any],
    what: str,
) -> None:
    """Write a record; `what` names the caller if pyarrow is missing."""
    pa, parquet = _pyarrow(what)
    if path.suffix.lower() != ".parquet":
        raise InputError(
            f"cannot write {path}: expected a name that ends in .parquet, the format that holds "
            "all of a record; to_frame() has the columns for other formats"
        )
    types = {"number": pa.float64(), "whole": pa.int64(), "text": pa.string()}
    arrays = {name: pa.array(cells, types[kinds[name]]) for name, cells in columns.items()}
    table = pa.table(arrays).replace_schema_metadata({_KEY: json.dumps(metadata)})
    parquet.write_table(table, path)


def load_record(path: Path, what: str) -> tuple[list[Trial], dict[str, Any]]:
    """Read rows and metadata of a file, or the finished rows of a campaign's folder."""
    pa, parquet = _pyarrow(what)
    if path.is_dir():
        rows, campaign = finished(path, what), read_campaign(path)
        return [rows[number] for number in sorted(rows)], _with_reuse(campaign, path, rows)
    try:
        table = parquet.read_table(path)
    except pa.ArrowInvalid as error:
        raise InputError(f"cannot read {path}: it is not a Parquet file") from error
    stored = table.schema.metadata or {}
    if _KEY not in stored:
        raise InputError(f"{path} is not a record: expected a file of Record.save or Sweep.save")
    metadata: dict[str, Any] = json.loads(stored[_KEY])
    return [_row(cells, metadata) for cells in table.to_pylist()], metadata


def holds_run(path: Path) -> bool:
    """Return whether a Parquet file stores one run, as `Run.save` writes it."""
    pa, parquet = _pyarrow("a file of runs")
    try:
        return b"rtamt.run" in (parquet.read_schema(path).metadata or {})
    except pa.ArrowInvalid as error:
        raise InputError(f"cannot read {path}: it is not a Parquet file") from error


def written_space(space: Space) -> dict[str, Any]:
    """Return a space as plain values for JSON; `read_space` is the inverse."""
    return {
        "duration": space.duration,
        "entries": [{"kind": type(entry).__name__, **asdict(entry)} for entry in space],
    }


def read_space(written: Mapping[str, Any]) -> Space:
    """Read a space that `written_space` wrote."""
    kinds: dict[str, Any] = {"Signal": Signal, "Parameter": Parameter}
    entries = [
        kinds[entry["kind"]](**{key: value for key, value in entry.items() if key != "kind"})
        for entry in written["entries"]
    ]
    return Space(entries, duration=written["duration"])


def part_name(number: int, path: Path) -> str:
    """Return the file name of a part, with the checksum of its content."""
    return f"part-{number:06d}-{file_hash(path)[:16]}.parquet"


def part_number(path: Path) -> int:
    """Return the number in the file name of a part."""
    return int(_match(path)[1])


def finished(path: Path, what: str) -> dict[int, Trial]:
    """Read the finished runs of a folder, by task number."""
    read_campaign(path)
    rows: dict[int, Trial] = {}
    for numbers, trials, _ in parts(path, what):
        rows |= zip(numbers, trials, strict=True)
    return rows


def parts(path: Path, what: str) -> Iterator[tuple[list[int], list[Trial], dict[str, Any]]]:
    """Yield the task numbers, the runs and the metadata of each file of finished runs.

    The file of a finished campaign comes first. A search that continues with a larger budget adds
    further files.
    """
    if (path / RECORD).exists():
        rows, also = _load_part(path / RECORD, what, _OTHER)
        yield list(range(len(rows))), rows, also
    for part in sorted(path.glob(PARTS)):
        checksum = _match(part)[2]
        _check_regular(part, _REMOVE)
        if checksum is not None and file_hash(part)[:16] != checksum:
            raise InputError(
                f"{part} is damaged: its content has not the checksum of its name; {_REMOVE}"
            )
        rows, also = _load_part(part, what, _REMOVE)
        tasks = also.get("tasks")
        if not isinstance(tasks, list) or len(tasks) != len(rows):
            raise InputError(f"{part} is damaged: it does not number its runs; {_REMOVE}")
        yield tasks, rows, also


def read_campaign(path: Path) -> dict[str, Any]:
    """Read the description of the campaign in a folder."""
    file = path / CAMPAIGN
    if file.exists():
        _check_regular(file, _OTHER)
    try:
        campaign: Any = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path} holds no campaign: there is no {CAMPAIGN} in it") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file} is damaged: {error}; {_OTHER}") from error
    for key, kind in _FIELDS.items():
        if not isinstance(campaign, dict) or not isinstance(campaign.get(key), kind):
            raise InputError(f"{file} is damaged: expected an object with {key!r}; {_OTHER}")
    try:
        Fingerprint.read(campaign.get("fingerprint"))
        list(map(Mixture.read, campaign.get("mixtures", ())))
    except (InputError, KeyError, TypeError) as error:
        raise InputError(
            f"{file} is damaged: expected a fingerprint and mixtures; {_OTHER}"
        ) from error
    result: dict[str, Any] = campaign
    return result


def _pyarrow(what: str) -> tuple[Any, Any]:
    """Import pyarrow and its Parquet module; an error names the extra that installs it."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ModuleNotFoundError as error:
        raise naming_extra(error, what, "search") from error
    return pa, pq


def _match(path: Path) -> re.Match[str]:
    match = _PART.fullmatch(path.name)
    if match is None:
        raise InputError(
            f"expected parts of a campaign as part-NUMBER-CHECKSUM.parquet, got {path}; {_REMOVE}"
        )
    return match


def _check_regular(path: Path, fix: str) -> None:
    """Raise InputError for a pipe, which would block a reader forever, or a device."""
    if not path.is_file():
        raise InputError(f"{path} is damaged: expected a regular file; {fix}")


def _load_part(path: Path, what: str, fix: str) -> tuple[list[Trial], dict[str, Any]]:
    _check_regular(path, fix)
    try:
        rows, metadata = load_record(path, what)
        also: dict[str, Any] = {**metadata["also"]}
    except Exception as error:  # reading a damaged file can raise anything
        reason = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise InputError(f"{path} is damaged: {reason}; {fix}") from error
    return rows, also


def _with_reuse(campaign: dict[str, Any], path: Path, rows: Collection[int]) -> dict[str, Any]:
    """Add known changes of the model to the description of a campaign."""
    unseen = campaign.get("fingerprint", {}).get("unseen", ())
    mixtures = tuple(map(Mixture.read, campaign.get("mixtures", ())))
    reuse = Reuse(str(path), len(rows), len(rows), mixtures, (), tuple(unseen))
    return {**campaign, "reuse": reuse.plain()}


def _row(cells: Mapping[str, Any], metadata: Mapping[str, Any]) -> Trial:
    case: dict[str, float | Waveform] = {}
    for name, shape in metadata["shapes"].items():
        if shape is None:
            if cells[name] is not None:
                case[name] = cells[name]
            continue
        values = [cells[f"{name}[{i}]"] for i in range(len(shape["times"]))]
        if values[0] is not None:
            case[name] = Waveform(shape["times"], values, shape["interpolation"])
    return Trial.read(
        cells,
        Case(case),
        metadata["requirements"],
        timed=metadata.get("timed", True),  # version 1 does not store it
        unconditional=metadata.get("unconditional", ()),
    )
