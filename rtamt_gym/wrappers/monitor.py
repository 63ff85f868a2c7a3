"""`StlMonitor`: an environment monitored against specifications of signal temporal logic."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, SupportsFloat, Unpack

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs

from rtamt import Specification, SpecificationError
from rtamt_gym.judging.constants import ConstantValue
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.feeding import Feed
from rtamt_gym.judging.infos import step_info
from rtamt_gym.judging.panel import Panel
from rtamt_gym.judging.specs import SpecsLike, recordable
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.books import Books
from rtamt_gym.wrappers.callable_spec import CallableSpec
from rtamt_gym.wrappers.episode_monitoring import EpisodeMonitoring
from rtamt_gym.wrappers.monitoring import (
    ChangedConstants,
    OnSatisfaction,
    OwnOptions,
    Violations,
    single_env,
)
from rtamt_gym.wrappers.observing import Observe
from rtamt_gym.wrappers.substeps import SubSteps, fits, read_substep_period

__all__ = ["StlMonitor"]


class StlMonitor(
    EpisodeMonitoring, gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs
):
    """Monitors an environment against specifications and ends an episode that violates one.

    Sample 0 of an episode is the observation that :meth:`reset` returns; every later sample is the
    observation after a step with the action and the reward of that step, the terminal observation
    included. Observations, actions and rewards pass through unchanged, but for ``observe=``.

    The info of :meth:`reset` has ``stl_period`` (float), the seconds between two samples, where
    there is a period. After each reset and in the first steps of each episode, the period is
    compared with what the environment states and with the time of the simulation, if there is one.
    A copy in mid-episode whose environment is built again (`gymnasium.utils.EzPickle`) refuses
    :meth:`step` until :meth:`reset`.

    Every ``info``, also from :meth:`reset`, gets

    * ``robustness`` (float): the least robustness over the specifications, if the episode ended now
    * ``stl_lower``, ``stl_upper`` (float): bounds of what it can still become
    * ``stl_violated`` (bool): no continuation can satisfy all specifications
    * ``stl`` (dict): with ``details=True``, ``{spec: {"robustness", "lower", "upper", "verdict"}}``
    * ``stl_progress`` (float): where a specification is in stages (:func:`rtamt.patterns.stages`),
      how far the episode has come in them, from 0 to 1, and 1 only if it is satisfied; of several
      the least, ``"progress"`` of each is in ``stl`` and ``stl_episode``; not with ``view="step"``
    * ``cost`` (float): with ``cost=``, in the info of every step; with several specifications also
      ``cost_NAME`` of each, of which ``cost`` is the greatest (of ``"first"`` the first)

    and the last info of an episode also

    * ``stl_episode`` (dict): ``{spec: {"robustness", "verdict", "satisfied", "decided_at"}}``;
      ``verdict`` is ``"VIOLATED"``, ``"UNDECIDED"`` or ``"SATISFIED"``, ``decided_at`` the sample
      that decided it, absent from an open verdict; if only the end decided it, ``ended_at``, the
      last sample, stands in its place; ``by_end`` is True, and else absent, where
      ``at_termination="failure"`` violates it beside a robustness that holds
    * ``stl_success`` (bool): all specifications are satisfied
    * ``stl_undecided`` (bool): the verdict on one is open
    * ``is_success`` (bool): ``stl_success``, unless the environment reports its own, which is kept
    * ``stl_violated_by`` (str), ``stl_violated_at`` (int): the specification that was violated
      first and the sample that showed it, the last one if only the end did; absent if none was

    Floats are ``numpy.float64``.

    A specification that is certainly violated ends the episode, unless ``on_violation`` says
    otherwise; ``on_satisfaction`` can end it once all are certainly satisfied. What the sample of
    the reset decides ends the episode at its first step.

    What an open verdict becomes at the end of an episode is said by ``at_termination``, where the
    environment ends it, and by ``at_truncation``, where a time limit does; if both do, by the
    first. The end that this wrapper makes of an episode decides nothing more: verdicts on other
    specifications stay open. Place time limits inside this wrapper; the truncation of a wrapper
    around it is seen at the next :meth:`reset` or :meth:`close`, which records the episode in
    ``stl_episodes`` and warns once; its last info has none of these keys.
    A copy or a pickle of a MuJoCo environment is a new simulation, as Gymnasium makes it, with the
    monitors of the old one: reset it.

    A ``Monitor`` of Stable-Baselines3 or a ``RecordEpisodeStatistics`` of Gymnasium inside of this
    wrapper counts the episodes that the wrapper ends too.

    :func:`rtamt_gym.simulate` runs whole episodes and records the signals too, sample by sample;
    it can also stop at a certain satisfaction.

    With ``substeps=True`` the wrapper takes a sample after every step of the simulation, of which
    an environment makes several in one step of its own: a violation between two observations is
    seen. Signals are read from the simulation (``qpos[1]``, ``body:torso.xpos[2]``,
    ``vehicle.speed``, or a callable, which reads ``env`` and gets neither observation nor reward
    nor info) and from the action, which holds during the step. The period is a step of the
    simulation, sample numbers count its steps, and an episode still ends after a whole step of the
    environment. For the MuJoCo environments of Gymnasium and for highway-env.

    With ``view="step"`` a formula is a requirement on every instant, as in an online monitor:
    ``robustness`` is the robustness at the newest instant whose horizon has passed (before the
    first, of the samples so far); bounds and verdict judge ``always(formula)``. Robustness and
    verdict may differ in sign then, and ``info["stl_of_instant"]`` is True, in each
    ``info["stl"][name]`` ``"of_instant"``; ``stl_episode`` has the robustness of
    ``always(formula)``.

    ``observe="state"`` appends the state of the monitors to the observation, for a learner or a
    policy that is to act on it; the reward stays as it is, and signals read the observation of the
    environment. There are five numbers for every specification, in their order: robustness, lower
    and upper bound, clipped to [-clip, clip], the fraction of its horizon that is left (1 without a
    horizon), and the verdict (1 certainly satisfied, -1 certainly violated, 0 undecided).
    ``observe="obligations"`` appends after the five of each specification, for every temporal
    operator below the top, a clock from 0 to 1 and the margin of each operand, its newest known
    robustness: the clock says how old the oldest unanswered request is, how long a
    goal has been held, how much of a duty is left, or how long ago an event was, as a fraction of
    the window. :attr:`observed` lists the numbers, :class:`rtamt.OperatorClocks` defines them. A
    ``Box`` of one dimension grows by them; a ``Dict`` gets the key ``"stl"``.

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
        >>> round(float(info["robustness"]), 3), info["stl_violated"]
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

    _UNPICKLED = frozenset({"_feed", "_feed_reset", "_inside", "_comparing"})

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
        **reading: Unpack[EvaluationKeywords],
    ) -> None:
        """Parses the specifications, binds the signals, and refuses what cannot be monitored.

        Args:
            env: The environment to apply the wrapper
            specs: A specification (text, path of a ``.stl`` file, or ``rtamt.Specification``), or
                several with their names; of a text, every formula that no other formula uses
            signals: For every variable of the specifications a selector such as ``"obs[2]"``,
                ``"obs['goal'][0]"``, ``"action[0]"``, ``"reward"``, ``"info['speed']"`` or
                ``"qpos[1]"``, or a callable of a :class:`rtamt_gym.Step`, or a pair of one of them
                and its value at reset, which action and reward need, and info where that of the
                reset lacks it: a number, or ``None`` for a first sample of which nothing is known;
                a variable that is not among them reads what the environment says in its own
                ``signals``, as scenarios do
            on_violation: What a certain violation does: ``"terminate"`` or ``"truncate"`` the
                episode, or only ``"report"`` it; or a mapping with a word for every specification,
                such as ``{"upright": "terminate", "slow": "report"}``. If several are violated,
                terminate wins over truncate, and truncate over report
            on_satisfaction: What it does once every specification is certainly satisfied: only
                ``"report"`` it, or ``"terminate"`` or ``"truncate"`` the episode
            details: Whether to add ``info["stl"]``, the state of every specification
            cost: What ``info["cost"]`` is, if it is to be added: ``"violation"`` is 1 at a step
                that shows that an instant violates p, where the formula is ``always(p)``, so that
                the sum counts unsafe instants; ``"depth"`` is how deep; ``"latched"`` is 1 from
                the first violation on; ``"first"`` is 1 only at the step that shows it; the last
                two charge what only the end decides too. With ``substeps=True`` the cost of a step
                is the maximum over its samples
            buffer_length: How many records :attr:`stl_episodes` keeps
            constants: Values of constants that the specifications name, as for `rtamt.parse`, each
                for all that name it; :attr:`constants` and :meth:`reset` change them later
            history: Whether to keep the samples of the episode for :meth:`explain`, 8 bytes for
                each variable of each specification
            observe: ``"state"`` appends the state of the monitors to the observation;
                ``"obligations"`` what temporal operators owe too
            clip: Bound of the numbers that ``observe`` appends; the interesting margins of every
                specification should lie inside. If the robustness of one was outside at more than
                half of the samples of the first 10 episodes, a ``UserWarning`` at the end of the
                tenth says so, with its range
            **reading: How samples are judged, the options of :class:`rtamt_gym.Reading`:
                ``period``, ``view``, ``nan``, ``align``, ``semantics``, ``inputs``, ``outputs``,
                ``at_termination``, ``at_truncation`` and ``substeps``

        Raises:
            SpecificationError: If a specification is wrong, speaks of the first sample only, has
                a bound that is not a multiple of the period, or needs a period and has none; if
                ``cost`` asks when an instant violates a formula whose future has no end
            InputError: If the environment has a monitor; if a variable has no signal, a signal no
                variable, or a selector does not fit the environment; if ``substeps`` does not; if
                the semantics is unknown, or a name in ``inputs`` or ``outputs`` is no variable
        """
        read = checked_options(reading, type(self), "runs")
        options = OwnOptions(
            on_violation=on_violation,
            on_satisfaction=on_satisfaction,
            details=details,
            cost=cost,
            buffer_length=buffer_length,
            constants=constants,
        )
        given: dict[str, Any] = {
            "specs": recordable(specs),
            "signals": signals,
            "history": history,
            **options,
            **read.whole("runs").options(),
        }
        RecordConstructorArgs.__init__(self, **given, observe=observe, clip=clip)
        gym.Wrapper.__init__(self, single_env(env))
        find_period = read_substep_period if read.substeps else read_period
        judged = self._set_up(env, specs, signals, read, options, find_period)
        self.stl_episodes = deque(maxlen=buffer_length)
        self._history = history
        try:
            self._panel = self._make_panel(judged.specs)
        except SpecificationError as error:
            inner = None if read.substeps else read_substep_period(env)
            if inner is not None and read.period is None and fits(judged, inner, cost):
                error.add_note(f"substeps=True takes samples {inner:g} s apart, which fits")
            raise
        panel = self._panel
        self._tells_more = details or panel.tells_more
        self._set_up_observations(env, observe, clip, panel.monitors, panel.track_obligations)
        self._substeps = read.substeps
        if panel.period is not None:
            self._watch = self._step_time(env, float(panel.period))
        self._bind_signals()
        self._books = Books(env)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsType, dict[str, Any]]:
        """Resets the environment and the monitors; the observation is sample 0.

        ``options={"constants": {"limit": 0.3}}`` changes constants of the specifications for this
        episode and all further ones; the environment does not see them.

        Raises:
            InputError: If a signal is nan or cannot be read; as :attr:`constants` does.
            SpecificationError: As :attr:`constants` does.
            StateError: If the environment has changed its period since construction.
        """
        options, change = self._taken(options)
        self._warn_of_unseen_end(unended=self._abandon())
        obs, info = self.env.reset(seed=seed, options=options)
        self._adopt(change)
        self._begin_times()
        panel = self._panel
        panel.reset()
        assessed = self._feed_reset(obs, None, None, info)
        panel.begin()
        found = *assessed, panel.violated_by is not None
        states = panel.describe() if self._details else None
        told = panel.of_instant, panel.least_progress, self._told_period
        info = step_info(info, *found, states, None, *told)
        self._running, self._lost = True, None
        if self._state is not None:
            values = self.values()
            obs = self._observed(obs, values)
            self._look_at_reset(values)
        return obs, info

    def close(self) -> None:
        """Closes the environment; an episode that has not ended is recorded as truncated."""
        self._abandon()
        super().close()

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, dict[str, Any]]:
        """Steps through the environment, feeds one sample, and ends a violated episode.

        Raises:
            StateError: Before :meth:`reset`, after the end of an episode, and in a copy that has
                lost the episode.
            InputError: If a signal is nan or cannot be read; the episode is over then, and with
                ``substeps=True`` after any error of the environment.
            StateError: If the step has lasted longer or shorter than the period that was read, by
                the time of the simulation, and a specification has bounds.
        """
        if not self._running:
            self._resume()
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
        how = self._how_to_end() if panel.settled else "report"
        ended = terminated or truncated
        if ended:
            robustness, lower, upper = self._finish(terminated)
        if how != "report" and not terminated:
            terminated = how == "terminate"
            truncated = truncated or how == "truncate"
        violated = panel.violated_by is not None
        if self._tells_more:
            info = step_info(
                info,
                robustness,
                lower,
                upper,
                violated,
                panel.describe() if self._details else None,
                panel.take_costs(),
                panel.of_instant,
                panel.least_progress,
            )
        else:
            info = step_info(info, robustness, lower, upper, violated)
        if terminated or truncated:
            self._running = False
            self._conclude(info, terminated, truncated)
            if not ended:
                self._books.close(terminated, truncated, info)
            self._tell()
        if self._state is not None:
            values = self.values()
            obs = self._observed(obs, values)
            self._look(values, terminated or truncated)
        return obs, reward, terminated, truncated, info

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # as Gymnasium's wrappers do
        """The ``EnvSpec`` with this wrapper; with a callable signal it has no JSON."""
        spec = super().spec
        if spec is not None and any(signal.source is None for signal in self._signals):
            self._cached_spec = spec = CallableSpec.of(spec)
        return spec

    @property
    def substeps(self) -> bool:
        """Whether it takes samples inside of the environment's steps."""
        return self._substeps

    def _tap(self, env: Any) -> None:  # noqa: ANN401
        super()._tap(env)
        if self._substeps:
            self._inside.inside.env = env

    def _make_panel(self, specs: Mapping[str, Specification]) -> Panel:
        return Panel(specs, self._of_monitors, self._cost, history=self._history, number=np.float64)

    def _adopt(self, change: ChangedConstants | None) -> None:
        super()._adopt(change)
        self._tells_more = self._details or self._panel.tells_more

    def _bind_signals(self) -> None:
        if not self._substeps:
            super()._bind_signals()
            return
        self._inside = SubSteps(self.env, self._readings(), self._panel)
        self._feed: Feed = self._compared(self._panel.read, substeps=True)
        self._feed_reset: Feed = self._inside.reset

    def _conclude(self, info: dict[str, Any], terminated: bool, truncated: bool) -> None:  # noqa: FBT001 - as Gymnasium has them
        """Adds the keys that only the last info of an episode has, and records the episode."""
        found = self._found()
        self._add_last(info, found)
        self._record(found, terminated=terminated, truncated=truncated)
