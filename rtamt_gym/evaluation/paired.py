"""Two measurements on the same episodes: how far apart they are, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rtamt_gym.results.intervals import (
    bootstrap,
    check_confidence,
    differences,
    median,
    median_interval,
    scipy_stats,
)


@dataclass(frozen=True, slots=True)
class Effect:
    """How far two measurements on the same episodes are apart, B less A.

    Attributes:
        statistic: ``"mean"``: ``value`` is the mean of the differences; ``"median"``: their median,
            as `quantiles` defines it, if a difference is infinite.
        value: The difference.
        interval: Its 95 % interval: by the bootstrap for a mean, by ranks for a median.
        pairs: The measurements of A and B in each episode that has both.
    """

    statistic: Literal["mean", "median"]
    value: float
    interval: tuple[float, float]
    pairs: tuple[tuple[float, float], ...]


def effect_of(first: ArrayLike, second: ArrayLike, *, seed: int = 0) -> Effect | None:
    """Return how far the second measurements are above the first; None without a pair.

    Two equal infinities have the difference 0. Swapping both sides reverses the sign, up to the
    random numbers of the bootstrap.

    Example:
        >>> found = effect_of([1.0, 2.0, 3.0, 4.0], [2.0, 2.5, 4.0, 4.5])
        >>> found.statistic, found.value, found.interval
        ('mean', 0.75, (0.5, 1.0))
        >>> inf = float("inf")
        >>> found = effect_of([inf, 2.0, 3.0], [inf, inf, 3.0])
        >>> found.statistic, found.value, found.interval
        ('median', 0.0, (-inf, inf))
    """
    gaps = differences(first, second)
    if not gaps.size:
        return None
    both = np.stack([np.asarray(first, float), np.asarray(second, float)], axis=1)
    pairs = tuple((float(a), float(b)) for a, b in both)
    if np.isfinite(gaps).all():
        return Effect("mean", float(gaps.mean()), bootstrap(gaps, seed=seed), pairs)
    return Effect("median", median(gaps), median_interval(gaps), pairs)


def mcnemar(only_a: int, only_b: int) -> float:
    """Return the p-value of McNemar's exact test: the chance of such a split if rates are equal.

    If the rates are equal, A has half of the episodes with a single success. Without such an
    episode the p-value is 1.

    Example:
        >>> mcnemar(0, 6), mcnemar(3, 3), mcnemar(0, 0)
        (0.03125, 1.0, 1.0)
    """
    if only_a + only_b == 0:
        return 1.0
    return float(scipy_stats("mcnemar").binomtest(only_b, only_a + only_b).pvalue)


def tango(only_a: int, only_b: int, pairs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the interval of a difference of rates on the same episodes: B's rate minus A's.

    It contains every difference that the score test does not reject, like the interval of Wilson
    for one rate (Tango 1998, "Equivalence test and confidence interval for the difference in
    proportions for the paired-sample design", Statistics in Medicine 17). So its width is above 0
    even if A and B agree in all episodes, and it lies within -1 and 1.

    Args:
        only_a: The number of episodes where only A succeeds.
        only_b: The number of episodes where only B succeeds.
        pairs: All episodes; of 0 nothing is known, and the interval is (-1, 1).
        confidence: How often an interval shall cover the difference: between 0 and 1.

    Example:
        >>> low, high = tango(only_a=20, only_b=40, pairs=160)
        >>> round(low, 3), round(high, 3)
        (0.031, 0.218)
        >>> low, high = tango(0, 0, 100)
        >>> round(low, 3), round(high, 3)
        (-0.037, 0.037)
    """
    check_confidence(confidence)
    return -_greatest(only_b, only_a, pairs, confidence), _greatest(
        only_a, only_b, pairs, confidence
    )


def _greatest(only_a: int, only_b: int, pairs: int, confidence: float) -> float:
    """Return the largest difference that the score test does not reject."""
    if only_b == pairs:
        return 1.0
    z = scipy_stats("tango").norm.ppf((1 + confidence) / 2)
    from scipy.optimize import brentq

    def score(gap: float) -> float:
        """Change its sign where the test statistic is -z; free of its division by 0."""
        # the likeliest share of episodes where only A succeeds, if the difference is `gap`
        linear = (2 * pairs + only_a - only_b) * gap - only_a - only_b
        constant = -only_a * gap * (1 - gap)
        root = math.sqrt(max(linear**2 - 8 * pairs * constant, 0.0))
        share = (root - linear) / (4 * pairs)
        variance = max(pairs * (2 * share + gap * (1 - gap)), 0.0)
        return float(only_b - only_a - pairs * gap + z * math.sqrt(variance))

    # If A and B always agree, the variance is 0 at the estimate, which is not an end.
    start = (only_b - only_a) / pairs + 1e-9
    return float(brentq(score, start, 1.0, xtol=1e-12))


def holm(chances: Mapping[str, float]) -> dict[str, float]:
    """P-values of several tests, adjusted by the method of Holm (1979).

    If all adjusted results below 0.05 are called differences, the probability of any wrong one is
    at most 0.05.

    Example:
        >>> holm({"near": 0.01, "slow": 0.04, "calm": 0.03})
        {'near': 0.03, 'slow': 0.06, 'calm': 0.06}
    """
    adjusted: dict[str, float] = {}
    least = 0.0
    for done, name in enumerate(sorted(chances, key=chances.__getitem__)):
        least = max(least, min(1.0, (len(chances) - done) * chances[name]))
        adjusted[name] = least
    return {name: adjusted[name] for name in chances}
