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
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_choice, check_count
from rtamt_gym.checks.extras import naming_extra

QUANTILES: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
"""The default shares of `quantiles`."""

_RESAMPLES: Final = 9999

_AT_ONCE: Final = 1_000_000
"""The number of values that the bootstrap draws at once, because of memory."""


IntervalKind = Literal["exact", "wilson"]
"""The kinds of intervals of a rate: of Clopper and Pearson, and of Wilson."""


def rate_interval(
    count: int, total: int, kind: IntervalKind = "exact", confidence: float = 0.95
) -> tuple[float, float]:
    """Return the interval of a kind for the true rate, from ``count`` of ``total`` trials.

    Raises:
        InputError: If the kind is unknown, or a number is out of its range.

    Example:
        >>> [[round(end, 3) for end in rate_interval(6, 10, kind)] for kind in ("exact", "wilson")]
        [[0.262, 0.878], [0.313, 0.832]]
    """
    check_choice("interval", kind, get_args(IntervalKind))
    interval = clopper_pearson if kind == "exact" else wilson
    return interval(count, total, confidence)


def promise(kind: IntervalKind) -> str:
    """Return the coverage of the 95 % intervals of a kind, in words that follow its name."""
    if kind == "exact":
        return "holds the true rate in at least 95 of 100 evaluations"
    return "of Wilson, holds the true rate in about 95 of 100 evaluations"


