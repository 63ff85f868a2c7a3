"""Wrappers inside a monitor or a reward that count episodes, and their statistics."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RecordEpisodeStatistics, TimeLimit
from gymnasium.wrappers.vector import RecordEpisodeStatistics as RecordStatistics
from keepers import Fresh, Monitor
from replay import X, run
from vector_environments import MODES, Envs, Make, difference, sync

from rtamt_gym import StlMonitor, StlReward, VectorStlReward
from rtamt_gym.wrappers.monitoring import OnViolation

Env = gym.Env[Any, Any]
ACTION = np.array([0.5])


# ---- a monitor ----

# Ends by itself, is violated at sample 2, is violated at the sample that ends it.
EPISODES = [[3, 3, 3], [3, 3, 0, 3, 3], [3, 3, 0], [3, 0, 3]]


def played(env: Env, replay: Fresh) -> list[dict[str, Any]]:
    """Return the last infos of the episodes."""
    lasts = []
    for values in EPISODES:
        replay.values = values
        lasts.append(run(env)[-1])
    return lasts


def counts(info: dict[str, Any]) -> tuple[float, int]:
    return float(info["episode"]["r"]), int(info["episode"]["l"])


EXPECTED = [(3.0, 2), (3.0, 2), (3.0, 2), (1.0, 1)]
"""Returns and lengths: the reward of step n is n."""


class Derived(Monitor):
    """A user's own class."""


@pytest.mark.parametrize("on_violation", ["terminate", "truncate"])
@pytest.mark.parametrize("keeper", [Monitor, Derived, RecordEpisodeStatistics])
def test_every_episode_is_counted_once_inside_as_outside(
    keeper: Any, on_violation: OnViolation
) -> None:
    replay = Fresh([])
    inside = keeper(replay)
    env = StlMonitor(inside, "always(x > 1)", X, on_violation=on_violation)
    assert [counts(info) for info in played(env, replay)] == EXPECTED
    outside = Fresh([])
    around = keeper(StlMonitor(outside, "always(x > 1)", X, on_violation=on_violation))
    assert [counts(info) for info in played(around, outside)] == EXPECTED
    if issubclass(keeper, Monitor):
        assert inside.rows == around.rows
        assert inside.total_steps == around.total_steps == 7
    else:
        assert list(inside.return_queue) == list(around.return_queue) == [3.0, 3.0, 3.0, 1.0]
        assert list(inside.length_queue) == list(around.length_queue) == [2, 2, 2, 1]
        assert inside.episode_count == around.episode_count == 4


def test_an_episode_that_goes_on_after_a_violation_is_counted_at_its_end() -> None:
    replay = Fresh([3, 0, 3, 3])
    env = StlMonitor(RecordEpisodeStatistics(replay), "always(x > 1)", X, on_violation="report")
    *running, last = run(env)
    assert not any("episode" in info for info in running)
    assert counts(last) == (6.0, 3)


def test_a_wrapper_of_the_same_name_that_keeps_no_logs_is_left_alone() -> None:
    named = type("Monitor", (gym.Wrapper,), {})
    env = StlMonitor(named(Fresh([3, 0, 3])), "always(x > 1)", X)
    last = run(env)[-1]
    assert last["stl_violated"]
    assert "episode" not in last


def test_logs_are_kept_by_a_wrapper_whose_environment_is_the_same_after_it() -> None:
    replay = Fresh([3, 0, 3])
    inside = RecordEpisodeStatistics(replay)
    env = StlMonitor(inside, "always(x > 1)", X)
    env.reset()
    env.step(np.array([0.5]))
    assert inside.env is replay


# ---- a reward ----


def returns(keeper: Any) -> list[float]:
    held = keeper.episode_returns if isinstance(keeper, Monitor) else keeper.return_queue
    return list(held)


keepers = pytest.mark.parametrize("keeper", [Monitor, RecordEpisodeStatistics])
SERIES = [3.0, 1.5, 4.0, 0.25, 9.0, 2.0]


def shaped(env: Env, **options: Any) -> StlReward[Any, Any]:
    given = {"mode": "add", "clip": 9.0, "on_violation": "report", **options}
    return StlReward(env, "always(x > 1)", X, **given)


def play(env: Env) -> tuple[float, float, dict[str, Any]]:
    """Return the sums of shaped and own rewards of an episode, and its last info."""
    env.reset(seed=1)
    paid = own = 0.0
    while True:
        _, reward, terminated, truncated, info = env.step(ACTION)
        paid, own = paid + float(reward), own + info["reward"]
        if terminated or truncated:
            return paid, own, info
        assert "episode" not in info


@keepers
@pytest.mark.parametrize("end", ["terminated", "truncated"])
@pytest.mark.parametrize("mode", ["add", "replace", "potential", "terminal"])
def test_statistics_inside_say_what_was_paid(
    mode: str, end: str, keeper: Callable[[Env], Env]
) -> None:
    logs = keeper(Fresh(SERIES, end))
    env = shaped(logs, mode=mode)
    for episode in range(1, 4):
        paid, own, info = play(env)
        assert paid != own
        result = info["episode"]
        assert (result["r"], result["r_env"], result["l"]) == (paid, own, 5)
        assert type(result["r"]) is np.float64
        assert returns(logs) == [paid] * episode


