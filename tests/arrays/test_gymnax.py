"""Wrapped environments of gymnax, and functional ones of Gymnasium, are judged like signals."""

from __future__ import annotations

import doctest
from typing import Any

import gymnax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from array_requirements import RequirementContract
from gymnasium.envs.functional_jax_env import FunctionalJaxEnv, FunctionalJaxVectorEnv
from gymnasium.envs.phys2d.cartpole import CartPoleFunctional

from rtamt import InputError, VectorEpisodeMonitor
from rtamt_arrays.jax import episode, functional, online
from rtamt_arrays.jax import gymnax as wrappers
from rtamt_arrays.jax.functional import StlFuncEnv
from rtamt_arrays.jax.gymnax import StlEnvironment
from rtamt_arrays.jax.operations import JaxOperations
from rtamt_arrays.judging import StepJudge
from rtamt_arrays.monitor_set import ArrayLibrary
from rtamt_arrays.operations import Tensor

ENTRIES = 6
SPEC = "always(abs(theta) < 0.15 and (x > -0.04 or eventually[0:0.2](v > -0.5)))"
SIGNALS = {"x": "obs[0]", "v": "obs[1]", "theta": "obs[2]"}
OPEN: dict[str, Any] = {"at_truncation": "complete", "dtype": jnp.float64}


pytestmark = pytest.mark.usefixtures("doubles")


class Jax:
    """JAX under ``jit``."""

    def judge(self, specs: Any, options: Any) -> StepJudge:  # noqa: ANN401
        return StepJudge(specs, ArrayLibrary(episode, online, JaxOperations()), options)

    def tensor(self, values: object) -> Tensor:
        return jnp.asarray(np.array(values))

    def compiled(self, function: Any) -> Any:  # noqa: ANN401
        return jax.jit(function)


class TestRequirements(RequirementContract):
    library = Jax()


@pytest.mark.parametrize("on_violation", ["terminate", "truncate", "report"])
def test_scanned_rollout_equals_recorded_signals(on_violation: str) -> None:
    bare, params = gymnax.make("CartPole-v1")
    params = params.replace(max_steps_in_episode=12)
    options: Any = {**OPEN, "on_violation": on_violation, "cost": "latched"}
    env = StlEnvironment(bare, SPEC, SIGNALS, **options)
    steps = 60

    def run(key: Any) -> Any:  # noqa: ANN401
        keys = jax.random.split(key, ENTRIES)
        obs, state = jax.vmap(env.reset, in_axes=(0, None))(keys, params)

        def step(carried: Any, key: Any) -> Any:  # noqa: ANN401
            keys = jax.random.split(key, ENTRIES)
            actions = jax.random.randint(key, (ENTRIES,), 0, 2)
            result = jax.vmap(env.step, in_axes=(0, 0, 0, None))(keys, carried, actions, params)
            return result[1], (result[0], *result[2:])

        return obs, jax.lax.scan(step, state, jax.random.split(key, steps))[1]

    first, (obs, _reward, terminated, truncated, info) = jax.jit(run)(jax.random.key(3))
    monitor = VectorEpisodeMonitor(SPEC, ENTRIES, period=0.02)
    monitor.update(_table(monitor, first))
    count, ends = np.zeros(ENTRIES), 0
    for t in range(steps):
        last = np.asarray(info["final_observation"][t])
        monitor.update(_table(monitor, last))
        count += 1
        fallen = (np.abs(last[:, 2]) > 12 * np.pi / 180) | (np.abs(last[:, 0]) > 2.4)
        limit = (count >= 12) & ~fallen
        closed = fallen | limit
        violated = np.signbit(np.where(closed, monitor.robustness, monitor.upper))
        early = np.signbit(monitor.upper) & (on_violation != "report")
        np.testing.assert_array_equal(info["robustness"][t], monitor.robustness)
        for key, bound in (("stl_lower", monitor.lower), ("stl_upper", monitor.upper)):
            np.testing.assert_array_equal(info[key][t], np.where(closed, monitor.robustness, bound))
        np.testing.assert_array_equal(info["stl_violated"][t], violated)
        np.testing.assert_array_equal(info["cost"][t], violated)
        np.testing.assert_array_equal(terminated[t], fallen | (early & (on_violation[1] == "e")))
        over = np.asarray(terminated[t] | truncated[t])
        np.testing.assert_array_equal(over, closed | early | (count >= 12))
        np.testing.assert_array_equal(
            info["is_success"][t], over & ~violated & (closed | (monitor.verdict > 0))
        )
        if over.any():
            monitor.reset(over)
            monitor.update(_table(monitor, np.asarray(obs[t])), over)
            count[over] = 0
            ends += over.sum()
    assert ends > ENTRIES


