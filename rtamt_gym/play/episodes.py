"""Episodes of a policy: `Episodes` in an environment, `VectorEpisodes` in a vector environment."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
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
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_count
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.specs import own_requirements, with_unknown_start
from rtamt_gym.options.evaluation import (
    AtTermination,
    EvaluationOptions,
    checked_options,
    seconds_of,
)
from rtamt_gym.play.history import Stop
from rtamt_gym.play.loop import PlayBatch, Played, SideBySide, Task, play
from rtamt_gym.play.run import Run
from rtamt_gym.play.runner import CaseLike, Requirements, Runner, load_requirements
from rtamt_gym.play.simulate import Simulator
from rtamt_gym.play.simulation import Simulation
from rtamt_gym.signals.columns import SignalColumns
from rtamt_gym.signals.periods import (
    StepTime,
    StepTimes,
    ask_another,
    read_period,
    warn_of_unverified_period,
)
from rtamt_gym.signals.signals import own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.signals.taps import VectorTap, rescaling, tapped
from rtamt_gym.systems.environment import with_own_monitor
from rtamt_gym.systems.policies import Model, PolicyBatch, SeededPolicy, evaluated
from rtamt_gym.systems.system import Policy, Signals, System, SystemEnd, no_exit
from rtamt_gym.wrappers.monitor import monitor_of
from rtamt_gym.wrappers.vector_forms import autoreset_mode, final_infos, final_observations
from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor

Vector = VectorEnv[Any, Any, Any]
Mask = NDArray[np.bool_]


_WAVES = 8
"""The number of episodes per environment that a worker gets at once."""


class Episodes(Runner):
    """Plays episodes of a policy in an environment, one by one or side by side.

    A deterministic model acts in ``n_envs`` episodes at once, each in its own environment.

    Attributes:
        evaluated: The policy.
        unasked: Whether ``at_termination`` was not given.
        monitor: The monitor of the environment, or None.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any] | Callable[[], gym.Env[Any, Any]],
        requirements: Requirements | None = None,
        *,
        policy: Any,  # noqa: ANN401
        deterministic: bool = True,
        n_envs: int = 1,
        first: gym.Env[Any, Any] | None = None,
        **options: Any,  # noqa: ANN401 - as for `Runner`
    ) -> None:
        self._n_envs = check_count(Argument("n_envs"), n_envs)
        self._given = env
        self._envs: list[gym.Env[Any, Any]] = []
        self._simulators: list[Simulator] = []  # of the first environments
        first = first or (env if isinstance(env, gym.Env) else env())
        self.evaluated = evaluated(policy, first, deterministic=deterministic)
        options = {"batch": n_envs, **options}
        self.monitor = monitor_of(first)
        super().__init__(first, requirements, policies=self.evaluated.make, **options)
        self.unasked = self.evaluation_options.at_termination is None
        if self.unasked:  # every episode would warn
            self.evaluation_options = self.evaluation_options.having(at_termination="complete")
        if self._model is not None and n_envs > 1:
            self._envs = [first, self._another()]

    @property
    def arguments(self) -> Mapping[str, Any]:
        """As `Runner.arguments`."""
        own = {**super().arguments, "policy": self.evaluated, "n_envs": self._n_envs}
        own.pop("policies", None)
        return own

    @property
    def origin(self) -> Any:  # noqa: ANN401
        """As `Runner.origin`: the function that makes the environment, if there is one."""
        return self._given

    @property
    def batch(self) -> int:
        """The minimum number of episodes that a worker gets at once."""
        return self._n_envs * _WAVES if self._envs else super().batch

    def close(self) -> None:
        """Close the environments made here: all but the first, which `Runner.close` closes."""
        for env in self._envs[1:]:
            env.close()
        super().close()

    def _play(
        self, tasks: Sequence[Task], above: Mapping[str, float] | None, *, keeps: bool
    ) -> Iterator[Played]:
        model = self._model
        if not self._envs or model is None or keeps:
            yield from super()._play(tasks, above, keeps=keeps)
            return
        size = min(self._n_envs, len(tasks))
        while len(self._envs) < size:
            self._envs.append(self._another())
        for env in self._envs[len(self._simulators) : size]:
            self._simulators.append(self._simulator(self.evaluation_options, env=env))

        def begin(place: int, task: Task, policy: Policy) -> Simulation:
            simulator = self._simulators[place]
            return self._begin(task.case, task.seed, above, None, policy, simulator, light=True)

        batch = SideBySide(size, begin, model, self.system.observation_space)
        yield from self._played(batch, tasks, above, light=True)

    @property
    def _model(self) -> Model | None:
        """The model that can act in many episodes at once, or None."""
        make = self.evaluated.make
        return make if isinstance(make, Model) and make.deterministic else None

    def _another(self) -> gym.Env[Any, Any]:
        """Make another environment like the first."""
        if not isinstance(self._given, gym.Env):
            return self._given()
        spec = self._given.spec
        wrappers = spec.additional_wrappers if spec else ()
        missing = [wrapper.name for wrapper in wrappers if wrapper.kwargs is None]
        if spec is None or missing:
            phrase = f"the wrapper {missing[0]} of {self.name}" if missing else self.name
            raise InputError(
                Argument("n_envs", self._n_envs),
                f" needs as many environments, and {phrase} cannot be constructed again; pass a "
                "function that makes the environment",
            )
        return gym.make(spec)


