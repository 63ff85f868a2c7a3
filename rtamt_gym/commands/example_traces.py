"""Traces and answers of a solver as tables, JSON, files and pictures."""

from __future__ import annotations

import argparse
import csv
import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, get_args

import numpy as np

from rtamt import InputError, Specification
from rtamt.checking import Answer, Equivalence, ExampleTrace
from rtamt.typing import End
from rtamt_gym.options.command_line import (
    Option,
    add_options,
    positive,
    read_evaluation_options,
    shared,
)
from rtamt_gym.results.warnings import exit_code
from rtamt_gym.tables import counted, number, shorten, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rtamt_gym.results.outcome import Word

_WORDS: Final[Mapping[str, Word]] = {
    "yes": "satisfied",
    "no": "violated",
    "unknown": "undecided",
}


def add_search(parser: argparse.ArgumentParser, horizon: int, why: str = "") -> None:
    """Add the arguments of a search for traces."""
    add_options(
        parser,
        Option("SPEC", "a formula or a .stl file", nargs="+", dest="specs"),
        shared("--only", about="take only this requirement"),
        "--constant",
        Option("--assume FORMULA", "an assumption that every trace satisfies"),
        Option(
            "--rate 'NAME in [LOW, HIGH]'",
            "minimum and maximum change of a variable per second, or per sample without --period",
            repeat=True,
        ),
        Option(
            "--end",
            "end mode of a trace, as for rtamt monitor",
            default="cut",
            choices=get_args(End),
        ),
        Option(
            "--horizon N",
            f"maximum number of samples of a trace (default: {horizon}{why})",
            default=horizon,
            read=positive,
        ),
        Option(
            "--timeout SECONDS",
            "time limit for each question",
            default=10.0,
            usual="10",
            read=float,
        ),
        Option("--save FOLDER", "write the traces as CSV for rtamt monitor", read=Path),
        Option("--json", "print JSON instead of text"),
        "--period",
    )


