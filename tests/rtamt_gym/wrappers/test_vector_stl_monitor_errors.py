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
from vector_environments import Envs, native, sync

from rtamt import InputError, InputTypeError, RtamtError, SpecificationError, StateError
from rtamt_gym import VectorStlMonitor, VectorStlReward
from rtamt_gym.wrappers import batched
from rtamt_gym.wrappers.vector_forms import autoreset_mode

ANGLE = {"theta": "obs[2]"}
WAY_OUT = (
    "read obs[...], or wrap each environment: gym.make_vec(..., vectorization_mode='sync', "
    "wrappers=[...]) with StlMonitor"
)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (
            {"on_violation": "terminate"},
            InputError,
            (
                "on_violation='terminate' needs an environment that the caller resets, "
                "AutoresetMode.DISABLED, got AutoresetMode.NEXT_STEP of "
                "CartPoleVectorEnv(CartPole-v1, num_envs=2); wrap each environment, "
                "gym.make_vec(..., vectorization_mode='sync', wrappers=[...]) with StlMonitor, or "
                "take on_violation='report'"
            ),
        ),
        (
            {"specs": "theta < 1"},
            SpecificationError,
            (
                "specification 'spec' is about the first sample only; "
                "write always(theta < 1) or view='step'"
            ),
        ),
        (
            {"signals": {"theta": "obs[4]"}},
            InputError,
            (
                "signal 'theta': obs[4] does not fit: the observation space of one environment "
                "has 4 elements there, 0 to 3; it is Box(shape=(4,), dtype=float32)"
            ),
        ),
        (
            {"signals": {"theta": ("action[0]", 0.0)}},
            InputError,
            (
                "signal 'theta': action[0] does not fit: the action space of one environment "
                "needs no indices there; it is Discrete(2)"
            ),
        ),
        (
            {"signals": {"theta": "qpos[0]"}},
            InputError,
            (
                "signal 'theta': qpos[0] reads the simulations of a SyncVectorEnv, got "
                f"CartPoleVectorEnv(CartPole-v1, num_envs=2); {WAY_OUT}"
            ),
        ),
    ],
)
def test_what_cannot_be_monitored_is_refused_at_construction(
    arguments: dict[str, Any], error: type[RtamtError], message: str
) -> None:
    given: dict[str, Any] = {"specs": "always(theta < 1)", "signals": ANGLE, **arguments}
    with pytest.raises(error) as caught:
        VectorStlMonitor(native(2), **given)
    assert str(caught.value) == message


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
    # In Gymnasium before 1.4, the vector environment that is made last sets the mode of all.
    envs = sync([lambda: Replay([1.0])], AutoresetMode.SAME_STEP)
    envs.metadata["autoreset_mode"] = AutoresetMode.DISABLED
    assert autoreset_mode(envs) is AutoresetMode.SAME_STEP
    assert autoreset_mode(VectorWrapper(envs)) is AutoresetMode.SAME_STEP


def test_simulations_that_are_reset_before_the_end_is_seen_are_refused() -> None:
    envs = sync([functools.partial(gym.make, "HalfCheetah-v5")], AutoresetMode.SAME_STEP)
    with pytest.raises(InputError) as caught:
        VectorStlMonitor(envs, "always(z < 1)", {"z": "qpos[1]"})
    assert str(caught.value) == (
        "signal 'z': qpos[1] reads the simulations, and with AutoresetMode.SAME_STEP they are "
        f"reset before the end is seen; {WAY_OUT}"
    )


class Numbers(VectorWrapper):
    """Tells one of the ends in numbers."""

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


# ---- signals that say no number ----


def told(*infos: dict[str, Any]) -> Envs:
    """Environments with these infos."""

    def make(info: dict[str, Any]) -> Replay:
        env = Replay([3, 3, 3])
        env.info = info
        return env

    return sync([functools.partial(make, info) for info in infos], AutoresetMode.NEXT_STEP)


@pytest.mark.parametrize(
    ("infos", "signal", "error", "message"),
    [
        (
            [{"a": 1.0, "b": 2}, {"a": 1.0}],
            "info['c']",
            InputError,
            "signal 'x': the infos have no info['c']; their keys are 'a', 'b'",
        ),
        (
            [{"a": 1.0, "b": 2}, {"a": 1.0}],
            "info['b']",
            InputError,
            "signal 'x': the info of environment 1 has no info['b']",
        ),
        (
            [{"a": np.zeros(2)}, {"a": np.zeros(2)}],
            "info['a'][2]",
            InputError,
            (
                "signal 'x': the infos have no number at info['a'][2]; they have "
                "array([[0., 0.],\n       [0., 0.]])"
            ),
        ),
        (
            [{"a": np.zeros(3)}, {"a": np.zeros(3)}],
            "info['a']",
            InputTypeError,
            (
                "signal 'x': expected 2 numbers from info['a'], one for every environment, got "
                "shape (2, 3) and dtype float64"
            ),
        ),
        (
            [{"a": "word"}, {"a": "word"}],
            "info['a']",
            InputError,
            (
                "signal 'x': the infos have no number at info['a']; they have "
                "array(['word', 'word'], dtype=object)"
            ),
        ),
        (
            [{"a": {"b": 1}}, {"a": {"b": 1}}],
            "info['a']",
            InputError,
            (
                "signal 'x': the infos have no number at info['a']; they have {'b': array([1, 1]), "
                "'_b': array([ True,  True])}"
            ),
        ),
        (
            [{}, {}],
            batched(len),
            InputTypeError,
            (
                "signal 'x': expected 2 numbers from batched(len), one for every environment, got "
                "shape () and dtype int64"
            ),
        ),
    ],
)
def test_a_signal_that_says_no_number_of_each_is_refused(
    infos: list[dict[str, Any]], signal: Any, error: type[RtamtError], message: str
) -> None:
    envs = VectorStlMonitor(told(*infos), "always(x < 9)", {"x": (signal, 0.0)})

    def run() -> None:
        envs.reset()  # reads an info that is there
        envs.step(np.zeros((2, 1)))

    with pytest.raises(error) as caught:
        run()
    assert str(caught.value) == message
