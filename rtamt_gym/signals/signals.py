"""Signals: the named numbers of a formula, read from an environment or its simulation.

A signal is a text selector or a function, or a pair of either and its value at reset:

| selector | selects | value at reset |
|---|---|---|
| ``obs[2]``, ``obs[0][1]``, ``obs['key'][0]``, ``obs`` | one number of the observation | read |
| ``action[0]``, ``action`` | one number of the action | required |
| ``reward`` | the reward | required |
| ``info['key']``, ``info['key'][0]`` | one number of the info | read; otherwise the pair's value |
| ``qpos[1]``, ``sensor:imu[0]``, ... | one number of a MuJoCo simulation | read |
| ``vehicle.speed``, ``vehicle.position[0]`` | one number of highway-env's vehicle | read |
| a function | its result for a `Step` | called, unless the pair has a value |

The value at reset is a number, or None: then the sample of the reset is unknown. A function reads
one environment, also in a vector environment; `rtamt_gym.wrappers.batched` marks a function that
reads a batch at once. With several agents, a selector starts with the agent: ``agent_0: obs[2]``.

`rtamt_gym.signals.selectors` parses selectors; the rows of `rtamt_gym.signals.sources` bind them.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, Final, Literal, NamedTuple, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import concatenate, create_empty_array
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError, RtamtError
from rtamt.errors import Argument, Message, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.signals.selectors import Selector, Syntax, hint, parse_selector

Env = gym.Env[Any, Any]

_NUMBERS: Final = (float, int, np.floating, np.integer, np.bool_)

Read = Callable[[Any, Any, Any, dict[str, Any]], float]
"""Reads a signal from observation, action, reward and info; action and reward are None at reset."""

Number = Callable[..., float]
"""Reads a signal from the current state of a simulation; ignores its arguments."""


@dataclass(frozen=True, slots=True)
class ElementRead:
    """A `Read` of one element of the observation, which C++ reads without a call."""

    index: Any

    def __call__(self, obs: Any, _action: Any, _reward: Any, _info: Any) -> float:
        """Read the element."""
        return float(obs[self.index])


@dataclass(frozen=True, slots=True)
class SlotRead:
    """A `Number` in an array that a simulation updates, which C++ reads without a call.

    A ``memoryview`` would crash Python before 3.11.8 if the collector cleared it while something
    else still reads it.
    """

    array: NDArray[np.float64]
    index: int

    def __call__(self, *_: object) -> float:
        """Read the element."""
        return float(self.array.item(self.index))


class MovingRead:
    """A `Number` of a simulation that may replace its arrays.

    ``home`` returns the object that holds the arrays now; ``bind`` returns a function that reads
    them.
    """

    def __init__(self, home: Callable[[], object], bind: Callable[[], Number]) -> None:
        self.home = home
        self._bind = bind
        self._bound, self._read = home(), bind()

    def now(self) -> Number:
        """Return the function that reads the current arrays."""
        if self.home() is not self._bound:
            self._bound, self._read = self.home(), self._bind()
        return self._read

    def __call__(self, *_: object) -> float:
        """Read the number."""
        return self.now()()


class Step(NamedTuple):
    """The argument of a function that is a signal.

    It describes one environment, also in a vector environment. A function marked with
    `rtamt_gym.wrappers.batched` gets the batch of all environments.

    Attributes:
        obs: The observation that `reset` or `step` returned.
        action: The action of the step; None at reset.
        reward: The reward of the step; None at reset.
        info: The environment's own info.
        env: The monitored environment; ``env.unwrapped`` is the simulation. In a vector
            environment, the single environment, which only a `SyncVectorEnv` provides; for a batch,
            the vector environment.
    """

    obs: Any
    action: Any
    reward: Any
    info: dict[str, Any]
    env: Any


SignalLike = str | Callable[[Step], float] | Sequence[Any]
"""A selector or a function, or a pair of either and its value at reset, None for unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source(Syntax):
    """The first word of selectors.

    ``bind`` returns the function that reads a signal from an environment. ``at_reset`` is whether a
    reset provides a value; ``"maybe"``: the function raises `AbsentError` if it does not.
    """

    bind: Callable[[ParsedSignal, Env], Read]
    at_reset: bool | Literal["maybe"] = True


class AbsentError(InputError):
    """The source of a signal is absent: a key of the info, or an agent."""


