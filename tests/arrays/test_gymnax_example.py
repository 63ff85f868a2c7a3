"""The example that trains on the device pays its requirement, and learns it."""

from __future__ import annotations

import importlib.util
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from paths import EXAMPLES

STEPS = 500  # the time limit of CartPole


@pytest.fixture(scope="module")
def example() -> ModuleType:
    name = "train_on_device"
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def driven(example: ModuleType, place: float) -> Any:  # noqa: ANN401 - arrays of each step
    """Return last observations, rewards and ends of an episode with a rule that reaches a place in
    3 s.
    """
    env, params = example.make_env()

    def step(carried: Any, moment: Any) -> Any:  # noqa: ANN401
        (x, v, theta, w), state = carried[0][:4], carried[1]
        ahead = x - place * jnp.minimum(1.0, moment / 150)
        action = (0.3 * ahead + 0.5 * v + 6.0 * theta + w > 0.0).astype(int)
        key = jax.random.fold_in(jax.random.key(0), moment)
        obs, state, reward, terminated, truncated, info = env.step(key, state, action, params)
        return (obs, state), (info["final_observation"], reward, terminated, truncated)

    begun = env.reset(jax.random.key(3), params)
    return jax.tree.map(np.asarray, jax.lax.scan(step, begun, jnp.arange(STEPS))[1])


def test_visiting_episode_has_more_value(example: ModuleType) -> None:
    worth = {}
    for place in (0.0, 0.45):
        obs, reward, terminated, _ = driven(example, place)
        assert (obs[:, 0].max() > 0.3) == (place > 0.0)
        assert not terminated.any()
        worth[place] = reward @ example.GAMMA ** np.arange(STEPS)
    assert worth[0.45] > 1.1 * worth[0.0]
    assert worth[0.0] > 0.0  # otherwise an early end would be a relief


def test_observation_at_the_time_limit(example: ModuleType) -> None:
    """The critic estimates its value, learned only from the others."""
    obs, _, _, truncated = driven(example, 0.45)
    np.testing.assert_array_equal(np.flatnonzero(truncated), [STEPS - 1])
    np.testing.assert_allclose(obs[-1], obs[-2], atol=0.5)
    lower, verdict = obs[:, 10], obs[:, 13]  # of the limit of the place
    np.testing.assert_array_equal(lower, -1.0)
    np.testing.assert_array_equal(verdict, 0.0)


def test_advantages_are_sums_of_errors_until_an_end(example: ModuleType) -> None:
    generator = np.random.default_rng(0)
    steps, entries = 12, 5
    value = generator.normal(size=(steps + 1, entries))
    reward = generator.normal(size=(steps, entries))
    over = generator.random((steps, entries)) < 0.25
    seen: dict[str, Any] = dict.fromkeys(example.Transition._fields)
    seen |= {"value": value[:-1], "reward": reward, "over": over}
    found = example.advantages(example.Transition(**seen), value[-1])
    expected = np.zeros((steps, entries))
    for entry in range(entries):
        for start in range(steps):
            for t in range(start, steps):
                following = 0.0 if over[t, entry] else value[t + 1, entry]
                error = reward[t, entry] + 0.99 * following - value[t, entry]
                expected[start, entry] += (0.99 * 0.95) ** (t - start) * error
                if over[t, entry]:
                    break
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


def test_a_short_training_learns_the_task(
    example: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(example, "UPDATES", 150)
    monkeypatch.setattr(example, "EPISODES", 20)
    policy, rates = jax.jit(example.train)(jax.random.key(100))
    assert rates[:10].mean() < 0.1
    assert rates[-10:].mean() > 0.8
    assert example.evaluate(policy).success.satisfied >= 0.9 * 20
