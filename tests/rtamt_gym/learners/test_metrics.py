"""The metrics of training against counts by hand, and many environments against one."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from rtamt import InputError, InputTypeError
from rtamt_gym import StlMonitor, VectorStlMonitor
from rtamt_gym.learners.metrics import Satisfaction, ended_episodes, metrics_of

SPECS = {"near": "always(abs(x) < 0.12)", "upright": "always(abs(theta) < 0.1)"}
SIGNALS = {"x": "obs[0]", "theta": "obs[2]"}

NAMES = ("near", "far")
VERDICTS = ("SATISFIED", "VIOLATED", "UNDECIDED")


@st.composite
def outcomes(draw: st.DrawFn) -> dict[str, Any]:
    verdict = draw(st.sampled_from(VERDICTS))
    found: dict[str, Any] = {"verdict": verdict, "satisfied": verdict == "SATISFIED"}
    found["robustness"] = np.float64(draw(st.floats(allow_nan=False)))
    if verdict != "UNDECIDED":
        key = draw(st.sampled_from(["decided_at", "ended_at"]))
        found[key] = draw(st.integers(0, 99))
    if draw(st.booleans()):
        found["progress"] = draw(st.floats(0, 1))
    return found


episodes = st.fixed_dictionaries({name: outcomes() for name in NAMES})


def least(values: list[float], share: float) -> float:
    """Return the smallest value that at least this share of the values does not exceed."""
    return min(v for v in values if sum(w <= v for w in values) >= share * len(values))


def interval(prefix: str, count: int, number: int) -> dict[str, float]:
    """Return the exact interval of a share, by the distribution of SciPy."""
    found = binomtest(count, number).proportion_ci(0.95, "exact")
    return {f"{prefix}satisfied_low": found.low, f"{prefix}satisfied_high": found.high}


def by_hand(found: list[dict[str, Any]], period: float) -> dict[str, float]:
    """Return the metrics, one list at a time."""
    number = len(found)
    good = [each for each in found if each["near"]["satisfied"] and each["far"]["satisfied"]]
    metrics = {"satisfied": len(good) / number, **interval("", len(good), number)}
    for name in NAMES:
        for verdict in VERDICTS:
            these = [each for each in found if each[name]["verdict"] == verdict]
            metrics[f"{name}/{verdict.lower()}"] = len(these) / number
        held = sum(each[name]["verdict"] == "SATISFIED" for each in found)
        metrics |= interval(f"{name}/", held, number)
        made = [each[name]["progress"] for each in found if "progress" in each[name]]
        if made:
            metrics[f"{name}/progress"] = sum(made) / len(made)
        heights = [float(each[name]["robustness"]) for each in found]
        for end, share in (("p5", 0.05), ("median", 0.5), ("p95", 0.95)):
            if not math.isinf(least(heights, share)):
                metrics[f"{name}/robustness_{end}"] = least(heights, share)
        times = [
            sum(each[name].get(key, 0) for key in ("decided_at", "ended_at")) * period
            for each in found
            if each[name]["verdict"] == "VIOLATED"
        ]
        if times:
            metrics[f"{name}/first_violation"] = least(times, 0.5)
    return metrics


@given(
    st.lists(episodes, min_size=1, max_size=30), st.integers(1, 12), st.sampled_from([0.02, 1.0])
)
def test_the_metrics_are_those_of_a_count_by_hand(
    found: list[dict[str, Any]], window: int, period: float
) -> None:
    assert metrics_of(found, period) == pytest.approx(by_hand(found, period))
    training = Satisfaction(window, period)
    for number, episode in enumerate(found, 1):
        training.add(episode)
        violations = {
            f"{name}/violations": sum(
                each[name]["verdict"] == "VIOLATED" for each in found[:number]
            )
            for name in NAMES
        }
        newest = found[max(0, number - window) : number]
        counted = {"episodes": number, **by_hand(newest, period), **violations}
        assert training.metrics() == pytest.approx(counted)


def test_no_episodes_have_no_metrics() -> None:
    assert metrics_of([]) == {}
    assert Satisfaction().metrics() == {"episodes": 0}


def test_times_without_a_period_are_samples() -> None:
    found = {"verdict": "VIOLATED", "satisfied": False, "robustness": -1.0, "decided_at": 7}
    assert metrics_of([{"near": found}])["near/first_violation"] == 7


def test_changed_requirements_error() -> None:
    found = {"verdict": "UNDECIDED", "satisfied": False, "robustness": 1.0}
    training = Satisfaction()
    training.add({"near": found})
    with pytest.raises(InputError) as caught:
        training.add({"near": found, "far": found})
    assert str(caught.value) == (
        "expected the requirements of the episodes before, 'near', got 'near', 'far'; give all "
        "environments the same"
    )
    assert training.metrics()["episodes"] == 1


def test_a_window_is_a_whole_number_above_0() -> None:
    with pytest.raises(InputError, match=r"^expected window= as 1 or more, got 0$"):
        Satisfaction(0)
    with pytest.raises(InputTypeError, match=r"^expected window= as a whole number, got 2\.5$"):
        Satisfaction(2.5)  # type: ignore[arg-type]


def wrapped(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    return StlMonitor(env, SPECS, SIGNALS, on_violation="report")


def cart() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1", max_episode_steps=20)


def each_alone(seed: int, actions: list[Any], num: int) -> list[dict[str, Any]]:
    """Return the outcomes of last infos in the order of their ends, for each environment alone."""
    found = []
    for i in range(num):
        env = wrapped(cart())
        env.reset(seed=seed + i)
        for at, action in enumerate(actions):
            *_, terminated, truncated, info = env.step(action[i])
            if terminated or truncated:
                found.append((at, i, info["stl_episode"]))
                env.reset()
    return [outcome for _, _, outcome in sorted(found, key=lambda each: each[:2])]


@pytest.mark.parametrize("outside", [False, True], ids=["each wrapped", "wrapped together"])
def test_vector_episodes_equal_single_ones(*, outside: bool) -> None:
    make = cart if outside else lambda: wrapped(cart())
    envs: Any = SyncVectorEnv([make] * 3, autoreset_mode=AutoresetMode.SAME_STEP)
    if outside:
        envs = VectorStlMonitor(envs, SPECS, SIGNALS)
    rng = np.random.default_rng(1)
    actions = [rng.integers(2, size=3) for _ in range(120)]
    envs.reset(seed=4)
    found = []
    for action in actions:
        *_, terminated, truncated, infos = envs.step(action)
        found += ended_episodes(infos, terminated | truncated)
    envs.close()
    expected = each_alone(4, actions, 3)
    assert found == expected
    assert metrics_of(found, 0.02) == metrics_of(expected, 0.02)
    shares = metrics_of(found)
    assert min(shares[f"{name}/{what}"] for name in SPECS for what in ("satisfied", "violated")) > 0


def test_reset_step_has_no_episode() -> None:
    envs = SyncVectorEnv([lambda: wrapped(cart())] * 2)
    envs.reset(seed=2)
    envs.action_space.seed(2)
    ends = 0
    for _ in range(100):
        *_, terminated, truncated, infos = envs.step(envs.action_space.sample())
        ended = terminated | truncated
        found = ended_episodes(infos, ended)
        assert len(found) == ended.sum()
        ends += len(found)
    envs.close()
    assert ends > 5


def test_infos_without_outcomes_error() -> None:
    infos = {"final_info": {"reward": np.zeros(2), "_reward": np.ones(2, bool)}}
    assert ended_episodes(infos, [False, False]) == []
    with pytest.raises(InputError) as caught:
        ended_episodes(infos, [False, True])
    assert str(caught.value) == (
        "expected 'stl_episode' in the last info of an episode, which StlMonitor and StlReward "
        "add, got the keys 'reward'; wrap the environment in a monitor, and place time limits "
        "inside it"
    )
