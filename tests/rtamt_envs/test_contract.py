"""The promises of every scenario, for each scenario of the registry."""

import dataclasses
import json
import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from copy import deepcopy

import gymnasium as gym
import numpy as np
import pytest
import scenario_courses
from gymnasium.utils.env_checker import check_env
from rtamt_envs import SCENARIOS, scenario_of
from rtamt_envs.compiled import compiled
from rtamt_envs.environment import ScenarioEnv
from rtamt_envs.pictures import figure_of
from scenario_courses import course, courses, made, middle, random_actions, read_signals

import rtamt
from rtamt_gym import StlMonitor, simulate

each_scenario = pytest.mark.parametrize("name", SCENARIOS)


@each_scenario
def test_the_declaration_says_everything(name: str) -> None:
    found = scenario_of(name)
    assert found.name == name
    assert found.title
    assert found.source
    assert found.id == f"rtamt/{name}-v0"
    assert scenario_of(name) is found
    assert round(found.duration / found.period) == SCENARIOS[name][1]
    names = [observation.name for observation in found.observations]
    assert len(set(names)) == len(names)
    for quantity in (*found.actions, *found.observations):
        assert quantity.low < quantity.high, quantity
    assert all(np.isfinite([action.low, action.high]).all() for action in found.actions)
    assert {source.name for source in found.inputs} <= {action.name for action in found.actions}
    assert not np.isnan(found.defaults).any()


@each_scenario
def test_requirements_read_what_is_observed(name: str) -> None:
    found = scenario_of(name)
    assert found.specifications
    names = {observation.name for observation in found.observations}
    for requirement in found.specifications.values():
        assert set(requirement.variables) <= names, requirement
    alone = {
        specification: found.specifications[specification] for specification in found.specifications
    }
    assert list(alone) == list(rtamt.parse(found.requirements).requirements)


@each_scenario
def test_it_is_an_environment_of_gymnasium(name: str) -> None:
    env = gym.make(f"rtamt/{name}-v0", render_mode="rgb_array")
    check_env(env.unwrapped)
    assert env.observation_space.dtype == env.action_space.dtype == np.float64
    assert env.spec is not None
    assert env.spec.max_episode_steps == SCENARIOS[name][1]
    assert env.unwrapped.dt == scenario_of(name).period  # type: ignore[attr-defined]


@each_scenario
def test_observations_stay_in_their_space(name: str) -> None:
    env = made(name)
    for seed in range(3):
        actions = random_actions(env.scenario, (8,), seed).repeat(50, axis=0)
        for observation in course(env, actions, seed):
            assert env.observation_space.contains(observation), observation


@each_scenario
def test_the_time_limit_ends_an_episode(name: str) -> None:
    env = gym.make(f"rtamt/{name}-v0", max_episode_steps=3)
    env.reset(seed=0)
    low = env.action_space.low  # type: ignore[attr-defined]
    ends = [env.step(low)[1:4] for _ in range(3)]
    assert ends == [(0.0, False, False), (0.0, False, False), (0.0, False, True)]


@each_scenario
def test_an_error_of_the_first_reset_changes_nothing(name: str) -> None:
    env = gym.make(f"rtamt/{name}-v0")
    with pytest.raises(rtamt.InputError, match="no parameter 'colour'"):
        env.reset(options={"colour": 1.0})
    first, _ = env.reset(seed=0)
    np.testing.assert_array_equal(first, made(name).reset(seed=0)[0])
    env.step(env.action_space.low)  # type: ignore[attr-defined]


@each_scenario
def test_a_seed_gives_an_episode_again(name: str) -> None:
    env, other = made(name), made(name)
    actions = random_actions(env.scenario, (40,), 1)
    whole = course(env, actions, seed=5)
    np.testing.assert_array_equal(course(env, actions, seed=5), whole)
    np.testing.assert_array_equal(course(other, actions, seed=5), whole)
    noisy = made(name, parameters=middle(env.scenario))
    differs = (course(noisy, actions, seed=5) != course(noisy, actions, seed=6)).any()
    assert differs == bool(env.scenario.noise)


@each_scenario
def test_actions_out_of_bounds_act_as_the_nearest(name: str) -> None:
    env = made(name)
    far = 3 * random_actions(env.scenario, (20,), 2) - env.action_space.high  # type: ignore[attr-defined]
    near = np.clip(far, env.action_space.low, env.action_space.high)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(course(env, far), course(env, near))


@each_scenario
def test_an_action_that_is_none_changes_nothing(name: str) -> None:
    env = made(name)
    actions = random_actions(env.scenario, (10,), 3)
    whole = course(env, actions)
    env.reset(seed=0)
    seen = [env.step(action)[0] for action in actions[:5]]
    wrong = actions[0].copy()
    wrong[-1] = np.nan
    last = env.action_names[-1]
    with pytest.raises(rtamt.InputError, match=f"a number as action '{last}', got nan"):
        env.step(wrong)
    with pytest.raises(rtamt.InputError, match="expected an action"):
        env.step(actions)
    with pytest.raises(rtamt.InputTypeError, match="expected an action"):
        env.step("full")
    seen += [env.step(action)[0] for action in actions[5:]]
    np.testing.assert_array_equal(seen, whole[1:])