@keepers
def test_an_episode_that_the_monitor_ends_is_counted_once(keeper: Callable[[Env], Env]) -> None:
    for how in ("terminate", "truncate"):
        logs = keeper(Fresh(SERIES))
        env = shaped(logs, on_violation=how)
        for episode in range(1, 4):
            paid, own, info = play(env)
            result = info["episode"]
            assert (result["r"], result["r_env"], result["l"]) == (paid, own, 3)
            assert own == 1 + 2 + 3
            assert returns(logs) == [paid] * episode


@keepers
def test_statistics_between_the_monitor_and_the_reward_count_too(
    keeper: Callable[[Env], Env],
) -> None:
    inner = shaped(Fresh(SERIES)).env  # the monitor
    logs = keeper(inner)
    paid, own, info = play(StlReward(logs, mode="add", clip=9.0))
    assert (info["episode"]["r"], info["episode"]["r_env"]) == (paid, own)
    assert returns(logs) == [paid]


def test_statistics_around_the_reward_count_what_they_see() -> None:
    logs = RecordEpisodeStatistics(shaped(Fresh(SERIES)))
    paid, _, info = play(logs)
    assert info["episode"]["r"] == paid
    assert "r_env" not in info["episode"]


def test_without_statistics_none_are_made() -> None:
    env = shaped(Fresh(SERIES))
    assert "episode" not in play(env)[2]
    replay = Fresh(SERIES)
    replay.info = {"episode": 7}
    env = shaped(replay)
    env.reset()
    for _ in SERIES[1:]:
        assert env.step(ACTION)[4]["episode"] == 7


def test_an_episode_given_up_does_not_count_in_the_next() -> None:
    env = shaped(Monitor(Fresh(SERIES)))
    env.reset()
    env.step(ACTION)
    paid, _, info = play(env)
    assert info["episode"]["r"] == paid


def test_a_copy_goes_on_adding() -> None:
    env = shaped(Monitor(TimeLimit(Fresh(SERIES), 4)))
    whole = play(env)[2]["episode"]["r"]
    env.reset(seed=1)
    env.step(ACTION)
    copy = pickle.loads(pickle.dumps(env))
    for _ in range(3):
        info = copy.step(ACTION)[4]
    assert info["episode"]["r"] == whole


# ---- many environments ----


def make(values: list[float], keeper: Callable[[Env], Env] | None = RecordEpisodeStatistics) -> Env:
    env = Fresh(values)
    return env if keeper is None else keeper(env)


def infos(envs: Envs, steps: int) -> list[dict[str, Any]]:
    """Return the infos of steps, without the times of the statistics."""
    envs.reset(seed=1)
    listed = []
    for _ in range(steps):
        _, _, terminated, truncated, info = envs.step(np.full((envs.num_envs, 1), 0.5))
        ended = terminated | truncated
        for holder in (info, info.get("final_info", {})):
            for key in ("t", "_t"):
                holder.get("episode", {}).pop(key, None)
        listed.append(deepcopy(info))  # Gymnasium changes its masks later
        if ended.any() and envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
            envs.reset(options={"reset_mask": ended})
    return listed


@pytest.mark.parametrize("autoreset", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("mode", ["add", "potential"])
def test_many_environments_say_what_each_does(mode: str, autoreset: AutoresetMode) -> None:
    makes: list[Make] = [
        functools.partial(make, SERIES[:n], keeper)
        for n, keeper in [(3, RecordEpisodeStatistics), (4, Monitor), (6, Monitor)]
    ]
    options: Any = {"mode": mode, "clip": 9.0, "on_violation": "report"}
    singles = [functools.partial(lambda make: shaped(make(), **options), item) for item in makes]
    together = VectorStlReward(sync(makes, autoreset), "always(x > 1)", X, **options)
    result = infos(together, 16)
    assert difference(result, infos(sync(singles, autoreset), 16)) == ""
    holders = [info.get("final_info", info) for info in result]
    counted = [holder["episode"] for holder in holders if "episode" in holder]
    assert len(counted) > 7
    assert any((item["r"] != item["r_env"]).any() for item in counted)


# Before 1.4, Gymnasium's statistics omitted the first reward after a reset in the same step.
COUNTED = [
    mode
    for mode in MODES
    if mode is not AutoresetMode.SAME_STEP or not gym.__version__.startswith(("1.1", "1.2", "1.3"))
]


@pytest.mark.parametrize("autoreset", COUNTED, ids=lambda mode: mode.name)
def test_statistics_of_many_environments_say_what_was_paid(autoreset: AutoresetMode) -> None:
    makes: list[Make] = [functools.partial(make, SERIES[:n], None) for n in (3, 4, 6)]
    options: Any = {"mode": "add", "clip": 9.0, "on_violation": "report"}
    inside = RecordStatistics(sync(makes, autoreset))
    rewarded = VectorStlReward(inside, "always(x > 1)", X, **options)
    around = RecordStatistics(
        VectorStlReward(sync(makes, autoreset), "always(x > 1)", X, **options)
    )
    ended = 0
    for first, second in zip(infos(rewarded, 16), infos(around, 16), strict=True):
        assert ("episode" in first) is ("episode" in second)
        if "episode" in first:
            assert first["episode"]["r"].tolist() == second["episode"]["r"].tolist()
            assert first["_episode"].tolist() == second["_episode"].tolist()
            ended += 1
    assert ended > 6
