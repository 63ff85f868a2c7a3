"""Wrapped environments of Brax and Playground are judged like recorded signals."""

from __future__ import annotations

import doctest
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bits import bits
from brax.envs.base import Env, State, Wrapper
from brax.envs.wrappers.training import AutoResetWrapper, EpisodeWrapper, VmapWrapper

import rtamt_arrays.jax as arrays
from rtamt import InputError, VectorEpisodeMonitor
from rtamt_arrays.jax import brax as wrappers
from rtamt_arrays.jax.brax import StlWrapper, training_wrapper

ENTRIES = 5


pytestmark = pytest.mark.usefixtures("doubles")


class Drift(Env):  # type: ignore[misc]  # Brax is untyped
    """A point that actions push; an episode ends beyond 2."""

    dt = np.float32(0.1)
    observation_size = 2
    action_size = 1
    backend = "none"

    def reset(self, rng: Any) -> State:  # noqa: ANN401
        obs = jax.random.uniform(rng, (2,), minval=-1.0, maxval=1.0)
        return State(obs, obs, jnp.zeros(()), jnp.zeros(()), {"far": jnp.zeros(())}, {})

    def step(self, state: State, action: Any) -> State:  # noqa: ANN401
        obs = state.pipeline_state + jnp.array([1.0, -0.5]) * action
        done = (jnp.abs(obs[0]) > 2.0).astype(obs.dtype)
        metrics = {**state.metrics, "far": jnp.abs(obs[1])}
        return state.replace(pipeline_state=obs, obs=obs, reward=obs[1], done=done, metrics=metrics)


def wrapped(specs: Any, signals: Any, length: int = 7, repeat: int = 1, **options: Any) -> Any:  # noqa: ANN401
    counted = EpisodeWrapper(VmapWrapper(Drift()), length, repeat)
    return AutoResetWrapper(StlWrapper(counted, specs, signals, **options))


def rollout(env: Any, steps: int = 40) -> tuple[Any, Any, Any]:  # noqa: ANN401
    """Return the state of the reset, and the states and actions of a compiled rollout."""
    actions = jax.random.normal(jax.random.PRNGKey(1), (steps, ENTRIES, 1)) * 0.7
    keys = jax.random.split(jax.random.PRNGKey(0), ENTRIES)

    def run(actions: Any) -> Any:  # noqa: ANN401
        def step(state: Any, action: Any) -> Any:  # noqa: ANN401
            after = env.step(state, action)
            return after, after

        first = env.reset(keys)
        return first, jax.lax.scan(step, first, actions)[1]

    first, states = jax.jit(run)(actions)
    return first, states, actions


SPEC = "always((x > -1) implies eventually[0:0.2](x + y < 1.2))"
SIGNALS = {"x": "obs[0]", "y": "obs[1]"}


