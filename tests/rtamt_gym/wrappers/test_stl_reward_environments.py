"""The contract of `StlReward` on real environments: what holds for one holds for each."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES, Case, Env, continued, equal, restored, rollout
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation

from rtamt.errors import InputError
from rtamt_gym import Step, StlReward

cases = pytest.mark.parametrize("case", CASES, ids=lambda case: case.env_id.split(":")[-1])


def shaped(case: Case, **arguments: Any) -> Env:  # noqa: ANN401
    """The environment with a reward that depends on all that a reward can depend on."""
    names = list(case.specs) if isinstance(case.specs, dict) else ["spec"]
    arguments = {
        "mode": "hierarchical",
        "priorities": dict.fromkeys(names, "safety"),
        "weights": {names[0]: 2.0},
        "temperature": 0.5,
        **arguments,
    }
    return StlReward(case.bare(), case.specs, case.signals, **arguments)


def is_picture(env: Env) -> bool:
    return len(env.observation_space.shape or ()) > 1


def observing(case: Case) -> Env:
    """With the state of the monitor in the observation, flattened where it is a picture."""
    env = case.monitored()
    if is_picture(env):
        env = FlattenObservation(env)
    return StlReward(env, mode="potential", observe="state")


@pytest.mark.slow(keep=3)
@cases
@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version:UserWarning")
@pytest.mark.filterwarnings("ignore:clip=1 flattens what observe='state' appends:UserWarning")
def test_gymnasium_finds_no_fault(case: Case) -> None:
    check_env(shaped(case), skip_render_check=True)
    check_env(observing(case), skip_render_check=True)


@pytest.mark.slow(keep=3)
@cases
def test_only_reward_and_info_change(case: Case) -> None:
    monitored = rollout(case.monitored(cost="depth"))
    rewarded = rollout(shaped(case, cost="depth"))
    assert len(monitored) == len(rewarded)
    assert equal(monitored[0], rewarded[0])
    for (obs, reward, *ends, info), (same, paid, *others, more) in zip(
        monitored[1:], rewarded[1:], strict=True
    ):
        assert equal((obs, ends), (same, others))
        assert equal({**info, "reward": np.float64(reward)}, more)
        assert type(paid) is type(more["reward"]) is np.float64


@pytest.mark.slow(keep=3)
@cases
def test_the_environment_is_made_again_from_its_specification_and_from_json(case: Case) -> None:
    for env in (shaped(case, cost="first"), observing(case)):
        expected = rollout(env)
        assert env.spec is not None
        for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
            again = gym.make(spec)
            assert str(again) == str(env)
            assert equal(rollout(again), expected)
            again.close()


@cases
@pytest.mark.parametrize("clone", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_in_mid_episode_continues_as_the_original(
    case: Case, clone: Callable[[Env], Env]
) -> None:
    env = shaped(case)
    if not is_picture(env):  # FlattenObservation holds a lambda, which pickle refuses
        env = observing(case)
    rollout(env, steps=4)
    copy = restored(clone(env), env)
    assert copy.get_wrapper_attr("samples") == env.get_wrapper_attr("samples") == 5
    assert equal(continued(copy, 11, 6), continued(env, 11, 6))
    assert equal(copy.get_wrapper_attr("stl_episodes"), env.get_wrapper_attr("stl_episodes"))


def test_a_wrapper_specification_serves_a_registration() -> None:
    case = CASES[0]
    gym.register(
        "ShapedCartPole-v0",
        entry_point="gymnasium.envs.classic_control:CartPoleEnv",
        max_episode_steps=500,
        additional_wrappers=(
            StlReward.wrapper_spec(
                specs=case.specs, signals=case.signals, mode="add", cost="first"
            ),
        ),
    )
    try:
        expected = rollout(shaped(case, mode="add", priorities=None, weights=None, cost="first"))
        assert equal(rollout(gym.make("ShapedCartPole-v0")), expected)
    finally:
        del gym.registry["ShapedCartPole-v0"]


def angle(step: Step) -> float:
    return float(step.obs[2])


def test_a_callable_signal_is_not_written_as_json() -> None:
    env = StlReward(
        gym.make("CartPole-v1"), "always(abs(angle) < 0.2)", {"angle": angle}, mode="add"
    )
    assert env.spec is not None
    assert equal(rollout(gym.make(env.spec)), rollout(env))
    with pytest.raises(InputError, match="signal 'angle' is a callable, which JSON cannot hold"):
        env.spec.to_json()
