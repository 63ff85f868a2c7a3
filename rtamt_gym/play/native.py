"""Runs cases side by side, in the lanes of a native vector environment."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, Final, cast

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

import rtamt
from rtamt import Verdict
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.panel import Panel
from rtamt_gym.judging.questions import Questions
from rtamt_gym.judging.vector_panel import VectorPanel
from rtamt_gym.play.loop import SimulatedTrace
from rtamt_gym.play.run_record import AT_VERDICTS, AT_VIOLATION, KNOWN_EVERY, Stop
from rtamt_gym.results.outcome import Outcome
from rtamt_gym.results.trial import STOPPED, RunEnd, Trial
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.signals import ElementRead, SignalLike, own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES

Floats = NDArray[np.float64]

_STEPS: Final = 100
"""The steps of a call. A lane that is over within a call throws the rest of its steps away."""

_REWARD: Final = 0.0
"""The sum of rewards where there is a ``rollout``, which gives observations alone: scenarios have
requirements in place of rewards."""

_NUMBERS: Final = 2**24
"""The most numbers that the actions of a batch may be; a batch of long runs has fewer lanes."""


class NativeLanes:
    """The lanes of a native vector environment: each runs a case, and all step together.

    `rtamt_gym.simulate` gives the same numbers, to the last bit.

    Attributes:
        size: The greatest number of cases of a batch.

    Args:
        env: The environment of one case, which is registered with a vector environment.
        judging: The requirements, and how runs are judged.
        elements: The element of the observation that each of their variables reads.
        most: The greatest number of steps; None: the time limit of the environment.
        stop: When runs are stopped, as `rtamt_gym.simulate` describes it.
        batch: The greatest number of lanes.
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
        self._elements = elements
        self.judging, self.stop = judging, stop
        self.questions = Questions(judging.specs, judging.reading)
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
        self._panel: VectorPanel | None = None
        self._defaults: dict[str, Floats] = {}

    def kind(self, case: Case) -> str | None:
        """How a lane runs a case: ``"driven"``, or by the ``"baseline"``.

        None: no lane can, because the case drives some actions alone, or out of their bounds, or
        has an entry that the scenario does not know.
        """
        acted = 0
        for name, entry in case.items():
            if name in self._bounds:
                least, most = self._bounds[name]
                low, high = _range(entry)
                if not least <= low <= high <= most:
                    return None
                acted += 1
            elif name not in self._parameters or isinstance(entry, Waveform):
                return None
        return {0: "baseline", len(self._actions): "driven"}.get(acted)

    def run(
        self,
        cases: Sequence[Case],
        seeds: Sequence[int | None],
        keep: Callable[[int, SimulatedTrace], object] | None = None,
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """Runs cases of one kind, ``size`` at most; gives each with its index when it is over.

        Args:
            cases: What they are given.
            seeds: The seed of each.
            keep: Is called with the samples of each before it is given.
            above: As for `rtamt_gym.simulate`.

        Raises:
            Exception: What the environment or a monitor raises in any lane. What has not been given
                by then is lost.
        """
        env, panel = self._made(len(cases))
        panel.reset()
        batch = _Batch(self, panel, env.num_envs, len(cases), above or {})
        begin = time.perf_counter()
        made = self._reset(env, cases, seeds)[None]
        actions = self._driven(cases, env.num_envs, panel.period)
        kept: list[Floats] = []

        def signals_of(lane: int) -> dict[str, Floats]:
            if not kept:
                return {}
            samples = np.concatenate([each[:, :, lane] for each in kept])
            values = np.ascontiguousarray(samples[: int(batch.last[lane]) + 1].T)
            return dict(zip(self._elements, values, strict=True))

        while True:
            # By samples, variables and lanes, which monitors read fastest.
            tables = np.ascontiguousarray(made.transpose(0, 2, 1)[:, list(self._elements.values())])
            over = batch.feed(tables, begin)
            if keep is not None or self.questions:
                kept.append(tables)
            if keep is not None:
                for lane in over.tolist():
                    keep(lane, SimulatedTrace(signals_of(lane), panel.period))
            for lane, outcomes in batch.outcomes(over, signals_of):
                yield (
                    lane,
                    Trial(
                        cases[lane],
                        seeds[lane],
                        outcomes,
                        batch.ends[lane],
                        float(int(batch.last[lane]) * (panel.period or 1)),
                        float(batch.wall[lane]),
                        reward=_REWARD,
                    ),
                )
            if not batch.active.any():
                return
            begin = time.perf_counter()
            done = batch.samples - 1
            steps = min(_STEPS, self.steps - done)
            due = steps if actions is None else actions[done : done + steps]
            made = env.unwrapped.rollout(due, batch.active)  # type: ignore[attr-defined]  # see `runner`

    def whole(
        self, cases: Sequence[Case], seeds: Sequence[int | None]
    ) -> list[tuple[Trial, SimulatedTrace]]:
        """Runs cases of one kind, ``size`` at most, to the end without monitors.

        Gives the row of each, without outcomes, and its samples.

        Raises:
            Exception: What the environment raises in any lane.
        """
        begin = time.perf_counter()
        env, panel = self._made(len(cases))
        first = self._reset(env, cases, seeds)[None]
        actions = self._driven(cases, env.num_envs, panel.period)
        due = self.steps if actions is None else actions
        active = np.arange(env.num_envs) < len(cases)
        made = env.unwrapped.rollout(due, active)  # type: ignore[attr-defined]  # see `runner`
        samples = np.concatenate([first, made])[:, :, list(self._elements.values())]
        simulated = float(self.steps * (panel.period or 1))
        wall = (time.perf_counter() - begin) / len(cases)
        found = []
        for lane, (case, seed) in enumerate(zip(cases, seeds, strict=True)):
            values = np.ascontiguousarray(samples[:, lane].T)
            trace = SimulatedTrace(dict(zip(self._elements, values, strict=True)), panel.period)
            row = Trial(case, seed, {}, self.end, simulated, wall, reward=_REWARD)
            found.append((row, trace))
        return found

    def close(self) -> None:
        """Frees the vector environment."""
        if self._env is not None:
            self._env.close()
            self._env = self._panel = None

    def _made(self, count: int) -> tuple[VectorEnv[Any, Any, Any], VectorPanel]:
        """The environment and the monitors, with lanes for as many cases at least."""
        if self._env is None or self._panel is None or self._env.num_envs < count:
            self.close()
            self._env = gym.make_vec(self._spec, num_envs=count)
            simulation: Any = self._env.unwrapped
            self._defaults = simulation.parameters  # before an episode has others
            specs, _, reading = self.judging
            self._panel = VectorPanel(specs, count, reading, list(self._elements))
        return self._env, self._panel

    def _reset(
        self, env: VectorEnv[Any, Any, Any], cases: Sequence[Case], seeds: Sequence[int | None]
    ) -> Floats:
        """Begins the episodes; returns the observations of sample 0."""
        options: dict[str, Any] = {}
        for name in {name for case in cases for name in case if name in self._parameters}:
            options[name] = self._defaults[name].copy()
            for lane, case in enumerate(cases):
                options[name][lane] = case.get(name, options[name][lane])
        every: Any = [*seeds, *[None] * (env.num_envs - len(cases))]
        found: Floats = env.reset(seed=every, options=options)[0]
        return found

    def _driven(self, cases: Sequence[Case], num: int, period: Fraction | None) -> Floats | None:
        """The actions of every step, shape (steps, lanes, actions); None: the baseline acts."""
        if self.kind(cases[0]) == "baseline":
            return None
        actions = np.zeros((self.steps, num, len(self._actions)))
        for lane, case in enumerate(cases):
            for i, name in enumerate(self._actions):
                entry = case[name]
                actions[:, lane, i] = (
                    entry.of_steps(period or 1, self.steps)
                    if isinstance(entry, Waveform)
                    else entry
                )
        return actions


def _range(entry: float | Waveform) -> tuple[float, float]:
    """The least and the greatest value of an entry of a case."""
    if isinstance(entry, Waveform):
        return min(entry.values), max(entry.values)
    return (entry, entry) if math.isfinite(entry) else (math.inf, -math.inf)


class _Batch:
    """The runs of one batch: which are active, and how the others ended.

    Attributes:
        active: The lanes whose runs go on.
        samples: How many samples the active lanes have been fed.
        ends: Why the run of a lane is over, by lane.
        last: The last sample of each lane.
        wall: The seconds that each lane took: an equal share of each call, for lanes that ran.
    """

    def __init__(
        self,
        lanes: NativeLanes,
        panel: VectorPanel,
        num: int,
        count: int,
        above: Mapping[str, float],
    ) -> None:
        self._panel = panel
        self._above = above
        self._stops, self._at_end = lanes.stop, lanes.judging.reading.at_truncation
        self._questions = lanes.questions
        self._steps = lanes.steps
        self._end = lanes.end
        self._all = np.arange(num)
        self.active = self._all < count
        self.samples = 0
        self.ends: dict[int, RunEnd] = {}
        self.last = np.zeros(num, np.int64)
        self.wall = np.zeros(num)

    def feed(self, tables: Floats, begin: float) -> NDArray[np.int64]:
        """Feeds samples, shape (samples, variables, lanes), until all runs are over.

        Returns:
            The lanes whose runs are over now.
        """
        running = self.active.copy()
        whole = bool(running.all())
        for table in tables:
            self._panel.feed(table.T, None if whole else self.active)
            self._stop()
            self.samples += 1
            if not self.active.any():
                break
            whole = whole and not self.ends
        self.wall[running] += (time.perf_counter() - begin) / np.count_nonzero(running)
        over: NDArray[np.int64] = (running & ~self.active).nonzero()[0]
        return over

    def outcomes(
        self, over: NDArray[np.int64], signals_of: Callable[[int], Mapping[str, Floats]]
    ) -> Iterator[tuple[int, dict[str, Outcome]]]:
        """What the requirements have become in these lanes, whose runs are over.

        Args:
            over: The lanes.
            signals_of: Gives the samples of a lane, if they were kept.
        """
        if not len(over):
            return
        panel = self._panel
        found: dict[str, list[NDArray[Any]]] = {
            name: [judge.robustness, judge.lower, judge.upper, judge.verdict]
            for name, (_, judge) in panel.monitors.items()
        }
        moments = {
            name: (each["decided_at"], each["ended_at"])
            for name, each in panel.outcomes(over).by_name().items()
        }
        progress = panel.progress
        for place, lane in enumerate(over.tolist()):
            verdicts = {name: Verdict(columns[-1][lane].item()) for name, columns in found.items()}
            stopped = self.ends[lane] in STOPPED
            stands_on = self._questions.answers(
                signals_of(lane),
                int(self.last[lane]) + 1,
                None if stopped else self._at_end,
                verdicts,
            )
            outcomes = {}
            for name, (*bounds, _) in found.items():
                decided, ended = (
                    at.value[place].item() if at.there[place] else None for at in moments[name]
                )
                outcomes[name] = Outcome.at(
                    [column[lane].item() for column in bounds],
                    verdicts[name],
                    decided,
                    panel.period,
                    stands_on[name],
                    progress[name][lane].item() if name in progress else None,
                    ended=ended,
                )
            yield lane, outcomes

    def _stop(self) -> None:
        """Ends the runs that the sample ends which has been fed, in the order of `simulate`."""
        ends = self.samples == self._steps
        if ends and self._end == "truncated":
            self._panel.finish(self.active, self._at_end)
            self._over(self.active, "truncated")
            return
        if self._stops in AT_VIOLATION:
            self._over(self._panel.any_violated(), "violation")
        if self._stops in AT_VERDICTS:
            self._over(~np.logical_or.reduce(self._panel.undecided(self._all)), "decided")
        if self._stops == "known" and self.samples % KNOWN_EVERY == 0:
            self._over(self._panel.knows(self._above), "known")
        if ends:
            self._panel.finish(self.active, self._at_end)
            self._over(self.active, "duration")

    def _over(self, lanes: NDArray[np.bool_], why: RunEnd) -> None:
        chosen = (lanes & self.active).nonzero()[0]
        if len(chosen):
            self.active[chosen] = False
            self.last[chosen] = self.samples
            self.ends.update(dict.fromkeys(chosen.tolist(), why))


def lanes_of(
    system: Any,  # noqa: ANN401
    judging: Judging,
    duration: float | None,
    stop: Stop,
    batch: int,
) -> NativeLanes | None:
    """The lanes that run the cases of an environment; None if it has none, or they do not do."""
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
    panel = Panel(judging.specs, judging.reading)
    most = None
    if duration is not None and duration != math.inf:
        most = int(exact(duration) / (panel.period or 1))
    return NativeLanes(system, judging, elements, most, stop, batch)


def _elements(
    env: gym.Env[Any, Any],
    specs: Mapping[str, rtamt.Specification],
    signals: Mapping[str, SignalLike] | None,
) -> dict[str, int] | None:
    """The element of the observation that each variable reads; None if one reads something else."""
    variables = list(dict.fromkeys(name for spec in specs.values() for name in spec.variables))
    own = own_signals(env)
    chosen = {name: (signals or {}).get(name, own.get(name)) for name in variables}
    texts = {name: read for name, read in chosen.items() if isinstance(read, str)}
    if set(texts) != set(variables) or not set(signals or {}) <= set(variables):
        return None
    try:
        bound = [each.bind(env) for each in parse_signals(texts, variables, SOURCES)]
    except rtamt.RtamtError:  # which the first simulation raises, in words of its own
        return None
    if not all(isinstance(read, ElementRead) for read in bound):
        return None
    return dict(zip(variables, (cast("ElementRead", read).index for read in bound), strict=True))
