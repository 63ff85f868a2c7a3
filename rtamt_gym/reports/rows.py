"""What became of requirements in the rows of a record: counts, trials, robustness."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from rtamt_gym.play.record import Record
from rtamt_gym.reports.episodes import case_texts, rounded_moment
from rtamt_gym.reports.model import (
    Counts,
    Fact,
    ShownEpisode,
    ShownFile,
    ShownRequirement,
    ShownTrial,
)
from rtamt_gym.reports.series import evenly, six, spaced
from rtamt_gym.reports.texts import number
from rtamt_gym.reports.views import Cases
from rtamt_gym.results.intervals import quantiles
from rtamt_gym.results.outcome import BY_END, Outcome, Word, word
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.statistics import (
    STATISTICS,
    RequirementResult,
    mean_progress,
    progress_text,
)
from rtamt_gym.results.table import Results
from rtamt_gym.results.trial import Trial, open_at_stop
from rtamt_gym.tables import counted

__all__ = [
    "DIGITS",
    "TRIALS",
    "at_stop",
    "cases_of",
    "counts_of",
    "judged",
    "labelled",
    "made_of",
    "requirement_of",
    "reuse_notes",
    "trials_of",
    "worst_first",
]

TRIALS: Final = 500
"""The most trials of a requirement that are shown."""

DIGITS: Final = 12
"""The digits of a hash that are shown; the whole is shown where the pointer rests."""

_ROBUSTNESS: Final = 1000
"""The most numbers of a distribution."""

_CASES: Final = 2000
"""The most points of a sweep."""

_ORDER: Final[dict[Word, int]] = {"failed": 0, "violated": 1, "undecided": 2, "satisfied": 3}

Label = Callable[[int, Trial], str]


def labelled(number: int, row: Trial) -> str:
    """What tells a simulation from others: its seed, if it has no case; else its number, from 1."""
    return f"simulation {number + 1}" if row.case or row.seed is None else f"seed {row.seed}"


def counts_of(words: Sequence[Word]) -> Counts:
    """How often each word occurs."""
    order: tuple[Word, ...] = ("satisfied", "violated", "undecided", "failed")
    return Counts(len(words), *(words.count(each) for each in order))


def trials_of(
    rows: Sequence[Trial], outcomes: Sequence[Outcome | None], label: Label = labelled
) -> list[ShownTrial]:
    """The trials of a requirement, the worst first.

    Args:
        rows: The trials.
        outcomes: What the requirement has become in each; None where it failed.
        label: What tells a trial from others.
    """
    trials = []
    for place, (row, outcome) in enumerate(zip(rows, outcomes, strict=True)):
        at = None if outcome is None else outcome.violated
        trials.append(
            ShownTrial(
                label=label(place, row),
                verdict=word(outcome),
                robustness=None if outcome is None else six(outcome.robustness),
                violated_at=None if at is None else rounded_moment(at),
                duration=None if row.ended == "recorded" else six(row.simulated),
                reward=None if row.reward is None else six(row.reward),
                seed=row.seed,
                case=case_texts(row.case),
                text=row.error or _text_of(row, outcome),
                asked=None if outcome is None else outcome.occasions,
                vacuous=outcome is not None and outcome.vacuous,
                defaults=()
                if outcome is None
                else tuple(f"{each} = {number(v)}" for each, v in outcome.defaults.items()),
                unknown=outcome is not None and bool(outcome.unknown),
                progress=None if outcome is None else outcome.progress,
            )
        )
    return sorted(trials, key=worst_first)


def _text_of(row: Trial, outcome: Outcome | None) -> str:
    """Why a requirement has no outcome, or what would decide it."""
    if outcome is not None:
        return f"violated {BY_END}" if outcome.by_end else outcome.way_out
    return next((each.message for each in row.failures.values()), "")


def judged(results: Results, name: str) -> list[Outcome | None]:
    """What a requirement has become in each trial; None where it failed."""
    return [row.judged(name) for row in results]


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
    known = [(each.robustness, each.verdict) for each in trials if each.robustness is not None]
    known.sort(key=lambda each: (each[0], _ORDER[each[1]]))
    heights = [height for height, _ in known]
    asked = [each.asked for each in trials if each.asked is not None]
    violations = sorted(
        each.violated_at.time or 0.0 for each in trials if each.violated_at is not None
    )
    return ShownRequirement(
        name=name,
        words=words,
        formula=formula,
        counts=counts_of([each.verdict for each in trials]),
        rate=also.pop("rate", None),
        interval=also.pop("interval", None),
        statistics=(*statistics_of(heights), *_progress_of(trials)),
        robustness=evenly(heights, _ROBUSTNESS),
        verdicts=tuple(verdict for _, verdict in spaced(known, _ROBUSTNESS)),
        quantiles=shares_of(heights),
        first_violations=evenly(violations, _ROBUSTNESS),
        trials=tuple(trials[:TRIALS]),
        left_out=max(0, len(trials) - TRIALS),
        worst=tuple(worst),
        by_end=sum(map(_by_end, trials)),
        asked=(sum(map(bool, asked)), len(asked)) if asked else None,
        unknown=any(each.unknown for each in trials if each.asked is not None),
        vacuous=sum(each.vacuous for each in trials),
        defaults=Counter(text for each in trials for text in each.defaults),
        **also,
    )


def made_of(found: Provenance) -> dict[str, Any]:
    """The fields of a section that say what its result was made of and with."""
    files = tuple(ShownFile(path, sha) for path, sha in found.files.items())
    return {"files": files, "versions": dict(found.versions)}


def reuse_notes(found: Provenance, trial: str) -> list[str]:
    """Return notes on results that came from a folder; ``trial`` is the word for one."""
    return [] if found.reuse is None else found.reuse.lines(trial)


def statistics_of(heights: Sequence[float]) -> tuple[Fact, ...]:
    """What the page tells of the robustness, a fact for each statistic of it."""
    result = RequirementResult("", "", 0, 0, 0, 0, 0, np.array(heights), np.array(()), 0.0, ())
    return tuple(
        Fact(each.heading, number(each.of(result)))
        for each in STATISTICS
        if each.robustness and heights and each.shown(result)
    )


def _progress_of(trials: Sequence[ShownTrial]) -> list[Fact]:
    """How far trials came in the stages of a requirement; nothing if it has none."""
    mean = mean_progress([each.progress for each in trials if each.progress is not None])
    return [] if mean is None else [Fact("mean progress", progress_text(mean))]


def _by_end(trial: ShownTrial) -> bool:
    """Whether it is violated by its end alone: its robustness, which says so else, is above."""
    height = trial.robustness
    return trial.verdict == "violated" and height is not None and math.copysign(1.0, height) > 0


def at_stop(record: Record, name: str, noun: str) -> str:
    """A sentence on simulations that were stopped early and left open; empty if there are none."""
    count = len(open_at_stop(record, name))
    if not count:
        return ""
    was, their = ("was", "its") if count == 1 else ("were", "their")
    return (
        f"{counted(count, f'undecided {noun}')} {was} stopped early: {their} robustness counts the "
        "samples until the stop."
    )


def cases_of(record: Record) -> Cases | None:
    """The points of a record, without columns that are the same everywhere; None if none is left.

    Where there are more than 2000 simulations, it has the worst 500 of all requirements, and evenly
    spaced others.
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
        verdicts={name: tuple(word(rows[i].judged(name)) for i in places) for name in names},
        left_out=len(rows) - len(places),
    )


def _known(row: Trial, name: str) -> float | None:
    outcome = row.judged(name)
    return None if outcome is None else six(outcome.robustness)


def _height(row: Trial, name: str) -> float:
    known = _known(row, name)
    return -math.inf if known is None else known
