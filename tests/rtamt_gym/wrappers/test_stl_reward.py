"""`StlReward`: the rewards of every mode, the appended observations, and errors."""

from __future__ import annotations

import inspect
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.wrappers import FlattenObservation, TimeLimit
from replay import Replay, X, shaping_options

from rtamt.errors import InputError
from rtamt_gym import StlMonitor, StlReward
from rtamt_gym.shaping import Mode
from rtamt_gym.wrappers.monitoring import OnViolation
from rtamt_gym.wrappers.reward import StlMonitorOptions

MODES: tuple[Mode, ...] = ("add", "replace", "potential", "terminal", "hierarchical")

modes = pytest.mark.parametrize("mode", MODES)

FALLING = [1.5, 1.25, 1.75, 0.5]
"""Robustness of always(x > 1), clipped to 1: 0.5, 0.25, 0.25, -0.5; the rewards are 1, 2, 3."""


def rewards(env: gym.Env[Any, Any]) -> list[float]:
    """Return the rewards of one episode, step by step."""
    env.reset(seed=1)
    paid: list[float] = []
    ended = False
    while not ended:
        _, reward, terminated, truncated, info = env.step(np.array([0.5]))
        assert type(reward) is type(info["reward"]) is np.float64
        paid.append(reward)
        ended = terminated or truncated
    return paid


@pytest.mark.parametrize(
    ("mode", "end", "expected"),
    [
        ("add", "terminated", [1.5, 2.5, 2.0]),
        ("replace", "terminated", [0.25, 0.25, -0.5]),
        ("potential", "terminated", [1 - 0.75, 2 - 0.25, 3 - 0.5]),
        ("potential", "truncated", [1 - 0.75, 2 - 0.25, 3 - 1.0]),
        ("terminal", "terminated", [1.0, 2.0, 2.0]),
        ("terminal", "truncated", [1.0, 2.0, 2.0]),
        ("hierarchical", "terminated", [0.25, 0.25, -0.5]),
    ],
)
def test_every_mode_pays_by_its_formula(mode: Mode, end: str, expected: list[float]) -> None:
    env = StlReward(
        Replay(FALLING, end),
        "always(x > 1)",
        X,
        **shaping_options(mode, "spec"),
        weight=2.0,
        gamma=0.5,
        on_violation="report",
    )
    assert rewards(env) == expected
    assert rewards(env) == expected


@pytest.mark.parametrize(
    ("how", "last"), [("terminate", 3 - 2 * 0.25), ("truncate", 3 + 2 * (0.5 * -0.5 - 0.25))]
)
def test_a_potential_ends_with_the_monitors_own_termination_and_stays_at_its_truncation(
    how: OnViolation, last: float
) -> None:
    env = StlReward(
        Replay([*FALLING, 9, 9]),
        "always(x > 1)",
        X,
        mode="potential",
        weight=2.0,
        gamma=0.5,
        on_violation=how,
    )
    assert rewards(env)[2:] == [last]


def test_the_reward_of_the_environment_stays_in_the_info() -> None:
    env = StlReward(Replay([3, 2, 4]), "always(x > 1)", X, mode="replace")
    _, info = env.reset()
    assert "reward" not in info
    assert env.step(np.array([0.5]))[4]["reward"] == 1.0
    _, reward, _, _, info = env.step(np.array([0.5]))
    assert (reward, info["reward"], info["own"]) == (1.0, 2.0, 1)
    assert info["stl_episode"]["spec"]["satisfied"] is True


def test_an_infinite_robustness_pays_no_more_than_the_clip() -> None:
    env = StlReward(
        Replay([0, 0, 0, 3]), "eventually[2:9](x > 1)", X, mode="replace", clip=1.5, period=1
    )
    # The window is empty at samples 0 and 1.
    assert rewards(env) == [-1.5, -1.0, 1.5]


def test_of_several_specifications_the_weighted_least_is_paid() -> None:
    specs = {"low": "always(x < 10)", "high": "always(x > 1)"}
    env = StlReward(Replay([9.5, 9.5, 1.5]), specs, X, mode="replace", clip=5, weights={"low": 8})
    assert rewards(env) == [4.0, 0.5]


