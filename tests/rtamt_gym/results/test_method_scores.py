"""Statistics of methods over training seeds: against their definitions, run by run."""

from __future__ import annotations

import itertools
import statistics
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from rtamt_gym.results.method_scores import (
    improvement,
    interquartile_mean,
    mean,
    permutation_p,
    profile,
    stratified_bootstrap,
)

SCORE = st.integers(0, 8).map(lambda eighths: eighths / 8)  # sums are exact


def matrices(tasks: int) -> st.SearchStrategy[np.ndarray]:
    row = st.lists(SCORE, min_size=tasks, max_size=tasks)
    return st.lists(row, min_size=1, max_size=9).map(np.array)


SCORES = st.integers(1, 3).flatmap(matrices)
PAIRS = st.integers(1, 3).flatmap(lambda tasks: st.tuples(matrices(tasks), matrices(tasks)))


@given(SCORES)
def test_means_match_definition(scores: np.ndarray) -> None:
    by_task = [statistics.fmean(column) for column in scores.T.tolist()]
    assert mean(scores) == pytest.approx(statistics.fmean(by_task))
    ordered = sorted(scores.ravel().tolist())
    cut = int(0.25 * len(ordered))
    assert interquartile_mean(scores) == pytest.approx(
        statistics.fmean(ordered[cut : len(ordered) - cut])
    )
    assert interquartile_mean(scores) == pytest.approx(stats.trim_mean(scores.ravel(), 0.25))


@given(SCORES, st.lists(SCORE, min_size=1, max_size=4))
def test_profile_counts_scores_above(scores: np.ndarray, thresholds: list[float]) -> None:
    every = scores.ravel().tolist()
    expected = [sum(score > least for score in every) / len(every) for least in thresholds]
    assert profile(scores, np.array(thresholds)) == pytest.approx(expected)


@given(PAIRS)
def test_improvement_counts_pairs(pair: tuple[np.ndarray, np.ndarray]) -> None:
    ours, theirs = pair
    by_task = []
    for mine, other in zip(ours.T.tolist(), theirs.T.tolist(), strict=True):
        won = [Fraction(a > b) + Fraction(a == b) / 2 for a in mine for b in other]
        by_task.append(float(sum(won) / len(won)))
    assert improvement(ours, theirs) == pytest.approx(statistics.fmean(by_task))
    assert improvement(ours, theirs) + improvement(theirs, ours) == pytest.approx(1.0)


@given(PAIRS, st.integers(0, 99))
def test_statistics_of_resamples(pair: tuple[np.ndarray, np.ndarray], seed: int) -> None:
    rng = np.random.default_rng(seed)
    ours, theirs = (
        np.stack([each[rng.integers(len(each), size=len(each))] for _ in range(3)]) for each in pair
    )
    levels = np.array([0.0, 0.5])
    for k in range(3):
        assert mean(ours)[k] == pytest.approx(mean(ours[k]))
        assert interquartile_mean(ours)[k] == pytest.approx(interquartile_mean(ours[k]))
        assert profile(ours, levels)[k] == pytest.approx(profile(ours[k], levels))
        assert improvement(ours, theirs)[k] == pytest.approx(improvement(ours[k], theirs[k]))


def test_bootstrap_draws_tasks_independently() -> None:
    scores = np.array([[0.0, 0.0], [1.0, 1.0]])
    drawn: list[np.ndarray] = []

    def kept(resamples: np.ndarray) -> np.ndarray:
        drawn.append(resamples)
        return np.asarray(mean(resamples))

    low, high = stratified_bootstrap([scores], kept, resamples=4000)
    (found,) = drawn
    assert found.shape == (4000, 2, 2)
    sums = found.sum(axis=1)  # 0, 1 or 2 of each task
    for first, second in itertools.product((0, 1, 2), repeat=2):
        chance = {0: 0.25, 1: 0.5, 2: 0.25}
        share = ((sums[:, 0] == first) & (sums[:, 1] == second)).mean()
        assert share == pytest.approx(chance[first] * chance[second], abs=0.03)
    assert (low, high) == tuple(np.percentile(mean(found), [2.5, 97.5]))


@pytest.mark.parametrize("options", [{}, {"resamples": 1}, {"resamples": 7}])
def test_number_of_resamples(options: dict[str, int]) -> None:
    drawn: list[int] = []

    def kept(resamples: np.ndarray) -> np.ndarray:
        drawn.append(len(resamples))
        return np.asarray(mean(resamples))

    stratified_bootstrap([np.ones((3, 2))], kept, **options)
    assert sum(drawn) == options.get("resamples", 10_000)


def test_stratified_bootstrap_coverage() -> None:
    rng = np.random.default_rng(5)
    covered = 0
    for seed in range(200):
        scores = rng.beta(4.0, 1.0, (25, 2))
        low, high = stratified_bootstrap([scores], mean, resamples=400, seed=seed)
        covered += low <= 0.8 <= high
    assert 0.88 <= covered / 200 <= 0.99


@given(
    st.lists(SCORE, min_size=1, max_size=5).map(lambda runs: np.array(runs)[:, None]),
    st.lists(SCORE, min_size=1, max_size=5).map(lambda runs: np.array(runs)[:, None]),
)
def test_permutation_test_counts_splits(ours: np.ndarray, theirs: np.ndarray) -> None:
    both = [Fraction(score) for score in (*ours[:, 0], *theirs[:, 0])]
    n, m = len(ours), len(theirs)

    def gap(chosen: tuple[int, ...]) -> Fraction:
        first = sum((both[k] for k in chosen), Fraction())
        return abs(first / n - (sum(both) - first) / m)

    splits = list(itertools.combinations(range(n + m), n))
    far = sum(gap(each) >= gap(tuple(range(n))) for each in splits)
    assert permutation_p(ours, theirs) == pytest.approx(far / len(splits))


def test_permutation_test_draws_many_splits() -> None:
    rng = np.random.default_rng(3)
    ours, theirs = rng.normal(0.5, 1.0, (15, 1)), rng.normal(0.0, 1.0, (15, 1))
    expected = stats.permutation_test(
        (ours[:, 0], theirs[:, 0]),
        lambda a, b, axis: a.mean(axis=axis) - b.mean(axis=axis),
        vectorized=True,
        n_resamples=50_000,
        random_state=np.random.default_rng(0),
    )
    assert permutation_p(ours, theirs) == pytest.approx(expected.pvalue, abs=0.01)
    assert permutation_p(ours + 100.0, theirs) == 1e-05
    two = np.concatenate([ours, theirs - 0.5], axis=1)
    other = np.concatenate([theirs, ours - 0.5], axis=1)
    assert permutation_p(two, other) == 1.0  # the tasks cancel each other
    nothing = np.zeros((15, 1))
    assert permutation_p(nothing, nothing) == 1.0  # all permutations have the distance 0
