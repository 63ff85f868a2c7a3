"""What runs leave undecided: nothing is known of a requirement there."""

from __future__ import annotations

from rtamt import Verdict
from rtamt_gym.results.table import Results
from rtamt_gym.tables import counted

__all__ = ["decides_nothing", "undecided_in", "undecided_texts"]


def undecided_in(results: Results, name: str) -> tuple[int, int]:
    """How many trials leave a requirement undecided, and how many were judged."""
    verdicts = _verdicts(results, name)
    return verdicts.count(Verdict.UNDECIDED), len(verdicts)


def decides_nothing(results: Results, name: str) -> bool:
    """Whether trials leave a requirement undecided, and none decides it."""
    return set(_verdicts(results, name)) == {Verdict.UNDECIDED}


def undecided_texts(results: Results, what: str) -> dict[str, str]:
    """How many trials leave a requirement undecided, for each that some do.

    Args:
        results: The trials.
        what: What a trial is, in a word.
    """
    counts = {name: undecided_in(results, name) for name in results.requirements}
    return {
        name: f"undecided: {name} in {left} of {counted(every, what)}"
        for name, (left, every) in counts.items()
        if left
    }


def _verdicts(results: Results, name: str) -> list[Verdict]:
    """The verdicts on a requirement in all trials that were judged."""
    judged = (row.judged(name) for row in results)
    return [each.verdict for each in judged if each is not None]
