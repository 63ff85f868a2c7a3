"""Signals of a vector environment: each is a column with a number for every environment.

`rtamt_gym.signals.signals` lists the selectors. ``obs[2]`` reads column 2 of the batched
observations, ``info['speed']`` the array of that key; its mask ``_speed``, where there is one, must
be true for every environment that takes a sample, and at a reset says which have the key, and which
the default. A function is called for each environment, and one that is marked with
`rtamt_gym.batched` once, with the whole batch: see `rtamt_gym.signals.lanes`. Selectors that read
simulations, such as ``qpos[1]``, read the environments of a `SyncVectorEnv` one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import SyncVectorEnv, VectorEnv
from numpy.typing import NDArray

from rtamt import InputError, RtamtError, StateError
from rtamt_gym.checks.names import listing
from rtamt_gym.signals.batches import Batched
from rtamt_gym.signals.lanes import Apart, AtOnce, EachLane
from rtamt_gym.signals.signals import AbsentError, ParsedSignal, Step
from rtamt_gym.signals.spaces import fit

__all__ = ["Batch", "Floats", "Lanes", "SignalColumns"]

Batch = VectorEnv[Any, Any, Any]
Floats = NDArray[np.float64]
Lanes = NDArray[np.bool_]
"""A mask of environments: true for those that are meant."""

_Read = Callable[[Step, Lanes], Any]
"""Reads a column from a step of all environments; only numbers of the mask are used."""


class SignalColumns:
    """Reads the signals of all environments at once.

    Args:
        signals: What to read, in the order of the columns.
        env: The vector environment.
        same_step: Whether it resets an environment in the step that ends its episode.
        compare: Whether the first calls of functions that are marked with `rtamt_gym.batched` are
            compared with calls for each environment.

    Raises:
        InputError: If a selector does not fit the environment.
    """

    def __init__(
        self,
        signals: Sequence[ParsedSignal],
        env: Batch,
        *,
        same_step: bool,
        compare: bool = True,
    ) -> None:
        self._signals = signals
        given: Any = env  # of recorded episodes there is none
        self._env: Any = env if isinstance(given, VectorEnv) else None
        self._all: Lanes = np.ones(env.num_envs, np.bool_)
        self._apart = Apart(env, same_step=same_step)
        self._compare = compare
        self._reads = [
            _without_nan(signal, self._bind(signal, env, same_step=same_step)) for signal in signals
        ]
        sources = [signal.source for signal in signals]
        self.reads_obs = any(source in {"obs", None} for source in sources)
        self.reads_info = any(source in {"info", None} for source in sources)
        self._observed = [i for i, source in enumerate(sources) if source == "obs"]

    def step(
        self,
        obs: Any,  # noqa: ANN401
        actions: Any,  # noqa: ANN401
        rewards: Any,  # noqa: ANN401
        infos: dict[str, Any],
        begun: Lanes | None = None,
    ) -> Floats:
        """Reads the signals from a step: an array with a row for every environment.

        The step has reset the environments ``begun``: their rows hold first samples of episodes.
        """
        lanes = self._all if begun is None else ~begun
        step = Step(obs, actions, rewards, infos, self._env)
        reset = step if begun is None else Step(obs, None, None, infos, self._env)
        self._apart.forget()
        table = self._table()
        for column, (signal, read) in enumerate(zip(self._signals, self._reads, strict=True)):
            as_ever = signal.default is None and signal.source not in {None, "info"}
            if begun is None or as_ever:
                table[:, column] = read(step, lanes)
                continue
            if lanes.any():
                table[:, column] = read(step, lanes)
            table[begun, column] = _at_reset(signal, read, reset, begun)[begun]
        return table

    def reset(self, obs: Any, infos: dict[str, Any], lanes: Lanes) -> Floats:  # noqa: ANN401
        """Reads the signals from a reset; rows of environments outside the mask mean nothing."""
        step = Step(obs, None, None, infos, self._env)
        self._apart.forget()
        table = self._table()
        for column, (signal, read) in enumerate(zip(self._signals, self._reads, strict=True)):
            table[:, column] = _at_reset(signal, read, step, lanes)
        return table

    def _bind(self, signal: ParsedSignal, env: Batch, *, same_step: bool) -> _Read:
        if isinstance(signal.reads, Batched):
            return AtOnce(signal, self._apart, compare=self._compare)
        if signal.source is None:
            return EachLane(signal, self._apart)
        return _bind(signal, env, same_step=same_step)

    def _table(self) -> Floats:
        """A new table in Fortran's order: it is filled and read by columns."""
        return np.empty((len(self._signals), len(self._all))).T

    def check_untouched(self, table: Floats, before: Floats, others: Lanes) -> None:
        """Refuses a reset that has changed the observations of other environments than it should.

        Args:
            table: The signals after the reset.
            before: The signals before it.
            others: The environments that it should leave alone.

        Raises:
            StateError: If it has reset one of these, as far as signals see it.
        """
        now, then = table[:, self._observed], before[:, self._observed]
        changed = np.any((now != then) & ~(np.isnan(now) & np.isnan(then)), axis=1)
        touched = np.logical_and(others, changed)
        if touched.any():
            raise StateError(
                f"expected a reset of the environments of reset_mask alone, but {self._env} has "
                f"reset others, such as {np.flatnonzero(touched)[0]}: it does not know reset_mask; "
                "reset all, or take gym.make_vec(..., vectorization_mode='sync')"
            )


