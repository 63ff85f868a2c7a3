"""The one line at the head of a page: passed, failed or undecided, and what that stands on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

from rtamt_gym.reports.charts import NOUNS
from rtamt_gym.reports.model import Section, ShownRequirement
from rtamt_gym.reports.views import ComparedRequirement
from rtamt_gym.results.mutation import percent
from rtamt_gym.results.outcome import Word
from rtamt_gym.results.warnings import never_triggered_word
from rtamt_gym.tables import counted

__all__ = ["Standing", "key_of", "standing_of", "word_of"]


@dataclass(frozen=True, slots=True)
class Standing:
    """What a page says first.

    Attributes:
        verdict: The word for all: the worst that became of a requirement.
        text: The same in a word of its own, and what it stands on.
    """

    verdict: Word
    text: str


_SAID: Final[dict[Word, Literal["Failed", "Undecided", "Passed"]]] = {
    "violated": "Failed",
    "failed": "Undecided",
    "undecided": "Undecided",
    "satisfied": "Passed",
}

_WORST: Final[tuple[Word, ...]] = ("violated", "failed", "undecided", "satisfied")


_NAMED: Final = 5
"""The most requirements that are named."""


def standing_of(sections: Sequence[Section]) -> Standing | None:
    """The line for the sections of a page; None if none of them judges a requirement.

    Each requirement counts once, with the worst that became of it in any section; so does each
    episode, however many requirements it was judged under. A rate that sequential stopping has
    compared with a target counts as it was answered. Where traces were judged as tests, by the
    mutants that they notice, their verdicts do not count.
    """
    found: dict[tuple[str, str], Word] = {}
    asked: dict[tuple[str, str], bool] = {}
    unknown: set[tuple[str, str]] = set()
    names = {}
    rests: dict[str, None] = {}
    for section in sections:
        for each in () if section.mutants else section.requirements:
            if each.together:
                continue
            key = key_of(each)
            names[key] = each.name
            if each.defaults:
                rests[each.name] = None
            found[key] = _worse(word_of(each), found.get(key, "satisfied"))
            if each.asked is not None:
                asked[key] = asked.get(key, False) or each.asked[0] > 0
                unknown |= {key} if each.unknown else set()
    tested = _Tested.of(sections)
    if not found:
        return None if tested is None else tested.standing(_runs(sections))
    words = Counter(found.values())
    worst = next(each for each in _WORST if words[each])
    of = [f"{words[each]} {each}" for each in (*get_args(Word)[1:], "failed") if words[each]]
    never: dict[str, list[str]] = {}
    for key in (key for key, ever in asked.items() if not ever):
        never.setdefault(never_triggered_word(unknown=key in unknown), []).append(names[key])
    parts = [
        f"of {counted(len(found), 'requirement')} {', '.join(of)}",
        *_runs(sections),
        *(f"{word}: {', '.join(those)}" for word, those in never.items()),
        *([f"on defaults: {', '.join(rests)}"] if rests else []),
        *([] if tested is None else [tested.text]),
    ]
    return Standing(worst, f"{_SAID[worst]}: {'; '.join(parts)}.")


@dataclass(frozen=True, slots=True)
class _Tested:
    """What traces notice of the mutants of all requirements, where they were judged as tests."""

    noticed: int
    different: int
    least: float | None
    below: Sequence[str]
    failed: bool

    @classmethod
    def of(cls, sections: Sequence[Section]) -> _Tested | None:
        """It of all sections with mutants; None if there is none."""
        views = [each.mutants for each in sections if each.mutants is not None]
        if not views:
            return None
        scores = [score for view in views for score in view.scores.values()]
        of = [each.counts.failed for s in sections if s.mutants for each in s.requirements]
        asked = [view.least for view in views if view.least is not None]
        return cls(
            noticed=sum(score.count("noticed") for score in scores),
            different=sum(score.different for score in scores),
            least=max(asked, default=None),
            below=[name for view in views for name in view.below],
            failed=any(of),
        )

    @property
    def text(self) -> str:
        """How many mutants are noticed, and of which requirements that is too few."""
        text = f"mutants noticed: {self.noticed} of {self.different}"
        if not self.below or self.least is None:
            return text
        more = f" and {len(self.below) - _NAMED} more" if len(self.below) > _NAMED else ""
        return f"{text}, less than {percent(self.least)} of {', '.join(self.below[:_NAMED])}{more}"

    def standing(self, runs: Iterator[str]) -> Standing:
        """The line of a page on which nothing else is judged."""
        parts = "; ".join([self.text, *runs])
        if self.failed:
            return Standing("failed", f"{_SAID['failed']}: {parts}.")
        if self.least is not None:
            word: Word = "undecided" if self.below else "satisfied"
            return Standing(word, f"{_SAID[word]}: {parts}.")
        word = "satisfied" if self.noticed == self.different else "undecided"
        return Standing(word, f"{parts[0].upper()}{parts[1:]}.")


def key_of(requirement: ShownRequirement | ComparedRequirement) -> tuple[str, str]:
    """What is the same for one requirement in several sections."""
    return requirement.name, requirement.formula


def word_of(requirement: ShownRequirement) -> Word:
    """The worst that became of a requirement in a section; what nothing judged is undecided."""
    if requirement.answer is not None:
        return requirement.answer
    counts = requirement.counts
    if not counts.episodes:
        return "undecided"
    return next(each for each in _WORST if getattr(counts, each))


def _runs(sections: Sequence[Section]) -> Iterator[str]:
    """How many episodes, simulations and traces were judged, and how many failed."""
    judged: Counter[str] = Counter()
    failed: Counter[str] = Counter()
    for section in sections:
        own = [each for each in section.requirements if not each.together]
        if not own:
            continue
        noun = NOUNS[section.kind]
        every = max(each.counts.episodes for each in own)
        # A trace may fail under one requirement alone; of more trials than are shown, most do.
        labels = {t.label for each in own for t in each.trials if t.verdict == "failed"}
        lost = max(len(labels), *(each.counts.failed for each in own))
        judged[noun] += every - lost
        failed[noun] += lost
    for noun in judged:
        text = f"{counted(judged[noun], noun)} judged"
        yield f"{text}, {failed[noun]} failed" if failed[noun] else text


def _worse(one: Word, other: Word) -> Word:
    return min(one, other, key=_WORST.index)
