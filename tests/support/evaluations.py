"""Evaluations made from outcomes, for tests of their statistics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction

from rtamt import Verdict
from rtamt_gym import Case
from rtamt_gym.results import Evaluation, Record
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.provenance import Fingerprint, Provenance
from rtamt_gym.results.trial import Trial

FAILED = math.nan
"""The robustness of an episode that an error has ended."""


def evaluation_of(
    heights: Mapping[str, Sequence[float]],
    *,
    seeds: Sequence[int] | None = None,
    policy: str = "policy",
    system: str = "Task-v0",
    formulas: Mapping[str, str] | None = None,
    rewards: Sequence[float] | None = None,
    undecided: Sequence[int] = (),
    decision: Mapping[str, str] | None = None,
    period: Fraction | None = Fraction(1, 10),
) -> Evaluation:
    """Return an evaluation with these robustness values of its episodes, by requirement.

    Args:
        heights: The values: nan is an error, above 0 is satisfied, other values are violated.
        seeds: The seeds of the episodes; counted from 0 by default.
        policy: The name of the policy.
        system: The name of the environment.
        formulas: The texts of the requirements; their names by default.
        rewards: The returns; None for no returns.
        undecided: The indices of undecided episodes.
        decision: The decision of sequential stopping.
        period: Seconds between samples.
    """
    count = len(next(iter(heights.values())))
    rows = []
    for place in range(count):
        failed = any(math.isnan(values[place]) for values in heights.values())
        outcomes = {
            name: _outcome(values[place], place in undecided) for name, values in heights.items()
        }
        rows.append(
            Trial(
                Case({}),
                place if seeds is None else seeds[place],
                {} if failed else outcomes,
                "error" if failed else "truncated",
                5.0,
                0.0,
                "ValueError: no" if failed else "",
                None if rewards is None else rewards[place],
            )
        )
    texts = formulas or {name: f"always({name} > 0)" for name in heights}
    record = Record(
        rows, texts, system, Provenance(fingerprint=Fingerprint(simulators={"rtamt": "1.0"}))
    )
    return Evaluation(record, system, policy, period, 5.0, 0, decision)


def _outcome(height: float, undecided: bool) -> Outcome:  # noqa: FBT001 - a flag of the episode
    if undecided:
        return Outcome(height, -math.inf, math.inf, Verdict.UNDECIDED, None)
    if height > 0:
        return Outcome(height, height, height, Verdict.SATISFIED, Moment(50, 5.0))
    return Outcome(height, height, height, Verdict.VIOLATED, Moment(25, 2.5))
