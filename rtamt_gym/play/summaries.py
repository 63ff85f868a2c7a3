"""Outcomes of runs and records: tables for the terminal, and JSON.

To change how failed simulations are reported, change `failures`. A command that lets some of them
pass has the option ``--allow-failures`` and calls `failure_warnings` of
`rtamt_gym.results.warnings`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any, Final

from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.play.record import Record
from rtamt_gym.play.run import Run
from rtamt_gym.results.codec import document, plain_results, plain_trial
from rtamt_gym.results.matrix import times_text
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.statistics import Results, columns_of
from rtamt_gym.results.trial import STOPPED, Trial, end_note
from rtamt_gym.tables import counted, number, sample_text, shorten, table

Episode = Run | Trial
"""A run with its samples, or the trial of a run that an error has ended."""


def trial_of(episode: Episode) -> Trial:
    """Return the trial of an episode."""
    return episode if isinstance(episode, Trial) else episode.trial()


def run_table(episodes: Sequence[Episode]) -> list[str]:
    """Return a table with a row for every specification of every episode.

    It shows when runs were stopped, or, if none could be stopped, when verdicts were certain. Not
    all episodes may have failed.
    """
    runs = _runs(episodes)
    stops = any(run.stop != "end" for run in runs)
    at_head = "stopped" if stops else "certain"
    has_triggers = any(
        outcome.trigger_count is not None for run in runs for outcome in run.outcomes.values()
    )
    head = ("triggered",) if has_triggers else ()
    rows = [("ep", "driver", "steps", at_head, "spec", "robustness", "verdict", *head, "saved")]
    for count, run in enumerate(episodes, 1):
        if isinstance(run, Trial):
            at_front = [str(count), "", "-", "-"]
            for name in runs[0].histories:
                of_spec = (shorten(name, 16), "-", "ERROR", *["-"] * len(head))
                rows.append((*at_front, *of_spec, "-"))
                at_front = [""] * len(at_front)
            continue
        for name, history in run.histories.items():
            first = name == next(iter(run.histories))
            stopped = run.last_sample if run.ended in STOPPED else None
            if stops:
                when = "-" if stopped is None else sample_text(stopped, run.period)
            else:
                when = history.decided_text(run.period) or "-"
            of_run = (str(count), shorten(run.label, 16), str(run.steps), when)
            counts = (times_text(history.outcome(run.period)) or "-",) if has_triggers else ()
            of_spec = (shorten(name, 15), history.final_text("+.3g"), history.verdict.name, *counts)
            if first:
                rows.append((*of_run, *of_spec, _saved(run) if stops else ""))
            else:
                rows.append(("", "", "", "" if stops else when, *of_spec, ""))
    return table(rows, f"><>><><{'>' * len(head)}>")


def saved_note(episodes: Sequence[Episode]) -> list[str]:
    """Return lines that explain the column ``saved``; empty if no run saved anything."""
    if not any(run.saved for run in _runs(episodes)):
        return []
    return [
        "saved: simulated time from the stop to the time limit. An environment that ends",
        "by itself, as after a fall or a crash, might not have used all of it.",
    ]


def runs_json(episodes: Sequence[Episode], reading: Mapping[str, Any]) -> str:
    """Return episodes of one environment as a result of the kind ``"runs"``."""
    first = _runs(episodes)[0]
    texts = {name: history.formula for name, history in first.histories.items()}
    specs = {name: history.specification for name, history in first.histories.items()}
    provenance = Provenance.of(specs)
    results = Results(map(trial_of, episodes), texts, first.system, provenance)
    trials = [{**plain_trial(trial_of(episode)), **_of_run(episode)} for episode in episodes]
    limit = None if first.limit is None else float(first.limit * (first.period or 1))
    about = {"period": first.period, "limit": limit, "reading": reading}
    return document("runs", {**about, **plain_results(results), "trials": trials})


def _runs(episodes: Sequence[Episode]) -> list[Run]:
    """Return the episodes that have not failed."""
    return [episode for episode in episodes if isinstance(episode, Run)]


def _of_run(episode: Episode) -> dict[str, Any]:
    """Return the JSON entries of a run that its trial lacks."""
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


_ERROR: Final = 200
"""The maximum length of an error that is shown."""


def record_table(record: Record) -> list[str]:
    """Return a table of the requirements of a record: robustness and verdicts.

    The simulated time and the failures follow.
    """
    results = list(record.results().values())
    columns = columns_of(results, rates=False)
    rows = [["requirement", *(result.heading for result in columns)]]
    rows += [[result.name, *(column.cell(result) for column in columns)] for result in results]
    simulated = math.fsum(row.simulated for row in record)
    took = f"{counted(len(record), 'simulation')}, {simulated:.6g} simulated seconds"
    below = [took, *end_note(record), *failures(record)]
    return [*table(rows, "<" + ">" * len(columns), 80), "", *below]


def failures(record: Record, *, rated: bool = True) -> list[str]:
    """Return lines of 80 columns: how many simulations failed, and the first case and error.

    ``rated`` is whether rates of episodes, where failures count, are shown above.
    """
    failed = record.failed()
    if not len(failed):
        return []
    first = failed[0]
    if record.has_cases:
        columns = first.case.columns().items()
        case = ", ".join(f"{name}={value:.4g}" for name, value in columns)
        head = f"{len(failed)} of {counted(len(record), 'simulation')} failed, the first with "
    else:  # episodes
        case = f"seed {first.seed}"
        head = f"{len(failed)} of {counted(len(record), 'episode')} failed"
        head += ", which counts as not satisfied; the first with " if rated else "; the first, "
    error = shorten(" ".join(first.error.split()), _ERROR)
    others = len({row.error for row in failed}) - 1
    return [
        *wrap(f"{shorten(f'{head}{case}', 139)}:", 80),
        *wrap(error, 80, initial_indent="  ", subsequent_indent="  "),
        *([f"  and {counted(others, 'other error')}"] if others else []),
    ]


def record_json(record: Record, options: Mapping[str, Any]) -> str:
    """Return the record as a result of the kind ``"record"``."""
    return document("record", {**options, **plain_results(record, rates=not record.has_cases)})


def case_lines(case: Case) -> list[str]:
    """Return a case for the terminal: a line for each entry, more for many control points."""
    return [line for entry in case.items() for line in _entry(*entry)]


def _entry(name: str, entry: float | Waveform) -> list[str]:
    """Return the lines of an entry: a number, or the values of a waveform at its times."""
    if not isinstance(entry, Waveform):
        return [f"  {name} = {number(entry)}"]
    if len(set(entry.values)) == 1:
        return [f"  {name} = {number(entry.values[0])} throughout"]
    points = zip(entry.times, entry.values, strict=True)
    # Lines break after a control point: `wrap` does not break at a no-break space.
    values = [f"{number(value)}\xa0at\xa0{number(time)}\xa0s" for time, value in points]
    how = {"hold": "steps"}.get(entry.interpolation, entry.interpolation)
    text = f"{name}, {how}: {', '.join(values)}"
    lines = wrap(text, 79, initial_indent="  ", subsequent_indent="    ")
    return [line.replace("\xa0", " ") for line in lines]
