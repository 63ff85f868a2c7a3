"""Selectors of a MuJoCo simulation, resolved once to views of its arrays.

`rtamt_gym.StepMonitor` lists them. Named objects are accessed as in MuJoCo's Python bindings:
``body:torso.xpos`` reads ``data.body("torso").xpos``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np

from rtamt import InputError, InputTypeError
from rtamt.errors import nearest
from rtamt_gym.signals.selectors import Selector
from rtamt_gym.signals.signals import MovingRead, Number, ParsedSignal, SlotRead

StepSignal = str | Callable[[Any, Any], float]
"""A selector, or a function of model and data."""


def check_pair(model: object, data: object) -> None:
    """Raise InputTypeError if the two are not an ``MjModel`` and an ``MjData``."""
    if not isinstance(model, mujoco.MjModel) or not isinstance(data, mujoco.MjData):
        raise InputTypeError(
            f"expected an MjModel and its MjData, got {type(model).__name__} and "
            f"{type(data).__name__}"
        )


def bind_signal(signal: ParsedSignal, model: Any, data: Any) -> Number:
    """Return the function that reads a signal from ``data``; an InputError lists what exists."""
    if isinstance(signal.reads, Selector):
        return _bind_selector(f"signal {signal.name!r}", signal.reads, model, data)
    return lambda *_: signal.number(signal.call(model, data))


def bind_simulation(signal: ParsedSignal, simulation: Any) -> MovingRead:
    """Return the function that reads a signal from ``simulation.data``, which may be replaced."""
    return MovingRead(
        lambda: simulation.data, lambda: bind_signal(signal, simulation.model, simulation.data)
    )


def derive(model: Any, data: Any) -> None:
    """Compute positions, sensors, contacts and forces from the state, and keep the state."""
    warmstart = data.qacc_warmstart.copy()  # some versions of MuJoCo write it here
    mujoco.mj_forward(model, data)
    data.qacc_warmstart[:] = warmstart


def _bind_selector(owner: str, selector: Selector, model: Any, data: Any) -> Number:
    if selector.source == "time":
        index_in(owner, selector, 1)
        return lambda *_: float(data.time)
    if selector.source == "contact":
        return _contact(owner, selector, model, data)
    array = field_of(owner, selector, data) if selector.names else getattr(data, selector.source)
    flat = array.reshape(-1)
    index = index_in(owner, selector, len(flat))
    if flat.dtype == np.float64:
        return SlotRead(flat, index % len(flat))
    return lambda *_: float(flat[index])


def index_in(owner: str, selector: Selector, size: int) -> int:
    """Return the index of a selector in an array; a single number needs no index."""
    path = selector.path
    if not path and size == 1:
        return 0
    if len(path) != 1 or not isinstance(path[0], int):
        raise InputError(f"{owner}: expected one index, {selector.container}[0], got {selector}")
    if not -size <= path[0] < size:
        held = "1 element, [0]" if size == 1 else f"{size or 'no'} elements"
        more = f", 0 to {size - 1}" if size > 1 else ""
        raise InputError(f"{owner}: {selector} does not fit: {selector.container} has {held}{more}")
    return path[0]


def field_of(owner: str, selector: Selector, holder: Any) -> Any:
    """Return the array of a named object's field, in a model or its data."""
    named = _named(owner, selector, selector.source, selector.names[0], holder)
    fields = fields_of(named)
    field = selector.field or "data"
    if field not in fields:
        raise InputError(
            f"{owner}: {selector} does not fit: expected a field ({', '.join(fields)}), got "
            f"{field!r}{nearest(field, fields)}"
        )
    return getattr(named, field)


def fields_of(named: Any) -> list[str]:
    """Return the fields of a named object that are arrays of the simulation, not copies."""

    def is_view(field: str) -> bool:
        array = getattr(named, field)
        return isinstance(array, np.ndarray) and (
            not array.size or np.may_share_memory(array, getattr(named, field))
        )

    return [field for field in dir(named) if not field.startswith("_") and is_view(field)]


def _named(owner: str, selector: Selector, kind: str, wanted: str, holder: Any) -> Any:
    try:
        return getattr(holder, kind)(wanted)
    except KeyError as error:
        raise InputError(f"{owner}: {selector} names no {kind}: {error.args[0]}") from None


def _contact(owner: str, selector: Selector, model: Any, data: Any) -> Number:
    if selector.field not in {"", "force"} or selector.path:
        raise InputError(
            f"{owner}: {selector} cannot be read from a contact; write "
            f"{Selector('contact', selector.names)}, which is 1 or 0, or "
            f"{Selector('contact', selector.names, 'force')}"
        )
    first, *remainder = (_geoms(owner, selector, name, model) for name in selector.names)
    second = remainder[0] if remainder else frozenset(range(model.ngeom))
    pairs = {pair for a in first for b in second for pair in ((a, b), (b, a))}

    def touching() -> list[int]:
        if not data.ncon:
            return []
        contacts = data.contact  # every step replaces it
        between = [i for i, pair in enumerate(contacts.geom.tolist()) if tuple(pair) in pairs]
        return [i for i in between if contacts.efc_address[i] >= 0]

    if selector.field == "force":
        wrench = np.zeros(6)

        def force(*_: object) -> float:
            total = 0.0
            for i in touching():
                mujoco.mj_contactForce(model, data, i, wrench)
                total += float(wrench[0])
            return total

        return force
    return lambda *_: 1.0 if touching() else 0.0


def _geoms(owner: str, selector: Selector, wanted: str, model: Any) -> frozenset[int]:
    """Return the geom with this name, or all geoms of the body with this name."""
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, wanted)
    if geom >= 0:
        return frozenset([geom])
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, wanted)
    if body < 0:
        _named(owner, selector, "geom", wanted, model)
    start = int(model.body_geomadr[body])
    return frozenset(range(start, start + int(model.body_geomnum[body])))
