"""`StlMonitor`: an environment monitored against specifications; `CostEnv`: its costs."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any, SupportsFloat, Unpack

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv

from rtamt import InputError, InputTypeError, Specification, SpecificationError
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.infos import step_info
from rtamt_gym.judging.monitor_set import Feed, MonitorSet
from rtamt_gym.judging.specs import ConstantValue, SpecsLike, recordable
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.episode_counters import EpisodeCounters
from rtamt_gym.wrappers.episode_monitoring import EpisodeMonitoring
from rtamt_gym.wrappers.monitoring import (
    ChangedConstants,
    MonitorOptions,
    OnSatisfaction,
    Violations,
)
from rtamt_gym.wrappers.observing import Observe
from rtamt_gym.wrappers.substeps import SubSteps, fits, read_substep_period
from rtamt_gym.wrappers.vector_forms import is_pool

if TYPE_CHECKING:
    from rtamt_gym.live.view import RerunView


class StlMonitor(
    EpisodeMonitoring, gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs
):
    """Monitors an environment against specifications and ends an episode that violates one.

    Sample 0 is the observation of :meth:`reset`; every later sample is the observation after a step
    with its action and reward, the terminal observation included. Place time limits inside.

    Every ``info`` gets ``robustness``, the minimum over the specifications if the episode ended
    now; its bounds ``stl_lower`` and ``stl_upper``; and ``stl_violated`` (all ``numpy.float64`` or
    ``bool``). Depending on specifications and options, it also gets ``stl``, ``stl_progress``,
    ``stl_of_instant`` and ``cost``; the info of a reset gets ``stl_period``, in seconds. The last
    info of an episode also gets

    * ``stl_episode``: ``{spec: {"robustness", "verdict", "satisfied", "decided_at"}}``, with the
      sample that decided the verdict; ``ended_at`` in its place if only the end did, and
      ``by_end=True`` for a violation by ``at_termination="failure"``
    * ``stl_success``: all specifications are satisfied; ``stl_undecided``: a verdict is open
    * ``is_success``: ``stl_success``, unless the environment reports its own
    * ``stl_violated_by``, ``stl_violated_at``: the first violation, if any, and its sample

    The guide *Gymnasium* describes all keys, views, ends of episodes, sub-steps and observations.
    The vector version is :class:`VectorStlMonitor`.

    Attributes:
        stl_episodes: Records of the last ``buffer_length`` episodes, the newest last:
            ``{"samples", "terminated", "truncated", "specs", "violated_by", "violated_at"}``;
            ``specs`` is ``info["stl_episode"]``, the last two are absent without a violation.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import StlMonitor
        >>> env = gym.make("CartPole-v1")
        >>> env = StlMonitor(env, "always(abs(theta) < 0.1)", {"theta": "obs[2]"})
        >>> _, info = env.reset(seed=123)
        >>> terminated = False
        >>> while not terminated:
        ...     _, _, terminated, _, info = env.step(1)
        >>> info["stl_violated_by"], info["stl_violated_at"], env.samples
        ('spec', 6, 7)

    Change logs:
     * v0.5.0 - Initially added
    """

    _UNPICKLED = frozenset({"_feed", "_feed_reset", "_inside", "_comparing", "_live"})

    @documents_options("runs")
    def __init__(
        self,
        env: gym.Env[ObsType, ActType],
        specs: SpecsLike,
        signals: Mapping[str, SignalLike] | None = None,
        *,
        on_violation: Violations = "terminate",
        on_satisfaction: OnSatisfaction = "report",
        details: bool = False,
        cost: Cost | None = None,
        buffer_length: int = 100,
        constants: Mapping[str, ConstantValue] | None = None,
        history: bool = False,
        observe: Observe | None = None,
        clip: float = 1.0,
        live: RerunView | None = None,
        **reading: Unpack[EvaluationKeywords],
    ) -> None:
        """Parse the specifications and bind the signals.

        Args:
            env: The environment to apply the wrapper
            specs: A specification (text, path of a ``.stl`` file, or ``rtamt.Specification``), or
                a mapping of names to specifications. In a text, every formula that no other
                formula uses is a specification
            signals: For every variable a selector such as ``"obs[2]"``, ``"obs['goal'][0]"``,
                ``"action[0]"``, ``"reward"``, ``"info['speed']"`` or ``"qpos[1]"``, or a function
                of a :class:`rtamt_gym.Step`. A pair adds the value at reset: a number, or
                ``None`` if it is unknown. Action and reward need a pair. Other variables read the
                environment's own ``signals``
            on_violation: ``"terminate"`` or ``"truncate"`` the episode at a certain violation, or
                only ``"report"`` it; or a mapping with a word for every specification. If several
                are violated, terminate wins over truncate, and truncate over report
            on_satisfaction: The same once every specification is certainly satisfied
            details: Whether to add ``info["stl"]``, the state of every specification:
                ``{spec: {"robustness", "lower", "upper", "verdict"}}``
            cost: Adds ``info["cost"]`` to every step, and ``cost_NAME`` for each of several
                specifications; ``cost`` is their maximum. ``"violation"`` is 1 at a step that shows
                that an instant violates p in ``always(p)``, so the sum counts unsafe instants;
                ``"depth"`` is the depth of that violation; ``"latched"`` is 1 from the first
                violation on; ``"first"`` is 1 only at the step that shows it. The last two charge
                violations by the end of the episode too
            buffer_length: The number of records in :attr:`stl_episodes`
            constants: Values of constants of the specifications, as for `rtamt.parse`;
                :attr:`constants` and :meth:`reset` change them later
            history: Whether to keep the samples of the episode for :meth:`explain`, 8 bytes for
                each variable of each specification
            observe: ``"state"`` appends five numbers for each specification to the observation;
                ``"obligations"`` also appends pending obligations. :attr:`observed` lists the
                numbers. A ``Box`` of one dimension grows; a ``Dict`` gets the key ``"stl"``
            clip: Bound of the numbers that ``observe`` appends; the interesting margins of every
                specification should be inside. If more than half of the samples of the first 10
                episodes are outside, a ``UserWarning`` reports their range
            live: A view that shows each sample, such as ``rtamt_gym.live.RerunView()``; copies and
                environments made from ``spec`` do not show theirs. Default: no view
            **reading: The evaluation options of :class:`rtamt_gym.EvaluationOptions`

        Raises:
            SpecificationError: If a specification is wrong, needs a period that is unknown, has a
                bound that is not a multiple of the period, or depends on the first sample only
            InputError: If the environment has a monitor, a variable has no signal, a selector does
                not fit the environment, or an option has no such value
        """
        read = checked_options(reading, type(self), "runs")
        options = MonitorOptions(
            on_violation=on_violation,
            on_satisfaction=on_satisfaction,
            details=details,
            cost=cost,
            buffer_length=buffer_length,
            constants=constants,
        )
        recorded: dict[str, Any] = {**options, **read.complete("runs").options()}
        recorded |= {"specs": recordable(specs), "signals": signals, "history": history}
        RecordConstructorArgs.__init__(self, **recorded, observe=observe, clip=clip)
        gym.Wrapper.__init__(self, single_env(env))
        find_period = read_substep_period if read.substeps else read_period
        loaded = self._set_up(env, specs, signals, read, options, find_period)
        self.stl_episodes = deque(maxlen=buffer_length)
        self._history = history
        try:
            self._monitor_set = monitor_set = self._make_monitor_set(loaded)
        except SpecificationError as error:
            inner = None if read.substeps else read_substep_period(env)
            if inner is not None and read.period is None and fits(self._judging, inner, cost):
                error.add_note(f"substeps=True takes samples {inner:g} s apart, which fits")
            raise
        self._has_extras = details or monitor_set.tells_more
        self._set_up_observations(env, observe, clip, monitor_set)
        self._substeps = read.substeps
        if monitor_set.period is not None:
            self._time = self._step_time(env, float(monitor_set.period))
        self._show(live)
        self._bind_signals()
        self._counters = EpisodeCounters(env)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsType, dict[str, Any]]:
        """Reset the environment and the monitors; the observation is sample 0.

        ``options={"constants": {"limit": 0.3}}`` changes constants of the specifications for this
        episode and all later ones; the environment does not get them.

        Raises:
            InputError: If a signal is nan or cannot be read; as :attr:`constants` does.
            SpecificationError: As :attr:`constants` does.
            StateError: If the environment has changed its period since construction.
        """
        options, change = self._split_options(options)
        self._warn_of_unseen_end(unended=self._abandon())
        obs, info = self.env.reset(seed=seed, options=options)
        self._apply(change)
        self._begin_times()
        monitor_set = self._monitor_set
        monitor_set.reset()
        if self._live is not None:
            self._live.begin()
        assessed = self._feed_reset(obs, None, None, info)
        monitor_set.begin()
        violated = monitor_set.violated_by is not None
        states = monitor_set.describe() if self._details else None
        info = step_info(
            info, *assessed, violated, monitor_set, states, None, monitor_set.period_number
        )
        self._running, self._lost = True, None
        if self._state is not None:
            values = self.values()
            obs = self._observed(obs, values)
            self._watch_reset(values)
        return obs, info

    def close(self) -> None:
        """Close the environment; an episode that has not ended is recorded as truncated."""
        self._abandon()
        super().close()

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment, update the monitors, and end a violated episode.

        Raises:
            StateError: Before :meth:`reset`, after the end of an episode, and in a copy with an
                environment that has lost the episode; or if a bound depends on the period and the
                clock of the simulation contradicts it.
            InputError: If a signal is nan or cannot be read; the episode is over then, and with
                ``substeps=True`` after any error of the environment.
        """
        if not self._running:
            self._resume()
        # In a variable: Python would first look up self._feed() as a method.
        monitor_set, feed = self._monitor_set, self._feed
        if self._substeps:
            self._running = False  # until it is sure that no sample is missing
            obs, reward, terminated, truncated, info = self._inside.step(action)
            self._running = True
        else:
            obs, reward, terminated, truncated, info = self.env.step(action)
        try:
            robustness, lower, upper = feed(obs, action, reward, info)
        except BaseException:
            # After a missed sample the monitor would count wrong.
            self._running = False
            raise
        how = self._how_to_end() if monitor_set.settled else "report"
        ended = terminated or truncated
        if ended:
            robustness, lower, upper = self._finish(terminated)
        if how != "report" and not terminated:
            terminated = how == "terminate"
            truncated = truncated or how == "truncate"
        violated = monitor_set.violated_by is not None
        if self._has_extras:
            info = step_info(
                info,
                robustness,
                lower,
                upper,
                violated,
                monitor_set,
                monitor_set.describe() if self._details else None,
                monitor_set.take_costs(),
            )
        else:
            info = step_info(info, robustness, lower, upper, violated)
        if terminated or truncated:
            self._running = False
            self._conclude([info], terminated, truncated)
            if not ended:
                self._counters.close(terminated, truncated, info)
            self._warn_of_ends()
        if self._state is not None:
            values = self.values()
            obs = self._observed(obs, values)
            self._watch_step(values, terminated or truncated)
        return obs, reward, terminated, truncated, info

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # as Gymnasium's wrappers do
        """The ``EnvSpec`` with this wrapper; with a function as a signal it has no JSON."""
        spec = super().spec
        if spec is not None and any(signal.source is None for signal in self._signals):
            values = {part.name: getattr(spec, part.name) for part in fields(spec) if part.init}
            self._cached_spec = spec = _SpecWithFunction(**values)
        return spec

    @property
    def substeps(self) -> bool:
        """Whether it takes samples inside the environment's steps."""
        return self._substeps

    def _set_env(self, env: Any) -> None:
        super()._set_env(env)
        if self._substeps:
            self._inside.inside.env = env

    def _make_monitor_set(self, specs: Mapping[str, Specification]) -> MonitorSet:
        return MonitorSet(
            specs, self._of_monitors, self._cost, history=self._history, number=np.float64
        )

    def _apply(self, change: ChangedConstants | None) -> None:
        super()._apply(change)
        self._has_extras = self._details or self._monitor_set.tells_more

    def _bind_signals(self) -> None:
        if not self._substeps:
            super()._bind_signals()
            return
        self._inside = SubSteps(self.env, self._signals, self._monitor_set, self._keep())
        self._feed: Feed = self._compared(self._monitor_set.read, substeps=True)
        self._feed_reset: Feed = self._inside.reset


