"""Outcomes of runs: a table for the terminal, JSON for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import rtamt
from rtamt_gym.simulation.run import Run
from rtamt_gym.tables import moment, number, shorten, table

__all__ = ["report", "saved_note", "to_json"]


def report(runs: Sequence[Run]) -> list[str]:
    """The outcomes as a table, a row for every specification of every run.

    Where nothing was to stop them the table says when verdicts were certain instead of when the
    runs were stopped.
    """
    stops = any(run.stop != "end" for run in runs)
    labelled = any(run.label for run in runs)
    rows = [["ep", "driver", "steps", "stopped at", "spec", "robustness", "verdict", "saved"]]
    if not stops:
        rows[0][3] = "certain at"
    for count, run in enumerate(runs, 1):
        for name, course in run.courses.items():
            first = name == next(iter(run.courses))
            stopped = run.steps if run.ended in {"violation", "decided"} else None
            at = stopped if stops else course.decided_at
            rows.append(
                [
                    str(count) if first else "",
                    shorten(run.label, 16) if first else "",
                    str(run.steps) if first else "",
                    _moment(at, run.period) if first or not stops else "",
                    shorten(name, 16),
                    f"{course.final:+.3g}",
                    course.verdict.name,
                    _span(run.saved, run.period) if first else "",
                ]
            )
    kept = [i for i in range(8) if (i != 1 or labelled) and (i != 7 or stops)]
    return table([[row[i] for i in kept] for row in rows], "".join("><>><><>"[i] for i in kept))


def saved_note(runs: Sequence[Run]) -> list[str]:
    """What the last column of the table means, where it says something."""
    if not any(run.saved for run in runs):
        return []
    return [
        "saved: simulated time from the stop to the time limit. An environment that ends",
        "by itself, as after a fall or a crash, might not have used all of it.",
    ]


def to_json(runs: Sequence[Run], on_violation: str) -> str:
    """The outcomes as strict JSON: infinities are the strings ``"inf"`` and ``"-inf"``.

    Args:
        runs: One or more of one environment.
        on_violation: What a certain violation did.
    """
    first = runs[0]
    return json.dumps(
        {
            "rtamt": rtamt.__version__,
            "environment": first.system,
            "period": None if first.period is None else float(first.period),
            "time_limit": first.limit,
            "on_violation": on_violation,
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


def _moment(sample: int | None, period: Fraction | None) -> str:
    return "-" if sample is None else moment(sample, period)


def _span(steps: int | None, period: Fraction | None) -> str:
    if steps is None:
        return "-"
    return f"{steps} steps" if period is None else f"{number(float(steps * period))} s"
