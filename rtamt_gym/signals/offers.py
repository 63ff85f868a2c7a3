"""The selectors that an environment offers."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import numpy as np
from gymnasium import spaces

from rtamt_gym.signals.selectors import Selector
from rtamt_gym.signals.signals import Env
from rtamt_gym.signals.sources import MUJOCO

Path = tuple[int | str, ...]


@dataclass(slots=True)
class Offer:
    """Selectors that start with the same word.

    Attributes:
        common: The selectors that most specifications read.
        others: The other selectors.
    """

    common: list[Selector] = field(default_factory=list)
    others: list[Selector] = field(default_factory=list)


def offers(env: Env, info: Mapping[str, Any]) -> dict[str, Offer]:
    """Return the selectors of an environment in mid-episode, by their first word.

    Args:
        env: The environment.
        info: The info of a step, because no space describes its keys.
    """
    simulation: Any = env.unwrapped
    offer = {
        "obs": Offer([Selector("obs", path=path) for path in _in_space(env.observation_space)]),
        "action": Offer([Selector("action", path=path) for path in _in_space(env.action_space)]),
        "reward": Offer([Selector("reward")]),
        "info": Offer([Selector("info", path=path) for path in _in_value(info) if path]),
    }
    mujoco = sys.modules.get("mujoco")  # a simulation of it has loaded it
    if mujoco is not None and isinstance(getattr(simulation, "data", None), mujoco.MjData):
        offer |= _in_mujoco(simulation.model, simulation.data)
    if hasattr(simulation, "vehicle"):
        offer["vehicle"] = _of_vehicle(simulation.vehicle)
    return {word: entry for word, entry in offer.items() if entry.common or entry.others}


def _in_space(space: spaces.Space[Any]) -> Iterator[Path]:
    """Yield the paths of the numbers in the values of a space."""
    parts: Any = ()
    match space:
        case spaces.Dict():
            parts = space.spaces.items()
        case spaces.Tuple():
            parts = enumerate(space.spaces)
        case spaces.Box() | spaces.MultiDiscrete() | spaces.MultiBinary():
            yield from np.ndindex(space.shape or ())
        case spaces.Discrete():
            yield ()
    for key, part in parts:
        yield from ((key, *path) for path in _in_space(part))


def _in_value(value: object) -> Iterator[Path]:
    """Yield the paths of the numbers in a value."""
    parts: Any = ()
    match value:
        case Real() | np.bool_():
            yield ()
        case np.ndarray() if value.dtype.kind in "biuf":
            yield from np.ndindex(value.shape)
        case Mapping():  # only keys that a selector can quote
            parts = ((k, v) for k, v in value.items() if isinstance(k, str) and not {*"'\""} & {*k})
        case list() | tuple():
            parts = enumerate(value)
    for key, part in parts:
        yield from ((key, *path) for path in _in_value(part))


_FIELDS = {
    "body": ["xpos"],
    "joint": ["qpos", "qvel"],
    "geom": ["xpos"],
    "site": ["xpos"],
    "tendon": ["length"],
    "actuator": ["force"],
    "sensor": ["data"],
    "camera": [],
    "light": [],
}
"""The named objects of a MuJoCo model, with the fields that most specifications read."""

_COUNTS = {"joint": "njnt", "camera": "ncam", "actuator": "nu"}
"""MuJoCo's name for the number of objects of a kind, if it is not "n" and the kind."""


def _in_mujoco(model: Any, data: Any) -> dict[str, Offer]:
    offer = {"time": Offer([Selector("time")])}
    for word in MUJOCO:
        array = getattr(data, word, None)
        if isinstance(array, np.ndarray):
            elements = _elements(Selector(word), array)
            offer[word] = Offer(elements) if word in {"qpos", "qvel"} else Offer(others=elements)
    for kind in _FIELDS:
        offer[kind] = _named(model, data, kind)
    geoms = [model.geom(i).name for i in range(model.ngeom)]
    offer["contact"] = Offer(
        [Selector("contact", (name,)) for name in geoms if name],
        [Selector("contact", (name,), "force") for name in geoms if name],
    )
    return offer


def _named(model: Any, data: Any, kind: str) -> Offer:
    from rtamt_gym.signals.mujoco import fields_of

    offer = Offer()
    for i in range(getattr(model, _COUNTS.get(kind, f"n{kind}"))):
        named = getattr(data, kind)(i)
        for name in fields_of(named) if named.name else ():
            container = Selector(kind, (named.name,), "" if kind == "sensor" else name)
            world = kind == "body" and i == 0  # it does not move
            held = offer.common if name in _FIELDS[kind] and not world else offer.others
            held += _elements(container, getattr(named, name))
    return offer


def _elements(whole: Selector, array: Any) -> list[Selector]:
    """Return the selectors of the numbers in an array; a single number needs no index."""
    if array.size == 1:
        return [whole]
    return [Selector(whole.source, whole.names, whole.field, (i,)) for i in range(array.size)]


_VEHICLE = {"position", "heading", "speed", "velocity", "crashed", "on_road"}
"""The attributes of highway-env's vehicle that most specifications read."""


def _of_vehicle(vehicle: object) -> Offer:
    """Return the attributes of highway-env's vehicle that are numbers."""
    offer = Offer()
    for name in dir(vehicle):
        if name.startswith("_"):
            continue
        try:
            value = getattr(vehicle, name)
        except Exception:  # noqa: BLE001, S112 - a property may raise anything before it is used
            continue
        paths = _in_value(value) if not isinstance(value, Mapping) else ()
        held = offer.common if name in _VEHICLE else offer.others
        held += [Selector("vehicle", field=name, path=path) for path in paths]
    return offer
