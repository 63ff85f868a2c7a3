"""The first words of selectors, a row for each: its syntax, and the function that binds it.

To add a kind of selector, such as ``vehicle.speed``: a row of `SOURCES` with an example and the
function that binds it, here or in a file next to `rtamt_gym.signals.mujoco`. List it in
``docs/gymnasium.md`` and at the top of `rtamt_gym.signals.signals`. Vector environments bind the
same row. `rtamt_gym.signals.offers` lists the selectors of an environment for ``rtamt envs``.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Hashable, Mapping
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, Final, cast

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
from rtamt_gym.signals.spaces import fit


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

    Args:
        agents: The agents by the names that selectors use.
        hold: Whether the signal of an absent agent is nan; otherwise it is an error.
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
