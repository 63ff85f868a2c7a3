"""`StlReward` and `VectorStlReward`: rewards shaped with robustness; the base of all rewards."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import compress
from typing import Any, Required, SupportsFloat, TypeVar, Unpack

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorWrapper
from numpy.typing import NDArray

from rtamt import Explanation, InputError
from rtamt.errors import Argument
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.infos import put
from rtamt_gym.judging.monitors import MonitorValues
from rtamt_gym.judging.specs import ConstantValue, SpecsLike
from rtamt_gym.shaping import (
    Mode,
    Numeric,
    Priority,
    Shaping,
    ShapingNumbers,
    clip,
    least,
    outcome,
    settle,
)
from rtamt_gym.signals.columns import Batch, Entries, Floats
from rtamt_gym.signals.signals import SignalLike, own_signals
from rtamt_gym.signals.taps import StaysOpen
from rtamt_gym.wrappers.episode_counters import EpisodeCounters, put_returns
from rtamt_gym.wrappers.monitor import StlMonitor
from rtamt_gym.wrappers.monitoring import Monitoring, MonitorOptions
from rtamt_gym.wrappers.observing import ClipWatch, Observe, Observing
from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor

_M = TypeVar("_M", bound=Monitoring)


class ShapingOptions(ShapingNumbers):
    """The keyword arguments of `rtamt_gym.shaping.Shaping.of`."""

    mode: Required[Mode]


class StlMonitorOptions(MonitorOptions, total=False):
    """The keyword arguments of `StlMonitor`."""

    history: bool


class Rewarding(Observing):
    """The base of `StlReward`, `VectorStlReward` and `ParallelStlReward`."""

    _monitor: Any
    _outcome: Any
    """The `outcome` of the newest samples."""
    _followed = 0
    """The number of changes of constants that it has applied."""

    def _set_up(
        self, env: Any, options: ShapingOptions, observe: Observe | None = None, num: int = 1
    ) -> None:
        self._shaping = shaping = Shaping.of(list(self._monitor.monitors), **options)
        self._settles = shaping.settles
        self._set_up_observations(
            env,
            observe,
            shaping.clip,
            self._monitor,
            shaping.weights,
            whole_episode=shaping.pays_episode,
        )
        self._clip_watch = ClipWatch(shaping, num) if shaping.pays_robustness else None
        self._followed = self._monitor.constant_changes

    @property
    def constants(self) -> dict[str, float]:
        """The values of the constants, as in the monitor; setting it changes some there."""
        constants: dict[str, float] = self._monitor.constants
        return constants

    @constants.setter
    def constants(self, constants: Mapping[str, ConstantValue]) -> None:
        self._monitor.constants = constants

    @property
    def stl_episodes(self) -> deque[dict[str, Any]]:
        """The records of the last episodes that ended, as in the monitor."""
        episodes: deque[dict[str, Any]] = self._monitor.stl_episodes
        return episodes

    def _begin(self, entries: Entries | None = None) -> None:
        """Apply a change of constants; refuse starts with unknown values in these environments."""
        monitor = self._monitor
        if self._followed != monitor.constant_changes:
            self._follow_monitors(monitor)
            self._followed = monitor.constant_changes
        if not monitor.unknown_allowed:
            return
        for name, (_, judge) in monitor.monitors.items():
            unknown = judge.unknown
            if not isinstance(unknown, tuple):  # a row for each environment
                rows = unknown if entries is None else unknown[entries]
                unknown = tuple(compress(judge.variables, np.any(rows, axis=0).tolist()))
            read = [v for v in unknown if v in judge.program.read_first()]
            if read:
                raise InputError(
                    f"specification {name!r} reads {listing(read)} at the sample of the reset, "
                    "where nothing is known of it: its worst case stays as it is there for the "
                    "whole episode, and nothing can be learned; give the signal a value at the "
                    "reset, speak of the samples after it, as in always[1:inf](...), or pass ",
                    Argument("nan", "hold"),
                )

    def _paying(self, values: MonitorValues[Numeric]) -> list[Numeric]:
        """Return the robustness of each specification that the reward depends on."""
        return values.judged if self._shaping.pays_episode else values.robustness

    def _potential_of(self, values: MonitorValues[Numeric]) -> Numeric:
        """Return the number that sets the reward of a step by its values before and after."""
        if self._shaping.pays_bounds:
            return self._shaping.middle(values.lower, values.upper)
        return self._shaping.robustness(self._paying(values))

    def _settle(self, lower: Numeric, upper: Numeric) -> Numeric:
        """Return the bonus or the penalty of a step with these bounds of the minimum."""
        newest = outcome(lower, upper)
        shaping = self._shaping
        paid: Numeric = settle(self._outcome, newest, shaping.bonus, shaping.penalty)
        self._outcome = newest
        return paid

    def _watch_start(self, paying: Sequence[Any], entries: Entries | None = None) -> None:
        """Count the robustness at the start of episodes for the warning about the clip."""
        if self._clip_watch is not None:
            self._clip_watch.reset(paying, entries)
            self._warn_if_flat()

    def _warn_if_flat(self) -> None:
        """Report after the first episodes if the clip flattens the reward, once."""
        watch = self._clip_watch
        if watch is not None and watch.finished:
            self._clip_watch = None
            report = watch.report
            if report is not None:
                self._observed_watch = None  # it would report the same clip
                warnings.warn(report, UserWarning, stacklevel=caller_level())


def find_or_make(
    kind: type[_M],
    env: Any,
    specs: SpecsLike | None,
    signals: Mapping[str, SignalLike] | None,
    options: MonitorOptions,
) -> tuple[Any, _M]:
    """Return the environment inside its monitor, and the monitor: its own, or a new one.

    Raises:
        InputError: Without a monitor and arguments that describe one, or with both.
    """
    phrase = f"{'a' if kind.__name__.startswith('V') else 'an'} {kind.__name__}"
    required = {"specs": specs, "signals": signals}
    within = env
    while isinstance(within, gym.Wrapper | VectorWrapper) or hasattr(within, "possible_agents"):
        if isinstance(within, Rewarding):
            raise InputError(
                f"expected an environment without a reward of its requirements, got one with "
                f"{type(within).__name__}; give one wrapper all specifications, with "
                'weights={"upright": 1.0, "near": 0.5} or priorities='
            )
        if isinstance(within, kind):
            names = [*(name for name, value in required.items() if value is not None), *options]
            if names:
                raise InputError(
                    f"{', '.join(f'{name}=' for name in names)} would describe a second "
                    f"monitor, but the environment has {phrase}; give them to that one"
                )
            return env, within
        within = getattr(within, "env", None)
    for name, value in required.items():
        if value is None and not (name == "signals" and own_signals(env)):
            raise InputError(
                f"expected {name}=, or an environment with {phrase}, got neither; such as "
                'specs="always(x > 0)", signals={"x": "obs[0]"}'
            )
    make: Any = kind
    monitor = make(env, specs, signals, **options)
    return monitor, monitor


class StlReward(Rewarding, gym.Wrapper[Any, ActType, ObsType, ActType], RecordConstructorArgs):
    """Shapes the reward with the robustness of specifications.

    The wrapper takes the arguments of :class:`StlMonitor` and contains a monitor, or uses the
    monitor of the environment. The environment's own reward stays in ``info["reward"]``.

    Let r be that reward, x' the robustness of the episode so far, ``info["robustness"]``, clipped
    to [-clip, clip], and x the same before the step. The new reward is

    * ``mode="add"``: r + weight * x'
    * ``mode="replace"``: x'
    * ``mode="potential"``: r + weight * (gamma * x' - x), with x' = 0 if the step terminates the
      episode, but not if it truncates it; this keeps the optimal policies if ``gamma`` is the
      learner's discount and the state is observed
    * ``mode="terminal"``: r, and weight * x' more at the end of the episode
    * ``mode="progress"``: r + weight * (m' - m), with m the middle of the lower and the upper bound
      of the robustness, each clipped
    * ``mode="hierarchical"``: the first level of ``priorities`` that is violated pays its own x',
      raised by ``clip`` for every level before it; if none is violated, the last level does
    * ``mode="verdict"``: 0; only ``bonus`` and ``penalty`` are paid

    With several specifications x is their minimum, each times its entry in ``weights``; with a
    ``temperature`` T it is the smooth minimum -T * log(sum(exp(-x / T))). With ``view="step"`` x is
    the robustness of the newest instant whose horizon has passed; ``"terminal"`` pays the
    robustness of the whole episode. Wrappers inside that count episodes get the returns that the
    learner was paid. ``compute_reward`` of a goal environment is not shaped.

    :mod:`rtamt_gym.shaping` explains each mode. The vector version is :class:`VectorStlReward`.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import StlReward
        >>> specs, signals = "always(abs(theta) < 0.1)", {"theta": "obs[2]"}
        >>> env = StlReward(gym.make("CartPole-v1"), specs, signals, mode="add", weight=10.0)
        >>> _, info = env.reset(seed=123)
        >>> _, reward, _, _, info = env.step(1)
        >>> print(f"{reward:.2f} {info['reward']} {info['robustness']:.3f}")
        1.71 1.0 0.071

    Change logs:
     * v0.5.0 - Initially added
    """

    _monitor: StlMonitor[Any, Any]

    def __init__(
        self,
        env: gym.Env[ObsType, ActType],
        specs: SpecsLike | None = None,
        signals: Mapping[str, SignalLike] | None = None,
        *,
        mode: Mode,
        weight: float = 1.0,
        clip: float = 1.0,
        gamma: float = 0.99,
        temperature: float | None = None,
        weights: Mapping[str, float] | None = None,
        priorities: Mapping[str, Priority] | None = None,
        bonus: float = 0.0,
        penalty: float = 0.0,
        observe: Observe | None = None,
        **monitor: Unpack[StlMonitorOptions],
    ) -> None:
        """Find the monitor of the environment or make one, and check the numbers.

        Args:
            env: The environment to apply the wrapper
            specs: As for :class:`StlMonitor`; ``None`` if the environment has one
            signals: As for :class:`StlMonitor`; ``None`` if the environment has one, or has
                ``signals`` of its own
            mode: How robustness becomes reward, see above
            weight: Factor of the robustness next to the reward of the environment; not for
                ``"replace"``, ``"hierarchical"`` and ``"verdict"``. 0 pays ``bonus`` and
                ``penalty`` without shaping
            clip: Bound of the robustness; the interesting margins of every specification should be
                inside (``weights`` help). If the robustness that decides the reward is outside
                at more than 9 of 10 samples of the first 10 episodes, or below -clip at more than
                half, a ``UserWarning`` reports its range. An infinite robustness does not count.
                For ``"terminal"``, only the last samples count
            gamma: The discount of the learner, for ``"potential"``
            temperature: Makes the minimum over the specifications smooth; ``None``: exact
            weights: Factor of the robustness of a specification, 1 where absent, so that margins
                in different units compare
            priorities: For ``"hierarchical"``, which needs them: ``"safety"``, ``"target"`` or
                ``"comfort"`` of every specification, in this order; a level counts as the minimum
                over its specifications
            bonus: Paid once an episode, in addition to the reward of every mode, when all
                specifications are certainly satisfied: at the step that shows it, or at the last
                one if only the end decides; 0 or more. The first step pays what the sample of the
                reset decides
            penalty: Deducted once in the same way when one is certainly violated; 0 or more
            observe: As for :class:`StlMonitor`; the numbers are multiplied by ``weights``
            **monitor: The keyword arguments of :class:`StlMonitor`

        Raises:
            SpecificationError: As :class:`StlMonitor` does
            InputError: As :class:`StlMonitor` does; if the environment has no monitor and none is
                described, or has a monitor and another is described; and if an argument is not one
                of its choices, is out of range or names an unknown specification
        """
        options = ShapingOptions(
            mode=mode,
            weight=weight,
            clip=clip,
            gamma=gamma,
            temperature=temperature,
            weights=weights,
            priorities=priorities,
            bonus=bonus,
            penalty=penalty,
        )
        # Without the arguments of the monitor: the EnvSpec lists it as a separate wrapper, and
        # this wrapper finds it when the environment is made again.
        RecordConstructorArgs.__init__(self, **options, observe=observe)
        env, self._monitor = find_or_make(StlMonitor, env, specs, signals, monitor)
        gym.Wrapper.__init__(self, env)
        self._set_up(env, options, observe)
        self._payers = self._find_payers()
        self._fresh = env is self._monitor  # its infos are new at every step
        self._factor = self._shaping.factor
        if not self._fresh or (
            self._shaping.pays_episode and self._monitor.judging.reading.view == "step"
        ):
            self._factor = None  # a wrapper may have changed the info, or it shows an instant
        self._robustness = self._outcome = self._return = 0.0
        self._counters = EpisodeCounters(env)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; the sample of the reset gives the first potential."""
        obs, info = self.env.reset(seed=seed, options=options)
        if self._followed != self._monitor.constant_changes:
            self._payers = self._find_payers()
        self._begin()
        self._robustness = self._potential(info)
        self._outcome = self._return = 0.0
        self._watch_start(self._robustness_of_each())
        if self._state is not None:
            shown: MonitorValues[float] = self._monitor.values()
            obs = self._observed(obs, shown)
            self._watch_reset(shown)
        return obs, info

    def step(self, action: ActType) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment and shape the reward."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        own = float(reward)
        before = self._robustness
        after = self._robustness = self._potential(info)
        ended = terminated or truncated
        shaping = self._shaping
        shaped = shaping.reward(own, before, after, terminated, ended)
        if self._settles:
            shaped += self._settle(float(info["stl_lower"]), float(info["stl_upper"]))
        self._return += shaped
        if self._fresh:
            info["reward"] = np.float64(own)
        else:
            info = {**info, "reward": np.float64(own)}
        if ended:
            self._counters.put_return(info, self._return)
        if self._clip_watch is not None:
            paying = self._robustness_of_each()
            self._clip_watch.step(paying)
            if ended:
                self._clip_watch.end(paying)
                self._warn_if_flat()
        if self._state is not None:
            shown: MonitorValues[float] = self._monitor.values()
            obs = self._observed(obs, shown)
            self._watch_step(shown, ended)
        return obs, np.float64(shaped), terminated, truncated, info

    @property
    def samples(self) -> int:
        """The number of samples since :meth:`reset`, including the sample of the reset."""
        return self._monitor.samples

    def explain(self, name: str | None = None) -> Explanation:
        """Explain the robustness of the episode, as :meth:`StlMonitor.explain` does."""
        return self._monitor.explain(name)

    def _find_payers(self) -> list[Any]:
        """Return the monitors that the reward depends on, one per specification."""
        pairs = self._monitor.monitors.values()
        return [judge if self._shaping.pays_episode else source for source, judge in pairs]

    def _robustness_of_each(self) -> list[float]:
        return [payer.robustness for payer in self._payers]

    def _potential(self, info: Mapping[str, Any]) -> float:
        """Return `_potential_of` the newest sample, from the info where it has the numbers."""
        shaping, factor = self._shaping, self._factor
        if factor is None:
            if not shaping.pays_bounds:
                return shaping.robustness(self._robustness_of_each())
            values: MonitorValues[float] = self._monitor.values()
            return self._potential_of(values)
        if not shaping.pays_bounds:
            return clip(factor * float(info["robustness"]), shaping.clip)
        lower = clip(factor * float(info["stl_lower"]), shaping.clip)
        upper = clip(factor * float(info["stl_upper"]), shaping.clip)
        return 0.5 * (lower + upper)


class VectorStlReward(Rewarding, StaysOpen, VectorWrapper, RecordConstructorArgs):
    """Shapes the rewards of all environments with the robustness of specifications.

    Each environment gets the reward that :class:`StlReward` around it would pay. The wrapper takes
    the arguments of :class:`VectorStlMonitor` and contains a monitor, or uses the monitor of the
    environments. The rewards are float64; the environments' own stay in ``infos["reward"]``. In the
    autoreset mode ``NEXT_STEP``, a step that resets an environment pays the vector environment's
    reward: 0. With ``SAME_STEP`` the environment's reward of the last step of an episode is in
    ``infos["final_info"]["reward"]``, and ``observe="state"`` is appended to ``final_obs``. If a
    wrapper inside counts episodes, of each environment or of all, ``infos["episode"]`` has ``r``,
    the sum of the rewards that the learner was paid, and ``r_env``, the environment's own; the
    wrapper's own statistics do not change.

    The warning about a ``clip`` that flattens counts the first 10 episodes that end, in any
    environment, and the samples of all until then.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import VectorStlReward
        >>> envs = gym.make_vec("CartPole-v1", num_envs=3, vectorization_mode="vector_entry_point")
        >>> envs = VectorStlReward(
        ...     envs, "always(abs(theta) < 0.1)", {"theta": "obs[2]"}, mode="add", weight=10.0
        ... )
        >>> _, infos = envs.reset(seed=123)
        >>> _, rewards, _, _, infos = envs.step(np.array([1, 1, 0]))
        >>> rewards.round(2), infos["reward"], infos["robustness"].round(3)
        (array([1.57, 1.78, 1.68]), array([1., 1., 1.]), array([0.057, 0.078, 0.068]))

    Change logs:
     * v0.5.0 - Initially added
    """

    _monitor: VectorStlMonitor

    def __init__(
        self,
        env: Batch,
        specs: SpecsLike | None = None,
        signals: Mapping[str, SignalLike] | None = None,
        *,
        mode: Mode,
        weight: float = 1.0,
        clip: float = 1.0,
        gamma: float = 0.99,
        temperature: float | None = None,
        weights: Mapping[str, float] | None = None,
        priorities: Mapping[str, Priority] | None = None,
        bonus: float = 0.0,
        penalty: float = 0.0,
        observe: Observe | None = None,
        **monitor: Unpack[MonitorOptions],
    ) -> None:
        """Find the monitor of the environment or make one, and check the numbers.

        It takes the arguments of :class:`StlReward`, with a vector environment, and the keyword
        arguments of :class:`VectorStlMonitor`.

        Raises:
            SpecificationError: As :class:`VectorStlMonitor` does
            InputError: As :class:`VectorStlMonitor` and :class:`StlReward` do
        """
        options = ShapingOptions(
            mode=mode,
            weight=weight,
            clip=clip,
            gamma=gamma,
            temperature=temperature,
            weights=weights,
            priorities=priorities,
            bonus=bonus,
            penalty=penalty,
        )
        RecordConstructorArgs.__init__(self, **options, observe=observe)
        env, self._monitor = find_or_make(VectorStlMonitor, env, specs, signals, monitor)
        VectorWrapper.__init__(self, env)
        self._set_up(env, options, observe, env.num_envs)
        self._robustness = np.zeros(env.num_envs)
        self._outcome = np.zeros(env.num_envs)
        self._returns = np.zeros(env.num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset environments; the sample of a reset gives the first potential."""
        mask = None if options is None else options.get("reset_mask")
        obs, infos = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]  # lists
        self._begin(mask)
        values = self._monitor.values()
        self._robustness = self._potential_of(values)
        which = slice(None) if mask is None else mask
        self._returns[which] = self._outcome[which] = 0.0
        self._watch_start(self._paying(values), mask)
        self._watch_reset(values, mask)
        return self._observed(obs, values), infos

    def step(self, actions: Any) -> tuple[Any, Floats, Any, Any, dict[str, Any]]:
        """Step the environments and shape the rewards."""
        obs, rewards, terminated, truncated, infos = self.env.step(actions)
        own = np.array(rewards, np.float64)
        ended = np.logical_or(terminated, truncated)
        now = self._monitor.values()
        last = self._monitor.terminal or now
        before, after = self._robustness, self._potential_of(last)
        shaping = self._shaping
        shaped = shaping.reward(
            own, before, after, np.array(terminated, np.float64), ended.astype(np.float64)
        )
        if self._settles:
            shaped += self._settle(least(last.lower), least(last.upper))
            if last is not now:
                self._outcome[ended] = 0.0
        self._returns += shaped
        infos = dict(infos)
        if last is now:
            self._robustness = after
            begun = self._monitor.begun
            if begun is not None:
                self._begin(begun)
                shaped = np.where(begun, own, shaped)
                self._returns[begun] = self._outcome[begun] = 0.0
            put(infos, "reward", own, None if begun is None else ~begun, self.num_envs)
        else:
            self._begin(ended)
            self._robustness = self._potential_of(now)
            infos["final_info"] = dict(infos["final_info"])
            put(infos["final_info"], "reward", own, ended, self.num_envs)
            put(infos, "reward", own, ~ended, self.num_envs)
            self._append_to_final(infos, last, ended)
            put_returns(infos["final_info"], self._returns, ended)
        if ended.any():
            put_returns(infos, self._returns, ended)
            self._returns[ended] = 0.0
        if self._clip_watch is not None:
            paying = self._paying(last)
            self._clip_watch.step(paying)
            if ended.any():
                self._clip_watch.end(paying, ended)
                if last is not now:
                    self._clip_watch.reset(self._paying(now), ended)
                self._warn_if_flat()
        self._watch_step(last, ended)
        if last is not now:
            self._watch_reset(now, ended)
        return self._observed(obs, now), shaped, terminated, truncated, infos

    @property
    def samples(self) -> NDArray[np.int64]:
        """The number of samples since each environment's reset, including the reset's."""
        return self._monitor.samples
