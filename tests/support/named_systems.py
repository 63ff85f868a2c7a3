"""Systems that a file can name: ``named_systems:pump``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]

from rtamt_gym import Waveform

PENDULUM = """
<mujoco model="pendulum">
  <option timestep="0.01"/>
  <worldbody><body pos="0 0 1">
    <joint name="hinge" axis="0 1 0" damping=".05"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02"/>
  </body></worldbody>
  <actuator><motor joint="hinge"/></actuator>
</mujoco>
"""


def wave(time: float, gain: float, drive: Callable[[float], float]) -> Mapping[str, float]:
    """A function of time."""
    return {"x": gain * drive(time) + time / 7}


def pump(inflow: float, leak: float = 0.1) -> Iterator[Mapping[str, float]]:
    """A generator function."""
    level = 1.0
    for _ in range(20):
        yield {"x": level}
        level += inflow - leak * level


def pendulum() -> Any:  # noqa: ANN401 - MuJoCo is not typed
    """A model and its data."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    return model, mujoco.MjData(model)


def lean(obs: Any) -> int:  # noqa: ANN401
    """A policy for a pole on a cart."""
    return int(obs[2] + 0.1 * obs[3] > 0)


def swing(_model: Any, data: Any) -> None:  # noqa: ANN401
    """A policy for the pendulum."""
    data.ctrl[0] = -0.1 * data.qvel[0]


def wrapped() -> gym.Env[Any, Any]:
    """An environment below a wrapper."""
    return gym.wrappers.TimeAwareObservation(gym.make("CartPole-v1"))


class Lamp:
    """An object that is not a function, with a method."""

    def burn(self, time: float) -> Mapping[str, float]:
        """A bound method."""
        return {"x": time}


burn = Lamp().burn
drive = Waveform([0, 1], [2, 3])
