"""Paired intervals and tests against independent definitions."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar
from scipy.stats import multinomial, norm

from rtamt_gym.evaluation.paired import effect_of, holm, mcnemar, tango

INF = math.inf


def score(gap: float, only_a: int, only_b: int, pairs: int) -> float:
    """Return the score statistic, with the share of A alone from a maximum of the likelihood."""
    low, high = max(0.0, -gap), (1 - gap) / 2

    def negative(share: float) -> float:
        cells = (
            (only_b, share + gap),
            (only_a, share),
            (pairs - only_a - only_b, 1 - gap - 2 * share),
        )
        return -sum(n * math.log(max(p, 1e-300)) for n, p in cells if n)

    share = float(minimize_scalar(negative, bounds=(low, high), options={"xatol": 1e-12}).x)
    return (only_b - only_a - pairs * gap) / math.sqrt(pairs * (2 * share + gap - gap * gap))


@given(st.integers(0, 60), st.integers(0, 60), st.integers(1, 200))
def test_the_ends_of_tango_are_the_differences_at_which_the_score_test_turns(
    only_a: int, only_b: int, others: int
) -> None:
    pairs = only_a + only_b + others
    low, high = tango(only_a, only_b, pairs)
    assert -1 < low <= (only_b - only_a) / pairs <= high < 1
    z = norm.ppf(0.975)
    assert score(low, only_a, only_b, pairs) == pytest.approx(z, rel=1e-3)
    assert score(high, only_a, only_b, pairs) == pytest.approx(-z, rel=1e-3)
    turned = tango(only_b, only_a, pairs)
    assert turned == pytest.approx((-high, -low))


def test_tango_gives_the_published_interval() -> None:
    # Airway hyper-responsiveness of 21 children before and after a transplantation: Fagerland,
    # Lydersen and Laake 2014, "Recommended tests and confidence intervals for paired binomial
    # proportions", Statistics in Medicine 33.
    low, high = tango(7, 1, 21)
    assert (round(low, 3), round(high, 3)) == (-0.517, -0.026)


@pytest.mark.parametrize("pairs", [1, 2, 10, 1000])
def test_tango_has_ends_where_all_episodes_agree_or_none_does(pairs: int) -> None:
    z = norm.ppf(0.975) ** 2
    assert tango(0, 0, pairs) == pytest.approx((-z / (pairs + z), z / (pairs + z)))
    assert tango(0, pairs, pairs) == pytest.approx(((pairs - z) / (pairs + z), 1.0))
    assert tango(pairs, 0, pairs) == pytest.approx((-1.0, -(pairs - z) / (pairs + z)))
    assert tango(0, 0, 0) == (-1.0, 1.0)


def test_tango_covers_about_as_often_as_it_says() -> None:
    pairs = 25
    counts = [(a, b) for a in range(pairs + 1) for b in range(pairs + 1 - a)]
    ends = np.array([tango(a, b, pairs) for a, b in counts])
    cells = np.array([(a, b, pairs - a - b) for a, b in counts])
    for p_a, p_b in ((0.05, 0.05), (0.1, 0.3), (0.02, 0.2), (0.4, 0.2)):
        chance = multinomial.pmf(cells, pairs, [p_a, p_b, 1 - p_a - p_b])
        covered = (ends[:, 0] <= p_b - p_a) & (p_b - p_a <= ends[:, 1])
        assert 0.93 < (chance * covered).sum() < 0.985


@given(st.integers(0, 25), st.integers(0, 25))
def test_mcnemar_sums_all_splits_that_are_no_likelier(only_a: int, only_b: int) -> None:
    total = only_a + only_b
    seen = math.comb(total, only_b)
    tail = sum(c for c in (math.comb(total, k) for k in range(total + 1)) if c <= seen)
    assert mcnemar(only_a, only_b) == pytest.approx(float(Fraction(tail, 2**total)))


@pytest.mark.slow
def test_where_mcnemar_shows_a_difference_the_interval_leaves_out_zero() -> None:
    for only_a, only_b, others in itertools.product(range(25), range(25), (0, 1, 10, 500)):
        if mcnemar(only_a, only_b) < 0.05:
            low, high = tango(only_a, only_b, only_a + only_b + others)
            assert low > 0 or high < 0


@given(st.dictionaries(st.sampled_from("abcde"), st.floats(0, 1), min_size=1))
def test_holm_is_what_no_set_of_tests_refuses(chances: dict[str, float]) -> None:
    sets = [
        chosen
        for size in range(1, len(chances) + 1)
        for chosen in itertools.combinations(chances, size)
    ]
    expected = {
        name: max(
            min(1.0, len(chosen) * min(chances[each] for each in chosen))
            for chosen in sets
            if name in chosen
        )
        for name in chances
    }
    assert holm(chances) == pytest.approx(expected)
    assert list(holm(chances)) == list(chances)


def test_an_effect_is_a_mean_or_with_infinities_a_median() -> None:
    first, second = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [2.0, 2.0, 5.0, 6.0, 4.0, 8.0]
    found = effect_of(first, second)
    assert found is not None
    assert (found.statistic, found.value) == ("mean", 1.0)
    low, high = found.interval
    assert -1.0 <= low < 1.0 < high <= 2.0
    assert found.pairs == tuple(zip(first, second, strict=True))
    assert effect_of(first, second) == found
    infinite = effect_of([*first, INF, -INF, INF], [*second, INF, INF, 0.0])
    assert infinite is not None
    assert (infinite.statistic, infinite.value) == ("median", 1.0)
    assert infinite.interval == (-1.0, 2.0)
    assert effect_of([], []) is None
    alone = effect_of([1.0], [3.0])
    assert alone is not None
    assert (alone.value, alone.interval) == (2.0, (-INF, INF))
