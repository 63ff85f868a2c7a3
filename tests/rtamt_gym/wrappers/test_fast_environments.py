"""Vector monitors around the forms of EnvPool and of PufferLib, with stand-ins."""

from __future__ import annotations

import copy
import functools
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fast_environments import NativeCounters, Pool, SharedEnvironments
from gymnasium.vector import AutoresetMode
from vector_environments import ANGLE, TEXT, difference, make_pole, native, sync

from rtamt import InputError, InputTypeError, StateError
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward
from rtamt_gym.wrappers import SharedBuffers, as_vector_env

NEXT_STEP = AutoresetMode.NEXT_STEP
SAFE = "always(abs(theta) < 0.1)"


def make_rewarded_pole() -> gym.Env[Any, Any]:
    return StlReward(make_pole(), SAFE, ANGLE, mode="add", on_violation="report")


def actions(num: int, steps: int) -> Any:
    return np.random.default_rng(3).integers(0, 2, (steps, num))


def pool(*given: Any) -> Any:
    return Pool(*given)


def shared_environments(*given: Any) -> Any:
    return SharedEnvironments(*given)


def counters(num: int) -> Any:
    return NativeCounters(num)


# ---- the form of EnvPool ----


def test_a_pool_says_what_gymnasiums_own_vector_environment_says() -> None:
    own = native(5)
    envs = VectorStlMonitor(pool(5), TEXT, ANGLE, period=0.02)
    twin = VectorStlMonitor(own, TEXT, ANGLE)
    shown: Any = envs.reset()
    expected: Any = twin.reset(seed=5)
    for item in [None, *actions(5, 60)]:
        if item is not None:
            shown, expected = envs.step(item), twin.step(item)
        elapsed = shown[-1].pop("elapsed_step")
        shown[-1].pop("env_id", None)
        assert (elapsed + 1).tolist() == envs.samples.tolist()
        (_, *message), (_, *due) = shown, expected
        assert difference(message[-1], due[-1]) == ""
        assert np.array_equal(shown[0], expected[0])
    assert len(envs.stl_episodes) > 5
    assert str(envs) == "<VectorStlMonitor<Pool of 5 environments>, period 0.02 s>"


def test_a_pool_has_no_period_of_its_own() -> None:
    with pytest.raises(ValueError, match="give period= in seconds"):
        VectorStlMonitor(pool(2), TEXT, ANGLE)
    assert VectorStlMonitor(pool(2), TEXT, ANGLE, period=0.02).period is not None


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (functools.partial(pool, 4, 2), "got an EnvPool with num_envs=4 and batch_size=2"),
        (functools.partial(pool, 4, None, 2), "one player in each environment"),
    ],
)
def test_pools_whose_environments_do_not_step_together_are_refused(make: Any, text: str) -> None:
    with pytest.raises(InputError, match=text):
        VectorStlMonitor(make(), SAFE, ANGLE)


def test_what_a_pool_cannot_do_at_a_reset_is_refused() -> None:
    envs = as_vector_env(pool(2))
    with pytest.raises(InputError, match=r"seeded where it is made: envpool\.make_gymnasium"):
        envs.reset(seed=1)
    with pytest.raises(InputError, match=r"reset\(\) of EnvPool without options"):
        envs.reset(options={"far": 1})


@pytest.mark.parametrize("wrapper", [StlMonitor, functools.partial(StlReward, mode="add")])
def test_wrappers_of_one_environment_refuse_a_pool(wrapper: Any) -> None:
    with pytest.raises(InputTypeError, match="VectorStlReward for many environments"):
        wrapper(pool(2), SAFE, ANGLE)


def test_what_is_no_vector_environment_is_refused_with_the_ways_to_make_one() -> None:
    with pytest.raises(InputTypeError, match=r"gym\.make_vec, envpool\.make_gymnasium or puffer"):
        as_vector_env(3)
    with pytest.raises(InputTypeError, match="use StlMonitor or StlReward for one environment"):
        as_vector_env(gym.make("CartPole-v1"))
    with pytest.raises(ValueError, match="final_obs"):
        as_vector_env(native(2), final_obs="lost")  # type: ignore[arg-type]


