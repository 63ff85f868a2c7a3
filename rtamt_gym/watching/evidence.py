"""The evidence for the verdicts of a stream: how often its traces trigger implications."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import rtamt
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.outcome import Failure, Outcome
from rtamt_gym.results.trial import Trial
from rtamt_gym.results.warnings import VerdictWarning, bare_variable_warnings, evidence_warnings

_MOST: Final = 1_000_000
"""The maximum number of rows of all traces that are kept to count triggers."""

_TRACE: Final = 1000
"""The minimum number of rows that a trace counts."""

JudgeTrace = Callable[[str, rtamt.Specification], rtamt.Judgement]
"""Judges a requirement on the rows of a trace."""


class StreamEvidence:
    """The triggers of implications on the traces of a stream.

    Args:
        specs: The requirements by name.
        view: ``"episode"`` or ``"step"``.
    """

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
        """Count the triggers of a trace at its end.

        Args:
            judge: Judges a requirement of this name on the trace.
        """
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
