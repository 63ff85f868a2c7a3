"""`VectorStlMonitor`: a vector environment monitored against specifications."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorWrapper
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError, Specification, StateError
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.end_warnings import assumed
from rtamt_gym.judging.infos import (
    EpisodeRecords,
    key_mask,
    last_info,
    put,
    put_last,
    record,
    step_info,
)
from rtamt_gym.judging.monitors import MonitorValues
from rtamt_gym.judging.specs import ConstantValue, SpecsLike, recordable
from rtamt_gym.judging.vector_monitor_set import VectorMonitors, VectorMonitorSet
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.signals.columns import Batch, Entries, Floats, SignalColumns
from rtamt_gym.signals.periods import StepTimes
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.signals.taps import StaysOpen
from rtamt_gym.wrappers.monitoring import (
    ChangedConstants,
    Monitoring,
    MonitorOptions,
    OnSatisfaction,
    Violations,
    check_pictures,
    refuse_monitored,
)
from rtamt_gym.wrappers.observing import Observe
from rtamt_gym.wrappers.vector_forms import (
    as_vector_env,
    autoreset_mode,
    checked_mask,
    final_infos,
    final_observations,
)

if TYPE_CHECKING:
    from rtamt_gym.live.track import Track
    from rtamt_gym.live.view import RerunView


class VectorStlMonitor(Monitoring, StaysOpen, VectorWrapper, RecordConstructorArgs):
    """Monitors every environment of a vector environment against specifications.

    Samples and infos are as if :class:`StlMonitor` wrapped each environment, in the form of vector
    environments: an array for every key, and a mask ``_key`` of the environments that have it.
    Numbers are float64. Native, synchronous and asynchronous vector environments of
    :func:`gymnasium.make_vec` work, and others that follow the same rules.

    Ends of episodes are observed in all of Gymnasium's autoreset modes:

    * ``NEXT_STEP``: the step after the end of an episode is the reset, its observation is sample 0
    * ``SAME_STEP``: the terminal observation is read from ``final_obs``; the keys of the last info
      of an episode are in ``final_info``
    * ``DISABLED``: ``reset(options={"reset_mask": mask})`` starts new episodes in the environments
      of the mask and changes no other

    A wrapper around all environments cannot reset a single environment. Therefore a violation is
    only reported, unless the mode is ``DISABLED``, where the caller resets. To end episodes in the
    other modes, wrap each environment with :class:`StlMonitor`, the scalar version of this wrapper.

    Attributes:
        begun: The mask of environments that the last step has reset (``NEXT_STEP``); None without
            resets.
        terminal: The values of the monitors before the resets in the last step (``SAME_STEP``);
            None without resets.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import VectorStlMonitor
        >>> envs = gym.make_vec("CartPole-v1", num_envs=3, vectorization_mode="vector_entry_point")
        >>> envs = VectorStlMonitor(envs, "always(abs(theta) < 0.1)", {"theta": "obs[2]"})
        >>> _, infos = envs.reset(seed=123)
        >>> terminated = np.zeros(3, bool)
        >>> while not terminated.any():
        ...     _, _, terminated, _, infos = envs.step(np.array([1, 1, 0]))
        >>> infos["stl_violated_at"], infos["_stl_violated_at"]
        (array([0, 6, 6]), array([False,  True,  True]))

    Change logs:
     * v0.5.0 - Initially added
    """

    _UNPICKLED = frozenset({"_columns", "_live"})
    _monitor_set: VectorMonitorSet
    _has_flags = False
    _live: VectorTracks | None = None

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
        live: RerunView | None = None,
        **reading: Unpack[EvaluationKeywords],
    ) -> None:
        """Parse the specifications and bind the signals.

        It takes the arguments of :class:`StlMonitor`, with these differences: ``env`` is a vector
        environment; a function that :func:`rtamt_gym.wrappers.batched` marks reads all environments
        at once; for the period of an ``AsyncVectorEnv``, one more environment is made and closed if
        a specification has bounds; a view shows the environments that it names; and
        ``on_violation`` is ``"report"`` by default. It and ``on_satisfaction`` may be
        ``"terminate"`` or ``"truncate"`` only with ``AutoresetMode.DISABLED``.

        Raises:
            SpecificationError: As :class:`StlMonitor` does
            InputError: As :class:`StlMonitor` does; and if ``on_violation`` or ``on_satisfaction``
                would end episodes that the environment cannot reset
        """
        read = checked_options(reading, type(self), "episodes")
        options = MonitorOptions(
            on_violation=on_violation,
            on_satisfaction=on_satisfaction,
            details=details,
            cost=cost,
            buffer_length=buffer_length,
            constants=constants,
        )
        recorded: dict[str, Any] = {**options, **read.complete("episodes").options()}
        recorded |= {"specs": recordable(specs), "signals": signals}
        RecordConstructorArgs.__init__(self, **recorded, observe=observe, clip=clip)
        env = as_vector_env(env)
        VectorWrapper.__init__(self, env)
        loaded = self._set_up(env, specs, signals, read, options)
        self._autoreset = autoreset_mode(env)
        self._check_can_end(options)
        self._monitor_set = monitor_set = self._make_monitor_set(loaded)
        self._set_up_observations(env, observe, clip, monitor_set)
        period = monitor_set.period
        make = None if period is None else partial(self._step_time, period=float(period))
        self._times = StepTimes(env, make)
        self._bind_signals()
        self._episodes = EpisodeRecords(buffer_length)
        self._done: Entries | None = None  # the environments that ended and are still to be reset
        self._table = np.full((env.num_envs, len(self._signals)), np.nan)
        self.begun: Entries | None = None
        self.terminal: MonitorValues[Floats] | None = None
        if live is not None:
            if live.pictures is not None:
                check_pictures(env, "RerunView(pictures=)", lists=False)
            names = [signal.name for signal in self._signals]
            seconds = None if period is None else float(period)
            self._live = VectorTracks(
                live, names, [*monitor_set.monitors], seconds, env.num_envs, self.env.render
            )

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset the environments and their monitors; with ``reset_mask`` only where it is true.

        ``options={"constants": {...}}`` changes constants as for :meth:`StlMonitor.reset`, of all
        environments: it is an error in a reset of some. A change by :attr:`constants` waits for a
        reset of all, which never comes in a loop where the environments reset themselves.

        Raises:
            InputError: If a signal is nan or cannot be read; as :attr:`constants` does; and if some
                environments are to be reset with other constants.
            SpecificationError: As :attr:`constants` does.
            StateError: If the environment has changed its period since construction, if it has
                reset environments outside the mask, or if the first reset has a mask.
        """
        mask: Entries | None = None
        if options is not None and "reset_mask" in options:
            mask = checked_mask(options["reset_mask"], self.num_envs)
            if not self._running:
                raise StateError(
                    "expected a reset of all environments before a reset of some, got "
                    "options={'reset_mask': ...}; call reset()"
                )
            # A copy: Gymnasium's environments remove the mask, and wrappers around read it.
            options = dict(options)
        change: ChangedConstants | None = None
        if mask is None or mask.all():
            options, change = self._split_options(options)
        elif options is not None and "constants" in options:
            raise InputError(
                "expected a reset of all environments, because new constants apply to all, got a "
                "reset of some: reset all, or wrap each environment with StlMonitor, which changes "
                "constants when its episode ends"
            )
        entries = np.ones(self.num_envs, np.bool_) if mask is None else mask
        self._warn_of_unseen_end(unended=self._abandon(entries))
        obs, infos = self.env.reset(seed=seed, options=options)
        self._apply(change)
        if mask is None and "stl_violated" in infos:  # of environments in other processes
            refuse_monitored("StlMonitor", " around each of its environments")
        self._times.begin(entries)
        first_obs, first_infos = (obs, infos) if self._beneath is None else self._beneath.shown
        table = self._columns.reset(first_obs, first_infos, entries)
        if mask is not None:
            self._columns.check_untouched(table, self._table, ~mask)
        infos = dict(infos)
        self._begin(table, mask)
        self._report(infos, mask)
        self._report_period(infos, entries)
        if self._done is not None:
            self._done = _some(self._done & ~entries)
        self._running, self._lost = True, None
        if self._state is not None:
            values = self.values()
            obs = self._observed(obs, values)
            self._watch_reset(values, mask)
        return obs, infos

    def close(self, **kwargs: Any) -> None:
        """Close the environments; episodes that have not ended are recorded as truncated."""
        self._abandon(np.ones(self.num_envs, np.bool_))
        super().close(**kwargs)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environments and update the monitors with one sample of each.

        Raises:
            StateError: Before :meth:`reset`, after an error, and if an episode has ended and the
                caller has not reset its environment.
            InputError: If a signal is nan or cannot be read.
            InputTypeError: At the first step, if terminations or truncations are not flags.
        """
        begun = self.begun = self._resetting()
        obs, rewards, terminated, truncated, infos = self.env.step(actions)
        # After a missed sample, because a signal cannot be read, the monitors would count wrong.
        self._running = False
        self._require_flags(terminated, truncated)
        ended = _some(np.logical_or(terminated, truncated))
        resets = ended if self._autoreset is AutoresetMode.SAME_STEP else None
        self._times.step(begun if resets is None else resets)
        self._table, shown = self._read(obs, actions, rewards, infos, begun, resets)
        self._update(begun, resets)
        certain = self._certain()
        if ended is not None:
            self._finish(np.asarray(terminated), np.asarray(truncated))
        if certain:
            terminated, truncated = _with_ends(certain, terminated, truncated)
            ended = _some(np.logical_or(terminated, truncated))
        infos = dict(infos)
        stepped = None if begun is None else ~begun
        costs = self._monitor_set.take_costs(stepped)
        self.terminal = None
        if resets is not None:
            final = dict(infos.get("final_info", {}))
            self._report(final, resets, costs, resets)
            self._conclude(final, resets, terminated, truncated)
            infos["final_info"], infos["_final_info"] = final, resets.copy()
            self.terminal = self.values()
            self._begin(self._columns.reset(*shown, resets), resets)
            self._report(infos, None, costs, ~resets)
            self._report_period(infos, resets)
        else:
            self._report(infos, None, costs, stepped)
            self._report_period(infos, begun)
            if ended is not None:
                self._conclude(infos, ended, terminated, truncated)
            self._done = ended
        if self._state is not None:
            self._append_to_final(infos, self.terminal, resets)
            values = self.values()
            obs = self._observed(obs, values)
            self._watch_step(self.terminal or values, np.logical_or(terminated, truncated))
            if resets is not None:
                self._watch_reset(values, resets)
        self._running = True
        if ended is not None:
            self._warn_of_ends()
        return obs, rewards, terminated, truncated, infos

    @property
    def samples(self) -> NDArray[np.int64]:
        """The number of samples since each environment's reset, including the reset's."""
        return self._monitor_set.samples

    @property
    def monitors(self) -> VectorMonitors:
        """The monitors of each specification: ``(robustness source, judge)``."""
        return dict(self._monitor_set.monitors)

    @property
    def stl_episodes(self) -> deque[dict[str, Any]]:
        """The records of the last episodes that ended, in a new deque."""
        return self._episodes.newest()

    def _check_can_end(self, options: MonitorOptions) -> None:
        """Raise InputError if the wrapper would end episodes that the caller cannot reset."""
        if self._autoreset is AutoresetMode.DISABLED:
            return
        choices: dict[str, Any] = {
            "on_violation": options["on_violation"],
            "on_satisfaction": options["on_satisfaction"],
        }
        for name, choice in choices.items():
            words = choice.values() if isinstance(choice, Mapping) else [choice]
            if any(word != "report" for word in words):
                raise InputError(
                    f"{name}={choice!r} needs an environment that the caller resets, "
                    f"AutoresetMode.DISABLED, got {self._autoreset} of {self.env}; wrap each "
                    "environment, gym.make_vec(..., vectorization_mode='sync', wrappers=[...]) "
                    f"with StlMonitor, or take {name}='report'"
                )

    def _require_flags(self, terminated: Any, truncated: Any) -> None:
        """Check the type of the ends in the first step."""
        if self._has_flags:
            return
        for name, flags in (("terminated", terminated), ("truncated", truncated)):
            kind = np.asarray(flags).dtype
            if kind != np.bool_:
                raise InputTypeError(
                    f"expected {name} of {self.env} as flags of dtype bool, got dtype {kind}; "
                    "convert them in the step of a wrapper, .astype(bool)"
                )
        self._has_flags = True

    def _make_monitor_set(self, specs: Mapping[str, Specification]) -> VectorMonitorSet:
        names = [signal.name for signal in self._signals]
        return VectorMonitorSet(specs, self.num_envs, self._of_monitors, names, self._cost)

    def _bind_signals(self) -> None:
        same_step = self._autoreset is AutoresetMode.SAME_STEP
        env = self.env if self._beneath is None else self._beneath.env
        self._columns = SignalColumns(self._signals, env, same_step=same_step)

    def _resetting(self) -> Entries | None:
        """Return the mask of environments that the next step resets, or None."""
        if not self._running and not self._resumes():
            raise StateError("expected running episodes, got step() before reset(); call reset()")
        if self._done is not None and self._autoreset is AutoresetMode.DISABLED:
            raise StateError(
                "expected running episodes, got step() after the end of the episode of environment "
                f"{np.flatnonzero(self._done)[0]}; call reset(options={{'reset_mask': mask}}), "
                "with a mask that is true for ended episodes"
            )
        return self._done

    def _read(
        self,
        obs: Any,
        actions: Any,
        rewards: Any,
        infos: dict[str, Any],
        begun: Entries | None,
        resets: Entries | None,
    ) -> tuple[Floats, tuple[Any, Any]]:
        """Return the table from before the resets in a step, and observations and infos after."""
        env, tap = self.env, self._beneath
        if tap is not None:
            env, actions = tap, tap.actions
            obs, rewards, _, _, infos = tap.result
        last_obs, last_infos = obs, infos
        if resets is not None and self._columns.reads_obs:
            last_obs = final_observations(env.single_observation_space, obs, infos, resets)
        if resets is not None and self._columns.reads_info:
            last_infos = final_infos(infos, resets)
        return self._columns.step(last_obs, actions, rewards, last_infos, begun), (obs, infos)

    def _begin(self, table: Floats, entries: Entries | None) -> None:
        """Start episodes in the environments of the mask; None: in all."""
        which = slice(None) if entries is None else entries
        self._monitor_set.reset(entries)
        self._monitor_set.feed(table, entries)
        self._table[which] = table[which]
        if self._live is not None and (entries is None or self._live.shows(entries)):
            self._live.reset(self._table, self._monitor_set, entries)

    def _update(self, begun: Entries | None, resets: Entries | None) -> None:
        """Update the monitors with the samples of a step; the masks are those of `VectorTracks`."""
        if begun is not None:
            self._monitor_set.reset(begun)
        self._monitor_set.feed(self._table)
        if self._live is not None:
            self._live.step(self._table, self._monitor_set, begun, resets)

    def _certain(self) -> list[tuple[Entries, str]]:
        """Return the episodes that a certain verdict ends, and how, the strongest effect first."""
        monitor_set = self._monitor_set
        certain: list[tuple[Entries, str]] = []
        for how in ("terminate", "truncate"):
            names = [name for name, word in self._on_violation.items() if word == how]
            if names:
                certain.append((monitor_set.violated(names), how))
        if self._on_satisfaction != "report":
            satisfied = monitor_set.success(np.arange(self.num_envs))
            certain.append((satisfied, self._on_satisfaction))
        return certain

    def _report(
        self,
        infos: dict[str, Any],
        entries: Entries | None,
        costs: dict[str, Floats] | None = None,
        charged: Entries | None = None,
    ) -> None:
        """Add the keys of every info to ``entries``, and costs to ``charged``; None: to all."""
        monitor_set = self._monitor_set
        states = monitor_set.describe() if self._details else None
        violated = monitor_set.any_violated()
        bounds = monitor_set.robustness, monitor_set.lower, monitor_set.upper
        for key, value in step_info({}, *bounds, violated, monitor_set, states).items():
            put(infos, key, value, entries, self.num_envs)
        for key, cost in (costs or {}).items():
            put(infos, key, cost, charged, self.num_envs)

    def _report_period(self, infos: dict[str, Any], entries: Entries | None) -> None:
        """Add the period to the infos of starting episodes, a mask or None."""
        period = self._monitor_set.period
        if period is not None and entries is not None:
            put(infos, "stl_period", np.full(self.num_envs, float(period)), entries, self.num_envs)

    def _finish(self, terminated: Entries, truncated: Entries) -> None:
        """Evaluate the environments' own ends."""
        monitor_set, names = self._monitor_set, list(self._monitor_set.monitors)
        index, undecided = terminated.nonzero()[0], None
        windows: frozenset[str] = frozenset()
        if self._warns_of_open_end and len(index):
            undecided = monitor_set.undecided(index)
            if np.count_nonzero(undecided):
                windows = monitor_set.cut_windows(terminated)
            else:
                undecided = None
        monitor_set.finish(terminated, self._at_termination)
        if np.count_nonzero(truncated):
            monitor_set.finish(truncated & ~terminated, self._at_truncation)
        if undecided is not None:
            held = np.flatnonzero((undecided & monitor_set.satisfied(index)).any(axis=1))
            self._assumed = assumed([names[position] for position in held], windows)

    def _conclude(
        self, infos: dict[str, Any], ended: Entries, terminated: Any, truncated: Any
    ) -> None:
        """Add the keys of last infos, and record the episodes."""
        monitor_set, index = self._monitor_set, ended.nonzero()[0]
        if self._live is not None and self._live.shows(ended):
            self._live.end(self._monitor_set, ended)
        outcomes, success, undecided = monitor_set.ends(index)
        violation = outcomes, *monitor_set.first_violations(index)
        own: Entries | None = None
        has_own = np.zeros(len(index), np.bool_)
        if "is_success" in infos:
            own = key_mask(infos, "is_success", self.num_envs)
            has_own = own.take(index)
            self._seen_success |= bool(has_own.any())
        last = last_info(*violation, success, undecided, has_own)
        put_last(infos, last, index, ended, own, monitor_set.spread)
        flags = np.asarray(terminated).take(index), np.asarray(truncated).take(index)
        self._episodes.append(index, record(*violation, monitor_set.samples.take(index), *flags))

    def _abandon(self, entries: Entries) -> bool:
        """Record running episodes in these environments as truncated; return if there are any."""
        running, self._running = self._running, False
        if not running:
            return False
        monitor_set = self._monitor_set
        cut = entries & (monitor_set.samples > 1)
        if self._done is not None:
            cut &= ~self._done
        index = cut.nonzero()[0]
        if len(index) == 0:
            return False
        monitor_set.finish(cut, self._at_truncation)
        if self._live is not None:
            self._live.end(self._monitor_set, cut)
        violation = monitor_set.outcomes(index), *monitor_set.first_violations(index)
        flags = ~cut[index], cut[index]
        self._episodes.append(index, record(*violation, monitor_set.samples[index], *flags))
        return True


