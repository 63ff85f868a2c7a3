"""What requirements came to on recorded traces: plain values that processes send each other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rtamt import Verdict
from rtamt_gym.tables import counted, number

__all__ = ["ERROR", "Failure", "Matrix", "Outcome", "Row", "word"]

ERROR = "ERROR"
"""The word in the place of a verdict where there is none."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The verdict on one requirement of one trace.

    Attributes:
        verdict: The verdict.
        robustness: The robustness if the trace is all there is.
        bounds: The least and the greatest robustness that the reading of the end leaves possible.
        text: The verdict in words, with the time from which on it was certain; empty if nothing was
            to be explained.
        certain_from: That time in seconds, in samples without a period; None: the end of the trace.
        not_recorded: What an open verdict needs and the trace does not have.
        way_out: What would decide an open verdict; else empty.
        explanation: Which samples decided a violation; empty if it was not asked for.
    """

    verdict: Verdict
    robustness: float
    bounds: tuple[float, float]
    text: str
    certain_from: float | None
    not_recorded: tuple[str, ...]
    way_out: str
    explanation: str


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a requirement could not be judged on a trace.

    Attributes:
        message: The message of the error.
        traceback: Where it was raised, if nobody expected it; else empty.
    """

    message: str
    traceback: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """The outcomes of every requirement on one trace.

    Attributes:
        trace: The name of the trace.
        described: The number of its samples or events, and its times; empty if it was not read.
        cells: For each requirement its outcome, or why there is none.
        notes: What was read otherwise than it is written, such as a trace that was resampled.
    """

    trace: str
    described: str
    cells: Mapping[str, Outcome | Failure]
    notes: Sequence[str] = ()

    @property
    def outcomes(self) -> dict[str, Outcome]:
        """The outcomes of the requirements that were judged."""
        return {name: cell for name, cell in self.cells.items() if isinstance(cell, Outcome)}

    @property
    def word(self) -> str:
        """The worst of its verdicts, as a word."""
        words = {word(cell) for cell in self.cells.values()}
        return next(each for each in _WORDS if each in words)


_WORDS = (ERROR, *(v.name for v in (Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.SATISFIED)))


def word(cell: Outcome | Failure) -> str:
    """The verdict of a cell as a word."""
    return ERROR if isinstance(cell, Failure) else cell.verdict.name


@dataclass(frozen=True, slots=True)
class Matrix:
    """The outcomes of requirements on traces.

    Attributes:
        formulas: The formula of each requirement.
        rows: A row for each trace, at least one.
    """

    formulas: Mapping[str, str]
    rows: Sequence[Row]

    def counts(self) -> dict[str, int]:
        """The number of outcomes with each word, those with 0 too."""
        words = [word(cell) for row in self.rows for cell in row.cells.values()]
        return {each: words.count(each) for each in _WORDS}

    @property
    def word(self) -> str:
        """The worst of all verdicts, as a word."""
        return next(each for each, count in self.counts().items() if count)

    @property
    def exit_code(self) -> int:
        """2 if something could not be judged, else 1 if violated, else 3 if undecided, else 0."""
        return {ERROR: 2, "VIOLATED": 1, "UNDECIDED": 3, "SATISFIED": 0}[self.word]

    def failures(self) -> dict[str, tuple[Failure, list[str]]]:
        """For each message of an error the error and the traces that have it."""
        found: dict[str, tuple[Failure, list[str]]] = {}
        for row in self.rows:
            for cell in row.cells.values():
                if isinstance(cell, Failure):
                    _, traces = found.setdefault(cell.message, (cell, []))
                    if row.trace not in traces[-1:]:
                        traces.append(row.trace)
        return found

    def worst_requirement(self) -> tuple[str, str] | None:
        """The name of the requirement that most traces violate, and why; None if none was judged.

        Of several it is the one that is undecided in most traces, then the one of the least
        robustness, then the first.
        """
        columns = {
            name: {
                row.trace: outcome
                for row in self.rows
                if isinstance(outcome := row.cells[name], Outcome)
            }
            for name in self.formulas
        }
        found = _worst(columns)
        if found is None:
            return None
        name, counts, least = found
        total = len(columns[name])
        words = [f"{word} in {n} of {counted(total, 'trace')}" for word, n in counts if n]
        words.append(f"least {number(columns[name][least].robustness + 0.0)} in {least}")
        return name, ", ".join(words)

    def worst_trace(self) -> tuple[str, str] | None:
        """The name of the trace that violates most requirements, and why; None if none was judged.

        Of several it is the one with most that are undecided, then that of the least robustness.
        """
        rows = {row.trace: row.outcomes for row in self.rows}
        found = _worst(rows)
        if found is None:
            return None
        name, counts, least = found
        total = len(rows[name])
        words = [f"{n} of {counted(total, 'requirement')} {word}" for word, n in counts if n]
        words.append(f"least {number(rows[name][least].robustness + 0.0)} of {least}")
        return name, ", ".join(words)


def _worst(
    lines: Mapping[str, Mapping[str, Outcome]],
) -> tuple[str, list[tuple[str, int]], str] | None:
    """The worst row or column: its name, its open and violated verdicts, and where it is least."""
    best: tuple[int, int, float] | None = None
    found = None
    for name, line in lines.items():
        if not line:
            continue
        verdicts = [outcome.verdict for outcome in line.values()]
        violated, open_ = verdicts.count(Verdict.VIOLATED), verdicts.count(Verdict.UNDECIDED)
        values = {other: outcome.robustness for other, outcome in line.items()}
        least = min(values, key=lambda other: (values[other], math.copysign(1.0, values[other])))
        badness = violated, open_, -values[least]
        if best is None or badness > best:
            best = badness
            found = name, [("violated", violated), ("undecided", open_)], least
    return found
