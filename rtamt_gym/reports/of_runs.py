"""The sections of runs: many without their samples, or one with all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rtamt_gym.play.record import Record
from rtamt_gym.play.run import Run
from rtamt_gym.reports.episodes import episode_of_run, in_words_of
from rtamt_gym.reports.model import Fact, Section
from rtamt_gym.reports.of_record import of_record
from rtamt_gym.reports.rows import labelled, requirement_of, trials_of
from rtamt_gym.results.codec import trials_of as read_trials
from rtamt_gym.results.provenance import provenance_of
from rtamt_gym.tables import counted, sample_text

__all__ = ["of_run", "of_runs"]


def of_runs(kept: Mapping[str, Any], room: int) -> Section:
    """The section of episodes that ``rtamt run --json`` has written.

    Args:
        kept: The result, of the kind ``"runs"``.
        room: How many numbers all episodes together may have.
    """
    record = Record(read_trials(kept), kept["requirements"], kept["system"], provenance_of(kept))
    said = {"period": kept["period"], **kept["reading"]}
    facts = {name: str(value) for name, value in said.items() if value is not None}
    title = f"{counted(len(record), 'episode')} of {record.system}"
    section = of_record(record, room, facts)
    unit = "s" if kept["period"] else "steps"
    return replace(section, kind="evaluation", title=title, notes=(), unit=unit)


def of_run(run: Run, room: int) -> Section:
    """The section of one run with its samples, such as `Run.save` keeps it."""
    trial, label = run.trial(), run.label or labelled(0, run.trial())
    requirements = []
    for name, course in run.courses.items():
        words = in_words_of(course.formula, run.period, unit=course.unit, step=run.view == "step")
        requirements.append(
            requirement_of(
                name,
                words,
                course.formula,
                trials_of([trial], [trial.judged(name)], lambda *_: label),
                [episode_of_run(run, name, label, room, len(run.courses))],
                id=course.specification.id,
            )
        )
    last = sample_text(run.last_sample, run.period)
    facts = {"ended": f"{run.ended} at {last}", "samples": str(run.steps + 1)}
    return Section(
        kind="evaluation",
        title=f"A run of {run.system}",
        system=run.system,
        unit="s" if run.period is not None else "steps",
        facts=tuple(Fact(*each) for each in facts.items()),
        requirements=tuple(requirements),
    )