class VectorEpisodes(Runner):
    """Plays episodes in the environments of a vector environment, each with its own seed.

    A vector environment that resets by itself plays waves: a reset with seeds, and steps until all
    episodes of this reset are over, so that short episodes are not played more often. If single
    environments can be reset, a place starts its next episode as soon as the last one is over.
    """

    def __init__(
        self,
        env: Vector | Callable[[], Vector],
        requirements: Requirements | None = None,
        *,
        policy: Any,  # noqa: ANN401
        deterministic: bool = True,
        first: Vector | None = None,
        **options: Any,  # noqa: ANN401 - as for `Runner`
    ) -> None:
        self._given = env
        self._env: Vector = first or (env if isinstance(env, VectorEnv) else env())
        self.monitor = _monitor_of(self._env)
        self._inside: Vector = self._env if self.monitor is None else self.monitor.env
        stop, duration = options.pop("stop", "end"), options.pop("duration", None)
        signals = options.pop("signals", None)
        evaluation_options = checked_options(options, type(self), "episodes")
        requirements, self.signals, reading = with_own_monitor(
            self.monitor, requirements, signals, evaluation_options
        )
        spec = self._env.spec
        self.name = spec.id if spec else type(self._env.unwrapped).__name__
        own = own_requirements(self._env)
        self._check_resets()
        self.requirements = load_requirements(requirements, own, self.name)
        timed = any(requirement.timed for requirement in self.requirements.values())
        if timed and reading.period is None and self.monitor is None:
            warn_of_unverified_period(self._env)
        self.period = reading.period or read_period(self._env) or ask_another(self._env)
        self.inputs = ()
        limit = spec.max_episode_steps if spec else None
        step = seconds_of(self.period)
        self._times = StepTimes(self._env, self._comparison(step, reading, timed=timed))
        self.duration = duration or (None if limit is None or step is None else float(step * limit))
        self.unasked = reading.at_termination is None
        self.evaluation_options = reading.having(
            at_termination=reading.at_termination or "complete", period=self.period
        )
        self.stop: Stop = stop
        self._of_runs: dict[str, Any] = {"duration": duration, "stop": stop}
        if isinstance(policy, str) and policy == "baseline":
            raise InputError(
                "the policy baseline is for one environment; give the id of the environment with "
                f"n_envs={self._env.num_envs}"
            )
        single: Any = SimpleNamespace(
            observation_space=self._env.single_observation_space,
            action_space=self._env.single_action_space,
            unwrapped=None,
            spec=spec,
        )
        self.evaluated = evaluated(policy, single, deterministic=deterministic)
        self._bind_signals()
        self._places = [Place(self.name, self.period, limit) for _ in range(self._env.num_envs)]
        self._simulators = self._simulators_of(self._judged)

    def _bind_signals(self) -> None:
        """Bind the signals of all environments together."""
        specs = self.requirements.values()
        variables = list(dict.fromkeys(name for spec in specs for name in spec.variables))
        known = {**own_signals(self._inside)}
        if self.monitor is not None:
            known |= self.monitor.judging.signals or {}
        read = {**known, **(self.signals or {})}
        self._judged, refuse_nan = with_unknown_start(
            self.evaluation_options, {name: read.get(name) for name in variables}
        )
        parsed = parse_signals(
            self.signals or {}, variables, SOURCES, extra=True, own=known, refuse_nan=refuse_nan
        )
        same_step = autoreset_mode(self._env) is AutoresetMode.SAME_STEP
        self._rescaler = rescaling(
            self._inside,
            parsed,
            below=self.evaluation_options.below,
            rescaled=self.evaluation_options.rescaled,
        )
        read_in = self._inside if self._rescaler is None else self._rescaler.env
        self._columns = SignalColumns(parsed, read_in, same_step=same_step)

    def _comparison(
        self, period: Fraction | None, reading: EvaluationOptions, *, timed: bool
    ) -> Callable[[Any], StepTime] | None:
        """Return a check of the period against an environment; None if a monitor inside has it."""
        if period is None or self.monitor is not None:
            return None

        def compare(env: Any) -> StepTime:  # noqa: ANN401 - one, or many
            was_read, stated = reading.period is None, read_period(env)
            return StepTime(
                env, float(period), read_period, was_read=was_read, timed=timed, stated=stated
            )

        return compare

    def _simulators_of(self, reading: EvaluationOptions) -> list[Simulator]:
        first, *others = self._places
        duration = self._of_runs["duration"]
        read = reading.having(below=False)  # the signals of all environments are read together
        simulator = Simulator(first, self.requirements, None, read, duration=duration)
        return [simulator, *(simulator.of(position) for position in others)]

    @property
    def _acting(self) -> Sequence[object]:
        return [self.evaluated.make]

    def check(self, case: CaseLike) -> None:
        """Do nothing: the constructor has checked everything."""

    def close(self) -> None:
        """Leave the environment open: it belongs to the caller."""

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
        """Play one episode and keep every sample, as `Runner.simulate` does."""
        simulators = self._simulators
        if at_termination is not None:
            simulators = self._simulators_of(self._judged.having(at_termination=at_termination))
        when: Stop = self._of_runs["stop"] if stop is None else stop
        batch = self._batch(simulators, when, above, light=False)
        ((_, trial, episode),) = play(batch, [Task(0, Case(case), seed)])
        if trial.error or episode is None:
            raise StateError(f"expected an episode as it was before, got {trial.error}")
        run: Run = episode.run
        return replace(run, seed=seed)

    def _play(
        self, tasks: Sequence[Task], above: Mapping[str, float] | None, *, keeps: bool
    ) -> Iterator[Played]:
        light = not keeps
        batch = self._batch(self._simulators, self._of_runs["stop"], above, light=light)
        yield from self._played(batch, tasks, above, light=light)

    def _alone(
        self, task: Task, above: Mapping[str, float] | None, *, light: bool
    ) -> Iterator[Played]:
        batch = self._batch(self._simulators, self._of_runs["stop"], above, light=light)
        with no_exit(self.name):
            played = list(play(batch, [task]))
        return iter(played)

    def _batch(
        self,
        simulators: Sequence[Simulator],
        stop: Stop,
        above: Mapping[str, float] | None,
        *,
        light: bool,
    ) -> VectorBatch:
        taps, tap = ExitStack(), None
        if self.monitor is not None:
            tap = VectorTap(self._inside)
            taps.enter_context(self.monitor.tapped(tap))
        if self._rescaler is not None:
            inner = self._rescaler.env
            tap = tapped(self._rescaler)
            taps.callback(setattr, self._rescaler, "env", inner)
        make = self.evaluated.make
        assert make is not None, "the baseline was refused"  # noqa: S101 - for mypy

        def begin(place: int) -> Simulation:
            return simulators[place].begin(stop=stop, above=above, light=light)

        return VectorBatch(
            self._env, make, self._columns, self._places, begin, self._times, tap, taps
        )

    def _check_resets(self) -> None:
        """Raise InputError if places do not take their own seeds, or have monitors inside."""
        try:
            _, infos = self._inside.reset(seed=[0] * self._env.num_envs)  # type: ignore[arg-type]  # a seed for each
        except (gym.error.Error, TypeError) as error:
            raise InputError(
                "expected a vector environment that takes a seed for each of its environments, so "
                f"that every episode can be played again, got {self._env.unwrapped}, which takes "
                f"one for all; give {self.name!r} with n_envs={self._env.num_envs}, or "
                "gym.make_vec(..., vectorization_mode='sync')"
            ) from error
        if "stl_lower" in infos:  # they might end episodes without notice
            raise InputError(
                f"expected environments without monitors in {self._env.unwrapped}, got some with; "
                f"pass the function that makes one environment with n_envs={self._env.num_envs}, "
                "or put a VectorStlMonitor around all"
            )