def _with_ends(
    certain: list[tuple[Entries, str]], terminated: Any, truncated: Any
) -> tuple[Any, Any]:
    """Return the flags with the ends by certain verdicts, except where an episode terminated."""
    for entries, how in certain:
        running = entries & ~np.asarray(terminated)
        if how == "terminate":
            terminated = np.logical_or(terminated, running)
        else:
            truncated = np.logical_or(truncated, running)
    return terminated, truncated


def _some(entries: Entries) -> Entries | None:
    """Return the mask, or None if it is false everywhere."""
    return entries if np.count_nonzero(entries) else None


class VectorTracks:
    """The tracks of the environments that a view shows; ``render`` returns a picture of each."""

    def __init__(
        self,
        live: RerunView,
        signals: Sequence[str],
        requirements: Sequence[str],
        period: float | None,
        num: int,
        render: Callable[[], Any],
    ) -> None:
        for index in live.environments:
            if index not in range(num):
                raise InputError(
                    f"RerunView(environments=) names the environment {index!r}; the environments "
                    f"are 0 to {num - 1}"
                )
        self._requirements = requirements
        self._render, self._every = render, live.pictures
        self._tracks: dict[int, Track] = {
            index: live.track(signals, requirements, period, f"environment {index}")
            for index in live.environments
        }
        if live.pictures is not None:
            for track in self._tracks.values():
                track.draw(None, live.pictures)

    def shows(self, entries: Entries) -> bool:
        """Return whether an environment of the mask is shown."""
        return any(entries[index] for index in self._tracks)

    def reset(self, table: Floats, monitor_set: VectorMonitorSet, entries: Entries | None) -> None:
        """Start episodes with sample 0 in the environments of the mask; None: in all."""
        for index, track in self._tracks.items():
            if entries is None or entries[index]:
                track.begin()
                self._add(index, table, monitor_set)
        self._draw([index for index in self._tracks if entries is None or entries[index]])

    def step(
        self,
        table: Floats,
        monitor_set: VectorMonitorSet,
        begun: Entries | None,
        resets: Entries | None,
    ) -> None:
        """Take a sample of every environment.

        The step has reset ``begun`` before the samples, and ``resets`` after them, which render
        others.
        """
        for index, track in self._tracks.items():
            if begun is not None and begun[index]:
                track.begin()
            self._add(index, table, monitor_set)
        self._draw([index for index in self._tracks if resets is None or not resets[index]])

    def end(self, monitor_set: VectorMonitorSet, entries: Entries) -> None:
        """End the episodes in the environments of the mask."""
        for index, track in self._tracks.items():
            if entries[index]:
                track.finish(*monitor_set.values_at(index))

    def _add(self, index: int, table: Floats, monitor_set: VectorMonitorSet) -> None:
        self._tracks[index].add(table[index].tolist(), *monitor_set.values_at(index))

    def _draw(self, indexes: Sequence[int]) -> None:
        """Take the pictures of the environments that are due for one."""
        every = self._every
        if every is None:
            return
        due = [index for index in indexes if not (self._tracks[index].samples - 1) % every]
        frames: Any = self._render() if due else None
        for index in due if frames is not None else ():
            if frames[index] is not None:
                self._tracks[index].picture(frames[index])
