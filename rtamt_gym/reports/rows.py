"""What became of requirements in the rows of a record: counts, trials, robustness."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

from rtamt_gym.reports.episodes import WORDS, case_texts
from rtamt_gym.reports.model import Counts, ShownEpisode, ShownRequirement, ShownTrial
from rtamt_gym.reports.series import evenly, six
from rtamt_gym.reports.views import Cases, Word
from rtamt_gym.results.intervals import quantiles
from rtamt_gym.results.trial import Trial, open_at_stop
from rtamt_gym.search.runs.record import Record
from rtamt_gym.tables import counted

__all__ = [
    "TRIALS",
    "at_stop",
    "cases_of",
    "counts_of",
    "labelled",
    "requirement_of",
    "trials_of",
    "worst_first",
]

TRIALS: Final = 500
"""The most trials of a requirement that are shown."""

_ROBUSTNESS: Final = 1000
"""The most numbers of a distribution."""

_CASES: Final = 2000
"""The most points of a sweep."""

_ORDER: Final[dict[Word, int]] = {"failed": 0, "violated": 1, "undecided": 2, "satisfied": 3}

Label = Callable[[int, Trial], str]


def labelled(number: int, row: Trial) -> str:
    """What tells a simulation from others: its seed, if it has no case; else its number, from 1."""
    return f"simulation {number + 1}" if row.case or row.seed is None else f"seed {row.seed}"


def word_of(row: Trial, name: str) -> Word:
    """What a requirement became in a row."""
    failed = row.error or name not in row.outcomes
    return "failed" if failed else WORDS[row.outcomes[name].verdict]


def counts_of(words: Sequence[Word]) -> Counts:
    """How often each word occurs."""
    order: tuple[Word, ...] = ("satisfied", "violated", "undecided", "failed")
    return Counts(len(words), *(words.count(each) for each in order))


def trials_of(record: Record, name: str) -> list[ShownTrial]:
    """A trial for each row, the worst first."""
    trials = []
    for number, row in enumerate(record):
        word, outcome = word_of(row, name), row.outcomes.get(name)
        at = outcome.decided_at if outcome is not None and word == "violated" else None
        trials.append(
            ShownTrial(
                label=labelled(number, row),
                verdict=word,
                robustness=None if outcome is None or word == "failed" else six(outcome.robustness),
                violated_at=None if at is None else six(at),
                duration=six(row.simulated),
                reward=None if row.reward is None else six(row.reward),
                seed=row.seed,
                case=case_texts(row.case),
                text=row.error,
            )
        )
    return sorted(trials, key=worst_first)


def worst_first(trial: ShownTrial) -> tuple[int, float]:
    """Orders trials: failures, violations, open ones, then the others; each by robustness."""
    height = math.inf if trial.robustness is None else trial.robustness
    return _ORDER[trial.verdict], height


def shares_of(values: Sequence[float]) -> dict[str, float]:
    """The quantiles of robustness by the text of their shares."""
    return {f"{share:g}": six(value) for share, value in quantiles(values).items()}


def requirement_of(
    name: str,
    words: str,
    formula: str,
    trials: Sequence[ShownTrial],
    worst: Sequence[ShownEpisode] = (),
    **also: Any,  # noqa: ANN401 - fields of a requirement
) -> ShownRequirement:
    """A requirement with its trials, the worst first; rate and interval are among ``also``."""
    heights = sorted(each.robustness for each in trials if each.robustness is not None)
    violations = sorted(each.violated_at for each in trials if each.violated_at is not None)
    return ShownRequirement(
        name=name,
        words=words,
        formula=formula,
        counts=counts_of([each.verdict for each in trials]),
        rate=also.pop("rate", None),
        interval=also.pop("interval", None),
        robustness=evenly(heights, _ROBUSTNESS),
        quantiles=shares_of(heights),
        first_violations=evenly(violations, _ROBUSTNESS),
        trials=tuple(trials[:TRIALS]),
        left_out=max(0, len(trials) - TRIALS),
        worst=tuple(worst),
        by_end=sum(map(_by_end, trials)),
        **also,
    )


def _by_end(trial: ShownTrial) -> bool:
    """Whether it is violated by its end alone: its robustness, which says so else, is above."""
    height = trial.robustness
    return trial.verdict == "violated" and height is not None and height > 0


def at_stop(record: Record, name: str, noun: str) -> str:
    """The sentence on robustness that is that at an early stop; empty if there is none."""
    count = len(open_at_stop(record, name))
    if not count:
        return ""
    was, their = ("was", "its") if count == 1 else ("were", "their")
    return (
        f"{counted(count, f'undecided {noun}')} {was} stopped early: {their} robustness is that "
        "at the stop."
    )


def cases_of(record: Record) -> Cases | None:
    """The points of a record; of columns that are the same everywhere there are none.

    Of more than 2000 simulations the worst 500 of all requirements are shown, and evenly spaced
    others.
    """
    columns = {name: record.numbers(name) for name in record.case_columns}
    varied = {name: cells for name, cells in columns.items() if len(set(cells.tolist())) > 1}
    if not varied:
        return None
    rows, names = list(record), list(record.requirements)
    places: Sequence[int] = range(len(rows))
    if len(rows) > _CASES:
        worst = sorted(places, key=lambda i: min(_height(rows[i], name) for name in names))
        rest = worst[TRIALS:]
        step = len(rest) / (_CASES - TRIALS)
        others = [rest[int(i * step)] for i in range(_CASES - TRIALS)]
        places = sorted({*worst[:TRIALS], *others})
    return Cases(
        labels=tuple(labelled(i, rows[i]) for i in places),
        columns={name: tuple(six(cells[i]) for i in places) for name, cells in varied.items()},
        robustness={name: tuple(_known(rows[i], name) for i in places) for name in names},
        verdicts={name: tuple(word_of(rows[i], name) for i in places) for name in names},
        left_out=len(rows) - len(places),
    )


def _known(row: Trial, name: str) -> float | None:
    return None if word_of(row, name) == "failed" else six(row.outcomes[name].robustness)


def _height(row: Trial, name: str) -> float:
    known = _known(row, name)
    return -math.inf if known is None else known
