"""Outcomes as strict JSON, in which numbers that are not finite are text."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Final

import rtamt
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.outcome import ERROR, Failure, Matrix, Outcome

__all__ = ["FORMAT", "to_json"]

FORMAT: Final = "rtamt outcomes 1"
"""What the files say that they are, for `rtamt report`."""


def to_json(matrix: Matrix, rules: Mapping[str, str], columns: Columns) -> str:
    """The outcomes of every trace and requirement.

    Args:
        matrix: The outcomes.
        rules: How the traces were judged, by name.
        columns: How their columns were read; what is not the default is said.
    """
    requirement, trace = matrix.worst_requirement(), matrix.worst_trace()
    default = Columns()
    said = {each.name: getattr(columns, each.name) for each in fields(columns)}
    outcomes = {
        "format": FORMAT,
        "rtamt": rtamt.__version__,
        **rules,
        "columns": {
            name: dict(value) if isinstance(value, Mapping) else value
            for name, value in said.items()
            if value != getattr(default, name)
        },
        "verdict": matrix.word,
        "exit_code": matrix.exit_code,
        "counts": {word.lower(): count for word, count in matrix.counts().items()},
        "worst_requirement": requirement and requirement[0],
        "worst_trace": trace and trace[0],
        "requirements": dict(matrix.formulas),
        "traces": [
            {
                "trace": row.trace,
                "verdict": row.word,
                "described": row.described or None,
                "notes": list(row.notes),
                "requirements": {name: _cell(cell) for name, cell in row.cells.items()},
            }
            for row in matrix.rows
        ],
    }
    return json.dumps(outcomes, indent=2, allow_nan=False)


def _cell(cell: Outcome | Failure) -> dict[str, Any]:
    if isinstance(cell, Failure):
        return {"verdict": ERROR, "error": cell.message}
    lower, upper = cell.bounds
    found: dict[str, Any] = {
        "verdict": cell.verdict.name,
        "robustness": _number(cell.robustness),
        "lower": _number(lower),
        "upper": _number(upper),
        "certain_from": cell.certain_from,
    }
    if cell.way_out:
        found |= {"not_recorded": list(cell.not_recorded), "way_out": cell.way_out}
    if cell.explanation:
        found["explanation"] = cell.explanation
    return found


def _number(value: float) -> float | str:
    """The value, -0.0 included, or ``"inf"`` or ``"-inf"``."""
    return value if math.isfinite(value) else str(value)