def test_a_smooth_minimum_listens_to_every_specification() -> None:
    specs = {"low": "always(x < 10)", "high": "always(x > 1)"}
    env = StlReward(Replay([2, 2]), specs, X, mode="replace", clip=9, temperature=2.0)
    assert rewards(env) == [pytest.approx(-2 * np.log(np.exp(-8 / 2) + np.exp(-1 / 2)))]


def test_safety_comes_before_target_before_comfort() -> None:
    specs = {"gentle": "always(abs(u) < 0.6)", "there": "eventually(x > 3)", "dry": "always(x > 0)"}
    signals = {"u": ("action[0]", 0.0), **X}
    env = StlReward(
        Replay([0.5, 2.5, 3.5, -0.25]),
        specs,
        signals,
        mode="hierarchical",
        priorities={"dry": "safety", "there": "target", "gentle": "comfort"},
        on_violation="report",
    )
    # Dry and moving; arrived, and gentle by 0.1; wet.
    assert rewards(env) == [0.5, pytest.approx(2.1), -0.25]


def test_the_step_view_pays_every_instant_and_its_terminal_mode_the_whole() -> None:
    def env(mode: Mode) -> StlReward[Any, Any]:
        return StlReward(
            Replay([1.5, 0.75, 1.75]), "x > 1", X, mode=mode, view="step", on_violation="report"
        )

    assert rewards(env("replace")) == [-0.25, 0.75]
    assert rewards(env("terminal")) == [1.0, 2.0 - 0.25]


# ---- the monitor ----


@modes
def test_a_monitor_that_is_there_is_used(mode: Mode) -> None:
    monitor = StlMonitor(Replay(FALLING), "always(x > 1)", X)
    outer = TimeLimit(monitor, 99)
    env = StlReward(outer, **shaping_options(mode, "spec"))
    assert env.env is outer
    alone = StlReward(Replay(FALLING), "always(x > 1)", X, **shaping_options(mode, "spec"))
    assert isinstance(alone.env, StlMonitor)
    assert rewards(env) == rewards(alone)
    assert monitor.samples == env.samples == 4
    assert env.stl_episodes is monitor.stl_episodes
    assert env.stl_episodes == alone.stl_episodes


def test_the_arguments_of_the_monitor_are_those_of_the_reward() -> None:
    options = {
        name
        for name, parameter in inspect.signature(StlMonitor).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY
    }
    # The observation, and its bounds, are arguments of both.
    assert options == set(StlMonitorOptions.__annotations__) | {"observe", "clip"}


@modes
def test_always_never_succeeds_before_the_end(mode: Mode) -> None:
    env = StlReward(
        TimeLimit(Replay([3.0] * 99), 50),
        "always(x > 1)",
        X,
        details=True,
        **shaping_options(mode, "spec"),
    )
    env.reset()
    for step in range(1, 51):
        _, _, terminated, truncated, info = env.step(np.array([0.5]))
        assert (terminated, truncated) == (False, step == 50)
        assert info["stl"]["spec"]["verdict"] == ("SATISFIED" if truncated else "UNDECIDED")
        assert ("is_success" in info) is truncated


def balanced(obs: Any) -> int:
    place, speed, angle, turn = obs
    return int(0.1 * place + 0.3 * speed + 3.0 * angle + turn > 0.0)


@modes
def test_a_balanced_pole_earns_more_than_a_fall(mode: Mode) -> None:
    env = StlReward(
        gym.make("CartPole-v1"),
        "always(abs(theta) < 0.2095)",
        {"theta": "obs[2]"},
        **shaping_options(mode, "spec"),
    )
    lengths, totals = [], []
    for falls in (False, True):
        obs, _ = env.reset(seed=3)
        total, steps, ended = 0.0, 0, False
        while not ended:
            obs, reward, terminated, truncated, _ = env.step(1 if falls else balanced(obs))
            total, steps, ended = total + float(reward), steps + 1, terminated or truncated
        lengths.append(steps)
        totals.append(total)
    assert lengths[0] == 500
    assert lengths[1] < 12
    assert totals[0] > totals[1]
    assert [episode["truncated"] for episode in env.stl_episodes] == [True, False]


# ---- observe="state" ----


def observed(env: gym.Env[Any, Any]) -> list[Any]:
    observations = [env.reset()[0]]
    ended = False
    while not ended:
        obs, _, terminated, truncated, _ = env.step(np.array([0.5]))
        observations.append(obs)
        ended = terminated or truncated
    assert all(env.observation_space.contains(obs) for obs in observations)
    return observations


