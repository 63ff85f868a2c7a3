"""The occurrences of a requirement on recorded traces: a timeline, rows and statistics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rtamt.monitors import BodyOccurrences, Occurrences
from rtamt_gym.reports.model import Cell, Column, Figure, Row, Table, numbers_table, plain
from rtamt_gym.reports.numbers import aligned, number, percent, six, time
from rtamt_gym.results.outcome import Word
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted

_RUNS = 500
"""Runs that a timeline shows of each body."""

_ROWS = 100
"""Violations in the table next to a timeline."""


def occurrence_figures(rows: Sequence[Trial], name: str) -> list[Figure | Table]:
    """Return the statistics of a requirement over traces, and the timeline of one trace.

    The timeline shows the trace with the longest violated time. The list is empty if no trace has
    occurrences.

    Args:
        rows: The traces.
        name: The name of the requirement.
    """
    found = [
        (row, outcome.occurrences)
        for row in rows
        if (outcome := row.outcomes.get(name)) is not None and outcome.occurrences is not None
    ]
    if not found:
        return []
    shown = max(found, key=lambda pair: sum(body.violated for body in pair[1].bodies))
    if not len(shown[1]):
        return [_statistics([each for _, each in found])]
    return [_statistics([each for _, each in found]), _timeline(*shown)]


def _statistics(found: Sequence[Occurrences]) -> Table:
    """Return a row for each body, over all traces."""
    head = ("body", "violations", "share of time", "an hour", "triggers", "answer time, median")
    rows = []
    for bodies in zip(*(each.bodies for each in found), strict=True):
        length, violated = (sum(getattr(body, part) for body in bodies) for part in _SPANS)
        if len({body.unit for body in bodies}) > 1:  # some traces have no times
            length = 0.0
        count = sum(len(body.violations) for body in bodies)
        timed = bodies[0].unit == "s" and length > 0
        triggers = sum(len(body.responses) for body in bodies)
        answers = np.concatenate([body.answer_times for body in bodies])
        cells = (
            Cell(str(count), "n"),
            Cell(f"{percent(violated / length)} %" if length else "", "n"),
            Cell(number(3600 * count / length) if timed else "", "n"),
            Cell(str(triggers) if triggers else "", "n"),
            Cell(_duration(float(np.median(answers)), bodies[0]) if len(answers) else "", "n"),
        )
        rows.append(Row((Cell(codes=(bodies[0].text,)), *cells)))
    columns = (Column(head[0]), *(Column(text, "n") for text in head[1:]))
    what = f"All violations in {counted(len(found), 'trace')}"
    return Table(columns, tuple(rows), "Violations of each body", what)


_SPANS = "length", "violated"


def _duration(value: float, body: BodyOccurrences) -> str:
    return f"{number(value)} {'s' if body.unit == 's' else 'samples'}"


def _timeline(row: Trial, found: Occurrences) -> Figure:
    """Return the chart of the violated and unknown runs of each body in a trace."""
    unit = "s" if found.unit == "s" else "steps"
    bodies, left_out = [], 0
    for body in found.bodies:
        runs = [*_runs(body, "violated"), *_runs(body, "undecided")]
        left_out += len(body.violations) + len(body.unknown) - len(runs)
        bodies.append({"text": body.text, "runs": tuple(run for _, run in sorted(runs))})
    extent = row.judged_extent
    drawn = [
        float(time)
        for body in found.bodies
        for table in (body.violations, body.unknown)
        for part in ("start", "end")
        for time in table.columns[part].tolist()
    ]
    span = [min(drawn), max(drawn)]
    if extent is not None and extent.begin is not None and extent.end is not None and unit == "s":
        span = [min(span[0], extent.begin), max(span[1], extent.end)]
    total = sum(violation.duration for violation in found)
    longest = max(found, key=lambda violation: violation.duration)
    summary = (
        f"{row.name}: {counted(len(found), 'violation')}, {number(total)} {found.unit} in all; the "
        f"longest starts at {time(six(float(longest.start)), unit)} and lasts "
        f"{number(longest.duration)} {found.unit}."
    )
    if left_out:
        summary += f" {counted(left_out, 'run')} not drawn."
    words: tuple[Word, ...] = tuple(
        word
        for word in ("violated", "undecided")
        if any(run[2] == word for body in bodies for run in body["runs"])
    )
    return Figure(
        "timeline",
        "All violations",
        summary,
        110 + 34 * len(bodies),
        plain({"bodies": tuple(bodies), "span": (six(span[0]), six(span[1])), "unit": unit}),
        _table(found),
        wide=True,
        words=words,
    )


def _runs(body: BodyOccurrences, word: Word) -> list[tuple[float, tuple[float, float, Word, str]]]:
    """Return start, end, verdict and robustness of runs, with the start first."""
    if word == "violated":
        texts = [number(six(run.robustness)) for run in body.violations[:_RUNS]]
        spans = [(float(run.start), float(run.end)) for run in body.violations[:_RUNS]]
    else:
        spans = [(float(run.start), float(run.end)) for run in body.unknown[:_RUNS]]
        texts = [""] * len(spans)
    return [
        (start, (six(start), six(end), word, text))
        for (start, end), text in zip(spans, texts, strict=True)
    ]


def _table(found: Occurrences) -> Table:
    rows: list[tuple[Any, ...]] = [
        (body.text, run) for body in found.bodies for run in body.violations[:_ROWS]
    ][:_ROWS]
    starts, ends, durations, worst = (
        aligned([six(float(getattr(run, part))) for _, run in rows])
        for part in ("start", "end", "duration", "robustness")
    )
    texts = [text for text, _ in rows]
    unit = "s" if found.unit == "s" else "samples"
    head = ("body", f"start ({unit})", f"end ({unit})", f"lasts ({unit})", "minimum robustness")
    return numbers_table(head, tuple(zip(texts, starts, ends, durations, worst, strict=True)))
