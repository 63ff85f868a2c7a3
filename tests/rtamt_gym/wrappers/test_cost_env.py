"""`CostEnv` returns the cost of the monitor inside, and changes nothing else."""

from __future__ import annotations

import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from replay import Replay, X

from rtamt_gym import CostEnv, StlMonitor, StlReward

COSTS = ["violation", "depth", "latched", "first"]


def monitored(values: list[float], cost: Any = "violation") -> StlMonitor[Any, Any]:
    return StlMonitor(
        Replay(values),
        {"low": "always(x < 2)", "soon": "always(eventually[0:1](x < 1))"},
        X,
        period=1,
        on_violation="report",
        at_termination="complete",
        cost=cost,
    )


@given(st.lists(st.sampled_from([0.0, 1.0, 3.0]), min_size=2, max_size=8), st.sampled_from(COSTS))
def test_a_step_gives_the_cost_beside_the_reward(values: list[float], cost: str) -> None:
    env, expected = CostEnv(monitored(values, cost)), monitored(values, cost)
    assert repr(env.reset(seed=1)) == repr(expected.reset(seed=1))
    for _ in values[1:]:
        *result, info = expected.step(np.array([0.5]))
        result.insert(2, info["cost"])
        assert repr(env.step(np.array([0.5]))) == repr((*result, info))


def test_the_costs_of_an_episode_are_its_unsafe_instants() -> None:
    env = CostEnv(
        StlMonitor(
            Replay([3, 0, 4, 5, 0]), "always(x < 2)", X, on_violation="report", cost="violation"
        )
    )
    env.reset()
    assert [env.step(np.array([0.5]))[2] for _ in range(4)] == [0.0, 1.0, 1.0, 0.0]


@pytest.mark.parametrize(
    "text",
    [
        "safe = always(x < 2 implies eventually[0:1](x < 1))",
        "input float x\nlow = x < 2; answer = low implies eventually[0:1](x < 1); always(answer)",
    ],
)
def test_named_formulas_cost_the_same_after_a_pickle(text: str) -> None:
    values = [0.0, 1.0, 1.0, 3.0, 0.0, 1.0, 1.0, 0.0]
    arguments: dict[str, Any] = {"on_violation": "report", "cost": "violation", "period": 1}
    env = CostEnv(StlMonitor(Replay(values), text, X, at_termination="complete", **arguments))
    env.reset()
    costs = []
    for _ in values[1:]:
        env = pickle.loads(pickle.dumps(env))
        costs.append(env.step(np.array([0.5]))[2])
    # Instants 1, 2 and 5 violate it, which the samples after them show.
    assert costs == [0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]


def test_the_monitor_may_be_below_other_wrappers() -> None:
    env = CostEnv(StlReward(monitored([0, 3, 0]), mode="add"))
    env.reset()
    _, reward, cost, _, _, info = env.step(np.array([0.5]))
    assert (reward, cost, info["reward"]) == (1.0 - 1.0, 1.0, 1.0)
    env = CostEnv(gym.wrappers.TimeLimit(monitored([0, 3, 0]), 1))
    env.reset()
    assert env.step(np.array([0.5]))[2:5] == (1.0, False, True)


def test_it_is_made_again_from_its_specification_and_pickled() -> None:
    inner = StlMonitor(
        gym.make("CartPole-v1"), "always(abs(theta) < 0.1)", {"theta": "obs[2]"}, cost="first"
    )
    env = CostEnv(inner)
    for twin in (gym.make(env.spec), pickle.loads(pickle.dumps(env))):  # type: ignore[arg-type]  # there is one
        assert isinstance(twin, CostEnv)
        assert repr(twin.reset(seed=3)) == repr(env.reset(seed=3))
        assert repr(twin.step(1)) == repr(env.step(1))
