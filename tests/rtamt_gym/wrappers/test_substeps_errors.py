"""Simulations that cannot be followed inside a step are errors, at construction if possible."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from gymnasium.envs.mujoco.inverted_pendulum_v5 import InvertedPendulumEnv

from rtamt.errors import InputError, SpecificationError, StateError
from rtamt_gym import Step, StlMonitor, VectorStlMonitor


class OwnStep(InvertedPendulumEnv):
    """Steps its simulation without the monitored function."""

    def do_simulation(self, ctrl: Any, n_frames: int) -> None:
        self.data.ctrl[:] = ctrl
        mujoco.mj_step(self.model, self.data, nstep=n_frames)

    def __str__(self) -> str:
        return "<OwnStep>"


def test_a_bound_must_be_a_multiple_of_the_simulations_period_only() -> None:
    env = gym.make("InvertedPendulum-v5")
    StlMonitor(env, "eventually[0:0.02](x > 1)", {"x": "qpos[0]"}, substeps=True)
    with pytest.raises(SpecificationError, match=r"not a multiple of the period 0\.04 s") as caught:
        StlMonitor(env, "eventually[0:0.02](x > 1)", {"x": "qpos[0]"})
    assert caught.value.__notes__ == ["substeps=True takes samples 0.02 s apart, which fits"]
    # Not for a bound that no simulation step divides, nor for a period of the caller.
    for spec, period in [("eventually[0:0.03](x > 1)", None), ("eventually[0:0.02](x > 1)", 0.04)]:
        with pytest.raises(SpecificationError, match="not a multiple") as caught:
            StlMonitor(env, spec, {"x": "qpos[0]"}, period=period)
        assert not hasattr(caught.value, "__notes__")


def test_a_step_that_does_not_step_the_simulation_as_expected_is_noticed() -> None:
    env = StlMonitor(OwnStep(), "always(x < 9)", {"x": "qpos[0]"}, substeps=True)
    env.reset(seed=1)
    with pytest.raises(StateError) as caught:
        env.step(np.zeros(1, np.float32))
    assert str(caught.value) == (
        "expected a step of <OwnStep> to step its simulation, got none: it steps it without "
        "the function that is followed; leave out substeps=True"
    )


def test_a_timestep_that_changes_is_noticed_at_reset() -> None:
    env = gym.make("InvertedPendulum-v5")
    monitor = StlMonitor(env, "eventually[0:0.1](x > 1)", {"x": "qpos[0]"}, substeps=True)
    monitor.reset()
    simulation: Any = env.unwrapped
    simulation.model.opt.timestep = 0.01
    with pytest.raises(StateError, match=r"expected the period of 0\.02 s .* got 0\.01 s"):
        monitor.reset()


def test_an_error_of_the_environment_ends_the_episode() -> None:
    env = gym.make("InvertedPendulum-v5", disable_env_checker=True)
    monitor = StlMonitor(env, "always(x < 9)", {"x": "qpos[0]"}, substeps=True)
    monitor.reset(seed=1)
    with pytest.raises(ValueError, match="Action dimension mismatch"):
        monitor.step(np.zeros(2, np.float32))
    with pytest.raises(StateError, match="expected a running episode"):
        monitor.step(np.zeros(1, np.float32))
    monitor.reset(seed=1)
    monitor.step(np.zeros(1, np.float32))
    assert monitor.samples == 3


def late_nan(step: Step) -> float:
    time = step.env.unwrapped.data.time
    return math.nan if 0.05 < time < 0.07 else 0.0


def test_a_nan_in_the_middle_of_a_step_ends_the_episode() -> None:
    env = gym.make("InvertedPendulum-v5")
    monitor = StlMonitor(env, "always(x < 9)", {"x": late_nan}, substeps=True)
    for _ in range(2):
        monitor.reset(seed=1)
        monitor.step(np.zeros(1, np.float32))
        with pytest.raises(InputError, match="nan at sample 3"):
            monitor.step(np.zeros(1, np.float32))
        assert "_step_mujoco_simulation" not in vars(env.unwrapped)
        with pytest.raises(StateError, match="expected a running episode"):
            monitor.step(np.zeros(1, np.float32))


def test_a_vector_wrapper_does_not_look_inside() -> None:
    envs = gym.make_vec("InvertedPendulum-v5", 2, vectorization_mode="sync")
    arguments: dict[str, Any] = {"substeps": True}
    with pytest.raises(TypeError, match="substeps"):
        VectorStlMonitor(envs, "always(x < 9)", {"x": "qpos[0]"}, **arguments)
    envs.close()
