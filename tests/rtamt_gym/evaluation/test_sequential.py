"""Sequential stopping: exact error rates and lengths, by dynamic programming over its walk."""

import math
from collections import defaultdict
from collections.abc import Callable
from copy import copy
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import beta

from rtamt import InputError
from rtamt_gym.evaluation.sequential import RatioTest, Stopping, Width, stopping_of
from rtamt_gym.results.intervals import IntervalKind

Floats = NDArray[np.float64]
Stop = tuple[Width | RatioTest, Floats]


def stops(rule: Width | RatioTest, rates: Floats, most: int = 3000) -> list[Stop]:
    """Return every end of a rule with its probability at each rate, from all counts at once."""
    found: list[Stop] = []
    alive = {0: (rule, np.ones(len(rates)))}
    for _ in range(most):
        chances: dict[int, Floats] = defaultdict(lambda: np.zeros(len(rates)))
        rules = {}
        for count, (before, chance) in alive.items():
            for satisfied, step in ((True, rates), (False, 1 - rates)):
                after = copy(before)
                after.add(satisfied)
                rules[count + satisfied] = after
                chances[count + satisfied] += chance * step
        alive = {}
        for count, after in rules.items():
            if after.decision is None:
                alive[count] = after, chances[count]
            else:
                found.append((after, chances[count]))
        if not alive or max(chance.max() for _, chance in alive.values()) < 1e-12:
            return found
    raise AssertionError("the rule does not stop")


def mean(found: list[Stop], of: Callable[[Width | RatioTest], float]) -> Floats:
    total: Floats = np.sum([of(rule) * chance for rule, chance in found], axis=0)
    return total


TESTS = [(0.95, 0.05, 0.1), (0.9, 0.05, 0.1), (0.9, 0.01, 0.3), (0.5, 0.1, 0.2), (0.3, 0.2, 0.1)]


@pytest.mark.parametrize(("target", "alpha", "margin"), TESTS)
def test_both_errors_are_at_most_alpha(target: float, alpha: float, margin: float) -> None:
    found = stops(RatioTest(target, alpha, margin), np.array([target - margin, target]))
    met = mean(found, lambda rule: rule.decision == f"meets {target}")
    fell = mean(found, lambda rule: rule.decision == f"falls short of {target}")
    assert met + fell == pytest.approx(1.0)
    assert 0.0 < met[0] <= alpha
    assert 0.0 < fell[1] <= alpha
    # They are not smaller than necessary: the walk leaves its bounds by less than a step.
    assert met[0] > alpha / 2
    assert fell[1] > alpha / 2 * (1 - target) / (1 - target + margin)


@pytest.mark.parametrize(("target", "alpha", "margin"), TESTS)
def test_the_mean_number_of_episodes_is_that_of_wald(
    target: float, alpha: float, margin: float
) -> None:
    refused = target - margin
    gain, loss = math.log(target / refused), math.log((1 - target) / (1 - refused))
    rates = np.array([0.05, refused, target, 1.0])
    found = stops(RatioTest(target, alpha, margin), rates)
    length = mean(found, lambda rule: rule.episodes)
    drift = rates * gain + (1 - rates) * loss
    # His equation holds exactly for the walk at its end, beyond its bounds,
    reached = mean(found, lambda r: r.satisfied * gain + (r.episodes - r.satisfied) * loss)
    assert length * drift == pytest.approx(reached, rel=1e-6)
    # and so nearly for the bounds themselves, less than a step before.
    met = mean(found, lambda rule: rule.decision == f"meets {target}")
    bounds = -math.log(alpha) * (2 * met - 1)
    assert (abs(reached - bounds) <= max(gain, -loss)).all()
    assert (abs(length) >= abs(bounds / drift) * (1 - 1e-9)).all()


@given(
    st.integers(1, 99).filter(lambda percent: percent != 50),
    st.lists(st.booleans(), min_size=1, max_size=120),
    st.sampled_from([0.05, 0.2]),
)
def test_the_answer_is_that_of_exact_likelihoods(
    percent: int, outcomes: list[bool], alpha: float
) -> None:
    target, refused = Fraction(percent, 100), Fraction(percent, 200)
    rule = RatioTest(float(target), alpha, float(target - refused))
    expected, ratio = None, Fraction(1)
    for satisfied in outcomes:
        rule.add(satisfied)
        if expected is None:
            ratio *= target / refused if satisfied else (1 - target) / (1 - refused)
            if ratio >= 1 / Fraction(alpha):
                expected = f"meets {float(target):g}"
            elif ratio <= Fraction(alpha):
                expected = f"falls short of {float(target):g}"
        assert rule.decision == expected


def test_of_a_target_of_all_one_miss_decides() -> None:
    rule = RatioTest(1.0, alpha=0.05, margin=0.1)
    for _ in range(28):
        rule.add(satisfied=True)
    assert rule.decision is None
    met = copy(rule)
    met.add(satisfied=True)
    assert met.decision == "meets 1"
    assert 0.9**met.episodes <= 0.05 < 0.9**rule.episodes
    rule.add(satisfied=False)
    assert rule.decision == "falls short of 1"


