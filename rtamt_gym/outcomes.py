"""Outcomes of episodes: a table for the terminal, JSON for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import rtamt
from rtamt_gym.run import Episode
from rtamt_gym.tables import moment, number, shorten, table

__all__ = ["report", "saved_note", "to_json"]


def report(episodes: Sequence[Episode]) -> list[str]:
    """The outcomes as a table, a row for every specification of every episode.

    Without an end on violation the table says when verdicts were certain instead of when the
    monitor stopped.
    """
    stops = any(e.on_violation != "report" for e in episodes)
    labelled = any(e.label for e in episodes)
    rows = [["ep", "driver", "steps", "stopped at", "spec", "robustness", "verdict", "saved"]]
    if not stops:
        rows[0][3] = "certain at"
    for count, episode in enumerate(episodes, 1):
        for name, course in episode.courses.items():
            first = name == next(iter(episode.courses))
            stopped = episode.steps if episode.ended == "violation" else None
            at = stopped if stops else course.decided_at
            rows.append(
                [
                    str(count) if first else "",
                    shorten(episode.label, 16) if first else "",
                    str(episode.steps) if first else "",
                    _moment(at, episode.period) if first or not stops else "",
                    shorten(name, 16),
                    f"{course.final:+.3g}",
                    course.verdict,
                    _span(episode.saved, episode.period) if first else "",
                ]
            )
    kept = [i for i in range(8) if (i != 1 or labelled) and (i != 7 or stops)]
    return table([[row[i] for i in kept] for row in rows], "".join("><>><><>"[i] for i in kept))


def saved_note(episodes: Sequence[Episode]) -> list[str]:
    """What the last column of the table means, where it says something."""
    if not any(episode.saved for episode in episodes):
        return []
    return [
        "saved: simulated time from the stop to the time limit. An environment that ends",
        "by itself, as after a fall or a crash, might not have used all of it.",
    ]


def to_json(episodes: Sequence[Episode]) -> str:
    """The outcomes as strict JSON: infinities are the strings ``"inf"`` and ``"-inf"``."""
    first = episodes[0]
    return json.dumps(
        {
            "rtamt": rtamt.__version__,
            "environment": first.env_id,
            "period": None if first.period is None else float(first.period),
            "time_limit": first.limit,
            "on_violation": first.on_violation,
            "specs": {name: course.formula for name, course in first.courses.items()},
            "episodes": [_outcome(episode) for episode in episodes],
        },
        indent=2,
        allow_nan=False,
    )


def _outcome(episode: Episode) -> dict[str, Any]:
    return {
        "seed": episode.seed,
        "steps": episode.steps,
        "ended": episode.ended,
        "steps_saved": episode.saved,
        "violated_by": episode.violated_by,
        "specs": {
            name: {
                "robustness": _finite(course.final),
                "lower": _finite(course.lower[-1]),
                "upper": _finite(course.upper[-1]),
                "verdict": course.verdict,
                "decided_at": course.decided_at,
            }
            for name, course in episode.courses.items()
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
