"""`VectorEpisodes`: plays episodes of a policy in a vector environment that somebody has made."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from rtamt import InputError, StateError
from rtamt_gym.evaluation.lanes import Lane, Task
from rtamt_gym.evaluation.places import Place
from rtamt_gym.evaluation.policies import evaluated
from rtamt_gym.evaluation.waves import Waves
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.ends import AtTermination
from rtamt_gym.judging.reading import EpisodeReading, Reading, checked_reading, seconds_of
from rtamt_gym.judging.specs import autoreset_mode, own_requirements
from rtamt_gym.judging.unknown import with_unknown_start
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.runs.requirements import Requirements, load_requirements
from rtamt_gym.search.runs.runner import CaseLike, Runner
from rtamt_gym.search.runs.trace import SimulatedTrace
from rtamt_gym.signals.columns import SignalColumns
from rtamt_gym.signals.periods import ask_another, read_period, warn_of_unverified_period
from rtamt_gym.signals.signals import own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.signals.step_time import StepTime, StepTimes
from rtamt_gym.signals.taps import VectorTap, rescaling, tapped
from rtamt_gym.simulation.crashes import failed, no_exit
from rtamt_gym.simulation.monitors import with_own_monitor
from rtamt_gym.simulation.record import Stop
from rtamt_gym.simulation.run import Run
from rtamt_gym.simulation.simulation import Simulation, Simulator
from rtamt_gym.simulation.systems import Policy
from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor

__all__ = ["VectorEpisodes"]

Vector = VectorEnv[Any, Any, Any]


class VectorEpisodes(Runner):
    """Plays episodes in the environments of a vector environment, each with a seed of its own.

    A vector environment that resets by itself plays waves: one reset with seeds, and steps until
    all episodes that it began are over, so that short ones do not come more often. One that resets
    single environments when it is told begins the next episode as soon as one is over.

    Attributes:
        evaluated: The policy.
        unasked: Whether nobody has said what the environment's own end means.
        monitor: The monitor of the environment, or None.

    Args:
        env: The vector environment, or a function that makes one.
        requirements: The requirements.
        policy: The policy, as for `Episodes`.
        deterministic: As for `Episodes`.
        made: What the function has made, if it was called already.
        **options: As for `Runner`.

    Raises:
        InputError: If the environment does not take a seed for each episode, or as `Runner` does.
    """

    def __init__(
        self,
        env: Vector | Callable[[], Vector],
        requirements: Requirements | None = None,
        *,
        policy: Any,  # noqa: ANN401
        deterministic: bool = True,
        made: Vector | None = None,
        **options: Any,  # noqa: ANN401 - as for `Runner`
    ) -> None:
        self._given = env
        self._env: Vector = made or (env if isinstance(env, VectorEnv) else env())
        self.monitor = _monitor_of(self._env)
        self._inside: Vector = self._env if self.monitor is None else self.monitor.env
        stop, duration = options.pop("stop", "end"), options.pop("duration", None)
        signals = options.pop("signals", None)
        given = checked_reading(options, type(self), EpisodeReading)
        requirements, self.signals, reading = with_own_monitor(
            self.monitor, requirements, signals, given
        )
        spec = self._env.spec
        self.name = spec.id if spec else type(self._env.unwrapped).__name__
        own = own_requirements(self._env)
        self._check_resets()
        self.requirements = load_requirements(requirements, own, self.name)
        timed = any(each.timed for each in self.requirements.values())
        if timed and reading.period is None and self.monitor is None:
            warn_of_unverified_period(self._env)
        self.period = reading.period or read_period(self._env) or ask_another(self._env)
        self.inputs = ()
        limit = spec.max_episode_steps if spec else None
        step = seconds_of(self.period)
        self._times = StepTimes(self._env, self._comparison(step, reading, timed=timed))
        self.duration = duration or (None if limit is None or step is None else float(step * limit))
        self.unasked = reading.at_termination is None
        self.reading = reading.having(
            at_termination=reading.at_termination or "complete", period=self.period
        )
        self.stop: Stop = stop
        self._of_runs: dict[str, Any] = {"duration": duration, "stop": stop}
        alone: Any = SimpleNamespace(
            observation_space=self._env.single_observation_space,
            action_space=self._env.single_action_space,
            unwrapped=None,
            spec=spec,
        )
        if isinstance(policy, str) and policy == "baseline":
            raise InputError(
                "the policy baseline is for one environment; give the id of the environment with "
                f"n_envs={self._env.num_envs}"
            )
        self.evaluated = evaluated(policy, alone, deterministic=deterministic)
        make = self.evaluated.make
        assert make is not None, "the baseline was refused"  # noqa: S101 - for mypy
        self._make = make
        specs = self.requirements.values()
        variables = list(dict.fromkeys(name for spec in specs for name in spec.variables))
        known = {**own_signals(self._inside)}
        if self.monitor is not None:
            known |= self.monitor.judging.signals or {}
        read = {**known, **(self.signals or {})}
        self._judged, refuse_nan = with_unknown_start(
            self.reading, {name: read.get(name) for name in variables}
        )
        parsed = parse_signals(
            self.signals or {}, variables, SOURCES, extra=True, own=known, refuse_nan=refuse_nan
        )
        same_step = autoreset_mode(self._env) is AutoresetMode.SAME_STEP
        self._rescaler = rescaling(
            self._inside, parsed, below=self.reading.below, rescaled=self.reading.rescaled
        )
        read_in = self._inside if self._rescaler is None else self._rescaler.env
        self._columns = SignalColumns(parsed, read_in, same_step=same_step)
        self._places = [Place(self.name, self.period, limit) for _ in range(self._env.num_envs)]
        self._simulators = self._simulators_of(self._judged)

    def _comparison(
        self, period: Fraction | None, reading: Reading, *, timed: bool
    ) -> Callable[[Any], StepTime] | None:
        """Return what compares the period with an environment; None if a monitor inside does."""
        if period is None or self.monitor is not None:
            return None

        def compare(env: Any) -> StepTime:  # noqa: ANN401 - one, or many
            was_read, stated = reading.period is None, read_period(env)
            return StepTime(
                env, float(period), read_period, was_read=was_read, timed=timed, stated=stated
            )

        return compare

    def _simulators_of(self, reading: Reading) -> list[Simulator]:
        """The simulators of the environments."""
        first, *others = self._places
        duration = self._of_runs["duration"]
        read = reading.having(below=False)  # the signals of all environments are read together
        simulator = Simulator(first, self.requirements, None, read, duration=duration)
        return [simulator, *(simulator.of(place) for place in others)]

    @property
    def _acting(self) -> Sequence[object]:
        """As `Runner._acting`."""
        return [self._make]

    def check(self, case: CaseLike) -> None:
        """Has nothing to do: the construction has refused what does not fit."""

    def close(self) -> None:
        """Leaves the environment open: somebody else has made it."""

    @property
    def system(self) -> Any:  # noqa: ANN401
        """The vector environment."""
        return self._env

    @property
    def origin(self) -> Any:  # noqa: ANN401
        """As `Runner.origin`: the function that makes the environment, if there is one."""
        return self._given

    @property
    def arguments(self) -> Mapping[str, Any]:
        """As `Runner.arguments`."""
        return {**self.options, "policy": self.evaluated}

    @property
    def takes_seeds(self) -> bool:
        """As `Runner.takes_seeds`."""
        return True

    @property
    def batch(self) -> int:
        """How many episodes a worker gets at once."""
        return self._env.num_envs

    def run(
        self,
        cases: Iterable[CaseLike],
        seeds: Sequence[int] | None = None,
        *,
        keep: Callable[[int, SimulatedTrace], object] | None = None,  # noqa: ARG002 - for searches alone
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """Plays episodes, as `Runner.run` does."""
        listed = [Case(case) for case in cases]
        given: Sequence[int | None] = seeds or [None] * len(listed)
        left = {task.number: task for task in map(Task, range(len(listed)), listed, given)}
        stop: Stop = self._of_runs["stop"]
        try:
            for number, row, _ in self._play(list(left.values()), stop, above):
                del left[number]
                yield number, row
        except (Exception, SystemExit):  # noqa: BLE001 - it stands in the row of the episode that has it
            for task in left.values():
                try:
                    with no_exit(self.name):
                        played = list(self._play([task], stop, above))
                    yield from ((number, row) for number, row, _ in played)
                except Exception as error:  # noqa: BLE001
                    yield task.number, failed(error, task.case, task.seed, 0.0)

    def simulate(
        self,
        case: CaseLike,
        seed: int | None = None,
        above: Mapping[str, float] | None = None,
        stop: Stop | None = None,
        *,
        policy: Policy | None = None,  # noqa: ARG002 - an evaluation has its own
        at_termination: AtTermination | None = None,
    ) -> Run:
        """Plays one episode and keeps every sample, as `Runner.simulate` does."""
        simulators = self._simulators
        if at_termination is not None:
            simulators = self._simulators_of(self._judged.having(at_termination=at_termination))
        when: Stop = self._of_runs["stop"] if stop is None else stop
        task = Task(0, Case(case), seed)
        ((_, row, run),) = self._play([task], when, above, simulators, light=False)
        if run is None:
            raise StateError(f"expected an episode as it was before, got {row.error}")
        return replace(run, seed=seed)

    def _play(
        self,
        tasks: Sequence[Task],
        stop: Stop,
        above: Mapping[str, float] | None,
        simulators: Sequence[Simulator] = (),
        *,
        light: bool = True,
    ) -> Iterator[tuple[int, Trial, Run | None]]:
        """Plays episodes; gives each with its number and its run when it is over."""
        of_places = dict(zip(map(id, self._places), simulators or self._simulators, strict=True))

        def begin(place: Any, _task: Task, _policy: Policy) -> Simulation:  # noqa: ANN401
            return of_places[id(place)].begin(stop=stop, above=above, light=light)

        lanes = [Lane(place, begin) for place in self._places]
        todo = deque(tasks)
        with ExitStack() as stack:
            tap = None
            if self.monitor is not None:
                tap = VectorTap(self._inside)
                stack.enter_context(self.monitor.tapped(tap))
            if self._rescaler is not None:
                inner = self._rescaler.env
                tap = tapped(self._rescaler)
                stack.callback(setattr, self._rescaler, "env", inner)
            waves = Waves(
                self._env, self._make, self._columns, self._places, lanes, tap, self._times
            )
            while todo:
                yield from waves.play(todo)

    def _check_resets(self) -> None:
        """Refuses one that takes no seeds for its environments, or has monitors in them."""
        try:
            _, infos = self._inside.reset(seed=[0] * self._env.num_envs)  # type: ignore[arg-type]  # what is asked
        except (gym.error.Error, TypeError) as error:
            raise InputError(
                "expected a vector environment that takes a seed for each of its environments, so "
                f"that every episode can be played again, got {self._env.unwrapped}, which takes "
                f"one for all; give {self.name!r} with n_envs={self._env.num_envs}, or "
                "gym.make_vec(..., vectorization_mode='sync')"
            ) from error
        if "stl_lower" in infos:  # they might end episodes, unseen and unsaid
            raise InputError(
                f"expected environments without monitors in {self._env.unwrapped}, got some with; "
                f"give the function that makes one of them with n_envs={self._env.num_envs}, or "
                "put a VectorStlMonitor around all"
            )


def _monitor_of(env: Any) -> VectorStlMonitor | None:  # noqa: ANN401
    while isinstance(env, VectorWrapper):
        if isinstance(env, VectorStlMonitor):
            return env
        env = env.env
    return None
