"""The outcomes of requirements in a record: counts, trials, robustness, evidence."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, get_args

import numpy as np

from rtamt_gym.play.record import Record
from rtamt_gym.reports.episodes import case_texts, rounded_moment
from rtamt_gym.reports.figures import trial_figures
from rtamt_gym.reports.model import (
    TRIALS,
    Cell,
    Column,
    Facts,
    Requirement,
    Row,
    Section,
    Table,
    Text,
    TrialRow,
)
from rtamt_gym.reports.numbers import aligned, number, six
from rtamt_gym.results.outcome import BY_END, Outcome, Word, word
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.statistics import (
    STATISTICS,
    RequirementResult,
    mean_progress,
    progress_text,
)
from rtamt_gym.results.trial import Trial, open_at_stop
from rtamt_gym.results.warnings import never_triggered_word
from rtamt_gym.tables import counted

DIGITS: Final = 12
"""The digits of a hash that are shown; a tooltip shows all."""

_CASES: Final = 2000
"""The maximum number of points of a sweep."""

Label = Callable[[int, Trial], str]


def labelled(number: int, row: Trial) -> str:
    """Return the name of a simulation: its seed if it has no case; otherwise its number, from 1."""
    return f"simulation {number + 1}" if row.case or row.seed is None else f"seed {row.seed}"


def trials_of(
    rows: Sequence[Trial], outcomes: Sequence[Outcome | None], label: Label = labelled
) -> tuple[TrialRow, ...]:
    """Return the trials of a requirement, the worst first."""
    trials = []
    for index, (row, outcome) in enumerate(zip(rows, outcomes, strict=True)):
        trial = TrialRow(
            label=label(index, row),
            verdict=word(outcome),
            duration=None if row.ended == "recorded" else six(row.simulated),
            reward=None if row.reward is None else six(row.reward),
            seed=row.seed,
            case=case_texts(row.case),
            text=row.error or _text_of(row, outcome),
        )
        trials.append(trial if outcome is None else with_outcome(trial, outcome))
    return tuple(sorted(trials, key=worst_first))


def with_outcome(trial: TrialRow, outcome: Outcome) -> TrialRow:
    """Return a trial with the outcome of the requirement."""
    moment = outcome.violated
    return replace(
        trial,
        robustness=six(outcome.robustness),
        violated_at=None if moment is None else rounded_moment(moment),
        asked=outcome.trigger_count,
        vacuous=outcome.vacuous,
        defaults=tuple(f"{name} = {number(value)}" for name, value in outcome.defaults.items()),
        unknown=bool(outcome.unknown),
        progress=outcome.progress,
    )


def _text_of(row: Trial, outcome: Outcome | None) -> str:
    """Return why a requirement has no outcome, or how to decide it."""
    if outcome is not None:
        return f"violated {BY_END}" if outcome.by_end else outcome.way_out
    return next((value.message for value in row.failures.values()), "")


def worst_first(trial: TrialRow) -> tuple[int, float]:
    """Order trials: failures, violations, undecided, satisfied; within each by robustness."""
    height = math.inf if trial.robustness is None else trial.robustness
    return get_args(Word).index(trial.verdict), height


def with_trials(requirement: Requirement, section: Section) -> Requirement:
    """Return a requirement with the texts, the numbers and the charts of its trials."""
    trials, noun = requirement.trials, section.noun
    statistics = (*_statistics(trials), *_progress(trials))
    return replace(
        requirement,
        blocks=(
            *_evidence(requirement, noun),
            *([Facts(statistics, "statistics")] if statistics else []),
            *([Text(requirement.note)] if requirement.note else []),
            *requirement.blocks,
        ),
        figures=(
            *(trial_figures(trials, noun, section.unit) if section.charts else ()),
            *requirement.figures,
        ),
    )


def _evidence(requirement: Requirement, noun: str) -> Iterator[Text]:
    """Yield the evidence for the verdicts, and warnings."""
    certain = " for certain" * requirement.unknown
    triggered, judged = sum(map(bool, requirement.triggers)), len(requirement.triggers)
    if triggered:
        yield Text(f"Triggered in {triggered} of {counted(judged, noun)}{certain}.", "asked")
        if vacuous := sum(trial.vacuous for trial in requirement.trials):
            total = counted(vacuous, noun)
            yield Text(f"Satisfied without an answer in {total}.", "asked warning")
    elif judged:
        word = never_triggered_word(unknown=requirement.unknown).capitalize()
        yield Text(f"{word} in {counted(judged, noun)}.", "asked warning")
    if requirement.defaults:
        counts = requirement.defaults.items()
        parts = ", ".join(f"{text} in {counted(count, noun)}" for text, count in counts)
        yield Text(f"Rests on a default: {parts}.", "asked warning")


def trials_table(
    requirement: Requirement, noun: str, unit: str, replay: str, ids: Callable[[str], str]
) -> Table:
    """Return the table of the trials of a requirement, without empty columns."""
    trials = requirement.trials[:TRIALS]
    times = [None if t.violated_at is None else t.violated_at.time for t in trials]
    progress = ["" if t.progress is None else progress_text(t.progress) for t in trials]
    columns: list[tuple[Column, Iterable[str], Iterable[float | None]]] = [
        (Column("robustness", "n"), *_numbers([t.robustness for t in trials])),
        (Column("progress", "n"), progress, [t.progress for t in trials]),
        (Column("triggers", "n"), map(_triggers, trials), [t.asked for t in trials]),
        (Column(f"violated at ({unit})", "n"), *_numbers(times)),
        (Column(f"length ({unit})", "n"), *_numbers([t.duration for t in trials])),
        (Column("return", "n"), *_numbers([t.reward for t in trials])),
    ]
    head = [Column(noun), Column("verdict")]
    cells = [[Cell(t.label), Cell(verdict=t.verdict)] for t in trials]

    def add(column: Column, added: Sequence[Cell]) -> None:
        if any(cell.text or cell.codes or cell.copied for cell in added):
            head.append(column)
            for row, cell in zip(cells, added, strict=True):
                row.append(cell)

    for column, texts, values in columns:
        pairs = zip(texts, values, strict=True)
        add(column, [Cell(text, "n", value) for text, value in pairs])
    add(Column("given"), [Cell(style="case", codes=t.case) for t in trials])
    add(Column("note"), [Cell(_remark(t), "text") for t in trials])
    buttons = [
        Cell(style="replaying")
        if t.seed is None or not replay
        else Cell(
            style="replaying",
            copied=(replay.replace("{seed}", str(t.seed)), f"command for {t.label}"),
        )
        for t in trials
    ]
    add(Column("replay", "replaying", sortable=False), buttons)
    rows = []
    for trial, (first, *others) in zip(trials, cells, strict=True):
        own = ids(trial.label)
        rows.append(Row((first._replace(link=own), *others), own, trial.verdict))
    labelled_by = f"{requirement.place}-trials"
    return Table(tuple(head), tuple(rows), style="sortable", labelled=labelled_by)


def _numbers(values: Sequence[float | None]) -> tuple[list[str], Sequence[float | None]]:
    return aligned(values), values


def _remark(trial: TrialRow) -> str:
    return " ".join(filter(None, (trial.text, *(f"default {item}" for item in trial.defaults))))


def _triggers(trial: TrialRow) -> str:
    """Return how often a trial triggered a requirement."""
    if trial.asked is None:
        return ""
    if trial.vacuous and trial.asked:
        return f"{trial.asked}x, no answer"
    if not trial.asked:
        return "not for certain" if trial.unknown else "never"
    return f"{trial.asked}x"


def made_of(provenance: Provenance) -> dict[str, Any]:
    """Return the fields of a section about the inputs and versions of its result."""
    return {"files": dict(provenance.files), "versions": dict(provenance.versions)}


def reuse_notes(provenance: Provenance, trial: str) -> list[str]:
    """Return notes on results from a folder; ``trial`` is the word for a result."""
    return [] if provenance.reuse is None else provenance.reuse.lines(trial)


def _statistics(trials: Sequence[TrialRow]) -> Iterator[tuple[str, str, str]]:
    """Yield the statistics of the robustness."""
    values = [trial.robustness for trial in trials if trial.robustness is not None]
    result = RequirementResult("", "", 0, 0, 0, 0, 0, np.array(values), np.array(()), 0.0, ())
    for statistic in STATISTICS:
        if statistic.robustness and values and statistic.shown(result):
            yield statistic.heading, number(statistic.of(result)), ""


def _progress(trials: Sequence[TrialRow]) -> Iterator[tuple[str, str, str]]:
    """Yield the mean progress in the stages of a requirement, if it has stages."""
    mean = mean_progress([trial.progress for trial in trials if trial.progress is not None])
    if mean is not None:
        yield "mean progress", progress_text(mean), ""


def at_stop(record: Record, name: str, noun: str) -> str:
    """Return a sentence on undecided simulations that were stopped early; may be empty."""
    count = len(open_at_stop(record, name))
    if not count:
        return ""
    was, their = ("was", "its") if count == 1 else ("were", "their")
    return (
        f"{counted(count, f'undecided {noun}')} {was} stopped early: {their} robustness counts the "
        "samples until the stop."
    )


def cases_of(record: Record) -> tuple[Mapping[str, Any], int] | None:
    """Return the points of a record for charts, and the number of points that are left out.

    Constant columns are left out; None if no column is left. For more than 2000 simulations, the
    points are the worst 500 of all requirements and evenly spaced others.
    """
    columns = {name: record.numbers(name) for name in record.case_columns}
    varied = {name: cells for name, cells in columns.items() if len(set(cells.tolist())) > 1}
    if not varied:
        return None
    rows, names = list(record), list(record.requirements)
    places: Sequence[int] = range(len(rows))
    if len(rows) > _CASES:
        worst = sorted(places, key=lambda i: min(_height(rows[i], name) for name in names))
        remainder = worst[TRIALS:]
        step = len(remainder) / (_CASES - TRIALS)
        others = [remainder[int(i * step)] for i in range(_CASES - TRIALS)]
        places = sorted({*worst[:TRIALS], *others})
    cases = {
        "labels": tuple(labelled(i, rows[i]) for i in places),
        "columns": {name: tuple(six(cells[i]) for i in places) for name, cells in varied.items()},
        "robustness": {name: tuple(_known(rows[i], name) for i in places) for name in names},
        "verdicts": {name: tuple(word(rows[i].judged(name)) for i in places) for name in names},
    }
    return cases, len(rows) - len(places)


def _known(row: Trial, name: str) -> float | None:
    outcome = row.judged(name)
    return None if outcome is None else six(outcome.robustness)


def _height(row: Trial, name: str) -> float:
    known = _known(row, name)
    return -math.inf if known is None else known
