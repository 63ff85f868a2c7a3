"""`StlMonitor`: an environment monitored against specifications of signal temporal logic."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, SupportsFloat

import gymnasium as gym
from gymnasium.core import ActType, ObsType
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs

from rtamt import InputError, Specification, SpecificationError, StateError
from rtamt_gym.judges.episodes import record
from rtamt_gym.judges.infos import Cost, last_info, present, step_cost, step_info
from rtamt_gym.judges.interface import Interface, Names, Semantics
from rtamt_gym.judges.panel import Feed, Monitors, Panel
from rtamt_gym.judges.specs import Align, Nan, SpecsLike, View, read_period, recordable
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.monitoring import Monitoring, MonitorOptions, OnViolation
from rtamt_gym.wrappers.substeps import SubSteps, read_substep_period

__all__ = ["StlMonitor"]


class StlMonitor(
    Monitoring, gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs
):
    """Monitors an environment against specifications and ends an episode that violates one.

    Sample 0 of an episode is the observation that :meth:`reset` returns; every later sample is the
    observation after a step with the action and the reward of that step, the terminal observation
    included. Observations, actions and rewards pass through unchanged.

    Every ``info``, that of :meth:`reset` included, gets

    * ``robustness`` (float): the least robustness over the specifications, if the episode ended now
    * ``stl_lower``, ``stl_upper`` (float): bounds of what it can still become
    * ``stl_violated`` (bool): no continuation can satisfy all specifications
    * ``stl`` (dict): with ``details=True``, ``{spec: {"robustness", "lower", "upper", "verdict"}}``
    * ``cost`` (float): with ``cost=``, in the info of every step

    and the last info of an episode also

    * ``stl_episode`` (dict): ``{spec: {"robustness", "verdict", "satisfied", "decided_at"}}``;
      ``verdict`` is ``"VIOLATED"``, ``"UNDECIDED"`` or ``"SATISFIED"``, ``decided_at`` the sample
      that decided it, absent from an open verdict
    * ``stl_violated_by`` (str), ``stl_violated_at`` (int): the specification that was violated
      first and the sample that showed it; absent if none was
    * ``is_success`` (bool): all specifications are satisfied; absent while a verdict is open, and
      where the environment reports its own

    An episode that the environment itself terminates is a complete trace, and its verdicts are
    final. An episode cut short, by a time limit or by this wrapper, could have gone on: a verdict
    that is open then stays ``"UNDECIDED"``, neither success nor failure. Place time limits inside
    this wrapper; it does not see the truncation of a wrapper around it.
    A copy or a pickle of a MuJoCo environment is a new simulation, as Gymnasium makes it, with the
    monitors of the old one: reset it.

    :func:`rtamt_gym.simulate` runs whole episodes and records the signals too, sample by sample;
    it can also stop at a certain satisfaction.

    With ``substeps=True`` the wrapper takes a sample after every step of the simulation, of which
    an environment makes several in one step of its own: a violation between two observations is
    seen. Signals are read from the simulation (``qpos[1]``, ``body:torso.xpos[2]``,
    ``vehicle.speed``, or a callable, which reads ``env`` and gets neither observation nor reward
    nor info) and from the action, which holds during the step. The period is that of the
    simulation, sample numbers count its steps, and an episode still ends after a whole step of the
    environment. For the MuJoCo environments of Gymnasium and for highway-env.

    With ``view="step"`` a formula is a requirement on every instant, as in an online monitor:
    ``robustness`` is that of the newest instant whose horizon has passed (before the first, that of
    the samples so far), bounds and verdict are those of ``always(formula)``.

    Attributes:
        stl_episodes: Records of the last ``buffer_length`` episodes that ended, the newest last:
            ``{"samples", "terminated", "truncated", "specs", "violated_by", "violated_at"}``;
            ``specs`` is ``info["stl_episode"]``, the last two are absent without a violation.

    The vector version of the wrapper is :class:`VectorStlMonitor`.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import StlMonitor
        >>> env = gym.make("CartPole-v1")
        >>> env = StlMonitor(env, "always(abs(theta) < 0.1)", {"theta": "obs[2]"})
        >>> _, info = env.reset(seed=123)
        >>> round(info["robustness"], 3), info["stl_violated"]
        (0.072, False)
        >>> terminated = False
        >>> while not terminated:
        ...     _, _, terminated, _, info = env.step(1)
        >>> info["stl_violated_by"], info["stl_violated_at"], env.samples
        ('spec', 6, 7)
        >>> info["stl_episode"]["spec"]["verdict"]
        'VIOLATED'
        >>> [episode["violated_by"] for episode in env.stl_episodes]
        ['spec']

    Change logs:
     * v0.5.0 - Initially added
    """

    _UNPICKLED = frozenset({"_feed", "_feed_reset", "_inside"})
    _panel: Panel

    def __init__(
        self,
        env: gym.Env[ObsType, ActType],
        specs: SpecsLike,
        signals: Mapping[str, SignalLike],
        *,
        period: float | str | None = None,
        on_violation: OnViolation = "terminate",
        view: View = "episode",
        nan: Nan = "raise",
        align: Align | None = None,
        semantics: Semantics = "standard",
        inputs: Names | None = None,
        outputs: Names | None = None,
        details: bool = False,
        cost: Cost | None = None,
        buffer_length: int = 100,
        substeps: bool = False,
    ) -> None:
        """Parses the specifications, binds the signals, and refuses what cannot be monitored.

        Args:
            env: The environment to apply the wrapper
            specs: A specification (text, path of a ``.stl`` file, or ``rtamt.Specification``), or
                several with their names
            signals: For every variable of the specifications a selector such as ``"obs[2]"``,
                ``"obs['goal'][0]"``, ``"action[0]"``, ``"reward"``, ``"info['speed']"`` or
                ``"qpos[1]"``, or a callable of a :class:`rtamt_gym.Step`, or a pair of one of them
                and its value at reset, which action, reward and info need
            period: Time between two samples, in seconds or as text with a unit; ``None`` reads
                it from the environment; ``1`` with bounds in the default unit counts steps
            on_violation: What a certain violation does: ``"terminate"`` or ``"truncate"`` the
                episode, or only ``"report"`` it
            view: ``"episode"`` evaluates a formula at sample 0 of the episode, ``"step"`` at
                every instant
            nan: ``"raise"`` refuses a signal that is nan, ``"hold"`` keeps its last value
            align: How a bound that is no multiple of the period becomes samples: ``None`` refuses
                it; ``"outward"``, ``"inward"`` and ``"nearest"`` are as for ``rtamt.Monitor``
            semantics: How predicates count, as for ``rtamt.Monitor``: ``"standard"``;
                ``"boolean"``, where each is +inf or -inf; or interface-aware, such as
                ``"output-robustness"``
            inputs: Variables that the system reads, for interface-aware semantics; ``None``: those
                that the texts declare ``input``
            outputs: Variables that the system sets; ``None``: those that the texts declare
                ``output``
            details: Whether to add ``info["stl"]``, the state of every specification
            cost: What ``info["cost"]`` is, if it is to be added: ``"indicator"`` is 1 while the
                episode is violated, ``"depth"`` is how far ``stl_upper`` is below 0, ``"first"`` is
                1 only at the step that shows the violation
            buffer_length: How many records :attr:`stl_episodes` keeps
            substeps: Whether to take a sample after every step of the simulation, see above

        Raises:
            SpecificationError: If a specification is wrong, speaks of the first sample only, has
                a bound that is not a multiple of the period, or needs a period and has none
            InputError: If a variable has no signal, a signal no variable, or a selector does not
                fit the environment; if ``substeps`` does not; if the semantics is unknown, or a
                name in ``inputs`` or ``outputs`` is no variable
        """
        interface = Interface(semantics, inputs, outputs)
        options = MonitorOptions(
            period=period,
            on_violation=on_violation,
            view=view,
            nan=nan,
            align=align,
            semantics=semantics,
            inputs=interface.inputs,
            outputs=interface.outputs,
            details=details,
            cost=cost,
            buffer_length=buffer_length,
        )
        RecordConstructorArgs.__init__(
            self, specs=recordable(specs), signals=signals, **options, substeps=substeps
        )
        gym.Wrapper.__init__(self, env)
        find_period = read_substep_period if substeps else read_period
        loaded = self._set_up(env, specs, signals, options, find_period)
        self.stl_episodes: deque[dict[str, Any]] = deque(maxlen=buffer_length)
        try:
            self._panel = Panel(loaded, self._period, view, nan, interface, align)
        except SpecificationError as error:
            inner = None if substeps else read_substep_period(env)
            if inner is not None and period is None and _fits(loaded, inner, view):
                error.add_note(f"substeps=True takes samples {inner:g} s apart, which fits")
            raise
        self._substeps = substeps
        self._bind_signals()
        self._charged = False
        self._running = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsType, dict[str, Any]]:
        """Resets the environment and the monitors; the observation is sample 0.

        Raises:
            InputError: If a signal is nan or cannot be read.
            StateError: If the environment has changed its period since construction.
        """
        self._running = False
        obs, info = self.env.reset(seed=seed, options=options)
        self._check_period(self.env)
        self._panel.reset()
        self._charged = False
        found = self._feed_reset(obs, None, None, info)
        violated = self._panel.violated_by is not None
        states = self._panel.describe() if self._details else None
        info = step_info(info, *found, violated, states)
        self._running = True
        return obs, info

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, dict[str, Any]]:
        """Steps through the environment, feeds one sample, and ends a violated episode.

        Raises:
            StateError: Before :meth:`reset` and after the end of an episode.
            InputError: If a signal is nan or cannot be read; the episode is over then, and with
                ``substeps=True`` after any error of the environment.
        """
        if not self._running:
            raise StateError(
                "expected a running episode, got step() before reset() or after the end of the "
                "episode; call reset()"
            )
        panel, feed = self._panel, self._feed  # self._feed() would be looked up as a method first
        if self._substeps:
            self._running = False  # until it is sure that no sample is missing
            obs, reward, terminated, truncated, info = self._inside.step(action)
            self._running = True
        else:
            obs, reward, terminated, truncated, info = self.env.step(action)
        try:
            robustness, lower, upper = feed(obs, action, reward, info)
        except BaseException:
            # A monitor that misses a sample would count wrong ever after.
            self._running = False
            raise
        if terminated:
            lower, upper = panel.finish()
        violated = panel.violated_by is not None
        if self._details or self._cost is not None:
            states = panel.describe() if self._details else None
            cost = None
            if self._cost is not None:
                cost = step_cost(self._cost, upper, violated, self._charged)
                self._charged = violated
            info = step_info(info, robustness, lower, upper, violated, states, cost)
        else:
            info = step_info(info, robustness, lower, upper, violated)
        if violated and not terminated:
            terminated = self._on_violation == "terminate"
            truncated = truncated or self._on_violation == "truncate"
        if terminated or truncated:
            self._running = False
            self._conclude(info, terminated, truncated)
        return obs, reward, terminated, truncated, info

    @property
    def samples(self) -> int:
        """Samples fed since :meth:`reset`, that of the reset included."""
        return self._panel.samples

    @property
    def monitors(self) -> Monitors:
        """The monitors of each specification: ``(robustness source, judge)``."""
        return dict(self._panel.monitors)

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # as Gymnasium's wrappers do
        """The ``EnvSpec`` with this wrapper; with a callable signal it has no JSON."""
        spec = super().spec
        if spec is not None and any(signal.source is None for signal in self._signals):
            spec = _CallableSpec(**{f.name: getattr(spec, f.name) for f in fields(spec) if f.init})
            self._cached_spec = spec
        return spec

    def _bind_signals(self) -> None:
        if self._substeps:
            self._inside = SubSteps(self.env, self._signals, self._panel)
            self._feed: Feed = self._inside.read
            self._feed_reset: Feed = self._inside.reset
            return
        names = [signal.name for signal in self._signals]
        reads = [signal.bind(self.env) for signal in self._signals]
        reset_reads = [signal.bind_reset(self.env) for signal in self._signals]
        self._feed = self._panel.feeder(names, reads)
        self._feed_reset = self._panel.feeder(names, reset_reads)

    def _conclude(self, info: dict[str, Any], terminated: bool, truncated: bool) -> None:  # noqa: FBT001 - as Gymnasium has them
        """Adds the keys that only the last info of an episode has, and records the episode."""
        panel = self._panel
        at = -1 if panel.violated_at is None else panel.violated_at
        found = panel.outcomes(), panel.violated_by, at
        info.update(present(last_info(*found, panel.all_decided, "is_success" in info)))
        self.stl_episodes.append(present(record(*found, panel.samples, terminated, truncated)))


def _fits(specs: Mapping[str, Specification], period: float, view: View) -> bool:
    """Whether all bounds are multiples of the period."""
    try:
        Panel(specs, period, view)
    except SpecificationError:
        return False
    return True


class _CallableSpec(EnvSpec):
    """An ``EnvSpec`` with a callable signal: for `gym.make`, not for JSON."""

    def to_json(self) -> str:
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
