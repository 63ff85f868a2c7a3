"""MuJoCo models and `StepMonitor`s as systems, and cases of a model: states, constants, inputs."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from typing import Any, Final, Literal, NamedTuple
from weakref import WeakKeyDictionary

import mujoco  # type: ignore[import-untyped]
import numpy as np

from rtamt import InputError, InputTypeError, StateError
from rtamt.errors import nearest
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.mujoco.snapshots import Snapshot
from rtamt_gym.mujoco.step_monitor import StepMonitor, renderer
from rtamt_gym.signals.mujoco import bind_signal, check_pair, derive, field_of, index_in
from rtamt_gym.signals.selectors import Selector, Syntax, parse_selector
from rtamt_gym.signals.signals import parse_signals
from rtamt_gym.signals.sources import MUJOCO
from rtamt_gym.systems.system import (
    Policy,
    Signals,
    System,
    as_number,
    as_waveform,
    exited,
    like,
    whole_steps,
)

_DRIVABLE: Final = (
    "ctrl[0], actuator:NAME, qfrc_applied[0], joint:NAME.qfrc_applied and body:NAME.xfrc_applied[0]"
)
"""The entries that waveforms can drive."""


def _of_object(example: str) -> Syntax:
    return Syntax(example=example, names=1, field="required")


_WRITES: Final = {
    "ctrl": Syntax(example="ctrl[0]", common=True),
    "actuator": Syntax(example="actuator:motor", names=1, field="optional", common=True),
    "qpos": Syntax(example="qpos[0]", common=True),
    "qvel": Syntax(example="qvel[0]"),
    "act": Syntax(example="act[0]"),
    "qfrc_applied": Syntax(example="qfrc_applied[0]"),
    "opt": Syntax(example="opt.gravity[2]", field="required", common=True),
    "body": Syntax(example="body:pole.mass", names=1, field="required", common=True),
    "joint": _of_object("joint:hinge.damping"),
    "geom": _of_object("geom:foot.friction[0]"),
    "site": _of_object("site:grip.pos[2]"),
    "tendon": _of_object("tendon:cord.stiffness"),
    "camera": _of_object("camera:eye.pos[2]"),
    "light": _of_object("light:sun.pos[2]"),
}
"""The first words of the names of entries."""

_INITIAL: Final = {("joint", "qpos"), ("joint", "qvel"), ("actuator", "act")}
"""The fields of objects with an initial state."""

_DRIVES: Final = {("joint", "qfrc_applied"), ("body", "xfrc_applied"), ("actuator", "ctrl")}
"""The fields of objects that are inputs of a step."""


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
"""Spare data where a branch saves the monitor's simulation: making data takes longer than a branch
of a hundred steps of a small model."""


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


class Driven(NamedTuple):
    """Copies of a model and its data with the entries of a case."""

    model: Any
    data: Any
    inputs: list[tuple[Any, int, Waveform]]

    def setter(self) -> Callable[[], None]:
        """Return a function that sets the inputs of the next step, starting with the first."""
        period = self.model.opt.timestep
        drives = [
            (array, element, waveform.stepper(period)) for array, element, waveform in self.inputs
        ]
        step = 0

        def set_inputs() -> None:
            nonlocal step
            for array, element, value in drives:
                array[element] = value(step)
            step += 1

        return set_inputs


def copy_data(target: Any, model: Any, source: Any) -> None:  # noqa: ANN401 - MuJoCo is not typed
    """Copy all data of a simulation into data of the same model."""
    if not hasattr(mujoco, "mj_copyData"):
        raise InputError(
            "cases and branches of a MuJoCo model need MuJoCo 3.5 or newer, got "
            f"{mujoco.__version__}; install it: pip install 'mujoco>=3.5'"
        )
    mujoco.mj_copyData(target, model, source)


def drive(model: Any, data: Any, case: Case, name: str) -> Driven:  # noqa: ANN401
    """Copy a model and its data, and set the entries of a case."""
    model, present = copy.copy(model), data
    data = mujoco.MjData(model)
    copy_data(data, model, present)
    places = _find(model, data, case)
    inputs = []
    for key, position in places.items():
        if position.kind == "input":
            inputs.append((position.array, position.index, as_waveform(key, case[key])))
        elif position.kind == "state":
            position.array[position.index] = _number(key, case[key])
    _set_constants(model, case, places, name)
    return Driven(model, data, inputs)


def changed(model: Any, case: Case, name: str) -> Any:  # noqa: ANN401
    """Return a copy of an environment's model with the constants of a case."""
    model = copy.copy(model)
    places = _find(model, mujoco.MjData(model), case)
    for key, position in places.items():
        as_number(key, case[key], "its actions")
        if position.kind in {"input", "state"}:
            phrase = (
                "resets its state" if position.kind == "state" else "has actions for its inputs"
            )
            raise InputError(
                f"{name} takes no {key!r} of a case: it {phrase}; of its model a case sets "
                "constants, such as body:torso.mass or opt.gravity[2]"
            )
    _set_constants(model, case, places, name)
    return model


