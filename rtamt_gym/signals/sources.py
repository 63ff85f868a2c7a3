"""The first words of selectors, a row for each: its syntax, and the function that binds it.

`fit` checks a selector against the spaces of an environment, and `offers` lists the selectors that
an environment offers.

To add a kind of selector, such as ``vehicle.speed``: a row of `SOURCES` with an example and the
function that binds it, here or in a file next to `rtamt_gym.signals.mujoco`. List it in
``docs/gymnasium.md`` and at the top of `rtamt_gym.signals.signals`. Vector environments bind the
same row. `offers` lists it for ``rtamt envs``.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from numbers import Real
from types import SimpleNamespace
from typing import Any, Final, NoReturn, cast

import numpy as np
from gymnasium import spaces

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.signals.selectors import Selector
from rtamt_gym.signals.signals import (
    AbsentError,
    ElementRead,
    Env,
    Number,
    ParsedSignal,
    Read,
    Source,
)

AnySpace = spaces.Space[Any]


def fit(signal: ParsedSignal, space: AnySpace, name: str) -> tuple[Any, ...]:
    """Return the indices of the selector's number in the values of a space, or raise InputError."""

    def refuse(reason: str, hint: str = "") -> NoReturn:
        raise InputError(
            f"signal {signal.name!r}: {signal} does not fit: {name} {reason}; it is "
            f"{described(space)}{hint}"
        )

    inner, fitted, path = space, list[Any](), list(signal.path)
    while path and isinstance(inner, spaces.Dict | spaces.Tuple):
        part = path.pop(0)
        fitted.append(part)
        if isinstance(inner, spaces.Tuple):
            _check_range(part, len(inner.spaces), refuse)
        elif part not in inner.spaces:
            refuse(f"has no key {part!r}", nearest(part, inner.spaces))
        inner = cast("Any", inner.spaces)[part]
    numeric = spaces.Box | spaces.Discrete | spaces.MultiDiscrete | spaces.MultiBinary
    if not isinstance(inner, numeric):
        refuse("has no number there")
    shape = inner.shape or ()
    if len(path) != len(shape):
        refuse(f"needs {len(shape) or 'no'} {'index' if len(shape) == 1 else 'indices'} there")
    for part, size in zip(path, shape, strict=True):
        _check_range(part, size, refuse)
    if path:
        fitted.append(path[0] if len(path) == 1 else tuple(path))
    return tuple(fitted)


def _check_range(part: int | str, size: int, refuse: Callable[[str], NoReturn]) -> None:
    if isinstance(part, str):
        refuse(f"has no key {part!r}")
    if not -size <= part < size:
        count = f"{size or 'no'} element{'' if size == 1 else 's'}"
        refuse(f"has {count} there, 0 to {size - 1}")


def described(space: AnySpace) -> str:
    """Describe a space without its bounds, which would fill a page for a robot."""
    match space:
        case spaces.Dict():
            inner = ", ".join(f"{key!r}: {described(part)}" for key, part in space.spaces.items())
            return f"Dict({inner})"
        case spaces.Tuple():
            return f"Tuple({', '.join(described(part) for part in space.spaces)})"
        case spaces.Box():
            return f"Box(shape={space.shape}, dtype={space.dtype})"
    return str(space)


def _bind_obs(signal: ParsedSignal, env: Env) -> Read:
    path = fit(signal, env.observation_space, "the observation space")
    if len(path) == 1:  # most signals are obs[i]
        return ElementRead(*path)
    return lambda obs, _action, _reward, _info: _number_at(obs, path)


def _bind_action(signal: ParsedSignal, env: Env) -> Read:
    path = fit(signal, env.action_space, "the action space")
    return lambda _obs, action, _reward, _info: _number_at(action, path)


def _number_at(value: Any, path: tuple[Any, ...]) -> float:
    for part in path:
        value = value[part]
    return float(value)


def _bind_reward(signal: ParsedSignal, _env: Env) -> Read:
    def read(_obs: object, _action: object, reward: Any, _info: object) -> float:
        value = reward
        try:
            for part in signal.path:
                value = value[part]
        except (KeyError, IndexError, TypeError):
            raise InputError(
                f"signal {signal.name!r}: the reward has no {signal}; it is {reward!r}"
            ) from None
        return signal.number(value)

    return read


def _bind_info(signal: ParsedSignal, _env: Env) -> Read:
    """Bind a key of the info; each value is checked, because no space describes the info."""

    def read(_obs: object, _action: object, _reward: object, info: dict[str, Any]) -> float:
        value: Any = info
        for part in signal.path:
            try:
                value = value[part]
            except (KeyError, IndexError, TypeError):
                if isinstance(value, Mapping):
                    held = f"its keys are {listing(value)}{nearest(part, value)}"
                else:
                    held = f"it has {value!r} before {part!r}"
                kind = AbsentError if isinstance(value, Mapping) else InputError
                raise kind(f"signal {signal.name!r}: the info has no {signal}; {held}") from None
        return signal.number(value)

    return read


def _bind_mujoco(signal: ParsedSignal, env: Env) -> Number:
    simulation: Any = env.unwrapped
    mujoco = sys.modules.get("mujoco")  # a simulation of it has loaded it
    if mujoco is None or not isinstance(getattr(simulation, "data", None), mujoco.MjData):
        raise InputError(
            f"signal {signal.name!r}: {signal} needs a MuJoCo environment, and "
            f"{type(simulation).__name__} has no MjData as its data; read obs[...] instead"
        )
    from rtamt_gym.signals.mujoco import bind_simulation

    return bind_simulation(signal, simulation)