class _SpecWithFunction(EnvSpec):
    """An ``EnvSpec`` with a function as a signal: for `gym.make`, not for JSON."""

    def to_json(self) -> str:
        """Raise an `InputError` that names the signal."""
        for wrapper in self.additional_wrappers:
            signals = (wrapper.kwargs or {}).get("signals")
            for name, signal in signals.items() if isinstance(signals, dict) else ():
                function = signal[0] if isinstance(signal, list | tuple) else signal
                if callable(function):
                    raise InputError(
                        f"signal {name!r} is a callable, which JSON cannot hold; use a selector "
                        'such as "obs[0]", or pass env.spec itself to gym.make'
                    )
        return super().to_json()


def single_env(env: Any) -> gym.Env[Any, Any]:
    """Return a single environment of Gymnasium; raise an `InputTypeError` for anything else."""
    many = isinstance(env, VectorEnv) or is_pool(env)
    if isinstance(env, gym.Env) and not many:
        return env
    way_out = "make it with gym.make"
    if many:
        way_out = "use VectorStlMonitor or VectorStlReward for many environments"
    elif hasattr(env, "possible_agents"):
        way_out = "use ParallelStlMonitor for several agents"
    raise InputTypeError(f"expected an environment of Gymnasium, got {env!r}; {way_out}")


