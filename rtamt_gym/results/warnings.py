"""Warnings on verdicts that rest on little evidence, and the exit codes of commands.

Commands, JUnit, Markdown and the page read the same list of `VerdictWarning`. This module imports
little, because every command imports it.

To add a warning: a function here that returns `VerdictWarning` objects, with ``fails`` set if an
option makes the command fail. Add a row to ``docs/warnings.md`` and the command that shows it to
``tests/rtamt_gym/commands/test_warnings_page.py``, which checks the output and the exit code of
every row.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

from rtamt_gym.tables import counted, shorten, wrapped

if TYPE_CHECKING:
    from fractions import Fraction

    import rtamt
    from rtamt.monitors import TriggerCount
    from rtamt_gym.results.outcome import Failure, Outcome, Word
    from rtamt_gym.results.statistics import Results
    from rtamt_gym.results.trial import Trial

INTERRUPTED: Final = 130
"""The exit code after Ctrl-C, as in shells."""

NEVER: Final = "never asked"
"""The kind of a warning on a requirement that no trial triggered, a failure type of JUnit."""

_NAMED: Final = 3
"""The maximum number of traces that a warning names."""


@dataclass(frozen=True, slots=True)
class VerdictWarning:
    """A warning on verdicts.

    Attributes:
        text: The warning, as in ``never triggered: up in 0 of 40 traces``; empty if the verdict
            already shows it.
        kind: The type of its failures in JUnit.
        requirement: The requirement of the warning; empty if it is about trials.
        cells: The text of each of its failures in JUnit, by trial and requirement; an empty name
            stands for all.
        fails: Whether an option makes the command fail for it.
    """

    text: str
    kind: str = ""
    requirement: str = ""
    cells: Mapping[tuple[str, str], str] = field(default_factory=dict)
    fails: bool = field(default=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class Required:
    """Evidence that a command requires for every requirement with an implication."""

    triggered: int | Literal["all"] | None = None
    answered: bool = False

    @classmethod
    def of(cls, options: Any) -> Required:  # noqa: ANN401 - a namespace of argparse
        """Return the evidence that the options of a command require."""
        triggered = options.require_triggered
        if triggered is None and options.require_answered:
            triggered = 1
        return cls(triggered, options.require_answered)


def exit_code(words: Collection[Word], warnings: Iterable[VerdictWarning] = ()) -> int:
    """Return the exit code of a command: the first of 2, 1, 3 and 0 that applies.

    Bad input also exits with 2, through an error that `rtamt_gym.__main__` prints.

    Example:
        >>> exit_code({"violated", "failed"}), exit_code({"violated", "undecided"})
        (2, 1)
        >>> exit_code({"satisfied", "undecided"}), exit_code({"satisfied"})
        (3, 0)
        >>> never = VerdictWarning("never triggered: up in 0 of 3 traces", fails=True)
        >>> exit_code({"satisfied"}, [never]), exit_code({"violated"}, [never])
        (3, 1)
    """
    if "failed" in words:
        return 2
    if "violated" in words:
        return 1
    return 3 if "undecided" in words or any(warning.fails for warning in warnings) else 0


def print_warnings(warnings: Iterable[VerdictWarning], *, stderr: bool = False) -> None:
    """Print warnings after an empty line, in lines of at most 80 columns."""
    lines = [line for warning in warnings for line in wrapped(warning.text)]
    if lines:
        lines = lines if stderr else ["", *lines]
        print(*lines, sep="\n", file=sys.stderr if stderr else sys.stdout, flush=True)


def evidence_warnings(
    results: Results, trial: str = "trace", required: Required = Required()
) -> list[VerdictWarning]:
    """Return the warnings on requirements with implications.

    They report requirements and implications that no trial triggered, requirements that too few
    triggered, and verdicts that did not rest on an answer.
    """
    never, seldom, partly, unanswered = [], [], list[VerdictWarning](), []
    for name in results.requirements:
        outcomes = _counted(results, name)
        if not outcomes:
            continue
        total, cells = counted(len(outcomes), trial), ("", name)
        certain = " for certain" * any(outcome.unknown for outcome in outcomes)
        triggered = sum(bool(outcome.trigger_count) for outcome in outcomes)
        if not triggered:
            word = never_triggered_word(unknown=bool(certain))
            text = f"{word}: {name} in 0 of {total}"
            fails = required.triggered is not None
            never.append(VerdictWarning(text, NEVER, name, {cells: text}, fails=fails))
            continue
        limit = len(outcomes) if required.triggered == "all" else required.triggered or 0
        if triggered < limit:
            text = (
                f"triggered too seldom: {name} in {triggered} of {total}{certain}; "
                f"--require-triggered={required.triggered} requires {required.triggered}"
            )
            rows = [
                row for row in results.rows if not (o := row.judged(name)) or not o.trigger_count
            ]
            failing = {(row.name, name): text for row in rows}
            kind = "triggered too seldom"
            seldom.append(VerdictWarning(text, kind, name, failing, fails=True))
        partly += map(VerdictWarning, _partly_triggered(name, outcomes, total, certain))
        if required.answered and not any(outcome.answered for outcome in outcomes):
            text = f"never answered: {name} depended on an answer in 0 of {total}"
            kind = "never answered"
            unanswered.append(VerdictWarning(text, kind, name, {cells: text}, fails=True))
    without = _without_implications(results, required)
    return [
        *bare_variable_warnings(results.requirements),
        *without,
        *never,
        *seldom,
        *partly,
        *unanswered,
    ]


def bare_variable_warnings(requirements: Mapping[str, str]) -> Iterator[VerdictWarning]:
    """Yield warnings on variables that stand alone as formulas, which 0 satisfies."""
    for name, text in requirements.items():
        if bare := bare_variables(text):
            first = bare[0]
            yield VerdictWarning(
                f"{first} alone in {name} means {first} >= 0, which 0 satisfies; write "
                f"'{first} > 0' for a flag, or '{first} >= 0'",
                requirement=name,
            )


def bare_variables(text: str) -> list[str]:
    """Return the variables that stand alone as formulas in the text of a requirement.

    Example:
        >>> bare_variables("always(brake or speed < 30)")
        ['brake']
    """
    import rtamt

    try:
        nodes = rtamt.parse(text).formula.nodes()
    except rtamt.RtamtError:  # the text names a file or a result of another version
        return []
    leaves = [
        node.args[0].leaf for node in nodes if node.op is not None and node.op.name == "value"
    ]
    return [leaf for leaf in leaves if isinstance(leaf, str)]


def _without_implications(results: Results, required: Required) -> Iterator[VerdictWarning]:
    """Yield the warning that nothing can be triggered, if a command requires a trigger."""
    judged = [outcome for row in results.rows for outcome in row.outcomes.values()]
    outcomes = [outcome for outcome in judged if isinstance(getattr(outcome, "triggers", 0), tuple)]
    if required.triggered is None or not outcomes or any(outcome.triggers for outcome in outcomes):
        return
    names = ", ".join(results.requirements)
    option = "--require-answered" if required.answered else "--require-triggered"
    text = (
        f"no implication to trigger: {names}; write 'p implies q' for 'not p or q', or remove "
        f"{option}"
    )
    cells = {("", name): text for name in results.requirements}
    yield VerdictWarning(text, NEVER, names, cells, fails=True)


def _partly_triggered(
    name: str, outcomes: Sequence[Outcome], total: str, certain: str
) -> Iterator[str]:
    """Yield texts on implications that were not triggered, and on verdicts without an answer."""
    times = Counter[str]()
    for outcome in outcomes:
        for implication in outcome.triggers or ():
            times[implication.text] += implication.count
    word = never_triggered_word(unknown=bool(certain))
    for text, count in times.items():
        if not count:
            yield f"{word} in {name}: {shorten(text, 60)} in 0 of {total}"
    unanswered = sum(outcome.vacuous and not outcome.never_triggered for outcome in outcomes)
    if unanswered:
        yield f"satisfied without an answer: {name} in {unanswered} of {total}"


def undecided_warnings(results: Results, trial: str, *, fails: bool) -> list[VerdictWarning]:
    """Return the warnings on undecided trials."""
    counts = {name: undecided_in(results, name) for name in results.requirements}
    return [
        VerdictWarning(
            f"undecided: {name} in {undecided} of {counted(judged, trial)}",
            requirement=name,
            fails=fails and undecided == judged,
        )
        for name, (undecided, judged) in counts.items()
        if undecided
    ]


def undecided_cells(results: Results) -> VerdictWarning:
    """Return the warning that makes every undecided verdict a failure in JUnit."""
    cells = {}
    for row in results.rows:
        for name, outcome in row.outcomes.items():
            if outcome.verdict.name == "UNDECIDED":
                reasons = (*outcome.not_recorded, outcome.way_out)
                cells[row.name, name] = "; ".join(filter(None, reasons)) or outcome.text
    return VerdictWarning("", "undecided", cells=cells, fails=True)


def length_warnings(rows: Sequence[Trial], minimum: Fraction | None) -> list[VerdictWarning]:
    """Return the warning on traces shorter than ``minimum`` seconds; none without a minimum."""
    from rtamt_gym.results.extent import short_text

    extents = {row.name: extent for row in rows if (extent := row.judged_extent) is not None}
    if minimum is None or not (text := short_text(extents, minimum)):
        return []
    texts = {name: short_text({name: extent}, minimum) for name, extent in extents.items()}
    cells = {(name, ""): short for name, short in texts.items() if short}
    return [VerdictWarning(text, "too short", cells=cells, fails=True)]


def range_warnings(rows: Sequence[Trial]) -> list[VerdictWarning]:
    """Return the warning on traces with values outside declared ranges."""
    names = [row.name for row in rows if row.outside]
    if not names:
        return []
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    text = f"outside declared ranges: {', '.join(names[:_NAMED])}{more}"
    cells = {(row.name, name): outside for row in rows for name, outside in row.outside.items()}
    return [VerdictWarning(text, "out of range", cells=cells, fails=True)]


def failure_warnings(failed: int, allowed: int | None, text: str) -> list[VerdictWarning]:
    """Return the warning on failed simulations, which fails if more failed than are allowed."""
    if not failed or allowed is None:
        return []
    fails = failed > allowed
    lets = "would let them pass" if fails else "lets them pass"
    return [VerdictWarning(f"{text} (--allow-failures {max(failed, allowed)} {lets})", fails=fails)]


def failing_cell(
    warnings: Iterable[VerdictWarning], trial: str, requirement: str, cell: Outcome | Failure
) -> tuple[str, str] | None:
    """Return the kind and text of the warning that fails a requirement on a trial.

    None without such a warning, and if the requirement is violated or could not be judged.
    """
    verdict = getattr(cell, "verdict", None)
    if verdict is None or verdict.name == "VIOLATED":
        return None
    kinds = {}
    for warning in warnings:
        keys = ((trial, requirement), ("", requirement), (trial, ""))
        text = next((warning.cells[key] for key in keys if key in warning.cells), "")
        if warning.fails and text:
            kinds[warning.kind] = text
    return (next(iter(kinds)), "; ".join(kinds.values())) if kinds else None


def failing_summary(warnings: Iterable[VerdictWarning]) -> str:
    """Return the reason for the failure of a command in a few words; empty without one."""
    names: dict[str, list[str]] = {}
    for warning in warnings:
        if warning.fails and warning.kind and warning.text:
            word = warning.text.partition(":")[0] if warning.requirement else warning.text
            names.setdefault(word, []).append(warning.requirement)
    return "; ".join(
        f"{word}: {', '.join(those)}" if any(those) else word for word, those in names.items()
    )


def evidence_lines(
    results: Results, trial: str, before: Iterable[VerdictWarning] = ()
) -> list[str]:
    """Return warnings as lines of 80 columns, after an empty line; no line without a warning."""
    warnings = [*before, *evidence_warnings(results, trial)]
    lines = [line for warning in warnings for line in wrapped(warning.text)]
    return [""] * bool(lines) + lines


def triggered_in(results: Results, name: str) -> tuple[int, int] | None:
    """Return the number of trials that triggered a requirement, and of trials with a count.

    None without an implication, or if triggers were not counted.
    """
    outcomes = _counted(results, name)
    return (sum(bool(o.trigger_count) for o in outcomes), len(outcomes)) if outcomes else None


def undecided_in(results: Results, name: str) -> tuple[int, int]:
    """Return how many trials leave a requirement undecided, and how many were judged."""
    judged = [outcome for row in results.rows if (outcome := row.judged(name)) is not None]
    return sum(outcome.verdict.name == "UNDECIDED" for outcome in judged), len(judged)


def never_triggered_word(*, unknown: bool) -> str:
    """Return the words for a requirement without a trigger."""
    return "not certainly triggered" if unknown else "never triggered"


def trigger_line(results: Results) -> str:
    """Return how many traces triggered each requirement with an implication; may be empty."""
    parts = []
    for name in results.requirements:
        if outcomes := _counted(results, name):
            certain = " for certain" * any(outcome.unknown for outcome in outcomes)
            triggered = sum(bool(outcome.trigger_count) for outcome in outcomes)
            parts.append(f"{name} in {triggered} of {counted(len(outcomes), 'trace')}{certain}")
    return f"triggered: {', '.join(parts)}" if parts else ""


def trigger_texts(
    implications: Sequence[TriggerCount | rtamt.dense.TriggerCount], instant: Callable[[float], str]
) -> list[str]:
    """Return how often each implication was triggered, in words; may be empty."""
    return [
        f"triggered {counted(row.count, 'time')}, first at {instant(row.first)}"
        + ", satisfied without an answer" * row.vacuous
        + f": {row.text}" * (len(implications) > 1)
        for row in implications
        if row.first is not None
    ]


def _counted(results: Results, name: str) -> list[Outcome]:
    """Return the outcomes of a requirement with counted triggers."""
    judged = (row.judged(name) for row in results.rows)
    return [outcome for outcome in judged if outcome is not None and outcome.triggers]
