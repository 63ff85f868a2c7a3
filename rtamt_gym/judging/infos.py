"""The keys that the wrappers add to ``info``, for one environment and for many.

Every key is written here once; a key that not every environment has gets a `Where`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "VERDICTS",
    "Lanewise",
    "SpecRows",
    "Where",
    "end_info",
    "last_info",
    "outcome",
    "present",
    "spec_state",
    "step_info",
]

VERDICTS = np.array(["UNDECIDED", "SATISFIED", "VIOLATED"], dtype=object)
"""The names of verdicts: of 0, 1 and -1."""

Lanewise = Any
"""A value of one environment, or an array with an element for each of many."""


class Where(NamedTuple):
    """A value that exists only where ``there`` is true, which is a bool or an array of them."""

    there: Lanewise
    value: Lanewise


class SpecRows(NamedTuple):
    """Values of several specifications in many environments.

    Attributes:
        names: The specifications.
        found: Arrays with a row for each of them.
        more: What a specification has beside that, by name.
    """

    names: Sequence[str]
    found: Mapping[str, Lanewise]
    more: Mapping[str, Mapping[str, Lanewise]]

    def by_name(self) -> dict[str, dict[str, Any]]:
        """The values of each specification."""
        return {
            name: {key: _row(value, k) for key, value in self.found.items()}
            | dict(self.more.get(name, {}))
            for k, name in enumerate(self.names)
        }


def _row(value: Lanewise, k: int) -> Lanewise:
    return Where(value.there[k], value.value[k]) if isinstance(value, Where) else value[k]


def step_info(
    info: Mapping[str, Any],
    robustness: Lanewise,
    lower: Lanewise,
    upper: Lanewise,
    violated: Lanewise,
    states: Mapping[str, Any] | None = None,
    costs: Mapping[str, Lanewise] | None = None,
    of_instant: Lanewise | None = None,
    progress: Lanewise | None = None,
    period: Lanewise | None = None,
) -> dict[str, Any]:
    """The info of an environment with the keys that every info has.

    ``violated`` says whether a specification is violated; ``states`` has a `spec_state` for each
    specification; ``of_instant`` is True where the robustness is that of an instant;
    ``progress`` is that of requirements in stages; ``period`` is told at a reset. States, costs,
    ``of_instant``, ``progress`` and ``period``, with their keys, are optional.
    """
    # Key by key: a dictionary of its own, and then one of both, would take twice the time.
    made = dict(info)
    made["robustness"] = robustness
    made["stl_lower"] = lower
    made["stl_upper"] = upper
    made["stl_violated"] = violated
    if of_instant is not None:
        made["stl_of_instant"] = of_instant
    if progress is not None:
        made["stl_progress"] = progress
    if period is not None:
        made["stl_period"] = period
    if states is not None:
        made["stl"] = states
    if costs is not None:
        made.update(costs)
    return made


def spec_state(
    robustness: Lanewise,
    lower: Lanewise,
    upper: Lanewise,
    verdict: Lanewise,
    of_instant: Lanewise | None = None,
    progress: Lanewise | None = None,
) -> dict[str, Any]:
    """The state of one specification, an entry of ``info["stl"]``.

    ``of_instant``, True where the robustness is that of an instant, and ``progress``, of a
    requirement in stages, are optional.
    """
    made = {"robustness": robustness, "lower": lower, "upper": upper, "verdict": verdict}
    if of_instant is not None:
        made["of_instant"] = of_instant
    if progress is not None:
        made["progress"] = progress
    return made


def outcome(
    robustness: Lanewise,
    verdict: Lanewise,
    satisfied: Lanewise,
    settled_at: Lanewise,
    decided: Lanewise,
    ended: Lanewise,
    by_end: Lanewise,
) -> dict[str, Any]:
    """Return the outcome of a specification, an entry of ``info["stl_episode"]``.

    Args:
        robustness: The robustness of the episode.
        verdict: -1 violated, 0 undecided, 1 satisfied.
        satisfied: Whether the verdict is 1.
        settled_at: The sample that decided the verdict, or the last one if only the end did.
        decided: Whether a sample decided the verdict.
        ended: Whether only the end did.
        by_end: Whether the verdict is -1 beside a robustness that holds.
    """
    return {
        "robustness": robustness,
        "verdict": VERDICTS[verdict],
        "satisfied": satisfied,
        "decided_at": Where(decided, settled_at),
        "ended_at": Where(ended, settled_at),
        "by_end": Where(by_end, by_end),
    }


def last_info(
    outcomes: Mapping[str, Any] | SpecRows,
    violated: Lanewise,
    violated_by: Lanewise,
    violated_at: Lanewise,
    success: Lanewise,
    undecided: Lanewise,
    reported: Lanewise,
) -> dict[str, Any]:
    """The keys that only the last info of an episode has.

    Args:
        outcomes: An `outcome` for each specification.
        violated: Whether a specification is violated.
        violated_by: The specification that was violated first, if one is.
        violated_at: The sample that showed it, or the last one if only the end did.
        success: Whether all specifications are satisfied.
        undecided: Whether the verdict on one is open.
        reported: Whether the environment has its own ``is_success``, which is kept.
    """
    return {
        "stl_episode": outcomes,
        "stl_violated_by": Where(violated, violated_by),
        **end_info(
            Where(violated, violated_at),
            success,
            undecided,
            Where(np.logical_not(reported), success),
        ),
    }


def end_info(
    violated_at: Lanewise, success: Lanewise, undecided: Lanewise, is_success: Lanewise
) -> dict[str, Any]:
    """The keys of the last info of an episode that are numbers or truth values."""
    return {
        "stl_violated_at": violated_at,
        "stl_success": success,
        "stl_undecided": undecided,
        "is_success": is_success,
    }


def present(info: Mapping[str, Any]) -> dict[str, Any]:
    """Copies the info of one environment, without the keys that are not there."""
    made = {}
    for key, value in info.items():
        if isinstance(value, dict):
            made[key] = present(value)
        elif not isinstance(value, Where):
            made[key] = value
        elif value.there:
            made[key] = value.value
    return made
