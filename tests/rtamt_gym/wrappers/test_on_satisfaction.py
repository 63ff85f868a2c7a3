"""`on_satisfaction`: the effect of a certain satisfaction of all specifications."""

from __future__ import annotations

import functools
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RecordEpisodeStatistics
from hypothesis import given
from hypothesis import strategies as st
from parallel_environments import Crew
from replay import Replay, X, run
from vector_environments import Make, both, difference, trajectory

from rtamt_gym import ParallelStlMonitor, StlMonitor, StlReward, VectorStlMonitor, VectorStlReward

SPECS = {"near": "always[0:2](x > 1)", "there": "eventually(x > 5)"}
SERIES = [2.0, 6.0, 2.0, 2.0, 0.0, 2.0]
OPTIONS: dict[str, Any] = {"period": 1, "at_termination": "complete"}


def monitored(series: list[float], end: str = "none", **options: Any) -> StlMonitor[Any, Any]:
    return StlMonitor(Replay(series, end), SPECS, X, **OPTIONS | options)


@pytest.mark.parametrize("how", ["terminate", "truncate"])
def test_the_episode_ends_at_the_sample_that_makes_it_certain(how: str) -> None:
    infos = run(monitored(SERIES, on_satisfaction=how))
    last = infos[-1]
    assert len(infos) == 3  # `near` is certain at sample 2
    assert (last["terminated"], last["truncated"]) == (how == "terminate", how == "truncate")
    assert (last["is_success"], last["stl_success"], last["stl_undecided"]) == (True, True, False)
    assert last["stl_episode"]["near"]["decided_at"] == 2
    assert "stl_violated_by" not in last
    assert float(last["stl_lower"]) > 0.0


def test_a_satisfaction_is_only_reported_unless_something_else_is_said() -> None:
    infos = run(monitored([*SERIES[:4], 2.0], "truncated"))
    assert len(infos) == 5
    assert run(monitored([*SERIES[:4], 2.0], "truncated", on_satisfaction="report")) == infos


@given(
    series=st.lists(st.sampled_from([0.0, 2.0, 6.0]), min_size=2, max_size=8),
    end=st.sampled_from(["terminated", "truncated"]),
    how=st.sampled_from(["terminate", "truncate"]),
)
def test_no_other_end_is_moved(series: list[float], end: str, how: str) -> None:
    whole = run(monitored(series, end, on_violation="report", details=True))
    certain = [
        number
        for number, info in enumerate(whole)
        if all(item["lower"] > 0.0 for item in info["stl"].values())
    ]
    own_end = len(whole) - 1
    # At the last sample the end mode has made bounds certain, which is not an early end.
    expected = min([max(number, 1) for number in certain] + [own_end])
    infos = run(monitored(series, end, on_violation="report", details=True, on_satisfaction=how))
    assert len(infos) == expected + 1
    if expected < own_end:
        last = infos[-1]
        assert (last["terminated"], last["truncated"]) == (how == "terminate", how == "truncate")


def test_a_reset_that_satisfies_ends_at_the_first_step() -> None:
    env = StlMonitor(Replay([6.0, 0.0, 0.0]), "eventually(x > 5)", X, on_satisfaction="truncate")
    assert [info["stl_lower"] > 0 for info in run(env)] == [True, True]


def test_a_violation_is_told_by_its_own_option() -> None:
    infos = run(
        monitored([0.0, 6.0, 6.0], "truncated", on_violation="report", on_satisfaction="terminate")
    )
    assert len(infos) == 3
    assert infos[-1]["stl_violated_by"] == "near"


@pytest.mark.parametrize("how", ["terminate", "truncate"])
def test_logs_inside_count_the_episode(how: Any) -> None:
    inside = RecordEpisodeStatistics(Replay(SERIES, "none"))
    env = StlReward(inside, SPECS, X, mode="replace", bonus=3.0, on_satisfaction=how, **OPTIONS)
    last = run(env)[-1]
    assert (last["episode"]["l"], last["episode"]["r_env"]) == (2, 3.0)
    assert last["episode"]["r"] == pytest.approx(1.0 + 1.0 + 3.0)
    assert list(inside.return_queue) == [last["episode"]["r"]]
    assert env.stl_episodes[-1]["terminated"] is (how == "terminate")


@pytest.mark.parametrize("how", ["terminate", "truncate"])
def test_the_episode_of_all_agents_ends(how: Any) -> None:
    env = ParallelStlMonitor(
        Crew({"a": SERIES, "b": SERIES}), SPECS, {"x": "a: obs[0]"}, on_satisfaction=how, **OPTIONS
    )
    env.reset()
    steps = 0
    while env.agents:
        actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        _, _, terminations, truncations, infos = env.step(actions)
        steps += 1
    assert steps == 2
    ends = {"a": True, "b": True}
    assert (terminations if how == "terminate" else truncations) == ends
    assert infos["b"]["is_success"] is True


@pytest.mark.slow(keep=6)
@pytest.mark.parametrize("how", ["terminate", "truncate"])
@pytest.mark.parametrize("on_violation", ["report", "terminate", "truncate"])
@pytest.mark.parametrize("reward", [False, True])
def test_many_environments_end_as_each_does(how: str, on_violation: str, *, reward: bool) -> None:
    makes: list[Make] = [
        functools.partial(Replay, series, end)
        for series, end in (
            (SERIES, "terminated"),
            ([6.0, 2.0, 2.0], "truncated"),
            ([2.0, 2.0, 0.0, 6.0, 6.0], "terminated"),
            ([2.0, 2.0, 2.0, 2.0, 2.0, 6.0, 2.0], "truncated"),
        )
    ]
    options: Any = {**OPTIONS, "on_satisfaction": how, "on_violation": on_violation}
    if reward:
        options |= {"mode": "potential", "bonus": 2.0, "penalty": 1.0, "clip": 9.0}
    one, many = (StlReward, VectorStlReward) if reward else (StlMonitor, VectorStlMonitor)
    together, singles = both(one, many, makes, AutoresetMode.DISABLED, SPECS, X, **options)
    assert difference(trajectory(together, 20), trajectory(singles, 20)) == ""


def test_the_argument_is_recorded() -> None:
    env = StlMonitor(
        gym.make("CartPole-v1"), "eventually(a > 0.01)", {"a": "obs[2]"}, on_satisfaction="truncate"
    )
    assert env.spec is not None
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    for item in (env, again):
        _, info = item.reset(seed=3)
        truncated = False
        while not truncated:
            *_, truncated, info = item.step(np.int64(0))
        assert info["is_success"] is True
