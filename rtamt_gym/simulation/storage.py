"""Parquet files of runs: a column for each signal, three for each specification."""

from __future__ import annotations

import json
from dataclasses import fields
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rtamt import InputError, Verdict
from rtamt_gym.inputs.case import Case
from rtamt_gym.simulation.record import CURVES, Course, Floats, RunRecord

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
    kept = {each.name: getattr(run, each.name) for each in fields(run)} | {
        "signals": list(run.signals),
        "courses": {
            name: {each.name: getattr(course, each.name) for each in fields(course)}
            | dict.fromkeys(CURVES)
            # Text, because JSON has no infinities.
            | {"final": repr(course.final), "verdict": course.verdict.name}
            for name, course in run.courses.items()
        },
        "period": None if run.period is None else str(run.period),
        "case": None if run.case is None else run.case.to_json(),
        "reward": None if run.reward is None else repr(run.reward),
    }
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

    return kept | {
        "signals": {name: column(name) for name in kept["signals"]},
        "courses": {
            name: Course(
                **course
                | {curve: column(f"{curve}({name})") for curve in CURVES}
                | {"final": float(course["final"]), "verdict": Verdict[course["verdict"]]}
                | {key: tuple(course.get(key, ())) for key in ("inputs", "outputs")}
            )
            for name, course in kept["courses"].items()
        },
        "period": None if kept["period"] is None else Fraction(kept["period"]),
        "case": Case.from_json(kept["case"]) if kept.get("case") else None,
        "reward": float(kept["reward"]) if kept.get("reward") else None,
    }
