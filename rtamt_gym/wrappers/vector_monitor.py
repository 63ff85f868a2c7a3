"""`VectorStlMonitor`: a vector environment monitored against specifications."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from functools import partial
from typing import Any, Unpack

import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorWrapper
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError, Specification, StateError
from rtamt_gym.judging.constants import ConstantValue
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.ends import assumed
from rtamt_gym.judging.episodes import EpisodeRecords, record
from rtamt_gym.judging.infos import last_info, step_info
from rtamt_gym.judging.specs import SpecsLike, autoreset_mode, checked_mask, recordable
from rtamt_gym.judging.values import MonitorValues
from rtamt_gym.judging.vector_infos import final_infos, final_observations, key_mask, put, put_last
from rtamt_gym.judging.vector_panel import VectorMonitors, VectorPanel
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.signals.columns import Batch, Floats, Lanes, SignalColumns
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.signals.step_time import StepTimes
from rtamt_gym.signals.taps import StaysOpen
from rtamt_gym.wrappers.monitoring import (
    ChangedConstants,
    Monitoring,
    OnSatisfaction,
    OwnOptions,
    Violations,
    check_can_end,
    refuse_monitored,
)
from rtamt_gym.wrappers.observing import Observe
from rtamt_gym.wrappers.vector_forms import as_vector_env

__all__ = ["VectorStlMonitor"]


class _LaneMonitoring(Monitoring):
    """What `VectorStlMonitor` says of episodes in its infos, and what it does at their ends."""

    num_envs: int
    _panel: VectorPanel
    _episodes: EpisodeRecords
    _done: Lanes | None
    _running: bool

    def _certain(self) -> list[tuple[Lanes, str]]:
        """The environments whose episodes a certain verdict ends, and how: the strongest first."""
        panel = self._panel
        found: list[tuple[Lanes, str]] = []
        for how in ("terminate", "truncate"):
            names = [name for name, word in self._on_violation.items() if word == how]
            if names:
                found.append((panel.violated(names), how))
        if self._on_satisfaction != "report":
            satisfied = panel.success(np.arange(self.num_envs))
            found.append((satisfied, self._on_satisfaction))
        return found

    def _report(
        self,
        infos: dict[str, Any],
        lanes: Lanes | None,
        costs: dict[str, Floats] | None = None,
        charged: Lanes | None = None,
    ) -> None:
        """Adds the keys that every info has, to the environments of the mask; None: to all.

        The costs are added to the environments ``charged``; None: to all.
        """
        panel = self._panel
        states = panel.describe() if self._details else None
        violated = panel.any_violated()
        bounds = panel.robustness, panel.lower, panel.upper
        added = step_info(
            {}, *bounds, violated, states, None, panel.of_instant, panel.least_progress
        )
        for key, value in added.items():
            put(infos, key, value, lanes, self.num_envs)
        for key, cost in (costs or {}).items():
            put(infos, key, cost, charged, self.num_envs)

    def _finish(self, terminated: Lanes, truncated: Lanes) -> None:
        """Reads the ends that the environments have made."""
        panel, names = self._panel, list(self._panel.monitors)
        at, undecided = terminated.nonzero()[0], None
        windows: frozenset[str] = frozenset()
        if self._unasked and len(at):
            undecided = panel.undecided(at)
            if np.count_nonzero(undecided):
                windows = panel.cut_windows(terminated)
            else:
                undecided = None
        panel.finish(terminated, self._at_termination)
        if np.count_nonzero(truncated):
            panel.finish(truncated & ~terminated, self._at_truncation)
        if undecided is not None:
            held = np.flatnonzero((undecided & panel.satisfied(at)).any(axis=1))
            self._assumed = assumed([names[place] for place in held], windows)

    def _conclude(
        self,
        infos: dict[str, Any],
        ended: Lanes,
        terminated: Any,  # noqa: ANN401
        truncated: Any,  # noqa: ANN401
    ) -> None:
        """Adds the keys that only the last infos of episodes have, and records the episodes."""
        panel, at = self._panel, ended.nonzero()[0]
        outcomes, success, undecided = panel.ends(at)
        violated = panel.any_violated(at)
        found = outcomes, violated, panel.violated_by(at), panel.violated_at.take(at)
        reported: Lanes | None = None
        has = np.zeros(len(at), np.bool_)
        if "is_success" in infos:
            reported = key_mask(infos, "is_success", self.num_envs)
            has = reported.take(at)
            self._seen_success |= bool(has.any())
        last = last_info(*found, success, undecided, has)
        put_last(infos, last, at, ended, reported, panel.spread)
        flags = np.asarray(terminated).take(at), np.asarray(truncated).take(at)
        self._episodes.append(at, record(*found, panel.samples.take(at), *flags))

    def _abandon(self, lanes: Lanes) -> bool:
        """Records what goes on in these environments as truncated; returns whether anything did."""
        found = False
        if self._running:
            cut = lanes & (self._panel.samples > 1)
            if self._done is not None:
                cut &= ~self._done
            at, panel = cut.nonzero()[0], self._panel
            found = len(at) > 0
            if found:
                panel.finish(cut, self._at_truncation)
                violated = panel.any_violated(at)
                ends = panel.outcomes(at), violated, panel.violated_by(at), panel.violated_at[at]
                self._episodes.append(at, record(*ends, panel.samples[at], ~cut[at], cut[at]))
        self._running = False
        return found


class VectorStlMonitor(_LaneMonitoring, StaysOpen, VectorWrapper, RecordConstructorArgs):
    """Monitors every environment of a vector environment against specifications.

    Samples and infos are as if :class:`StlMonitor` wrapped each environment. The infos
    have the form of vector environments: an array for every key, and a mask ``_key`` of the
    environments that have it. Numbers are float64. Works with the vector environments of
    :func:`gymnasium.make_vec`, native, synchronous and asynchronous, and with others that keep to
    their rules.

    The end of an episode is seen in all of Gymnasium's autoreset modes:

    * ``NEXT_STEP``: a step after the end of an episode is the reset, its observation is sample 0
    * ``SAME_STEP``: the terminal observation is read from ``final_obs``; what the last info of an
      episode has is in ``final_info``
    * ``DISABLED``: until ``reset(options={"reset_mask": mask})``, which begins new episodes in the
      environments of the mask and touches no other

    A wrapper around all environments cannot reset one of them. So a violation is only reported,
    unless the mode is ``DISABLED``, where the caller resets. To end episodes in the other modes,
    wrap each environment with :class:`StlMonitor`.

    Signals are read for all environments at once: ``"obs[2]"`` is column 2 of the observations. A
    function is called for each environment, with the :class:`rtamt_gym.Step` that
    :class:`StlMonitor` around it would give; :func:`rtamt_gym.batched` marks one that gets the
    whole batch and returns an array with one number for each environment. Selectors that read
    simulations, such as ``"qpos[1]"``, need a ``SyncVectorEnv``, whose environments are read one by
    one. For samples inside a step, ``substeps=True``, wrap each environment with
    :class:`StlMonitor` too.

    With ``SAME_STEP``, what ``observe="state"`` appends is appended to ``final_obs`` too.

    Attributes:
        stl_episodes: Records of the last ``buffer_length`` episodes that ended, as
            :class:`StlMonitor` makes them, with ``"env"``, the number of the environment.
        begun: The environments that the last step has reset instead of stepping; None if none.
        terminal: With ``SAME_STEP``, the values of the monitors before the resets in the last step;
            None if there were none.

    The scalar version of the wrapper is :class:`StlMonitor`.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import VectorStlMonitor
        >>> envs = gym.make_vec("CartPole-v1", num_envs=3, vectorization_mode="vector_entry_point")
        >>> envs = VectorStlMonitor(envs, "always(abs(theta) < 0.1)", {"theta": "obs[2]"})
        >>> _, infos = envs.reset(seed=123)
        >>> infos["robustness"].round(3)
        array([0.058, 0.078, 0.068])
        >>> terminated = np.zeros(3, bool)
        >>> while not terminated.any():
        ...     _, _, terminated, _, infos = envs.step(np.array([1, 1, 0]))
        >>> terminated, infos["stl_episode"]["spec"]["verdict"]
        (array([False,  True,  True]), array([None, 'VIOLATED', 'VIOLATED'], dtype=object))
        >>> infos["stl_violated_at"], infos["_stl_violated_at"]
        (array([0, 6, 6]), array([False,  True,  True]))

    ChangedConstants logs:
     * v0.5.0 - Initially added
    """

    _UNPICKLED = frozenset({"_columns"})
    _panel: VectorPanel
    _knows_flags = False

    @documents_options("episodes")
    def __init__(
        self,
        env: Batch,
        specs: SpecsLike,
        signals: Mapping[str, SignalLike] | None = None,
        *,
        on_violation: Violations = "report",
        on_satisfaction: OnSatisfaction = "report",
        details: bool = False,
        cost: Cost | None = None,
        buffer_length: int = 100,
        constants: Mapping[str, ConstantValue] | None = None,
        observe: Observe | None = None,
        clip: float = 1.0,
        **reading: Unpack[EvaluationKeywords],
    ) -> None:
        """Parses the specifications, binds the signals, and refuses what cannot be monitored.

        It takes the arguments of :class:`StlMonitor`, except that ``env`` is a vector environment,
        that a function that :func:`rtamt_gym.batched` marks reads all environments at once, that
        for the period of an ``AsyncVectorEnv`` one more environment is made and closed if a
        specification has bounds, and that ``on_violation`` is ``"report"`` by default; it and
        ``on_satisfaction`` may be ``"terminate"`` or ``"truncate"`` only with
        ``AutoresetMode.DISABLED``.

        Raises:
            SpecificationError: As :class:`StlMonitor` does
            InputError: As :class:`StlMonitor` does; and if the environment cannot do what
                ``on_violation`` or ``on_satisfaction`` asks
        """
        read = checked_options(reading, type(self), "episodes")
        options = OwnOptions(
            on_violation=on_violation,
            on_satisfaction=on_satisfaction,
            details=details,
            cost=cost,
            buffer_length=buffer_length,
            constants=constants,
        )
        given: dict[str, Any] = {"specs": recordable(specs), "signals": signals, **options}
        given |= read.whole("episodes").options()
        RecordConstructorArgs.__init__(self, **given, observe=observe, clip=clip)
        env = as_vector_env(env)
        VectorWrapper.__init__(self, env)
        judged = self._set_up(env, specs, signals, read, options, read_period)
        self._autoreset = autoreset_mode(env)
        check_can_end(options, self._autoreset, env)
        self._panel = panel = self._make_panel(judged.specs)
        self._set_up_observations(env, observe, clip, panel.monitors, panel.track_obligations)
        period = panel.period
        make = None if period is None else partial(self._step_time, period=float(period))
        self._times = StepTimes(env, make)
        self._bind_signals()
        self._episodes = EpisodeRecords(buffer_length)
        self._done: Lanes | None = None  # the environments that ended and are still to be reset
        self._table = np.full((env.num_envs, len(self._signals)), np.nan)
        self._running = False
        self.begun: Lanes | None = None
        self.terminal: MonitorValues[Floats] | None = None

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Resets the environments and their monitors; with ``reset_mask`` only where it is true.

        ``options={"constants": {...}}`` changes constants as for :meth:`StlMonitor.reset`, of all
        environments: a reset of some with it is refused. What is set as :attr:`constants` waits for
        a reset of all, and so never happens in a loop that lets the environments reset themselves.

        Raises:
            InputError: If a signal is nan or cannot be read; as :attr:`constants` does; and if some
                environments are to be reset with other constants.
            SpecificationError: As :attr:`constants` does.
            StateError: If the environment has changed its period since construction, if it has
                reset others than the mask says, or if the mask is given before any reset.
        """
        mask: Lanes | None = None
        if options is not None and "reset_mask" in options:
            mask = checked_mask(options["reset_mask"], self.num_envs)
            if not self._running:
                raise StateError(
                    "expected a reset of all environments before a reset of some, got "
                    "options={'reset_mask': ...}; call reset()"
                )
            # Gymnasium's environments take it out, and a wrapper around this one looks for it.
            options = dict(options)
        change: ChangedConstants | None = None
        if mask is None or mask.all():
            options, change = self._taken(options)
        elif options is not None and "constants" in options:
            raise InputError(
                "expected a reset of all environments with other constants, which hold for all, "
                "got one of some: reset all, or wrap each environment with StlMonitor, "
                "whose constants change as its episodes end"
            )
        lanes = np.ones(self.num_envs, np.bool_) if mask is None else mask
        self._warn_of_unseen_end(unended=self._abandon(lanes))
        obs, infos = self.env.reset(seed=seed, options=options)
        self._adopt(change)
        if mask is None and "stl_violated" in infos:  # of environments that cannot be looked into
            refuse_monitored("StlMonitor", " around each of its environments")
        self._times.begin(lanes)
        shown, said = (obs, infos) if self._beneath is None else self._beneath.shown
        table = self._columns.reset(shown, said, lanes)
        if mask is not None:
            self._columns.check_untouched(table, self._table, ~mask)
        infos = dict(infos)
        self._begin(table, mask)
        self._report(infos, mask)
        self._report_period(infos, lanes)
        if self._done is not None:
            self._done = _some(self._done & ~lanes)
        self._running, self._lost = True, None
        if self._state is not None:
            values = self.values()
            obs = self._observed(obs, values)
            self._look_at_reset(values, mask)
        return obs, infos

    def close(self, **kwargs: Any) -> None:  # noqa: ANN401 - as the environment takes
        """Closes the environments; episodes that have not ended are recorded as truncated."""
        self._abandon(np.ones(self.num_envs, np.bool_))
        super().close(**kwargs)

    def step(
        self,
        actions: Any,  # noqa: ANN401
    ) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Steps through the environments and feeds one sample of each.

        Raises:
            StateError: Before :meth:`reset`, after an error, and if an environment whose episode
                has ended was to be reset by the caller.
            InputError: If a signal is nan or cannot be read.
            InputTypeError: At the first step, if the environments tell their ends in no flags.
        """
        begun = self.begun = self._begun()
        obs, rewards, terminated, truncated, infos = self.env.step(actions)
        # A monitor that misses a sample, because a signal cannot be read, would count wrong.
        self._running = False
        self._require_flags(terminated, truncated)
        ended = _some(np.logical_or(terminated, truncated))
        resets = ended if self._autoreset is AutoresetMode.SAME_STEP else None
        self._times.step(begun if resets is None else resets)
        self._table, read = self._read(obs, actions, rewards, infos, begun, resets)
        if begun is not None:
            self._panel.reset(begun)
        self._panel.feed(self._table)
        certain = self._certain()
        if ended is not None:
            self._finish(np.asarray(terminated), np.asarray(truncated))
        if certain:
            for lanes, how in certain:
                terminated, truncated = _flagged(lanes, how, terminated, truncated)
            ended = _some(np.logical_or(terminated, truncated))
        infos = dict(infos)
        stepped = None if begun is None else ~begun
        costs = self._panel.take_costs(stepped)
        self.terminal = None
        if resets is not None:
            final = dict(infos.get("final_info", {}))
            self._report(final, resets, costs, resets)
            self._conclude(final, resets, terminated, truncated)
            infos["final_info"], infos["_final_info"] = final, resets.copy()
            self.terminal = self.values()
            self._begin(self._columns.reset(*read, resets), resets)
            self._report(infos, None, costs, ~resets)
            self._report_period(infos, resets)
        else:
            self._report(infos, None, costs, stepped)
            self._report_period(infos, begun)
            if ended is not None:
                self._conclude(infos, ended, terminated, truncated)
            self._done = ended
        if self._state is not None:
            self._observed_last(infos, self.terminal, resets)
            values = self.values()
            obs = self._observed(obs, values)
            self._look(self.terminal or values, np.logical_or(terminated, truncated))
            if resets is not None:
                self._look_at_reset(values, resets)
        self._running = True
        if ended is not None:
            self._tell()
        return obs, rewards, terminated, truncated, infos

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples fed since each environment's reset, counting the sample of the reset."""
        return self._panel.samples

    @property
    def monitors(self) -> VectorMonitors:
        """The monitors of each specification: ``(robustness source, judge)``."""
        return dict(self._panel.monitors)

    @property
    def stl_episodes(self) -> deque[dict[str, Any]]:
        """The records of the last episodes that ended; a fresh deque."""
        return self._episodes.newest()

    def _require_flags(self, terminated: Any, truncated: Any) -> None:  # noqa: ANN401
        """Refuses environments whose first step tells ends in anything but flags."""
        if self._knows_flags:
            return
        for name, given in (("terminated", terminated), ("truncated", truncated)):
            kind = np.asarray(given).dtype
            if kind != np.bool_:
                raise InputTypeError(
                    f"expected {name} of {self.env} as flags, of dtype bool, got dtype {kind}; put "
                    "a wrapper around it whose step converts them, .astype(bool)"
                )
        self._knows_flags = True

    def _make_panel(self, specs: Mapping[str, Specification]) -> VectorPanel:
        names = [signal.name for signal in self._signals]
        return VectorPanel(specs, self.num_envs, self._of_monitors, names, self._cost)

    def _bind_signals(self) -> None:
        same_step = self._autoreset is AutoresetMode.SAME_STEP
        env = self.env if self._beneath is None else self._beneath.env
        self._columns = SignalColumns(self._signals, env, same_step=same_step)

    def _report_period(self, infos: dict[str, Any], lanes: Lanes | None) -> None:
        """Tells the environments of the mask, whose episodes begin, the period; None: none."""
        period = self._panel.period
        if period is not None and lanes is not None:
            put(infos, "stl_period", np.full(self.num_envs, float(period)), lanes, self.num_envs)

    def _begun(self) -> Lanes | None:
        """The environments that the next step resets; None if none."""
        if not self._running and not self._resumes():
            raise StateError("expected running episodes, got step() before reset(); call reset()")
        if self._done is not None and self._autoreset is AutoresetMode.DISABLED:
            raise StateError(
                "expected running episodes, got step() after the end of the episode of environment "
                f"{np.flatnonzero(self._done)[0]}; call reset(options={{'reset_mask': mask}}), "
                "the mask true for all that have ended"
            )
        return self._done

    def _read(
        self,
        obs: Any,  # noqa: ANN401
        actions: Any,  # noqa: ANN401
        rewards: Any,  # noqa: ANN401
        infos: dict[str, Any],
        begun: Lanes | None,
        resets: Lanes | None,
    ) -> tuple[Floats, tuple[Any, Any]]:
        """The table of a step, from before the resets in it, and what they have shown."""
        env, tap = self.env, self._beneath
        if tap is not None:
            env, actions = tap, tap.actions
            obs, rewards, _, _, infos = tap.result
        shown, said = obs, infos
        if resets is not None and self._columns.reads_obs:
            shown = final_observations(env.single_observation_space, obs, infos, resets)
        if resets is not None and self._columns.reads_info:
            said = final_infos(infos, resets)
        return self._columns.step(shown, actions, rewards, said, begun), (obs, infos)

    def _begin(self, table: Floats, lanes: Lanes | None) -> None:
        """Begins episodes in the environments of the mask; None: in all."""
        which = slice(None) if lanes is None else lanes
        self._panel.reset(lanes)
        self._panel.feed(table, lanes)
        self._table[which] = table[which]


def _some(lanes: Lanes) -> Lanes | None:
    """The mask itself; None if it is true nowhere."""
    return lanes if np.count_nonzero(lanes) else None


def _flagged(lanes: Lanes, how: str, terminated: Any, truncated: Any) -> tuple[Any, Any]:  # noqa: ANN401
    """Sets a flag for the environments of the mask that are not terminated; returns both flags."""
    ended = lanes & ~np.asarray(terminated)
    if how == "terminate":
        return np.logical_or(terminated, ended), truncated
    return terminated, np.logical_or(truncated, ended)
