"""Episodes that end in a wrapper around a monitor are recorded, with one warning."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorWrapper
from gymnasium.wrappers import RecordEpisodeStatistics, TimeLimit, TransformReward
from parallel_environments import Crew
from replay import Replay, X
from vector_environments import sync, trajectory

from rtamt_gym import CostEnv, ParallelStlMonitor, StlMonitor, StlReward, VectorStlMonitor
from rtamt_gym.judging.end_warnings import UnseenEndWarning
from rtamt_gym.wrappers.parallel import ParallelWrapper

SPEC = "always(x > 0)"
SERIES = [3.0] * 9
ACTION = np.zeros(1)


class Bored(gym.Wrapper[Any, Any, Any, Any]):
    """Terminates an episode after two steps, as a user's wrapper might."""

    def reset(self, **options: Any) -> Any:
        self.steps = 0
        return self.env.reset(**options)

    def step(self, action: Any) -> Any:
        self.steps += 1
        obs, reward, terminated, truncated, info = self.env.step(action)
        return obs, reward, terminated or self.steps == 2, truncated, info


def limited(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    return TimeLimit(env, 2)


def monitored(**options: Any) -> StlMonitor[Any, Any]:
    return StlMonitor(Replay(SERIES), SPEC, X, **options)


def episodes(env: gym.Env[Any, Any], count: int = 2) -> list[dict[str, Any]]:
    """Return the last infos of some episodes, as a learner sees them."""
    last = []
    for _ in range(count):
        env.reset(seed=1)
        ended = False
        while not ended:
            _, _, terminated, truncated, info = env.step(ACTION)
            ended = terminated or truncated
        last.append(info)
    return last


@pytest.mark.parametrize(
    "around", [limited, Bored, lambda env: RecordEpisodeStatistics(Bored(env))]
)
@pytest.mark.parametrize("rewarded", [False, True])
def test_unseen_end_is_recorded_and_warned_about_once(
    around: Callable[[Any], Any],
    rewarded: bool,  # noqa: FBT001 - a case
) -> None:
    monitor: Any = monitored()
    env = around(StlReward(monitor, mode="add") if rewarded else monitor)
    with pytest.warns(UnseenEndWarning) as caught:
        infos = episodes(env, 4)
    name = "TimeLimit" if around is limited else "Bored"
    (message,) = (str(item.message) for item in caught)
    assert message == (
        f"{name} around StlMonitor reset an episode that had not ended for the monitor. If {name} "
        "ended it, the last info had no is_success, and success rates leave the episode out: put "
        f"{name} inside of StlMonitor. stl_episodes has the episode as truncated"
    )
    assert caught[0].filename == __file__
    assert not any("is_success" in info for info in infos)
    assert [(item["samples"], item["truncated"]) for item in monitor.stl_episodes] == [
        (3, True)
    ] * 3
    assert all(item["specs"]["spec"]["satisfied"] for item in monitor.stl_episodes)


def success_buffer(env: gym.Env[Any, Any], count: int) -> list[bool]:
    """Return the values that Stable-Baselines3 averages: ``is_success`` of last infos with it."""
    result = [info.get("is_success") for info in episodes(env, count)]
    return [item for item in result if item is not None]


def test_limit_inside_counts_every_episode_as_the_warning_says() -> None:
    assert success_buffer(StlMonitor(limited(Replay(SERIES)), SPEC, X), 3) == [True] * 3
    with pytest.warns(UnseenEndWarning):
        assert success_buffer(limited(monitored()), 3) == []


def test_warning_that_is_an_error_leaves_a_monitor_that_goes_on() -> None:
    monitor = monitored()
    env = limited(monitor)
    episodes(env, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UnseenEndWarning):
            env.reset()
    assert len(monitor.stl_episodes) == 1
    episodes(env, 1)
    env.reset()
    assert len(monitor.stl_episodes) == 2


@pytest.mark.parametrize(
    "around",
    [
        lambda env: env,
        RecordEpisodeStatistics,
        lambda env: TransformReward(env, float),
        CostEnv,
        lambda env: StlReward(env, mode="add"),
    ],
)
def test_program_that_resets_early_is_not_warned(around: Callable[[Any], Any]) -> None:
    env = around(monitored(cost="violation"))
    for _ in range(2):
        env.reset()
        env.step(ACTION)
    assert len(env.get_wrapper_attr("stl_episodes")) == 1


def test_end_that_both_see_is_no_unseen_end() -> None:
    monitor = StlMonitor(Replay([3.0, 3.0, 3.0], "truncated"), SPEC, X)
    assert [info["is_success"] for info in episodes(limited(monitor), 3)] == [True] * 3
    assert len(monitor.stl_episodes) == 3


def limited_monitor() -> gym.Env[Any, Any]:
    return limited(monitored())


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_environments_of_a_vector_warn_each_once(mode: AutoresetMode) -> None:
    envs = SyncVectorEnv([limited_monitor] * 2, autoreset_mode=mode)
    with pytest.warns(UnseenEndWarning) as caught:
        trajectory(envs, 7)
    assert len(caught) == 2


@pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.UnseenEndWarning")
def test_processes_record_unseen_ends() -> None:
    envs = AsyncVectorEnv([limited_monitor] * 2)
    trajectory(envs, 7)
    recorded = envs.get_attr("stl_episodes")
    envs.close()
    assert [len(item) for item in recorded] == [2, 2]


class Around(VectorWrapper):
    """A wrapper around vector environments that may end episodes."""

    def step(self, actions: Any) -> Any:
        return super().step(actions)


def reset_early(envs: Any, times: int) -> None:
    """Reset all environments after one step, and only the first one after another."""
    for _ in range(times):
        envs.reset()
        envs.step(np.zeros((2, 1)))
        envs.reset(options={"reset_mask": np.array([True, False])})
        envs.step(np.zeros((2, 1)))


def test_wrapper_around_all_environments_is_warned_about_once() -> None:
    inside = sync([lambda: Replay(SERIES)] * 2, AutoresetMode.DISABLED)
    monitor = VectorStlMonitor(inside, SPEC, X)
    reset_early(monitor, 1)  # by the program itself
    with pytest.warns(UnseenEndWarning, match="Around around VectorStlMonitor") as caught:
        reset_early(Around(monitor), 3)
    assert len(caught) == 1
    assert len(monitor.stl_episodes) == 1 + 3 * (2 + 1)


class Limit(ParallelWrapper):
    """Truncates the episodes of several agents after a step."""

    def __init__(self, env: Any) -> None:
        self.env = env

    def reset(self, **options: Any) -> Any:
        return self.env.reset(**options)

    def step(self, actions: Any) -> Any:
        obs, rewards, terminations, _, infos = self.env.step(actions)
        return obs, rewards, terminations, dict.fromkeys(actions, True), infos


def test_wrapper_around_several_agents_is_warned_about_once() -> None:
    crew = Crew({"one": SERIES, "two": SERIES})
    monitor = ParallelStlMonitor(crew, SPEC, {"x": "one: obs[0]"})
    env = Limit(monitor)

    def run(times: int) -> Any:
        for _ in range(times):
            env.reset()
            *_, infos = env.step({"one": ACTION, "two": ACTION})
        return infos

    with pytest.warns(UnseenEndWarning, match="Limit around ParallelStlMonitor") as caught:
        infos = run(3)
    assert len(caught) == 1
    assert "is_success" not in infos["one"]
    assert len(monitor.stl_episodes) == 2
