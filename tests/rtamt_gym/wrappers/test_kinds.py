"""A wrapper of one environment refuses many, one of many refuses one, and both name the other."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import pytest

from rtamt import InputTypeError
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward

ARGUMENTS: Any = ("always(abs(x) < 1)", {"x": "obs[0]"})


def refusal(wrapper: Any, env: object, **options: Any) -> str:  # noqa: ANN401 - a wrapper's class
    with pytest.raises(InputTypeError) as caught:
        wrapper(env, *ARGUMENTS, **options)
    return str(caught.value)


def test_many_environments_need_a_vector_wrapper() -> None:
    envs = gym.make_vec("CartPole-v1", 2)
    expected = (
        f"expected an environment of Gymnasium, got {envs!r}; "
        "VectorStlMonitor and VectorStlReward are for many environments at once"
    )
    assert refusal(StlMonitor, envs) == expected
    assert refusal(StlReward, envs, mode="add") == expected


def test_one_environment_needs_a_scalar_wrapper() -> None:
    env = gym.make("CartPole-v1")
    expected = (
        f"expected a vector environment of Gymnasium, got {env!r}; "
        "StlMonitor and StlReward are for one environment"
    )
    assert refusal(VectorStlMonitor, env) == expected
    assert refusal(VectorStlReward, env, mode="add") == expected


def test_several_agents_need_a_parallel_wrapper() -> None:
    class Agents:
        possible_agents = ("first", "second")

        def __repr__(self) -> str:
            return "<Agents>"

    assert refusal(StlMonitor, Agents()) == (
        "expected an environment of Gymnasium, got <Agents>; "
        "ParallelStlMonitor is for several agents"
    )


def test_a_name_is_no_environment_yet() -> None:
    assert refusal(StlMonitor, "CartPole-v1") == (
        "expected an environment of Gymnasium, got 'CartPole-v1'; make it with gym.make"
    )
    assert refusal(VectorStlMonitor, "CartPole-v1") == (
        "expected a vector environment of Gymnasium, got 'CartPole-v1'; make it with gym.make_vec, "
        "envpool.make_gymnasium or pufferlib.vector.make"
    )
