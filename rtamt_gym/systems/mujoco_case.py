"""A case of a MuJoCo model: initial states, constants, options and driven inputs."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable, Mapping
from typing import Any, Final, Literal, NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.signals.mujoco import field_of, index_in
from rtamt_gym.signals.selectors import Selector, Syntax, parse_selector
from rtamt_gym.systems.system import as_number, as_waveform, like

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

_STATE: Final = {("joint", "qpos"), ("joint", "qvel"), ("actuator", "act")}
"""The fields of objects with an initial state."""

_DRIVES: Final = {("joint", "qfrc_applied"), ("body", "xfrc_applied"), ("actuator", "ctrl")}
"""The fields of objects that are inputs of a step."""


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
            inputs.append((position.array, position.at, as_waveform(key, case[key])))
        elif position.kind == "state":
            position.array[position.at] = _number(key, case[key])
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
                "resets its state" if position.kind == "state" else "has actions for what drives it"
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
    at: Any


def _find(model: Any, data: Any, case: Case) -> dict[str, _Place]:  # noqa: ANN401
    """Return the location of every entry of a case."""
    places: dict[str, _Place] = {}
    taken: dict[object, str] = {}
    for key in case:
        position = places[key] = _place(model, data, key)
        held = (
            position.at if position.kind == "option" else position.array[position.at :].ctypes.data
        )
        if held in taken:
            raise InputError(
                f"expected one entry of the case for a number, got {taken[held]!r} and {key!r}"
            )
        taken[held] = key
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
    elif (selector.source, field) in _STATE:
        kind, array = "state", field_of(phrase, selected, data)
    elif (selector.source, field) in _DRIVES:
        kind, array = "input", field_of(phrase, selected, data)
    else:
        array = field_of(phrase, selected, model)
    if array.dtype.kind != "f":  # whole numbers are indices and kinds
        raise InputError(f"{phrase}: {selector} holds whole numbers, which no case sets")
    return _Place(kind, array.reshape(-1), index_in(phrase, selected, array.size))


def _option(what: str, model: Any, selector: Selector) -> _Place:  # noqa: ANN401
    """Return the location of a number of ``model.opt``."""
    options = [name for name in dir(model.opt) if not name.startswith("_")]
    if selector.field not in options:
        raise InputError(
            f"{what}: MuJoCo has no option {selector.field!r}{nearest(selector.field, options)}"
        )
    value = getattr(model.opt, selector.field)
    if isinstance(value, np.ndarray):
        return _Place("constant", value, index_in(what, selector, value.size))
    index_in(what, selector, 1)
    return _Place("option", model.opt, selector.field)


def _set_constants(model: Any, case: Case, places: Mapping[str, _Place], name: str) -> None:  # noqa: ANN401
    """Set options and constants; MuJoCo derives others from them, as when it compiles a model."""
    constants: list[tuple[str, _Place, float]] = []
    for key, position in places.items():
        if position.kind == "constant":
            number = _number(key, case[key])
            position.array[position.at] = number
            constants.append((key, position, number))
        elif position.kind == "option":
            present = getattr(position.array, position.at)
            setattr(position.array, position.at, like(present, key, _number(key, case[key])))
    if constants:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    for key, position, number in constants:
        if position.array[position.at] != number:
            raise InputError(
                f"{key!r} of the case cannot be chosen: MuJoCo derives it from others of {name}"
            )


def _number(name: str, entry: float | Waveform) -> float:
    number = as_number(name, entry, _DRIVABLE)
    if not math.isfinite(number):
        raise InputError(f"expected {name!r} of the case as a finite number, got {number!r}")
    return number