# ---- the form of PufferLib: environments of Gymnasium ----


def test_shared_arrays_say_what_a_monitor_around_each_environment_says() -> None:
    def monitored() -> gym.Env[Any, Any]:
        return StlMonitor(make_pole(), TEXT, ANGLE, on_violation="report")

    envs = VectorStlMonitor(shared_environments([make_pole] * 3), TEXT, ANGLE)
    twin = sync([monitored] * 3, NEXT_STEP)
    assert float(envs.period or 0) == 0.02
    shown: Any = envs.reset(seed=7)
    expected: Any = twin.reset(seed=7)
    assert difference(list(shown), list(expected)) == ""
    for item in actions(3, 60):
        shown, expected = envs.step(item), twin.step(item)
        assert difference(shown[-1], expected[-1]) == ""
        assert all(np.array_equal(a, b) for a, b in zip(shown[:4], expected[:4], strict=True))
    assert len(envs.stl_episodes) > 5


def test_rewards_are_written_into_the_array_that_the_learner_holds() -> None:
    shared = shared_environments([make_pole] * 3)
    learner = SharedBuffers(VectorStlReward(shared, SAFE, ANGLE, mode="add", weight=3.0))
    twin = VectorStlReward(sync([make_pole] * 3, NEXT_STEP), SAFE, ANGLE, mode="add", weight=3.0)
    twin.reset(seed=7)
    learner.async_reset(7)
    held = shared.observations, shared.rewards, shared.terminals, shared.truncations
    ended = 0
    for item in actions(3, 60):
        learner.send(item)
        *arrays, infos, ids, masks = learner.recv()
        assert all(array is own for array, own in zip(arrays, held, strict=True))
        obs, rewards, terminated, truncated, message = twin.step(item)
        assert np.array_equal(held[0], obs)
        assert np.array_equal(held[1], rewards.astype(np.float32))
        assert np.array_equal(held[2], terminated)
        assert np.array_equal(held[3], truncated)
        assert (ids.tolist(), masks.tolist()) == ([0, 1, 2], [True] * 3)
        over = np.flatnonzero(terminated | truncated)
        assert [info["ended"] for info in infos if "ended" in info] == over.tolist()
        told = [info for info in infos if "ended" not in info]
        assert len(told) == bool(len(over))
        if told:
            lows = message["stl_episode"]["spec"]["robustness"][over].tolist()
            assert told[0]["stl/robustness"] == told[0]["stl/spec/robustness"] == lows
            assert told[0]["stl/satisfied"] == message["stl_success"][over].tolist()
            assert told[0]["stl/spec/satisfied"] == told[0]["stl/satisfied"]
        ended += len(over)
    assert ended > 5


def test_a_learners_other_calls_and_names_are_pufferlibs() -> None:
    shared = shared_environments([make_pole] * 2)
    learner = SharedBuffers(VectorStlMonitor(shared, SAFE, ANGLE))
    with pytest.raises(StateError, match=r"recv\(\) before a reset"):
        learner.recv()
    obs, infos = learner.reset(seed=1)
    assert obs is shared.observations
    assert infos == []
    assert len(learner.step(np.zeros(2, int))) == 5
    assert learner.driver_env is shared.driver_env
    assert learner.num_agents == 2
    with pytest.raises(AttributeError, match="no_such"):
        _ = learner.no_such
    learner.close()
    assert shared.closed


def test_a_learner_may_copy_what_it_holds_and_ask_for_protocols() -> None:
    shared = shared_environments([make_pole] * 2)
    learner = SharedBuffers(VectorStlMonitor(shared, SAFE, ANGLE))
    obs, _ = learner.reset(seed=1)
    again = copy.copy(learner)
    assert again.recv()[0] is obs
    assert again.driver_env is shared.driver_env
    shared.__array__ = lambda *_: np.zeros(3)  # the environments' own protocols are not its own
    assert not hasattr(learner, "__array__")


