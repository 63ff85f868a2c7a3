"""The best evaluation of a training, and the test of a target."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from evaluations import FAILED, evaluation_of

from rtamt import InputError
from rtamt_gym import evaluate_policy
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.sequential import RatioTest
from rtamt_gym.learners.best import MOST, Best, Target
from rtamt_gym.learners.metrics import evaluation_metrics, successes
from rtamt_gym.results.intervals import clopper_pearson

SPECS = {"near": "always(abs(x) < 0.12)", "upright": "always(abs(theta) < 0.1)"}
SIGNALS = {"x": "obs[0]", "theta": "obs[2]"}


def cart() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1", max_episode_steps=30)


def leaning(weight: float) -> Any:  # noqa: ANN401
    return lambda obs: int(obs[2] + weight * obs[3] > 0)


def evaluation(policy: Any, bound: float = 0.12, **more: Any) -> Evaluation:  # noqa: ANN401
    specs = {**SPECS, "near": f"always(abs(x) < {bound})"}
    return evaluate_policy(policy, cart, specs, SIGNALS, episodes=12, seed=50, keep=0, **more)


def by_hand(policy: Any) -> list[tuple[bool, bool, int, float, float]]:  # noqa: ANN401
    """Return near, upright, length, first time not near and its margin of each episode."""
    result = []
    env = cart()
    for seed in range(50, 62):
        obs, _ = env.reset(seed=seed)
        rows, ended = [obs], False
        while not ended:
            obs, _, terminated, truncated, _ = env.step(policy(obs))
            rows.append(obs)
            ended = terminated or truncated
        margins = 0.12 - np.abs(np.array(rows, float)[:, 0])
        upright = bool((np.abs(np.array(rows, float)[:, 2]) < 0.1).all())
        first = float(np.argmax(margins <= 0)) * 0.02
        result.append((bool(margins.min() > 0), upright, len(rows) - 1, first, margins.min()))
    return result


def test_evaluation_metrics() -> None:
    made = evaluation(leaning(0.0))
    result, episodes = evaluation_metrics(made), by_hand(leaning(0.0))
    both = [near and upright for near, upright, *_ in episodes]
    assert successes(made) == both
    assert 0 < sum(both) < 12
    assert result["rate"] == sum(both) / 12
    assert (result["low"], result["high"]) == clopper_pearson(sum(both), 12)
    assert result["return"] == np.mean([length for *_, length, _, _ in episodes])
    near = [episode[0] for episode in episodes]
    assert result["near/rate"] == sum(near) / 12
    assert (result["near/low"], result["near/high"]) == clopper_pearson(sum(near), 12)
    heights = sorted(episode[4] for episode in episodes)
    assert result["near/robustness_p5"] == heights[0]
    assert result["near/robustness_median"] == heights[5]
    assert result["near/robustness_p95"] == heights[11]
    times = sorted(episode[3] for episode in episodes if not episode[0])
    assert result["near/first_violation"] == pytest.approx(times[(len(times) - 1) // 2])


def test_infinite_quantiles_are_left_out() -> None:
    result = evaluation_metrics(evaluation(leaning(0.3), semantics="boolean"))
    assert not [key for key in result if "robustness" in key]
    assert all(np.isfinite(value) for value in result.values())


def test_best_by_success_then_return() -> None:
    good, bad = leaning(0.3), leaning(-0.3)
    some, none = evaluation(good), evaluation(bad, bound=0.001)
    tie = evaluation(good, bound=0.001)  # as few successes, and longer episodes
    assert [item.success.satisfied > 0 for item in (some, none, tie)] == [True, False, False]
    assert none.returns.mean() < tie.returns.mean()
    best = Best()
    assert [best.add(item) for item in (none, tie, none, tie, some, tie, some)] == [
        *(True, True, False, False, True, False, False)
    ]
    assert best.evaluation is some


def test_failed_episodes_have_no_return() -> None:
    whole = evaluation_of({"near": [-1.0, FAILED, -1.0]}, rewards=[10.0, 0.0, 10.0])
    part = evaluation_of({"near": [-1.0, FAILED, -1.0]}, rewards=[9.0, 500.0, 9.0])
    assert evaluation_metrics(whole)["return"] == 10.0
    assert np.isnan(part.returns).tolist() == [False, True, False]
    best = Best()
    assert [best.add(part), best.add(whole), best.add(part)] == [True, True, False]
    assert "return" not in evaluation_metrics(evaluation_of({"near": [FAILED]}, rewards=[3.0]))


TRAININGS, TESTS = 400, 20


def share_that_stops(rate: float, alpha: float) -> float:
    """Return the share of trainings that stop, each with a number of tested policies.

    The worst case tests every policy, for any result of the evaluation before.
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
