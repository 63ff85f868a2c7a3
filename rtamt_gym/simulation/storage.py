"""Runs in Parquet files: a column for every signal, three for every specification."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rtamt import InputError, Verdict
from rtamt_gym.simulation.run import Course, Floats, Run

__all__ = ["load", "save"]

_KEY = b"rtamt.run"
"""Where the schema of the file holds what is no array."""

_CURVES = ("robustness", "lower", "upper")


def save(run: Run, path: Path) -> None:
    """Writes a run.

    Columns are ``time``, the signals, and ``robustness(NAME)``, ``lower(NAME)``, ``upper(NAME)``
    for every specification. A signal called ``time`` stands in place of the times, which the period
    gives again.
    """
    columns: dict[str, Floats] = {"time": run.times, **run.signals}
    for name, course in run.courses.items():
        columns |= {f"{curve}({name})": getattr(course, curve) for curve in _CURVES}
    said = {
        "system": run.system,
        "signals": list(run.signals),
        "courses": {
            name: {
                "formula": course.formula,
                # Text, because JSON has no infinities.
                "final": repr(course.final),
                "verdict": course.verdict.name,
                "decided_at": course.decided_at,
                "unit": course.unit,
            }
            for name, course in run.courses.items()
        },
        "ended": run.ended,
        "violated_by": run.violated_by,
        "period": None if run.period is None else str(run.period),
        "view": run.view,
        "stop": run.stop,
        "limit": run.limit,
        "seed": run.seed,
        "label": run.label,
        "wall_time": run.wall_time,
    }
    metadata = {_KEY: json.dumps(said, allow_nan=False)}
    table = pa.table({name: np.asarray(values) for name, values in columns.items()})
    pq.write_table(table.replace_schema_metadata(metadata), path)


def load(path: Path) -> Run:
    """Reads the run that `save` has written.

    Raises:
        InputError: If the file is none.
    """
    try:
        table = pq.read_table(path)
    except pa.ArrowInvalid as error:
        raise InputError(f"cannot read {path}: it is no Parquet file") from error
    metadata = table.schema.metadata or {}
    if _KEY not in metadata:
        raise InputError(f"{path} holds no run: only files that Run.save has written do")
    said: dict[str, Any] = json.loads(metadata[_KEY])

    def column(name: str) -> Floats:
        array: Floats = table.column(name).to_numpy()
        return array

    return Run(
        **said
        | {
            "signals": {name: column(name) for name in said["signals"]},
            "courses": {
                name: Course(
                    formula=course["formula"],
                    robustness=column(f"robustness({name})"),
                    lower=column(f"lower({name})"),
                    upper=column(f"upper({name})"),
                    final=float(course["final"]),
                    verdict=Verdict[course["verdict"]],
                    decided_at=course["decided_at"],
                    unit=course["unit"],
                )
                for name, course in said["courses"].items()
            },
            "period": None if said["period"] is None else Fraction(said["period"]),
        }
    )