def _table(monitor: VectorEpisodeMonitor, obs: Any) -> Any:  # noqa: ANN401
    columns = {name: np.asarray(obs, np.float64)[:, i] for name, i in _PLACES.items()}
    return np.stack([columns[name] for name in monitor.variables], axis=1)


_PLACES = {"x": 0, "v": 1, "theta": 2}


def test_spaces_and_observations_have_the_state() -> None:
    bare, params = gymnax.make("CartPole-v1")
    env = StlEnvironment(bare, "always(abs(theta) < 0.1)", {"theta": "obs[2]"}, observe="state")
    obs, state = env.reset(jax.random.key(0), params)
    assert env.observation_space(params).shape == obs.shape == (9,)
    np.testing.assert_allclose(obs[4], 0.1 - abs(obs[2]), atol=1e-7)
    after = env.step(jax.random.key(1), state, 1, params)
    assert after[0].shape == after[-1]["final_observation"].shape == (9,)


def test_functional_environment_under_scan() -> None:
    jax.config.update("jax_enable_x64", False)  # noqa: FBT003 - these mix kinds of floats else
    env = StlFuncEnv(CartPoleFunctional(), "always(abs(theta) < 0.05)", {"theta": "obs[2]"})

    def step(state: Any, key: Any) -> Any:  # noqa: ANN401
        after = env.transition(state, 1, key)
        info = env.transition_info(state, 1, after)
        return after, (env.observation(after, key), env.terminal(after, key), info)

    state = env.initial(jax.random.key(0))
    first = env.observation(state, jax.random.key(0))
    keys = jax.random.split(jax.random.key(1), 8)
    _, (obs, over, info) = jax.jit(lambda s: jax.lax.scan(step, s, keys))(state)
    theta = np.concatenate([[first[2]], obs[:, 2]]).astype(np.float64)
    robustness = np.minimum.accumulate(0.05 - np.abs(theta))
    np.testing.assert_allclose(info["robustness"], robustness[1:], rtol=0, atol=1e-7)
    np.testing.assert_array_equal(over, robustness[1:] < 0)
    assert over.any()
    alone: Any = FunctionalJaxEnv(env)
    alone.reset(seed=0)
    told = [alone.step(1) for _ in range(8)]
    assert any(terminated for _, _, terminated, _, _ in told)
    assert told[0][4].keys() == info.keys()
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - as before


def test_functional_vector_environment() -> None:
    """An entry's samples are its observations, whatever the others do."""
    jax.config.update("jax_enable_x64", False)  # noqa: FBT003 - these mix kinds of floats else
    spec = "always(abs(theta) < 0.12)"
    made = StlFuncEnv(CartPoleFunctional(), spec, {"theta": "obs[2]"})
    env: Any = FunctionalJaxVectorEnv(made, ENTRIES, max_episode_steps=12)
    env.func_env.transform(jax.jit)
    monitor = VectorEpisodeMonitor(spec, ENTRIES)
    obs, info = env.reset(seed=0)
    monitor.update(_table(monitor, obs))
    np.testing.assert_allclose(info["robustness"], monitor.robustness, rtol=0, atol=1e-7)
    begins, judged, violated = np.zeros(ENTRIES, dtype=bool), 0, 0
    for action in (np.random.default_rng(3).random((60, ENTRIES)) < 0.8).astype(int):
        before = np.asarray(obs)
        obs, _, terminated, truncated, info = env.step(action)
        # At the start of another entry, Gymnasium leaves an entry in its state.
        went_on = ~begins & (np.asarray(obs) != before).any(axis=1)
        monitor.reset(begins)
        monitor.update(_table(monitor, obs), went_on | begins)
        for key in ("robustness", "lower", "upper"):
            found = info[key if key == "robustness" else f"stl_{key}"]
            np.testing.assert_allclose(
                np.asarray(found)[went_on], getattr(monitor, key)[went_on], rtol=0, atol=1e-7
            )
        np.testing.assert_array_equal(
            np.asarray(terminated)[went_on], np.signbit(monitor.upper)[went_on]
        )
        judged, violated = judged + went_on.sum(), violated + np.asarray(terminated).sum()
        begins = np.asarray(terminated | truncated)
    assert judged > 30 * ENTRIES
    assert violated > ENTRIES
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - as before


def test_bounds_without_a_period_are_refused() -> None:
    bare, _ = gymnax.make("Catch-bsuite")
    with pytest.raises(InputError) as error:
        StlEnvironment(bare, "always[0:3](x > 0)", {"x": "reward"})
    assert str(error.value) == (
        "Specification 'spec' has bounds, and the duration of a step is unknown. Pass period=0.02 "
        "in seconds, or period=1 for bounds in steps."
    )


def test_the_examples_of_docstrings_show_what_happens() -> None:
    for module in (wrappers, functional):
        done = doctest.testmod(module)
        assert done.attempted
        assert not done.failed
