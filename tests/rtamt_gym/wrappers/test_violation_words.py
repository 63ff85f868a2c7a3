"""`on_violation` as a mapping: a word for each requirement."""

from __future__ import annotations

import functools
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from hypothesis import given
from hypothesis import strategies as st
from parallel_environments import Crew
from replay import Replay, X, run
from vector_environments import both, difference, sync, trajectory

from rtamt.errors import InputError
from rtamt_gym import (
    ParallelStlMonitor,
    ParallelStlReward,
    StlMonitor,
    StlReward,
    VectorStlMonitor,
    VectorStlReward,
)
from rtamt_gym.wrappers.monitoring import OnViolation

SPECS = {"a": "always(x > 0)", "b": "always(x > 1)", "c": "always(x != 2)"}
LOW = {"a": 0.0, "b": 1.0}
WORDS = ["terminate", "truncate", "report"]
OPTIONS: dict[str, Any] = {"at_termination": "complete", "period": 1}


def expected_end(series: list[float], words: dict[str, str]) -> tuple[int, str] | None:
    """Return the step and the word of an end by violations; None without one."""
    seen: set[str] = set()
    for step, x in enumerate(series):
        violated = {"a": x <= 0, "b": x <= 1, "c": x == 2}
        seen |= {words[name] for name in words if violated[name]}
        for word in ("terminate", "truncate"):
            if word in seen and step > 0:
                return step, word
    return None


MAPPINGS = st.fixed_dictionaries({name: st.sampled_from(WORDS) for name in SPECS})
SERIES = st.lists(st.sampled_from([0.0, 1.0, 2.0, 3.0]), min_size=2, max_size=6)


@given(series=SERIES, words=MAPPINGS)
def test_strongest_word_of_violated_requirements_ends_the_episode(
    series: list[float], words: dict[str, str]
) -> None:
    options: dict[str, Any] = {**OPTIONS, "on_violation": words}
    infos = run(StlMonitor(Replay(series, "truncated"), SPECS, X, **options))
    limit = len(series) - 1
    step, word = expected_end(series, words) or (limit, "")
    assert len(infos) - 1 == step
    assert infos[-1]["terminated"] is (word == "terminate")
    assert infos[-1]["truncated"] is (word == "truncate" or step == limit)


@given(series=SERIES, words=MAPPINGS)
def test_agents_end_as_one_environment_does(series: list[float], words: dict[str, str]) -> None:
    options: dict[str, Any] = {**OPTIONS, "on_violation": words}
    crew = Crew({"one": [*series, 3.0, 3.0], "two": [*series, 3.0, 3.0]})
    env = ParallelStlMonitor(crew, SPECS, {"x": "one: obs[0]"}, **options)
    env.reset()
    end = expected_end(series, words)
    for step in range(1, len(series)):
        actions = {agent: np.zeros(1) for agent in env.agents}
        _, _, terminations, truncations, _ = env.step(actions)
        here = end if end is not None and end[0] == step else (step, "")
        assert set(terminations.values()) == {here[1] == "terminate"}
        assert set(truncations.values()) == {here[1] == "truncate"}
        if not env.agents:
            break
    assert (not env.agents) is (end is not None)


MIXED: dict[str, OnViolation] = {"a": "terminate", "b": "truncate", "c": "report"}
CAST = [[3.0, 2.0, 3.0, 1.0, 3.0], [3.0, 3.0, 0.0, 3.0, 3.0], [2.0, 3.0, 3.0, 3.0, 0.5]]


@pytest.mark.parametrize("words", [MIXED, {"a": "truncate", "b": "report", "c": "terminate"}])
def test_vector_monitor_ends_as_wrapped_environments_do(words: dict[str, str]) -> None:
    options: dict[str, Any] = {**OPTIONS, "on_violation": words}
    makes = [functools.partial(Replay, series, "terminated") for series in CAST]
    outside, singles = both(
        StlMonitor, VectorStlMonitor, makes, AutoresetMode.DISABLED, SPECS, X, **options
    )
    assert not difference(trajectory(outside, 9), trajectory(singles, 9))
    ends = {(item["env"], item["terminated"]): item["samples"] for item in outside.stl_episodes}
    if words is MIXED:
        assert ends[0, False] == 4  # b at sample 3
        assert ends[1, True] == 3  # a and b at sample 2


def monitored() -> gym.Env[Any, Any]:
    return StlMonitor(Replay(CAST[1], "terminated"), SPECS, X, **OPTIONS, on_violation=MIXED)


def test_environments_in_other_processes_take_the_mapping() -> None:
    envs = AsyncVectorEnv([monitored, monitored])
    envs.reset()
    for _ in range(2):
        _, _, terminated, truncated, infos = envs.step(np.zeros((2, 1)))
    envs.close()
    assert terminated.tolist() == [True, True]
    assert truncated.tolist() == [False, False]
    assert infos["stl_violated_by"].tolist() == ["a", "a"]


def test_rewards_take_the_mapping_and_pickles_keep_it() -> None:
    env = StlReward(
        Replay(CAST[0]), SPECS, X, mode="replace", penalty=2.0, on_violation=MIXED, **OPTIONS
    )
    again = pickle.loads(pickle.dumps(env))
    for item in (env, again):
        infos = run(item)
        assert (len(infos), infos[-1]["truncated"], infos[-1]["stl_violated_by"]) == (4, True, "c")
    envs = VectorStlReward(
        sync([lambda: Replay(CAST[0])], AutoresetMode.DISABLED),
        SPECS, X, mode="replace", on_violation=MIXED, **OPTIONS,
    )  # fmt: skip
    assert [bool(item[3][0]) for item in trajectory(envs, 3)[1:4]] == [False, False, True]
    crew = ParallelStlReward(
        Crew({"one": CAST[0]}), SPECS, {"x": "one: obs[0]"}, mode="replace",
        on_violation=MIXED, **OPTIONS,
    )  # fmt: skip
    crew.reset()
    while crew.agents:
        _, _, _, truncations, _ = crew.step({"one": np.zeros(1)})
    assert truncations == {"one": True}


def test_mapping_is_part_of_the_specification_of_the_environment() -> None:
    made = StlMonitor(
        gym.make("CartPole-v1"),
        {"up": "always(abs(x) < 0.1)", "far": "always(abs(x) < 2)"},
        {"x": "obs[2]"},
        on_violation={"up": "report", "far": "terminate"},
    )
    assert made.spec is not None
    again = gym.make(EnvSpec.from_json(made.spec.to_json()))
    again.reset(seed=1)
    ended, steps = False, 0
    while not ended:
        _, _, terminated, truncated, info = again.step(0)
        ended, steps = terminated or truncated, steps + 1
    assert info["stl_violated_by"] == "up"
    assert info["stl_violated_at"] < steps  # reported, and the pole fell later


def test_mapping_that_ends_episodes_needs_environments_that_the_caller_resets() -> None:
    envs = sync([lambda: Replay(CAST[0])], AutoresetMode.NEXT_STEP)
    with pytest.raises(InputError, match="needs an environment that the caller resets"):
        VectorStlMonitor(envs, SPECS, X, on_violation=MIXED)
    reported: dict[str, OnViolation] = {"a": "report", "b": "report", "c": "report"}
    assert VectorStlMonitor(envs, SPECS, X, on_violation=reported).num_envs == 1