@pytest.mark.parametrize(
    ("on_violation", "end"), [("terminate", "cut"), ("truncate", "open"), ("report", "cut")]
)
def test_scanned_rollout_equals_recorded_signals(
    on_violation: str,
    end: Any,  # noqa: ANN401
) -> None:
    signals = {**SIGNALS, "u": ("action[0]", 0.5)}
    spec = f"{SPEC} and always(u < 1.8)"
    env = wrapped(spec, signals, period="100ms", on_violation=on_violation, at_truncation=end)
    first, states, actions = rollout(env)
    info, done = states.info, np.asarray(states.done) > 0
    # The results of a bare environment for these actions from each reset on, by hand.
    where = np.array(first.obs)
    monitor = VectorEpisodeMonitor(spec, ENTRIES, period="100ms")
    beginning = np.ones(ENTRIES, bool)
    steps, ended, open_ends = np.zeros(ENTRIES), 0, 0
    start = where.copy()
    for t, action in enumerate(np.asarray(actions)):
        if beginning.any():
            monitor.reset(beginning)
            where[beginning], steps[beginning] = start[beginning], 0
            monitor.update(_table(monitor, where, np.full(ENTRIES, 0.5)), beginning)
        where = where + np.array([1.0, -0.5]) * action
        steps += 1
        monitor.update(_table(monitor, where, action[:, 0]))
        terminated = np.abs(where[:, 0]) > 2.0
        truncated = (steps >= 7) & ~terminated
        early = np.signbit(monitor.upper)
        expected = terminated | truncated | (early & (on_violation != "report"))
        np.testing.assert_array_equal(done[t], expected)
        cut = (truncated | (early & (on_violation == "truncate"))) & ~terminated
        cut &= ~(early & (on_violation == "terminate"))
        np.testing.assert_array_equal(np.asarray(info["truncation"])[t] > 0, cut)
        monitor.finish(terminated)
        monitor.finish(truncated, end=end)
        for key, name in (("", "robustness"), ("stl_", "lower"), ("stl_", "upper")):
            assert bits(info[key + name][t]) == bits(getattr(monitor, name))
        np.testing.assert_array_equal(info["is_success"][t], (monitor.verdict > 0) & expected)
        open_ends += ((monitor.verdict == 0) & truncated).sum()
        beginning = expected
        ended += expected.sum()
    assert ended > ENTRIES  # resets in the middle
    assert open_ends  # windows that extend beyond an end


def _table(monitor: VectorEpisodeMonitor, obs: Any, action: Any) -> Any:  # noqa: ANN401
    columns = {"x": obs[:, 0], "y": obs[:, 1], "u": action}
    return np.stack([columns[name] for name in monitor.variables], axis=1)


def test_a_float32_monitor_reads_the_rounded_signals() -> None:
    env = wrapped(SPEC, SIGNALS, dtype=jnp.float32, on_violation="report")
    _, states, _ = rollout(env)
    exact = wrapped(SPEC, SIGNALS, on_violation="report")
    _, expected, _ = rollout(exact)
    assert states.info["robustness"].dtype == jnp.float32
    np.testing.assert_allclose(
        states.info["robustness"], expected.info["robustness"], rtol=0, atol=4e-7
    )


def test_metrics_follow_episode_ends() -> None:
    env = wrapped("always(x < 0.8)", {"x": "obs[0]"}, mode="add", weight=2.0)
    _, states, _ = rollout(env)
    done = np.asarray(states.done) > 0
    assert not np.asarray(states.metrics["robustness"])[~done].any()
    np.testing.assert_array_equal(
        np.asarray(states.metrics["is_success"]) > 0, states.info["stl_success"]
    )
    total = np.zeros(ENTRIES)
    sums = np.asarray(states.info["episode_metrics"]["sum_reward"])
    for t in range(len(done)):
        total += np.asarray(states.reward)[t]
        np.testing.assert_allclose(sums[t], total, atol=1e-12)
        total[done[t]] = 0.0
    paid = np.asarray(states.info["reward"]) + 2.0 * np.clip(states.info["robustness"], -1, 1)
    np.testing.assert_allclose(states.reward, paid, atol=1e-12)


def test_verdicts_alone_are_paid_once_an_episode() -> None:
    env = wrapped("always(x < 0.8)", {"x": "obs[0]"}, mode="verdict", bonus=2.0, penalty=3.0)
    _, states, _ = rollout(env)
    done = np.asarray(states.done) > 0
    success = np.asarray(states.info["is_success"])
    np.testing.assert_array_equal(states.reward, np.where(done, np.where(success, 2.0, -3.0), 0.0))
    assert success[done].any()
    assert not success[done].all()


