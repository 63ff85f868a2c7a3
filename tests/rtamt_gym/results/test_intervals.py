"""Intervals and quantiles against definitions, exact coverage, and samples without a spread."""

import math
from collections.abc import Callable
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from paths import ROOT
from scipy.stats import beta, binom, norm

from rtamt import InputError
from rtamt_gym.results.intervals import (
    QUANTILES,
    IntervalKind,
    bootstrap,
    clopper_pearson,
    differences,
    median,
    median_interval,
    promise,
    quantiles,
    rate_interval,
    wilson,
)

Floats = NDArray[np.float64]
INF = math.inf
values = st.floats(allow_nan=False, allow_infinity=True)


@given(st.integers(1, 3000), st.data())
def test_wilson_inverts_the_score_test(total: int, data: st.DataObject) -> None:
    count = data.draw(st.integers(0, total))
    z = norm.ppf(0.975)
    for end in wilson(count, total):
        if 0.0 < end < 1.0:
            score = (count - total * end) / math.sqrt(total * end * (1 - end))
            assert abs(score) == pytest.approx(z, rel=1e-6)
    low, high = wilson(count, total)
    assert low <= count / total <= high


def test_intervals_end_at_0_and_1() -> None:
    for total in range(1, 500):
        for found in (wilson, clopper_pearson):
            assert found(0, total)[0] == 0.0
            assert found(total, total)[1] == 1.0
    assert wilson(0, 0) == clopper_pearson(0, 0) == (0.0, 1.0)


@given(st.one_of(st.integers(1, 60), st.integers(1, 20_000)), st.data())
def test_exact_interval_has_beta_quantiles(total: int, data: st.DataObject) -> None:
    count = data.draw(st.integers(0, total))
    low, high = clopper_pearson(count, total)
    assert low == pytest.approx(
        beta.ppf(0.025, count, total - count + 1) if count else 0.0, rel=1e-9, abs=0
    )
    assert high == pytest.approx(
        beta.ppf(0.975, count + 1, total - count) if count < total else 1.0, rel=1e-9
    )
    assert low <= count / total <= high


@pytest.mark.parametrize("count", range(3800, 3830, 3))
def test_exact_interval_with_tiny_chances(
    count: int,
) -> None:
    total = 1_000_000
    low, high = clopper_pearson(count, total)
    assert low == pytest.approx(beta.ppf(0.025, count, total - count + 1), rel=1e-9)
    assert high == pytest.approx(beta.ppf(0.975, count + 1, total - count), rel=1e-9)


def coverage(kind: IntervalKind, total: int, rates: Floats) -> Floats:
    """Return the coverage of intervals, by exact sums over all counts."""
    ends = np.array([rate_interval(count, total, kind) for count in range(total + 1)])
    within = (ends[:, :1] <= rates) & (rates <= ends[:, 1:])
    found: Floats = (binom.pmf(np.arange(total + 1)[:, None], total, rates) * within).sum(axis=0)
    return found


FINE = np.arange(1, 10_000) / 10_000


def test_page_states_coverage_of_intervals() -> None:
    page = " ".join((ROOT / "docs" / "evaluation.md").read_text(encoding="utf-8").split())
    wilson_worst = []
    for total in (5, 20, 100):
        covered = {kind: coverage(kind, total, FINE) for kind in get_args(IntervalKind)}
        assert covered["exact"].min() >= 0.95 - 1e-12
        assert f"{covered['wilson'].mean():.2f}" in ("0.95", "0.96")
        assert 0.4 < (covered["wilson"] < 0.95).mean() < 0.45
        wilson_worst.append(f"{100 * covered['wilson'].min():.1f} %")
    few, some, many = wilson_worst
    assert f"the share is {few} for 5 episodes, {some} for 20 and {many} for 100." in page
    assert "contain the true rate in at least 95 of 100 evaluations" in page
    assert "less often for more than 40 % of the rates" in page


