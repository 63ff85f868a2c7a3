"""An environment with a monitor is a system: its samples are judged, and it ends no episode."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import pytest
from walks import SIGNALS, SPECS, Walk, acts

from rtamt import InputError
from rtamt_gym import Parameter, StlMonitor, StlReward, falsify, simulate, sweep

ENDS: Any = {"at_termination": "cut", "at_truncation": "complete"}


def plain(seed: int, **options: Any) -> Any:  # noqa: ANN401
    act = acts()
    return simulate(Walk(), SPECS, SIGNALS, policy=act, seed=seed, stop="end", **ENDS, **options)


def monitored(kind: str) -> Any:  # noqa: ANN401
    env: Any
    match kind:
        case "monitor":
            return StlMonitor(Walk(), SPECS, SIGNALS, **ENDS)
        case "reward":
            env = StlReward(Walk(), SPECS, SIGNALS, mode="replace", observe="state", **ENDS)
            return gym.wrappers.TransformReward(env, lambda reward: 10.0 * float(reward))
        case _:
            env = StlMonitor(Walk(), SPECS, SIGNALS, on_satisfaction="truncate", **ENDS)
            return gym.wrappers.TransformObservation(env, lambda obs: obs * 1, None)


@pytest.mark.parametrize("kind", ["monitor", "reward", "satisfied"])
def test_a_run_is_that_of_the_environment_without_the_monitor(kind: str) -> None:
    env = monitored(kind)
    violated = 0
    for seed in range(12):
        run = simulate(env, policy=acts(), seed=seed, stop="end")
        assert run == plain(seed)  # also its signals, histories and return
        violated += run.violated_by is not None
    assert violated > 2


def test_the_monitor_is_as_before_afterwards_even_after_an_error() -> None:
    env = StlMonitor(Walk(cursed=5), SPECS, SIGNALS, **ENDS)
    inside = env.env
    with pytest.raises(ValueError, match="a cursed step"):
        simulate(env, policy=acts(), seed=5, stop="end")
    assert env.env is inside
    env.reset(seed=1)
    terminated = False
    while not terminated:
        *_, terminated, _, info = env.step(2)
    assert info["stl_violated_by"] == "low"


def test_specifications_that_are_given_read_what_the_monitor_reads() -> None:
    env = monitored("reward")
    run = simulate(env, {"p": "always(x < 0.5)"}, policy=acts(), seed=2, stop="end", **ENDS)
    expected = simulate(
        Walk(), {"p": "always(x < 0.5)"}, SIGNALS, policy=acts(), seed=2, stop="end", **ENDS
    )
    assert run.histories == expected.histories
    assert run.reward == expected.reward


def test_an_option_that_the_monitor_has_is_refused() -> None:
    with pytest.raises(InputError) as refused:
        simulate(monitored("monitor"), policy=acts(), view="step")
    assert str(refused.value) == (
        "view= comes from the monitor of the environment, which has 'episode', got 'step'; leave "
        "it out, or give specifications with it"
    )


def test_other_signals_than_the_monitor_has_are_refused() -> None:
    with pytest.raises(InputError) as refused:
        simulate(monitored("monitor"), None, {"x": "obs[1]"}, policy=acts())
    message = str(refused.value)
    assert message.startswith("signals= comes from the monitor of the environment, which has ")
    assert message.endswith("leave it out, or give specifications with it")


def test_a_sweep_takes_a_monitored_environment() -> None:
    env = StlMonitor(Walk(), SPECS, SIGNALS, **ENDS)
    goals = [Parameter("env._goal", 0.5, 3)]
    result = sweep(env, space=goals, samples=4, policy=lambda _: 2, progress=False)
    expected = sweep(
        Walk(), SPECS, goals, samples=4, policy=lambda _: 2, signals=SIGNALS, progress=False, **ENDS
    )
    assert result.record == expected.record


def test_a_search_takes_a_monitored_environment() -> None:
    goals = [Parameter("env._goal", 0.5, 3)]
    options: Any = {"space": goals, "budget": 20, "policy": lambda _: 2}
    result = falsify(StlMonitor(Walk(), SPECS, SIGNALS, **ENDS), **options)
    expected = falsify(Walk(), SPECS, signals=SIGNALS, **options, **ENDS)
    assert result.record == expected.record
    assert result.input == expected.input
