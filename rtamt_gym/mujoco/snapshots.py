"""Snapshots of a MuJoCo simulation with its monitors, to branch from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError
from rtamt_gym.mujoco.step_monitor import StepMonitor
from rtamt_gym.signals.mujoco import derive

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""The state that MuJoCo's next steps depend on, including the warm start of its solver."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Snapshot:
    """A `StepMonitor` and its simulation at an instant.

    After `restore` the simulation continues exactly as before, bit for bit, and so do robustness,
    bounds and verdicts, any number of times, in the same monitor or in another monitor with the
    same model and specifications. A snapshot holds no model and can be pickled.

    It does not hold derived quantities (``xpos``, ``sensordata``, contacts): the next step derives
    them. `restore` derives them at once if the monitor has ``forward=True``; otherwise a controller
    that reads them before the first step gets values of another branch.

    `simulate` runs a branch, and does not change the monitor.

    Attributes:
        values: The value of every signal of the monitor; empty before sample 0.

    Example:
        >>> import mujoco
        >>> from rtamt_gym import StepMonitor
        >>> model = mujoco.MjModel.from_xml_string('''
        ...     <mujoco><worldbody><body><joint name="up" type="slide" axis="0 0 1"/>
        ...     <geom size=".1"/></body></worldbody>
        ...     <actuator><motor name="lift" joint="up" gear="100"/></actuator></mujoco>''')
        >>> monitor = StepMonitor(
        ...     model, mujoco.MjData(model), "always(z > -1)", {"z": "joint:up.qpos"}
        ... )
        >>> monitor.reset()
        >>> before = Snapshot.of(monitor)
        >>> for lift in (0.0, 0.5):
        ...     before.restore(monitor)
        ...     monitor.data.ctrl[0] = lift
        ...     print(monitor.run(1.0).name, monitor.samples)
        VIOLATED 227
        UNDECIDED 501
    """

    values: Mapping[str, float]
    _simulation: NDArray[np.float64]
    _monitor: tuple[Any, ...]

    @classmethod
    def of(cls, monitor: StepMonitor) -> Snapshot:
        """Take a snapshot.

        Raises:
            InputTypeError: If ``monitor`` is not a `StepMonitor`.
        """
        if not isinstance(monitor, StepMonitor):
            raise InputTypeError(f"expected a StepMonitor, got {monitor!r}")
        simulation = np.empty(mujoco.mj_stateSize(monitor.model, _STATE))
        mujoco.mj_getState(monitor.model, monitor.data, simulation, _STATE)
        values = monitor.values if monitor.samples else {}
        return cls(values, simulation, monitor.state())

    def restore(self, monitor: StepMonitor) -> None:
        """Set the simulation and its monitors back to this instant.

        Raises:
            InputError: If the monitor's model has another state, or its specifications differ.
        """
        size = mujoco.mj_stateSize(monitor.model, _STATE)
        if size != len(self._simulation):
            raise InputError(
                f"expected a snapshot of the same model, with {size} numbers of state, got one "
                f"with {len(self._simulation)}"
            )
        monitor.restore(self._monitor)
        mujoco.mj_setState(monitor.model, monitor.data, self._simulation, _STATE)
        if monitor.forward:
            derive(monitor.model, monitor.data)

    def __repr__(self) -> str:
        return f"<Snapshot with {len(self._simulation)} numbers of state>"