def test_page_states_widths_of_intervals() -> None:
    page = (ROOT / "docs" / "evaluation.md").read_text(encoding="utf-8")
    table = []
    for total in (20, 100, 500, 1000, 2000):
        cells = [str(total)]
        for percent in (50, 80, 90, 95):
            low, high = clopper_pearson(total * percent // 100, total)
            cells.append(f"{50 * (high - low):.1f}")
        cells.append(f"{100 * clopper_pearson(total, total)[0]:.1f} %")
        table.append(f"| {' | '.join(cells)} |")
    assert "\n".join(table) in page, "\n".join(table)


def test_interval_kinds() -> None:
    assert rate_interval(6, 10) == rate_interval(6, 10, "exact") == clopper_pearson(6, 10)
    assert rate_interval(6, 10, "wilson") == wilson(6, 10)
    assert promise("exact") != promise("wilson")
    with pytest.raises(InputError) as refused:
        rate_interval(6, 10, "exat")  # type: ignore[arg-type]
    assert str(refused.value).startswith("expected interval='exact' or 'wilson', got 'exat'")


@pytest.mark.parametrize("found", [wilson, clopper_pearson])
@pytest.mark.parametrize(
    ("count", "message"),
    [
        (3, "expected a count of 0 to 2, got 3"),
        (-1, "expected a count of 0 to 2, got -1"),
    ],
)
def test_count_out_of_range_error(found: Callable[..., object], count: int, message: str) -> None:
    with pytest.raises(InputError) as refused:
        found(count, 2)
    assert str(refused.value) == message


@given(st.lists(values, min_size=1, max_size=50))
def test_quantiles_match_definition(numbers: list[float]) -> None:
    for share, found in quantiles(numbers).items():
        enough = [v for v in numbers if sum(w <= v for w in numbers) >= share * len(numbers) - 1e-9]
        assert found == min(enough)


def test_quantiles_of_empty_and_nan() -> None:
    assert dict(quantiles([])) == {}
    assert list(quantiles([1.0])) == list(QUANTILES)
    assert math.isnan(median([]))
    with pytest.raises(InputError) as refused:
        quantiles([1.0, math.nan])
    assert str(refused.value) == (
        "expected values that are not nan, got nan at index 1; remove episodes without a value"
    )


@given(st.lists(values, min_size=1, max_size=60))
def test_median_interval_matches_ranks(numbers: list[float]) -> None:
    low, high = median_interval(numbers)
    assert low <= median(numbers) <= high
    size = len(numbers)
    # The highest rank below which the median lies with a probability of at most 2.5 %.
    rank = sum(binom.cdf(k, size, 0.5) <= 0.025 for k in range(size))
    ordered = sorted(numbers)
    assert low == (ordered[rank - 1] if rank else -INF)
    assert high == (ordered[size - rank] if rank else INF)


def test_median_interval_with_infinities() -> None:
    assert median_interval([-INF] * 10) == (-INF, -INF)
    assert median_interval([0.0] * 8 + [INF] * 8) == (0.0, INF)
    assert median_interval([]) == (-INF, INF)


@pytest.mark.slow
def test_bootstrap_coverage() -> None:
    generator = np.random.default_rng(1)
    samples = generator.normal(size=(200, 30))
    ends = [bootstrap(sample) for sample in samples]
    assert ends[0] == bootstrap(samples[0])
    covered = sum(low <= 0.0 <= high for low, high in ends)
    assert 0.90 <= covered / 200 <= 0.98


def test_bootstrap_of_equal_or_few_values() -> None:
    assert bootstrap([0.1] * 7) == (0.1, 0.1)
    assert bootstrap([]) == bootstrap([2.0]) == (-INF, INF)
    assert bootstrap([0.0, 0.0, 0.0, 0.0, 1.0])[0] == 0.0
    assert bootstrap([1.0, 2.0]) == (1.0, 2.0)


@pytest.mark.parametrize("value", [INF, -INF])
def test_bootstrap_errors(value: float) -> None:
    with pytest.raises(InputError) as refused:
        bootstrap([1.0, value])
    assert str(refused.value) == (
        "expected finite values for a mean, got an infinite value; use median_interval for "
        "infinities"
    )


@given(st.lists(st.tuples(values, values)))
def test_differences_are_antisymmetric(
    pairs: list[tuple[float, float]],
) -> None:
    first, second = [a for a, _ in pairs], [b for _, b in pairs]
    with np.errstate(over="ignore"):  # the largest floats differ by more than any float
        found = differences(first, second)
        assert not np.isnan(found).any()
        assert (found == -differences(second, first)).all()
    for (a, b), gap in zip(pairs, found, strict=True):
        assert math.copysign(1, gap) == (b > a) - (b < a) if a != b else gap == 0


def test_differences_of_unequal_lengths_error() -> None:
    with pytest.raises(InputError) as refused:
        differences([1.0], [])
    assert str(refused.value) == "expected as many values in both, got 1 and 0"
