"""Signals: the named numbers of a formula, read from an environment or its simulation.

A signal is a text selector, a callable, or a pair of one of them and its value at reset:

| selector | selects | value at reset |
|---|---|---|
| ``obs[2]``, ``obs[0][1]``, ``obs['key'][0]``, ``obs`` | one number of the observation | read |
| ``action[0]``, ``action`` | one number of the action | to be given |
| ``reward`` | the reward | to be given |
| ``info['key']``, ``info['key'][0]`` | one number of the info | read, else what is given |
| ``qpos[1]``, ``sensor:imu[0]``, ... | one number of a MuJoCo simulation | read |
| ``vehicle.speed``, ``vehicle.position[0]`` | one number of highway-env's vehicle | read |
| a function | what it returns for a `Step` | called, unless it has a default |

The value at reset is a number, or None where nothing is known of it: then the sample of the reset
is unknown. A function is for one environment, in a vector environment too; `rtamt_gym.batched`
marks one that reads all of a batch at once.

Where there are several agents a selector says whose it is, ``agent_0: obs[2]``: see
`rtamt_gym.signals.agents`.

Selectors are parsed by the grammar of `rtamt_gym.signals.selectors`, and bound to an environment by
the rows of `rtamt_gym.signals.sources`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, Final, Literal, NamedTuple, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError, RtamtError
from rtamt.errors import Argument, Message, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.signals.batches import Batched, batch_of_one
from rtamt_gym.signals.selectors import Selector, Syntax, hint, parse_selector

__all__ = [
    "AbsentError",
    "ElementRead",
    "Env",
    "Number",
    "ParsedSignal",
    "Read",
    "SignalLike",
    "Source",
    "Step",
    "own_signals",
    "parse_signals",
    "unknown_at_reset",
]

Env = gym.Env[Any, Any]

_NUMBERS: Final = (float, int, np.floating, np.integer, np.bool_)

Read = Callable[[Any, Any, Any, dict[str, Any]], float]
"""Reads a signal from observation, action, reward and info; action and reward are None at reset."""


@dataclass(frozen=True, slots=True)
class ElementRead:
    """The `Read` of an element of the observation; who knows it reads without a call.

    Attributes:
        index: The index or key of the element.
    """

    index: Any

    def __call__(self, obs: Any, _action: Any, _reward: Any, _info: Any) -> float:  # noqa: ANN401
        """Reads the element."""
        return float(obs[self.index])


Number = Callable[..., float]
"""Reads a signal from a simulation as it is now; takes any arguments and ignores them."""


class Step(NamedTuple):
    """The argument of a function that is a signal.

    It is of one environment, of each lane of a vector environment too; a function that is marked
    with `rtamt_gym.batched` gets the batch of all.

    Attributes:
        obs: The observation that `reset` or `step` returned.
        action: The action of the step; None at reset.
        reward: The reward of the step; None at reset.
        info: The environment's own info.
        env: The monitored environment; ``env.unwrapped`` is the simulation. In a vector
            environment the lane's own, which only a `SyncVectorEnv` has; of a batch the vector
            environment.
    """

    obs: Any
    action: Any
    reward: Any
    info: dict[str, Any]
    env: Any


SignalLike = str | Callable[[Step], float] | Sequence[Any]
"""A selector, a callable, or a pair of one of them and its value at reset, None for unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source(Syntax):
    """A word that selectors begin with.

    Attributes:
        bind: Makes the function that reads a signal with such a selector from an environment.
        at_reset: Whether there is a value at reset; ``"maybe"``: it raises `AbsentError` where not.
    """

    bind: Callable[[ParsedSignal, Env], Read]
    at_reset: bool | Literal["maybe"] = True


class AbsentError(InputError):
    """What a signal reads is not there: a key of the info, or an agent."""


