"""Selectors of an element of a reward: environments with several objectives."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorWrapper
from parallel_environments import Crew
from replay import Replay
from vector_environments import sync

from rtamt import InputError, InputTypeError
from rtamt_gym import ParallelStlMonitor, StlMonitor, VectorStlMonitor

SPEC = "always(r < 9)"
SERIES = [0.0, 0.0, 0.0, 0.0]


class Objectives(Replay):
    """An environment with the reward (k, 10 k) at step k."""

    def step(self, action: object) -> Any:
        obs, reward, *rest = super().step(action)
        return obs, np.array([reward, 10 * reward]), *rest


class ObjectivesOfAll(VectorWrapper):
    def step(self, actions: Any) -> Any:
        obs, rewards, *rest = super().step(actions)
        return obs, np.stack([rewards, 10 * rewards], axis=1), *rest


class ObjectivesOfAgents(Crew):
    def step(self, actions: dict[str, Any]) -> Any:
        obs, rewards, *rest = super().step(actions)
        return obs, {agent: np.array([1.0, 10.0]) for agent in rewards}, *rest


def monitor_one(selector: str, **options: Any) -> Any:
    return StlMonitor(Objectives(SERIES), SPEC, {"r": (selector, 0.0)}, **options)


def monitor_many(selector: str, **options: Any) -> Any:
    envs: Any = ObjectivesOfAll(sync([lambda: Replay(SERIES)] * 3, AutoresetMode.NEXT_STEP))
    return VectorStlMonitor(envs, SPEC, {"r": (selector, 0.0)}, **options)


def monitor_agents(selector: str) -> Any:
    crew = ObjectivesOfAgents({"one": SERIES})
    return ParallelStlMonitor(crew, SPEC, {"r": (f"one: {selector}", 0.0)})


def test_proposed_selector_is_accepted() -> None:
    env = monitor_one("reward")
    env.reset()
    with pytest.raises(InputTypeError) as error:
        env.step(np.zeros(1))
    found = re.search("choose an element, (.*)$", str(error.value))
    assert found is not None
    assert found[1] == "reward[0]"
    env = monitor_one(found[1])
    env.reset()
    assert env.step(np.zeros(1))[-1]["robustness"] == 8.0


@pytest.mark.parametrize(("selector", "robustness"), [("reward[0]", 8.0), ("reward[1]", -1.0)])
def test_elements_of_rewards_are_read(selector: str, robustness: float) -> None:
    one, many, agents = monitor_one(selector), monitor_many(selector), monitor_agents(selector)
    for env in (one, many, agents):
        env.reset()
    assert one.step(np.zeros(1))[-1]["robustness"] == robustness
    assert many.step(np.zeros((3, 1)))[-1]["robustness"].tolist() == [robustness] * 3
    assert agents.step({"one": np.zeros(1)})[-1]["one"]["robustness"] == robustness


def test_batch_reward_error() -> None:
    env = monitor_many("reward")
    env.reset()
    with pytest.raises(
        InputTypeError, match=r"expected 3 numbers from reward.* got shape \(3, 2\)"
    ):
        env.step(np.zeros((3, 1)))


@pytest.mark.parametrize("selector", ["reward[2]", "reward['speed']"])
def test_missing_reward_element_error(selector: str) -> None:
    for env, actions, held in (
        (monitor_one(selector), np.zeros(1), "it is array([ 1., 10.])"),
        (monitor_many(selector), np.zeros((3, 1)), "they have shape (3, 2)"),
    ):
        env.reset()
        with pytest.raises(InputError, match=re.escape(f"no {selector}; {held}")):
            env.step(actions)


def test_element_of_number_error() -> None:
    env = StlMonitor(Replay(SERIES), SPEC, {"r": ("reward[0]", 0.0)})
    env.reset()
    with pytest.raises(InputError) as error:
        env.step(np.zeros(1))
    assert str(error.value) == "signal 'r': the reward has no reward[0]; it is 1.0"
