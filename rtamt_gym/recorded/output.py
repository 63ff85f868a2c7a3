"""Writes robustness to files that can be read and judged as traces."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path

from rtamt_gym.recorded.judge import RESULT, Judgement, Series
from rtamt_gym.recorded.names import VALUE, VARIABLE
from rtamt_gym.recorded.times import TIME

__all__ = ["save_csv"]


def save_csv(judgements: Mapping[str, Judgement], path: Path, *, dense: bool) -> None:
    """Writes the robustness of every formula.

    For samples, the columns are the times, or the sample numbers if the period is unknown, and one
    for each formula. In dense time a row is one event, with its time, variable and value.

    Args:
        judgements: The judgements by name of the specification. If there are several, the name
            precedes that of each formula.
        path: The file.
        dense: Whether the robustness consists of events in dense time.
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
