"""Occurrences as JSON holds them: a list of rows for each body, and statistics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import Verdict
from rtamt.monitors import (
    BodyOccurrences,
    Occurrence,
    Occurrences,
    Response,
    RunTable,
    UnknownRun,
)

_TABLES: Mapping[str, type[Any]] = {
    "violations": Occurrence,
    "unknown": UnknownRun,
    "responses": Response,
    "unknown_triggers": UnknownRun,
}
"""The rows of each table of a body."""

_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def plain_occurrences(found: Occurrences) -> dict[str, Any]:
    """Return occurrences as JSON holds them; times are in seconds or numbers of samples."""
    return {
        "unit": found.unit,
        "end": found.end,
        "formula": found.formula,
        "at_start": found.at_start,
        "bodies": [_plain_body(body) for body in found.bodies],
    }


def _plain_body(body: BodyOccurrences) -> dict[str, Any]:
    return {
        "body": body.text,
        "length": body.length,
        "violated": body.violated,
        "statistics": statistics(body),
        **{name: _plain_rows(getattr(body, name)) for name in _TABLES},
    }


def statistics(body: BodyOccurrences) -> dict[str, Any]:
    """Return the count, the share of time, the rate and the answer times of a body."""
    times = body.answer_times
    found: dict[str, Any] = {
        "count": len(body.violations),
        "share": _known(body.share),
        "per_hour": _known(body.per_hour),
    }
    if len(body.responses):
        counts = {verdict.name: count for verdict, count in body.outcomes.items()}
        found |= {"triggers": len(body.responses), "outcomes": counts, "answered": len(times)}
    if len(times):
        levels = zip(_QUANTILES, np.quantile(times, _QUANTILES).tolist(), strict=True)
        found["answer_times"] = {
            "min": float(times[0]),
            **{str(share): value for share, value in levels},
            "max": float(times[-1]),
        }
    return found


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _plain_rows(table: RunTable[Any]) -> list[dict[str, Any]]:
    columns = {
        name: [_plain_cell(name, value) for value in column.tolist()]
        for name, column in table.columns.items()
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _plain_cell(name: str, value: Any) -> object:  # noqa: ANN401 - an element of an array
    if name == "verdict":
        return Verdict(value).name
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else repr(value)
    return value


def occurrences_of(kept: Mapping[str, Any]) -> Occurrences:
    """Read the result of `plain_occurrences`."""
    bodies = tuple(
        BodyOccurrences(
            body["body"],
            **{name: _table(body[name], kind, kept["unit"]) for name, kind in _TABLES.items()},
            length=body["length"],
            violated=body["violated"],
            unit=kept["unit"],
        )
        for body in kept["bodies"]
    )
    return Occurrences(kept["formula"], bodies, kept["end"], kept["unit"], kept["at_start"])


def _table(rows: list[dict[str, Any]], kind: type[Any], unit: str) -> RunTable[Any]:
    return RunTable(
        kind,
        {
            name: _column(name, [row.get(name, False) for row in rows], unit)
            for name in kind._fields
        },
    )


def _column(name: str, values: list[Any], unit: str) -> NDArray[Any]:
    if name in ("to_end", "unseen", "open_start", "closed_end"):
        return np.array(values, bool)
    if name == "verdict":
        return np.array([Verdict[value].value for value in values], np.int8)
    if unit == "samples" and name in ("start", "end", "duration", "worst_at"):
        return np.array(values, np.int64)
    return np.array([math.nan if value is None else float(value) for value in values])
