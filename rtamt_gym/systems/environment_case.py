"""A case of an environment: options of its reset, attributes, parts of its actions."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from numbers import Real
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from rtamt import InputError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.signals.spaces import described
from rtamt_gym.systems.system import as_number, as_waveform, like, refuse_unknown

_Policy = Callable[..., Any]

_ATTRIBUTE = "env."
"""The prefix of the name of an attribute."""


class _Attribute(NamedTuple):
    """The value of an attribute during a run: a number, or a MuJoCo model with other constants."""

    name: str
    owner: Any
    field: str
    value: Any


class EnvironmentCase:
    """A case, bound to an environment."""

    def __init__(self, env: gym.Env[Any, Any], case: Case, name: str) -> None:
        self._name = name
        self._simulation: Any = env.unwrapped
        self._space = env.action_space
        self.options: dict[str, float] | None = {}
        self._attributes: list[_Attribute] = []
        self._drives: dict[str, tuple[tuple[int, ...], Waveform]] = {}
        parameters = _parameters(self._simulation)
        self._actions = _action_names(env)
        drivable = listing(self._actions)
        has_model, constants = _has_model(self._simulation), dict[str, float | Waveform]()
        for key, entry in case.items():
            if key in parameters:
                self.options[key] = as_number(key, entry, drivable)
            elif key in self._actions:
                waveform = as_waveform(key, entry)
                _check_fits(key, waveform, self._space, self._actions[key])
                self._drives[key] = self._actions[key], waveform
            elif has_model and _is_of_model(key):
                constants[key] = entry
            elif key.startswith(_ATTRIBUTE) and not parameters:
                self._attributes.append(_attribute(name, key, as_number(key, entry, drivable), env))
            else:
                known = [*self._actions, *parameters]
                if parameters:
                    refuse_unknown(name, key, known)
                more = "numbers of its attributes, such as 'env.gravity'"
                if has_model:
                    more += ", and of its model, such as 'body:torso.mass'"
                own = [f"{_ATTRIBUTE}{key}"] if hasattr(self._simulation, key) else []
                refuse_unknown(name, key, known, more, own)
        self.options = self.options or None
        if constants:
            self._attributes.append(_changed_model(self._simulation, Case(constants), name))

    @contextmanager
    def attributes(self) -> Iterator[None]:
        """Set the attributes inside a context, and restore them afterwards."""
        before: list[tuple[_Attribute, bool, Any]] = []
        try:
            for attribute in self._attributes:
                own = attribute.field in getattr(attribute.owner, "__dict__", {attribute.field})
                before.append((attribute, own, getattr(attribute.owner, attribute.field)))
                try:
                    setattr(attribute.owner, attribute.field, attribute.value)
                except AttributeError as error:
                    before.pop()
                    raise InputError(
                        f"cannot set {attribute.name!r} of {self._name}: {error}"
                    ) from None
            yield
        finally:
            for attribute, own, value in reversed(before):
                if own:
                    setattr(attribute.owner, attribute.field, value)
                else:  # the class had the value
                    delattr(attribute.owner, attribute.field)

    def check(self) -> None:
        """Raise InputError if the reset has changed an attribute or a parameter."""
        for attribute in self._attributes:
            now = getattr(attribute.owner, attribute.field)
            if now != attribute.value:
                raise InputError(
                    f"{attribute.name!r} of the case is {attribute.value!r}, but the reset of "
                    f"{self._name} sets it to {now!r}: it cannot be chosen"
                )
        parameters = _parameters(self._simulation)
        for name, value in (self.options or {}).items():
            if parameters.get(name) != value:
                raise InputError(
                    f"{name!r} of the case is {value:g}, but after the reset of {self._name} with "
                    f"this option it is {parameters.get(name)!r}"
                )

    def policy(self, policy: _Policy | None, baseline: _Policy | None, period: Fraction) -> _Policy:
        """Return the policy that drives the actions of the case and calls another for the rest."""
        drives = [(element, wave.stepper(period)) for element, wave in self._drives.values()]
        driven = {element for element, _ in drives}
        left = [name for name, element in self._actions.items() if element not in driven]
        if not left:
            if policy is not None:
                raise InputError(
                    f"the case drives all actions of {self._name}, {listing(self._drives)}, and "
                    "leaves no action to the policy; remove the policy, or an action from the case"
                )
            others: _Policy | None = None
        else:
            others = policy or baseline
            if others is None:
                raise InputError(
                    f"the case drives {listing(self._drives)} of {self._name}, and nothing drives "
                    f"{listing(left)}; add them to the case, or give ",
                    Argument("policy"),
                    " for them",
                )
        space, step = self._space, 0

        def act(obs: Any) -> Any:  # noqa: ANN401
            nonlocal step
            action: Any = np.zeros(space.shape or (), space.dtype)
            if others is not None:
                action[...] = others(obs)
            for element, value in drives:
                action[element] = value(step)
            step += 1
            return int(action) if isinstance(space, spaces.Discrete) else action

        return act

    @property
    def drives(self) -> bool:
        """Whether the case drives an action."""
        return bool(self._drives)


def baseline_of(env: gym.Env[Any, Any]) -> _Policy | None:
    """Return the environment's own policy, its attribute ``baseline``.

    None without one, or if a wrapper changes the actions.
    """
    simulation: Any = env.unwrapped
    baseline = getattr(simulation, "baseline", None)
    if not callable(baseline) or env.action_space != simulation.action_space:
        return None
    policy: _Policy = baseline
    return policy


def _parameters(simulation: Any) -> Mapping[str, Any]:  # noqa: ANN401
    """Return the parameters of a scenario by name; empty for other environments."""
    parameters = getattr(simulation, "parameters", None)
    if isinstance(parameters, Mapping) and hasattr(simulation, "action_names"):
        return parameters
    return {}


def _action_names(env: gym.Env[Any, Any]) -> dict[str, tuple[int, ...]]:
    """Return the indices of action components by name; empty if actions are not numeric arrays."""
    space = env.action_space
    if not isinstance(
        space, spaces.Box | spaces.Discrete | spaces.MultiDiscrete | spaces.MultiBinary
    ):
        return {}
    shape = space.shape or ()
    names = getattr(env.unwrapped, "action_names", None)
    if isinstance(names, Sequence) and shape == (len(names),):
        return {str(name): (i,) for i, name in enumerate(names)}
    places = list(np.ndindex(shape))
    return {"action" + "".join(f"[{i}]" for i in element): element for element in places}


def _check_fits(
    name: str, waveform: Waveform, space: spaces.Space[Any], at: tuple[int, ...]
) -> None:
    """Raise InputError if a waveform leaves the range of its action component."""
    low, high = min(waveform.values), max(waveform.values)
    if isinstance(space, spaces.Box):
        # In the type of the action: a bound of 0.1 in float32 is not 0.1.
        least, most = space.dtype.type(low), space.dtype.type(high)
        bounds = space.low[at], space.high[at]
    else:
        integral = all(value.is_integer() for value in waveform.values)
        if not integral or waveform.interpolation != "hold":
            raise InputError(
                f"expected {name!r} of the case as whole numbers with interpolation='hold', for "
                f"the actions {described(space)}, got {waveform!r}"
            )
        least, most = low, high
        bounds = _whole_bounds(space, at)
    if least < bounds[0] or most > bounds[1]:
        got = f"{low:g}" if low == high else f"values from {low:g} to {high:g}"
        raise InputError(
            f"expected {name!r} of the case from {bounds[0]:g} to {bounds[1]:g}, as the actions "
            f"go, got {got}"
        )


def _whole_bounds(space: Any, at: tuple[int, ...]) -> tuple[int, int]:  # noqa: ANN401
    match space:
        case spaces.Discrete():
            return int(space.start), int(space.start + space.n - 1)
        case spaces.MultiDiscrete():
            return int(space.start[at]), int(space.start[at] + space.nvec[at] - 1)
        case _:
            return 0, 1


def _has_model(simulation: Any) -> bool:  # noqa: ANN401
    """Return whether an environment steps a MuJoCo model, without importing MuJoCo."""
    mujoco = sys.modules.get("mujoco")
    return mujoco is not None and isinstance(getattr(simulation, "model", None), mujoco.MjModel)


def _is_of_model(key: str) -> bool:
    from rtamt_gym.systems.mujoco_case import is_of_model

    return is_of_model(key)


def _changed_model(simulation: Any, case: Case, name: str) -> _Attribute:  # noqa: ANN401
    from rtamt_gym.systems.mujoco_case import changed

    return _Attribute(listing(case), simulation, "model", changed(simulation.model, case, name))


def _attribute(system: str, name: str, number: float, env: gym.Env[Any, Any]) -> _Attribute:
    """Return the attribute of the simulation with a dotted name."""
    owner: Any = None
    value: Any = env.unwrapped
    reached, field = "env", ""
    for field in name.removeprefix(_ATTRIBUTE).split("."):
        owner = value
        if not hasattr(owner, field):
            known = [other for other in dir(owner) if not other.startswith("_")]
            meant = nearest(field, known).replace("'", f"'{reached}.", 1)
            raise InputError(f"{system} has no {name!r}{meant or _numbers_of(owner, reached)}")
        value, reached = getattr(owner, field), f"{reached}.{field}"
    if not isinstance(value, Real):
        raise InputError(
            f"expected a number as {name!r} of {system}, which a case can set, got "
            f"{type(value).__name__} {value!r}"
        )
    return _Attribute(name, owner, field, like(value, name, number))


def _numbers_of(owner: Any, reached: str) -> str:  # noqa: ANN401
    """Return the numeric attributes of an object, for a message."""
    named = []
    for field in dir(owner):
        value = inspect.getattr_static(owner, field, None)  # without calling properties
        if (
            isinstance(value, int | float)
            and not isinstance(value, bool)
            and not field.startswith("_")
        ):
            named.append(f"{reached}.{field}")
    return f"; its numbers are {listing(named)}" if named else ""