class FullReset(Wrapper):  # type: ignore[misc]  # Brax is untyped
    """Resets all arrays whose first axis is the number of entries, as Playground does."""

    def step(self, state: State, action: Any) -> State:  # noqa: ANN401
        steps = jnp.where(state.done, 0.0, state.info["steps"])
        info = {**state.info, "steps": steps}
        after = self.env.step(state.replace(info=info, done=jnp.zeros(ENTRIES)), action)
        fresh = self.env.reset(jax.random.split(jax.random.PRNGKey(0), ENTRIES))

        def where_done(x: Any, y: Any) -> Any:  # noqa: ANN401
            if x.shape[:1] != (ENTRIES,):
                return y
            return jnp.where(after.done.reshape(-1, *[1] * (x.ndim - 1)) > 0, x, y)

        info = jax.tree.map(where_done, fresh.info, after.info)
        info = {name: info.get(name, value) for name, value in after.info.items()}
        info |= {key: after.info[key] for key in KEPT}
        parts = jax.tree.map(
            where_done, (fresh.pipeline_state, fresh.obs), (after.pipeline_state, after.obs)
        )
        return after.replace(pipeline_state=parts[0], obs=parts[1], info=info)


KEPT = ("steps", "robustness", "stl_lower", "stl_upper", "stl_violated")


def test_info_resets_keep_other_environments() -> None:
    assert arrays.episode(SPEC, 0.1).init(ENTRIES).rows.shape[0] == ENTRIES
    counted = EpisodeWrapper(VmapWrapper(Drift()), 7, 1)
    _, found, _ = rollout(FullReset(StlWrapper(counted, SPEC, SIGNALS, cost="depth")))
    _, expected, _ = rollout(wrapped(SPEC, SIGNALS, cost="depth"))
    for key in KEPT:
        np.testing.assert_array_equal(found.info[key], expected.info[key])


def test_costs_are_summed_with_metrics() -> None:
    env = wrapped("always(x < 0.8)", {"x": "obs[0]"}, cost="violation", on_violation="report")
    first, states, _ = rollout(env)
    goes_on = np.asarray(states.done) == 0  # the observations of the others are from resets
    cost = np.asarray(states.info["cost"])
    assert not np.asarray(first.info["cost"]).any()
    np.testing.assert_array_equal(cost[goes_on], np.asarray(states.obs)[goes_on, 0] >= 0.8)
    assert cost.any()
    np.testing.assert_array_equal(states.metrics["cost"], cost)


def test_observed_state_is_hidden_from_the_environment() -> None:
    env = wrapped("always(x < 0.8)", {"x": "obs[0]"}, observe="state")
    first, states, _ = rollout(env)
    assert env.observation_size == 7
    assert states.obs.shape == (40, ENTRIES, 7)
    plain, bare, _ = rollout(wrapped("always(x < 0.8)", {"x": "obs[0]"}))
    np.testing.assert_array_equal(states.obs[..., :2], bare.obs)
    robustness = 0.8 - np.asarray(plain.obs)[:, 0]
    np.testing.assert_allclose(first.obs[:, 2], np.clip(robustness, -1, 1), atol=1e-7)


def test_repeated_action_is_one_sample() -> None:
    env = wrapped("always(y > -9)", {"y": "obs[1]"}, length=8, repeat=2, on_violation="report")
    _, states, _ = rollout(env, steps=3)
    assert np.asarray(states.info["stl_state"].samples).max() <= 4


def test_function_and_metric_signals() -> None:
    signals = {"x": lambda step: step.state.pipeline_state[0], "far": "metrics['far']"}
    env = wrapped("always(x < 0.5 and far < 3)", signals, on_violation="report")
    _, states, _ = rollout(env)
    plain = wrapped(
        "always(x < 0.5 and abs(y) < 3)", SIGNALS | {"y": "obs[1]"}, on_violation="report"
    )
    # The metric of a reset is 0, and all else is from the observation.
    _, expected, _ = rollout(plain)
    np.testing.assert_array_equal(states.info["stl_violated"], expected.info["stl_violated"])


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        (
            {"x": "obs[2]"},
            "signal 'x': obs[2] does not fit the values of one environment, an array of shape (2,)",
        ),
        (
            {"x": "metrics['fat']"},
            "signal 'x': metrics['fat'] has no 'fat'; the keys are far; did you mean 'far'?",
        ),
        (
            {"x": "obs"},
            "expected shape (5,) of 'x', got (5, 2); init() set the batch size",
        ),
    ],
)
def test_what_does_not_fit_raises_while_jax_traces(signals: Any, message: str) -> None:  # noqa: ANN401
    with pytest.raises(InputError) as error:
        rollout(wrapped("always(x < 1)", signals))
    assert str(error.value) == message