SPECS = {"dry": "always(x > 1)", "there": "eventually[0:4](x > 5)"}


class Places(gym.ObservationWrapper[Any, Any, Any]):
    """Has the observation in a dictionary with unsorted keys."""

    def __init__(self, env: gym.Env[Any, Any], key: str = "z") -> None:
        super().__init__(env)
        self.key = key
        box = env.observation_space
        self.observation_space = spaces.Dict([(key, box), ("a", spaces.Discrete(3))])

    def observation(self, observation: Any) -> Any:
        return {self.key: observation, "a": 1}


def test_the_state_of_the_monitor_is_a_key_of_a_dictionary() -> None:
    signals = {"x": "obs['z'][0]"}
    env = StlReward(
        Places(Replay([3, 1.5])), SPECS, signals, mode="add", clip=2.0, observe="state", period=1
    )
    space = env.observation_space
    assert isinstance(space, spaces.Dict)
    assert list(space.spaces) == ["z", "a", "stl"]
    assert space["stl"].dtype == np.float32
    last = observed(env)[-1]
    assert last["z"].tolist() == [1.5]
    # The environment ended: goals that were not reached in time are violated.
    assert last["stl"].tolist() == [0.5, 0.5, 0.5, 1.0, 1.0, -2.0, -2.0, -2.0, 0.75, -1.0]


def test_flattened_observations_of_any_kind_grow() -> None:
    inner = StlMonitor(Places(Replay([3, 1.5])), "always(x > 1)", {"x": "obs['z'][0]"})
    env = StlReward(FlattenObservation(inner), mode="add", observe="state")
    assert env.observation_space.shape == (9,)
    assert observed(env)[-1].tolist() == [1.5, 0.0, 1.0, 0.0, 0.5, 0.5, 0.5, 1.0, 1.0]


def test_integers_become_floats() -> None:
    inner = StlMonitor(gym.make("FrozenLake-v1"), "always(s < 99)", {"s": "obs"})
    env = StlReward(FlattenObservation(inner), mode="add", observe="state")
    obs, _ = env.reset()
    assert obs.dtype == env.observation_space.dtype == np.float64
    assert obs.shape == (21,)
    assert env.observation_space.contains(obs)


def test_a_clip_that_float32_rounds_stays_inside_of_the_space() -> None:
    env = StlReward(
        gym.make("CartPole-v1"),
        "always(abs(theta) < 2)",
        {"theta": "obs[2]"},
        mode="add",
        clip=0.1,
        observe="state",
    )
    obs, _ = env.reset(seed=1)
    assert obs.dtype == np.float32
    assert obs[4] == np.float32(0.1)
    assert env.observation_space.contains(obs)


def test_the_terminal_mode_of_the_step_view_shows_what_it_pays() -> None:
    env = StlReward(
        Replay([1.5, 0.75, 1.75]),
        "x > 1",
        X,
        mode="terminal",
        view="step",
        on_violation="report",
        observe="state",
    )
    assert [obs[1] for obs in observed(env)] == [0.5, -0.25, -0.25]


def refused(env: gym.Env[Any, Any], **arguments: Any) -> str:
    with pytest.raises(InputError) as caught:
        StlReward(env, **{"mode": "add", **arguments})
    return str(caught.value)


def test_observations_that_cannot_grow_are_refused() -> None:
    given = {"specs": "always(s < 9)", "signals": {"s": "obs"}, "observe": "state"}
    assert refused(gym.make("FrozenLake-v1"), **given) == (
        "expected observations as a Box of one dimension or a Dict for observe='state', got "
        "Discrete(16); flatten them first: gymnasium.wrappers.FlattenObservation"
    )
    given = {"specs": "always(x > 1)", "signals": {"x": "obs['stl'][0]"}, "observe": "state"}
    assert refused(Places(Replay([1]), "stl"), **given) == (
        "expected an observation space without the key 'stl', where the monitor puts its state; "
        "rename it"
    )
    assert refused(Replay([1]), specs="always(x > 1)", signals=X, observe="all") == (
        "expected observe=None, 'state' or 'obligations', got 'all'"
    )
