"""The files in the folder of a campaign: which there are, and how they are read."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from rtamt import InputError
from rtamt_gym.results.trial import Trial

__all__ = ["CAMPAIGN", "PARTS", "RECORD", "finished", "parts", "read"]

CAMPAIGN: Final = "campaign.json"
"""Says which campaign it is."""

PARTS: Final = "part-*.parquet"
"""Hold finished runs, ``part-000001.parquet`` and so on, until the campaign is over."""

RECORD: Final = "record.parquet"
"""Holds all runs once the campaign is over."""


def finished(
    path: Path, load_file: Callable[[Path], tuple[list[Trial], dict[str, Any]]]
) -> tuple[dict[int, Trial], dict[str, Any]]:
    """Reads the finished runs by the numbers of their tasks, and what is kept with them.

    Args:
        path: The folder.
        load_file: What reads a file of rows.

    Raises:
        InputError: If the folder holds no campaign.
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
    """
    if (path / RECORD).exists():
        rows, kept = load_file(path / RECORD)
        yield list(range(len(rows))), rows, kept["also"]
    for part in sorted(path.glob(PARTS)):
        rows, kept = load_file(part)
        yield kept["also"]["tasks"], rows, kept["also"]


def read(path: Path) -> dict[str, Any]:
    """Reads what is kept of a campaign beside its runs.

    Raises:
        InputError: If the folder holds none.
    """
    try:
        kept: dict[str, Any] = json.loads((path / CAMPAIGN).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path} holds no campaign: there is no {CAMPAIGN} in it") from error
    return kept
