"""The files in the folder of a campaign: which there are, and how they are read."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from rtamt import InputError
from rtamt_gym.results.fingerprint import Fingerprint, Mixture
from rtamt_gym.results.provenance import file_hash
from rtamt_gym.results.trial import Trial

__all__ = ["CAMPAIGN", "PARTS", "RECORD", "finished", "part_name", "part_number", "parts", "read"]

CAMPAIGN: Final = "campaign.json"
"""Says which campaign it is."""

PARTS: Final = "part-*.parquet"
"""Hold finished runs, ``part-000001-0123456789abcdef.parquet`` and so on, until all are over.

The name has the first 16 digits of the SHA-256 of the file; those of older files have none.
"""

_PART: Final = re.compile(r"part-(\d+)(?:-([0-9a-f]{16}))?\.parquet")

_REMOVE: Final = "remove it, and its runs are made again, or give another folder"

_OTHER: Final = "give another folder, or remove this one"

RECORD: Final = "record.parquet"
"""Holds all runs once the campaign is over."""


def part_name(number: int, path: Path) -> str:
    """The name of a part with a number, whose content a file has."""
    return f"part-{number:06d}-{file_hash(path)[:16]}.parquet"


def part_number(path: Path) -> int:
    """The number of a part.

    Raises:
        InputError: If its name is none of a part.
    """
    return int(_named(path)[1])


def _named(path: Path) -> re.Match[str]:
    named = _PART.fullmatch(path.name)
    if named is None:
        raise InputError(
            f"expected parts of a campaign as part-NUMBER-CHECKSUM.parquet, got {path}; {_REMOVE}"
        )
    return named


def finished(
    path: Path, load_file: Callable[[Path], tuple[list[Trial], dict[str, Any]]]
) -> tuple[dict[int, Trial], dict[str, Any]]:
    """Reads the finished runs by the numbers of their tasks, and what is kept with them.

    Args:
        path: The folder.
        load_file: What reads a file of rows.

    Raises:
        InputError: If the folder holds no campaign, or a file of it is damaged.
    """
    kept = read(path)
    rows: dict[int, Trial] = {}
    for numbers, found, _ in parts(path, load_file):
        rows |= zip(numbers, found, strict=True)
    return rows, kept


def parts(
    path: Path, load_file: Callable[[Path], tuple[list[Trial], dict[str, Any]]]
) -> Iterator[tuple[list[int], list[Trial], dict[str, Any]]]:
    """Reads the files of finished runs: the numbers of their tasks, they, and what is with them.

    The file of a campaign that is over comes first. A search that goes on with a greater budget has
    further ones.

    Raises:
        InputError: If one is damaged, with the way out.
    """
    if (path / RECORD).exists():
        _check_regular(path / RECORD, _OTHER)
        rows, also = _loaded(path / RECORD, load_file, _OTHER)
        yield list(range(len(rows))), rows, also
    for part in sorted(path.glob(PARTS)):
        checksum = _named(part)[2]
        _check_regular(part, _REMOVE)
        if checksum is not None and file_hash(part)[:16] != checksum:
            raise InputError(
                f"{part} is damaged: its content has not the checksum of its name; {_REMOVE}"
            )
        rows, also = _loaded(part, load_file, _REMOVE)
        tasks = also.get("tasks")
        if not isinstance(tasks, list) or len(tasks) != len(rows):
            raise InputError(f"{part} is damaged: it does not number its runs; {_REMOVE}")
        yield tasks, rows, also


def _check_regular(path: Path, way_out: str) -> None:
    """Refuses a pipe, whose reader would wait for ever, and a device."""
    if not path.is_file():
        raise InputError(f"{path} is damaged: expected a regular file; {way_out}")


def _loaded(
    path: Path,
    load_file: Callable[[Path], tuple[list[Trial], dict[str, Any]]],
    way_out: str,
) -> tuple[list[Trial], dict[str, Any]]:
    """The runs of a file, and what is kept with them."""
    try:
        rows, kept = load_file(path)
        also: dict[str, Any] = {**kept["also"]}
    except Exception as error:  # whatever reading what is no record raises
        said = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise InputError(f"{path} is damaged: {said}; {way_out}") from error
    return rows, also


def read(path: Path) -> dict[str, Any]:
    """Reads what is kept of a campaign beside its runs.

    Raises:
        InputError: If the folder holds none, or what it holds is damaged.
    """
    if (path / CAMPAIGN).exists():
        _check_regular(path / CAMPAIGN, _OTHER)
    try:
        kept: Any = json.loads((path / CAMPAIGN).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path} holds no campaign: there is no {CAMPAIGN} in it") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path / CAMPAIGN} is damaged: {error}; {_OTHER}") from error
    for key in ("system", "requirements", "also", "identity"):
        if not isinstance(kept, dict) or not isinstance(kept.get(key), _TYPES[key]):
            raise InputError(
                f"{path / CAMPAIGN} is damaged: expected an object with {key!r}; {_OTHER}"
            )
    try:
        Fingerprint.read(kept.get("fingerprint"))
        list(map(Mixture.read, kept.get("mixtures", ())))
    except (InputError, KeyError, TypeError) as error:
        raise InputError(
            f"{path / CAMPAIGN} is damaged: expected a fingerprint and mixtures; {_OTHER}"
        ) from error
    found: dict[str, Any] = kept
    return found


_TYPES: Final[dict[str, type]] = {
    "system": str,
    "requirements": dict,
    "also": dict,
    "identity": dict,
}
