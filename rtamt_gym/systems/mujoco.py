"""MuJoCo models and `StepMonitor`s as systems."""

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
from rtamt_gym.mujoco.step_monitor import StepMonitor, renderer
from rtamt_gym.signals.mujoco import bind_signal, check_pair, derive
from rtamt_gym.signals.signals import parse_signals
from rtamt_gym.signals.sources import MUJOCO
from rtamt_gym.systems.mujoco_case import Driven, copy_data, drive
from rtamt_gym.systems.system import Policy, Signals, System, exited, whole_steps

_STATE = frozenset({"time", "qpos", "qvel", "act", "ctrl"})
"""The fields that `mj_step` updates last; it derives all others from the previous state."""


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
        """Return a copy of model and data with the entries of a case."""
        driven = drive(self._model, self._data, case, self.name)
        return MujocoModel(driven.model, driven.data, self._policy, driven)

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Bind the selectors and count the steps in a period."""
        parsed = parse_signals(signals or {}, variables, MUJOCO, extra=True)
        self._reads = [bind_signal(signal, self._model, self._data) for signal in parsed]
        self._derives = not all(signal.source in _STATE for signal in parsed)
        timestep, phrase = exact(self._model.opt.timestep), f"timestep of {self.name},"
        self._steps = whole_steps(period or timestep, timestep, "period", phrase)

    def start(self) -> list[float]:
        """Derive everything that depends on the state; return the first sample."""
        if self._driven is not None and self._driven.inputs:
            self._set_inputs = self._driven.setter()
        derive(self._model, self._data)
        return [read() for read in self._reads]

    def advance(self) -> list[float]:
        """Make the steps of a period; then derive quantities for the signals from the new state."""
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

    def renderer(self) -> Callable[[], Any]:
        """Return a function that renders the simulation."""
        return renderer(self._model, self._data)

    def close(self) -> None:
        """Do nothing: model and data belong to the caller."""


def model_name(model: Any) -> str:  # noqa: ANN401
    """Return the name of a model."""
    name: str = model.names.partition(b"\0")[0].decode()
    return name


def check_policy(policy: object) -> None:
    """Raise InputTypeError unless a policy is None or callable."""
    if policy is not None and not callable(policy):
        raise InputTypeError(
            f"expected a policy, a function of model and data that sets data.ctrl, got {policy!r}"
        )


def check_time(data: Any, due: float, name: str) -> None:  # noqa: ANN401
    """Raise StateError if a step has ended at another time: MuJoCo has reset the simulation."""
    if data.time != due:
        raise StateError(
            f"expected the time {due:g} s of {name} after a step, got {data.time:g} s: MuJoCo "
            "found the simulation unstable and reset it"
        )


_SPARES: WeakKeyDictionary[StepMonitor, list[Any]] = WeakKeyDictionary()
"""Spare data in which a branch saves the monitor's simulation: making data takes longer than a
branch of a hundred steps of a small model."""


class Monitored(System):
    """A `StepMonitor`, its simulation, and the policy that sets ``data.ctrl``."""

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
        """Do nothing: the monitor has bound its signals."""

    def start(self) -> list[float]:
        """Go to the start of the run; return its values, which update sample 0 if it is missing."""
        monitor, self._taken = self._monitor, []
        known: Mapping[str, float] = {}
        if self._start is not None:
            self._set_aside()
            self._start.restore(monitor)
            if not monitor.forward:
                derive(monitor.model, monitor.data)  # replaces values of another branch
            # restore: `derive` updates values that `mj_step` leaves one step late
            known = self._start.values
        self._ends.enter_context(monitor.recorded(self._keep))
        monitor.begin()
        return self._taken or [known.get(name, now) for name, now in monitor.values.items()]

    def advance(self) -> list[float]:
        """Make a step, which feeds the monitor; return these values."""
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

    def renderer(self) -> Callable[[], Any]:
        """Return a function that renders the simulation."""
        return renderer(self._monitor.model, self._monitor.data)

    def close(self) -> None:
        """Leave the monitor at the last sample, or restore it after a branch."""
        self._ends.close()

    def _keep(self, values: list[float]) -> None:
        self._taken = values

    def _set_aside(self) -> None:
        """Save the exact state of monitor and simulation until `close`."""
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
