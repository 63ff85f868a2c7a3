"""`Unmet`: what outcomes were to stand on and do not, so that the command fails for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rtamt import Verdict
from rtamt_gym.results.outcome import Failure, Outcome

__all__ = ["Unmet"]


@dataclass(frozen=True, slots=True)
class Unmet:
    """What a switch asks for and outcomes do not have.

    Attributes:
        unasked: For each requirement that nothing has put to the test, that in words.
        seldom: For each requirement that too few traces trigger, a text.
        unanswered: For each requirement of which no verdict hung on an answer, that in words.
        short: For each trace that is shorter than it is to be, that in words.
        outside: For each trace with values outside declared ranges, a text by requirement.
        undecided: Whether an undecided verdict counts as a failure.
        summary: All of it in a few words, for a heading; empty if there is nothing.
    """

    unasked: Mapping[str, str] = field(default_factory=dict)
    seldom: Mapping[str, str] = field(default_factory=dict)
    unanswered: Mapping[str, str] = field(default_factory=dict)
    short: Mapping[str, str] = field(default_factory=dict)
    outside: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    undecided: bool = False
    summary: str = ""

    def of(self, trace: str, requirement: str, cell: Outcome | Failure) -> tuple[str, str] | None:
        """What a requirement fails for on a trace: its kind and the words.

        None if there is nothing, and where the outcome is a failure of its own.
        """
        if isinstance(cell, Failure) or cell.verdict is Verdict.VIOLATED:
            return None
        reasons = (*cell.not_recorded, cell.way_out)
        undecided = self.undecided and cell.verdict is Verdict.UNDECIDED
        found = {
            "undecided": "; ".join(filter(None, reasons)) or cell.text if undecided else "",
            "never asked": self.unasked.get(requirement),
            "triggered too seldom": "" if cell.occasions else self.seldom.get(requirement),
            "never answered": self.unanswered.get(requirement),
            "too short": self.short.get(trace),
            "out of range": self.outside.get(trace, {}).get(requirement),
        }
        said = {kind: text for kind, text in found.items() if text}
        return (next(iter(said)), "; ".join(said.values())) if said else None