def clopper_pearson(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact interval of Clopper and Pearson (1934) for a rate.

    The interval contains the true rate with a probability of at least ``confidence``, for every
    rate. At its lower end, ``count`` or more have the probability (1 - confidence) / 2; at its
    upper end, ``count`` or fewer. It is wider than the interval of `wilson`, which has this
    coverage on average only.

    Args:
        count: The number of successes, from 0 to ``total``.
        total: The number of trials; for 0 trials, the interval is (0, 1).
        confidence: The minimum probability that the interval contains the rate, between 0 and 1.

    Raises:
        InputError: If a number is out of its range.

    Example:
        >>> low, high = clopper_pearson(95, 100)
        >>> round(low, 3), round(high, 3)
        (0.887, 0.984)
        >>> clopper_pearson(0, 100)[0], clopper_pearson(100, 100)[1], clopper_pearson(0, 0)
        (0.0, 1.0, (0.0, 1.0))
    """
    _check_counts(count, total, confidence)
    if not total:
        return 0.0, 1.0
    chance = (1 - confidence) / 2
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


def wilson(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the interval of Wilson (1927) for the true rate, from ``count`` of ``total`` trials.

    It lies within 0 and 1: its low end is exactly 0 for a count of 0, its high end exactly 1 for
    ``total``. Averaged over rates, the coverage is about ``confidence``, but near 0 or 1 it may be
    far less: 84.4 % for a 95 % interval of 100 trials at a rate of 0.9983.

    Args:
        count: The number of successes, from 0 to ``total``.
        total: The number of trials; for 0 trials, the interval is (0, 1).
        confidence: The average coverage, between 0 and 1.

    Raises:
        InputError: If a number is out of its range.

    Example:
        >>> low, high = wilson(95, 100)
        >>> round(low, 3), round(high, 3)
        (0.888, 0.978)
        >>> wilson(0, 100)[0], wilson(100, 100)[1], wilson(0, 0)
        (0.0, 1.0, (0.0, 1.0))
    """
    _check_counts(count, total, confidence)
    if not total:
        return 0.0, 1.0
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    middle = (count + z * z / 2) / (total + z * z)
    half = z * math.sqrt(count * (total - count) / total + z * z / 4) / (total + z * z)
    return middle - half if count else 0.0, middle + half if count < total else 1.0


def quantiles(values: ArrayLike, shares: Sequence[float] = QUANTILES) -> Mapping[float, float]:
    """Return the quantiles of robustness, which may be infinite, by share, in their order.

    The quantile of a share is the smallest value that at least this share of the values does not
    exceed. It is always an existing value, never a mean of two, so infinities cause no nan. The
    median of an even number of values is the lower middle value.

    Args:
        values: The values, in any order, without nan. Without values the result is empty.
        shares: Numbers from 0 to 1.

    Raises:
        InputError: If a value is nan.

    Example:
        >>> dict(quantiles([3.0, -1.0, float("inf"), 2.0]))
        {0.05: -1.0, 0.25: -1.0, 0.5: 2.0, 0.75: 3.0, 0.95: inf}
        >>> dict(quantiles([]))
        {}
    """
    array = _checked(values)
    if not array.size:
        return {}
    result = np.quantile(array, list(shares), method="inverted_cdf")
    return dict(zip(shares, result.tolist(), strict=True))


def median(values: ArrayLike) -> float:
    """Return the median as `quantiles` defines it; nan without values.

    Example:
        >>> median([float("-inf"), 1.0, 2.0, float("inf")])
        1.0
    """
    return quantiles(values, [0.5]).get(0.5, math.nan)


def median_interval(values: ArrayLike, confidence: float = 0.95) -> tuple[float, float]:
    """Return the interval of the median, between two of the values.

    If the values are independent, with any distribution, infinities and ties included, it covers
    the median with a probability of at least ``confidence``, because the number of values below the
    median is binomial. Fewer than six values cannot reach 95 %: their interval is (-inf, inf).

    Raises:
        InputError: If a value is nan, or ``confidence`` is not between 0 and 1.

    Example:
        >>> median_interval([1, 2, 3, 4, 5, 6, 7, 8, 9, float("inf")])
        (2.0, 9.0)
        >>> median_interval([1, 2, 3])
        (-inf, inf)
    """
    check_confidence(confidence)
    array = _checked(values)
    if not array.size:
        return -math.inf, math.inf
    stats = scipy_stats("median_interval")
    low, high = stats.quantile_test(array, p=0.5).confidence_interval(confidence)
    return (
        -math.inf if math.isnan(low) else float(low),
        math.inf if math.isnan(high) else float(high),
    )


def bootstrap(
    values: ArrayLike, confidence: float = 0.95, *, seed: int = 0, resamples: int = _RESAMPLES
) -> tuple[float, float]:
    """Return the interval of the mean by the bootstrap of Efron (1987), BCa.

    Use it for independent values of an unknown distribution. The interval lies between the minimum
    and the maximum of the values; if all are equal, both ends are this value. For few values it is
    too narrow. The same values in the same order and the same seed return the same interval.

    Args:
        values: Finite values; for fewer than two, the interval is (-inf, inf).
        confidence: The probability that the interval covers the mean, between 0 and 1.
        seed: The seed of the resamples.
        resamples: The number of resamples.

    Raises:
        InputError: If a value is nan or infinite, or a number is out of its range.

    Example:
        >>> low, high = bootstrap([0.2, 0.5, 0.3, 0.9, 0.4, 0.6, 0.1, 0.8])
        >>> round(low, 2), round(high, 2)
        (0.3, 0.66)
        >>> bootstrap([1.0, 1.0, 1.0]), bootstrap([1.0])
        ((1.0, 1.0), (-inf, inf))
    """
    check_confidence(confidence)
    check_count(Argument("resamples"), resamples)
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
            confidence_level=confidence,
            n_resamples=resamples,
            batch=max(1, _AT_ONCE // len(array)),
            random_state=np.random.default_rng(seed),
        )
        .confidence_interval
    )
    return float(low), float(high)


def differences(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """Return the second values minus the first, pair by pair; 0 for two equal infinities, not nan.

    Raises:
        InputError: If the numbers of values differ, or a value is nan.

    Example:
        >>> inf = float("inf")
        >>> differences([1.0, inf, inf, -inf], [3.0, inf, 0.0, 1.0])
        array([  2.,   0., -inf,  inf])
    """
    before, after = _checked(first), _checked(second)
    if len(before) != len(after):
        raise InputError(f"expected as many values in both, got {len(before)} and {len(after)}")
    differing = before != after
    return np.subtract(after, before, out=np.zeros(len(before)), where=differing)


def _check_counts(count: int, total: int, confidence: float) -> None:
    check_confidence(confidence)
    if not 0 <= count <= total:
        raise InputError(f"expected a count of 0 to {total}, got {count}")


def check_confidence(confidence: float) -> None:
    """Raise InputError if a confidence is not between 0 and 1."""
    if not 0 < confidence < 1:
        raise InputError(f"expected confidence= between 0 and 1, such as 0.95, got {confidence!r}")


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
