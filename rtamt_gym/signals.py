"""Signals of a simulation: from what `reset` and `step` return to the named numbers of a formula.

A signal is a text selector, a callable, or a pair of one of them and its value at reset:

| selector | selects | value at reset |
|---|---|---|
| ``obs[2]``, ``obs[0][1]``, ``obs['key'][0]``, ``obs`` | one number of the observation | read |
| ``action[0]``, ``action`` | one number of the action | the default |
| ``reward`` | the reward | the default |
| ``info['key']``, ``info['key'][0]`` | one number of the info | the default |
| ``qpos[1]``, ``qvel[1]`` | one number of a MuJoCo simulation's state | read |
| a callable | what it returns for a `Step` | called, unless it has a default |

Selectors are read by a small grammar, ``source ("[" (integer | string) "]")*``, checked against the
spaces of the environment, and bound to closures. Nothing is ever evaluated as Python.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, Final, NamedTuple, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from rtamt import InputError, InputTypeError

__all__ = ["Read", "Signal", "SignalLike", "Step", "listing", "parse_signals"]

SOURCES: Final = ("obs", "action", "reward", "info", "qpos", "qvel")
"""The words that a selector may begin with; the first four are what a step gives, in this order."""

HINT: Final = "obs[2], obs['key'][0], action[0], reward, info['key'], qpos[0] or qvel[0]"

_NUMBERS: Final = (float, int, np.floating, np.integer, np.bool_)

Read = Callable[[Any, Any, Any, dict[str, Any]], float]
"""Reads a signal from observation, action, reward and info; action and reward are None at reset."""


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
        source: Word that the selector begins with, or the callable.
        path: Indices and keys behind the source.
        default: Value at reset, or None where reset gives one.
    """

    name: str
    source: str | Callable[[Step], float]
    path: tuple[int | str, ...] = ()
    default: float | None = None

    @classmethod
    def parse(cls, name: str, value: SignalLike) -> Signal:
        """The signal of one entry of ``signals=``.

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
            return cls(name, value, (), default)
        if not isinstance(value, str):
            raise InputTypeError(
                f"signal {name!r}: expected a selector, a callable, or a pair of one of them and "
                f"its value at reset, got {value!r}; a selector is {HINT}"
            )
        source, path = _parse_selector(name, value)
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
        return cls(name, source, path, default)

    def __str__(self) -> str:
        if callable(self.source):
            return getattr(self.source, "__qualname__", repr(self.source))
        return self.source + "".join(f"[{part!r}]" for part in self.path)

    def bind(self, env: gym.Env[Any, Any]) -> Read:
        """The function that reads the signal from a step of an environment.

        Raises:
            InputError: If the selector does not fit the spaces of the environment.
        """
        if callable(self.source):
            return self._bind_callable(self.source, env)
        match self.source:
            case "obs":
                path = self.fit(env.observation_space, "the observation space")
                return _reader(0, path)
            case "action":
                path = self.fit(env.action_space, "the action space")
                return _reader(1, path)
            case "qpos" | "qvel":
                return self._bind_state(self.source, env)
            case _:
                return self._bind_unchecked(SOURCES.index(self.source))

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
                    raise InputError(self._refusal(whole, what, f"has no key {part!r}"))
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

    def _bind_state(self, source: str, env: gym.Env[Any, Any]) -> Read:
        simulation: Any = env.unwrapped
        state = getattr(getattr(simulation, "data", None), source, None)
        if state is None:
            raise InputError(
                f"signal {self.name!r}: {self} needs a MuJoCo environment, and "
                f"{type(simulation).__name__} has no data.{source}; read obs[...] instead"
            )
        size = len(state)
        if len(self.path) != 1 or not isinstance(self.path[0], int):
            raise InputError(f"signal {self.name!r}: expected one index, {source}[0], got {self}")
        index = self.path[0]
        if not -size <= index < size:
            raise InputError(
                f"signal {self.name!r}: {self} does not fit: {source} has "
                f"{_count(size, 'element')}, 0 to {size - 1}"
            )
        # An environment may build its MjData anew in reset: a view held from now on would go stale.
        if source == "qpos":
            return lambda *_: float(simulation.data.qpos[index])
        return lambda *_: float(simulation.data.qvel[index])

    def _bind_unchecked(self, place: int) -> Read:
        """A reader of the reward or the info, of which no space says what they hold."""

        def read(*step: Any) -> float:  # noqa: ANN401
            value = step[place]
            for part in self.path:
                try:
                    value = value[part]
                except (KeyError, IndexError, TypeError):
                    held = (
                        f"its keys are {listing(value)}"
                        if isinstance(value, Mapping)
                        else f"it has {value!r} before {part!r}"
                    )
                    raise InputError(
                        f"signal {self.name!r}: the info has no {self}; {held}"
                    ) from None
            return self._number(value)

        return read

    def _bind_callable(self, function: Callable[[Step], float], env: gym.Env[Any, Any]) -> Read:
        return lambda obs, action, reward, info: self._number(
            function(Step(obs, action, reward, info, env))
        )

    def _number(self, value: object) -> float:
        if not isinstance(value, _NUMBERS):
            raise InputTypeError(
                f"signal {self.name!r}: expected a number from {self}, got {value!r}"
            )
        return float(value)


def parse_signals(
    signals: Mapping[str, SignalLike], variables: Iterable[str]
) -> tuple[Signal, ...]:
    """The signals of the variables, in the order of the variables.

    Args:
        signals: Selector, callable, or pair with a value at reset, for every variable.
        variables: Names that the specifications read.

    Raises:
        InputError: If a variable has no signal or a signal no variable; names the nearest.
        InputTypeError: If ``signals`` is no mapping.
    """
    if not isinstance(signals, Mapping):
        raise InputTypeError(
            f'expected a mapping such as signals={{"x": "obs[0]"}}, got {signals!r}'
        )
    names = list(dict.fromkeys(variables))
    spare = [name for name in signals if name not in names]
    for name in names:
        if name not in signals:
            near = _nearest(name, spare)
            way_out = f"did you mean {near!r}?" if near else f'give one: "{name}": "obs[0]"'
            raise InputError(
                f"variable {name!r} has no signal; the signals are {listing(signals)}; {way_out}"
            )
    for name in spare:
        near = _nearest(name, names)
        way_out = f"did you mean {near!r}?" if near else "leave it out"
        raise InputError(
            f"signal {name!r} is read by no specification; the variables are "
            f"{listing(names)}; {way_out}"
        )
    return tuple(Signal.parse(name, signals[name]) for name in names)


_TOKEN = re.compile(r"\s*(?:([A-Za-z_]\w*)|([+-]?\d+)|('[^']*'|\"[^\"]*\")|(.))")


def _parse_selector(name: str, text: str) -> tuple[str, tuple[int | str, ...]]:
    tokens = [
        (match.start(match.lastindex), match.lastindex, match[match.lastindex])
        for match in _TOKEN.finditer(text.rstrip())
        if match.lastindex is not None
    ]
    tokens.append((len(text.rstrip()), 0, ""))

    def refuse(at: int, expected: str) -> InputError:
        column, _, got = tokens[at]
        return InputError(
            f"signal {name!r}, column {column + 1}: expected {expected}, "
            f"got {repr(got) if got else 'the end of the selector'}\n"
            f"  {text}\n"
            f"  {' ' * column}^\n"
            f"  hint: write {HINT}"
        )

    source = tokens[0][2]
    if source not in SOURCES:
        raise refuse(0, f"one of {', '.join(SOURCES)}")
    path: list[int | str] = []
    at = 1
    while tokens[at][2]:
        if tokens[at][2] != "[":
            raise refuse(at, "'[' or the end of the selector")
        _, kind, part = tokens[at + 1]
        if kind not in {2, 3}:
            raise refuse(at + 1, "an index or a key in quotes")
        if tokens[at + 2][2] != "]":
            raise refuse(at + 2, "']'")
        path.append(int(part) if kind == 2 else part[1:-1])
        at += 3
    if source == "reward" and path:
        raise refuse(1, "the end of the selector")
    if source == "info" and not (path and isinstance(path[0], str)):
        raise refuse(1 if len(tokens) < 3 else 2, "a key in quotes, info['key']")
    return source, tuple(path)


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


def _nearest(name: str, names: Iterable[str]) -> str | None:
    return next(iter(difflib.get_close_matches(name, list(names), n=1)), None)


def listing(names: Iterable[Any]) -> str:
    """The names in an error message."""
    return ", ".join(repr(name) for name in names) or "none"


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
