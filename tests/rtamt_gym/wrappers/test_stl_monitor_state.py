"""`StlMonitor` between episodes and processes: reset, copies, pickles, callables, errors midway."""

from __future__ import annotations

import json
import math
import pickle
from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from replay import Replay, X, run

from rtamt.errors import InputError, StateError
from rtamt_gym import Step, StlMonitor
from rtamt_gym.options.evaluation import View


def test_a_step_outside_an_episode_is_refused() -> None:
    env = StlMonitor(Replay([3, 3, 3]), "always(x > 1)", X)
    for _ in range(2):
        with pytest.raises(StateError) as caught:
            env.step(np.array([0.5]))
        assert str(caught.value) == (
            "expected a running episode, got step() before reset() or after the end of the "
            "episode; call reset()"
        )
        run(env)


@pytest.mark.parametrize("view", ["episode", "step"])
def test_a_nan_may_keep_the_last_value(view: View) -> None:
    text = "x > 1 implies eventually[0:2](x < 1)"
    text = f"always({text})" if view == "episode" else text
    gaps, filled = [3, math.nan, 2, math.nan, 0, 4, math.nan], [3, 3, 2, 2, 0, 4, 4]
    held = run(StlMonitor(Replay(gaps), text, X, period=1, view=view, nan="hold", details=True))
    whole = run(StlMonitor(Replay(filled), text, X, period=1, view=view, details=True))
    assert data_equivalence(held, whole, exact=True)


def test_a_nan_at_reset_has_no_last_value() -> None:
    env = StlMonitor(Replay([math.nan, 3]), "always(x > 1)", X, nan="hold")
    with pytest.raises(InputError) as caught:
        env.reset()
    assert str(caught.value) == (
        "variable 'x' is nan at sample 0; nan='hold' keeps the last value, and the first sample "
        "has none"
    )


def test_an_episode_with_a_sample_that_is_nan_is_over() -> None:
    env = StlMonitor(Replay([3, math.nan, 3]), "always(x > 1)", X)
    env.reset()
    with pytest.raises(InputError) as caught:
        env.step(np.array([0.5]))
    assert str(caught.value) == (
        "variable 'x' is nan at sample 1; pass nan='hold' to keep the last value instead"
    )
    with pytest.raises(StateError):
        env.step(np.array([0.5]))
    env.reset()
    assert env.samples == 1


def test_a_period_that_the_environment_changes_is_noticed_at_reset() -> None:
    env = gym.make("Pendulum-v1")
    monitor = StlMonitor(env, "always[0:1](c > -2)", {"c": "obs[0]"})
    monitor.reset()
    simulation: Any = env.unwrapped
    simulation.dt = 0.1
    with pytest.raises(StateError) as caught:
        monitor.reset()
    assert str(caught.value) == (
        "expected the period of 0.05 s that <PendulumEnv<Pendulum-v1>> had at construction, "
        "got 0.1 s; wrap it again, or give period="
    )


def height(step: Step) -> float:
    return float(step.obs[0]) + (0.0 if step.action is None else float(step.action[0]))


def test_a_callable_signal_is_read_once_a_sample_for_all_specifications() -> None:
    calls = []

    def count(step: Step) -> float:
        calls.append(step.reward)
        return 1.0

    run(StlMonitor(Replay([3, 3, 3]), {"a": "always(x > 0)", "b": "always(x < 2)"}, {"x": count}))
    assert calls == [None, 1.0, 2.0]


def test_an_importable_callable_is_pickled_and_made_again_but_not_written_as_json() -> None:
    gym.register("Replay-v0", entry_point="replay:Replay", kwargs={"values": [1, 2, 3]})
    try:
        env = StlMonitor(
            gym.make("Replay-v0", disable_env_checker=True), "always(x > 0)", {"x": height}
        )
        assert data_equivalence(run(pickle.loads(pickle.dumps(env))), run(env), exact=True)
        assert env.spec is not None
        assert data_equivalence(run(gym.make(env.spec)), run(env), exact=True)
        outer = gym.wrappers.TimeLimit(env, 2)
        for spec in (env.spec, outer.spec):
            assert spec is not None
            with pytest.raises(InputError) as caught:
                spec.to_json()
            assert str(caught.value) == (
                "signal 'x' is a callable, which JSON cannot hold; use a selector such as "
                '"obs[0]", or pass env.spec itself to gym.make'
            )
    finally:
        del gym.registry["Replay-v0"]


def test_a_record_and_the_last_info_are_not_shared() -> None:
    env = StlMonitor(Replay([3, 2, 4]), {"dry": "always(x > 1)", "there": "eventually(x > 4)"}, X)
    last = run(env)[-1]
    last["stl_episode"]["dry"].clear()
    assert env.stl_episodes[-1]["specs"]["dry"]["robustness"] == 1.0


def test_a_record_is_json_whatever_booleans_the_environment_ends_with() -> None:
    class Numpy(Replay):
        def step(self, action: object) -> Any:
            obs, reward, terminated, truncated, info = super().step(action)
            return obs, reward, np.bool_(terminated), np.bool_(truncated), info

    env = StlMonitor(Numpy([3, 3], "truncated"), "always(x > 0)", X)
    run(env)
    (written,) = json.loads(json.dumps(list(env.stl_episodes)))
    assert (written["terminated"], written["truncated"]) == (False, True)


def test_the_record_keeps_the_newest_episodes() -> None:
    replay = Replay([3, 3])
    env = StlMonitor(replay, "always(x > 0)", X, buffer_length=2)
    for length in (2, 3, 4):
        replay.values = [3] * length
        run(env)
    assert [episode["samples"] for episode in env.stl_episodes] == [3, 4]
    assert list(deepcopy(env).stl_episodes) == list(env.stl_episodes)
    assert list(pickle.loads(pickle.dumps(env)).stl_episodes) == list(env.stl_episodes)
