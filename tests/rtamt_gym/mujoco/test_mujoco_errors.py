"""Errors of monitors in MuJoCo: ``errors.txt`` has the calls and the exact texts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from catalogue import check, entries
from mujoco_models import arm

from rtamt_gym import StepMonitor
from rtamt_gym.mujoco import evaluate_rollouts
from rtamt_gym.results import Snapshot

ROLLED = """<mujoco><worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="ball" pos="0 0 .5"><freejoint name="free"/><geom size=".1"/></body>
<body name="pole" pos="1 0 1"><joint name="hinge" axis="0 1 0"/><geom size=".02"/>
<site name="tip" pos="0 0 .6"/></body></worldbody>
<actuator><general name="motor" joint="hinge" dyntype="filter" dynprm=".1"/></actuator>
<sensor><framepos name="tip" objtype="site" objname="tip"/></sensor></mujoco>"""


def monitor(specs: Any = "always(x < 1)", signals: Any = None, **options: Any) -> StepMonitor:
    return StepMonitor(*arm(), specs, {"x": "qpos[0]"} if signals is None else signals, **options)


def swapped() -> StepMonitor:
    model, data = arm()
    return StepMonitor(data, model, "always(x < 1)", {"x": "qpos[0]"})


def one(model: Any, data: Any) -> float:  # noqa: ARG001
    """A function as a signal."""
    return 1.0


def rollouts(reads: Any = "qpos[2]", states: Any = (2, 3, 17), sensed: Any = None) -> Any:
    """Evaluate rollouts of states and sensors of these shapes."""
    model = mujoco.MjModel.from_xml_string(ROLLED)
    sensors = None if sensed is None else np.zeros(sensed)
    return evaluate_rollouts(model, "always(x > 0)", {"x": reads}, np.zeros(states), sensors)


def restored_in_another() -> None:
    taken = monitor()
    taken.reset()
    model = mujoco.MjModel.from_xml_string(ROLLED)
    other = StepMonitor(model, mujoco.MjData(model), "always(x > 0)", {"x": "qpos[0]"})
    Snapshot.of(taken).restore(other)


def after_others() -> None:
    stepped = monitor("always(x < 9)")
    stepped.run(0.25)
    mujoco.mj_resetData(stepped.model, stepped.data)
    stepped.finish()


NAMES: dict[str, Any] = {
    "inf": math.inf,
    "Snapshot": Snapshot,
    **{f.__name__: f for f in (monitor, swapped, one, rollouts, restored_in_another, after_others)},
}


@pytest.mark.parametrize(
    ("call", "said"), entries(Path(__file__).with_name("errors.txt")), ids=lambda text: text[:60]
)
def test_errors_of_step_monitors(call: str, said: str) -> None:
    check(call, said, **NAMES)