def monitor_of(env: Any) -> StlMonitor[Any, Any] | None:
    """Return the monitor of an environment below its wrappers; None for any other object."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, StlMonitor):
            return env
        env = env.env
    return None


class CostEnv(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Returns the cost of a step next to its reward, in the form of Safety-Gymnasium.

    :meth:`step` returns six values, ``obs, reward, cost, terminated, truncated, info``; the cost is
    ``info["cost"]``, which stays there. Place it outermost: the wrappers of Gymnasium expect five
    values, the wrappers of Safety-Gymnasium six.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import CostEnv, StlMonitor
        >>> env = StlMonitor(
        ...     gym.make("CartPole-v1"),
        ...     "always(abs(theta) < 0.1)",
        ...     {"theta": "obs[2]"},
        ...     on_violation="report",
        ...     at_termination="complete",
        ...     cost="violation",
        ... )
        >>> env = CostEnv(env)
        >>> obs, info = env.reset(seed=123)
        >>> terminated, costs = False, []
        >>> while not terminated:
        ...     obs, reward, cost, terminated, truncated, info = env.step(1)
        ...     costs.append(float(cost))
        >>> costs
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]

    Change logs:
     * v0.5.0 - Initially added
    """

    def __init__(self, env: gym.Env[ObsType, ActType]) -> None:
        """Find the monitor inside.

        Args:
            env: The environment to apply the wrapper, with an :class:`StlMonitor` or
                :class:`StlReward` that has ``cost=``

        Raises:
            InputError: If no monitor inside the environment adds a cost
        """
        RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)
        monitor = monitor_of(env)
        if monitor is None:
            raise InputError(
                f"expected an environment with an StlMonitor, which adds the cost, got {env}; "
                'such as CostEnv(StlMonitor(env, specs, signals, cost="violation"))'
            )
        if monitor.cost is None:
            raise InputError(
                f"expected a monitor with cost=, got {type(monitor).__name__} without; give it "
                'cost="violation", "depth", "latched" or "first"'
            )

    def step(  # type: ignore[override]  # six values, as the wrappers of Safety-Gymnasium return
        self, action: ActType
    ) -> tuple[ObsType, SupportsFloat, float, bool, bool, dict[str, Any]]:
        """Step the environment; return the cost of the step too."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        return obs, reward, info["cost"], terminated, truncated, info
