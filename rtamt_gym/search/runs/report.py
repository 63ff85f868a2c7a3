"""The outcomes of a record as lines for the terminal and as JSON for programs."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from textwrap import wrap
from typing import Any, Final

import numpy as np

import rtamt
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.results.statistics import columns_of
from rtamt_gym.search.runs.record import Record
from rtamt_gym.tables import counted, number, shorten, table

__all__ = ["FORMAT", "case_lines", "failures", "strict_json", "summary", "to_json"]


FORMAT: Final = "rtamt record 1"
"""What the JSON of a record says that it is, for `rtamt report`."""


def summary(record: Record) -> list[str]:
    """A table with a row for every requirement: its robustness over the record, and its verdicts.

    Below it stand what was simulated and how many failed.
    """
    results = list(record.results().values())
    columns = columns_of(results, rates=False)
    rows = [["requirement", *(each.heading for each in columns)]]
    rows += [[each.name, *(column.cell(each) for column in columns)] for each in results]
    simulated = math.fsum(row.simulated for row in record)
    took = f"{counted(len(record), 'simulation')}, {simulated:.6g} simulated seconds"
    return [*table(rows, "<" + ">" * len(columns), 80), "", took, *failures(record)]


def failures(record: Record) -> list[str]:
    """How many simulations failed, with the error that most had; no lines if none did."""
    failed = record.failed()
    if not len(failed):
        return []
    (error, times), *others = Counter(row.error for row in failed).most_common()
    more = f" (and {counted(len(others), 'other error')})" if others else ""
    return [
        f"{counted(len(failed), 'simulation')} of {len(record)} failed, {times} with{more}:",
        f"  {shorten(error, 200)}",
    ]


def to_json(record: Record, options: Mapping[str, Any]) -> str:
    """The record as strict JSON: infinities are the strings ``"inf"`` and ``"-inf"``.

    Args:
        record: The simulations.
        options: How they were chosen and run.
    """
    columns = record.columns()
    names = list(columns)
    rows = zip(*columns.values(), strict=True)
    return json.dumps(
        {
            "format": FORMAT,
            "rtamt": rtamt.__version__,
            "system": record.system,
            **options,
            "requirements": dict(record.requirements),
            "simulations": [
                {name: _finite(cell) for name, cell in zip(names, row, strict=True)} for row in rows
            ],
        },
        indent=2,
        allow_nan=False,
    )


def _finite(cell: Any) -> Any:  # noqa: ANN401 - a cell of a table
    return str(cell) if isinstance(cell, float) and not np.isfinite(cell) else cell


def strict_json(kept: Mapping[str, Any]) -> str:
    """Strict JSON over several lines, in which a list of numbers or texts is one line."""
    text = json.dumps(kept, indent=2, allow_nan=False)
    # No text of JSON holds a newline.
    return re.sub(r"\[\n([^\[\]{}]*)\n *\]", lambda found: f"[{_one_line(found[1])}]", text)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def case_lines(case: Case) -> list[str]:
    """A case for the terminal: a line for each entry, and more for one of many control points."""
    return [line for each in case.items() for line in _entry(*each)]


def _entry(name: str, entry: float | Waveform) -> list[str]:
    """An entry of a case: a number, or the values of a waveform at its times."""
    if not isinstance(entry, Waveform):
        return [f"  {name} = {number(entry)}"]
    if len(set(entry.values)) == 1:
        return [f"  {name} = {number(entry.values[0])} throughout"]
    points = zip(entry.times, entry.values, strict=True)
    # Lines break behind a control point, not within: a blank that does not break is none to `wrap`.
    values = [f"{number(value)}\xa0at\xa0{number(time)}\xa0s" for time, value in points]
    how = {"hold": "steps"}.get(entry.interpolation, entry.interpolation)
    text = f"{name}, {how}: {', '.join(values)}"
    lines = wrap(text, 79, initial_indent="  ", subsequent_indent="    ")
    return [line.replace("\xa0", " ") for line in lines]
