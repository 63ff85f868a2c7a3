"""The contract of `StlMonitor` on real environments: what holds for one holds for each."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES, Case, Env, continued, equal, restored, rollout
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

from rtamt_gym import StlMonitor

cases = pytest.mark.parametrize("case", CASES, ids=lambda case: case.env_id.split(":")[-1])


@pytest.mark.slow(keep=4)
@cases
@pytest.mark.parametrize("view", ["episode", "step"])
@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version:UserWarning")
def test_gymnasium_finds_no_fault(case: Case, view: str) -> None:
    if view == "step" and case.env_id == "CartPole-v1":
        case = Case(case.env_id, "abs(theta) < 0.2", case.signals)
    elif view == "step":
        case = Case(case.env_id, "x < 9", {"x": next(iter(case.signals.values()))})
    check_env(case.monitored(view=view), skip_render_check=True)


@pytest.mark.slow(keep=3)
@cases
def test_monitoring_changes_nothing_but_the_info(case: Case) -> None:
    bare = rollout(case.bare())
    monitored = rollout(case.monitored(on_violation="report", details=True, cost="depth"))
    assert len(bare) == len(monitored)
    for plain, (*rest, info) in zip(bare, monitored, strict=True):
        assert equal(plain[:-1], tuple(rest))
        assert equal(plain[-1], {key: info[key] for key in plain[-1]})
        assert type(info["robustness"]) is np.float64
        assert type(info["stl_violated"]) is bool


@pytest.mark.slow(keep=3)
@cases
def test_the_environment_is_made_again_from_its_specification_and_from_json(case: Case) -> None:
    env = case.monitored(on_violation="truncate", details=True, cost="first")
    expected = rollout(env)
    assert env.spec is not None
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        again = gym.make(spec)
        assert str(again) == str(env)
        assert equal(rollout(again), expected)
        again.close()


@pytest.mark.slow(keep=4)
@cases
@pytest.mark.parametrize("clone", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_in_mid_episode_continues_as_the_original(
    case: Case, clone: Callable[[Env], Env]
) -> None:
    env = case.monitored(on_violation="report", details=True)
    rollout(env, steps=4)
    copy = restored(clone(env), env)
    assert copy.get_wrapper_attr("samples") == env.get_wrapper_attr("samples") == 5
    assert equal(continued(copy, 11, 6), continued(env, 11, 6))


@cases
def test_reset_with_options_none_is_reset(case: Case) -> None:
    env = case.monitored(details=True)
    (obs, info), (other, same) = env.reset(seed=4), env.reset(seed=4, options=None)
    assert equal(obs, other)
    stl = {"robustness", "stl_lower", "stl_upper", "stl_violated", "stl"}
    assert stl <= info.keys()
    assert equal({key: info[key] for key in stl}, {key: same[key] for key in stl})


def test_a_wrapper_specification_serves_a_registration() -> None:
    case = CASES[0]
    gym.register(
        "MonitoredCartPole-v0",
        entry_point="gymnasium.envs.classic_control:CartPoleEnv",
        max_episode_steps=500,
        additional_wrappers=(
            StlMonitor.wrapper_spec(specs=case.specs, signals=case.signals, details=True),
        ),
    )
    try:
        env = gym.make("MonitoredCartPole-v0")
        assert equal(rollout(env), rollout(case.monitored(details=True)))
    finally:
        del gym.registry["MonitoredCartPole-v0"]


def test_a_list_of_environments_may_be_monitored_one_by_one() -> None:
    case = CASES[0]

    def wrap(env: Env) -> StlMonitor[Any, Any]:
        return StlMonitor(env, case.specs, case.signals)

    envs = gym.make_vec(case.env_id, 2, vectorization_mode="sync", wrappers=[wrap])
    envs.reset(seed=7)
    envs.action_space.seed(7)
    while True:
        _, _, terminated, _, info = envs.step(envs.action_space.sample())
        if terminated.any():
            break
    lane = int(np.flatnonzero(terminated)[0])
    assert info["stl_violated_by"][lane] == "spec"
    assert info["robustness"].dtype == np.float64
    envs.close()


def test_a_monitored_environment_crosses_to_a_fresh_process() -> None:
    envs = gym.vector.AsyncVectorEnv(
        [CASES[0].monitored], context="forkserver", shared_memory=False
    )
    _, info = envs.reset(seed=7)
    assert info["robustness"][0] == CASES[0].monitored().reset(seed=7)[1]["robustness"]
    envs.close()