def wilson_ends(count: int, total: int) -> tuple[float, float]:
    z = 1.959963984540054
    centre, half = count + z * z / 2, z * math.sqrt(count * (total - count) / total + z * z / 4)
    return (centre - half) / (total + z * z), (centre + half) / (total + z * z)


def exact_ends(count: int, total: int) -> tuple[float, float]:
    low = beta.ppf(0.025, count, total - count + 1) if count else 0.0
    return low, beta.ppf(0.975, count + 1, total - count) if count < total else 1.0


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(
    ("kind", "ends", "average", "least"),
    [("exact", exact_ends, 0.968, 0.942), ("wilson", wilson_ends, 0.954, 0.928)],
)
def test_an_interval_at_the_stop_covers_as_the_docstring_says(
    kind: IntervalKind,
    ends: Callable[[int, int], tuple[float, float]],
    average: float,
    least: float,
) -> None:
    rates = np.arange(1, 100) / 100
    found = stops(Width(0.2, kind=kind), rates)
    covered = np.zeros(len(rates))
    for rule, chance in found:
        assert isinstance(rule, Width)
        low, high = ends(rule.satisfied, rule.episodes)
        assert high - low <= 0.2 + 1e-9
        covered += chance * ((low <= rates) & (rates <= high))
    assert covered.mean() == pytest.approx(average, abs=0.001)
    assert covered.min() == pytest.approx(least, abs=0.001)


@pytest.mark.parametrize(("kind", "half", "every"), [("exact", 1574, 72), ("wilson", 1533, 73)])
def test_a_width_stops_no_later_than_it_must(kind: IntervalKind, half: int, every: int) -> None:
    rule, of_all = Width(0.05, kind=kind), Width(0.05, kind=kind)
    for number in range(half):
        assert rule.decision is None
        rule.add(satisfied=number % 2 == 0)
        assert (of_all.decision is None) == (number < every)
        of_all.add(satisfied=True)
    assert (rule.decision, rule.episodes) == ("known to 0.05", half)


@pytest.mark.parametrize("rule", [Width(0.5), RatioTest(0.5, 0.1, 0.2)])
def test_after_the_answer_nothing_changes(rule: Width | RatioTest) -> None:
    while rule.decision is None:
        rule.add(satisfied=True)
    before = dict(vars(rule))
    for _ in range(100):
        rule.add(satisfied=False)
    assert vars(rule) == before


def test_stopping_waits_for_all_and_each_keeps_its_first_answer() -> None:
    alone = RatioTest(0.9, margin=0.1)
    both = Stopping({"quick": RatioTest(0.9, margin=0.1), "slow": RatioTest(0.9, margin=0.01)})
    episodes = 0
    while not both.done:
        satisfied = episodes < 40
        if alone.decision is None:
            alone.add(satisfied)
        both.add({"quick": satisfied, "slow": satisfied})
        episodes += 1
        assert both.decisions["quick"] == (alone.decision or f"undecided after {episodes}")
    assert dict(both.decisions) == {"quick": "meets 0.9", "slow": "falls short of 0.9"}
    assert alone.episodes < 40 < both.episodes == episodes


def test_arguments_ask_for_one_kind_or_none() -> None:
    assert stopping_of(["a"]) is None
    width = stopping_of(["a", "b"], until_width=0.5)
    test = stopping_of(["a"], target=0.9, alpha=0.1, margin=0.2)
    assert width is not None
    assert test is not None
    for _ in range(13):
        width.add({"a": True, "b": False})
        test.add({"a": True})
    assert dict(width.decisions) == {"a": "known to 0.5", "b": "known to 0.5"}
    assert dict(test.decisions) == {"a": "meets 0.9"}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Width(0),
            "expected until_width= as a finite number above 0 and at most 1, got 0",
        ),
        (
            lambda: Width(1.5),
            "expected until_width= as a finite number above 0 and at most 1, got 1.5",
        ),
        (
            lambda: RatioTest(95),
            "expected target= as a finite number above 0 and at most 1, got 95",
        ),
        (lambda: RatioTest(0.9, 0.5), "expected alpha= above 0 and below 0.5, got 0.5"),
        (
            lambda: RatioTest(0.04),
            "expected margin= above 0 and below target=0.04, got 0.05",
        ),
        (
            lambda: RatioTest(0.9, margin=0),
            "expected margin= above 0 and below target=0.9, got 0",
        ),
        (
            lambda: stopping_of(["a"], 0.05, 0.9),
            "expected one rule, got until_width=0.05 and target=0.9; omit one",
        ),
    ],
)
def test_numbers_out_of_range_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError) as refused:
        make()
    assert str(refused.value) == message
