"""The first line of a page: passed, failed or undecided, with its evidence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple, get_args

from rtamt_gym.reports.model import Requirement, Section
from rtamt_gym.results.mutation import below, percent
from rtamt_gym.results.outcome import Word
from rtamt_gym.results.warnings import never_triggered_word
from rtamt_gym.tables import counted


class Standing(NamedTuple):
    """The line at the head of a page.

    Attributes:
        verdict: The worst that became of a requirement.
        text: The word for it, with its evidence.
    """

    verdict: Word
    text: str


_HEADS: Final[dict[Word, str]] = {
    "violated": "Failed",
    "failed": "Undecided",
    "undecided": "Undecided",
    "satisfied": "Passed",
}

_WORST: Final[tuple[Word, ...]] = ("violated", "failed", "undecided", "satisfied")

_NAMED: Final = 5
"""The most requirements that are named."""


def standing_of(sections: Sequence[Section]) -> Standing | None:
    """Return the line for the sections of a page; None if no section judges a requirement.

    Each requirement counts once, with the worst that became of it in any section; so does each
    episode, however many requirements it was judged under. A rate that sequential stopping has
    compared with a target counts as it was answered. Verdicts of traces that test requirements, by
    the mutants that they kill, do not count.
    """
    same: dict[tuple[str, str], list[Requirement]] = {}
    for section in sections:
        for item in _judged(section) if section.mutants is None else ():
            same.setdefault(key_of(item), []).append(item)
    mutants = _mutants(sections)
    if not same:
        return None if mutants is None else _of_mutants(sections, mutants)
    words = Counter(min(map(word_of, those), key=_WORST.index) for those in same.values())
    worst = next(word for word in _WORST if words[word])
    counts = [f"{words[word]} {word}" for word in (*get_args(Word)[1:], "failed") if words[word]]
    never: dict[str, list[str]] = {}
    for (name, _), those in same.items():
        triggers = [item.asked[0] for item in those if item.asked is not None]
        if triggers and not any(triggers):
            unknown = any(item.unknown for item in those if item.asked is not None)
            never.setdefault(never_triggered_word(unknown=unknown), []).append(name)
    judged = [item for those in same.values() for item in those]
    defaults = dict.fromkeys(item.name for item in judged if item.defaults)
    parts = [
        f"of {counted(len(same), 'requirement')} {', '.join(counts)}",
        *_runs(sections),
        *(f"{word}: {', '.join(names)}" for word, names in never.items()),
        *([f"on defaults: {', '.join(defaults)}"] if defaults else []),
        *([] if mutants is None else [mutants]),
    ]
    return Standing(worst, f"{_HEADS[worst]}: {'; '.join(parts)}.")


def _judged(section: Section) -> list[Requirement]:
    """Return the requirements of a section that are judged, each by itself."""
    return [r for r in section.requirements if not (r.legend or r.together)]


def _required(sections: Sequence[Section]) -> tuple[float | None, list[str]]:
    """Return the share of killed mutants that was required, and the requirements below it."""
    required = [section.min_share for section in sections if section.min_share is not None]
    names = [
        name for section in sections for name in below(section.mutants or {}, section.min_share)
    ]
    return max(required, default=None), names


def _mutants(sections: Sequence[Section]) -> str | None:
    """Return how many mutants the traces kill; None if no traces were judged as tests."""
    tested = [section.mutants for section in sections if section.mutants is not None]
    if not tested:
        return None
    scores = [score for mutants in tested for score in mutants.values()]
    killed = sum(score.count("noticed") for score in scores)
    text = f"mutants killed: {killed} of {sum(score.different for score in scores)}"
    required, names = _required(sections)
    if not names or required is None:
        return text
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{text}, less than {percent(required)} of {', '.join(names[:_NAMED])}{more}"


def _of_mutants(sections: Sequence[Section], text: str) -> Standing:
    """Return the line of a page that judges mutants only."""
    parts = "; ".join([text, *_runs(sections)])
    tested = [section for section in sections if section.mutants is not None]
    if any(requirement.counts.failed for section in tested for requirement in section.requirements):
        return Standing("failed", f"{_HEADS['failed']}: {parts}.")
    required, names = _required(sections)
    if required is not None:
        word: Word = "undecided" if names else "satisfied"
        return Standing(word, f"{_HEADS[word]}: {parts}.")
    scores = [score for section in tested for score in (section.mutants or {}).values()]
    survived = any(score.count("noticed") < score.different for score in scores)
    return Standing("undecided" if survived else "satisfied", f"{parts[0].upper()}{parts[1:]}.")


def key_of(requirement: Requirement) -> tuple[str, str]:
    """Return the common status of one requirement in several sections."""
    return requirement.name, requirement.formula


def word_of(requirement: Requirement) -> Word:
    """Return the worst that became of a requirement; undecided if nothing judged it."""
    if requirement.answer is not None:
        return requirement.answer
    counts = requirement.counts
    return next((word for word in _WORST if getattr(counts, word)), "undecided")


def _runs(sections: Sequence[Section]) -> Iterator[str]:
    """Yield how many episodes, simulations and traces were judged, and how many failed."""
    judged: Counter[str] = Counter()
    failed: Counter[str] = Counter()
    for section in sections:
        own = _judged(section)
        if not own:
            continue
        # A trace may fail under one requirement alone; of more trials than are shown, most do.
        labels = {
            t.label for requirement in own for t in requirement.trials if t.verdict == "failed"
        }
        lost = max(len(labels), *(requirement.counts.failed for requirement in own))
        judged[section.noun] += max(requirement.counts.episodes for requirement in own) - lost
        failed[section.noun] += lost
    for noun in judged:
        text = f"{counted(judged[noun], noun)} evaluated"
        yield f"{text}, {failed[noun]} failed" if failed[noun] else text
