"""The outcomes of runs, as a table for the terminal and as JSON for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rtamt_gym.results.codec import document, plain_results, plain_trial
from rtamt_gym.results.matrix import times_text
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.table import Results
from rtamt_gym.results.trial import STOPPED, Trial
from rtamt_gym.simulation.run import Run
from rtamt_gym.tables import number, sample_text, shorten, table

__all__ = ["Episode", "report", "saved_note", "to_json", "trial_of"]

Episode = Run | Trial
"""A run with its samples; of one that an error has ended the trial."""


def trial_of(episode: Episode) -> Trial:
    """What an episode came to, without its samples."""
    return episode if isinstance(episode, Trial) else episode.trial()


def report(episodes: Sequence[Episode]) -> list[str]:
    """Writes the outcomes as a table, with a row for every specification of every episode.

    The table tells when the runs were stopped; if none was to be stopped, when the verdicts were
    certain. One episode at least has not failed.
    """
    runs = _runs(episodes)
    stops = any(run.stop != "end" for run in runs)
    at_head = "stopped" if stops else "certain"
    asks = any(each.occasions is not None for run in runs for each in run.outcomes.values())
    head = ("asked",) if asks else ()
    rows = [("ep", "driver", "steps", at_head, "spec", "robustness", "verdict", *head, "saved")]
    for count, run in enumerate(episodes, 1):
        if isinstance(run, Trial):
            at_front = [str(count), "", "-", "-"]
            for name in runs[0].courses:
                of_spec = (shorten(name, 16), "-", "ERROR", *["-"] * len(head))
                rows.append((*at_front, *of_spec, "-"))
                at_front = [""] * len(at_front)
            continue
        for name, course in run.courses.items():
            first = name == next(iter(run.courses))
            stopped = run.last_sample if run.ended in STOPPED else None
            if stops:
                when = "-" if stopped is None else sample_text(stopped, run.period)
            else:
                when = course.decided_text(run.period) or "-"
            of_run = (str(count), shorten(run.label, 16), str(run.steps), when)
            asked = (times_text(course.outcome(run.period)) or "-",) if asks else ()
            of_spec = (shorten(name, 16), course.final_text("+.3g"), course.verdict.name, *asked)
            if first:
                rows.append((*of_run, *of_spec, _saved(run) if stops else ""))
            else:
                rows.append(("", "", "", "" if stops else when, *of_spec, ""))
    return table(rows, f"><>><><{'>' * len(head)}>")


def saved_note(episodes: Sequence[Episode]) -> list[str]:
    """Explains the column ``saved`` of the table; no lines if no run saved anything."""
    if not any(run.saved for run in _runs(episodes)):
        return []
    return [
        "saved: simulated time from the stop to the time limit. An environment that ends",
        "by itself, as after a fall or a crash, might not have used all of it.",
    ]


def to_json(episodes: Sequence[Episode], reading: Mapping[str, Any]) -> str:
    """The episodes as a result of the kind ``"runs"``.

    Args:
        episodes: Those of one environment, of which one at least has not failed.
        reading: What a certain violation does to an episode, and how episodes are read.
    """
    first = _runs(episodes)[0]
    texts = {name: course.formula for name, course in first.courses.items()}
    specs = {name: course.specification for name, course in first.courses.items()}
    made = Provenance.of(specs)
    results = Results(map(trial_of, episodes), texts, first.system, made)
    trials = [{**plain_trial(trial_of(each)), **_of_run(each)} for each in episodes]
    limit = None if first.limit is None else float(first.limit * (first.period or 1))
    about = {"period": first.period, "limit": limit, "reading": reading}
    return document("runs", {**about, **plain_results(results), "trials": trials})


def _runs(episodes: Sequence[Episode]) -> list[Run]:
    """The episodes that have not failed."""
    return [each for each in episodes if isinstance(each, Run)]


def _of_run(episode: Episode) -> dict[str, Any]:
    """What JSON has of a run beside its trial."""
    if isinstance(episode, Trial):
        return {}
    return {
        "steps": episode.steps,
        "steps_saved": episode.saved,
        "violated_by": episode.violated_by,
    }


def _saved(run: Run) -> str:
    if run.saved is None:
        return "-"
    if run.period is None:
        return f"{run.saved} steps"
    return f"{number(float(run.saved * run.period))} s"
