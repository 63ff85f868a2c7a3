"""Robustness in files, which can be read and judged as traces."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path

from rtamt_gym.recorded.judge import RESULT, Judgement, Series
from rtamt_gym.recorded.trace import TIME, VALUE, VARIABLE

__all__ = ["save_csv"]


def save_csv(judgements: Mapping[str, Judgement], path: Path, *, dense: bool) -> None:
    """Writes the robustness of every formula.

    Samples are rows of a column of times, or of sample numbers where the period is unknown, and a
    column for every formula. In dense time a row is one event: time, variable and value.

    Args:
        judgements: By the name of the specification, which stands before that of a formula if
            there are several.
        path: The file.
        dense: Whether the formulas change at times of their own.
    """
    series = _named(judgements)
    rows: Iterable[tuple[float | str, ...]]
    if dense:
        head = [TIME, VARIABLE, VALUE]
        events = (
            zip(each.times.tolist(), itertools.repeat(name), each.values.tolist(), strict=False)
            for name, each in series.items()
        )
        rows = sorted(itertools.chain.from_iterable(events))
    else:
        first = next(iter(series.values()))
        head = ["sample" if first.step is None else TIME, *series]
        times = first.times.tolist()
        if first.step is None:
            times = range(len(times))
        rows = zip(times, *(each.values.tolist() for each in series.values()), strict=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(rows)


def _named(judgements: Mapping[str, Judgement]) -> dict[str, Series]:
    named = {}
    for spec, judgement in judgements.items():
        for formula, series in judgement.series.items():
            parts = [spec] if len(judgements) > 1 else []
            if formula != RESULT:
                parts.append(formula)
            named[".".join(parts) or "robustness"] = series
    return named
