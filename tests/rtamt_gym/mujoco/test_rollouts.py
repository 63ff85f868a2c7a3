"""Rollouts of MuJoCo under specifications equal monitors step by step."""

from typing import Any

import mujoco  # type: ignore[import-untyped]
import mujoco.rollout  # type: ignore[import-untyped]
import numpy as np
import pytest

from rtamt import evaluate
from rtamt_gym import StepMonitor
from rtamt_gym.mujoco import evaluate_rollouts

XML = """
<mujoco>
  <option timestep="0.01" integrator="{integrator}"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <body name="ball" pos="0 0 .5"><freejoint name="free"/><geom size=".1"/></body>
    <body name="pole" pos="1 0 1">
      <joint name="hinge" axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto="0 0 0 0 0 .6"/><site name="tip" pos="0 0 .6"/>
    </body>
  </worldbody>
  <actuator>
    <general name="motor" joint="hinge" dyntype="filter" dynprm=".1" gainprm="1"/>
  </actuator>
  <sensor><framepos name="tip" objtype="site" objname="tip"/><jointvel name="speed" joint="hinge"/>
  </sensor>
</mujoco>
"""
SIGNALS = {
    "t": "time",
    "z": "qpos[2]",
    "v": "qvel[2]",
    "u": "act[0]",
    "hinge": "joint:hinge.qpos",
    "speed": "joint:hinge.qvel[0]",
    "sensed": "sensor:speed",
    "tip": "sensor:tip[2]",
    "raw": "sensordata[0]",
}
SPECS = {
    "bounces": "always(z < 0.2 implies eventually[0:0.3](v > 0))",
    "sweeps": "eventually[0:0.5](tip < 1.5 and abs(hinge) > 0.1) until[0:1] (raw < 2 or t > 0.5)",
    "calm": "historically[0:0.2](abs(speed - sensed) < 1) and abs(u) < 2",
}


def rolled_out(integrator: str) -> tuple[Any, Any, Any, Any, Any]:
    model = mujoco.MjModel.from_xml_string(XML.format(integrator=integrator))
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    rng = np.random.default_rng(1)
    initial = np.zeros((4, size))
    data = mujoco.MjData(model)
    for i in range(4):
        data.qpos[7] = rng.normal()
        data.qpos[2] = rng.uniform(0.2, 0.6)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        mujoco.mj_getState(model, data, initial[i], kind)
    control = rng.normal(size=(4, 80, 1))
    states, sensed = mujoco.rollout.rollout(model, mujoco.MjData(model), initial, control)
    return model, initial, control, states, sensed


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
def test_a_rollout_has_the_robustness_of_the_samples_of_a_monitored_loop(integrator: str) -> None:
    model, initial, control, states, sensed = rolled_out(integrator)
    result = evaluate_rollouts(model, SPECS, SIGNALS, states, sensed)
    assert {name: values.shape for name, values in result.items()} == dict.fromkeys(SPECS, (4, 80))
    for i in range(4):
        data = mujoco.MjData(model)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        mujoco.mj_setState(model, data, initial[i], kind)
        monitor = StepMonitor(model, data, SPECS, SIGNALS, view="step")
        rows = []
        for k in range(80):
            data.ctrl[:] = control[i, k]
            monitor.step()
            rows.append(monitor.values)
        columns = {name: [row[name] for row in rows] for name in SIGNALS}
        for name, values in result.items():
            offline = evaluate(SPECS[name], columns, monitor.period)
            assert values[i].tolist() == offline.tolist()


def test_the_first_sample_is_the_initial_state_where_it_is_put_before_the_others() -> None:
    model, initial, _, states, _ = rolled_out("Euler")
    whole = np.concatenate([initial[:, None], states], axis=1)
    result = evaluate_rollouts(model, "z > 0", {"z": "qpos[2]"}, whole)["spec"]
    assert result[:, 0].tolist() == initial[:, 3].tolist()
    assert np.array_equal(
        result[:, 1:], evaluate_rollouts(model, "z > 0", {"z": "qpos[2]"}, states)["spec"]
    )


def test_rollouts_of_one_step() -> None:
    model, *_, states, _ = rolled_out("Euler")
    z = {"z": "qpos[2]"}
    one = evaluate_rollouts(model, "z > 0", z, states[:, :1])["spec"]
    assert np.array_equal(one, evaluate_rollouts(model, "z > 0", z, states)["spec"][:, :1])


def test_bounds_count_steps_with_a_period_of_1() -> None:
    model, _, _, states, _ = rolled_out("Euler")
    seconds = evaluate_rollouts(model, "always[0:0.05](z > 0)", {"z": "qpos[2]"}, states)
    steps = evaluate_rollouts(model, "always[0:5](z > 0)", {"z": "qpos[2]"}, states, period=1)
    assert np.array_equal(seconds["spec"], steps["spec"])
