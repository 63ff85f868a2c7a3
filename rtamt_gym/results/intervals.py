"""Confidence intervals and quantiles of numbers that were measured on episodes.

Intervals of rates and quantiles need only NumPy; other functions import SciPy when they are called.

To add a kind of interval of a rate: its name in `IntervalKind`, its case in `rate_interval`, its
guarantee in `promise`, and a choice of ``rtamt evaluate --interval``. ``docs/evaluation.md`` states
its coverage, which ``tests/rtamt_gym/results/test_intervals.py`` computes again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt import InputError
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.checks.extras import naming_extra

QUANTILES: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
"""The default shares of `quantiles`."""

CONFIDENCE: Final = 0.95
"""How often the intervals cover the true value."""

_RESAMPLES: Final = 9999

_AT_ONCE: Final = 1_000_000
"""The number of values that the bootstrap draws at once, because of memory."""


IntervalKind = Literal["exact", "wilson"]
"""The kinds of intervals of a rate: of Clopper and Pearson, and of Wilson."""


def rate_interval(count: int, total: int, kind: IntervalKind = "exact") -> tuple[float, float]:
    """Return the 95 % interval of a kind for the true rate, from ``count`` of ``total`` trials."""
    check_choice("interval", kind, get_args(IntervalKind))
    return (clopper_pearson if kind == "exact" else wilson)(count, total)


def promise(kind: IntervalKind) -> str:
    """Return the coverage of the 95 % intervals of a kind, in words that follow its name."""
    if kind == "exact":
        return "holds the true rate in at least 95 of 100 evaluations"
    return "of Wilson, holds the true rate in about 95 of 100 evaluations"


def clopper_pearson(count: int, total: int) -> tuple[float, float]:
    """Return the exact 95 % interval of Clopper and Pearson (1934) for a rate.

    The interval contains the true rate with a probability of at least 95 %, for every rate. At its
    lower end, ``count`` or more have a probability of 2.5 %; at its upper end, ``count`` or fewer.
    It is wider than the interval of `wilson`, which has this coverage on average only.
    """
    _check_counts(count, total)
    if not total:
        return 0.0, 1.0
    chance = (1 - CONFIDENCE) / 2
    return _lower_rate(count, total, chance), 1.0 - _lower_rate(total - count, total, chance)


def _lower_rate(count: int, total: int, chance: float) -> float:
    """Return the rate at which ``count`` or more of ``total`` have this chance; 0 for count 0.

    Newton's method on the logarithms of rate and chance, within bounds that become narrower.
    """
    if not count:
        return 0.0
    if count == total:
        return float(chance ** (1 / total))
    low, high = 0.0, count / total
    rate = high / 2
    for _ in range(200):
        tail, first = _tail(count, total, rate)
        if tail < chance:
            low = rate
        else:
            high = rate
        # The derivative of the tail by the rate equals its first term, times count / rate.
        step = math.log(chance / tail) * tail / (first * count) if tail and first else math.nan
        closer = rate * math.exp(step) if abs(step) < 1 else math.nan
        before, rate = rate, closer if low < closer < high else (low + high) / 2
        if abs(rate - before) <= 1e-15 * rate:
            break
    return rate


def _tail(count: int, total: int, rate: float) -> tuple[float, float]:
    """Return the chance of ``count`` or more of ``total`` at a rate, and of exactly ``count``."""
    log_count = math.lgamma(total + 1) - math.lgamma(count + 1) - math.lgamma(total - count + 1)
    first = math.exp(log_count + count * math.log(rate) + (total - count) * math.log1p(-rate))
    odds = rate / (1 - rate)
    terms, term = [first], first
    for successes in range(count, total):
        term *= (total - successes) / (successes + 1) * odds
        terms.append(term)
        if term <= 1e-18 * first:
            break
    return math.fsum(terms), first


def wilson(count: int, total: int) -> tuple[float, float]:
    """Return the interval of Wilson (1927) for the true rate, from ``count`` of ``total`` trials.

    It lies within 0 and 1: its low end is exactly 0 for a count of 0, its high end exactly 1 for
    ``total``. Averaged over rates, the coverage is about 95 %, but near 0 or 1 it may be
    far less: 84.4 % for a 95 % interval of 100 trials at a rate of 0.9983.
    """
    _check_counts(count, total)
    if not total:
        return 0.0, 1.0
    z = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
    middle = (count + z * z / 2) / (total + z * z)
    half = z * math.sqrt(count * (total - count) / total + z * z / 4) / (total + z * z)
    return middle - half if count else 0.0, middle + half if count < total else 1.0


def quantiles(values: ArrayLike, shares: Sequence[float] = QUANTILES) -> Mapping[float, float]:
    """Return the quantiles of robustness, which may be infinite, by share, in their order.

    The quantile of a share is the smallest value that at least this share of the values does not
    exceed. It is always an existing value, never a mean of two, so infinities cause no nan. The
    median of an even number of values is the lower middle value.
    """
    array = _checked(values)
    if not array.size:
        return {}
    result = np.quantile(array, list(shares), method="inverted_cdf")
    return dict(zip(shares, result.tolist(), strict=True))


def median(values: ArrayLike) -> float:
    """Return the median as `quantiles` defines it; nan without values."""
    return quantiles(values, [0.5]).get(0.5, math.nan)


def median_interval(values: ArrayLike) -> tuple[float, float]:
    """Return the 95 % interval of the median, between two of the values.

    If the values are independent, with any distribution, infinities and ties included, it covers
    the median with a probability of at least 95 %, because the number of values below the
    median is binomial. Fewer than six values cannot reach 95 %: their interval is (-inf, inf).
    """
    array = _checked(values)
    if not array.size:
        return -math.inf, math.inf
    stats = scipy_stats("median_interval")
    low, high = stats.quantile_test(array, p=0.5).confidence_interval(CONFIDENCE)
    return (
        -math.inf if math.isnan(low) else float(low),
        math.inf if math.isnan(high) else float(high),
    )


def bootstrap(values: ArrayLike) -> tuple[float, float]:
    """Return the 95 % interval of the mean by the bootstrap of Efron (1987), BCa.

    Use it for independent values of an unknown distribution. The interval lies between the minimum
    and the maximum of the values; if all are equal, both ends are this value. For few values it is
    too narrow. The same values in the same order return the same interval.
    """
    array = _checked(values)
    if not np.isfinite(array).all():
        raise InputError(
            "expected finite values for a mean, got an infinite value; use median_interval for "
            "infinities"
        )
    if len(array) < 2:
        return -math.inf, math.inf
    if array.min() == array.max():  # SciPy's corrections would be 0 / 0
        return float(array[0]), float(array[0])
    low, high = (
        scipy_stats("bootstrap")
        .bootstrap(
            (array,),
            np.mean,
            confidence_level=CONFIDENCE,
            n_resamples=_RESAMPLES,
            batch=max(1, _AT_ONCE // len(array)),
            random_state=np.random.default_rng(0),
        )
        .confidence_interval
    )
    return float(low), float(high)


def differences(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """Return the second values minus the first; 0 for two equal infinities, not nan."""
    before, after = _checked(first), _checked(second)
    if len(before) != len(after):
        raise InputError(f"expected as many values in both, got {len(before)} and {len(after)}")
    differing = before != after
    return np.subtract(after, before, out=np.zeros(len(before)), where=differing)


def _check_counts(count: int, total: int) -> None:
    if not 0 <= count <= total:
        raise InputError(f"expected a count of 0 to {total}, got {count}")


def _checked(values: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64).ravel()
    if np.isnan(array).any():
        raise InputError(
            f"expected values that are not nan, got nan at index {int(np.isnan(array).argmax())}; "
            "remove episodes without a value"
        )
    return array


def scipy_stats(caller: str) -> Any:  # noqa: ANN401 - a module without types
    """Return the module `scipy.stats`; the error names the extra if SciPy is missing."""
    try:
        from scipy import stats
    except ModuleNotFoundError as error:
        raise naming_extra(error, caller, "search") from error
    return stats
