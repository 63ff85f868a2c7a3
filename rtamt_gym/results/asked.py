"""What nothing has put to the test, and what needed no answer, over many runs or traces."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Literal

from rtamt import Asked, DenseAsked
from rtamt_gym.results.outcome import Outcome
from rtamt_gym.results.table import Results
from rtamt_gym.tables import counted, shorten, wrapped

__all__ = [
    "asked_in",
    "asked_line",
    "asked_said",
    "asked_texts",
    "never_answered_texts",
    "never_asked",
    "never_asked_lines",
    "never_asked_texts",
    "never_asked_word",
    "partly_asked_lines",
    "rests_on_unknown",
    "seldom_triggered_texts",
]


def asked_in(results: Results, name: str) -> tuple[int, int] | None:
    """How many trials have put a requirement to the test, and of how many that is known.

    None if it has no implication that could be, or nobody has counted.
    """
    found = _counted(results, name)
    return (sum(bool(each.occasions) for each in found), len(found)) if found else None


def never_asked(results: Results) -> list[str]:
    """The requirements with implications that no trial has put to the test."""
    counts = {name: asked_in(results, name) for name in results.requirements}
    return [name for name, count in counts.items() if count is not None and not count[0]]


def never_asked_word(*, unknown: bool) -> str:
    """What is said where nothing was put to the test for certain.

    Args:
        unknown: Whether values are not known, so that the left side of an implication may hold.
    """
    return "not asked for certain" if unknown else "never asked"


def rests_on_unknown(results: Results, name: str) -> bool:
    """Whether values are not known in a trial in which somebody has counted."""
    return any(each.unknown for each in _counted(results, name))


def never_asked_texts(results: Results, what: str = "trace") -> dict[str, str]:
    """A text for each requirement that nothing has put to the test, by its name.

    Args:
        results: The trials.
        what: What a trial is, in a word.
    """
    texts = {}
    for name in never_asked(results):
        unknown = rests_on_unknown(results, name)
        texts[name] = (
            f"{never_asked_word(unknown=unknown)}: {name} was put to the test"
            f"{' for certain' * unknown} in 0 of {counted(len(_counted(results, name)), what)}"
        )
    return texts


def seldom_triggered_texts(
    results: Results, least: int | Literal["all"] | None, what: str = "trace"
) -> dict[str, str]:
    """Return a text for each requirement that some trials triggered, but too few.

    Args:
        results: The trials.
        least: The number of trials that must trigger a requirement, or ``"all"`` that were judged;
            None: any number.
        what: The word for a trial.
    """
    texts = {}
    for name in results.requirements:
        count = asked_in(results, name)
        if count is None or least is None:
            continue
        triggered, judged = count
        if 0 < triggered < (judged if least == "all" else least):
            texts[name] = (
                f"triggered too seldom: {name} in {triggered} of {counted(judged, what)}"
                f"{' for certain' * rests_on_unknown(results, name)}; "
                f"--require-triggered={least} requires {least}"
            )
    return texts


def never_answered_texts(results: Results, what: str = "trace") -> dict[str, str]:
    """A text for each requirement that was put to the test and hung on an answer in no trial.

    Args:
        results: The trials.
        what: What a trial is, in a word.
    """
    texts = {}
    for name in results.requirements:
        found = _counted(results, name)
        asked = any(each.occasions for each in found)
        if asked and not any(each.answered for each in found):
            every = counted(len(found), what)
            texts[name] = f"never answered: {name} hung on an answer in 0 of {every}"
    return texts


def never_asked_lines(results: Results, what: str = "trace") -> list[str]:
    """The texts of `never_asked_texts`."""
    return list(never_asked_texts(results, what).values())


def partly_asked_lines(results: Results, what: str = "trace") -> list[str]:
    """A text for what is hollow in requirements that were put to the test.

    These are implications of several that nothing has put to the test, and requirements that were
    satisfied without an answer although they were put to the test.

    Args:
        results: The trials.
        what: What a trial is, in a word.
    """
    lines = []
    for name in results.requirements:
        found = _counted(results, name)
        every = f"of {counted(len(found), what)}"
        if not any(each.occasions for each in found):
            continue
        word = never_asked_word(unknown=rests_on_unknown(results, name))
        asked: dict[str, int] = {}
        for outcome in found:
            for each in outcome.asked or ():
                asked[each.text] = asked.get(each.text, 0) + each.occasions
        lines += [
            f"{word} in {name}: {shorten(text, 60)} in 0 {every}"
            for text, times in asked.items()
            if not times
        ]
        unanswered = sum(each.vacuous and not each.never_asked for each in found)
        if unanswered:
            lines.append(f"satisfied without an answer: {name} in {unanswered} {every}")
    return lines


def asked_texts(asked: Sequence[Asked | DenseAsked], instant: Callable[[float], str]) -> list[str]:
    """How many times each implication was put to the test, in words; empty if none was.

    Args:
        asked: The rows of the implications.
        instant: Writes a sample, or in dense time a time.
    """
    return [
        f"asked {each.occasions}x, first at {instant(each.first)}"
        + ", satisfied without an answer" * each.vacuous
        + f": {each.text}" * (len(asked) > 1)
        for each in asked
        if each.first is not None
    ]


def asked_said(results: Results, what: str = "trace", before: Iterable[str] = ()) -> list[str]:
    """What is hollow in requirements with implications, in lines of at most 80 columns.

    An empty line stands above; there is no line if nothing is hollow.

    Args:
        results: The trials.
        what: What a trial is, in a word.
        before: Texts for what else is hollow, which stand before it.
    """
    texts = [*before, *never_asked_lines(results, what), *partly_asked_lines(results, what)]
    lines = [line for text in texts for line in wrapped(text)]
    return [""] * bool(lines) + lines


def asked_line(results: Results, what: str = "trace") -> str:
    """How many trials have put each requirement with an implication to the test; may be empty."""
    counts = {name: asked_in(results, name) for name in results.requirements}
    said = [
        f"{name} in {of[0]} of {counted(of[1], what)}"
        + " for certain" * rests_on_unknown(results, name)
        for name, of in counts.items()
        if of
    ]
    return f"asked: {', '.join(said)}" if said else ""


def _counted(results: Results, name: str) -> list[Outcome]:
    """The outcomes of a requirement with implications for which somebody has counted."""
    judged = (row.judged(name) for row in results.rows)
    return [each for each in judged if each is not None and each.asked]
