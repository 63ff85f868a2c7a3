"""A `StepMonitor` with its simulation, as a system that `simulate` runs on, or branches off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from typing import Any
from weakref import WeakKeyDictionary

import mujoco  # type: ignore[import-untyped]

from rtamt import InputTypeError
from rtamt_gym.mujoco.snapshots import Snapshot
from rtamt_gym.mujoco.step_monitor import StepMonitor
from rtamt_gym.signals.mujoco import derive
from rtamt_gym.simulation.crashes import exited
from rtamt_gym.simulation.mujoco import check_policy, check_time, model_name
from rtamt_gym.simulation.mujoco_case import copy_data
from rtamt_gym.simulation.systems import Policy, Signals, System

__all__ = ["Monitored"]

_SPARES: WeakKeyDictionary[StepMonitor, list[Any]] = WeakKeyDictionary()
"""Simulations that a branch may set the monitor's aside in: making one takes longer than a branch
of a hundred steps of a small model."""


class Monitored(System):
    """A monitor, its simulation, and the policy that sets ``data.ctrl`` before every ``mj_step``.

    Args:
        monitor: The monitor, which feeds itself.
        policy: A function of model and data, or None.
        start: Where to branch off. None: the monitor runs on.
    """

    endless = True

    def __init__(self, monitor: StepMonitor, policy: Policy | None, start: Snapshot | None) -> None:
        check_policy(policy)
        if start is not None and not isinstance(start, Snapshot):
            raise InputTypeError(f"expected start= as a Snapshot, got {start!r}")
        self.name = model_name(monitor.model)
        self.period = float(monitor.model.opt.timestep)
        self._monitor = monitor
        self._policy = policy
        self._start = start
        self._taken: list[float] = []
        self._ends = ExitStack()

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Has nothing to do: the monitor has bound its signals."""

    def start(self) -> list[float]:
        """Goes to where the run starts; returns the values there, fed as sample 0 if none was."""
        monitor, self._taken = self._monitor, []
        known: Mapping[str, float] = {}
        if self._start is not None:
            self._set_aside()
            self._start.restore(monitor)
            if not monitor.forward:
                derive(monitor.model, monitor.data)  # they still come from another branch
            # As they were: `derive` makes those new that `mj_step` leaves a step behind.
            known = self._start.values
        self._ends.enter_context(monitor.recorded(self._keep))
        monitor.begin()
        return self._taken or [known.get(name, now) for name, now in monitor.values.items()]

    def advance(self) -> list[float]:
        """Makes a step, which feeds the monitor; returns the values that it was fed."""
        monitor = self._monitor
        if self._policy is not None:
            try:
                self._policy(monitor.model, monitor.data)
            except SystemExit as end:
                raise exited("the policy", end) from end
        due = monitor.data.time + monitor.model.opt.timestep
        monitor.step()
        check_time(monitor.data, due, self.name)
        return self._taken

    def close(self) -> None:
        """Leaves the monitor at the last sample; after a branch, as it was before."""
        self._ends.close()

    def _keep(self, values: list[float]) -> None:
        self._taken = values

    def _set_aside(self) -> None:
        """Keeps monitor and simulation as they are, to the last number, until `close`."""
        monitor = self._monitor
        model, data = monitor.model, monitor.data
        spares = _SPARES.setdefault(monitor, [])
        aside = spares.pop() if spares else mujoco.MjData(model)
        copy_data(aside, model, data)
        state = monitor.state()

        def put_back() -> None:
            monitor.restore(state)
            copy_data(data, model, aside)
            spares.append(aside)

        self._ends.callback(put_back)
