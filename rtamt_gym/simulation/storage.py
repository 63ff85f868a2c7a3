"""Parquet files of runs: a column for each signal, three for each specification."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rtamt import InputError
from rtamt_gym.results.codec import VERSION
from rtamt_gym.simulation.record import Floats, RunRecord
from rtamt_gym.simulation.written import plain_run, run_fields

__all__ = ["load", "save"]

_KEY = b"rtamt.run"
"""The key of the file's metadata under which everything but the arrays is kept, as JSON."""


def save(run: RunRecord, path: Path) -> None:
    """Writes a run: its columns, and all else as metadata.

    Raises:
        InputError: If the name of the file says that it is no Parquet file.
    """
    if path.suffix.lower() != ".parquet":
        raise InputError(
            f"cannot write {path}: expected a name that ends in .parquet, the format that holds "
            "all of a run; run.to_frame() has the columns for other formats"
        )
    kept = {"version": VERSION, **plain_run(run, arrays=False)}
    metadata = {_KEY: json.dumps(kept, allow_nan=False)}
    table = pa.table({name: np.asarray(values) for name, values in run.columns().items()})
    pq.write_table(table.replace_schema_metadata(metadata), path)


def load(path: Path) -> dict[str, Any]:
    """Reads the fields of a run that `save` has written.

    Raises:
        InputError: If the file does not hold a run.
    """
    try:
        table = pq.read_table(path)
    except pa.ArrowInvalid as error:
        raise InputError(f"cannot read {path}: it is no Parquet file") from error
    metadata = table.schema.metadata or {}
    if _KEY not in metadata:
        raise InputError(f"{path} holds no run: only files that Run.save has written do")
    kept: dict[str, Any] = json.loads(metadata[_KEY])

    def column(name: str) -> Floats:
        array: Floats = table.column(name).to_numpy()
        return array

    return run_fields(kept, column)
