"""Paired statistics: two results on the same episodes, their differences and intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from rtamt_gym.results.intervals import (
    CONFIDENCE,
    IntervalKind,
    bootstrap,
    differences,
    median,
    median_interval,
    rate_interval,
    scipy_stats,
)
from rtamt_gym.results.statistics import SUCCESS
from rtamt_gym.tables import counted, p_text, short


@dataclass(frozen=True, slots=True)
class Effect:
    """The difference of two measurements on the same episodes, B minus A.

    Attributes:
        statistic: ``"mean"``: ``value`` is the mean of the differences; ``"median"``: their median,
            as `quantiles` defines it, if a difference is infinite.
        value: The difference.
        interval: The 95 % interval: by the bootstrap for a mean, by ranks for a median.
        pairs: The measurements of A and B in each episode that has both.
    """

    statistic: Literal["mean", "median"]
    value: float
    interval: tuple[float, float]
    pairs: tuple[tuple[float, float], ...]


def effect_of(first: ArrayLike, second: ArrayLike) -> Effect | None:
    """Return the difference of the second and the first measurements; None without a pair.

    Two equal infinities have the difference 0. Swapping both sides reverses the sign, up to the
    random numbers of the bootstrap.
    """
    gaps = differences(first, second)
    if not gaps.size:
        return None
    both = np.stack([np.asarray(first, float), np.asarray(second, float)], axis=1)
    pairs = tuple((float(a), float(b)) for a, b in both)
    if np.isfinite(gaps).all():
        return Effect("mean", float(gaps.mean()), bootstrap(gaps), pairs)
    return Effect("median", median(gaps), median_interval(gaps), pairs)


def mcnemar(only_a: int, only_b: int) -> float:
    """Return the p-value of McNemar's exact test: the chance of such a split if rates are equal.

    If the rates are equal, A has half of the episodes with a single success. Without such an
    episode the p-value is 1.
    """
    if only_a + only_b == 0:
        return 1.0
    return float(scipy_stats("mcnemar").binomtest(only_b, only_a + only_b).pvalue)


def tango(only_a: int, only_b: int, pairs: int) -> tuple[float, float]:
    """Return the 95 % interval of a difference of rates on the same episodes: B's rate minus A's.

    It contains every difference that the score test does not reject, like the interval of Wilson
    for one rate (Tango 1998, "Equivalence test and confidence interval for the difference in
    proportions for the paired-sample design", Statistics in Medicine 17). Therefore its width is
    above 0 even if A and B agree in all episodes, and it lies within -1 and 1.
    """
    return -_largest(only_b, only_a, pairs), _largest(only_a, only_b, pairs)


def _largest(only_a: int, only_b: int, pairs: int) -> float:
    """Return the largest difference that the score test does not reject."""
    if only_b == pairs:
        return 1.0
    z = scipy_stats("tango").norm.ppf((1 + CONFIDENCE) / 2)
    from scipy.optimize import brentq

    def score(gap: float) -> float:
        """Return a number that is 0 where the test statistic is -z, without a division by 0."""
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
    """Return the p-values of several tests, adjusted by the method of Holm (1979).

    If all adjusted results below 0.05 are called differences, the probability of any wrong one is
    at most 0.05.
    """
    adjusted: dict[str, float] = {}
    largest = 0.0
    for rank, name in enumerate(sorted(chances, key=chances.__getitem__)):
        largest = max(largest, min(1.0, (len(chances) - rank) * chances[name]))
        adjusted[name] = largest
    return {name: adjusted[name] for name in chances}


LEVEL: Final = 0.05
"""A difference of rates is significant if the adjusted p-value is below this."""


@dataclass(frozen=True)
class Compared:
    """One requirement in the episodes of two policies, A and B, with the same seeds.

    An episode that failed, or that leaves the requirement undecided, does not satisfy it.

    Attributes:
        name: The name of the requirement.
        formula: The text of the requirement.
        both: The number of pairs in which both satisfy it.
        only_a: The number of pairs in which only A satisfies it.
        only_b: The number of pairs in which only B satisfies it.
        neither: The number of pairs in which neither satisfies it.
        interval_a: The 95 % interval of the rate of A, of the kind of its evaluation.
        interval_b: The 95 % interval of the rate of B.
        interval: The 95 % interval of Tango for the difference, see `tango`.
        p: The p-value of McNemar's exact test.
        adjusted: The p-value, adjusted by Holm's method for the number of requirements.
        robustness: The robustness of B minus the robustness of A, over seeds without a failure;
            None without such a seed.
    """

    name: str
    formula: str
    both: int
    only_a: int
    only_b: int
    neither: int
    interval_a: tuple[float, float]
    interval_b: tuple[float, float]
    interval: tuple[float, float]
    p: float
    adjusted: float
    robustness: Effect | None

    @property
    def pairs(self) -> int:
        """The number of seeds."""
        return self.both + self.only_a + self.only_b + self.neither

    @property
    def rate_a(self) -> float:
        """The share of seeds where A satisfies it."""
        return (self.both + self.only_a) / self.pairs

    @property
    def rate_b(self) -> float:
        """The share of seeds where B satisfies it."""
        return (self.both + self.only_b) / self.pairs

    @property
    def difference(self) -> float:
        """The rate of B minus the rate of A."""
        return (self.only_b - self.only_a) / self.pairs

    @property
    def shown(self) -> bool:
        """Whether the difference of the rates is significant: the adjusted p is below 0.05."""
        return self.adjusted < LEVEL

    @property
    def sentence(self) -> str:
        """The significant differences of rates and robustness, in a sentence."""
        return self.sentence_of("episode")

    def sentence_of(self, noun: str) -> str:
        """Return `sentence` with a word for a pair, such as ``"recording"``."""
        parts = [_rates(self, noun)]
        if self.robustness is not None:
            parts.append(effect_sentence(self.robustness, "its robustness"))
        return " ".join(parts)


def compared_of(
    name: str,
    formula: str,
    counts: Mapping[tuple[bool, bool], int],
    robustness: Effect | None,
    kinds: tuple[IntervalKind, IntervalKind] = ("exact", "exact"),
) -> Compared:
    """Return one requirement from the counts of joint results of A and B, A first.

    The kinds are the interval kinds of both rates.
    """
    both, neither = counts[True, True], counts[False, False]
    only_a, only_b = counts[True, False], counts[False, True]
    pairs = both + neither + only_a + only_b
    p = mcnemar(only_a, only_b)
    return Compared(
        name,
        formula,
        both,
        only_a,
        only_b,
        neither,
        rate_interval(both + only_a, pairs, kinds[0]),
        rate_interval(both + only_b, pairs, kinds[1]),
        tango(only_a, only_b, pairs),
        p,
        p,
        robustness,
    )


def _rates(compared: Compared, noun: str) -> str:
    name = SUCCESS if compared.name == SUCCESS else f"`{compared.name}`"
    gap, pairs = compared.difference, compared.pairs
    low, high = (points(end, pairs) for end in compared.interval)
    if compared.shown:
        ends = sorted(abs(end) for end in compared.interval)
        low, high = (points(end, pairs) for end in ends)
        return (
            f"B satisfies {name} in {counted_points(abs(gap), pairs)} "
            f"{'more' if gap > 0 else 'less'} of the {noun}s "
            f"(95%: {low} to {high}; {p_text(compared.adjusted)})."
        )
    start = f"No difference is shown for {name}:"
    if compared.only_a == compared.only_b == 0:
        agree = f"agree in the only {noun}" if pairs == 1 else f"agree in all {pairs} {noun}s"
        return f"{start} A and B {agree} (95%: {low} to {high} points)."
    return (
        f"{start} {counted_points(gap, pairs)}, {low} to {high} (95%; {p_text(compared.adjusted)})."
    )


def effect_sentence(effect: Effect, what: str) -> str:
    """Return the significant difference of a measurement, such as ``"the return"``, in words."""
    statistic = "on average" if effect.statistic == "mean" else "in the median"
    low, high = effect.interval
    name = what[0].upper() + what[1:]
    if all(a == b for a, b in effect.pairs):
        return f"{name} is the same in each pair."
    if low > 0 or high < 0:
        ends = sorted(abs(end) for end in effect.interval)
        return (
            f"{name} is {short(abs(effect.value))} {'greater' if low > 0 else 'less'} "
            f"{statistic} (95%: {short(ends[0])} to {short(ends[1])})."
        )
    if math.isinf(low) and math.isinf(high):
        return f"{counted(len(effect.pairs), 'pair')} can say nothing of {what}."
    return (
        f"No difference of {what} is shown: {short(effect.value)} {statistic} "
        f"(95%: {short(low)} to {short(high)})."
    )


def points(share: float, pairs: int) -> str:
    """Return a difference of rates in percentage points, with tenths for 500 pairs or more.

    Example:
        >>> points(0.118, 100), points(-0.0043, 2000), points(-0.001, 100)
        ('12', '-0.4', '0')
    """
    digits = 1 if pairs >= 500 else 0
    rounded = round(100 * share, digits)
    return f"{rounded + 0.0:.{digits}f}"  # -0.0 becomes 0.0


def counted_points(share: float, pairs: int) -> str:
    """Return `points` with the unit: ``1 point``, ``12 points``."""
    text = points(share, pairs)
    return f"{text} {'point' if text in {'1', '-1'} else 'points'}"