class VectorBatch(PlayBatch):
    """The environments of a vector environment, which step together.

    A place without a task repeats the action of another one.
    """

    def __init__(
        self,
        env: Vector,
        make: SeededPolicy,
        columns: SignalColumns,
        places: Sequence[Place],
        begin: Callable[[int], Simulation],
        times: StepTimes,
        tap: VectorTap | None,
        taps: ExitStack,
    ) -> None:
        self.size = len(places)
        self._env, self._make, self._columns, self._places = env, make, columns, places
        self._begin, self._times, self._tap, self._taps = begin, times, tap, taps
        self._mode = autoreset_mode(env)
        self._fresh = True  # the next reset is of all environments
        self._ended: Mask = np.zeros(self.size, np.bool_)
        self._acting: _Acting
        self._obs: Any = None

    def free(self, running: Collection[int]) -> Sequence[int]:
        if not running:
            self._fresh = self._fresh or self._mode is not AutoresetMode.DISABLED
        elif self._fresh or self._mode is not AutoresetMode.DISABLED:
            return ()
        return super().free(running)

    def start(self, tasks: Mapping[int, Task]) -> None:
        if self._fresh:
            self._acting = _Acting(self._env, self._make)
            self._fresh = False
            self._reset(np.ones(self.size, np.bool_), tasks, {})
        else:
            mask = self._ended | np.isin(np.arange(self.size), [*tasks])
            self._reset(mask, tasks, {"reset_mask": mask})

    def begin(self, place: int, task: Task) -> Simulation:
        self._acting.begin(place, task.seed)
        return self._begin(place)

    def step(self, running: Sequence[int]) -> float:
        """Step all environments; if one episode is running, an error of the step belongs to it."""
        if self._mode is AutoresetMode.DISABLED and self._ended.any():
            mask = self._ended
            self._reset(mask, {}, {"reset_mask": mask})
        begun = None
        if self._mode is AutoresetMode.NEXT_STEP and self._ended.any():
            begun = self._ended
        with no_exit("the policy"):
            actions = self._acting.act(self._obs, running)
        try:
            with no_exit("an environment"):
                result = self._env.step(actions)
            ended: Mask = np.logical_or(result[2], result[3])
            self._times.step(ended if self._mode is AutoresetMode.SAME_STEP else begun)
        except Exception as error:
            if len(running) > 1:
                raise
            self._places[running[0]].error = error
            return 0.0
        self._obs, terminated = result[0], result[2]
        if self._tap is not None:
            actions, result = self._tap.actions, self._tap.result
        table = self._read(result, actions, begun)
        for position in running:
            self._places[position].take(table[position], result[1][position])
            if ended[position]:
                self._places[position].end = "terminated" if terminated[position] else "truncated"
        self._ended = ended
        return 0.0

    def close(self) -> None:
        self._taps.close()

    def _reset(self, mask: Mask, tasks: Mapping[int, Task], options: dict[str, Any]) -> None:
        """Reset the environments of a mask; those with tasks get their seeds."""
        seeds = [
            tasks[position].seed if position in tasks else None for position in range(self.size)
        ]
        if tasks:
            first = next(iter(tasks.values())).seed
            seeds = [first if seed is None else seed for seed in seeds]
        shown: Any = self._env.reset(seed=seeds, options=options)  # type: ignore[arg-type]  # a seed for each
        self._obs = shown[0]
        self._times.begin(mask)
        observations, infos = shown if self._tap is None else self._tap.shown
        table = self._columns.reset(observations, infos, mask)
        self._ended = np.zeros(self.size, np.bool_)
        for position in tasks:
            self._places[position].take(table[position], None)

    def _read(self, result: Any, actions: Any, begun: Mask | None) -> Any:  # noqa: ANN401
        """Return the signals after a step, also of the episodes that the step has ended."""
        obs, rewards, terminated, truncated, infos = result
        ended = np.logical_or(terminated, truncated)
        if self._mode is AutoresetMode.SAME_STEP and ended.any():
            if self._columns.reads_obs:
                space = (self._env if self._tap is None else self._tap).single_observation_space
                obs = final_observations(space, obs, infos, ended)
            if self._columns.reads_info:
                infos = final_infos(infos, ended)
        return self._columns.step(obs, actions, rewards, infos, begun)


