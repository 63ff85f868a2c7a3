"""`VectorStlMonitor` with other vector environments, other wrappers, and copies."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics
from replay import Replay, X
from vector_environments import (
    ANGLE,
    MODES,
    TEXT,
    Envs,
    difference,
    make_monitored_pole,
    make_pole,
    native,
    sync,
    trajectory,
)

from rtamt import InputError, StateError
from rtamt_gym import StlMonitor, VectorStlMonitor


def replays(*series: Sequence[float]) -> list[Callable[[], Replay]]:
    return [functools.partial(Replay, values) for values in series]


# ---- asynchronous environments ----


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_asynchronous_environments_say_what_synchronous_ones_say(mode: AutoresetMode) -> None:
    asynchronous = AsyncVectorEnv([make_pole] * 2, context="forkserver", autoreset_mode=mode)
    envs = VectorStlMonitor(asynchronous, TEXT, ANGLE, period=0.02)
    shown = trajectory(envs, 40)
    envs.close()
    assert difference(shown, trajectory(sync([make_monitored_pole] * 2, mode), 40)) == ""


# ---- environments that keep to fewer rules ----


class Bare(VectorEnv[Any, Any, Any]):
    """Counts up to 3 in every environment: no masks of keys, batches only at the end."""

    def __init__(self, mode: AutoresetMode | None, *, ends: bool = True) -> None:
        self.metadata = {} if mode is None else {"autoreset_mode": mode}
        self.num_envs = 2
        self.single_observation_space = spaces.Dict({"x": spaces.Box(-9, 9, (1,))})
        self.observation_space = batch_space(self.single_observation_space, 2)
        self.single_action_space = spaces.Discrete(2)
        self.action_space = batch_space(self.single_action_space, 2)
        self.ends = ends
        self.mode = mode

    def __str__(self) -> str:
        return "<Bare>"

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ARG002
        self.at = np.array([0.0, 1.0])
        return self.shown(), {"speed": self.at.copy()}

    def step(self, actions: Any) -> Any:  # noqa: ARG002
        self.at = np.where(self.at == 3, 0, self.at + 1)
        ended = self.at == 3
        infos: dict[str, Any] = {"speed": self.at.copy()}
        if self.mode is AutoresetMode.SAME_STEP and self.ends:
            infos["final_obs"] = self.shown()
        if self.mode is AutoresetMode.SAME_STEP:
            self.at[ended] = 0
        return self.shown(), np.ones(2), ended, np.zeros(2, np.bool_), infos

    def shown(self) -> dict[str, Any]:
        return {"x": self.at[:, None].astype(np.float32)}


SPEED = {"x": "obs['x'][0]", "v": ("info['speed']", 0.0)}


def test_masks_of_keys_are_not_needed_and_a_missing_mode_is_that_of_the_next_step() -> None:
    with pytest.warns(UserWarning, match=r"<Bare> has no metadata\['autoreset_mode'\]"):
        envs = VectorStlMonitor(Bare(None), "always(x + v < 5)", SPEED)
    _, infos = envs.reset()
    assert infos["robustness"].tolist() == [5, 3]
    assert "_speed" not in infos
    result = [envs.step(np.zeros(2))[-1] for _ in range(4)]
    assert [item["robustness"].tolist() for item in result] == [[3, 1], [1, -1], [-1, 5], [5, 3]]
    assert result[2]["stl_violated_at"].tolist() == [3, 0]
    assert envs.samples.tolist() == [1, 2]
    assert [(item["env"], item["samples"]) for item in envs.stl_episodes] == [(1, 3), (0, 4)]


def test_terminal_observations_may_come_as_a_batch() -> None:
    envs = VectorStlMonitor(
        Bare(AutoresetMode.SAME_STEP), "always(x < 2.5)", {"x": "obs['x'][0]"}, buffer_length=1
    )
    envs.reset()
    envs.step(np.zeros(2))
    infos = envs.step(np.zeros(2))[-1]
    assert infos["final_info"]["robustness"].tolist() == [0, -0.5]
    assert infos["final_info"]["_robustness"].tolist() == [False, True]
    assert infos["robustness"].tolist() == [0.5, 2.5]
    assert [item["robustness"] for item in envs.stl_episodes[0]["specs"].values()] == [-0.5]


def test_what_is_observed_is_appended_to_a_batch_of_terminal_observations_too() -> None:
    envs = VectorStlMonitor(
        Bare(AutoresetMode.SAME_STEP),
        "always(x < 2.5)",
        {"x": "obs['x'][0]"},
        observe="state",
        clip=3.0,
    )
    obs, _ = envs.reset()
    assert envs.observation_space.contains(obs)
    envs.step(np.zeros(2))
    obs, *_, infos = envs.step(np.zeros(2))
    assert infos["final_obs"].keys() == obs.keys()
    assert infos["final_obs"]["x"].tolist() == [[2], [3]]
    # robustness, lower, upper, the time that is left, and the verdict
    (name,) = obs.keys() - {"x"}
    assert infos["final_obs"][name][1].tolist() == [-0.5, -0.5, -0.5, 1, -1]
    assert obs[name].tolist() == [[0.5, -3, 0.5, 1, 0], [2.5, -3, 2.5, 1, 0]]


def test_an_environment_without_terminal_observations_is_refused_at_the_first_end() -> None:
    envs = VectorStlMonitor(
        Bare(AutoresetMode.SAME_STEP, ends=False), "always(x < 9)", {"x": "obs['x'][0]"}
    )
    envs.reset()
    envs.step(np.zeros(2))
    with pytest.raises(ValueError, match="final_obs") as caught:
        envs.step(np.zeros(2))
    assert str(caught.value) == (
        "expected the observations at the ends of episodes in infos['final_obs'], as "
        "AutoresetMode.SAME_STEP has them, got the keys 'speed'"
    )


def test_monitors_in_other_processes_are_found_at_the_first_reset() -> None:
    envs = VectorStlMonitor(AsyncVectorEnv([make_monitored_pole] * 2), TEXT, ANGLE)
    try:
        with pytest.raises(InputError, match="StlMonitor around each of its environments"):
            envs.reset(seed=1)
    finally:
        envs.close()


# ---- resets ----


def test_a_masked_reset_touches_only_the_environments_of_the_mask() -> None:
    mode = AutoresetMode.DISABLED
    envs = VectorStlMonitor(sync(replays([3, 2, 1, 0], [5, 6, 7, 8]), mode), "always(x > 1)", X)
    envs.reset()
    actions = np.zeros((2, 1))
    envs.step(actions)
    envs.step(actions)
    _, infos = envs.reset(options={"reset_mask": np.array([True, False])})
    assert envs.samples.tolist() == [1, 3]
    assert infos["robustness"].tolist() == [2, 0]
    assert infos["_robustness"].tolist() == [True, False]
    infos = envs.step(actions)[-1]
    assert infos["robustness"].tolist() == [1, 4]
    assert infos["stl_episode"]["_spec"].tolist() == [False, True]
    with pytest.raises(StateError) as caught:
        envs.step(actions)
    assert str(caught.value) == (
        "expected running episodes, got step() after the end of the episode of environment 1; "
        "call reset(options={'reset_mask': mask}), with a mask that is true for ended episodes"
    )
    envs.reset(options={"reset_mask": np.array([False, True])})
    assert envs.step(actions)[-1]["robustness"].tolist() == [0, 4]


def test_an_environment_that_resets_more_than_it_was_told_is_found_out() -> None:
    envs = VectorStlMonitor(native(3), "always(abs(theta) < 0.2)", ANGLE)
    envs.reset(seed=1)
    envs.step(np.zeros(3, np.int64))
    with pytest.raises(StateError) as caught:
        envs.reset(options={"reset_mask": np.array([True, False, True])})
    assert str(caught.value) == (
        "expected a reset of the environments in reset_mask only, but "
        "CartPoleVectorEnv(CartPole-v1, num_envs=3) also reset environment 1, because it ignores "
        "reset_mask; reset all, or use gym.make_vec(..., vectorization_mode='sync')"
    )
    with pytest.raises(StateError):
        envs.step(np.zeros(3, np.int64))
    envs.reset()
    assert envs.samples.tolist() == [1, 1, 1]


def test_seeds_and_options_pass_through_and_the_callers_options_stay_as_they_are() -> None:
    seen: list[Any] = []

    class Noting(Replay):
        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            seen.append((seed, options))
            return super().reset(seed=seed)

    makes = [functools.partial(Noting, [3.0, 3, 3])] * 2
    envs = VectorStlMonitor(sync(makes, AutoresetMode.DISABLED), "always(x > 1)", X)
    envs.reset(seed=[4, None], options={"far": 1})
    options = {"far": 2, "reset_mask": np.array([False, True])}
    envs.reset(seed=8, options=options)
    assert seen == [(4, {"far": 1}), (None, {"far": 1}), (9, {"far": 2})]
    assert options.keys() == {"far", "reset_mask"}
    outer = RecordEpisodeStatistics(envs)
    outer.reset()
    outer.step(np.zeros((2, 1)))
    outer.reset(options={"reset_mask": np.array([False, True])})
    assert outer.episode_lengths.tolist() == [1, 0]


def test_a_period_that_the_environments_change_is_noticed_at_reset() -> None:
    bare: Any = native(2)
    envs = VectorStlMonitor(bare, TEXT, ANGLE)
    envs.reset()
    bare.tau = 0.01
    with pytest.raises(StateError) as caught:
        envs.reset()
    assert str(caught.value) == (
        "expected the period of 0.02 s that CartPoleVectorEnv(CartPole-v1, num_envs=2) had at "
        "construction, got 0.01 s; wrap it again, or give period="
    )


# ---- other wrappers, copies ----


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_infos_become_the_list_that_single_environments_give(mode: AutoresetMode) -> None:
    makes = replays([3, 2, 0, 4], [3, 3])
    lists: list[list[Any]] = []
    for wrap in (True, False):
        inner = [make if wrap else functools.partial(one_by_one, make) for make in makes]
        envs: Envs = sync(inner, mode)
        if wrap:
            envs = VectorStlMonitor(envs, "always(x > 1)", X, details=True)
        shown = trajectory(DictInfoToList(envs), 9)
        lists.append([row[-1] for row in shown])
    assert difference(lists[0], lists[1]) == ""


def one_by_one(make: Callable[[], Replay]) -> gym.Env[Any, Any]:
    return StlMonitor(make(), "always(x > 1)", X, details=True, on_violation="report")


def test_the_buffer_keeps_the_newest_episodes() -> None:
    makes = replays([3, 2], [3, 3, 3, 3], [3, 4])
    envs = VectorStlMonitor(
        sync(makes, AutoresetMode.SAME_STEP), "always(x > 1)", X, buffer_length=4
    )
    trajectory(envs, 6)
    assert [item["env"] for item in envs.stl_episodes] == [2, 0, 1, 2]
    assert len(envs._episodes._steps) == 2
    nothing = VectorStlMonitor(
        sync(makes, AutoresetMode.SAME_STEP), "always(x > 1)", X, buffer_length=0
    )
    trajectory(nothing, 6)
    assert len(nothing.stl_episodes) == len(nothing._episodes._steps) == 0
