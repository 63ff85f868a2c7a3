"""Traces that a solver has found, and its answers: as tables, as JSON and in files."""

from __future__ import annotations

import argparse
import csv
import itertools
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from rtamt import Answer, Equivalence, ExampleTrace, Specification
from rtamt_gym.commands.arguments import add_reading, positive
from rtamt_gym.tables import counted, number, table

__all__ = [
    "add_search",
    "answer_data",
    "drawn",
    "equivalence_data",
    "first_timed",
    "strict",
    "trace_data",
    "write",
]


def add_search(parser: argparse.ArgumentParser) -> None:
    """Adds the specifications and how traces are searched for."""
    parser.add_argument("specs", nargs="+", metavar="SPEC", help="a formula or a .stl file")
    parser.add_argument(
        "--constant",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="the value of a constant, in place of that in the text; may be repeated",
    )
    parser.add_argument("--assume", metavar="FORMULA", help="what holds of every trace")
    parser.add_argument(
        "--end",
        choices=("complete", "cut", "open"),
        default="cut",
        help="how the end of a trace is read, as by rtamt monitor (default: cut)",
    )
    parser.add_argument(
        "--horizon",
        type=positive,
        default=1000,
        metavar="N",
        help="the most samples of a trace (default: 1000)",
    )
    parser.add_argument(
        "--timeout",
        type=float,
        default=10.0,
        metavar="SECONDS",
        help="for each question (default: 10)",
    )
    parser.add_argument(
        "--save", type=Path, metavar="FOLDER", help="write the traces as CSV for rtamt monitor"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")
    add_reading(parser, "period")


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
    columns = {name: [*map(strict, values)] for name, values in trace.columns.items()}
    return {"samples": trace.samples, "repeats": trace.loop, "columns": columns}


def strict(value: float | None) -> float | str | None:
    """A number that strict JSON can say: infinities are texts."""
    return str(value) if value is not None and math.isinf(value) else value


def write(traces: Iterable[tuple[str, ExampleTrace]], folder: Path) -> None:
    """Writes files of samples, which `rtamt monitor` reads with the same period.

    Args:
        traces: Traces, each with the words that its file is named after.
        folder: Where the files lie.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for words, trace in traces:
        columns = [trace.unrolled(variable) for variable in trace.columns]
        path = folder / f"{re.sub(_NO_NAME, '_', words)}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([[*trace.columns], *zip(*columns, strict=True)])


_NO_NAME: Final = r"[^\w.-]"
"""What is left out of names of files."""