def test_monitors_around_the_environments_write_rewards_and_ends_themselves() -> None:
    shared = shared_environments([make_rewarded_pole] * 2)
    twin = sync([make_rewarded_pole] * 2, NEXT_STEP)
    twin.reset(seed=4)
    shared.async_reset(4)
    for item in actions(2, 40):
        shared.send(item)
        obs, rewards, terminated, truncated, _ = twin.step(item)
        assert np.array_equal(shared.observations, obs)
        assert np.array_equal(shared.rewards, rewards.astype(np.float32))
        assert np.array_equal(shared.terminals | shared.truncations, terminated | truncated)
    with pytest.raises(InputError, match="StlMonitor around each of its environments"):
        VectorStlMonitor(shared, SAFE, ANGLE)


def test_shared_buffers_refuse_what_the_shared_arrays_cannot_hold() -> None:
    with pytest.raises(InputError, match="around environments of PufferLib"):
        SharedBuffers(VectorStlMonitor(native(2), SAFE, ANGLE))
    wider = VectorStlMonitor(shared_environments([make_pole]), SAFE, ANGLE, observe="state")
    with pytest.raises(InputError, match="leave observe= out"):
        SharedBuffers(wider)


def test_environments_that_do_not_step_together_are_refused() -> None:
    shared = shared_environments([make_pole] * 4)
    shared.agents_per_batch = 2
    with pytest.raises(InputError, match="4 of PufferLib in batches of 2"):
        as_vector_env(shared)
    with pytest.raises(InputError, match="put ParallelStlMonitor around the environment in it"):
        as_vector_env(shared_environments([make_pole], 2))
    envs = as_vector_env(shared_environments([make_pole] * 2))
    with pytest.raises(InputError, match=r"reset\(\) of PufferLib without options"):
        envs.reset(options={"far": 1})


def test_an_agent_that_is_absent_is_an_error() -> None:
    shared = counters(3)
    envs = as_vector_env(shared, final_obs="held")
    shared.masks[1] = False
    with pytest.raises(StateError, match="got none for agent 1"):
        envs.reset()


# ---- the form of PufferLib: native environments ----


def test_native_environments_are_refused_unless_the_last_observation_is_held() -> None:
    with pytest.raises(InputError) as caught:
        VectorStlMonitor(counters(2), "always(x < 9)", {"x": "obs[0]"})
    assert str(caught.value) == (
        "expected environments that show the last observation of an episode, got <NativeCounters> "
        "of PufferLib, which replaces it by the first observation of the next episode; "
        "as_vector_env(env, final_obs='held') uses the observation before it instead"
    )


def test_the_observation_before_stands_for_the_last_and_the_reward_is_its_own() -> None:
    shared = counters(2)
    envs = as_vector_env(shared, final_obs="held")
    signals: Any = {"x": "obs[0]", "paid": ("reward", 0.0)}
    specs = {"x": "always(x < 3.5)", "paid": "always(paid < 3.5)"}
    learner = SharedBuffers(
        VectorStlReward(envs, specs, signals, mode="terminal", weight=2.0, clip=9.0)
    )
    assert learner.reset()[0].tolist() == [[0], [1]]
    paid, told = [], []
    for _ in range(4):
        *_, infos = learner.step(np.zeros(2, int))
        paid.append(shared.rewards.tolist())
        told += infos
    # Environment 1 ends at the third step, seen as 3 and paid 4; environment 0 at the fourth.
    assert paid == [[1, 2], [2, 3], [3, 4 + 2 * -0.5], [4 + 2 * -0.5, 2]]
    lows = {"stl/robustness": [-0.5], "stl/x/robustness": [0.5], "stl/paid/robustness": [-0.5]}
    result = {"stl/satisfied": [0.0], "stl/x/satisfied": [1.0], "stl/paid/satisfied": [0.0]}
    assert told == [{**lows, **result}] * 2
