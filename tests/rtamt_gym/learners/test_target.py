"""Stopping a training: how often it is wrong, over all tests together."""

from __future__ import annotations

import numpy as np
import pytest

from rtamt import InputError
from rtamt_gym.evaluation.sequential import RatioTest
from rtamt_gym.learners.best import MOST, Target

TRAININGS, TESTS = 400, 20


def share_that_stops(rate: float, alpha: float) -> float:
    """The share of trainings that stop, in each of which so many policies are tested.

    That every policy is tested, whatever an evaluation has said before, is the worst case.
    """
    rng = np.random.default_rng(7)
    stopped = 0
    for _ in range(TRAININGS):
        target = Target(0.8, alpha, 0.1, seed=0)
        stopped += any(
            target.met_by(lambda _: (rng.random(20) < rate).tolist()) for _ in range(TESTS)
        )
    return stopped / TRAININGS


@pytest.mark.slow
def test_target_error_rate_is_below_alpha() -> None:
    assert share_that_stops(0.7, 0.2) <= 0.2
    # With each of them at the level alpha most trainings would stop.
    rng = np.random.default_rng(7)
    wrong = 0
    for _ in range(TRAININGS):
        tests = [RatioTest(0.8, 0.2, 0.1) for _ in range(TESTS)]
        for test in tests:
            while test.decision is None:
                test.add(bool(rng.random() < 0.7))
        wrong += any(test.decision == "meets 0.8" for test in tests)
    assert wrong / TRAININGS > 0.5


def test_a_policy_that_meets_the_target_passes_soon() -> None:
    assert share_that_stops(0.95, 0.05) == 1.0
    target = Target(0.8, 0.05, 0.1, seed=0)
    passed = target.met_by(lambda _: [True] * 20)
    assert passed is not None
    assert target.tests == 1


def test_target_seeds_and_levels() -> None:
    seeds = []

    def play(seed: int) -> list[bool]:
        seeds.append(seed)
        return [True] * 15

    target = Target(0.9, seed=300)
    lengths = []
    for number in range(1, 6):
        test = target.met_by(play)
        assert test is not None
        alone = RatioTest(0.9, 0.05 / (number * (number + 1)))
        while alone.decision is None:
            alone.add(satisfied=True)
        assert test.episodes == alone.episodes
        lengths.append(test.episodes)
    assert lengths == sorted(set(lengths))
    assert seeds == list(range(300, target.seed, 15))


def test_without_an_answer_a_policy_has_not_passed() -> None:
    target = Target(0.8, 0.001, 0.001, seed=0)
    assert target.met_by(lambda _: [True, True, True, True, False] * 10) is None
    assert target.seed == MOST


def test_target_argument_errors() -> None:
    with pytest.raises(InputError, match=r"^expected alpha= above 0 and below 0\.5, got 0\.7$"):
        Target(0.9, 0.7, seed=0)
