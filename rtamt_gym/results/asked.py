"""Which requirements nothing has put to the test, over many runs or traces."""

from __future__ import annotations

from rtamt_gym.results.table import Results
from rtamt_gym.tables import counted

__all__ = ["asked_in", "never_asked", "never_asked_lines"]


def asked_in(results: Results, name: str) -> tuple[int, int] | None:
    """How many trials have put a requirement to the test, and how many have judged it.

    None if it has no implication that could be, or no trial has judged it.
    """
    judged = [row.outcomes[name] for row in results.rows if name in row.outcomes]
    if not any(outcome.asked for outcome in judged):
        return None
    asked = sum(any(each.occasions for each in outcome.asked) for outcome in judged)
    return asked, len(judged)


def never_asked(results: Results) -> list[str]:
    """The requirements with implications that no trial has put to the test."""
    counts = {name: asked_in(results, name) for name in results.requirements}
    return [name for name, count in counts.items() if count is not None and not count[0]]


def never_asked_lines(results: Results, what: str = "trace") -> list[str]:
    """A text for each requirement that nothing has put to the test.

    Args:
        results: The trials.
        what: What a trial is, in a word.
    """
    lines = []
    for name in never_asked(results):
        _, judged = asked_in(results, name) or (0, 0)
        lines.append(f"never asked: {name} was put to the test in 0 of {counted(judged, what)}")
    return lines
