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
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import concatenate, create_empty_array, iterate
from numpy.typing import NDArray

from rtamt import InputError, StateError
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.specs import autoreset_mode, own_requirements
from rtamt_gym.judging.unknown import with_unknown_start
from rtamt_gym.judging.vector_infos import final_infos, final_observations
from rtamt_gym.options.evaluation import AtTermination, Reading, checked_options, seconds_of
from rtamt_gym.play.loop import Lane, SimulatedTrace, Task
from rtamt_gym.play.recorder import failed
from rtamt_gym.play.run import Run
from rtamt_gym.play.run_record import Stop
from rtamt_gym.play.runner import CaseLike, Requirements, Runner, load_requirements
from rtamt_gym.play.simulation import Simulation, Simulator
from rtamt_gym.results.trial import Trial
from rtamt_gym.signals.columns import SignalColumns
from rtamt_gym.signals.periods import ask_another, read_period, warn_of_unverified_period
from rtamt_gym.signals.signals import own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.signals.step_time import StepTime, StepTimes
from rtamt_gym.signals.taps import VectorTap, rescaling, tapped
from rtamt_gym.systems.environment import with_own_monitor
from rtamt_gym.systems.models import Model, PolicyBatch
from rtamt_gym.systems.policies import SeededPolicy, evaluated
from rtamt_gym.systems.system import Policy, Signals, System, SystemEnd, no_exit
from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor

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
        given = checked_options(options, type(self), "episodes")
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


Played = tuple[int, Trial, Run | None]
"""The number of an episode, its row, and its run, if no error has ended it."""

Mask = NDArray[np.bool_]