def _bind_vehicle(signal: ParsedSignal, env: Env) -> Number:
    """Bind an attribute of the vehicle that highway-env's agent drives, and read it once."""
    simulation: Any = env.unwrapped
    selector = cast("Selector", signal.reads)

    # Every reset makes a new vehicle.
    def read(*_: object) -> float:
        try:
            value = getattr(simulation.vehicle, selector.field)
            for part in selector.path:
                value = value[part]
        except (AttributeError, IndexError, KeyError, TypeError) as error:
            vehicle = getattr(simulation, "vehicle", None)
            known = hasattr(vehicle, selector.field)
            raise InputError(
                f"signal {signal.name!r}: cannot read {signal} of {type(simulation).__name__}: "
                f"{error}{'' if known else nearest(selector.field, dir(vehicle))}"
            ) from None
        return signal.number(value)

    read()
    return read


def _of_mujoco(example: str, **syntax: Any) -> Source:
    return Source(example=example, bind=_bind_mujoco, **syntax)


def _by_name(example: str, *, common: bool = False) -> Source:
    return _of_mujoco(example, names=1, field="required", common=common)


STEP: Final = {
    "obs": Source(example="obs[2], obs['key'][0]", bind=_bind_obs, common=True),
    "action": Source(example="action[0]", bind=_bind_action, at_reset=False, common=True),
    "reward": Source(example="reward", bind=_bind_reward, at_reset=False, common=True),
    "info": Source(
        example="info['key']", bind=_bind_info, brackets="key", at_reset="maybe", common=True
    ),
}
"""The results of `reset` and `step` of an environment, in the order of a `Read`."""

MUJOCO: Final = {
    "time": _of_mujoco("time"),
    "qpos": _of_mujoco("qpos[0]", common=True),
    "qvel": _of_mujoco("qvel[0]"),
    "qacc": _of_mujoco("qacc[0]"),
    "act": _of_mujoco("act[0]"),
    "ctrl": _of_mujoco("ctrl[0]"),
    "sensordata": _of_mujoco("sensordata[0]"),
    "body": _by_name("body:torso.xpos[2]", common=True),
    "joint": _by_name("joint:hip.qpos"),
    "geom": _by_name("geom:foot.xpos[2]"),
    "site": _by_name("site:grip.xpos[2]"),
    "camera": _by_name("camera:eye.xpos[2]"),
    "light": _by_name("light:sun.xpos[2]"),
    "tendon": _by_name("tendon:cord.length"),
    "actuator": _by_name("actuator:motor.force"),
    "sensor": _of_mujoco("sensor:imu[0]", names=1, field="optional", common=True),
    "contact": _of_mujoco("contact:foot,floor", names=2, field="optional"),
}
"""A MuJoCo simulation: its state, and its named objects."""

VEHICLE: Final = {
    "vehicle": Source(example="vehicle.speed", bind=_bind_vehicle, field="required", common=True)
}
"""A simulation of highway-env."""

SOURCES: Final = {**STEP, **MUJOCO, **VEHICLE}
"""The words that selectors of an environment may start with."""


def agent_sources(agents: Mapping[str, Hashable], *, hold: bool) -> dict[str, Source]:
    """Return the words that may follow an agent in a selector, such as ``agent_0: obs[2]``.

    The signal of an absent agent is nan with ``hold``; otherwise, an error.
    """
    first = next(iter(agents))
    sources = {}
    for index, (word, row) in enumerate(STEP.items()):
        bind = partial(_bind_agent, row, index, agents, hold=hold)
        sources[word] = replace(row, example=f"{first}: {row.example.split(', ')[0]}", bind=bind)
    return sources


_ACTION = 1
"""The place of the actions among the arguments of a `Read`; they are None at reset."""


def _bind_agent(  # a function of the module, for pickle
    row: Source,
    place: int,
    agents: Mapping[str, Hashable],
    signal: ParsedSignal,
    env: Any,
    *,
    hold: bool,
) -> Read:
    """Bind a selector to its agent's part of the arguments of a `Read`, at this place."""
    agent = agents[cast("Selector", signal.reads).agent]
    seat: Any = SimpleNamespace(
        observation_space=env.observation_space(agent), action_space=env.action_space(agent)
    )
    read = row.bind(signal, seat)

    def read_part(*parts: Any) -> float:
        part = parts[place]
        if agent in part:
            own: list[Any] = [None] * len(parts)
            own[place] = part[agent]
            return read(*own)
        if hold and not (signal.maybe_at_reset and parts[_ACTION] is None):
            return math.nan
        raise AbsentError(
            f"signal {signal.name!r}: {signal} has no value, for the agents of this step are "
            f"{listing(part)}; nan='hold' keeps the last value of an agent that left"
        )

    return read_part


Path = tuple[int | str, ...]


@dataclass(slots=True)
class Offer:
    """Selectors with the same first word: what most specifications read, and the others."""

    common: list[Selector] = field(default_factory=list)
    others: list[Selector] = field(default_factory=list)


def offers(env: Env, info: Mapping[str, Any]) -> dict[str, Offer]:
    """Return the selectors of an environment in mid-episode, by their first word.

    ``info`` is the info of a step, because no space describes its keys.
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
        offer[kind] = _named_objects(model, data, kind)
    geoms = [model.geom(i).name for i in range(model.ngeom)]
    offer["contact"] = Offer(
        [Selector("contact", (name,)) for name in geoms if name],
        [Selector("contact", (name,), "force") for name in geoms if name],
    )
    return offer


def _named_objects(model: Any, data: Any, kind: str) -> Offer:
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
