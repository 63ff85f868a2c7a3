"""`MethodScores`: statistics of methods over few training seeds.

The definitions follow Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical
Precipice" (NeurIPS 2021), with the reference implementation rliable. Scores are an array of shape
(runs, tasks); leading axes are resamples of it. Only NumPy is needed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_AT_ONCE: Final = 2_000_000
"""The number of values that are drawn at once, because of memory."""

_EXACT: Final = 200_000
"""The maximum number of splits of the runs that a permutation test lists."""

_DRAWN: Final = 99_999
"""The number of splits that it draws if there are more."""

_ROUNDING: Final = 1e-12
"""The tolerance of a difference for rounding, relative to the numbers."""


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
        profile: The share of scores above each threshold.
        curve: The mean at each point of training; empty without ``steps``.
        improvement: The probability that a run scores above a run of the baseline; None for the
            baseline itself.
        p: The p-value of a permutation test of the means against the baseline; None for the
            baseline.
        adjusted: The p-value, adjusted by Holm's method for the number of methods.
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
        """The minimum, quartiles and maximum of the scores, which also show failed runs."""
        quartiles = np.quantile(np.array(self.scores), [0.0, 0.25, 0.5, 0.75, 1.0])
        low, first, middle, third, high = map(float, quartiles)
        return low, first, middle, third, high


def mean(scores: Floats) -> Any:  # noqa: ANN401 - a number, or one for each resample
    """Return the mean over tasks of the means over runs."""
    return scores.mean(axis=(-2, -1))


def interquartile_mean(scores: Floats) -> Any:  # noqa: ANN401 - as `mean`
    """Return the mean of the middle half of all scores, runs and tasks together.

    ``floor(n / 4)`` of n scores are left out at either end, as in SciPy's ``trim_mean``.
    """
    ordered = np.sort(scores.reshape(*scores.shape[:-2], -1), axis=-1)
    cut = ordered.shape[-1] // 4
    return ordered[..., cut : ordered.shape[-1] - cut].mean(axis=-1)


def profile(scores: Floats, thresholds: Floats) -> Floats:
    """Return the performance profile: the share of all scores above each threshold."""
    every = scores.reshape(*scores.shape[:-2], -1, 1)
    shares: Floats = (every > thresholds).mean(axis=-2)
    return shares


def improvement(scores: Floats, other: Floats) -> Any:  # noqa: ANN401 - as `mean`
    """Return the chance that a run of one method scores above a run of the other on the same task.

    Equal scores count half: this is Mann and Whitney's U as a share of all pairs, averaged over
    tasks.
    """
    ours, theirs = scores[..., :, None, :], other[..., None, :, :]
    won = (ours > theirs).mean(axis=(-3, -2)) + 0.5 * (ours == theirs).mean(axis=(-3, -2))
    return won.mean(axis=-1)


def stratified_bootstrap(
    samples: Sequence[Floats],
    statistic: Callable[..., Any],
    *,
    confidence: float = 0.95,
    resamples: int = 10_000,
    seed: int = 0,
) -> tuple[Any, Any]:
    """Return the percentile interval of a statistic over resampled runs of each task."""
    rng = np.random.default_rng(seed)
    # A statistic of two methods compares pairs of runs.
    deals = math.prod(len(scores) for scores in samples) * samples[0].shape[1]
    statistics = [
        statistic(*(_drawn(scores, count, rng) for scores in samples))
        for count in _batches(resamples, max(1, _AT_ONCE // deals))
    ]
    tail = 50.0 * (1.0 - confidence)
    low, high = np.percentile(np.concatenate(statistics), [tail, 100.0 - tail], axis=0)
    return low, high


def _batches(count: int, most: int) -> Iterator[int]:
    while count > 0:
        yield min(count, most)
        count -= most


def _drawn(scores: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Return resamples of the runs of each task, shape (count, runs, tasks)."""
    places = rng.integers(len(scores), size=(count, *scores.shape))
    return scores[places, np.arange(scores.shape[1])]


def permutation_p(scores: Floats, other: Floats, *, seed: int = 0) -> float:
    """Return the two-sided p-value of a permutation test on the difference of the means.

    If the methods are equal, the assignment of runs to methods is arbitrary. p is the share of all
    assignments with means at least as far apart as observed. For one task with up to 200,000
    assignments, all are counted. Otherwise 99,999 are drawn, and p is (1 + the number as far apart)
    / 100,000 (Phipson and Smyth, 2010).
    """
    both = np.concatenate([scores, other])
    runs, tasks = len(scores), scores.shape[1]
    distance = abs(float(mean(scores) - mean(other)))
    least = distance - _ROUNDING * float(np.abs(both).max())
    if tasks == 1 and math.comb(len(both), runs) <= _EXACT:
        chosen = np.array(list(itertools.combinations(range(len(both)), runs)))
        return float((_gaps(both[chosen, 0].sum(axis=1)[:, None], both, runs) >= least).mean())
    rng = np.random.default_rng(seed)
    hits = 0
    for count in _batches(_DRAWN, max(1, _AT_ONCE // both.size)):
        orders = rng.random((count, *both.shape)).argsort(axis=1)[:, :runs]
        sums = both[orders, np.arange(tasks)].sum(axis=1)
        hits += int((_gaps(sums, both, runs) >= least).sum())
    return (1 + hits) / (1 + _DRAWN)


def _gaps(sums: Floats, both: Floats, runs: int) -> Floats:
    """Return the distance of the means if the first method's runs of each task have these sums."""
    remainder = both.sum(axis=0) - sums
    gaps: Floats = np.abs((sums / runs - remainder / (len(both) - runs)).mean(axis=1))
    return gaps