def _at_reset(signal: ParsedSignal, read: _Read, step: Step, lanes: Lanes) -> Any:  # noqa: ANN401
    """The column of a reset: what is read, or the default where there is one."""
    if signal.default is None:
        try:
            return read(step, lanes)
        except AbsentError as error:
            raise signal.absent(error) from None
        except RtamtError as error:
            raise signal.at_reset(error) from error.__cause__
    column = np.full(len(lanes), signal.default)
    if signal.maybe_at_reset:
        there = _present(signal, step.info, lanes)
        if there.any():
            column[there] = read(step, there)[there]
    return column


def _without_nan(signal: ParsedSignal, read: _Read) -> _Read:
    """The function, which refuses nan where the signal does."""
    if not signal.refuses_nan:
        return read

    def read_numbers(step: Step, lanes: Lanes) -> Any:  # noqa: ANN401
        column = np.asarray(read(step, lanes))
        if np.isnan(column[lanes]).any():
            raise signal.is_nan()
        return column

    return read_numbers


def _bind(signal: ParsedSignal, env: Batch, *, same_step: bool) -> _Read:
    match signal.source:
        case "obs":
            space = env.single_observation_space
            pick = _picker(space, fit(signal, space, "the observation space of one environment"))
            return lambda step, _: pick(step.obs)
        case "action":
            space = env.single_action_space
            pick = _picker(space, fit(signal, space, "the action space of one environment"))
            return lambda step, _: pick(step.action)
        case "reward":
            return lambda step, lanes: _from_rewards(signal, step.reward, len(lanes))
        case "info":
            return lambda step, lanes: _from_infos(signal, step.info, lanes)
        case _:
            return _bind_simulations(signal, env, same_step=same_step)


def _picker(space: spaces.Space[Any], path: tuple[Any, ...]) -> Callable[[Any], Any]:
    """Makes the function that takes the number at a path, of all environments, from a batch."""
    parts: list[Any] = []
    while isinstance(space, spaces.Dict | spaces.Tuple):
        part, *rest = path
        parts.append(part)
        space, path = space.spaces[part], tuple(rest)
    index = path[0] if path and isinstance(path[0], tuple) else path
    where = (slice(None), *index)

    def pick(batch: Any) -> Any:  # noqa: ANN401
        for part in parts:
            batch = batch[part]
        return np.asarray(batch)[where]

    return pick


def _bind_simulations(signal: ParsedSignal, env: Batch, *, same_step: bool) -> _Read:
    way_out = (
        "read obs[...], or wrap each environment: "
        "gym.make_vec(..., vectorization_mode='sync', wrappers=[...]) with StlMonitor"
    )
    base = env.unwrapped
    if not isinstance(base, SyncVectorEnv):
        raise InputError(
            f"signal {signal.name!r}: {signal} reads the simulations of a SyncVectorEnv, got "
            f"{base}; {way_out}"
        )
    if same_step:
        raise InputError(
            f"signal {signal.name!r}: {signal} reads the simulations, and with "
            f"AutoresetMode.SAME_STEP they are reset before the end is seen; {way_out}"
        )
    reads = [signal.bind(each) for each in base.envs]
    return lambda *_: np.array([read(None, None, None, {}) for read in reads])


def _present(signal: ParsedSignal, infos: dict[str, Any], lanes: Lanes) -> Lanes:
    """The environments of the mask whose info has all keys of the selector."""
    values: Any = infos
    for part in signal.path:
        if not isinstance(values, Mapping):
            break
        if part not in values:
            return np.zeros_like(lanes)
        lanes = lanes & np.asarray(values.get(f"_{part}", lanes), np.bool_)
        values = values[part]
    return lanes


def _from_rewards(signal: ParsedSignal, rewards: Any, num: int) -> Any:  # noqa: ANN401
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


def _from_infos(signal: ParsedSignal, infos: dict[str, Any], lanes: Lanes) -> Any:  # noqa: ANN401
    values: Any = infos
    path = list(signal.path)
    while path and isinstance(values, Mapping):
        part = path.pop(0)
        if part not in values:
            keys = listing(key for key in values if not str(key).startswith("_"))
            raise AbsentError(
                f"signal {signal.name!r}: the infos have no {signal}; their keys are {keys}"
            )
        missing = lanes & ~np.asarray(values.get(f"_{part}", lanes), np.bool_)
        if missing.any():
            raise AbsentError(
                f"signal {signal.name!r}: the info of environment {np.flatnonzero(missing)[0]} "
                f"has no {signal}"
            )
        values = values[part]
    found, where = np.asarray(values), tuple[Any, ...](path)
    try:
        if found.dtype == object:  # an object for each environment: a list, a tuple
            numbers = np.zeros(len(lanes))
            for lane in np.flatnonzero(lanes):
                numbers[lane] = np.asarray(found[lane])[where]
            return numbers
        found = found[(slice(None), *where)]
    except (IndexError, TypeError, ValueError):
        raise InputError(
            f"signal {signal.name!r}: the infos have no number at {signal}; they have {values!r}"
        ) from None
    return signal.numbers(found, len(lanes))
