"""A bonus at the certain satisfaction and a penalty at the certain violation, in every mode."""

from __future__ import annotations

import functools
import pickle
from copy import deepcopy
from typing import Any, get_args

import gymnasium as gym
import numpy as np
import pytest
from environments import equal
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from hypothesis import given
from hypothesis import strategies as st
from replay import Replay, X, shaping_options
from vector_environments import MODES, Make, both, difference, trajectory

from rtamt_gym import StlReward, VectorStlReward
from rtamt_gym.shaping import Mode, outcome, settle

pytestmark = [
    pytest.mark.filterwarnings("ignore:clip=.* flattens the values of")  # it is narrow here
]

SPECS = {"dry": "always(x > 1)", "there": "eventually[0:4](x > 5)"}
SHAPES: tuple[Mode, ...] = get_args(Mode)
OPTIONS: dict[str, Any] = {"period": 1, "on_violation": "report", "at_termination": "complete"}


def shaped(env: gym.Env[Any, Any], mode: Mode, **options: Any) -> StlReward[Any, Any]:
    given = {**shaping_options(mode, *SPECS), **OPTIONS, **options}
    return StlReward(env, SPECS, X, **given)


def steps_of(env: gym.Env[Any, Any]) -> list[tuple[float, dict[str, Any]]]:
    """Return the rewards and infos of an episode."""
    env.reset(seed=1)
    result = []
    ended = False
    while not ended:
        _, reward, terminated, truncated, info = env.step(np.array([0.5]))
        result.append((float(reward), info))
        ended = terminated or truncated
    return result


@given(
    mode=st.sampled_from(SHAPES),
    series=st.lists(st.sampled_from([0.5, 1.5, 3.0, 6.0]), min_size=2, max_size=9),
    end=st.sampled_from(["terminated", "truncated"]),
    reading=st.sampled_from(["complete", "cut", "failure"]),
)
def test_each_is_paid_once_at_the_step_that_decides(
    mode: Mode, series: list[float], end: str, reading: str
) -> None:
    options = {"at_termination": reading, "details": True}
    alone = mode == "verdict"
    plain = steps_of(shaped(Replay(series, end), "replace" if alone else mode, **options))
    paid = steps_of(shaped(Replay(series, end), mode, bonus=7.0, penalty=3.0, **options))
    extra = [
        with_both - (0.0 if alone else without)
        for (with_both, _), (without, _) in zip(paid, plain, strict=True)
    ]
    expected = []
    open_still = True
    for _, info in plain:
        verdicts = [item["verdict"] for item in info["stl"].values()]
        won, lost = set(verdicts) == {"SATISFIED"}, "VIOLATED" in verdicts
        expected.append((7.0 * won - 3.0 * lost) if open_still else 0.0)
        open_still = open_still and not (won or lost)
    assert extra == pytest.approx(expected)
    last = plain[-1][1]
    assert sum(extra) == pytest.approx(7.0 * last["is_success"] - 3.0 * last["stl_violated"])


def test_weight_of_zero_adds_bonus_and_penalty_to_the_reward_alone() -> None:
    series = [3.0, 3.0, 9.0, 3.0, 3.0, 3.0]
    for mode in ("add", "terminal", "progress", "potential"):
        env = shaped(Replay(series), mode, weight=0, bonus=7.0, clip=1e-3)
        assert [reward for reward, _ in steps_of(env)] == [1.0, 2.0, 3.0, 4.0, 5.0 + 7.0]
    env = shaped(Replay([3.0, 0.0, 3.0]), "add", weight=0.0, penalty=3.0)
    assert [reward for reward, _ in steps_of(env)] == [1.0 - 3.0, 2.0]


@pytest.mark.filterwarnings("error")
def test_rewards_without_robustness_do_not_warn_of_the_clip() -> None:
    given: Any
    for given in ({"mode": "verdict", "bonus": 1.0}, {"mode": "add", "weight": 0}):
        env = StlReward(Replay([99.0] * 3), "always(x > 0)", X, **given, **OPTIONS)
        for _ in range(12):
            steps_of(env)


