"""The outcomes of runs, as a table for the terminal and as JSON for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rtamt_gym.results.codec import document, plain_results, plain_trial
from rtamt_gym.results.matrix import times_text
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.table import Results
from rtamt_gym.results.trial import STOPPED
from rtamt_gym.simulation.run import Run
from rtamt_gym.tables import number, sample_text, shorten, table

__all__ = ["report", "saved_note", "to_json"]


def report(runs: Sequence[Run]) -> list[str]:
    """Writes the outcomes as a table, with a row for every specification of every run.

    The table tells when the runs were stopped; if none was to be stopped, when the verdicts were
    certain.
    """
    stops = any(run.stop != "end" for run in runs)
    at_head = "stopped at" if stops else "certain at"
    asks = any(each.occasions is not None for run in runs for each in run.outcomes.values())
    head = ("asked",) if asks else ()
    rows = [("ep", "driver", "steps", at_head, "spec", "robustness", "verdict", *head, "saved")]
    for count, run in enumerate(runs, 1):
        for name, course in run.courses.items():
            first = name == next(iter(run.courses))
            stopped = run.last_sample if run.ended in STOPPED else None
            at = stopped if stops else course.decided_at
            when = "-" if at is None else sample_text(at, run.period)
            of_run = (str(count), shorten(run.label, 16), str(run.steps), when)
            asked = (times_text(course.outcome(run.period)) or "-",) if asks else ()
            of_spec = (shorten(name, 16), course.final_text("+.3g"), course.verdict.name, *asked)
            if first:
                rows.append((*of_run, *of_spec, _saved(run) if stops else ""))
            else:
                rows.append(("", "", "", "" if stops else when, *of_spec, ""))
    return table(rows, f"><>><><{'>' * len(head)}>")


def saved_note(runs: Sequence[Run]) -> list[str]:
    """Explains the column ``saved`` of the table; no lines if no run saved anything."""
    if not any(run.saved for run in runs):
        return []
    return [
        "saved: simulated time from the stop to the time limit. An environment that ends",
        "by itself, as after a fall or a crash, might not have used all of it.",
    ]


def to_json(runs: Sequence[Run], reading: Mapping[str, Any]) -> str:
    """The runs as a result of the kind ``"runs"``.

    Args:
        runs: One or more runs of the same environment.
        reading: What a certain violation does to an episode, and how episodes are read.
    """
    first = runs[0]
    texts = {name: course.formula for name, course in first.courses.items()}
    specs = {name: course.specification for name, course in first.courses.items()}
    made = Provenance.of(specs)
    results = Results([run.trial() for run in runs], texts, first.system, made)
    trials = [
        {
            **plain_trial(run.trial()),
            "steps": run.steps,
            "steps_saved": run.saved,
            "violated_by": run.violated_by,
        }
        for run in runs
    ]
    limit = None if first.limit is None else float(first.limit * (first.period or 1))
    about = {"period": first.period, "limit": limit, "reading": reading}
    return document("runs", {**about, **plain_results(results), "trials": trials})


def _saved(run: Run) -> str:
    if run.saved is None:
        return "-"
    if run.period is None:
        return f"{run.saved} steps"
    return f"{number(float(run.saved * run.period))} s"
