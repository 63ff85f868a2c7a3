"""Signals of a simulation: from what `reset` and `step` return to the named numbers of a formula.

A signal is a text selector, a callable, or a pair of one of them and its value at reset:

| selector | selects | value at reset |
|---|---|---|
| ``obs[2]``, ``obs[0][1]``, ``obs['key'][0]``, ``obs`` | one number of the observation | read |
| ``action[0]``, ``action`` | one number of the action | the default |
| ``reward`` | the reward | the default |
| ``info['key']``, ``info['key'][0]`` | one number of the info | the default |
| ``qpos[1]``, ``sensor:imu[0]``, ... | one number of a MuJoCo simulation | read |
| ``vehicle.speed``, ``vehicle.position[0]`` | one number of highway-env's vehicle | read |
| a callable | what it returns for a `Step` | called, unless it has a default |

Selectors are read by the grammar of `rtamt_gym.signals.selectors`, checked against the spaces and
the simulation of the environment, and bound to closures.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, Final, NamedTuple, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from rtamt import InputError, InputTypeError
from rtamt_gym.checks.names import listing, nearest
from rtamt_gym.signals.selectors import MUJOCO, STEP, VEHICLE, Selector, hint, parse_selector

__all__ = ["Number", "Read", "Signal", "SignalLike", "Step", "parse_signals"]

SOURCES: Final = (*STEP, *MUJOCO, *VEHICLE)
"""The words that a selector of an environment may begin with."""

_NUMBERS: Final = (float, int, np.floating, np.integer, np.bool_)

Read = Callable[[Any, Any, Any, dict[str, Any]], float]
"""Reads a signal from observation, action, reward and info; action and reward are None at reset."""


Number = Callable[..., float]
"""Reads a signal from a simulation as it is now; whatever it is called with means nothing."""


class Step(NamedTuple):
    """What a callable signal sees; of a vector environment, all of it for all environments at once.

    Attributes:
        obs: The observation that `reset` or `step` returned.
        action: The action of the step; None at reset.
        reward: The reward of the step; None at reset.
        info: The environment's own info.
        env: The monitored environment; ``env.unwrapped`` is the simulation.
    """

    obs: Any
    action: Any
    reward: Any
    info: dict[str, Any]
    env: Any


SignalLike = str | Callable[[Step], float] | Sequence[Any]
"""A selector, a callable, or a pair of one of them and its value at reset."""


@dataclass(frozen=True, slots=True)
class Signal:
    """One named number of a simulation.

    Attributes:
        name: Variable of the formulas.
        reads: What is read: a selector, or a callable.
        default: Value at reset, or None where reset gives one.
    """

    name: str
    reads: Selector | Callable[..., Any]
    default: float | None = None

    @classmethod
    def parse(cls, name: str, value: SignalLike, sources: Sequence[str] = SOURCES) -> Signal:
        """The signal of one entry of ``signals=``; ``sources`` are what selectors may begin with.

        Raises:
            InputError: On a selector that the grammar does not read, on a default that is nan, and
                where a default is missing or stands for a value that reset gives.
            InputTypeError: On anything else than a selector, a callable, or a pair.
        """
        default = None
        # JSON knows no tuples: an environment made again from its specification has lists.
        if isinstance(value, list | tuple) and len(value) == 2:
            value, default = value
            default = _default(name, default)
        if callable(value):
            return cls(name, value, default)
        if not isinstance(value, str):
            raise InputTypeError(
                f"signal {name!r}: expected a selector, a callable, or a pair of one of them and "
                f"its value at reset, got {value!r}; a selector is {hint(sources)}"
            )
        selector = parse_selector(name, value, sources)
        source = selector.source
        if default is None and source in {"action", "reward", "info"}:
            raise InputError(
                f"signal {name!r}: {value} has no value at reset; "
                f'say what it is there: "{name}": ("{value}", 0.0)'
            )
        if default is not None and source not in {"action", "reward", "info"}:
            raise InputError(
                f"signal {name!r}: {value} has a value at reset, which the default {default!r} "
                f'would hide; write "{name}": "{value}"'
            )
        return cls(name, selector, default)

    def __str__(self) -> str:
        if isinstance(self.reads, Selector):
            return str(self.reads)
        return getattr(self.reads, "__qualname__", repr(self.reads))

    @property
    def source(self) -> str | None:
        """The word that the selector begins with; None for a callable."""
        return self.reads.source if isinstance(self.reads, Selector) else None

    @property
    def path(self) -> tuple[int | str, ...]:
        """The indices and keys of the selector."""
        return self.reads.path if isinstance(self.reads, Selector) else ()

    def bind(self, env: gym.Env[Any, Any]) -> Read:
        """The function that reads the signal from a step of an environment.

        Raises:
            InputError: If the selector does not fit the spaces of the environment.
        """
        if not isinstance(self.reads, Selector):
            return self._bind_callable(env)
        match self.reads.source:
            case "obs":
                path = self.fit(env.observation_space, "the observation space")
                return _reader(0, path)
            case "action":
                path = self.fit(env.action_space, "the action space")
                return _reader(1, path)
            case "reward" | "info" as source:
                return self._bind_unchecked(STEP.index(source))
            case "vehicle":
                return self._bind_vehicle(self.reads, env)
            case _:
                return self._bind_simulation(self.reads, env)

    def bind_reset(self, env: gym.Env[Any, Any]) -> Read:
        """The function that reads the signal at reset: its default, where it has one."""
        if self.default is None:
            return self.bind(env)
        default = self.default
        return lambda *_: default

    def fit(self, space: spaces.Space[Any], what: str) -> tuple[Any, ...]:
        """The path as indices into values of a space: one number, and in range.

        Raises:
            InputError: If it is not.
        """
        fitted: list[Any] = []
        whole, path = space, list(self.path)
        while path and isinstance(space, spaces.Dict | spaces.Tuple):
            part = path.pop(0)
            if isinstance(space, spaces.Dict):
                if part not in space.spaces:
                    reason = f"has no key {part!r}"
                    raise InputError(
                        self._refusal(whole, what, reason) + nearest(part, space.spaces)
                    )
                space = space.spaces[part]
            else:
                self._check_range(part, len(space.spaces), whole, what)
                space = space.spaces[cast("int", part)]
            fitted.append(part)
        if not isinstance(
            space, spaces.Box | spaces.Discrete | spaces.MultiDiscrete | spaces.MultiBinary
        ):
            raise InputError(self._refusal(whole, what, "has no number there"))
        shape = space.shape or ()
        if len(path) != len(shape):
            raise InputError(
                self._refusal(whole, what, f"needs {_count(len(shape), 'index')} there")
            )
        for part, size in zip(path, shape, strict=True):
            self._check_range(part, size, whole, what)
        if path:
            fitted.append(path[0] if len(path) == 1 else tuple(path))
        return tuple(fitted)

    def _check_range(self, part: int | str, size: int, whole: spaces.Space[Any], what: str) -> None:
        if isinstance(part, str):
            raise InputError(self._refusal(whole, what, f"has no key {part!r}"))
        if not -size <= part < size:
            reason = f"has {_count(size, 'element')} there, 0 to {size - 1}"
            raise InputError(self._refusal(whole, what, reason))

    def _refusal(self, whole: spaces.Space[Any], what: str, reason: str) -> str:
        return f"signal {self.name!r}: {self} does not fit: {what} {reason}; it is {_shape(whole)}"

    def _bind_simulation(self, selector: Selector, env: gym.Env[Any, Any]) -> Number:
        simulation: Any = env.unwrapped
        mujoco = sys.modules.get("mujoco")  # a simulation of it has loaded it
        if mujoco is None or not isinstance(getattr(simulation, "data", None), mujoco.MjData):
            raise InputError(
                f"signal {self.name!r}: {self} needs a MuJoCo environment, and "
                f"{type(simulation).__name__} has no MjData as its data; read obs[...] instead"
            )
        from rtamt_gym.signals.mujoco import bind_simulation

        return bind_simulation(self.name, selector, simulation)

    def _bind_vehicle(self, selector: Selector, env: gym.Env[Any, Any]) -> Number:
        simulation: Any = env.unwrapped
        field, path = selector.field, selector.path

        # Every reset makes a new vehicle.
        def read(*_: object) -> float:
            try:
                value = getattr(simulation.vehicle, field)
                for part in path:
                    value = value[part]
            except (AttributeError, IndexError, KeyError, TypeError) as error:
                vehicle = getattr(simulation, "vehicle", None)
                near = "" if hasattr(vehicle, field) else nearest(field, dir(vehicle))
                raise InputError(
                    f"signal {self.name!r}: cannot read {self} of {type(simulation).__name__}: "
                    f"{error}{near}"
                ) from None
            return self.number(value)

        read()
        return read

    def _bind_unchecked(self, place: int) -> Read:
        """A reader of the reward or the info, of which no space says what they hold."""

        def read(*step: Any) -> float:  # noqa: ANN401
            value = step[place]
            for part in self.path:
                try:
                    value = value[part]
                except (KeyError, IndexError, TypeError):
                    held = (
                        f"its keys are {listing(value)}{nearest(part, value)}"
                        if isinstance(value, Mapping)
                        else f"it has {value!r} before {part!r}"
                    )
                    raise InputError(
                        f"signal {self.name!r}: the info has no {self}; {held}"
                    ) from None
            return self.number(value)

        return read

    def call(self, *args: object) -> Any:  # noqa: ANN401 - whatever a callable gives
        """What the callable returns."""
        return cast("Callable[..., Any]", self.reads)(*args)

    def _bind_callable(self, env: gym.Env[Any, Any]) -> Read:
        return lambda obs, action, reward, info: self.number(
            self.call(Step(obs, action, reward, info, env))
        )

    def _element(self, value: object) -> str:
        """The way out where a selector gives an array or a sequence."""
        held = isinstance(value, np.ndarray | list | tuple) and np.size(value)
        if not held or not isinstance(self.reads, Selector):
            return ""
        return f"; choose an element, {self}{'[0]' * np.ndim(value)}"  # type: ignore[arg-type]  # see above

    def number(self, value: object) -> float:
        """The number that was read, as a float.

        Raises:
            InputTypeError: If it is none.
        """
        if not isinstance(value, _NUMBERS):
            raise InputTypeError(
                f"signal {self.name!r}: expected a number from {self}, got {value!r}"
                + self._element(value)
            )
        return float(value)


def parse_signals(
    signals: Mapping[str, Any],
    variables: Iterable[str],
    sources: Sequence[str] = SOURCES,
    *,
    spare: bool = False,
) -> tuple[Signal, ...]:
    """The signals of the variables, in the order of the variables, then those to spare.

    Args:
        signals: Selector, callable, or pair with a value at reset, for every variable; see
            `SignalLike`.
        variables: Names that the specifications read.
        sources: The words that selectors may begin with.
        spare: Whether there may be signals that no specification reads, to be recorded.

    Raises:
        InputError: If a variable has no signal or a signal no variable; names the nearest.
        InputTypeError: If ``signals`` is no mapping.
    """
    if not isinstance(signals, Mapping):
        raise InputTypeError(
            f'expected a mapping such as signals={{"x": "obs[0]"}}, got {signals!r}'
        )
    names = list(dict.fromkeys(variables))
    example = "obs[0]" if "obs" in sources else "qpos[0]"
    others = [name for name in signals if name not in names]
    for name in names:
        if name not in signals:
            way_out = nearest(name, others) or f'; give one: "{name}": "{example}"'
            raise InputError(
                f"variable {name!r} has no signal; the signals are {listing(signals)}{way_out}"
            )
    for name in () if spare else others:
        raise InputError(
            f"signal {name!r} is read by no specification; the variables are "
            f"{listing(names)}{nearest(name, names) or '; leave it out'}"
        )
    if spare:
        names += others
    return tuple(Signal.parse(name, signals[name], sources) for name in names)


def _reader(place: int, path: tuple[Any, ...]) -> Read:
    if place == 0 and len(path) == 1:  # most signals are obs[i]; one call less a sample
        (part,) = path
        return lambda obs, _action, _reward, _info: float(obs[part])

    def read(*step: Any) -> float:  # noqa: ANN401
        value = step[place]
        for part in path:
            value = value[part]
        return float(value)

    return read


def _default(name: str, value: object) -> float:
    message = f"signal {name!r}: expected a number as the value at reset, got {value!r}"
    if not isinstance(value, Real):
        raise InputTypeError(message)
    if math.isnan(value):
        raise InputError(message)
    return float(value)


def _count(number: int, noun: str) -> str:
    plural = {"index": "indices", "element": "elements"}[noun]
    return f"{number or 'no'} {noun if number == 1 else plural}"


def _shape(space: spaces.Space[Any]) -> str:
    """A space without its bounds, which fill a page for a robot."""
    match space:
        case spaces.Dict():
            inner = ", ".join(f"{key!r}: {_shape(part)}" for key, part in space.spaces.items())
            return f"Dict({inner})"
        case spaces.Tuple():
            return f"Tuple({', '.join(_shape(part) for part in space.spaces)})"
        case spaces.Box():
            return f"Box(shape={space.shape}, dtype={space.dtype})"
        case _:
            return str(space)