def read_rates(texts: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Return the rates of change that ``--rate`` sets."""
    rates: dict[str, tuple[float, float]] = {}
    for text in texts:
        match = re.fullmatch(r"\s*([\w.]+)\s+in\s+\[([^,]*),([^,]*)\]\s*", text)
        try:
            lower, upper = map(float, match.groups()[1:]) if match else (math.nan, math.nan)
        except ValueError:
            lower = upper = math.nan
        if match is None or math.isnan(lower) or math.isnan(upper):
            raise InputError(
                "--rate: expected a variable and the range of its change, such as 'x in [-2, 2]', "
                f"got {text!r}"
            )
        if match[1] in rates:
            raise InputError(f"--rate: '{match[1]}' has two rates; give one rate")
        rates[match[1]] = lower, upper
    return rates


def read_period(
    options: argparse.Namespace, *requirements: Mapping[str, Specification]
) -> Fraction | None:
    """Read ``--period``."""
    period = read_evaluation_options(options).seconds
    for name, spec in itertools.chain(*(specs.items() for specs in requirements)):
        bounds = (node.interval for node in spec.formula.nodes())
        if period is None and any(bound is not None and bound.unit for bound in bounds):
            raise InputError(
                f"--period: {name} has bounds with units, and the period of the samples is "
                "unknown; give it, such as --period 100ms"
            )
    return period


def code_of(answers: Iterable[str]) -> int:
    """Return the exit code: 0 for yes, 1 for no, 3 for unknown."""
    return exit_code([_WORDS[says] for says in answers])


def drawn(trace: ExampleTrace) -> list[str]:
    """Return the trace as tables with a column for each run of equal samples."""
    rows = list(zip(*trace.columns.values(), strict=True))
    runs: list[tuple[str, tuple[float, ...]]] = []
    begin = 0
    for values, run in itertools.groupby(rows):
        end = begin + len([*run]) - 1
        runs.append((f"{begin}" if begin == end else f"{begin}-{end}", values))
        begin = end + 1
    if not runs:
        return [f"  any {counted(trace.samples, 'sample')}"]
    width = max(len(text) for span, values in runs for text in (span, *map(number, values))) + 2
    most = max(1, (78 - max(map(len, ("sample", *trace.columns)))) // width)
    lines: list[str] = []
    for first in range(0, len(runs), most):
        some = runs[first : first + most]
        cells = [["sample", *(span for span, _ in some)]]
        for i, name in enumerate(trace.columns):
            cells.append([name, *(number(values[i]) for _, values in some)])
        lines += [f"  {line}" for line in table(cells, "<" + ">" * len(some))]
    if trace.loop:
        lines.append(f"  the last {counted(trace.loop, 'sample')} again and again")
    return lines


def answer_data(answer: Answer) -> dict[str, Any]:
    """Return an answer and its trace as JSON data."""
    data: dict[str, Any] = {"says": answer.answer}
    if answer.trace is not None:
        data["trace"] = trace_data(answer.trace)
    if answer.answer == "no":
        parts = zip(answer.clash, answer.places, strict=True)
        clash = [{"text": text, "place": position and [*position]} for text, position in parts]
        data |= {"samples": answer.samples or None, "clash": clash}
    return data | ({"why": answer.why} if answer.why else {})


def equivalence_data(same: Equivalence) -> dict[str, Any]:
    """Return whether two requirements are equivalent, and a trace that distinguishes them."""
    data: dict[str, Any] = {"says": same.answer}
    if same.trace is not None:
        data |= {"satisfied": same.satisfied, "trace": trace_data(same.trace)}
    if same.answer == "yes":
        data["samples"] = same.samples or None
    return data | ({"why": same.why} if same.why else {})


def trace_data(trace: ExampleTrace) -> dict[str, Any]:
    """Return a trace with infinities as texts."""
    columns = {name: [*map(strict, values)] for name, values in trace.columns.items()}
    return {"samples": trace.samples, "repeats": trace.loop, "columns": columns}


def strict(value: float | None) -> float | str | None:
    """Return a number for strict JSON: infinities become texts."""
    return str(value) if value is not None and math.isinf(value) else value


def write(traces: Iterable[tuple[str, ExampleTrace]], folder: Path) -> None:
    """Write files of samples that `rtamt monitor` reads with the same period."""
    for words, trace in traces:
        write_samples(folder, words, {name: trace.unrolled(name) for name in trace.columns})


def write_samples(folder: Path, words: str, columns: Mapping[str, Sequence[float]]) -> None:
    """Write a file of samples into a folder; ``words`` are its name."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = re.sub(r"[^\w.-]", "_", words)
    with (folder / f"{stem}.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([[*columns], *zip(*columns.values(), strict=True)])


_ABREAST: Final = 3
_PICTURED: Final = 12


def draw_traces(traces: Sequence[tuple[str, ExampleTrace]], period: Fraction | None) -> Figure:
    """Draw a panel for each variable of each trace, with the repeated part shaded."""
    from matplotlib.figure import Figure

    from rtamt_gym import drawing

    shown = [*traces[:_PICTURED]]
    across = min(_ABREAST, len(shown))
    rows = [shown[i : i + across] for i in range(0, len(shown), across)]
    heights = [0.7 + 1.1 * max(1, *(len(trace.columns) for _, trace in row)) for row in rows]
    figure = Figure(figsize=(max(6.0, 4.0 * across), sum(heights) + 0.4), layout="constrained")
    parts = figure.subfigures(len(rows), across, squeeze=False, height_ratios=heights)
    for row, some in zip(rows, parts, strict=True):
        for (title, trace), part in zip(row, some, strict=False):
            part.suptitle(title, fontsize=10, fontweight="bold")
            panels = part.subplots(max(1, len(trace.columns)), 1, sharex=True, squeeze=False)[:, 0]
            for ax, (name, values) in zip(panels, trace.columns.items(), strict=False):
                _variable(ax, name, values, trace, period)
            if not trace.columns:
                panels[0].set_axis_off()
                panels[0].text(0.0, 0.5, f"any {counted(trace.samples, 'sample')}", fontsize=9)
            unit = "samples" if period is None else "time in s"
            again = "; shaded: again and again" if trace.loop else ""
            panels[-1].set_xlabel(unit + again, fontsize=9, color=drawing.OPEN)
    if len(traces) > len(shown):
        figure.suptitle(f"{len(shown)} of {len(traces)} traces", fontsize=10, color=drawing.OPEN)
    return figure


def _variable(
    ax: Axes, name: str, values: Sequence[float], trace: ExampleTrace, period: Fraction | None
) -> None:
    from rtamt_gym import drawing

    step = 1.0 if period is None else float(period)
    drawing.tidy(ax, shorten(name, 18))
    times = [0.0]
    levels = [values[0]]
    position = 0
    for value, run in itertools.groupby(values):  # a point for each run: traces may be long
        if position:
            times.append(position * step)
            levels.append(value)
        position += len([*run])
    times.append(trace.samples * step)  # the last sample is as wide as the others
    levels.append(values[-1])
    finite = [level for level in levels if math.isfinite(level)] or [0.0]
    margin = 0.2 * (max(finite) - min(finite)) or 1.0  # a constant line needs a margin too
    bottom, top = min(finite) - margin, max(finite) + margin
    ax.set_ylim(bottom, top)
    clipped = np.clip(levels, bottom, top)  # infinities lie at the edge
    ax.plot(times, clipped, color=drawing.SIGNAL, linewidth=1.4, drawstyle="steps-post")
    ax.margins(x=0.0)
    if trace.loop:
        loop_start = (trace.samples - trace.loop) * step
        ax.axvspan(loop_start, trace.samples * step, color=drawing.BOUNDS, alpha=0.4, linewidth=0)
