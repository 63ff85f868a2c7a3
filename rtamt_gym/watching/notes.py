"""Notes on how the rows of a stream were read, and warnings on the verdicts, as for files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt.errors import shown
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.outcome import Failure, Outcome
from rtamt_gym.results.trial import Trial
from rtamt_gym.results.warnings import VerdictWarning, bare_variable_warnings, evidence_warnings
from rtamt_gym.tables import counted, number


class StreamNotes:
    """The notes on all traces of a stream.

    Attributes:
        held: The number of empty cells of each variable that hold the value before.
        no_events: The number of empty cells of each variable that do not count as events.
        dropped: The number of rows with an empty cell that were left out.
    """

    def __init__(self) -> None:
        self.held, self.no_events = Counter[str](), Counter[str]()
        self._defaults: dict[str, None] = {}
        self.dropped = 0
        self._unknown = Counter[str]()
        self._first: dict[str, str] = {}
        self._unit = self._period = ""
        self._periods = 0

    def add_unknown(
        self, names: Sequence[str], empty: NDArray[np.bool_], lines: Sequence[int]
    ) -> None:
        """Count empty cells that are unknown."""
        for place in np.nonzero(empty.any(axis=0))[0].tolist():
            name, cells = names[place], empty[:, place]
            self._unknown[name] += int(cells.sum())
            self._first.setdefault(name, f"line {lines[int(cells.argmax())]}")

    def add_unknown_event(self, name: str, time: float) -> None:
        """Count an event without a number."""
        self._unknown[name] += 1
        self._first.setdefault(name, f"{number(time)} s")

    def add_default(self, text: str) -> None:
        """Add the note on a variable with its default value; equal notes are printed once."""
        self._defaults[text] = None

    def add_unit(self, text: str) -> None:
        """Add the note on the unit of a trace; only the first is printed."""
        self._unit = self._unit or text

    def add_period(self, text: str, group: str | None) -> None:
        """Add the note on times that a stated period ignores; only the first is printed."""
        if text:
            self._periods += 1
            place = "" if group is None else f"group {shown(group)!r}: "
            self._period = self._period or f"{place}{text}"

    def texts(self, *, dense: bool) -> list[str]:
        """Return the notes in sentences."""
        texts = []
        if any(self.held.values()):
            counts = ", ".join(f"{name}: {count}" for name, count in self.held.items() if count)
            texts.append(f"empty cells hold the value before ({counts})")
        if self.no_events:
            counts = ", ".join(f"{name}: {count}" for name, count in self.no_events.items())
            texts.append(f"empty cells are not events: the value before holds ({counts})")
        texts += self._defaults
        if self.dropped:
            rows = f"{self.dropped} row{'s' * (self.dropped > 1)}"
            texts.append(f"{rows} with an empty cell left out")
        if self._unknown:
            place = "at" if dense else "in"
            counts = ("; " if dense else ", ").join(
                f"{name}: {count}, the first {place} {self._first[name]}"
                for name, count in self._unknown.items()
            )
            cells = "events without a number are unknown" if dense else "empty cells are unknown"
            texts.append(f"{cells}{'' if dense else ' samples'} ({counts})")
        period = self._period
        if self._periods > 1:
            period += f" (and {counted(self._periods - 1, 'more group')} with other times)"
        return [*texts, *filter(None, [self._unit, period])]


_MOST: Final = 1_000_000
"""The maximum number of rows of all traces that are kept to count triggers."""

_TRACE: Final = 1000
"""The minimum number of rows that a trace counts."""

JudgeTrace = Callable[[str, rtamt.Specification], rtamt.Judgement]
"""Judges a requirement on the rows of a trace."""


class StreamEvidence:
    """The triggers of implications on the traces of a stream."""

    def __init__(self, specs: Mapping[str, rtamt.Specification], view: str) -> None:
        self._specs = specs
        self._viewed = {name: viewed(spec, view) for name, spec in specs.items()}
        self.counted = [
            name
            for name, spec in self._viewed.items()
            if any(node.op is not None and node.op.name == "implies" for node in spec.nodes())
        ]
        """The requirements with an implication."""
        self._left = _MOST
        self._trials: list[Trial] = []

    def begin(self) -> None:
        """Count a new trace."""
        self.add(_TRACE)

    def add(self, rows: int) -> bool:
        """Count rows; return whether the trace must keep them."""
        self._left -= rows
        if self._left < 0:
            self.counted = []
        return bool(self.counted)

    def finish(self, judge: JudgeTrace) -> None:
        """Count the triggers of a trace at its end."""
        cells: dict[str, Outcome | Failure] = {}
        for name in self.counted:
            result = judge(name, self._viewed[name])
            cells[name] = Outcome(
                *(result.robustness, result.lower, result.upper, result.verdict, None),
                triggers=result.triggers,
                vacuous=result.vacuous,
                unknown=result.unknown,
            )
        self._trials.append(Trial.of_trace(str(len(self._trials)), "", cells))

    def warnings(self) -> list[VerdictWarning]:
        """Return the warnings on the verdicts, as for recorded traces."""
        texts = {name: str(spec.standalone()) for name, spec in self._specs.items()}
        if self._left < 0:
            text = f"triggers of implications are not counted in more than {_MOST} rows"
            return [*bare_variable_warnings(texts), VerdictWarning(text)]
        if not self._trials:
            return [*bare_variable_warnings(texts)]
        return evidence_warnings(Matrix(self._trials, texts))
