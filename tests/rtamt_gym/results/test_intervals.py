"""Intervals and quantiles against definitions, exact coverage, and samples that have no spread."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, norm

from rtamt import InputError
from rtamt_gym.results.intervals import (
    QUANTILES,
    bootstrap,
    differences,
    median,
    median_interval,
    quantiles,
    wilson,
)

INF = math.inf
values = st.floats(allow_nan=False, allow_infinity=True)


@given(st.integers(1, 3000), st.data())
def test_the_ends_of_wilson_are_the_rates_at_which_the_score_test_turns(
    total: int, data: st.DataObject
) -> None:
    count = data.draw(st.integers(0, total))
    z = norm.ppf(0.975)
    for end in wilson(count, total):
        if 0.0 < end < 1.0:
            score = (count - total * end) / math.sqrt(total * end * (1 - end))
            assert abs(score) == pytest.approx(z, rel=1e-6)
    low, high = wilson(count, total)
    assert low <= count / total <= high


def test_wilson_is_exact_at_none_and_at_all() -> None:
    for total in range(1, 500):
        assert wilson(0, total)[0] == 0.0
        assert wilson(total, total)[1] == 1.0
    assert wilson(0, 0) == (0.0, 1.0)


def test_wilson_covers_on_average_what_it_says() -> None:
    rates = np.linspace(0.005, 0.995, 199)
    for total in (10, 50, 200):
        ends = np.array([wilson(count, total) for count in range(total + 1)])
        within = (ends[:, :1] <= rates) & (rates <= ends[:, 1:])
        covered = (binom.pmf(np.arange(total + 1)[:, None], total, rates) * within).sum(axis=0)
        assert covered.mean() == pytest.approx(0.95, abs=0.01)
        assert covered.min() > 0.83


@pytest.mark.parametrize(
    ("count", "total", "confidence", "message"),
    [
        (3, 2, 0.95, "expected a count of 0 to 2, got 3"),
        (-1, 2, 0.95, "expected a count of 0 to 2, got -1"),
        (1, 2, 95, "expected confidence= between 0 and 1, such as 0.95, got 95"),
    ],
)
def test_wilson_refuses(count: int, total: int, confidence: float, message: str) -> None:
    with pytest.raises(InputError) as refused:
        wilson(count, total, confidence)
    assert str(refused.value) == message


@given(st.lists(values, min_size=1, max_size=50))
def test_a_quantile_is_the_least_value_that_its_share_does_not_exceed(numbers: list[float]) -> None:
    for share, found in quantiles(numbers).items():
        enough = [v for v in numbers if sum(w <= v for w in numbers) >= share * len(numbers) - 1e-9]
        assert found == min(enough)


def test_quantiles_of_none_are_empty_and_nan_is_refused() -> None:
    assert dict(quantiles([])) == {}
    assert list(quantiles([1.0])) == list(QUANTILES)
    assert math.isnan(median([]))
    with pytest.raises(InputError) as refused:
        quantiles([1.0, math.nan])
    assert str(refused.value) == (
        "expected values that are no nan, got one at 1; leave out episodes that have none"
    )


@given(st.lists(values, min_size=1, max_size=60))
def test_the_interval_of_a_median_ends_at_values_whose_ranks_cover_it(numbers: list[float]) -> None:
    low, high = median_interval(numbers)
    assert low <= median(numbers) <= high
    size = len(numbers)
    # The greatest rank below which the median lies with a chance of 2.5 % at most.
    rank = sum(binom.cdf(k, size, 0.5) <= 0.025 for k in range(size))
    ordered = sorted(numbers)
    assert low == (ordered[rank - 1] if rank else -INF)
    assert high == (ordered[size - rank] if rank else INF)


def test_infinities_are_ends_of_an_interval_of_a_median() -> None:
    assert median_interval([-INF] * 10) == (-INF, -INF)
    assert median_interval([0.0] * 8 + [INF] * 8) == (0.0, INF)
    assert median_interval([]) == (-INF, INF)


def test_the_bootstrap_covers_a_mean_nearly_as_often_as_it_says() -> None:
    generator = np.random.default_rng(1)
    samples = generator.normal(size=(300, 30))
    ends = [bootstrap(sample, resamples=499) for sample in samples]
    covered = sum(low <= 0.0 <= high for low, high in ends)
    assert 0.90 <= covered / 300 <= 0.98


def test_the_bootstrap_of_a_seed_is_the_same_again_and_another_seed_gives_another() -> None:
    sample = np.random.default_rng(2).exponential(size=40)
    assert bootstrap(sample, seed=3) == bootstrap(sample, seed=3) != bootstrap(sample, seed=4)


def test_the_bootstrap_of_equal_or_few_values_is_no_nan() -> None:
    assert bootstrap([0.1] * 7) == (0.1, 0.1)
    assert bootstrap([]) == bootstrap([2.0]) == (-INF, INF)
    assert bootstrap([0.0, 0.0, 0.0, 0.0, 1.0])[0] == 0.0
    assert bootstrap([1.0, 2.0]) == (1.0, 2.0)


@pytest.mark.parametrize("value", [INF, -INF])
def test_the_bootstrap_refuses_what_has_no_mean(value: float) -> None:
    with pytest.raises(InputError) as refused:
        bootstrap([1.0, value])
    assert str(refused.value) == (
        "expected finite values, of which there is a mean, got an infinite one; "
        "median_interval takes infinities"
    )


@given(st.lists(st.tuples(values, values)))
def test_a_difference_is_never_nan_and_turns_with_its_sides(
    pairs: list[tuple[float, float]],
) -> None:
    first, second = [a for a, _ in pairs], [b for _, b in pairs]
    with np.errstate(over="ignore"):  # the greatest floats are farther apart than any float
        found = differences(first, second)
        assert not np.isnan(found).any()
        assert (found == -differences(second, first)).all()
    for (a, b), gap in zip(pairs, found, strict=True):
        assert math.copysign(1, gap) == (b > a) - (b < a) if a != b else gap == 0


def test_differences_need_as_many_values_in_both() -> None:
    with pytest.raises(InputError) as refused:
        differences([1.0], [])
    assert str(refused.value) == "expected as many values in both, got 1 and 0"