def test_constructor_errors() -> None:
    with pytest.raises(InputError) as error:
        wrapped("always(x < 1)", {"x": "action[0]"})
    assert "has no value at reset" in str(error.value)
    with pytest.raises(InputError) as error:
        StlWrapper(Drift(), "always(x < 1)", {"x": "obs[0]"}).reset(jax.random.PRNGKey(0))
    assert str(error.value) == (
        "StlWrapper needs an environment in VmapWrapper and then EpisodeWrapper. "
        "training_wrapper(specs, signals) builds the order that Brax trains with."
    )


@pytest.mark.filterwarnings("ignore:jax.device_put_replicated is deprecated:DeprecationWarning")
def test_ppo_trains_and_evaluates_under_the_wrapper() -> None:
    from brax.training.agents.ppo import networks
    from brax.training.agents.ppo import train as ppo

    jax.config.update("jax_enable_x64", False)  # noqa: FBT003 - Brax trains in float32
    wrap = training_wrapper(
        "always(x < 1.5)", {"x": "obs[0]"}, mode="add", observe="state", cost="violation"
    )
    rows: list[tuple[int, dict[str, Any]]] = []
    small = partial(
        networks.make_ppo_networks, policy_hidden_layer_sizes=(8,), value_hidden_layer_sizes=(8,)
    )
    make, params, metrics = ppo.train(
        Drift(),
        wrap_env_fn=wrap,
        num_timesteps=2000,
        num_evals=2,
        episode_length=20,
        num_envs=8,
        num_eval_envs=16,
        batch_size=8,
        num_minibatches=2,
        unroll_length=5,
        num_updates_per_batch=1,
        network_factory=small,
        progress_fn=lambda steps, found: rows.append((steps, found)),
        seed=1,
    )
    action, _ = make(params, deterministic=True)(jnp.zeros(7), jax.random.PRNGKey(0))
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - as before
    assert [steps for steps, _ in rows] == [0, 2000]
    assert action.shape == (1,)  # the policy sees two numbers and the five of the monitor
    for _, found in rows:
        # A violation ends an episode at once and costs 1; every other end is a success.
        rate, cost = found["eval/episode_is_success"], found["eval/episode_cost"]
        assert float(rate + cost) == pytest.approx(1.0)
        assert 0 < float(rate) < 1
    assert np.isfinite(float(metrics["eval/episode_reward"]))


@pytest.mark.parametrize("full_reset", [False, True])
def test_playground_resets_start_episodes(
    full_reset: bool,  # noqa: FBT001 - a case
) -> None:
    import mujoco_playground

    jax.config.update("jax_enable_x64", False)  # noqa: FBT003 - Playground mixes kinds else
    env = mujoco_playground.registry.load("CartpoleBalance")
    wrap = training_wrapper("always(upright > 0.9)", {"upright": "obs[1]"}, on_violation="report")
    env = wrap(env, episode_length=3, full_reset=full_reset)
    state = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), 2))
    step = jax.jit(env.step)
    samples, seen = [], []
    for _ in range(7):
        state = step(state, jnp.ones((2, 1)))
        samples.append(np.asarray(state.info["stl_state"].samples)[0].tolist())
        seen.append((np.asarray(state.done) > 0).tolist())
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - as before
    assert seen == [[False] * 2, [False] * 2, [True] * 2] * 2 + [[False] * 2]
    assert [each for each, over in zip(samples, seen, strict=True) if not over[0]] == [
        [2, 2], [3, 3], [2, 2], [3, 3], [2, 2]
    ]  # fmt: skip


def test_the_examples_of_docstrings_show_what_happens() -> None:
    done = doctest.testmod(wrappers)
    assert done.attempted
    assert not done.failed
