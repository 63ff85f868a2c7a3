"""Occurrences on recorded traces: all violations of a requirement, as text and as a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt.monitors import Occurrences, RunTable
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.judge import TraceJudgement, dense_arguments, having_unknown, viewed
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.results.matrix import indented
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted

_LISTED = 20
"""Traces whose violations are listed."""

KINDS: Mapping[str, str] = {
    "violations": "violated",
    "unknown": "unknown",
    "responses": "triggered",
    "unknown_triggers": "possibly triggered",
}
"""The tables of a body, and the word for their rows."""


def occurrences_of(
    spec: rtamt.Specification,
    trace: Trace | EventTrace,
    period: Fraction | None,
    reading: EvaluationOptions,
    judgement: TraceJudgement,
) -> Occurrences:
    """Return all violations of a requirement on a trace, at the times of the recording.

    Args:
        spec: The specification.
        trace: The samples or events.
        period: Seconds between samples; None: bounds count samples.
        reading: How traces are judged.
        judgement: The verdict, which decides where the trace starts.
    """
    requirement = viewed(spec, reading.view)
    late = judgement.late_start
    beginning = late is not None and late.counted
    if isinstance(trace, EventTrace):
        signals, options = dense_arguments(requirement, trace, late, reading, beginning=beginning)
        return rtamt.dense.occurrences(requirement, signals, reading.end, **options)
    names = requirement.variables
    samples = trace.with_beginning(names) if beginning else trace.known(names)
    reading = having_unknown(reading.having(period=period), samples, requirement)
    if beginning:
        reading = reading.having(nan="unknown")
    options = reading.from_monitors({"": requirement})[""]
    rows = rtamt.occurrences(
        requirement, samples.columns, end=reading.end, n=samples.samples, **options
    )
    return rows if period is None else rows.shifted(judgement.start)


def occurrence_lines(rows: Sequence[Trial]) -> list[str]:
    """Return the text of the occurrences of traces: the counts, and the first rows."""
    several = len(rows) > 1 or any(len(row.outcomes) > 1 for row in rows)
    lines, listed = list[str](), 0
    for row in rows:
        for name, outcome in row.outcomes.items():
            if (occurrences := outcome.occurrences) is None:
                continue
            if len(rows) > 1 and not len(occurrences):
                continue
            listed += 1
            if listed > _LISTED:
                continue
            if several:
                lines += [name if len(rows) == 1 else f"{name} in {row.name}"]
            lines += _text(occurrences, "  " if several else "")
    if listed > _LISTED:
        lines.append(f"and {counted(listed - _LISTED, 'list')} more")
    if listed == 0:
        lines.append("no violation in any trace")
    return lines


def _text(occurrences: Occurrences, indent: str) -> Iterator[str]:
    for body in occurrences.bodies:
        for line in body.lines(occurrences.moment, rates=not occurrences.at_start):
            rest = line.lstrip()
            yield from indented(rest, indent + " " * (len(line) - len(rest)))
    if occurrences.at_start:
        yield f"{indent}evaluated at the first instant only; --view step covers the trace"


def states_of(occurrences: Occurrences, begin: float) -> tuple[Floats, NDArray[Any]]:
    """Return the states of a requirement over a trace: a time and a word for each change.

    The state is ``violated`` if a body is violated, otherwise ``unknown`` if the trace does not
    decide a body, otherwise ``satisfied``.

    Args:
        occurrences: The occurrences.
        begin: The start of the trace.
    """
    # A place is an instant (time, 0), or the time after it (time, 1).
    changes: dict[tuple[float, int], list[tuple[str, int]]] = {(begin, 0): []}
    names = "start", "end", "to_end", "open_start", "closed_end"
    for body in occurrences.bodies:
        for word, table in (("violated", body.violations), ("unknown", body.unknown)):
            columns = (table.columns[name].tolist() for name in names)
            for start, end, to_end, open_start, closed_end in zip(*columns, strict=True):
                first = start, int(open_start and start < end)
                changes.setdefault(first, []).append((word, 1))
                if not to_end:
                    after = end, int(closed_end or start == end)
                    changes.setdefault(after, []).append((word, -1))
    open_runs = dict.fromkeys(("violated", "unknown"), 0)
    states: list[tuple[float, str]] = []
    for (time, _), changed in sorted(changes.items()):
        for word, step in changed:
            open_runs[word] += step
        state = next((word for word, count in open_runs.items() if count), "satisfied")
        if not states or states[-1][1] != state:
            states.append((time, state))
    times, words_ = zip(*states, strict=True)
    return np.array(times, dtype=np.float64), np.array(words_, dtype=np.str_)


def save_occurrences(rows: Sequence[Trial], path: Path) -> None:
    """Write the occurrences of traces as a table, in the format of the file's extension.

    Args:
        rows: The traces.
        path: The file, as for `rtamt_gym.recorded.output.save`.
    """
    from rtamt_gym.recorded.output import writer_of

    parts = [
        (row.name, name, body.text, word, getattr(body, kind))
        for row in rows
        for name, outcome in row.outcomes.items()
        if outcome.occurrences is not None
        for body in outcome.occurrences.bodies
        for kind, word in KINDS.items()
    ]
    counts = [len(table) for *_, table in parts]
    table: dict[str, NDArray[Any]] = {}
    for place, name in enumerate(("trace", "requirement", "body", "kind")):
        words = np.array([part[place] for part in parts], dtype=np.str_)
        table[name] = np.repeat(words, counts)
    for name, missing in _COLUMNS.items():
        columns = [_column(part[-1], name, missing) for part in parts]
        table[name] = np.concatenate([np.empty(0, np.asarray(missing).dtype), *columns])
    writer_of(path)(table, path)


_VERDICTS = {-1: "VIOLATED", 0: "UNDECIDED", 1: "SATISFIED"}

_COLUMNS: Mapping[str, Any] = {
    "start": np.nan,
    "end": np.nan,
    "duration": np.nan,
    "to_end": 0,
    "open_start": 0,
    "closed_end": 0,
    "robustness": np.nan,
    "worst_at": np.nan,
    "unseen": 0,
    "verdict": "",
    "answer_time": np.nan,
}
"""The columns of numbers and verdicts, and what a row without one has there."""


def _column(table: RunTable[Any], name: str, missing: Any) -> NDArray[Any]:  # noqa: ANN401 - a cell
    """Return a column of a table; the margin of a response is its robustness."""
    known = table.columns
    if name == "robustness" and "margin" in known:
        name = "margin"
    if name not in known:
        return np.full(len(table), missing)
    if name == "verdict":
        return np.array([_VERDICTS[value] for value in known[name].tolist()], dtype=np.str_)
    return known[name].astype(np.asarray(missing).dtype)
