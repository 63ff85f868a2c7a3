"""The table of Meta-World's tasks against Meta-World itself, and its scripted policies."""

from __future__ import annotations

import inspect
import re
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import metaworld
import numpy as np
import pytest

import rtamt
from rtamt import InputError
from rtamt_gym import StlMonitor, compare, evaluate_policy
from rtamt_gym.benchmarks.metaworld import TASKS, done, make, signals_of
from rtamt_gym.evaluation.replays import UnrepeatedSeedWarning
from rtamt_gym.signals.signals import Step
from rtamt_gym.success import reading, readings

FLAG: Any = {"success": ("info['success']", 0.0)}
SIDED = [name for name, row in TASKS.items() if row.quantity != "flag"]

# Warnings of the package and of Gymnasium about the package.
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*WARN:UserWarning"),
    pytest.mark.filterwarnings("ignore:Constant:UserWarning"),
]


def test_the_table_has_the_tasks_of_the_package() -> None:
    assert set(TASKS) == set(metaworld.ALL_V3_ENVIRONMENTS)


@pytest.mark.parametrize("name", TASKS)
def test_a_row_names_the_file_of_its_task_and_a_tolerance_that_is_there(name: str) -> None:
    row, kind = TASKS[name], metaworld.ALL_V3_ENVIRONMENTS[name]
    assert Path(inspect.getfile(kind)).name == row.file
    for number in re.findall(r"0\.\d+", row.flag):
        names = {str(getattr(kind, "TARGET_RADIUS", "")), "0.055"}  # 0.04 + 0.015
        assert number in inspect.getsource(kind) or number in names


@pytest.mark.parametrize("name", SIDED)
def test_one_side_holds_wherever_the_flag_does_and_not_before_the_robot_moves(name: str) -> None:
    env = make(name)
    simulation: Any = env.unwrapped
    state = rtamt.Monitor(done(name))
    past: Any = signals_of(name)["past"]
    observation, info = env.reset(seed=1)
    truncated, flags, held = False, 0, []
    while not truncated:
        action = simulation.baseline(observation)
        observation, _, terminated, truncated, info = env.step(action)
        assert not terminated
        read = past(Step(observation, action, 0.0, info, env))
        held.append(rtamt.holds(state.update(read)))
        flags += info["success"] > 0
        assert held[-1] >= (info["success"] > 0)
    assert flags
    assert not held[0]


def test_a_door_that_is_opened_further_is_kept_by_its_side_and_not_by_its_flag() -> None:
    name = "door-open-v3"
    specs = {"flag": reading("kept", "success"), "side": reading("kept", done(name))}
    signals = {**FLAG, **signals_of(name)}
    found = evaluate_policy("baseline", make(name), specs, signals, episodes=2)
    assert [found.requirements[each].satisfied for each in specs] == [0, 2]
    assert found.repeats is True
    assert found.limit is None


def test_a_seed_repeats_an_episode_and_another_is_another() -> None:
    env = make("push-v3")
    shown = [env.reset(seed=seed)[0] for seed in (3, 4, 3)]
    assert np.array_equal(shown[0], shown[2])
    assert not np.array_equal(shown[0], shown[1])


def test_what_gymnasium_makes_is_not_repeated_and_so_not_paired() -> None:
    env = gym.make("Meta-World/MT1", env_name="push-v3", disable_env_checker=True)
    with pytest.raises(InputError, match="cannot pair episodes of"):
        compare("random", "zero", env, {"any": reading("any")}, FLAG, episodes=2, period=0.0125)
    with pytest.warns(UnrepeatedSeedWarning):
        found = evaluate_policy(
            "random", env, {"any": reading("any")}, FLAG, episodes=2, period=0.0125
        )
    assert found.repeats is False


def test_an_end_at_the_first_success_holds_nothing_and_a_cut_window_is_said() -> None:
    name = "button-press-topdown-v3"
    made: Any = {"env_name": name, "seed": 0, "terminate_on_success": True}
    env = gym.make("Meta-World/MT1", disable_env_checker=True, **made)
    specs: Any = {**readings("success"), "ahead": "eventually(always[0:0.5](success >= 0.5))"}
    simulation: Any = make(name).unwrapped
    policy = simulation.baseline
    monitored = StlMonitor(env, specs, FLAG, period=0.0125)
    observation, info = monitored.reset(seed=0)
    over = False
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        while not over:
            step = monitored.step(policy(observation).astype(np.float32))
            observation, _, terminated, truncated, info = step
            over = terminated or truncated
    assert terminated
    verdicts = {each: found["satisfied"] for each, found in info["stl_episode"].items()}
    assert verdicts == {"any": True, "last": True, "held": False, "kept": False, "ahead": True}
    assert any("inside a bounded window of specification 'ahead'" in str(e.message) for e in told)
