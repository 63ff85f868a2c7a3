"""The state of monitors as bounded numbers, appended to observations; warnings about their clip.

For every specification, in their order:

| number | range |
|---|---|
| robustness, times the weight | [-clip, clip] |
| lower and upper bound of the robustness of the episode, times the weight | [-clip, clip] |
| time left until the horizon, as a fraction of it; 1 without a horizon | [0, 1] |
| the verdict: 1 certainly satisfied, -1 certainly violated, 0 undecided | [-1, 1] |
| for each temporal operator in `StateFeatures.operators`, its clock | [0, 1] |
| and the newest known robustness of each operand, times the weight | [-clip, clip] |

The functions take floats of one environment, or arrays of shape (environments,); the features of
several environments are an array of shape (environments, features).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Any, Literal, get_args

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.checks.arguments import check_choice, check_number
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.judging.monitors import MonitorValues, Owed
from rtamt_gym.judging.obligations import Obligation
from rtamt_gym.shaping import Numeric, Shaping, scaled
from rtamt_gym.signals.columns import Entries, Floats

Observe = Literal["state", "obligations"]
"""The numbers that are appended to the observation."""

KEY = "stl"
"""The key of the features in a dictionary of observations."""

_NAMES = ("robustness", "lower", "upper", "time left", "verdict")


class Observing:
    """The base of the wrappers that can append the state of monitors to observations."""

    _state: StateFeatures | None = None
    """The features; None if nothing is appended."""
    _observe: Observe | None
    _shown_specs: tuple[str, ...]

    def _set_up_observations(
        self,
        env: Any,
        observe: Observe | None,
        clip: float,
        monitored: Any,
        weights: Sequence[float] | None = None,
        *,
        whole_episode: bool = False,
    ) -> None:
        """Check ``observe`` and ``clip``, and make the observation spaces.

        ``monitored`` has ``monitors`` and ``track_obligations``, as a monitor set has.
        """
        check_choice("observe", observe, (None, *get_args(Observe)))
        bound = check_number("clip", clip)
        self._state, self._observe, self._shown_specs = None, observe, tuple(monitored.monitors)
        self._observed_watch: ObservedWatch | None = None
        if observe is None:
            return
        _refuse_twice(env, type(self).__name__, observe)
        horizons = _horizons(monitored.monitors)
        factors = (1.0,) * len(horizons) if weights is None else tuple(weights)
        operators = _operators(monitored) if observe == "obligations" else None
        self._state = StateFeatures(
            factors, bound, horizons, whole_episode=whole_episode, operators=operators
        )
        num = env.num_envs if isinstance(env, VectorEnv) else 1
        self._observed_watch = ObservedWatch(observe, self._shown_specs, factors, bound, num)
        wrapper: Any = self  # of one environment, or of many
        if isinstance(env, VectorEnv):
            space = appended_space(env.single_observation_space, self._state.box, observe)
            wrapper.single_observation_space = space
            wrapper.observation_space = batch_space(space, env.num_envs)
        else:
            wrapper.observation_space = appended_space(
                env.observation_space, self._state.box, observe
            )

    def _follow_monitors(self, monitored: Any) -> None:
        """Observe other monitors with as many operators, after a change of constants."""
        state = self._state
        if state is not None:
            operators = None if state.operators is None else _operators(monitored)
            horizons = _horizons(monitored.monitors)
            self._state = replace(state, horizons=horizons, operators=operators)

    @property
    def observed(self) -> list[str]:
        """The names of the numbers that are appended to the observation, in their order.

        Example:
            >>> import gymnasium as gym
            >>> from rtamt_gym import StlMonitor
            >>> env = StlMonitor(
            ...     gym.make("CartPole-v1"),
            ...     "always(eventually[0:1](x > 0))",
            ...     {"x": "obs[0]"},
            ...     observe="obligations",
            ... )
            >>> for name in env.observed:
            ...     print(name)
            spec: robustness
            spec: lower
            spec: upper
            spec: time left
            spec: verdict
            spec: clock of eventually[0:1](x > 0)
            spec: margin of x > 0
        """
        return [] if self._state is None else self._state.names(self._shown_specs)

    def _observed(self, obs: Any, values: MonitorValues[Any]) -> Any:
        """Return the observation, or a batch of them, with the features."""
        return obs if self._state is None else append(obs, self._state.read(values))

    def _watch_reset(self, values: MonitorValues[Any], entries: Entries | None = None) -> None:
        """Count the features of the environments in the mask at their reset; None: of all."""
        if self._observed_watch is not None:
            self._observed_watch.reset(self._shown_robustness(values), entries)
            self._warn_of_clip()

    def _watch_step(self, values: MonitorValues[Any], ended: Any) -> None:
        """Count the features of a step; ``ended`` is the mask of the episodes that it ends."""
        watch = self._observed_watch
        if watch is None:
            return
        robustness = self._shown_robustness(values)
        watch.step(robustness)
        if ended is not False and np.any(ended):
            watch.end(robustness, np.atleast_1d(ended))
            self._warn_of_clip()

    def _shown_robustness(self, values: MonitorValues[Any]) -> Sequence[Any]:
        whole_episode = self._state is not None and self._state.whole_episode
        return values.judged if whole_episode else values.robustness

    def _warn_of_clip(self) -> None:
        """Warn once ten episodes have ended, if most samples were clipped."""
        watch = self._observed_watch
        if watch is not None and watch.finished:
            self._observed_watch = None
            if watch.report is not None:
                warnings.warn(watch.report, UserWarning, stacklevel=caller_level())

    def _append_to_final(
        self, infos: dict[str, Any], values: MonitorValues[Any] | None, ended: Entries | None
    ) -> None:
        """Append features to ``final_obs``, the observations from before the resets in a step."""
        if self._state is None or values is None or ended is None or "final_obs" not in infos:
            return
        final, numbers = infos["final_obs"], self._state.read(values)
        if not isinstance(final, np.ndarray) or final.dtype != object:
            infos["final_obs"] = append(final, numbers)
            return
        # An object for each environment, as Gymnasium has them.
        shown = final.copy()
        for entry in np.flatnonzero(ended):
            shown[entry] = append(final[entry], numbers[entry])
        infos["final_obs"] = shown


def _horizons(monitors: Mapping[str, tuple[Any, Any]]) -> tuple[int | None, ...]:
    return tuple(judge.program.latency for _, judge in monitors.values())


def _operators(monitored: Any) -> tuple[tuple[Obligation, ...], ...]:
    return tuple(map(tuple, monitored.track_obligations()))


def _refuse_twice(env: Any, name: str, observe: Observe) -> None:
    while isinstance(env, gym.Wrapper | VectorWrapper):
        if isinstance(env, Observing) and env._state is not None:  # noqa: SLF001 - the same class
            inner, own = type(env).__name__, env._observe  # noqa: SLF001 - the same class
            raise InputError(
                f"observe={observe!r} of {name} would repeat the values that observe={own!r} of "
                f"the inner {inner} appends; pass observe= to one wrapper only"
            )
        env = env.env


@dataclass(frozen=True, slots=True)
class StateFeatures:
    """The numbers that are appended to observations.

    Attributes:
        weights: A factor of the numbers of each specification.
        clip: The bound of the numbers.
        horizons: For each specification, the number of samples after the first that it reads.
        whole_episode: Whether every view shows the robustness of the whole episode.
        operators: The temporal operators of each specification with clock and margins, or None.
    """

    weights: tuple[float, ...]
    clip: float
    horizons: tuple[int | None, ...]
    whole_episode: bool = False
    operators: tuple[tuple[Obligation, ...], ...] | None = None

    @property
    def box(self) -> spaces.Box:
        """The space of the features."""
        bound = self.clip
        low: list[float] = []
        high: list[float] = []
        for operators in self.operators or ((),) * len(self.weights):
            low += [-bound, -bound, -bound, 0.0, -1.0]
            high += [bound, bound, bound, 1.0, 1.0]
            for operator in operators:
                margins = [bound] * len(operator.operands)
                low += [0.0, *(-margin for margin in margins)]
                high += [1.0, *margins]
        return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)

    def names(self, specs: Iterable[str]) -> list[str]:
        """Return a name for each feature, for a reader."""
        names = []
        for spec, operators in zip(specs, self.operators or repeat(()), strict=False):
            names += [f"{spec}: {name}" for name in _NAMES]
            for operator in operators:
                names.append(f"{spec}: clock of {operator.formula}")
                names += [f"{spec}: margin of {operand}" for operand in operator.operands]
        return names

    def read(self, values: MonitorValues[Numeric]) -> NDArray[np.float32]:
        """Return the features of all specifications."""
        if not isinstance(values.samples, np.ndarray):
            return np.array(self._of_one(values), np.float32)
        return np.array(self.rows(values), np.float32).T

    def rows(self, values: MonitorValues[Any]) -> list[Any]:
        """Return the features of many environments, an array of any library for each feature."""
        robustness = values.judged if self.whole_episode else values.robustness
        numbers = [
            scaled(column, self.weights, self.clip)
            for column in (robustness, values.lower, values.upper)
        ]
        sample = values.samples - 1.0
        left = [time_left(sample, horizon) for horizon in self.horizons]
        owed = None if self.operators is None else values.owed
        rows: list[Any] = []
        for index, state in enumerate(zip(*numbers, left, values.verdicts, strict=True)):
            rows += state
            weight = self.weights[index]
            for clock, margins in () if owed is None else owed[index]:
                rows += [clock, *scaled(margins, [weight] * len(margins), self.clip)]
        return rows

    def _of_one(self, values: MonitorValues[Any]) -> list[float]:
        """Return the features of one environment, in loops: calls would take twice the time."""
        high, low, numbers = self.clip, -self.clip, list[float]()
        owed: Sequence[Iterable[Owed]] | None = None if self.operators is None else values.owed
        robustness = values.judged if self.whole_episode else values.robustness
        shown = (robustness, values.lower, values.upper)
        for index, weight in enumerate(self.weights):
            for column in shown:
                number = weight * column[index]
                numbers.append(low if number < low else high if number > high else number)  # noqa: FURB136
            numbers.append(time_left(values.samples - 1.0, self.horizons[index]))
            numbers.append(values.verdicts[index])
            for clock, margins in () if owed is None else owed[index]:
                numbers.append(clock)
                for margin in margins:
                    number = weight * margin
                    numbers.append(low if number < low else high if number > high else number)  # noqa: FURB136
        return numbers


def time_left(sample: Numeric, horizon: int | None) -> Numeric:
    """Return ``1 - sample / horizon``, 0 from the horizon on; 1 without a horizon.

    Example:
        >>> time_left(0, 4), time_left(3, 4), time_left(9, 4), time_left(9, None)
        (1.0, 0.25, 0.0, 1.0)
    """
    left = sample * 0.0 + 1.0 if horizon is None else (horizon - sample) / max(horizon, 1)
    if isinstance(left, float | int):
        return max(left, 0.0)
    return left * (left > 0.0)


def appended_space(
    space: spaces.Space[Any], box: spaces.Box, observe: str
) -> spaces.Box | spaces.Dict:
    """Return the space of observations with features; ``observe`` is the argument, for messages.

    A ``Box`` of one dimension grows, and holds floats; a ``Dict`` gets one more key.
    """
    match space:
        case spaces.Dict() if KEY not in space.spaces:
            # Pairs, so that Gymnasium keeps the order.
            return spaces.Dict([*space.spaces.items(), (KEY, box)])
        case spaces.Dict():
            raise InputError(
                f"expected an observation space without the key {KEY!r}, where the monitor "
                "puts its state; rename it"
            )
        case spaces.Box(shape=(_,)):
            dtype: Any = np.result_type(space.dtype, np.float32)
            low = np.concatenate([space.low, box.low]).astype(dtype)
            high = np.concatenate([space.high, box.high]).astype(dtype)
            return spaces.Box(low, high, dtype=dtype)
    raise InputError(
        f"expected observations as a Box of one dimension or a Dict for observe={observe!r}, got "
        f"{space}; flatten them first: gymnasium.wrappers.FlattenObservation"
    )


def append(observation: Any, numbers: NDArray[np.float32]) -> Any:
    """Return an observation or a batch of them, arrays or dictionaries, with features."""
    if isinstance(observation, dict):
        return {**observation, KEY: numbers}
    if observation.dtype != np.float32:
        numbers = numbers.astype(np.result_type(observation.dtype, np.float32))
    return np.concatenate([observation, numbers], axis=-1)


EPISODES = 10
"""The number of episodes that are checked."""

_BLOCK = 1000
"""The number of values of a specification that are counted together."""


class _Watch:
    """Watches the samples of all environments until ten episodes have ended.

    An infinite robustness does not count, because no clip could show it. A step only stores its
    values, which are counted in blocks; the caller must not change them.
    """

    def __init__(self, num: int) -> None:
        self._all = np.ones(num, np.bool_)
        self._running = np.zeros(num, np.bool_)
        self._episodes = 0
        self._stored: list[Sequence[Any]] = []
        self._most = max(1, _BLOCK // num)

    @property
    def finished(self) -> bool:
        """Whether ten episodes have ended."""
        return self._episodes >= EPISODES

    def reset(self, values: Sequence[Any], entries: Entries | None = None) -> None:
        """Watch the first samples of the environments in the mask; None: of all."""
        self._count_stored()
        started = self._all if entries is None else entries
        # A running episode has ended without a last sample.
        self._episodes += int(np.count_nonzero(self._running & started))
        if not self.finished:
            self._running = self._running | started
            self._count([np.atleast_1d(column)[started] for column in values], last=False)

    def step(self, values: Sequence[Any]) -> None:
        """Watch a sample of every environment."""
        self._stored.append(values)
        self._running = self._all
        if len(self._stored) >= self._most:
            self._count_stored()

    def end(self, values: Sequence[Any], ended: Entries | None = None) -> None:
        """Watch the ends of the episodes in the mask in the newest step; None: of all."""
        entries = self._all if ended is None else ended
        self._count_stored()
        self._count([np.atleast_1d(column)[entries] for column in values], last=True)
        self._episodes += int(np.count_nonzero(entries))
        self._running = ~entries

    def _count_stored(self) -> None:
        if self._stored:
            columns = zip(*self._stored, strict=True)
            self._count([np.ravel(column) for column in columns], last=False)
            self._stored = []

    def _count(self, values: Sequence[Floats], *, last: bool) -> None:
        """Count samples; ``last``: the last samples of episodes, which were counted already."""
        raise NotImplementedError


class _Extent:
    """The finite numbers so far, and how many of them a bound clips."""

    def __init__(self, bound: float) -> None:
        self.bound = bound
        self.seen = self.clipped = self.below = 0
        self.low, self.high = math.inf, -math.inf

    def add(self, numbers: Floats) -> None:
        finite = numbers[np.isfinite(numbers)]
        if len(finite):
            self.seen += len(finite)
            self.clipped += int(np.count_nonzero(np.abs(finite) > self.bound))
            self.below += int(np.count_nonzero(finite < -self.bound))
            self.low = min(self.low, finite.min())
            self.high = max(self.high, finite.max())

    @property
    def advice(self) -> str:
        """The range of the numbers, and a clip that shows them."""
        return (
            f"it ranged from {self.low:.3g} to {self.high:.3g}; take a clip= about that range, "
            f"such as clip={max(-self.low, self.high):.3g}"
        )


class ClipWatch(_Watch):
    """Counts the samples of the first episodes where the clip flattens the reward."""

    def __init__(self, shaping: Shaping, num: int) -> None:
        super().__init__(num)
        self._shaping = shaping
        self._extent = _Extent(shaping.clip)

    @property
    def report(self) -> str | None:
        """The warning; None if the clip changes at most 9 of 10 values and raises at most half."""
        extent, bound = self._extent, self._extent.bound
        if 10 * extent.clipped > 9 * extent.seen:
            count, where = extent.clipped, f"outside of [-{bound:g}, {bound:g}]"
        elif 2 * extent.below > extent.seen:
            count = extent.below
            where = f"below -{bound:g}, where no step towards satisfaction shows"
        else:
            return None
        return (
            f"clip={bound:g} flattens the reward: at {count} of {extent.seen} samples of the first "
            f"episodes the robustness that decides it was {where}; {extent.advice}, or weights= "
            "that bring the robustness inside"
        )

    def _count(self, values: Sequence[Floats], *, last: bool) -> None:
        if last is self._shaping.pays_episode:  # "terminal" pays only at last samples
            self._extent.add(self._shaping.deciding(values))


class ObservedWatch(_Watch):
    """Counts the samples of the first episodes where the clip flattens the observation."""

    def __init__(
        self, observe: str, names: Sequence[str], weights: Sequence[float], bound: float, num: int
    ) -> None:
        super().__init__(num)
        self._observe, self._names, self._weights = observe, names, weights
        self._extents = [_Extent(bound) for _ in names]

    @property
    def report(self) -> str | None:
        """The warning about the specification that is clipped most; None if at most half is."""
        pairs = zip(self._names, self._extents, strict=True)
        name, extent = max(pairs, key=lambda pair: pair[1].clipped / max(pair[1].seen, 1))
        if 2 * extent.clipped <= extent.seen:
            return None
        bound = extent.bound
        return (
            f"clip={bound:g} flattens the values of observe={self._observe!r}: at {extent.clipped} "
            f"of {extent.seen} samples of the first episodes the robustness of {name!r} was "
            f"outside of [-{bound:g}, {bound:g}], where the observation is the same; "
            f"{extent.advice}"
        )

    def _count(self, values: Sequence[Floats], *, last: bool) -> None:
        if not last:
            for extent, column, weight in zip(self._extents, values, self._weights, strict=True):
                extent.add(column * weight)
