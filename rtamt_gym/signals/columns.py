"""Signals of a vector environment: each is a column with a number for every environment.

`rtamt_gym.signals.signals` lists the selectors. ``obs[2]`` reads column 2 of the batched
observations, and ``info['speed']`` the array of that key. The mask ``_speed``, if it exists, must
be true for every environment that takes a sample; at a reset, the default applies where it is
false. A function is called for each environment; a function marked by `rtamt_gym.wrappers.batched`
is called once with the batch. Selectors of simulations, such as ``qpos[1]``, read the environments
of a `SyncVectorEnv` one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import compress
from typing import Any, NoReturn

import numpy as np
from gymnasium import spaces
from gymnasium.vector import SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import iterate
from numpy.typing import NDArray

from rtamt import InputError, RtamtError, StateError
from rtamt_gym.checks.names import listing
from rtamt_gym.signals.signals import AbsentError, Batched, ParsedSignal, Step, batch_of_one
from rtamt_gym.signals.sources import fit

Batch = VectorEnv[Any, Any, Any]
Floats = NDArray[np.float64]
Entries = NDArray[np.bool_]
"""A mask of environments."""

_Read = Callable[[Step, Entries], Any]
"""Reads a column from a step of all environments; only numbers inside the mask are used."""

_WRAP_EACH = "gym.make_vec(..., vectorization_mode='sync', wrappers=[...]) with StlMonitor"
_RESET_EARLY = "AutoresetMode.SAME_STEP they are reset before the end is seen"


class SignalColumns:
    """Reads the signals of all environments at once.

    With ``compare``, the first calls of functions that are marked with `rtamt_gym.wrappers.batched`
    are compared with calls for each environment. ``same_step``: the environment resets in the step
    that ends an episode.

    Raises:
        InputError: If a selector does not fit the environment.
    """

    def __init__(
        self, signals: Sequence[ParsedSignal], env: Batch, *, same_step: bool, compare: bool = True
    ) -> None:
        self._signals = signals
        played: Any = env  # recorded episodes have no environment
        self._env: Any = env if isinstance(played, VectorEnv) else None
        self._all: Entries = np.ones(env.num_envs, np.bool_)
        self._singles = _Singles(env, same_step=same_step)
        self._reads = [
            _without_nan(signal, self._bind(signal, env, same_step=same_step, compare=compare))
            for signal in signals
        ]
        sources = [signal.source for signal in signals]
        self.reads_obs = any(source in {"obs", None} for source in sources)
        self.reads_info = any(source in {"info", None} for source in sources)
        self._observed = [i for i, source in enumerate(sources) if source == "obs"]

    def step(
        self,
        obs: Any,
        actions: Any,
        rewards: Any,
        infos: dict[str, Any],
        begun: Entries | None = None,
    ) -> Floats:
        """Read the signals from a step; ``begun`` are environments that it has reset."""
        entries = self._all if begun is None else ~begun
        step = Step(obs, actions, rewards, infos, self._env)
        reset = step if begun is None else Step(obs, None, None, infos, self._env)
        self._singles.forget()
        table = self._table()
        for column, (signal, read) in enumerate(zip(self._signals, self._reads, strict=True)):
            same_at_reset = signal.default is None and signal.source not in {None, "info"}
            if begun is None or same_at_reset:
                table[:, column] = read(step, entries)
                continue
            if entries.any():
                table[:, column] = read(step, entries)
            table[begun, column] = _at_reset(signal, read, reset, begun)[begun]
        return table

    def reset(self, obs: Any, infos: dict[str, Any], entries: Entries) -> Floats:
        """Read the signals from a reset; rows of environments outside the mask mean nothing."""
        step = Step(obs, None, None, infos, self._env)
        self._singles.forget()
        table = self._table()
        for column, (signal, read) in enumerate(zip(self._signals, self._reads, strict=True)):
            table[:, column] = _at_reset(signal, read, step, entries)
        return table

    def _bind(self, signal: ParsedSignal, env: Batch, *, same_step: bool, compare: bool) -> _Read:
        match signal.source:
            case None if isinstance(signal.reads, Batched):
                return _BatchRead(signal, self._singles, compare=compare)
            case None:
                return _EachRead(signal, self._singles)
            case "obs":
                space = env.single_observation_space
                pick = _picker(
                    space, fit(signal, space, "the observation space of one environment")
                )
                return lambda step, _: pick(step.obs)
            case "action":
                space = env.single_action_space
                pick = _picker(space, fit(signal, space, "the action space of one environment"))
                return lambda step, _: pick(step.action)
            case "reward":
                return lambda step, entries: _from_rewards(signal, step.reward, len(entries))
            case "info":
                return lambda step, entries: _from_infos(signal, step.info, entries)
        return _bind_simulations(signal, env, same_step=same_step)

    def _table(self) -> Floats:
        """Return a new table in Fortran order, because it is filled and read by columns."""
        return np.empty((len(self._signals), len(self._all))).T

    def check_untouched(self, table: Floats, before: Floats, others: Entries) -> None:
        """Raise StateError if a reset has changed observations of environments outside its mask."""
        now, then = table[:, self._observed], before[:, self._observed]
        changed = np.any((now != then) & ~(np.isnan(now) & np.isnan(then)), axis=1)
        touched = np.logical_and(others, changed)
        if touched.any():
            raise StateError(
                f"expected a reset of the environments in reset_mask only, but {self._env} also "
                f"reset environment {np.flatnonzero(touched)[0]}, because it ignores reset_mask; "
                "reset all, or use gym.make_vec(..., vectorization_mode='sync')"
            )


def _at_reset(signal: ParsedSignal, read: _Read, step: Step, entries: Entries) -> Any:
    """Return the column of a reset: the numbers of the reset, or the default."""
    if signal.default is None:
        try:
            return read(step, entries)
        except AbsentError as error:
            raise signal.absent(error) from None
        except RtamtError as error:
            raise signal.at_reset(error) from error.__cause__
    column = np.full(len(entries), signal.default)
    if signal.maybe_at_reset:
        there = _present(signal, step.info, entries)
        if there.any():
            column[there] = read(step, there)[there]
    return column


def _without_nan(signal: ParsedSignal, read: _Read) -> _Read:
    if not signal.refuses_nan:
        return read

    def read_numbers(step: Step, entries: Entries) -> Any:
        column = np.asarray(read(step, entries))
        if np.isnan(column[entries]).any():
            raise signal.is_nan()
        return column

    return read_numbers


def _picker(space: spaces.Space[Any], path: tuple[Any, ...]) -> Callable[[Any], Any]:
    """Return a function that takes the numbers at a path from a batch."""
    parts: list[Any] = []
    while isinstance(space, spaces.Dict | spaces.Tuple):
        part, *remainder = path
        parts.append(part)
        space, path = space.spaces[part], tuple(remainder)
    index = path[0] if path and isinstance(path[0], tuple) else path
    where = (slice(None), *index)

    def pick(batch: Any) -> Any:
        for part in parts:
            batch = batch[part]
        return np.asarray(batch)[where]

    return pick


def _bind_simulations(signal: ParsedSignal, env: Batch, *, same_step: bool) -> _Read:
    base = env.unwrapped
    if isinstance(base, SyncVectorEnv) and not same_step:
        reads = [signal.bind(single) for single in base.envs]
        return lambda *_: np.array([read(None, None, None, {}) for read in reads])
    problem = f"reads the simulations of a SyncVectorEnv, got {base}"
    if isinstance(base, SyncVectorEnv):
        problem = f"reads the simulations, and with {_RESET_EARLY}"
    raise InputError(
        f"signal {signal.name!r}: {signal} {problem}; read obs[...], or wrap each environment: "
        f"{_WRAP_EACH}"
    )


def _present(signal: ParsedSignal, infos: dict[str, Any], entries: Entries) -> Entries:
    """Return the environments in the mask that have all keys of the selector."""
    values: Any = infos
    for part in signal.path:
        if not isinstance(values, Mapping):
            break
        if part not in values:
            return np.zeros_like(entries)
        entries = entries & np.asarray(values.get(f"_{part}", entries), np.bool_)
        values = values[part]
    return entries


def _from_rewards(signal: ParsedSignal, rewards: Any, num: int) -> Any:
    if not signal.path:
        return signal.numbers(rewards, num)
    where: tuple[Any, ...] = (slice(None), *signal.path)
    try:
        return signal.numbers(np.asarray(rewards)[where], num)
    except IndexError:
        raise InputError(
            f"signal {signal.name!r}: the rewards have no {signal}; they have shape "
            f"{np.shape(rewards)}"
        ) from None


def _from_infos(signal: ParsedSignal, infos: dict[str, Any], entries: Entries) -> Any:
    values: Any = infos
    path = list(signal.path)
    while path and isinstance(values, Mapping):
        part = path.pop(0)
        if part not in values:
            keys = listing(key for key in values if not str(key).startswith("_"))
            raise AbsentError(
                f"signal {signal.name!r}: the infos have no {signal}; their keys are {keys}"
            )
        missing = entries & ~np.asarray(values.get(f"_{part}", entries), np.bool_)
        if missing.any():
            raise AbsentError(
                f"signal {signal.name!r}: the info of environment {np.flatnonzero(missing)[0]} "
                f"has no {signal}"
            )
        values = values[part]
    column, where = np.asarray(values), tuple[Any, ...](path)
    try:
        if column.dtype == object:  # an object for each environment: a list, a tuple
            numbers = np.zeros(len(entries))
            for entry in np.flatnonzero(entries):
                numbers[entry] = np.asarray(column[entry])[where]
            return numbers
        column = column[(slice(None), *where)]
    except (IndexError, TypeError, ValueError):
        raise InputError(
            f"signal {signal.name!r}: the infos have no number at {signal}; they have {values!r}"
        ) from None
    return signal.numbers(column, len(entries))


class _Singles:
    """Splits a step of a vector environment into steps of single environments, once per step.

    A reset shares observations and infos with the step; it has no actions and rewards.
    """

    def __init__(self, env: Any, *, same_step: bool) -> None:
        self._env = env
        base = getattr(env, "unwrapped", None)
        self._envs: list[Any]
        if isinstance(base, SyncVectorEnv) and not same_step:
            self._envs = [*base.envs]
        else:
            why = f"with {_RESET_EARLY}" if same_step else "its environments are not accessible"
            self._envs = [_Hidden(env, entry, why) for entry in range(env.num_envs)]
        self._steps: dict[bool, list[Step]] = {}

    def forget(self) -> None:
        """Forget the last step, because the environment may write into the same arrays."""
        self._steps = {}

    def steps(self, step: Step) -> list[Step]:
        """Return the step of each environment."""
        begins = step.action is None
        if begins not in self._steps:
            num, env = self._env.num_envs, self._env
            other = self._steps.get(not begins)
            if other is None:
                observations = list(iterate(env.observation_space, step.obs))
                infos = _single_infos(step.info, num)
            else:
                observations = [single.obs for single in other]
                infos = [single.info for single in other]
            nothing = [None] * num
            actions = nothing if begins else list(iterate(env.action_space, step.action))
            rewards = nothing if step.reward is None else list(step.reward)
            columns = zip(observations, actions, rewards, infos, self._envs, strict=True)
            self._steps[begins] = [Step(*row) for row in columns]
        return self._steps[begins]

    def alone(self, step: Step, entry: int) -> Step:
        """Return the step of one environment as a batch of one."""
        observations = self._env.single_observation_space
        actions = self._env.single_action_space
        return batch_of_one(self.steps(step)[entry], observations, actions, step.env)


class _EachRead:
    """Reads a function of one environment, called for each environment of the mask."""

    def __init__(self, signal: ParsedSignal, singles: _Singles) -> None:
        self._signal, self._singles = signal, singles
        self._function: Any = signal.reads

    def __call__(self, step: Step, entries: Entries) -> Floats:
        """Return the column; 0 outside of the mask."""
        function, num = self._function, len(entries)
        steps: Iterable[Step] = self._singles.steps(step)
        if not entries.all():
            steps = compress(steps, entries.tolist())
        try:
            values = [function(single) for single in steps]
        except Exception as error:
            self._hint_at_batched(step, num, error)
            raise self._signal.raised(error) from error
        column = np.zeros(num)
        column[entries] = self._numbers(step, values, num)
        return column

    def _numbers(self, step: Step, values: list[Any], num: int) -> Any:
        try:
            numbers = np.array(values)
        except ValueError:  # arrays of several shapes
            numbers = np.array(None)
        if numbers.shape == (len(values),) and numbers.dtype.kind in "biuf":
            return numbers
        fix = (
            "; a function takes the rtamt_gym.Step of one environment, such as lambda step: "
            "step.obs[0]"
        )
        try:
            return [self._signal.number(value, fix) for value in values]
        except RtamtError as error:
            self._hint_at_batched(step, num, error)
            raise

    def _hint_at_batched(self, step: Step, num: int, error: Exception) -> None:
        """Raise an error that names `batched` if the function reads the whole batch."""
        signal = self._signal
        try:
            signal.numbers(signal.call(step), num)
        except RtamtError:
            return
        raise InputError(
            f"{signal.raised(error)}; the function is called for each environment, but returns "
            f"{num} numbers for the batch: mark it, rtamt_gym.wrappers.batched({signal})"
        ) from error


class _BatchRead:
    """Reads a function of all environments; its first calls may be compared."""

    def __init__(self, signal: ParsedSignal, singles: _Singles, *, compare: bool) -> None:
        self._signal, self._singles = signal, singles
        self._uncompared = {True, False} if compare else set()

    def __call__(self, step: Step, entries: Entries) -> NDArray[Any]:
        """Return the column."""
        column = self._signal.numbers(self._signal.call(step), len(entries))
        at_reset = step.action is None
        if at_reset in self._uncompared:
            self._compare(step, column, entries.nonzero()[0].tolist())
            self._uncompared.discard(at_reset)
        return column

    def _compare(self, step: Step, column: NDArray[Any], entries: Iterable[int]) -> None:
        signal, num = self._signal, len(column)

        def refuse(entry: int, problem: str, cause: Exception | None = None) -> NoReturn:
            raise InputError(
                f"signal {signal.name!r}: {signal} returns {column[entry]:.6g} for environment "
                f"{entry} in the batch of {num}, but {problem}; a batched function must keep "
                "environments apart, as lambda step: step.obs[:, 0] does; remove batched from a "
                "function of one environment"
            ) from cause

        for entry in entries:
            try:
                single = np.asarray(signal.call(self._singles.alone(step, entry)), np.float64)
            except (RtamtError, TypeError, ValueError) as error:
                problem = str(error).removeprefix(f"signal {signal.name!r}: ")
                refuse(entry, f"raises an error for it alone: {problem}", error)
            # A function that reads the vector environment itself still reads all of them.
            if single.shape == (num,) and num > 1:
                single = single[entry : entry + 1]
            if single.shape != (1,):
                refuse(entry, f"an array of shape {single.shape} for it alone")
            # Sums of a batch are rounded in another order than sums of one environment.
            if not np.allclose(single, column[entry], rtol=1e-4, atol=1e-6, equal_nan=True):
                refuse(entry, f"{single[0]:.6g} for it alone")


class _Hidden:
    """Stands for an environment that the vector environment does not give access to."""

    def __init__(self, env: Any, entry: int, why: str) -> None:
        self._hidden = env, entry, why

    def __getattr__(self, name: str) -> NoReturn:
        if name.startswith("__"):  # Python looks for a protocol
            raise AttributeError(name)
        env, entry, why = self._hidden
        raise InputError(
            f"step.env.{name} of environment {entry} cannot be read from {env}: {why}; read "
            f"step.obs or step.info, or wrap each environment: {_WRAP_EACH}"
        )


def _single_infos(infos: Mapping[str, Any], num: int) -> list[dict[str, Any]]:
    singles: list[dict[str, Any]] = [{} for _ in range(num)]
    for key, value in infos.items():
        if key.startswith("_") or key in {"final_info", "final_obs"}:
            continue
        there = infos.get(f"_{key}")
        values: Any = value
        if isinstance(value, Mapping):
            values = _single_infos(value, num)
        elif not hasattr(value, "__len__") or len(value) != num:  # one value for all
            values = [value] * num
        for entry in range(num):
            if there is None or there[entry]:
                singles[entry][key] = values[entry]
    return singles
