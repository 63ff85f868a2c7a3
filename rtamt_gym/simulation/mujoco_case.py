"""What a case does to a MuJoCo model: initial states, numbers of the model, and what drives it."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np

from rtamt import InputError
from rtamt_gym.checks.names import nearest
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.signals.mujoco import field_of, index_in
from rtamt_gym.signals.selectors import Selector, Syntax, parse_selector
from rtamt_gym.simulation.entries import as_number, as_waveform, like

__all__ = ["Driven", "drive"]

_DRIVABLE: Final = (
    "ctrl[0], actuator:NAME, qfrc_applied[0], joint:NAME.qfrc_applied and body:NAME.xfrc_applied[0]"
)
"""What waveforms drive."""


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
"""The words that the names of a case may begin with."""

_STATE: Final = {("joint", "qpos"), ("joint", "qvel"), ("actuator", "act")}
"""The fields of objects that hold the state, of which a case gives the initial value."""

_DRIVES: Final = {("joint", "qfrc_applied"), ("body", "xfrc_applied"), ("actuator", "ctrl")}
"""The fields of objects that are held while a step is made, and that a case may drive."""


class Driven(NamedTuple):
    """A model and its data as a case makes them; copies, so that the caller's stay as they are.

    Attributes:
        model: The model.
        data: The data.
        inputs: What is driven: the array, the index in it, and the waveform.
    """

    model: Any
    data: Any
    inputs: list[tuple[Any, int, Waveform]]

    def setter(self) -> Callable[[], None]:
        """The function that sets the inputs of a step; its first call those of the first step."""
        period = self.model.opt.timestep
        drives = [(array, at, waveform.stepper(period)) for array, at, waveform in self.inputs]
        step = 0

        def set_inputs() -> None:
            nonlocal step
            for array, at, value in drives:
                array[at] = value(step)
            step += 1

        return set_inputs


def drive(model: Any, data: Any, case: Case, name: str) -> Driven:  # noqa: ANN401
    """Copies a model and its data, and sets what a case says.

    Args:
        model: The model.
        data: Its data, whose present state is that of the copy where the case does not say another.
        case: The case.
        name: The name of the model, for messages.

    Raises:
        InputError: If the model has nothing of a name, with the nearest; if a number does not fit,
            or MuJoCo derives it from others.
    """
    model, present = copy.copy(model), data
    data = mujoco.MjData(model)
    mujoco.mj_copyData(data, model, present)
    inputs: list[tuple[Any, int, Waveform]] = []
    constants: list[tuple[str, Any, int, float]] = []
    for key, entry in case.items():
        selector = parse_selector(f"{key!r} of the case", key, _WRITES)
        field = selector.field or ("ctrl" if selector.source == "actuator" else "")
        if selector.source == "opt":
            _set_option(model, key, selector, as_number(key, entry, _DRIVABLE))
            continue
        array, kind = _array(model, data, key, selector, field)
        at = index_in(f"{key!r} of the case", selector, array.size)
        flat = array.reshape(-1)
        if kind == "input":
            inputs.append((flat, at, as_waveform(key, entry)))
            continue
        number = _finite(key, as_number(key, entry, _DRIVABLE))
        flat[at] = number
        if kind == "constant":
            constants.append((key, flat, at, number))
    if constants:
        mujoco.mj_setConst(model, mujoco.MjData(model))  # derives masses of subtrees and the like
    for key, flat, at, number in constants:
        if flat[at] != number:
            raise InputError(
                f"{key!r} of the case cannot be chosen: MuJoCo derives it from others of {name}"
            )
    return Driven(model, data, inputs)


def _array(model: Any, data: Any, key: str, selector: Selector, field: str) -> tuple[Any, str]:  # noqa: ANN401
    """The array in which a selector chooses, and whether it is an input, a state or a constant."""
    if not selector.names:
        held = "input" if selector.source in {"ctrl", "qfrc_applied"} else "state"
        return getattr(data, selector.source), held
    what = f"{key!r} of the case"
    named = Selector(selector.source, selector.names, field, selector.path)
    if (selector.source, field) in _STATE:
        return field_of(what, named, data), "state"
    if (selector.source, field) in _DRIVES:
        return field_of(what, named, data), "input"
    array = field_of(what, named, model)
    if array.dtype.kind != "f":  # others are places in arrays, and kinds
        raise InputError(f"{what}: {selector} holds whole numbers, which no case sets")
    return array, "constant"


def _set_option(model: Any, key: str, selector: Selector, number: float) -> None:  # noqa: ANN401
    """Sets a number of ``model.opt``."""
    what = f"{key!r} of the case"
    options = [name for name in dir(model.opt) if not name.startswith("_")]
    if selector.field not in options:
        raise InputError(
            f"{what}: there is no option {selector.field!r} of MuJoCo"
            f"{nearest(selector.field, options)}"
        )
    value = getattr(model.opt, selector.field)
    if isinstance(value, np.ndarray):
        value[index_in(what, selector, value.size)] = _finite(key, number)
        return
    index_in(what, selector, 1)
    setattr(model.opt, selector.field, like(value, key, _finite(key, number)))


def _finite(name: str, number: float) -> float:
    if not math.isfinite(number):
        raise InputError(f"expected {name!r} of the case as a finite number, got {number!r}")
    return number