def is_of_model(name: str) -> bool:
    """Return whether the name of an entry starts like a name in a model."""
    return re.match(r"\w*", name)[0] in _WRITES  # type: ignore[index]  # an empty match is one


class _Place(NamedTuple):
    """The location of the number of an entry: an array and an index, or an option."""

    kind: Literal["input", "state", "constant", "option"]
    array: Any
    index: Any


def _find(model: Any, data: Any, case: Case) -> dict[str, _Place]:  # noqa: ANN401
    """Return the location of each entry of a case."""
    places: dict[str, _Place] = {}
    owners: dict[object, str] = {}
    for key in case:
        position = places[key] = _place(model, data, key)
        address = (
            position.index
            if position.kind == "option"
            else position.array[position.index :].ctypes.data
        )
        if address in owners:
            raise InputError(
                f"expected one entry of the case for a number, got {owners[address]!r} and {key!r}"
            )
        owners[address] = key
    return places


def _place(model: Any, data: Any, key: str) -> _Place:  # noqa: ANN401
    phrase = f"{key!r} of the case"
    selector = parse_selector(phrase, key, _WRITES)
    if selector.source == "opt":
        return _option(phrase, model, selector)
    field = selector.field or ("ctrl" if selector.source == "actuator" else "")
    selected = Selector(selector.source, selector.names, field, selector.path)
    kind: Literal["input", "state", "constant"] = "constant"
    if not selector.names:
        kind = "input" if selector.source in {"ctrl", "qfrc_applied"} else "state"
        array = getattr(data, selector.source)
    elif (selector.source, field) in _INITIAL:
        kind, array = "state", field_of(phrase, selected, data)
    elif (selector.source, field) in _DRIVES:
        kind, array = "input", field_of(phrase, selected, data)
    else:
        array = field_of(phrase, selected, model)
    if array.dtype.kind != "f":  # whole numbers are indices and kinds
        raise InputError(f"{phrase}: {selector} is a whole number, which a case cannot set")
    return _Place(kind, array.reshape(-1), index_in(phrase, selected, array.size))


def _option(phrase: str, model: Any, selector: Selector) -> _Place:  # noqa: ANN401
    """Return the location of a number in ``model.opt``."""
    options = [name for name in dir(model.opt) if not name.startswith("_")]
    if selector.field not in options:
        raise InputError(
            f"{phrase}: MuJoCo has no option {selector.field!r}{nearest(selector.field, options)}"
        )
    value = getattr(model.opt, selector.field)
    if isinstance(value, np.ndarray):
        return _Place("constant", value, index_in(phrase, selector, value.size))
    index_in(phrase, selector, 1)
    return _Place("option", model.opt, selector.field)


def _set_constants(model: Any, case: Case, places: Mapping[str, _Place], name: str) -> None:  # noqa: ANN401
    """Set options and constants; MuJoCo derives others from them, as when it compiles a model."""
    constants: list[tuple[str, _Place, float]] = []
    for key, position in places.items():
        if position.kind == "constant":
            number = _number(key, case[key])
            position.array[position.index] = number
            constants.append((key, position, number))
        elif position.kind == "option":
            present = getattr(position.array, position.index)
            setattr(position.array, position.index, like(present, key, _number(key, case[key])))
    if constants:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    for key, position, number in constants:
        if position.array[position.index] != number:
            raise InputError(
                f"{key!r} of the case cannot be set: MuJoCo derives it from other values of {name}"
            )


def _number(name: str, entry: float | Waveform) -> float:
    number = as_number(name, entry, _DRIVABLE)
    if not math.isfinite(number):
        raise InputError(f"expected {name!r} of the case as a finite number, got {number!r}")
    return number
