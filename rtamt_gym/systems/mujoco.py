"""A MuJoCo model with its controller, as a system that `simulate` runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from typing import Any
from weakref import WeakKeyDictionary

import mujoco  # type: ignore[import-untyped]

from rtamt import InputTypeError, StateError
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case
from rtamt_gym.mujoco.snapshots import Snapshot
from rtamt_gym.mujoco.step_monitor import StepMonitor
from rtamt_gym.signals.mujoco import bind_signal, check_pair, derive
from rtamt_gym.signals.signals import parse_signals
from rtamt_gym.signals.sources import MUJOCO
from rtamt_gym.systems.mujoco_case import Driven, copy_data, drive
from rtamt_gym.systems.system import Policy, Signals, System, exited, whole_steps

_STATE = frozenset({"time", "qpos", "qvel", "act", "ctrl"})
"""What `mj_step` updates last; it derives everything else from the state before the step."""


class MujocoModel(System):
    """A model, its data, and the policy that sets ``data.ctrl`` before every ``mj_step``."""

    needs_period = True
    endless = True

    def __init__(
        self,
        model: Any,  # noqa: ANN401
        data: Any,  # noqa: ANN401
        policy: Policy | None,
        driven: Driven | None = None,
    ) -> None:
        check_pair(model, data)
        check_policy(policy)
        self.name = model_name(model)
        self.period = float(model.opt.timestep)
        self._model = model
        self._data = data
        self._policy = policy
        self._driven = driven
        self._set_inputs: Callable[[], None] | None = None

    def driven(self, case: Case) -> MujocoModel:
        """A copy of model and data with what a case says of them."""
        driven = drive(self._model, self._data, case, self.name)
        return MujocoModel(driven.model, driven.data, self._policy, driven)

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Binds the selectors and counts the steps in a period."""
        parsed = parse_signals(signals or {}, variables, MUJOCO, extra=True)
        self._reads = [bind_signal(signal, self._model, self._data) for signal in parsed]
        self._derives = not all(signal.source in _STATE for signal in parsed)
        timestep, of = exact(self._model.opt.timestep), f"timestep of {self.name},"
        self._steps = whole_steps(period or timestep, timestep, "period", of)

    def start(self) -> list[float]:
        """Derives everything that depends on the state; gives the values of the first sample."""
        if self._driven is not None and self._driven.inputs:
            self._set_inputs = self._driven.setter()
        derive(self._model, self._data)
        return [read() for read in self._reads]

    def advance(self) -> list[float]:
        """Makes the steps of a period; then derives what the signals need from the new state."""
        model, data = self._model, self._data
        for _ in range(self._steps):
            if self._policy is not None:
                try:
                    self._policy(model, data)
                except SystemExit as end:
                    raise exited("the policy", end) from end
            if self._set_inputs is not None:
                self._set_inputs()
            due = data.time + model.opt.timestep
            mujoco.mj_step(model, data)
            check_time(data, due, self.name)
        if self._derives:
            derive(model, data)
        return [read() for read in self._reads]

    def close(self) -> None:
        """Leaves model and data as they are: they belong to the caller."""


def model_name(model: Any) -> str:  # noqa: ANN401
    """The name of a model."""
    name: str = model.names.partition(b"\0")[0].decode()
    return name


def check_policy(policy: object) -> None:
    """Raises an `InputTypeError` unless a policy is None or can be called."""
    if policy is not None and not callable(policy):
        raise InputTypeError(
            f"expected a policy, a function of model and data that sets data.ctrl, got {policy!r}"
        )


def check_time(data: Any, due: float, name: str) -> None:  # noqa: ANN401
    """Raises a `StateError` unless a step of a simulation has ended at the time that is due."""
    if data.time != due:
        raise StateError(
            f"expected the time {due:g} s of {name} after a step, got {data.time:g} s: MuJoCo "
            "found the simulation unstable and reset it"
        )


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
