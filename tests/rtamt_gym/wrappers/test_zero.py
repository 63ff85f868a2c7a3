"""Robustness 0: its sign shows whether the formula holds, in infos, costs, records and rewards."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from replay import Replay, X, run, shaping_options
from vector_environments import both, difference, trajectory

import rtamt
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward
from rtamt_gym.judging.costs import Cost
from rtamt_gym.options.evaluation import View
from rtamt_gym.shaping import hierarchical, least


def bits(value: float) -> tuple[float, bool]:
    """A number and its sign bit, which comparisons do not see at 0."""
    return value, math.copysign(1.0, value) < 0.0


HOLDS, FAILS = (0.0, False), (-0.0, True)


def test_a_mode_that_is_kept_holds_with_robustness_0() -> None:
    *running, last = run(StlMonitor(Replay([1, 1, 1]), "always(x == 1)", X, details=True))
    for info in running:
        assert bits(info["robustness"]) == bits(info["stl_upper"]) == HOLDS
        assert info["stl_violated"] is False
        assert info["stl"]["spec"]["verdict"] == "UNDECIDED"
    assert bits(last["stl_lower"]) == bits(last["stl_upper"]) == HOLDS
    assert last["stl_episode"] == {
        "spec": {"robustness": 0.0, "verdict": "SATISFIED", "satisfied": True, "ended_at": 2}
    }
    assert last["is_success"] is True
    assert "stl_violated_by" not in last


def test_a_strict_bound_that_is_reached_is_violated_with_robustness_0() -> None:
    env = StlMonitor(Replay([1, 0, 5]), "always(x > 0)", X)
    *running, last = run(env)
    assert [info["stl_violated"] for info in running] == [False]
    assert bits(last["robustness"]) == bits(last["stl_upper"]) == FAILS
    assert last["stl_violated"] is True
    assert (last["stl_violated_by"], last["stl_violated_at"]) == ("spec", 1)
    assert last["is_success"] is False
    (record,) = env.stl_episodes
    assert (record["violated_by"], record["violated_at"]) == ("spec", 1)
    assert record["specs"]["spec"]["verdict"] == "VIOLATED"


def test_a_goal_that_is_just_reached_is_satisfied() -> None:
    infos = run(StlMonitor(Replay([-1, 0, -1]), "eventually(x >= 0)", X, details=True))
    assert [info["stl"]["spec"]["verdict"] for info in infos] == [
        *("UNDECIDED", "SATISFIED", "SATISFIED")
    ]
    assert bits(infos[1]["stl_lower"]) == HOLDS


@pytest.mark.parametrize("order", [("kept", "above"), ("above", "kept")])
@pytest.mark.parametrize(("values", "expected"), [([1, 1, 1], HOLDS), ([1, 0, 0], FAILS)])
def test_the_least_of_two_zeros_is_the_one_that_fails(
    order: tuple[str, str], values: list[float], expected: tuple[float, bool]
) -> None:
    texts = {"kept": "always(x * 0 == 0)", "above": "always(x > 0 or x >= 1)"}
    specs = {name: texts[name] for name in order}
    info = run(StlMonitor(Replay(values), specs, X, on_violation="report"))[-1]
    assert bits(info["robustness"]) == expected
    assert bits(info["stl_upper"]) == expected
    assert info["stl_violated"] is expected[1]


@pytest.mark.parametrize(
    ("cost", "expected"),
    [("latched", [0.0, 1.0, 1.0]), ("first", [0.0, 1.0, 0.0]), ("depth", [0.0, 0.0, 0.0])],
)
def test_a_violation_by_no_margin_is_charged(cost: Cost, expected: list[float]) -> None:
    env = StlMonitor(Replay([1, 1, 0, 1]), "always(x > 0)", X, cost=cost, on_violation="report")
    assert [info["cost"] for info in run(env)[1:]] == expected


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("cost", ["latched", "depth", "first"])
@pytest.mark.parametrize("view", ["episode", "step"])
def test_many_environments_say_what_one_says_of_zeros(
    mode: AutoresetMode, cost: Cost, view: View
) -> None:
    rng = np.random.default_rng(5)
    traces = rng.integers(-1, 2, (6, 5)).astype(np.float64)
    bare = {
        "kept": "x == 1 or x != 1",
        "above": "x > 0 or x > -1",
        "soon": "eventually[0:2](x >= 0)",
    }
    texts = bare if view == "step" else {name: f"always({text})" for name, text in bare.items()}
    options: Any = {"period": 1, "cost": cost, "view": view, "details": True}
    makes = [functools.partial(Replay, row.tolist()) for row in traces]
    envs = both(
        StlMonitor, VectorStlMonitor, makes, mode, texts, X, on_violation="report", **options
    )
    shown = [trajectory(item, 9) for item in envs]
    assert difference(shown[0], shown[1]) == ""
    zeros = 0
    for first, second in zip(*shown, strict=True):
        for key in ("robustness", "stl_lower", "stl_upper"):
            assert np.array_equal(np.signbit(first[-1][key]), np.signbit(second[-1][key])), key
        zeros += int(np.count_nonzero(first[-1]["robustness"] == 0.0))
    assert zeros > 10


def test_rewards_rank_a_level_that_fails_by_no_margin_as_violated() -> None:
    specs = {"safe": "always(x > 0)", "calm": "always(x < 9)"}
    options: Any = {
        "clip": 10.0,
        "on_violation": "report",
        **shaping_options("hierarchical", *specs),
    }
    env = StlReward(Replay([1, 0.5, 0]), specs, X, **options)
    many = VectorStlReward(SyncVectorEnv([lambda: Replay([1, 0.5, 0])] * 2), specs, X, **options)
    env.reset(seed=1)
    many.reset(seed=1)
    action = np.zeros(1)
    rewards = [env.step(action)[1] for _ in range(2)]
    assert rewards == [10.0 + 8.0, 0.0]
    assert [many.step(np.zeros((2, 1)))[1].tolist() for _ in range(2)] == [[r] * 2 for r in rewards]


@pytest.mark.parametrize("many", [False, True])
def test_combinations_keep_the_sign_of_a_zero(many: bool) -> None:  # noqa: FBT001
    def value(number: float) -> Any:
        return np.array([number]) if many else number

    def sign(number: Any) -> bool:
        return bool(np.signbit(number).all())

    for zeros in ([0.0, -0.0], [-0.0, 0.0], [1.0, -0.0], [-0.0, math.inf]):
        assert sign(least([value(z) for z in zeros]))
    for zeros in ([0.0, 0.0], [0.0, 1.0], [0.0]):
        assert not sign(least([value(z) for z in zeros]))
    assert sign(hierarchical([value(-0.0), value(1.0)], 1.0))
    assert hierarchical([value(-0.0), value(1.0)], 1.0) == 0.0
    assert hierarchical([value(0.0), value(-0.0), value(1.0)], 1.0) == 1.0
    assert hierarchical([value(0.0), value(0.0), value(0.5)], 1.0) == 2.5
    assert sign(hierarchical([value(-0.0)], 1.0))
    assert not sign(hierarchical([value(0.0)], 1.0))


def test_what_hangs_on_a_predicate_left_out_stays_undecided() -> None:
    for text in ("always(x > 9)", "always(not (x > 9))", "eventually(x > 9)"):
        options: Any = {"semantics": "output-vacuity", "outputs": [], "details": True}
        env = StlMonitor(Replay([1, 0, 5]), text, X, **options)
        infos = run(env)
        assert not any(info["stl_violated"] for info in infos)
        assert {info["stl"]["spec"]["verdict"] for info in infos} == {"UNDECIDED"}
        assert (infos[-1]["is_success"], infos[-1]["stl_undecided"]) == (False, True)
    monitor = rtamt.EpisodeMonitor("always(x > 9)", semantics="output-vacuity", outputs=())
    monitor.update(1.0)
    assert (bits(monitor.lower), bits(monitor.upper)) == (FAILS, HOLDS)
