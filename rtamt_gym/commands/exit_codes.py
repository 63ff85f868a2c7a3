"""The exit codes of commands, and the warnings on verdicts that rest on little evidence."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

from rtamt_gym.tables import wrapped

if TYPE_CHECKING:
    from rtamt_gym.results.outcome import Word
    from rtamt_gym.results.table import Results
if TYPE_CHECKING:
    from rtamt_gym.play.record import Record


@dataclass(frozen=True, slots=True)
class Required:
    """Evidence that a command requires for every requirement with an implication.

    Attributes:
        triggered: The number of trials that must trigger the requirement, or ``"all"``; None: any
            number.
        answered: Whether the verdict of at least one trial must rest on an answer.
    """

    triggered: int | Literal["all"] | None = None
    answered: bool = False

    @classmethod
    def of(cls, options: Any) -> Required:  # noqa: ANN401 - a namespace of argparse
        """Return the evidence that the options of a command require."""
        triggered = options.require_triggered
        if triggered is None and options.require_answered:
            triggered = 1
        return cls(triggered, options.require_answered)


INTERRUPTED: Final = 130
"""The exit code after Ctrl-C, as shells have it."""


@dataclass(frozen=True, slots=True)
class Hollow:
    """A warning on a verdict.

    Attributes:
        text: The warning, as in ``never asked: up was put to the test in 0 of 40 traces``.
        fails: Whether the command fails for it.
    """

    text: str
    fails: bool = False


def exit_code(words: Collection[Word], hollow: Iterable[Hollow] = ()) -> int:
    """Return the exit code of a command: the first of 2, 1, 3 and 0 for which there is a reason.

    Bad input is 2 too, before there is anything to judge: an error, which `rtamt_gym.__main__`
    says.

    Args:
        words: What became of requirements, in words, each once or more often.
        hollow: What the verdicts leave out.

    Example:
        >>> exit_code({"violated", "failed"}), exit_code({"violated", "undecided"})
        (2, 1)
        >>> exit_code({"satisfied", "undecided"}), exit_code({"satisfied"})
        (3, 0)
        >>> never = Hollow("never asked: up was put to the test in 0 of 3 traces", fails=True)
        >>> exit_code({"satisfied"}, [never]), exit_code({"violated"}, [never])
        (3, 1)
    """
    if "failed" in words:
        return 2
    if "violated" in words:
        return 1
    return 3 if "undecided" in words or any(warning.fails for warning in hollow) else 0


def undecided(results: Results, what: str, *, fails: bool) -> list[Hollow]:
    """Return the warnings on undecided trials.

    Args:
        results: The trials.
        what: What a trial is, in a word.
        fails: Whether the command is to fail for a requirement of which nothing is decided.
    """
    from rtamt_gym.results.undecided import decides_nothing, undecided_texts

    return [
        Hollow(text, fails and decides_nothing(results, name))
        for name, text in undecided_texts(results, what).items()
    ]


def unasked(results: Results, what: str, required: Required) -> list[Hollow]:
    """Return the warnings on requirements that were never triggered or never answered.

    Args:
        results: The trials.
        what: What a trial is, in a word.
        required: The evidence that the command requires; it fails if some is missing.
    """
    from rtamt_gym.results.asked import (
        never_answered_texts,
        never_asked_lines,
        partly_asked_lines,
        seldom_triggered_texts,
    )

    triggered = required.triggered
    fails = triggered is not None
    warnings = [Hollow(text, fails) for text in never_asked_lines(results, what)]
    seldom = seldom_triggered_texts(results, triggered, what)
    warnings += [Hollow(text, fails=True) for text in seldom.values()]
    warnings += [Hollow(text) for text in partly_asked_lines(results, what)]
    if required.answered:
        texts = never_answered_texts(results, what).values()
        warnings += [Hollow(text, fails=True) for text in texts]
    return warnings


def tell(hollow: Collection[Hollow], *, stderr: bool = False) -> None:
    """Print warnings after an empty line, in lines of at most 80 columns.

    Args:
        hollow: What they leave out.
        stderr: Whether it is printed to standard error, as where standard output holds JSON.
    """
    lines = [] if stderr or not hollow else [""]
    for warning in hollow:
        lines += wrapped(warning.text)
    if lines:
        print(*lines, sep="\n", file=sys.stderr if stderr else sys.stdout, flush=True)


def hollow_failures(record: Record, options: argparse.Namespace, shown: str) -> list[Hollow]:
    """Return the warning on failed simulations, which fails if more failed than are allowed.

    Args:
        record: The simulations.
        options: The arguments, with ``--allow-failures``.
        shown: What the others show, and how many failed.
    """
    failed, allowed = len(record.failed()), options.allow_failures
    if not failed or allowed is None:
        return []
    switch = f"--allow-failures {max(failed, allowed)}"
    if failed > allowed:
        return [Hollow(f"{shown} ({switch} would let them pass)", fails=True)]
    return [Hollow(f"{shown} ({switch} lets them pass)")]
