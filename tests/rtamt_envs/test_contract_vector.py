"""Many simulations of a scenario are equal to one at a time."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from rtamt_envs import SCENARIOS, scenario_of
from rtamt_envs.vector import ScenarioVectorEnv
from scenario_courses import random_actions, read_signals

import rtamt
from rtamt_gym import StlMonitor, VectorStlMonitor

ENTRIES = 3

each_scenario = pytest.mark.parametrize("name", SCENARIOS)


def many(name: str, **options: Any) -> ScenarioVectorEnv:  # noqa: ANN401 - as gym.make_vec
    env = gym.make_vec(f"rtamt/{name}-v0", ENTRIES, **options)
    assert isinstance(env, ScenarioVectorEnv)
    return env


def one_by_one(name: str, mode: AutoresetMode, steps: int) -> SyncVectorEnv:
    return SyncVectorEnv(
        [lambda: gym.make(f"rtamt/{name}-v0", max_episode_steps=steps)] * ENTRIES,
        autoreset_mode=mode,
    )


def options_of(name: str) -> Iterator[dict[str, Any]]:
    """Parameters of environments, for scenarios with parameters."""
    yield {}
    yield {
        parameter.name: np.linspace(parameter.low, parameter.high, ENTRIES + 2)[1:-1]
        for parameter in scenario_of(name).parameters
    }


@each_scenario
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_environments_equal_environments_to_the_bit(name: str, mode: AutoresetMode) -> None:
    entries = many(name, max_episode_steps=7, autoreset_mode=mode)
    alone = one_by_one(name, mode, 7)
    np.testing.assert_array_equal(entries.reset(seed=3)[0], alone.reset(seed=3)[0])
    for actions in random_actions(scenario_of(name), (20, ENTRIES), 0):
        made, expected = entries.step(actions), alone.step(actions)
        for got, wanted in zip(made[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(got, wanted)
            assert got.dtype == wanted.dtype
        assert ("final_obs" in made[4]) == ("final_obs" in expected[4])
        if "final_obs" in made[4]:
            np.testing.assert_array_equal(
                np.stack(made[4]["final_obs"]), np.stack(expected[4]["final_obs"])
            )


@each_scenario
def test_rollout_equals_steps_and_takes_parameters(name: str) -> None:
    actions = random_actions(scenario_of(name), (60, ENTRIES), 1)
    for options in options_of(name):
        entries, rolled, alone = many(name), many(name), one_by_one(name, "Disabled", 10**6)  # type: ignore[arg-type]
        np.testing.assert_array_equal(
            entries.reset(seed=8, options=options)[0], rolled.reset(seed=8, options=options)[0]
        )
        for i, env in enumerate(alone.envs):
            env.reset(seed=8 + i, options={key: row[i] for key, row in options.items()})
        expected = np.array([entries.step(each)[0] for each in actions])
        scalar = [
            np.array([env.step(action)[0] for env, action in zip(alone.envs, row, strict=True)])
            for row in actions
        ]
        np.testing.assert_array_equal(expected, scalar)
        cuts = [0, 1, 8, 40, 60]
        parts = [rolled.rollout(actions[a:b]) for a, b in pairwise(cuts)]
        np.testing.assert_array_equal(np.concatenate(parts), expected)
        for key, row in options.items():
            np.testing.assert_array_equal(entries.parameters[key], row)


@each_scenario
def test_environments_that_are_not_active_stand_still(name: str) -> None:
    actions = random_actions(scenario_of(name), (10, ENTRIES), 2)
    entries, others = many(name), many(name)
    entries.reset(seed=0)
    others.reset(seed=0)
    active = np.array([True, False, True])
    seen = entries.rollout(actions, active)
    np.testing.assert_array_equal(seen[:, active], others.rollout(actions)[:, active])
    assert np.isnan(seen[:, 1]).all()
    late = many(name)
    late.reset(seed=0)
    np.testing.assert_array_equal(
        entries.rollout(actions, ~active)[:, 1], late.rollout(actions)[:, 1]
    )


@each_scenario
def test_the_baseline_acts_in_every_environment(name: str) -> None:
    entries, rolled = many(name), many(name)
    entries.reset(seed=1)
    rolled.reset(seed=1)
    expected = np.array([entries.step(entries.baseline())[0] for _ in range(40)])
    np.testing.assert_array_equal(
        np.concatenate([rolled.rollout(15), rolled.rollout(25)]), expected
    )
    one = gym.make(f"rtamt/{name}-v0").unwrapped
    one.reset(seed=2)
    scalar = [one.step(one.baseline())[0] for _ in range(40)]  # type: ignore[attr-defined]
    np.testing.assert_array_equal(scalar, expected[:, 1])


@each_scenario
def test_environments_begin_anew_where_a_mask_says(name: str) -> None:
    entries = many(name, max_episode_steps=5, autoreset_mode="Disabled")
    first, _ = entries.reset(seed=4)
    actions = random_actions(scenario_of(name), (5, ENTRIES), 3)
    for row in actions:
        _, _, _, truncated, _ = entries.step(row)
    assert truncated.all()
    with pytest.raises(rtamt.InputError, match="environment 0 has ended; reset it"):
        entries.step(actions[0])
    mask = np.array([False, True, False])
    again, _ = entries.reset(seed=4, options={"reset_mask": mask})
    np.testing.assert_array_equal(again[1], first[1])
    with pytest.raises(rtamt.InputError, match="environment 0 has ended"):
        entries.step(actions[0])


@each_scenario
def test_episodes_begin_with_reset(name: str) -> None:
    entries = many(name)
    actions = random_actions(scenario_of(name), (4, ENTRIES), 5)
    calls = (lambda: entries.step(actions[0]), lambda: entries.rollout(actions), entries.baseline)
    for call in (*calls, lambda: entries.rollout(2)):
        with pytest.raises(rtamt.StateError, match="runs in environment 0; call reset"):
            call()
    entries.reset(options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(rtamt.StateError, match="runs in environment 1; call reset"):
        entries.step(actions[0])
    entries.rollout(actions, [True, False, True])


@each_scenario
def test_wrong_calls_change_nothing(name: str) -> None:
    entries, others = many(name), many(name)
    entries.reset(seed=0)
    others.reset(seed=0)
    actions = random_actions(scenario_of(name), (4, ENTRIES), 4)
    wrong = actions.copy()
    wrong[2, 1, 0] = np.nan
    action = entries.action_names[0]
    with pytest.raises(
        rtamt.InputError, match=f"a number as action '{action}' of step 2 in environment 1, got nan"
    ):
        entries.rollout(wrong)
    with pytest.raises(rtamt.InputError, match="of shape"):
        entries.step(actions)
    with pytest.raises(rtamt.InputError, match="expected active as 3 booleans"):
        entries.rollout(actions, [True])
    with pytest.raises(rtamt.InputError, match="expected a seed for each of 3 environments, got 2"):
        entries.reset(seed=[1, 2])
    with pytest.raises(rtamt.InputError, match="has no parameter 'colour'"):
        entries.reset(seed=9, options={"colour": 1.0})
    with pytest.raises(rtamt.InputTypeError, match="as a mapping from names to numbers, got 3"):
        entries.reset(options=3)  # type: ignore[arg-type]
    with pytest.raises(rtamt.InputError, match="a number of steps of 0 or more, got -1"):
        entries.rollout(-1)
    with pytest.raises(rtamt.InputError, match="expected num_envs of 1 or more, got 0"):
        gym.make_vec(f"rtamt/{name}-v0", num_envs=0)
    with pytest.raises(rtamt.InputError, match="a vector environment has no render_mode="):
        many(name, render_mode="rgb_array")
    np.testing.assert_array_equal(entries.rollout(actions), others.rollout(actions))


@each_scenario
def test_requirements_are_monitored_in_every_environment(name: str) -> None:
    entries = many(name)
    signals = read_signals(entries.scenario)
    many_monitored = VectorStlMonitor(entries, entries.requirements, signals)
    one = StlMonitor(gym.make(f"rtamt/{name}-v0"), entries.requirements, signals)
    _, infos = many_monitored.reset(seed=0)
    _, info = one.reset(seed=1)
    for _ in range(30):
        for key in ("stl_lower", "stl_upper", "stl_violated"):
            assert infos[key][1] == info[key]
        if info["stl_violated"]:
            break
        _, _, _, _, infos = many_monitored.step(entries.baseline())
        _, _, _, _, info = one.step(one.unwrapped.baseline())  # type: ignore[attr-defined]
