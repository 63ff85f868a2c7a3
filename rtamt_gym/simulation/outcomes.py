"""The outcomes of runs, as a table for the terminal and as JSON for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import rtamt
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
    rows = [("ep", "driver", "steps", at_head, "spec", "robustness", "verdict", "saved")]
    for count, run in enumerate(runs, 1):
        for name, course in run.courses.items():
            first = name == next(iter(run.courses))
            stopped = run.last_sample if run.ended in STOPPED else None
            at = stopped if stops else course.decided_at
            when = "-" if at is None else sample_text(at, run.period)
            of_run = (str(count), shorten(run.label, 16), str(run.steps), when)
            of_spec = (shorten(name, 16), course.final_text("+.3g"), course.verdict.name)
            if first:
                rows.append((*of_run, *of_spec, _saved(run) if stops else ""))
            else:
                rows.append(("", "", "", "" if stops else when, *of_spec, ""))
    return table(rows, "><>><><>")


def saved_note(runs: Sequence[Run]) -> list[str]:
    """Explains the column ``saved`` of the table; no lines if no run saved anything."""
    if not any(run.saved for run in runs):
        return []
    return [
        "saved: simulated time from the stop to the time limit. An environment that ends",
        "by itself, as after a fall or a crash, might not have used all of it.",
    ]


def to_json(runs: Sequence[Run], options: Mapping[str, str | None]) -> str:
    """Writes the outcomes as strict JSON: infinities are the strings ``"inf"`` and ``"-inf"``.

    Args:
        runs: One or more runs of the same environment.
        options: What a certain violation does to an episode, and how its ends are read.
    """
    first = runs[0]
    return json.dumps(
        {
            "rtamt": rtamt.__version__,
            "environment": first.system,
            "period": None if first.period is None else float(first.period),
            "time_limit": first.limit,
            **options,
            "specs": {name: course.formula for name, course in first.courses.items()},
            "episodes": [_outcome(run) for run in runs],
        },
        indent=2,
        allow_nan=False,
    )


def _outcome(run: Run) -> dict[str, Any]:
    return {
        "seed": run.seed,
        "steps": run.steps,
        "ended": run.ended,
        "steps_saved": run.saved,
        "violated_by": run.violated_by,
        "specs": {
            name: {
                "robustness": _finite(course.final),
                "lower": _finite(float(course.lower[-1])),
                "upper": _finite(float(course.upper[-1])),
                "verdict": course.verdict.name,
                "decided_at": course.decided_at,
            }
            for name, course in run.courses.items()
        },
    }


def _finite(value: float) -> float | str:
    return value if math.isfinite(value) else str(value)


def _saved(run: Run) -> str:
    if run.saved is None:
        return "-"
    if run.period is None:
        return f"{run.saved} steps"
    return f"{number(float(run.saved * run.period))} s"
