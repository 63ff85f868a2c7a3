"""The words that selectors begin with, a row for each: how it is written, and what binds it.

To add the selectors of a simulator, write a file beside `mujoco` and `vehicle` that binds them, and
a row here for each word.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any, Final

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
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
from rtamt_gym.signals.vehicle import bind_vehicle

__all__ = ["MUJOCO", "SOURCES", "STEP"]


def _bind_obs(signal: ParsedSignal, env: Env) -> Read:
    path = fit(signal, env.observation_space, "the observation space")
    if len(path) == 1:  # most signals are obs[i]
        return ElementRead(*path)
    return lambda obs, _action, _reward, _info: _number_at(obs, path)


def _bind_action(signal: ParsedSignal, env: Env) -> Read:
    path = fit(signal, env.action_space, "the action space")
    return lambda _obs, action, _reward, _info: _number_at(action, path)


def _number_at(value: Any, path: tuple[Any, ...]) -> float:  # noqa: ANN401
    for part in path:
        value = value[part]
    return float(value)


def _bind_reward(signal: ParsedSignal, _env: Env) -> Read:
    def read(_obs: object, _action: object, reward: Any, _info: object) -> float:  # noqa: ANN401
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
    """Binds to the info; each reading is checked, for no space describes it."""

    def read(_obs: object, _action: object, _reward: object, info: dict[str, Any]) -> float:
        value: Any = info
        for part in signal.path:
            try:
                value = value[part]
            except (KeyError, IndexError, TypeError):
                held = (
                    f"its keys are {listing(value)}{nearest(part, value)}"
                    if isinstance(value, Mapping)
                    else f"it has {value!r} before {part!r}"
                )
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


def _of_mujoco(example: str, **syntax: Any) -> Source:  # noqa: ANN401
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
"""What `reset` and `step` of an environment give."""

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
"""What a MuJoCo simulation gives: its state, and what is read by name."""

VEHICLE: Final = {
    "vehicle": Source(example="vehicle.speed", bind=bind_vehicle, field="required", common=True),
}
"""What a simulation of highway-env gives."""

SOURCES: Final = {**STEP, **MUJOCO, **VEHICLE}
"""What the selectors of an environment may begin with."""