@dataclass(frozen=True, slots=True)
class ParsedSignal:
    """One named number of a simulation.

    Attributes:
        name: Variable of the formulas.
        reads: A selector, or a callable.
        default: Value at reset, nan if nothing is known of it; None where reset gives one.
        row: The row of the selector's first word; None for a callable.
        refuses_nan: Whether a nan that is read is refused, which the monitors would take for
            unknown, as they do with a default of nan.
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
        """Parses one entry of ``signals=``; ``sources`` are the words selectors may begin with.

        Where there are agents, one of them stands in front of a selector.

        Raises:
            InputError: On a selector that the grammar does not read, on a default that is nan, and
                where a default is missing or stands for a value that reset gives.
            InputTypeError: On anything else than a selector, a callable, or a pair.
        """
        default = None
        # JSON knows no tuples: an environment made again from its specification has lists.
        if isinstance(value, list | tuple) and len(value) == 2:
            value, default = value
            default = math.nan if default is None else _default(name, default)
        if callable(value):
            if isinstance(value, Batched) and (agents or "obs" not in sources):
                raise InputError(
                    f"signal {name!r}: {value} is for batches of environments of Gymnasium, and "
                    "there are none here; leave batched out, for a function of one"
                )
            return cls(name, value, default)
        if not isinstance(value, str):
            raise InputTypeError(
                f"signal {name!r}: expected a selector, a callable, or a pair of one of them and "
                f"its value at reset, got {value!r}; a selector is {hint(sources)}"
            )
        selector = parse_selector(f"signal {name!r}", value, sources, agents)
        row = sources[selector.source]
        if default is None and not row.at_reset:
            what = f"signal {name!r}: {value} has no value at reset"
            raise InputError(*_to_give(name, value, what, "there"))
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
        """The word that the selector begins with; None for a callable."""
        return self.reads.source if isinstance(self.reads, Selector) else None

    @property
    def path(self) -> tuple[int | str, ...]:
        """The indices and keys of the selector."""
        return self.reads.path if isinstance(self.reads, Selector) else ()

    def bind(self, env: Env) -> Read:
        """Makes the function that reads the signal from a step of an environment.

        Raises:
            InputError: If the selector does not fit the environment.
        """
        read = self._bound(env)
        if not self.refuses_nan:
            return read

        def read_number(obs: object, action: object, reward: object, info: Any) -> float:  # noqa: ANN401
            value = read(obs, action, reward, info)
            if math.isnan(value):
                raise self.is_nan()
            return value

        return read_number

    def _bound(self, env: Env) -> Read:
        if self.row is not None:
            return self.row.bind(self, env)
        if isinstance(self.reads, Batched):
            shown, does = env.observation_space, env.action_space
            return lambda obs, action, reward, info: float(
                self.numbers(
                    self.call(batch_of_one(Step(obs, action, reward, info, env), shown, does)), 1
                )[0]
            )
        return lambda obs, action, reward, info: self.number(
            self.call(Step(obs, action, reward, info, env)), _OF_STEP
        )

    def bind_reset(self, env: Env) -> Read:
        """Makes the function that reads the signal at reset: its default, where it has one.

        The default of an info stands for what the info of the reset does not have.
        """
        default = self.default
        if default is not None and not self.maybe_at_reset:
            return lambda *_: default
        read = self.bind(env)
        if self.row is not None and not self.maybe_at_reset:
            return read

        def read_or_default(obs: object, action: object, reward: object, info: Any) -> float:  # noqa: ANN401
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
        """The error of a reset that does not give the value: with what to write."""
        return AbsentError(*_to_give(self.name, str(self.reads), str(error), "at reset"))

    def at_reset(self, error: RtamtError) -> RtamtError:
        """The error of a function at a reset: with the way out if it has met a None there."""
        said = str(error)
        if self.row is not None or not ("NoneType" in said or f"from {self}, got None" in said):
            return error
        return type(error)(
            f"{said}; at a reset there is no action and no reward: say what it is there, "
            f'"{self.name}": (FUNCTION, VALUE), or "{self.name}": (FUNCTION, None) where that is '
            "not known: then no always over it can be satisfied"
        )

    def is_nan(self) -> InputError:
        """The error of a value that is nan beside one that is unknown at reset."""
        return InputError(
            f"signal {self.name!r}: expected a number from {self}, got nan; pass ",
            Argument("nan", "unknown"),
            " if nothing is known of it then",
        )

    @property
    def maybe_at_reset(self) -> bool:
        """Whether resets of some environments give a value, in the place of the default."""
        return self.row is not None and self.row.at_reset == "maybe"

    def call(self, *args: object) -> Any:  # noqa: ANN401 - whatever a callable gives
        """Calls the callable.

        Raises:
            InputError: If it raises anything; names the signal and the error, its cause.
        """
        try:
            return cast("Callable[..., Any]", self.reads)(*args)
        except Exception as error:
            raise self.raised(error) from error

    def raised(self, error: Exception) -> RtamtError:
        """The error of a callable that has raised one: names the signal, unless it does already."""
        if isinstance(error, RtamtError) and str(error).startswith(f"signal {self.name!r}"):
            return error
        what = ": ".join(filter(None, (type(error).__name__, str(error))))
        return InputError(f"signal {self.name!r}: {self} raised {what}")

    def _element(self, value: object) -> str:
        """The hint of a message about a selector that reads an array or a sequence."""
        held = isinstance(value, np.ndarray | list | tuple) and np.size(value)
        if not held or not isinstance(self.reads, Selector):
            return ""
        return f"; choose an element, {self}{'[0]' * np.ndim(value)}"  # type: ignore[arg-type]  # see above

    def number(self, value: object, way_out: str = "") -> float:
        """Turns the value that was read into a float.

        Args:
            value: The value.
            way_out: The end of the message about one that is no number.

        Raises:
            InputTypeError: If it is no number.
        """
        if not isinstance(value, _NUMBERS) and not _is_scalar(value):
            raise InputTypeError(
                f"signal {self.name!r}: expected a number from {self}, got {value!r}"
                + (way_out or self._element(value))
            )
        return float(cast("float", value))

    def numbers(self, values: object, num: int) -> NDArray[Any]:
        """Turns what was read of many environments into an array.

        Args:
            values: The values.
            num: The number of environments.

        Raises:
            InputTypeError: If they are not a number for each environment.
        """
        found = np.asarray(values)
        if found.shape != (num,) or found.dtype.kind not in "biuf":
            raise InputTypeError(
                f"signal {self.name!r}: expected {num} numbers from {self}, one for every "
                f"environment, got shape {found.shape} and dtype {found.dtype}"
            )
        return found


def _is_scalar(value: object) -> bool:
    """Whether it is an array of one number and no dimension, such as ``obs[..., 0]``."""
    return isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "biuf"


_OF_STEP = "; a callable is given a rtamt_gym.Step, such as lambda step: step.obs[0]"


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
    """Parses ``signals=``: the signals of the variables in their order, then all others.

    Args:
        signals: Selector, callable, or pair with a value at reset, for every variable; see
            `SignalLike`.
        variables: Names that the specifications read.
        sources: The words that selectors may begin with.
        agents: The agents, one of which stands in front of every selector, if there are any.
        extra: Whether signals that no specification reads are recorded.
        own: The signals that the environment names itself, for variables without another.
        refuse_nan: Whether each of them refuses what it reads and is nan.

    Raises:
        InputError: If a variable has no signal, or a signal has nearly the name of one without a
            signal of its own here. Others without a variable are for others, and not read.
        InputTypeError: If ``signals`` is no mapping.
    """
    if not isinstance(signals, Mapping):
        raise InputTypeError(
            f'expected a mapping such as signals={{"x": "obs[0]"}}, got {signals!r}'
        )
    names = list(dict.fromkeys(variables))
    example = (f"{next(iter(agents))}: " if agents else "") + (
        "obs[INDEX]" if "obs" in sources else "qpos[INDEX]"
    )  # a number might be taken for the right one
    others = [name for name in signals if name not in names]
    known = {**(own or {}), **signals}
    for name in names:
        if name not in known:
            given = f"; the signals are {listing(known)}" if known else ""
            meant = nearest(name, [*others, *(own or {})])
            way_out = meant or Message(
                "; give one: ",
                Argument("signals", {name: example}, words=f'"{name}": "{example}"'),
                f", or if it is a constant declare it: const float {name} = VALUE",
            )
            raise InputError(f"variable {name!r} has no signal{given}", way_out)
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
    return tuple(replace(each, refuses_nan=refuse_nan) for each in parsed)


def unknown_at_reset(signals: Mapping[str, Any]) -> list[str]:
    """The names of the signals that are given with None as their value at reset."""
    return [
        name
        for name, each in signals.items()
        if isinstance(each, list | tuple) and len(each) == 2 and each[1] is None
    ]


def _to_give(name: str, selector: str, what: str, where: str) -> tuple[object, ...]:
    """The pieces of an error about a value at reset that is to be given."""
    pair = f'"{name}": ("{selector}", '
    return (
        f"{what}; say what it is {where}, ",
        Argument("signals", {name: (selector, "VALUE")}, words=f"{pair}VALUE)"),
        ", or ",
        Argument("signals", {name: (selector, "unknown")}, words=f"{pair}None)"),
        " where that is not known: then no always over it can be satisfied",
    )


def own_signals(env: Any) -> Mapping[str, Any]:  # noqa: ANN401 - an environment, or many
    """The signals that an environment names itself: its attribute ``signals``, if it is a mapping.

    A scenario of `rtamt_envs` has one, and any environment may: ``{"speed": "obs[0]"}``.
    """
    own = getattr(getattr(env, "unwrapped", env), "signals", None)
    return own if isinstance(own, Mapping) else {}


def _default(name: str, value: object) -> float:
    message = f"signal {name!r}: expected a number as the value at reset, got {value!r}"
    if not isinstance(value, Real):
        raise InputTypeError(message)
    if math.isnan(value):
        raise InputError(message)
    return float(value)