def test_what_the_reset_decides_is_paid_at_the_first_step() -> None:
    env = StlReward(
        Replay([9.0, 1.0, 1.0]), "eventually(x > 5)", X, mode="replace", bonus=4.0, penalty=2.0
    )
    assert [reward for reward, _ in steps_of(env)] == [5.0, 1.0]
    env = shaped(Replay([0.0, 1.5, 9.0]), "replace", bonus=4.0, penalty=2.0)
    for _ in range(2):
        assert [reward for reward, _ in steps_of(env)] == [-3.0, -1.0]


@given(
    series=st.lists(st.floats(-9.0, 9.0), min_size=2, max_size=9),
    end=st.sampled_from(["terminated", "truncated"]),
    reading=st.sampled_from(["complete", "cut", "failure"]),
    on_violation=st.sampled_from(["report", "terminate", "truncate"]),
)
def test_progress_sums_to_what_the_bounds_have_gained(
    series: list[float], end: str, reading: str, on_violation: str
) -> None:
    options = {"details": True, "at_termination": reading, "on_violation": on_violation}
    env = StlReward(
        Replay(series, end), SPECS, X, mode="progress", weight=3.0, clip=2.0, **OPTIONS | options
    )
    _, info = env.reset(seed=1)

    def middle(info: dict[str, Any]) -> float:
        bounds = [min(item[key] for item in info["stl"].values()) for key in ("lower", "upper")]
        return float(sum(np.clip(bounds, -2.0, 2.0))) / 2

    first, steps = middle(info), steps_of(env)
    gained = sum(reward - info["reward"] for reward, info in steps)
    last = steps[-1][1]
    assert gained == pytest.approx(3.0 * (middle(last) - first))
    if last["stl_success"]:  # both bounds have the sign of the verdict
        assert middle(last) >= 0.0
    elif last["stl_violated"]:
        assert middle(last) <= 0.0


@given(st.floats(allow_nan=False), st.floats(allow_nan=False), st.floats(0, 9), st.floats(0, 9))
def test_outcomes_of_arrays_are_those_of_floats(
    lower: float, upper: float, bonus: float, penalty: float
) -> None:
    low, high = sorted((lower, upper))
    one = outcome(low, high)
    many = outcome(np.array([low, low]), np.array([high, high]))
    assert many.tolist() == [one, one]
    assert (
        settle(np.zeros(2), many, bonus, penalty).tolist() == [settle(0.0, one, bonus, penalty)] * 2
    )


@pytest.mark.slow(keep=12)
@pytest.mark.parametrize("autoreset", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("end", ["terminated", "truncated"])
@pytest.mark.parametrize("mode", SHAPES)
def test_many_environments_pay_what_each_does(
    mode: Mode, end: str, autoreset: AutoresetMode
) -> None:
    makes: list[Make] = [
        functools.partial(Replay, series, end)
        for series in ([2.0, 6.0, 3.0], [2.0, 3.0, 0.0, 6.0], [9.0, 2.0, 2.0, 2.0, 2.0, 2.0])
    ]
    options: Any = {**shaping_options(mode, *SPECS), **OPTIONS, "bonus": 5.0, "penalty": 4.0}
    options |= {"observe": "obligations"}
    together, singles = both(StlReward, VectorStlReward, makes, autoreset, SPECS, X, **options)
    assert difference(trajectory(together, 16), trajectory(singles, 16)) == ""


@pytest.mark.parametrize("clone", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_remembers_what_was_paid(clone: Any) -> None:
    env = shaped(Replay([2.0, 0.0, 2.0, 6.0, 2.0]), "add", penalty=9.0)
    env.reset()
    env.step(np.array([0.5]))
    copy = clone(env)
    for _ in range(3):
        assert equal(copy.step(np.array([0.5])), env.step(np.array([0.5])))


def test_the_arguments_are_recorded() -> None:
    env = StlReward(
        gym.make("CartPole-v1"), "always(a < 1)", {"a": "obs[2]"}, mode="add", bonus=2, penalty=0.5
    )
    assert env.spec is not None
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert isinstance(again, StlReward)
    assert (again._shaping.bonus, again._shaping.penalty) == (2.0, 0.5)
