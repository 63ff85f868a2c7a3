"""Small MuJoCo models, and a loop that simulates one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np

INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast")

# Boxes that are pushed over: contacts, so that the warm start of the solver matters, delayed
# sensors, and an actuator with a state.
BOXES = """
<mujoco model="boxes">
  <option timestep="0.005" integrator="{integrator}"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 .1"/>
    <body name="low" pos="0 0 .1"><freejoint/><geom name="low" type="box" size=".1 .1 .1"/></body>
    <body name="top" pos="0 0 .31"><freejoint name="top"/><geom type="box" size=".1 .1 .1"/></body>
    <body pos="-.6 0 .2">
      <joint name="rod" type="slide" axis="1 0 0"/><geom type="capsule" size=".05 .1"/>
    </body>
  </worldbody>
  <actuator><general joint="rod" dyntype="filter" dynprm=".05" gainprm="40"/></actuator>
  <sensor><framelinvel name="speed" objtype="body" objname="top"/></sensor>
</mujoco>
"""
BOXES_SPECS = {
    "stands": "always[0:2](z > 0.25)",
    "calm": "always[0:1](speed > 1 implies eventually[0:0.1](speed < 0.5))",
    "touches": "eventually[0:0.5](always[0:0.05](push > 1))",
}
BOXES_SIGNALS = {"z": "qpos[9]", "speed": "sensor:speed[0]", "push": "contact:floor,low.force"}

ARM = """
<mujoco model="arm">
  <option timestep="0.01" integrator="{integrator}"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <light name="sun" pos="0 0 3"/>
    <camera name="eye" pos="0 -2 1"/>
    <body name="arm" pos="0 0 .4">
      <joint name="shoulder" axis="0 1 0" damping=".1"/>
      <geom name="rod" type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
      <body name="hand" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" damping=".02"/>
        <geom name="finger" type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>
        <geom name="thumb" type="sphere" pos=".2 0 0" size=".04"/>
        <site name="grip" pos=".2 0 0"/>
      </body>
    </body>
    <body name="ball.1" pos=".8 0 .3">
      <freejoint name="loose"/>
      <geom name="skin" size=".1" margin=".05" gap=".05"/>
    </body>
  </worldbody>
  <tendon><fixed name="cord"><joint joint="elbow" coef="1"/></fixed></tendon>
  <actuator>
    <motor name="motor" joint="shoulder" gear="2"/>
    <motor name="pull" joint="elbow"/>
  </actuator>
  <sensor>
    <framepos name="where" objtype="site" objname="grip"/>
    <jointvel name="rate" joint="elbow"/>
    <accelerometer name="imu" site="grip"/>
  </sensor>
</mujoco>
"""


def arm(integrator: str = "Euler") -> tuple[Any, Any]:
    """Return a model and its data: an arm of two joints above a floor, and a falling ball."""
    model = mujoco.MjModel.from_xml_string(ARM.format(integrator=integrator))
    return model, mujoco.MjData(model)


def swing(model: Any, data: Any) -> None:  # noqa: ANN401
    """Set controls that depend only on the time."""
    data.ctrl[:] = [np.sin(3.0 * data.time), 0.3 * np.cos(7.0 * data.time)][: model.nu]


def record(
    model: Any,  # noqa: ANN401
    data: Any,  # noqa: ANN401
    steps: int,
    look: Callable[[Any], float],
    *,
    forward: bool = False,
) -> list[float]:
    """Simulate in a plain loop; return the values of ``look`` at the start and after every step."""
    mujoco.mj_forward(model, data)
    seen = [look(data)]
    for _ in range(steps):
        swing(model, data)
        mujoco.mj_step(model, data)
        if forward:
            warmstart = data.qacc_warmstart.copy()  # some versions of MuJoCo write it here
            mujoco.mj_forward(model, data)
            data.qacc_warmstart[:] = warmstart
        seen.append(look(data))
    return seen
