"""Traces that a solver has found, and its answers: as tables, as JSON and in files."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rtamt import Answer, Equivalence, ExampleTrace, Specification
from rtamt_gym.tables import counted, number, table

__all__ = ["answer_data", "drawn", "equivalence_data", "first_timed", "trace_data", "write"]


def first_timed(specs: Mapping[str, Specification]) -> str:
    """The first requirement with a unit in a bound; empty if there is none."""
    for name, spec in specs.items():
        bounds = (node.interval for node in spec.formula.nodes())
        if any(interval is not None and interval.unit is not None for interval in bounds):
            return name
    return ""


def drawn(trace: ExampleTrace) -> list[str]:
    """The trace as a table: a column for each run of equal samples, in as many tables as needed."""
    rows = list(zip(*trace.columns.values(), strict=True))
    runs: list[tuple[str, tuple[float, ...]]] = []
    begin = 0
    for values, run in itertools.groupby(rows):
        end = begin + len([*run]) - 1
        runs.append((f"{begin}" if begin == end else f"{begin}-{end}", values))
        begin = end + 1
    if not runs:
        return [f"  any {counted(trace.samples, 'sample')}"]
    width = max(len(text) for at, values in runs for text in (at, *map(number, values))) + 2
    most = max(1, (78 - max(map(len, ("sample", *trace.columns)))) // width)
    lines: list[str] = []
    for first in range(0, len(runs), most):
        some = runs[first : first + most]
        cells = [["sample", *(at for at, _ in some)]]
        for i, name in enumerate(trace.columns):
            cells.append([name, *(number(values[i]) for _, values in some)])
        lines += [f"  {line}" for line in table(cells, "<" + ">" * len(some))]
    if trace.loop:
        lines.append(f"  the last {counted(trace.loop, 'sample')} again and again")
    return lines


def answer_data(answer: Answer) -> dict[str, Any]:
    """An answer, with its trace."""
    data: dict[str, Any] = {"says": answer.says}
    if answer.trace is not None:
        data["trace"] = trace_data(answer.trace)
    if answer.says == "no":
        parts = zip(answer.clash, answer.places, strict=True)
        clash = [{"text": text, "place": place and [*place]} for text, place in parts]
        data |= {"samples": answer.samples or None, "clash": clash}
    return data | ({"why": answer.why} if answer.why else {})


def equivalence_data(same: Equivalence) -> dict[str, Any]:
    """Whether two requirements are the same, with the trace that tells them apart."""
    data: dict[str, Any] = {"says": same.says}
    if same.trace is not None:
        data |= {"satisfied": same.satisfied, "trace": trace_data(same.trace)}
    if same.says == "yes":
        data["samples"] = same.samples or None
    return data | ({"why": same.why} if same.why else {})


def trace_data(trace: ExampleTrace) -> dict[str, Any]:
    """A trace, infinities as texts."""
    columns = {name: [*map(_strict, values)] for name, values in trace.columns.items()}
    return {"samples": trace.samples, "repeats": trace.loop, "columns": columns}


def _strict(value: float) -> float | str:
    return value if abs(value) != float("inf") else ("inf" if value > 0 else "-inf")


def write(trace: ExampleTrace, path: Path) -> None:
    """Writes a file of the samples, for `rtamt monitor` with the same period."""
    columns = [trace.unrolled(variable) for variable in trace.columns]
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([[*trace.columns], *zip(*columns, strict=True)])
