"""The contract of `StlMonitor` and `StlReward` on real environments."""

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
from rtamt_gym import Step, StlMonitor, StlReward

Wrap = Callable[[Case], Env]

cases = pytest.mark.parametrize("case", CASES, ids=lambda case: case.env_id.split(":")[-1])


def monitored(case: Case) -> Env:
    return case.monitored(on_violation="report", details=True, cost="first")


def of_instants(case: Case) -> Env:
    """Monitor every instant, with formulas that make sense there."""
    if case.env_id == "CartPole-v1":
        case = Case(case.env_id, "abs(theta) < 0.2", case.signals)
    else:
        case = Case(case.env_id, "x < 9", {"x": next(iter(case.signals.values()))})
    return case.monitored(view="step")


def shaped(case: Case, **arguments: Any) -> Env:
    """Return the environment with a reward that depends on all parts of a step."""
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
    """Return it with the state of the monitor in the observation, flattened if it is a picture."""
    env = case.monitored()
    if is_picture(env):
        env = FlattenObservation(env)
    return StlReward(env, mode="potential", observe="state")


def showing_state(case: Case) -> Env:
    return case.monitored(observe="state", clip=0.5)


def showing_obligations(case: Case) -> Env:
    return case.monitored(observe="obligations", clip=0.5)


def pairs(*wraps: Wrap) -> pytest.MarkDecorator:
    """Run a test with environments in these wrappers; nothing can be appended to a picture."""
    flat = [*CASES[:3], CASES[-1]]
    return pytest.mark.parametrize(
        ("case", "wrap"),
        [
            pytest.param(case, wrap, id=f"{case.env_id.split(':')[-1]}-{wrap.__name__}")
            for wrap in wraps
            for case in (flat if wrap in {showing_state, showing_obligations} else CASES)
        ],
    )


@pytest.mark.slow(keep=8)
@pairs(monitored, of_instants, shaped, observing, showing_state, showing_obligations)
@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version:UserWarning")
@pytest.mark.filterwarnings("ignore:clip=.* flattens the values of")  # it is narrow here
def test_gymnasium_checks(case: Case, wrap: Wrap) -> None:
    check_env(wrap(case), skip_render_check=True)


@pytest.mark.slow(keep=3)
@cases
def test_only_reward_and_info_change(case: Case) -> None:
    bare = rollout(case.bare())
    monitored = rollout(case.monitored(on_violation="report", details=True, cost="depth"))
    rewarded = rollout(shaped(case, on_violation="report", details=True, cost="depth"))
    assert len(bare) == len(monitored) == len(rewarded)
    assert equal(monitored[0], rewarded[0])
    for plain, (*rest, info) in zip(bare, monitored, strict=True):
        assert equal(plain[:-1], tuple(rest))
        assert equal(plain[-1], {key: info[key] for key in plain[-1]})
        assert type(info["robustness"]) is np.float64
        assert type(info["stl_violated"]) is bool
    for (obs, reward, *ends, info), (same, paid, *others, more) in zip(
        monitored[1:], rewarded[1:], strict=True
    ):
        assert equal((obs, ends), (same, others))
        assert equal({**info, "reward": np.float64(reward)}, more)
        assert type(paid) is type(more["reward"]) is np.float64


@pytest.mark.slow(keep=6)
@pairs(monitored, shaped, observing, showing_state, showing_obligations)
def test_made_again_from_spec_and_json(case: Case, wrap: Wrap) -> None:
    env = wrap(case)
    expected = rollout(env)
    assert env.spec is not None
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        again = gym.make(spec)
        assert str(again) == str(env)
        assert again.observation_space == env.observation_space
        assert equal(rollout(again), expected)
        again.close()


@pytest.mark.slow(keep=8)
@pairs(monitored, observing, showing_state, showing_obligations)
@pytest.mark.parametrize("clone", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copy_in_mid_episode_continues(case: Case, wrap: Wrap, clone: Callable[[Env], Env]) -> None:
    env = shaped(case)
    if wrap is not observing or not is_picture(env):  # pickle refuses FlattenObservation
        env = wrap(case)
    rollout(env, steps=4)
    copy = restored(clone(env), env)
    assert copy.get_wrapper_attr("samples") == env.get_wrapper_attr("samples") == 5
    assert equal(continued(copy, 11, 6), continued(env, 11, 6))
    assert equal(copy.get_wrapper_attr("stl_episodes"), env.get_wrapper_attr("stl_episodes"))


@pytest.mark.slow(keep=6)
@pairs(showing_state, showing_obligations)
def test_second_episode_shows_what_the_first_one_did(case: Case, wrap: Wrap) -> None:
    env = wrap(case)
    first = rollout(env)
    assert equal(rollout(env), first)
    env.reset(seed=7)
    assert equal(env.reset(seed=7, options=None)[0], first[0][0])


@cases
def test_reset_with_options_none_is_reset(case: Case) -> None:
    env = case.monitored(details=True)
    (obs, info), (other, same) = env.reset(seed=4), env.reset(seed=4, options=None)
    assert equal(obs, other)
    stl = {"robustness", "stl_lower", "stl_upper", "stl_violated", "stl"}
    assert stl <= info.keys()
    assert equal({key: info[key] for key in stl}, {key: same[key] for key in stl})


@pytest.mark.parametrize(
    ("wrapper", "options"),
    [(StlMonitor, {"details": True}), (StlReward, {"mode": "add", "cost": "first"})],
)
def test_wrapper_spec_serves_a_registration(wrapper: Any, options: dict[str, Any]) -> None:
    case = CASES[0]
    gym.register(
        "WrappedCartPole-v0",
        entry_point="gymnasium.envs.classic_control:CartPoleEnv",
        max_episode_steps=500,
        additional_wrappers=(
            wrapper.wrapper_spec(specs=case.specs, signals=case.signals, **options),
        ),
    )
    try:
        expected = rollout(wrapper(case.bare(), case.specs, case.signals, **options))
        assert equal(rollout(gym.make("WrappedCartPole-v0")), expected)
    finally:
        del gym.registry["WrappedCartPole-v0"]


def test_wrappers_of_a_vector_environment() -> None:
    case = CASES[0]

    def wrap(env: Env) -> StlMonitor[Any, Any]:
        return StlMonitor(env, case.specs, case.signals)

    envs = gym.make_vec(case.env_id, 2, vectorization_mode="sync", wrappers=[wrap])
    envs.reset(seed=7)
    envs.action_space.seed(7)
    while True:
        _, _, terminated, _, info = envs.step(envs.action_space.sample())
        if terminated.any():
            break
    entry = int(np.flatnonzero(terminated)[0])
    assert info["stl_violated_by"][entry] == "spec"
    assert info["robustness"].dtype == np.float64
    envs.close()


def test_fresh_process() -> None:
    envs = gym.vector.AsyncVectorEnv(
        [CASES[0].monitored], context="forkserver", shared_memory=False
    )
    _, info = envs.reset(seed=7)
    assert info["robustness"][0] == CASES[0].monitored().reset(seed=7)[1]["robustness"]
    envs.close()


def angle(step: Step) -> float:
    return float(step.obs[2])


def test_function_as_signal_has_no_json() -> None:
    env = StlReward(
        gym.make("CartPole-v1"), "always(abs(angle) < 0.2)", {"angle": angle}, mode="add"
    )
    assert env.spec is not None
    assert equal(rollout(gym.make(env.spec)), rollout(env))
    with pytest.raises(InputError, match="signal 'angle' is a callable, which JSON cannot hold"):
        env.spec.to_json()