@each_scenario
def test_an_episode_begins_with_reset(name: str) -> None:
    env = made(name)
    low = env.action_space.low  # type: ignore[attr-defined]
    for call in (lambda: env.step(low), env.baseline):
        with pytest.raises(rtamt.StateError, match=f"no episode of rtamt/{name}-v0 runs; call res"):
            call()
    with pytest.raises(rtamt.InputTypeError, match="as a mapping from names to numbers, got 3"):
        env.reset(options=3)  # type: ignore[arg-type]
    env.reset()
    env.step(low)


@each_scenario
def test_copies_go_on_alone(name: str) -> None:
    env = made(name)
    actions = random_actions(env.scenario, (12,), 4)
    whole = course(env, actions)
    env.reset(seed=0)
    for action in actions[:6]:
        env.step(action)
    for copy in (deepcopy(env), pickle.loads(pickle.dumps(env))):
        rest = [copy.step(action)[0] for action in actions[6:]]
        np.testing.assert_array_equal(rest, whole[7:])
    rest = [env.step(action)[0] for action in actions[6:]]
    np.testing.assert_array_equal(rest, whole[7:])


@each_scenario
def test_parameters_are_those_of_the_episode(name: str) -> None:
    found = scenario_of(name)
    given = middle(found)
    defaults = {each.name: each.default for each in found.parameters}
    env = made(name)
    env.reset(options=given)
    assert env.parameters == given
    env.reset()
    assert env.parameters == defaults
    fixed = made(name, parameters=given)
    fixed.reset()
    assert fixed.parameters == given
    with pytest.raises(rtamt.InputError, match=f"rtamt/{name}-v0 has no parameter 'colour'; "):
        env.reset(options={"colour": 1.0})
    for parameter in list(defaults)[:1]:
        with pytest.raises(rtamt.InputError, match=f"a number as parameter '{parameter}'"):
            env.reset(options={parameter: np.nan})
    assert env.parameters == defaults


@each_scenario
def test_the_baseline_runs_under_the_requirements(name: str) -> None:
    env = gym.make(f"rtamt/{name}-v0")
    bare = made(name)
    run = simulate(
        env,
        bare.requirements,
        bare.signals,
        policy=env.unwrapped.baseline,  # type: ignore[attr-defined]
        seed=0,
        stop="end",
    )
    assert run.steps == SCENARIOS[name][1]
    assert set(run.histories) == set(bare.requirements)
    assert all(np.isfinite(values).all() for values in run.signals.values())
    signals = read_signals(bare.scenario)
    monitored = StlMonitor(gym.make(f"rtamt/{name}-v0"), bare.requirements, signals)
    _, info = monitored.reset(seed=0)
    for _ in range(30):
        _, _, terminated, _, info = monitored.step(monitored.unwrapped.baseline())  # type: ignore[attr-defined]
        if terminated:
            break
    at = monitored.samples - 1
    courses = [course for course in run.histories.values() if len(course.upper) > at]
    assert info["stl_upper"] == min(course.upper[at] for course in courses)


def test_numbers_are_the_same_without_numba() -> None:
    program = subprocess.run(
        [sys.executable, scenario_courses.__file__],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    interpreted = json.loads(program.stdout)
    assert set(interpreted) == set(SCENARIOS)
    for name in SCENARIOS:
        assert hasattr(scenario_of(name).step, "py_func"), "this test needs numba"
        assert courses(name) == interpreted[name], name


@pytest.mark.slow(keep=2)
@each_scenario
def test_a_picture_shows_the_episode(name: str) -> None:
    env = made(name, render_mode="rgb_array")
    actions = random_actions(env.scenario, (30,), 5)
    course(env, actions)
    frame = env.render()
    assert frame is not None
    assert frame.dtype == np.uint8
    assert frame.shape == (600, 800, 3)
    assert (frame < 250).any(axis=2).mean() > 0.01
    env.reset(seed=0)
    assert (frame != env.render()).any()
    with pytest.warns(UserWarning, match="create the environment with render_mode"):
        assert made(name).render() is None


def test_a_scenario_without_a_drawing_shows_the_course_of_each_observation() -> None:
    env = made("RequestGrant", render_mode="rgb_array")
    course(env, random_actions(env.scenario, (20,), 5))
    episode = env.episode()
    figure = figure_of(dataclasses.replace(env.scenario, draw=None), episode)
    assert [ax.get_ylabel() for ax in figure.axes] == ["req", "gnt"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    for ax, values in zip(figure.axes, episode.observations.T, strict=True):
        (line,) = ax.lines
        np.testing.assert_array_equal(line.get_xydata(), np.stack([episode.times, values], axis=1))


def test_a_function_stays_as_it_is_where_numba_is_not_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    assert compiled(middle) is middle


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: scenario_of("ChasingCar"),
            "unknown scenario 'ChasingCar'; did you mean 'ChasingCars'?; there are ",
        ),
        (
            lambda: ScenarioEnv("RequestGrant", render_mode="ansi"),  # type: ignore[arg-type]
            "expected render_mode None or 'rgb_array', got 'ansi'",
        ),
        (
            lambda: made("RequestGrant").episode(),
            "the environment records no episode; create it with render_mode='rgb_array'",
        ),
        (
            lambda: made("RequestGrant", render_mode="rgb_array").episode(),
            "no episode has started; call reset() first",
        ),
        (
            lambda: made("RequestGrant").reset(options={"delay": "long"}),
            "expected a number as parameter 'delay' of rtamt/RequestGrant-v0, got 'long'",
        ),
    ],
)
def test_wrong_arguments_say_what_is_expected(call: Callable[[], object], message: str) -> None:
    with pytest.raises(rtamt.RtamtError, match=re.escape(message)):
        call()
