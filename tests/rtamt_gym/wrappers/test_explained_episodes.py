"""`StlMonitor(history=True).explain()` explains the episode so far like a run of its samples."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES, Case, rollout
from replay import Replay, X, run

import rtamt
from rtamt import InputError, StateError
from rtamt_gym import EvaluationOptions, StlMonitor, StlReward, simulate
from rtamt_gym.judging.monitor_set import MonitorSet
from rtamt_gym.options.evaluation import View

STEPS = 12


def recorded(case: Case, seed: int, **options: Any) -> Any:
    """Return the run of the same random actions, which `simulate` records by itself."""
    env = case.bare()
    space = deepcopy(env.action_space)  # highway-env draws from its own at reset
    space.seed(seed)
    limited = gym.wrappers.TimeLimit(env, STEPS)
    return simulate(
        limited, case.specs, case.signals, policy=lambda _: space.sample(), seed=seed, **options
    )


QUICK = [case for case in CASES if "fast" not in case.env_id]


@pytest.mark.slow(keep=2)
@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.env_id.split(":")[-1])
def test_an_episode_is_explained_as_the_run_of_its_samples(case: Case) -> None:
    env: Any = case.monitored(history=True)
    for seed in (7, 8):
        rollout(env, seed=seed, steps=STEPS)
        expected = recorded(case, seed)
        for name in expected.histories:
            assert env.explain(name) == expected.explain(name)
        assert env.explain() == expected.explain()
        assert max(map(len, str(env.explain()).splitlines())) <= 80


@pytest.mark.slow(keep=2)
@pytest.mark.parametrize(
    ("env_id", "selector"),
    [("HalfCheetah-v5", "qvel[1]"), ("highway_env:highway-fast-v0", "vehicle.speed")],
)
@pytest.mark.parametrize("view", ["episode", "step"])
def test_a_sample_inside_of_a_step_is_named(env_id: str, selector: str, view: View) -> None:
    formula = "x < 0.5 or eventually[0:0.1](x > 1)" if "Cheetah" in env_id else "x < 21"
    spec = f"always({formula})" if view == "episode" else formula
    case = Case(env_id, {"limit": spec}, {"x": selector})
    options: dict[str, Any] = {"substeps": True, "view": view, "align": "outward"}
    env: Any = case.monitored(history=True, on_violation="report", **options)
    rollout(env, steps=STEPS)
    expected = recorded(case, 7, stop="end", **options)
    assert env.samples == expected.steps + 1
    assert env.explain() == expected.explain()
    assert env.explain().steps[-1].time == env.explain().steps[-1].sample * float(env.period)


@pytest.mark.parametrize("view", ["episode", "step"])
def test_every_prefix_is_explained_and_a_reset_forgets_it(view: View) -> None:
    values = [3.0, 0.5, 4.0, -2.0, 1.5]
    spec = "x > 1 or x < -3"
    spec = f"always({spec})" if view == "episode" else spec
    env = StlMonitor(
        Replay(values), spec, X, view=view, on_violation="report", history=True, period=1
    )
    for _ in range(2):
        env.reset()
        for i in range(len(values)):
            if i:
                env.step(np.array([0.0]))
            trace = {"x": values[: i + 1]}
            expected = rtamt.explain("always(x > 1 or x < -3)", trace, 1)
            result = env.explain()
            assert (result.robustness, result.causes) == (expected.robustness, expected.causes)
            assert [step.sample for step in result.steps] == [s.sample for s in expected.steps]


def test_in_the_view_of_steps_the_formula_has_the_name_of_the_specification() -> None:
    env = StlMonitor(
        Replay([3, 0, 2]), {"low": "x > 1"}, X, view="step", on_violation="report", history=True
    )
    run(env)
    assert str(env.explain()).splitlines()[3:] == [
        "sample 0     -1  always(x > 1)",
        "sample 1     -1  low = x > 1",
        "sample 1      0  x",
    ]


def test_what_was_violated_first_is_explained_else_the_worst() -> None:
    specs = {"a": "always(x < 9)", "b": "always(x > 1)", "c": "always(x > 2)"}
    env = StlMonitor(Replay([3, 1.5, 0, 4]), specs, X, on_violation="report", history=True)
    env.reset()
    assert env.explain().steps[0].name == "c"
    run(env)
    assert env.explain().steps[0].name == "c"
    assert env.explain("b").causes == (("x", 2, 0.0),)
    with pytest.raises(InputError) as refused:
        env.explain("d")
    assert str(refused.value) == (
        "expected the name of a specification, got 'd'; the specifications are 'a', 'b', 'c'"
    )


@pytest.mark.parametrize("clone", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_explains_the_samples_before_and_after_it(clone: Callable[[Any], Any]) -> None:
    env = StlMonitor(
        Replay([3, 0.5, 4, 0, 2]), "always(x > 1)", X, on_violation="report", history=True
    )
    env.reset()
    env.step(np.array([0.0]))
    copy = clone(env)
    assert copy.explain() == env.explain()
    for _ in range(2):
        copy.step(np.array([0.0]))
    assert copy.explain().causes == (("x", 3, 0.0),)
    assert env.explain().causes == (("x", 1, 0.5),)


def test_held_values_are_explained() -> None:
    env = StlMonitor(
        Replay([3, 0.5, np.nan, 2]), "always[2:3](x > 1)", X, nan="hold", period=1, history=True
    )
    run(env)
    assert env.explain().causes == (("x", 2, 0.5),)


def test_a_wrapper_around_finds_the_explanation_and_an_environment_is_made_again_with_it() -> None:
    env: Any = StlReward(
        gym.make("CartPole-v1"), "always(abs(x) < 1)", {"x": "obs[0]"}, mode="add", history=True
    )
    env.reset(seed=1)
    explained = env.get_wrapper_attr("explain")()
    assert env.explain("spec") == explained
    assert explained.causes[0].variable == "x"
    spec = StlMonitor(
        gym.make("CartPole-v1"), "always(abs(x) < 1)", {"x": "obs[0]"}, history=True
    ).spec
    assert spec is not None
    made: Any = gym.make(gym.envs.registration.EnvSpec.from_json(spec.to_json()))
    made.reset(seed=1)
    assert made.get_wrapper_attr("explain")() == explained


def test_without_history_nothing_is_kept_and_the_error_names_the_option() -> None:
    env = StlMonitor(Replay([3, 0, 4]), {"a": "always(x > 1)"}, X)
    run(env)
    with pytest.raises(StateError) as refused:
        env.explain()
    assert str(refused.value) == (
        "explain() needs the samples of the episode; make the monitor with history=True"
    )
    for _, judge in env.monitors.values():
        assert judge.update == judge._machine.update
    for view in ("episode", "step"):
        spec = rtamt.parse("x > 1" if view == "step" else "always(x > 1)")
        monitor_set = MonitorSet({"a": spec}, EvaluationOptions(period=1, view=view), history=True)
        ((_, judge),) = monitor_set.monitors.values()
        assert judge.update != judge._machine.update


def test_before_the_first_reset_there_is_nothing_to_explain() -> None:
    env = StlMonitor(Replay([3, 0, 4]), "always(x > 1)", X, history=True)
    with pytest.raises(StateError) as refused:
        env.explain()
    assert str(refused.value) == "explain() needs at least one sample, got none since reset"