class Place(System):
    """One environment of a vector environment as a system; its last step is in the attributes."""

    observation: Any = None

    def __init__(self, name: str, period: Any, limit: int | None) -> None:  # noqa: ANN401
        self.name, self.period, self.limit = name, period, limit
        self.ended: SystemEnd = ""
        self.end: SystemEnd = ""
        self.error: Exception | None = None
        self.reward = 0.0
        self._values: list[float] = []

    def take(self, values: Any, reward: Any) -> None:  # noqa: ANN401
        """Take a sample and the reward of its step; None at a reset."""
        self._values, self.end = values.tolist(), ""
        self.reward = 0.0 if reward is None else self.reward + float(reward)

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Do nothing: the signals of all environments are read together."""

    def start(self) -> list[float]:
        """Return sample 0, which was taken before."""
        self.ended, self.error = "", None
        return self._values

    def advance(self) -> list[float]:
        """Return the last sample, or raise the error of the last step."""
        if self.error is not None:
            raise self.error
        self.ended = self.end
        return self._values

    def close(self) -> None:
        """Do nothing."""


class _Acting:
    """Acts in the environments of a vector environment, from a reset of all on."""

    def __init__(self, env: Vector, make: SeededPolicy) -> None:
        self._make = make
        self._observations, self._space = env.observation_space, env.single_action_space
        self._policies: list[Policy | None] = [None] * env.num_envs
        self._batch: PolicyBatch | None = None
        if isinstance(make, Model) and make.deterministic:
            self._batch = make.batch(env.single_observation_space, env.num_envs)

    def begin(self, place: int, seed: int | None) -> None:
        """Start an episode."""
        if self._batch is not None:
            self._batch.begin(place)
        else:
            self._policies[place] = self._make(seed or 0)

    def act(self, observations: Any, running: Sequence[int]) -> Any:  # noqa: ANN401
        """Return the actions; a place without an episode repeats the action of another place."""
        if self._batch is not None:
            return self._batch.of(observations)
        shown = list(iterate(self._observations, observations))
        policies: Any = self._policies
        own = {position: policies[position](shown[position]) for position in running}
        actions = [own.get(position, own[running[0]]) for position in range(len(shown))]
        room: Any = create_empty_array(self._space, len(actions))
        return concatenate(self._space, actions, room)


def _monitor_of(env: Any) -> VectorStlMonitor | None:  # noqa: ANN401
    while isinstance(env, VectorWrapper):
        if isinstance(env, VectorStlMonitor):
            return env
        env = env.env
    return None
