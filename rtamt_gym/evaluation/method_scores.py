"""`MethodScores`: one method of learning over its training seeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Estimate", "MethodScores"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its bootstrap interval.

    Attributes:
        value: The number.
        interval: The two ends.
    """

    value: float
    interval: tuple[float, float]


@dataclass(frozen=True, slots=True)
class MethodScores:
    """One method over its training seeds.

    Attributes:
        scores: The last score of every run, a row for each run and a column for each task.
        mean: The mean over tasks of the means over runs.
        interquartile_mean: The mean of the middle half of all scores.
        profile: For each threshold the share of scores above it.
        curve: At each point of training the mean; empty without ``steps``.
        improvement: The chance that a run scores above one of the baseline; None of the baseline.
        p: The p-value of a permutation test against the baseline, on the means; None of the
            baseline.
        adjusted: The same, adjusted by Holm's method for the number of methods.
    """

    scores: tuple[tuple[float, ...], ...]
    mean: Estimate
    interquartile_mean: Estimate
    profile: tuple[Estimate, ...]
    curve: tuple[Estimate, ...] = ()
    improvement: Estimate | None = None
    p: float | None = None
    adjusted: float | None = None

    @property
    def runs(self) -> int:
        """The number of training seeds."""
        return len(self.scores)

    @property
    def quartiles(self) -> tuple[float, float, float, float, float]:
        """The least score, the quartiles and the greatest: few numbers that hide no failed run."""
        found = np.quantile(np.array(self.scores), [0.0, 0.25, 0.5, 0.75, 1.0])
        low, first, middle, third, high = map(float, found)
        return low, first, middle, third, high
