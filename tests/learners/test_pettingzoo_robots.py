"""PettingZoo accepts the two service robots as a parallel environment of its own."""

from __future__ import annotations

import warnings
from typing import Any

import pytest
from pettingzoo.utils import ParallelEnv, parallel_to_aec
from rtamt_envs.two_service_robots import parallel_env

from rtamt_gym import ParallelStlMonitor

with warnings.catch_warnings():  # its tests import an environment in a deprecated way
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test, parallel_seed_test


def monitored(**options: Any) -> ParallelStlMonitor:  # noqa: ANN401
    env = parallel_env()
    return ParallelStlMonitor(env, env.requirements, **options)


def test_its_test_of_the_interface_finds_no_fault() -> None:
    env = parallel_env(parameters={"lag": 0.4})
    assert isinstance(env, ParallelEnv)
    parallel_api_test(env)


@pytest.mark.parametrize("on_violation", ["terminate", "report"])
def test_its_test_of_the_interface_finds_no_fault_in_a_monitored_one(on_violation: Any) -> None:  # noqa: ANN401
    parallel_api_test(monitored(on_violation=on_violation))


def test_its_test_of_seeds_finds_no_fault() -> None:
    parallel_seed_test(parallel_env)
    parallel_seed_test(monitored)


def test_its_other_interface_runs_to_the_time_limit() -> None:
    env = parallel_to_aec(parallel_env())
    env.reset(seed=0)
    turns = 0
    for agent in env.agent_iter():
        over = env.last()[2] or env.last()[3]
        env.step(None if over else env.action_space(agent).sample())
        turns += not over
    assert turns == 2 * 600