class Batched:
    """A function that reads all environments at once; `batched` returns one."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function = function
        self.__module__ = getattr(function, "__module__", None) or type(self).__module__
        self.__qualname__ = f"batched({getattr(function, '__qualname__', None) or repr(function)})"
        self.__doc__ = function.__doc__

    def __call__(self, step: Any) -> Any:
        """Call the function."""
        return self.function(step)

    def __repr__(self) -> str:
        return self.__qualname__

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Batched) and self.function == other.function

    def __hash__(self) -> int:
        return hash(self.function)

    def __reduce__(self) -> Any:
        # A decorated function has this object under its name, where pickle would look it up.
        name = getattr(self.function, "__qualname__", "")
        if getattr(sys.modules.get(self.__module__), name, None) is self:
            return name
        return Batched, (self.function,)


def batched(function: Callable[[Any], Any]) -> Batched:
    """Mark a function as a signal that reads all environments of a vector environment at once.

    Other functions are called once for each environment. A marked function gets one
    `rtamt_gym.Step` with the observations, actions, rewards and infos of all environments, as the
    vector environment returns them. It returns an array with a number for each environment. It must
    keep environments apart and depend on its argument only: its first calls, at a reset and at a
    step, are compared with calls for each environment, and different numbers are an error. A single
    environment passes a batch of one; `rtamt_gym.relabel` passes all samples of an episode.

    Args:
        function: The function; ``@batched`` also works as a decorator.

    Raises:
        InputTypeError: If it is not a function.

    Example:
        >>> import gymnasium as gym
        >>> import numpy as np
        >>> from rtamt_gym import VectorStlMonitor
        >>> from rtamt_gym.wrappers import batched
        >>> envs = gym.make_vec("CartPole-v1", 3, vectorization_mode="vector_entry_point")
        >>> energy = batched(lambda step: np.square(step.obs[:, 1]) + np.square(step.obs[:, 3]))
        >>> envs = VectorStlMonitor(envs, "always(energy < 1)", {"energy": energy})
        >>> _, infos = envs.reset(seed=123)
        >>> infos["robustness"].round(3)
        array([0.997, 0.999, 0.998])
    """
    if isinstance(function, Batched):
        return function
    if not callable(function):
        raise InputTypeError(
            f"expected a function of a rtamt_gym.Step to mark with batched, got {function!r}; "
            "selectors such as 'obs[2]' read all environments at once as they are"
        )
    return Batched(function)


def batch_of_one(
    step: Step, observations: spaces.Space[Any], actions: spaces.Space[Any], env: object
) -> Step:
    """Return the step of one environment as a vector environment of size 1 returns it."""

    def stacked(space: spaces.Space[Any], value: Any) -> Any:
        if value is None:
            return None
        room: Any = create_empty_array(space, 1)
        return concatenate(space, [value], room)

    reward = None if step.reward is None else np.array([step.reward], np.float64)
    obs, action = stacked(observations, step.obs), stacked(actions, step.action)
    return Step(obs, action, reward, _batched_info(step.info), env)


def _batched_info(info: Mapping[str, Any]) -> dict[str, Any]:
    batch: dict[str, Any] = {}
    for key, value in info.items():
        if isinstance(value, Mapping):
            batch[key] = _batched_info(value)
        elif isinstance(value, np.ndarray | np.number | bool | int | float):
            batch[key] = np.asarray(value)[None]
        else:
            batch[key] = np.empty(1, object)
            batch[key][0] = value
        batch[f"_{key}"] = np.ones(1, np.bool_)
    return batch


@dataclass(frozen=True, slots=True)
class ParsedSignal:
    """One named number of a simulation.

    Attributes:
        name: Variable of the formulas.
        reads: A selector, or a function.
        default: Value at reset, nan if it is unknown; None if the reset provides it.
        row: The row of the selector's first word; None for a function.
        refuses_nan: Whether a nan is an error, because the monitors take nan as unknown.
    """

    name: str
    reads: Selector | Callable[..., Any]
    default: float | None = None
    row: Source | None = None
    refuses_nan: bool = False

    @classmethod
    def parse(
        cls,
        name: str,
        value: SignalLike,
        sources: Mapping[str, Source],
        agents: Collection[str] = (),
    ) -> ParsedSignal:
        """Parse an entry of ``signals=``; an InputError explains what does not fit."""
        default = None
        # JSON has no tuples: an environment that is remade from its EnvSpec has lists.
        if isinstance(value, list | tuple) and len(value) == 2:
            value, default = value
            default = math.nan if default is None else _default(name, default)
        if callable(value):
            if isinstance(value, Batched) and (agents or "obs" not in sources):
                raise InputError(
                    f"signal {name!r}: {value} reads a batch of Gymnasium environments, and this "
                    "is a single environment; remove batched"
                )
            return cls(name, value, default)
        if not isinstance(value, str):
            raise InputTypeError(
                f"signal {name!r}: expected a selector, a callable, or a pair of a selector or "
                f"callable and its value at reset, got {value!r}; a selector is {hint(sources)}"
            )
        selector = parse_selector(f"signal {name!r}", value, sources, agents)
        row = sources[selector.source]
        if default is None and not row.at_reset:
            phrase = f"signal {name!r}: {value} has no value at reset"
            raise InputError(*_asks_for_default(name, value, phrase))
        if default is not None and row.at_reset is True:
            raise InputError(
                f"signal {name!r}: {value} has a value at reset, which "
                f"{'None' if math.isnan(default) else default} would hide; write ",
                Argument("signals", {name: value}, words=f'"{name}": "{value}"'),
            )
        return cls(name, selector, default, row)

    def __str__(self) -> str:
        if isinstance(self.reads, Selector):
            return str(self.reads)
        return getattr(self.reads, "__qualname__", repr(self.reads))

    @property
    def source(self) -> str | None:
        """The first word of the selector; None for a function."""
        return self.reads.source if isinstance(self.reads, Selector) else None

    @property
    def path(self) -> tuple[int | str, ...]:
        """The indices and keys of the selector."""
        return self.reads.path if isinstance(self.reads, Selector) else ()

    @property
    def maybe_at_reset(self) -> bool:
        """Whether only some resets provide a value; the default stands in for it."""
        return self.row is not None and self.row.at_reset == "maybe"

    def bind(self, env: Env) -> Read:
        """Return the function that reads the signal from a step of an environment."""
        read = self._bound(env)
        if not self.refuses_nan:
            return read

        def read_number(obs: object, action: object, reward: object, info: Any) -> float:
            value = read(obs, action, reward, info)
            if math.isnan(value):
                raise self.is_nan()
            return value

        return read_number

    def _bound(self, env: Env) -> Read:
        if self.row is not None:
            return self.row.bind(self, env)
        if isinstance(self.reads, Batched):
            observations, actions = env.observation_space, env.action_space

            def read_batch(obs: Any, action: Any, reward: Any, info: Any) -> float:
                step = Step(obs, action, reward, info, env)
                batch = batch_of_one(step, observations, actions, env)
                return float(self.numbers(self.call(batch), 1)[0])

            return read_batch
        return lambda obs, action, reward, info: self.number(
            self.call(Step(obs, action, reward, info, env)), _FUNCTION_HINT
        )

    def bind_reset(self, env: Env) -> Read:
        """Return the function that reads the signal at reset: its default, if it has one."""
        default = self.default
        if default is not None and not self.maybe_at_reset:
            return lambda *_: default
        read = self.bind(env)
        if self.row is not None and not self.maybe_at_reset:
            return read

        def read_or_default(obs: object, action: object, reward: object, info: Any) -> float:
            try:
                return read(obs, action, reward, info)
            except AbsentError as error:
                if default is None:
                    raise self.absent(error) from None
                return default
            except RtamtError as error:
                raise self.at_reset(error) from error.__cause__

        return read_or_default

    def absent(self, error: AbsentError) -> AbsentError:
        """Return the error of a reset that lacks the value, with the fix."""
        return AbsentError(*_asks_for_default(self.name, str(self.reads), str(error)))

    def at_reset(self, error: RtamtError) -> RtamtError:
        """Return the error of a function at a reset, with the fix if the function read a None."""
        text = str(error)
        if self.row is not None or not ("NoneType" in text or f"from {self}, got None" in text):
            return error
        return type(error)(
            f"{text}; at a reset there is no action and no reward: give a first value, "
            f'"{self.name}": (FUNCTION, VALUE), or "{self.name}": (FUNCTION, None) if it is '
            "unknown: then no always over it can be satisfied"
        )

    def is_nan(self) -> InputError:
        """Return the error of a nan where another signal is unknown at reset."""
        return InputError(
            f"signal {self.name!r}: expected a number from {self}, got nan; pass ",
            Argument("nan", "unknown"),
            " if nothing is known of it then",
        )

    def call(self, *args: object) -> Any:
        """Call the function; whatever it raises becomes an `InputError` that names the signal."""
        try:
            return cast("Callable[..., Any]", self.reads)(*args)
        except Exception as error:
            raise self.raised(error) from error

    def raised(self, error: Exception) -> RtamtError:
        """Return the error of a function, with the name of the signal."""
        if isinstance(error, RtamtError) and str(error).startswith(f"signal {self.name!r}"):
            return error
        phrase = ": ".join(filter(None, (type(error).__name__, str(error))))
        return InputError(f"signal {self.name!r}: {self} raised {phrase}")

    def number(self, value: object, fix: str = "") -> float:
        """Return the value as a float; ``fix`` ends the error about anything else."""
        if not isinstance(value, _NUMBERS) and not _is_scalar(value):
            nested = isinstance(value, np.ndarray | list | tuple) and np.size(value)
            if not fix and nested and isinstance(self.reads, Selector):
                fix = f"; choose an element, {self}{'[0]' * np.ndim(value)}"  # type: ignore[arg-type]  # see above
            raise InputTypeError(
                f"signal {self.name!r}: expected a number from {self}, got {value!r}{fix}"
            )
        return float(cast("float", value))

    def numbers(self, values: object, num: int) -> NDArray[Any]:
        """Return the values of ``num`` environments as an array, or raise InputTypeError."""
        column = np.asarray(values)
        if column.shape != (num,) or column.dtype.kind not in "biuf":
            raise InputTypeError(
                f"signal {self.name!r}: expected {num} numbers from {self}, one for every "
                f"environment, got shape {column.shape} and dtype {column.dtype}"
            )
        return column


def _is_scalar(value: object) -> bool:
    """Return whether a value is a number in an array without dimensions, as ``obs[..., 0]`` is."""
    return isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "biuf"


_FUNCTION_HINT = "; a callable takes a rtamt_gym.Step, such as lambda step: step.obs[0]"


def checked_mapping(signals: object) -> Mapping[str, Any]:
    """Return the signals, none for None; raise InputTypeError if they are not a mapping."""
    if signals is None:
        return {}
    if not isinstance(signals, Mapping):
        raise InputTypeError(
            f'expected a mapping such as signals={{"x": "obs[0]"}}, got {signals!r}'
        )
    return signals


def parse_signals(
    signals: Mapping[str, Any],
    variables: Iterable[str],
    sources: Mapping[str, Source],
    *,
    agents: Collection[str] = (),
    extra: bool = False,
    own: Mapping[str, Any] | None = None,
    refuse_nan: bool = False,
) -> tuple[ParsedSignal, ...]:
    """Parse ``signals=``: the signals of the variables, then all others if ``extra``.

    ``own`` has the environment's own signals, for variables that ``signals`` does not name. With
    agents, each selector starts with an agent.

    Raises:
        InputError: If a variable has no signal, or if a signal's name is close to a variable
            without a signal. Other signals may serve other specifications, and are not read.
        InputTypeError: If ``signals`` is not a mapping.
    """
    signals = checked_mapping(signals)
    names = list(dict.fromkeys(variables))
    others = [name for name in signals if name not in names]
    known = {**(own or {}), **signals}
    for name in names:
        if name not in known:
            # A number could be mistaken for the right index.
            example = "obs[INDEX]" if "obs" in sources else "qpos[INDEX]"
            example = f"{next(iter(agents))}: {example}" if agents else example
            existing = f"; the signals are {listing(known)}" if known else ""
            fix = nearest(name, [*others, *(own or {})]) or Message(
                "; pass ",
                Argument("signals", {name: example}, words=f'signals={{"{name}": "{example}"}}'),
                f", or declare a constant: const float {name} = VALUE",
            )
            raise InputError(f"variable {name!r} has no signal{existing}", fix)
    silent = [name for name in names if name not in signals]
    for name in () if extra else others:
        if meant := nearest(name, silent):
            raise InputError(
                f"signal {name!r} is read by no specification; the variables are "
                f"{listing(names)}{meant}"
            )
    if extra:
        names += others
    parsed = (ParsedSignal.parse(name, known[name], sources, agents) for name in names)
    return tuple(replace(signal, refuses_nan=refuse_nan) for signal in parsed)


def unknown_at_reset(signals: Mapping[str, Any]) -> list[str]:
    """Return the names of the signals that are unknown at reset."""
    return [
        name
        for name, signal in signals.items()
        if isinstance(signal, list | tuple) and len(signal) == 2 and signal[1] is None
    ]


def own_signals(env: Any) -> Mapping[str, Any]:
    """Return the attribute ``signals`` of an environment, such as ``{"speed": "obs[0]"}``."""
    own = getattr(getattr(env, "unwrapped", env), "signals", None)
    return own if isinstance(own, Mapping) else {}


def _asks_for_default(name: str, selector: str, problem: str) -> tuple[object, ...]:
    """Return the pieces of an error about a missing value at reset."""
    pair = f'"{name}": ("{selector}", '
    return (
        f"{problem}; give a first value, ",
        Argument("signals", {name: (selector, "VALUE")}, words=f"{pair}VALUE)"),
        ", or ",
        Argument("signals", {name: (selector, "unknown")}, words=f"{pair}None)"),
        " if it is unknown: then no always over it can be satisfied",
    )


def _default(name: str, value: object) -> float:
    message = f"signal {name!r}: expected a number as the value at reset, got {value!r}"
    if not isinstance(value, Real):
        raise InputTypeError(message)
    if math.isnan(value):
        raise InputError(message)
    return float(value)
