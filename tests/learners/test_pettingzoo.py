"""PettingZoo accepts a monitored environment as one of its own."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpe2 import simple_spread_v3
from parallel_environments import Crew, assert_as_one
from pettingzoo.utils import BaseParallelWrapper, ParallelEnv, aec_to_parallel, parallel_to_aec
from programs import run

from rtamt_gym import ParallelStlMonitor

with warnings.catch_warnings():  # its tests import an environment in a deprecated way
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test, parallel_seed_test

AGENTS = ["agent_0", "agent_1", "agent_2"]
SPECS = {
    "apart": "always(abs(dx) + abs(dy) > 0.1)",
    "inside": "always(abs(x) < 1)",
    "rewarded": "eventually[0:2](r > -1)",
}
SIGNALS = {
    "dx": "agent_0: obs[10]",
    "dy": "agent_0: obs[11]",
    "x": "agent_1: obs[2]",
    "r": ("agent_2: reward", -9.0),
}


def spread() -> Any:  # noqa: ANN401
    return simple_spread_v3.parallel_env(N=3, max_cycles=25)


class Zoo(Crew, ParallelEnv):  # type: ignore[misc]  # PettingZoo has no types
    """Agents that leave one after the other."""

    def __init__(self) -> None:
        rng = np.random.default_rng(3)
        super().__init__(
            {agent: rng.normal(size=4 + at).tolist() for at, agent in enumerate(AGENTS)}
        )

    def state(self) -> Any:  # noqa: ANN401
        return Crew.state(self)


def monitored(env: Any = None, **options: Any) -> ParallelStlMonitor:  # noqa: ANN401
    arguments = {"period": 0.1, "at_termination": "complete", "cost": "violation", **options}
    return ParallelStlMonitor(env or spread(), SPECS, SIGNALS, **arguments)


@pytest.mark.parametrize("on_violation", ["terminate", "truncate", "report"])
def test_its_test_of_the_interface_finds_no_fault(on_violation: Any) -> None:  # noqa: ANN401
    parallel_api_test(monitored(on_violation=on_violation))
    specs, signals = "always(x - y > -2)", {"x": "agent_0: obs[0]", "y": "agent_2: obs[0]"}
    parallel_api_test(
        ParallelStlMonitor(
            Zoo(), specs, signals, nan="hold", on_violation=on_violation, at_termination="complete"
        )
    )


def test_its_test_of_seeds_finds_no_fault() -> None:
    parallel_seed_test(monitored)


def test_a_monitored_environment_is_one_of_its_own() -> None:
    env = monitored()
    assert isinstance(env, ParallelEnv)
    assert str(env) == str(spread())
    around = BaseParallelWrapper(env)
    around.reset(seed=1)
    assert around.agents == AGENTS
    assert around.max_num_agents == around.num_agents == 3
    assert around.unwrapped is env.unwrapped
    assert np.array_equal(around.state(), env.env.state())


@pytest.mark.parametrize("on_violation", ["terminate", "truncate", "report"])
def test_its_agents_are_monitored_together_as_one(on_violation: Any) -> None:  # noqa: ANN401
    for seed in range(8):

        def act(agent: str, step: int, seed: int = seed) -> Any:  # noqa: ANN401
            return np.random.default_rng([seed, AGENTS.index(agent), step]).integers(5)

        assert_as_one(
            spread,
            SPECS,
            SIGNALS,
            act,
            period=0.1,
            on_violation=on_violation,
            cost="violation",
            details=True,
        )


def test_agents_that_take_turns_are_converted() -> None:
    env = monitored(aec_to_parallel(simple_spread_v3.env(N=3, max_cycles=25)))
    twin = monitored()
    for each in (env, twin):
        each.reset(seed=4)
    while twin.agents:
        result, expected = (each.step(dict.fromkeys(each.agents, 1))[4] for each in (env, twin))
        assert result == expected
    assert env.agents == []


def test_its_other_interface_shows_the_verdict_to_every_agent() -> None:
    env = parallel_to_aec(monitored())
    env.reset(seed=4)
    last = {}
    for agent in env.agent_iter():
        _, _, terminated, truncated, info = env.last()
        over = terminated or truncated
        if over:
            last[agent] = info["is_success"], info["stl_episode"]
        env.step(None if over else 1)
    assert last.keys() == set(AGENTS)
    assert all(each == last["agent_0"] for each in last.values())


def test_the_program_of_the_page_finds_what_a_hand_count_finds(tmp_path: Path) -> None:
    program, _ = run("PettingZoo", tmp_path)
    bare = simple_spread_v3.parallel_env(N=2, max_cycles=25)
    for agent in bare.possible_agents:
        bare.action_space(agent).seed(1)
    successes, costs = [], []
    for episode in range(40):
        seen = [bare.reset(seed=episode)[0]]
        while bare.agents:
            actions = {agent: bare.action_space(agent).sample() for agent in bare.agents}
            seen.append(bare.step(actions)[0])
        unsafe = [
            abs(float(each["agent_0"][8])) + abs(float(each["agent_0"][9])) <= 0.5
            or abs(float(each["agent_1"][2])) >= 1
            for each in seen
        ]
        successes.append(not any(unsafe))
        costs.append(float(sum(unsafe[1:])))
    assert program["successes"] == successes
    assert program["costs"] == costs
    assert 0 < sum(successes) < 40


def test_supersuit_keeps_the_verdict_and_shows_the_robustness_of_the_next_episode() -> None:
    from supersuit import pettingzoo_env_to_vec_env_v1

    envs, twin = pettingzoo_env_to_vec_env_v1(monitored()), monitored()
    envs.reset(seed=4)
    twin.reset(seed=4)
    while twin.agents:
        infos = envs.step(np.ones(3, int))[4]
        expected = twin.step(dict.fromkeys(AGENTS, 1))[4]
    for agent, info in zip(AGENTS, infos, strict=True):
        for key in ("is_success", "stl_episode", "stl_undecided", "cost"):
            assert info[key] == expected[agent][key]
    again = twin.reset()[1]
    assert [info["robustness"] for info in infos] == [
        again[agent]["robustness"] for agent in AGENTS
    ]
