"""Errors of `VectorStlMonitor`, mostly at construction, with a fix."""

from __future__ import annotations

import functools
import gc
import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from replay import Replay, X
from vector_environments import native, sync

from rtamt import InputError, InputTypeError, RtamtError, StateError
from rtamt_gym import VectorStlMonitor, VectorStlReward
from rtamt_gym.wrappers.vector_forms import autoreset_mode

ANGLE = {"theta": "obs[2]"}


def test_environments_stay_open_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    # As in Gymnasium before 1.3.
    monkeypatch.setattr(VectorEnv, "__del__", VectorEnv.close, raising=False)
    envs = native(2)
    with pytest.raises(InputError):
        VectorStlMonitor(envs, "always(theta < 1)", ANGLE, buffer_length=-1)
    with pytest.raises(InputError):
        VectorStlReward(envs, "always(theta < 1)", ANGLE, mode="add", weight=math.inf)
    gc.collect()
    assert not envs.closed
    envs.reset(seed=1)
    envs.close()


def test_shared_metadata_do_not_change_the_autoreset_mode() -> None:
    # In Gymnasium before 1.4, the last created vector environment sets the mode of all.
    envs = sync([lambda: Replay([1.0])], AutoresetMode.SAME_STEP)
    envs.metadata["autoreset_mode"] = AutoresetMode.DISABLED
    assert autoreset_mode(envs) is AutoresetMode.SAME_STEP
    assert autoreset_mode(VectorWrapper(envs)) is AutoresetMode.SAME_STEP


class Numbers(VectorWrapper):
    """Reports one of the ends in numbers."""

    def __init__(self, env: Any, place: int) -> None:
        super().__init__(env)
        self.place = place

    def step(self, actions: Any) -> Any:
        result = list(super().step(actions))
        result[self.place] = np.asarray(result[self.place]).astype(np.int8)
        return tuple(result)


@pytest.mark.parametrize(("place", "name"), [(2, "terminated"), (3, "truncated")])
def test_ends_that_are_no_flags_are_refused_at_the_first_step(place: int, name: str) -> None:
    inner = gym.make_vec("CartPole-v1", 2, vectorization_mode="sync")
    env = VectorStlMonitor(Numbers(inner, place), "always(abs(theta) < 9)", ANGLE)
    env.reset(seed=1)
    with pytest.raises(InputTypeError) as caught:
        env.step(np.array([1, 1]))
    assert str(caught.value) == (
        f"expected {name} of {env.env} as flags of dtype bool, got dtype int8; convert them in the "
        "step of a wrapper, .astype(bool)"
    )


def test_environments_of_different_periods_are_refused_where_it_matters() -> None:
    makes = [functools.partial(gym.make, "Pendulum-v1") for _ in range(2)]
    envs: Any = sync(makes, AutoresetMode.NEXT_STEP)
    envs.envs[1].unwrapped.dt = 0.1
    with pytest.raises(InputError) as caught:
        VectorStlMonitor(envs, "always[0:1](v < 1)", {"v": "obs[2]"})
    assert str(caught.value) == (
        "expected environments of one period, got 0.05, 0.1 s in SyncVectorEnv(num_envs=2); give "
        "period=, or period=1 to count steps"
    )
    VectorStlMonitor(envs, "always[0:1](v < 1)", {"v": "obs[2]"}, period=1)


def test_a_mode_of_autoreset_that_is_none_is_refused() -> None:
    envs = native(2)
    envs.metadata = {"autoreset_mode": "sometimes"}
    with pytest.raises(InputError) as caught:
        VectorStlMonitor(envs, "always(theta < 1)", ANGLE)
    assert str(caught.value) == (
        "expected an AutoresetMode as metadata['autoreset_mode'] of "
        "CartPoleVectorEnv(CartPole-v1, num_envs=2), got 'sometimes'"
    )


@pytest.mark.parametrize(
    ("mask", "error", "message"),
    [
        (
            [True, False],
            InputTypeError,
            "expected options['reset_mask'] as an array of booleans, got [True, False]",
        ),
        (
            np.array([1, 0]),
            InputTypeError,
            "expected options['reset_mask'] as an array of booleans, got array([1, 0])",
        ),
        (
            np.array([True]),
            InputError,
            (
                "expected options['reset_mask'] of shape (2,), true for one environment or more, "
                "got array([ True])"
            ),
        ),
        (
            np.array([False, False]),
            InputError,
            (
                "expected options['reset_mask'] of shape (2,), true for one environment or more, "
                "got array([False, False])"
            ),
        ),
    ],
)
def test_a_wrong_mask_is_refused_and_changes_nothing(
    mask: Any, error: type[RtamtError], message: str
) -> None:
    envs = VectorStlMonitor(native(2), "always(theta < 1)", ANGLE)
    envs.reset()
    with pytest.raises(error) as caught:
        envs.reset(options={"reset_mask": mask})
    assert str(caught.value) == message
    envs.step(np.zeros(2, np.int64))
    assert envs.samples.tolist() == [2, 2]


def test_calls_before_the_first_reset_are_refused() -> None:
    envs = VectorStlMonitor(native(2), "always(theta < 1)", ANGLE)
    with pytest.raises(StateError) as caught:
        envs.step(np.zeros(2, np.int64))
    assert str(caught.value) == (
        "expected running episodes, got step() before reset(); call reset()"
    )
    with pytest.raises(StateError) as caught:
        envs.reset(options={"reset_mask": np.array([True, False])})
    assert str(caught.value) == (
        "expected a reset of all environments before a reset of some, got "
        "options={'reset_mask': ...}; call reset()"
    )


def test_a_sample_that_is_nan_ends_the_run_until_the_next_reset() -> None:
    makes = [functools.partial(Replay, [3, x, 3]) for x in (3, math.nan)]
    envs = VectorStlMonitor(sync(makes, AutoresetMode.NEXT_STEP), "always(x > 1)", X)
    envs.reset()
    with pytest.raises(InputError, match="batch entry 1"):
        envs.step(np.zeros((2, 1)))
    with pytest.raises(StateError):
        envs.step(np.zeros((2, 1)))
    envs.reset()
    assert envs.samples.tolist() == [1, 1]