class Waves:
    """Plays episodes in the environments of a vector environment.

    Args:
        env: The vector environment.
        make: Makes the policy of an episode.
        columns: Reads the signals of all environments.
        places: Each environment as a system.
        lanes: What plays episodes in these systems.
        tap: What has shown the samples that are read, to a monitor of the environment or to a
            wrapper that rescales them; None: the environment itself.
        times: Compares the period with the environments.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        make: SeededPolicy,
        columns: SignalColumns,
        places: Sequence[Place],
        lanes: Sequence[Lane],
        tap: VectorTap | None,
        times: StepTimes,
    ) -> None:
        self._env = env
        self._make = make
        self._columns = columns
        self._places = places
        self._lanes = lanes
        self._tap = tap
        self._times = times
        self._mode = autoreset_mode(env)
        self._obs: Any = None

    def play(self, todo: deque[Task]) -> Iterator[Played]:
        """Plays an episode in each environment; in those that can be reset alone, all.

        An environment without an episode begins and does what another one does.

        Raises:
            Exception: What the environment or the policy raises where several episodes run.
        """
        single = self._mode is AutoresetMode.DISABLED
        acting = _Acting(self._env, self._make)
        mask: Mask = np.ones(len(self._lanes), np.bool_)
        yield from self._begin(mask, todo, acting, {})
        begun: Mask | None = None
        while running := self._running():
            with no_exit("the policy"):
                actions = acting.act(self._obs, running)
            ended = self._step(actions, begun, running)
            for place in running:
                yield from self._over(place, self._lanes[place].task, self._lanes[place].step())
            if ended is None:
                return
            begun = ended if self._mode is AutoresetMode.NEXT_STEP and ended.any() else None
            if single:
                mask = self._free(todo) | ended
                while mask.any() and (todo or self._running()):
                    yield from self._begin(mask, todo, acting, {"reset_mask": mask})
                    mask = self._free(todo)

    def _running(self) -> list[int]:
        return [place for place, lane in enumerate(self._lanes) if lane.task is not None]

    def _free(self, todo: deque[Task]) -> Mask:
        """The environments without an episode, if one is left for them."""
        return np.array([lane.task is None and bool(todo) for lane in self._lanes])

    def _begin(
        self, mask: Mask, todo: deque[Task], acting: _Acting, options: dict[str, Any]
    ) -> Iterator[Played]:
        """Resets the environments of the mask and begins episodes, as far as some are left."""
        due = {int(place): todo.popleft() for place in np.flatnonzero(mask) if todo}
        seeds = [due[place].seed if place in due else None for place in range(len(mask))]
        if due:
            first = next(iter(due.values())).seed
            seeds = [first if seed is None else seed for seed in seeds]
        found: Any = self._env.reset(seed=seeds, options=options)  # type: ignore[arg-type]  # a seed for each
        self._obs = found[0]
        self._times.begin(mask)
        shown, infos = found if self._tap is None else self._tap.shown
        table = self._columns.reset(shown, infos, mask)
        for place, task in due.items():
            self._places[place].take(table[place], None)
            acting.begin(place, task.seed)
            yield from self._over(place, task, self._lanes[place].begin(task))

    def _over(self, place: int, task: Task | None, row: Trial | None) -> Iterator[Played]:
        if row is not None and task is not None:
            yield task.number, row, self._lanes[place].run

    def _step(self, actions: Any, begun: Mask | None, running: Sequence[int]) -> Mask | None:  # noqa: ANN401
        """Makes a step; gives which environments it has ended, None if it raised an error."""
        try:
            with no_exit("an environment"):
                result = self._env.step(actions)
            ended: Mask = np.logical_or(result[2], result[3])
            self._times.step(ended if self._mode is AutoresetMode.SAME_STEP else begun)
        except Exception as error:
            if len(running) > 1:
                raise
            self._places[running[0]].error = error
            return None
        self._obs, terminated = result[0], result[2]
        if self._tap is not None:
            actions, result = self._tap.actions, self._tap.result
        table = self._read(result, actions, begun)
        for place in running:
            self._places[place].take(table[place], result[1][place])
            if ended[place]:
                self._places[place].end = "terminated" if terminated[place] else "truncated"
        return ended

    def _read(self, result: Any, actions: Any, begun: Mask | None) -> Any:  # noqa: ANN401
        """The signals after a step, also of the episodes that the step has ended."""
        obs, rewards, terminated, truncated, infos = result
        ended = np.logical_or(terminated, truncated)
        if self._mode is AutoresetMode.SAME_STEP and ended.any():
            if self._columns.reads_obs:
                space = (self._env if self._tap is None else self._tap).single_observation_space
                obs = final_observations(space, obs, infos, ended)
            if self._columns.reads_info:
                infos = final_infos(infos, ended)
        return self._columns.step(obs, actions, rewards, infos, begun)


class _Acting:
    """Acts in the environments of a vector environment."""

    def __init__(self, env: VectorEnv[Any, Any, Any], make: SeededPolicy) -> None:
        self._make = make
        self._observations, self._space = env.observation_space, env.single_action_space
        self._policies: list[Policy | None] = [None] * env.num_envs
        self._batch: PolicyBatch | None = None
        if isinstance(make, Model) and make.deterministic:
            self._batch = make.batch(env.single_observation_space, env.num_envs)

    def begin(self, place: int, seed: int | None) -> None:
        """Begins an episode."""
        if self._batch is not None:
            self._batch.begin(place)
        else:
            self._policies[place] = self._make(seed or 0)

    def act(self, observations: Any, running: Sequence[int]) -> Any:  # noqa: ANN401
        """The actions; an environment without an episode does what the first with one does."""
        if self._batch is not None:
            return self._batch.of(observations)
        shown = list(iterate(self._observations, observations))
        policies: Any = self._policies
        made = {place: policies[place](shown[place]) for place in running}
        actions = [made.get(place, made[running[0]]) for place in range(len(shown))]
        room: Any = create_empty_array(self._space, len(actions))
        return concatenate(self._space, actions, room)


class Place(System):
    """One environment of a vector environment, whose steps all make together.

    Attributes:
        end: How the last step has ended the episode.
        error: What the last step has raised, if it did.
        reward: The sum of the rewards of the episode.

    Args:
        name: The name of the environment.
        period: Seconds between samples.
        limit: The time limit in steps.
    """

    observation: Any = None

    def __init__(self, name: str, period: Any, limit: int | None) -> None:  # noqa: ANN401
        self.name, self.period, self.limit = name, period, limit
        self.ended: SystemEnd = ""
        self.end: SystemEnd = ""
        self.error: Exception | None = None
        self.reward = 0.0
        self._values: list[float] = []

    def take(self, values: Any, reward: Any) -> None:  # noqa: ANN401
        """Takes a sample and the reward of its step; None at a reset."""
        self._values, self.end = values.tolist(), ""
        self.reward = 0.0 if reward is None else self.reward + float(reward)

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Has nothing to do: the signals of all environments are read together."""

    def start(self) -> list[float]:
        """Gives sample 0, which was taken before."""
        self.ended, self.error = "", None
        return self._values

    def advance(self) -> list[float]:
        """Gives the sample that was taken last, or raises what that step has raised."""
        if self.error is not None:
            raise self.error
        self.ended = self.end
        return self._values

    def close(self) -> None:
        """Has nothing to close."""
