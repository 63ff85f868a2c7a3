"""Native rollouts: the environments of a vector environment with a ``rollout``, as a batch."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from typing import Any, Final, cast

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

import rtamt
from rtamt import Verdict
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.judging.judge import Judging, TriggerCounter
from rtamt_gym.judging.monitor_set import MonitorSet
from rtamt_gym.judging.vector_monitor_set import VectorMonitorSet
from rtamt_gym.play.history import Floats, SimulatedTrace, Stop
from rtamt_gym.play.loop import PlayBatch, Task
from rtamt_gym.play.simulation import AT_VERDICTS, AT_VIOLATION, KNOWN_EVERY
from rtamt_gym.results.outcome import Outcome
from rtamt_gym.results.trial import STOPPED, RunEnd, Trial
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.signals import ElementRead, SignalLike, own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.systems.system import step_limit

_STEPS: Final = 100
"""The steps of a call of ``rollout``. A run that ends within a call discards the rest."""

_REWARD: Final = 0.0
"""The sum of rewards: ``rollout`` returns observations only, and scenarios have requirements."""

_NUMBERS: Final = 2**24
"""The maximum size of a batch's actions; a batch of long runs has fewer places."""


class NativeRollouts:
    """The native vector environment of a scenario, with the judge of its runs.

    The trials equal the results of `rtamt_gym.simulate` to the last bit.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        judging: Judging,
        elements: Mapping[str, int],
        most: int | None,
        stop: Stop,
        batch: int,
    ) -> None:
        self._spec = cast("EnvSpec", env.spec)
        self.elements, self.judging, self.stop = elements, judging, stop
        self.trigger_counter = TriggerCounter(judging.specs, judging.reading)
        simulation: Any = env.unwrapped
        self._actions: tuple[str, ...] = tuple(simulation.action_names)
        self._parameters = frozenset(simulation.parameters)
        space: Any = env.action_space
        bounds = zip(space.low.tolist(), space.high.tolist(), strict=True)
        self._bounds = dict(zip(self._actions, bounds, strict=True))
        limit = cast("int", self._spec.max_episode_steps)
        self.steps = limit if most is None else min(limit, most)
        self.end: RunEnd = "truncated" if self.steps == limit else "duration"
        self.size = max(1, min(batch, _NUMBERS // max(1, self.steps * len(self._actions))))
        self._env: VectorEnv[Any, Any, Any] | None = None
        self._monitor_set: VectorMonitorSet | None = None
        self._defaults: dict[str, Floats] = {}

    @classmethod
    def of(
        cls,
        system: Any,  # noqa: ANN401
        judging: Judging,
        duration: float | None,
        stop: Stop,
        batch: int,
    ) -> NativeRollouts | None:
        """Return the native rollouts of a system; None if they are missing or do not fit."""
        spec = system.spec if isinstance(system, gym.Env) else None
        if spec is None or spec.vector_entry_point is None or spec.additional_wrappers:
            return None
        if judging.reading.substeps:
            return None
        elements = _elements(system, judging.specs, judging.signals)
        vector = gym.make_vec(spec, num_envs=1)
        has_rollout = hasattr(vector.unwrapped, "rollout")
        vector.close()
        if elements is None or not has_rollout or spec.max_episode_steps is None:
            return None
        if judging.reading.period is None:
            reading = judging.reading.having(period=read_period(system))
            judging = judging._replace(reading=reading)
        monitor_set = MonitorSet(judging.specs, judging.reading)
        most = step_limit(duration, monitor_set.period, spec.id)
        return cls(system, judging, elements, most, stop, batch)

    def kind(self, case: Case) -> str | None:
        """Return how rollouts run a case: ``"driven"`` or by the ``"baseline"``.

        None if they cannot: the case drives only some actions, or out of their bounds, or has an
        entry that the scenario does not know.
        """
        acted = 0
        for name, entry in case.items():
            if name in self._bounds:
                smallest, largest = self._bounds[name]
                low, high = _range(entry)
                if not smallest <= low <= high <= largest:
                    return None
                acted += 1
            elif name not in self._parameters or isinstance(entry, Waveform):
                return None
        return {0: "baseline", len(self._actions): "driven"}.get(acted)

    def close(self) -> None:
        """Close the vector environment."""
        if self._env is not None:
            self._env.close()
            self._env = self._monitor_set = None

    def opened(self, count: int) -> tuple[VectorEnv[Any, Any, Any], VectorMonitorSet]:
        """Return the environment and the monitors, with at least ``count`` places."""
        if self._env is None or self._monitor_set is None or self._env.num_envs < count:
            self.close()
            self._env = gym.make_vec(self._spec, num_envs=count)
            simulation: Any = self._env.unwrapped
            self._defaults = simulation.parameters  # before an episode changes them
            specs, _, reading = self.judging
            self._monitor_set = VectorMonitorSet(specs, count, reading, list(self.elements))
        return self._env, self._monitor_set

    def reset(self, env: VectorEnv[Any, Any, Any], tasks: Sequence[Task]) -> Floats:
        """Start the episodes of tasks; return the observations of sample 0."""
        options: dict[str, Any] = {}
        for name in {name for task in tasks for name in task.case if name in self._parameters}:
            options[name] = self._defaults[name].copy()
            for index, task in enumerate(tasks):
                options[name][index] = task.case.get(name, options[name][index])
        seeds: Any = [task.seed for task in tasks] + [None] * (env.num_envs - len(tasks))
        observations: Floats = env.reset(seed=seeds, options=options)[0]
        return observations

    def driven(self, tasks: Sequence[Task], num: int, period: Fraction | None) -> Floats | None:
        """Return the actions, shape (steps, places, actions); None if the baseline acts."""
        if self.kind(tasks[0].case) == "baseline":
            return None
        actions = np.zeros((self.steps, num, len(self._actions)))
        for index, task in enumerate(tasks):
            for i, name in enumerate(self._actions):
                entry = task.case[name]
                actions[:, index, i] = (
                    entry.from_steps(period or 1, self.steps)
                    if isinstance(entry, Waveform)
                    else entry
                )
        return actions


class NativeRun:
    """The run of one place, a `PlayEpisode`; its batch plays it."""

    def __init__(self, batch: NativeBatch, place: int, seed: int | None) -> None:
        self._batch, self._place, self._seed = batch, place, seed
        self._ended: RunEnd | None = None
        self._outcomes: Mapping[str, Outcome] = {}
        self.wall, self.last = 0.0, 0

    @property
    def trace(self) -> SimulatedTrace | None:
        return self._batch.trace(self._place, self.last)

    def end(self, why: RunEnd, last: int, outcomes: Mapping[str, Outcome]) -> None:
        """Store the end of the run."""
        self._ended, self.last, self._outcomes = why, last, outcomes

    def step(self) -> bool:
        return self._ended is not None

    def trial(self, case: Case, error: str = "") -> Trial:  # noqa: ARG002
        assert self._ended is not None  # noqa: S101 - for mypy
        simulated = float(self.last * (self._batch.period or 1))
        return Trial(
            case, self._seed, self._outcomes, self._ended, simulated, self.wall, reward=_REWARD
        )

    def leave(self) -> None:
        """Do nothing: the next reset ends the episode."""


class NativeBatch(PlayBatch):
    """The runs of one reset, of cases of one kind; all places step together.

    If ``above`` is None, the runs have no monitors, and their trials no outcomes.
    """

    period: Fraction | None

    def __init__(
        self,
        rollouts: NativeRollouts,
        count: int,
        above: Mapping[str, float] | None,
        *,
        keeps: bool,
    ) -> None:
        self.size = count
        self._rollouts, self._above, self._keeps = rollouts, above, keeps
        self._kept: list[Floats] | None = [] if keeps or rollouts.trigger_counter else None
        self._at_end = rollouts.judging.reading.at_truncation
        self._samples = 0
        self._runs: list[NativeRun] = []

    def free(self, running: Collection[int]) -> Sequence[int]:
        return [] if self._runs or running else range(self.size)

    def start(self, tasks: Mapping[int, Task]) -> None:
        since = time.perf_counter()
        listed = [*tasks.values()]
        self._runs = [NativeRun(self, place, task.seed) for place, task in tasks.items()]
        self._env, self._monitor_set = self._rollouts.opened(self.size)
        self.period = self._monitor_set.period
        self._all = np.arange(self._env.num_envs)
        self._active = self._all < self.size
        self._monitor_set.reset()
        first = self._rollouts.reset(self._env, listed)[None]
        self._actions = self._rollouts.driven(listed, len(self._all), self.period)
        self._take(first, since)

    def close(self) -> None:
        """Forget the runs, which refer to this batch: the cycle would keep its samples."""
        self._runs = []

    def begin(self, place: int, task: Task) -> NativeRun:  # noqa: ARG002
        return self._runs[place]

    def step(self, running: Sequence[int]) -> float:  # noqa: ARG002
        since = time.perf_counter()
        done = self._samples - 1
        left = self._rollouts.steps - done
        steps = left if self._above is None else min(_STEPS, left)
        due = steps if self._actions is None else self._actions[done : done + steps]
        simulation: Any = self._env.unwrapped
        self._take(simulation.rollout(due, self._active), since)
        return 0.0

    def trace(self, place: int, last: int) -> SimulatedTrace | None:
        """Return the samples of a run that is over, if they are needed."""
        return SimulatedTrace(self._signals(place, last), self.period) if self._keeps else None

    def _signals(self, place: int, last: int) -> dict[str, Floats]:
        if not self._kept:
            return {}
        samples = np.concatenate([block[:, :, place] for block in self._kept])
        values = np.ascontiguousarray(samples[: last + 1].T)
        return dict(zip(self._rollouts.elements, values, strict=True))

    def _take(self, observations: Floats, since: float) -> None:
        """Take observations, shape (samples, places, elements), until all runs are over."""
        # By samples, variables and places, the order that monitors read fastest.
        elements = list(self._rollouts.elements.values())
        tables = np.ascontiguousarray(observations.transpose(0, 2, 1)[:, elements])
        if self._kept is not None:
            self._kept.append(tables)
        running = self._active.nonzero()[0].tolist()
        ends: dict[int, tuple[RunEnd, int]] = {}
        if self._above is not None:
            self._judge(tables, ends)
        else:
            self._samples += len(tables)
            if self._samples > self._rollouts.steps:
                ends = dict.fromkeys(running, (self._rollouts.end, self._rollouts.steps))
        wall = (time.perf_counter() - since) / len(running)
        for place in running:
            self._runs[place].wall += wall
        outcomes = self._outcomes(ends) if ends and self._above is not None else {}
        for place, (why, last) in ends.items():
            self._runs[place].end(why, last, outcomes.get(place, {}))

    def _judge(self, tables: Floats, ends: dict[int, tuple[RunEnd, int]]) -> None:
        """Feed samples to the monitors, and collect the runs that are over."""
        all_running = bool(self._active.all())
        for table in tables:
            self._monitor_set.feed(table.T, None if all_running else self._active)
            self._stop(ends)
            self._samples += 1
            if not self._active.any():
                break
            all_running = all_running and not ends

    def _stop(self, ends: dict[int, tuple[RunEnd, int]]) -> None:
        """End the runs that the last sample ends, in the order of `Simulation`."""
        monitor_set, stop = self._monitor_set, self._rollouts.stop
        last = self._samples == self._rollouts.steps
        if last and self._rollouts.end == "truncated":
            monitor_set.finish(self._active, self._at_end)
            self._over(self._active, "truncated", ends)
            return
        if stop in AT_VIOLATION:
            self._over(monitor_set.any_violated(), "violation", ends)
        if stop in AT_VERDICTS:
            self._over(~np.logical_or.reduce(monitor_set.undecided(self._all)), "decided", ends)
        if stop == "known" and self._samples % KNOWN_EVERY == 0:
            self._over(monitor_set.knows(self._above or {}), "known", ends)
        if last:
            monitor_set.finish(self._active, self._at_end)
            self._over(self._active, "duration", ends)

    def _over(
        self, places: NDArray[np.bool_], why: RunEnd, ends: dict[int, tuple[RunEnd, int]]
    ) -> None:
        chosen = (places & self._active).nonzero()[0]
        self._active[chosen] = False
        ends.update(dict.fromkeys(chosen.tolist(), (why, self._samples)))

    def _outcomes(self, ends: Mapping[int, tuple[RunEnd, int]]) -> dict[int, dict[str, Outcome]]:
        """Return the outcomes of runs that are over, by their places."""
        monitor_set, places = self._monitor_set, sorted(ends)
        counter, progress = self._rollouts.trigger_counter, monitor_set.progress
        columns: dict[str, list[NDArray[Any]]] = {
            name: [judge.robustness, judge.lower, judge.upper, judge.verdict]
            for name, (_, judge) in monitor_set.monitors.items()
        }
        moments = {
            name: (columns_of["decided_at"], columns_of["ended_at"])
            for name, columns_of in monitor_set.outcomes(np.array(places)).by_name().items()
        }
        outcomes: dict[int, dict[str, Outcome]] = {}
        for row, place in enumerate(places):
            why, last = ends[place]
            verdicts = {name: Verdict(values[-1][place].item()) for name, values in columns.items()}
            end = None if why in STOPPED else self._at_end
            samples = self._signals(place, last) if counter else {}
            evidence = counter.evidence(samples, last + 1, end, verdicts)
            outcomes[place] = {}
            for name, (*bounds, _) in columns.items():
                decided, ended = (
                    moment.value[row].item() if moment.there[row] else None
                    for moment in moments[name]
                )
                outcomes[place][name] = Outcome.at(
                    [values[place].item() for values in bounds],
                    verdicts[name],
                    decided,
                    self.period,
                    evidence[name],
                    progress[name][place].item() if name in progress else None,
                    ended=ended,
                )
        return outcomes


def _range(entry: float | Waveform) -> tuple[float, float]:
    """Return the minimum and the maximum of an entry of a case."""
    if isinstance(entry, Waveform):
        return min(entry.values), max(entry.values)
    return (entry, entry) if math.isfinite(entry) else (math.inf, -math.inf)


def _elements(
    env: gym.Env[Any, Any],
    specs: Mapping[str, rtamt.Specification],
    signals: Mapping[str, SignalLike] | None,
) -> dict[str, int] | None:
    """Return the element of the observation that each variable reads; None for other signals."""
    variables = list(dict.fromkeys(name for spec in specs.values() for name in spec.variables))
    own = own_signals(env)
    chosen = {name: (signals or {}).get(name, own.get(name)) for name in variables}
    texts = {name: read for name, read in chosen.items() if isinstance(read, str)}
    if set(texts) != set(variables) or not set(signals or {}) <= set(variables):
        return None
    try:
        bound = [signal.bind(env) for signal in parse_signals(texts, variables, SOURCES)]
    except rtamt.RtamtError:  # the first simulation raises it in its own words
        return None
    if not all(isinstance(read, ElementRead) for read in bound):
        return None
    return dict(zip(variables, (cast("ElementRead", read).index for read in bound), strict=True))
