"""`Runner`: runs cases of one system, one by one or side by side; searches and campaigns use it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import groupby
from operator import itemgetter
from typing import Any, Self, Unpack, get_args

import gymnasium as gym
from gymnasium.vector import VectorEnv

import rtamt
from rtamt import InputError, InputTypeError, RtamtError
from rtamt.errors import Argument, nearest
from rtamt.renamed import OldName
from rtamt.typing import Period
from rtamt_gym.checks.arguments import check_choice, check_count, check_number
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.inputs.space import Parameter, Signal
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.specs import SpecLike, load_specs
from rtamt_gym.options.evaluation import (
    AtTermination,
    EvaluationKeywords,
    EvaluationOptions,
    checked_options,
    documents_options,
    seconds_of,
)
from rtamt_gym.play.history import SimulatedTrace, Stop
from rtamt_gym.play.loop import OneByOne, PlayBatch, Played, Task, play
from rtamt_gym.play.native import NativeBatch, NativeRollouts
from rtamt_gym.play.run import Run
from rtamt_gym.play.simulate import Simulator
from rtamt_gym.play.simulation import Simulation, failed
from rtamt_gym.results.provenance import Fingerprint
from rtamt_gym.results.trial import Trial
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.adapters import as_system
from rtamt_gym.systems.environment import Environment, with_own_monitor
from rtamt_gym.systems.fingerprints import fingerprint_of
from rtamt_gym.systems.policies import SeededPolicy
from rtamt_gym.systems.registry import make
from rtamt_gym.systems.system import Policy, System, no_exit
from rtamt_gym.wrappers.monitor import monitor_of

CaseLike = Mapping[str, float | Waveform]
"""The inputs of one simulation: a number or a waveform for each name."""

Requirements = SpecLike | Sequence[str] | Mapping[str, SpecLike]
"""A requirement or several: the name of a requirement of the system (``"AT6a"``), a specification
as for `rtamt_gym.simulate`, a sequence of names and texts, or a mapping from names to
specifications."""


@documents_options("runs")
class Runner:
    """A runner of cases of one system, which returns a `Trial` for each case.

    Scenarios run many cases side by side if variables read elements of the observation and there is
    no policy; other systems run one by one. The rows are equal to the last bit, except for wall
    times. As a context manager, a runner closes the environments that it made.

    Attributes:
        name: The name of the system.
        requirements: The requirements by name.
        signals: The sources of the variables, if they were passed.
        evaluation_options: The evaluation options.
        inputs: The ranges that the system itself varies; empty if it has no ranges.
        duration: The maximum duration of a run in seconds, or None.
        period: The seconds between samples, or text with a unit; None if unknown.

    Args:
        system: The id of an environment, or a system of `simulate` that can be restarted.
        requirements: Names of the system's own requirements (``"AT6a"``), or specifications as for
            `simulate`. Default: all requirements of the system.
        signals: As for `simulate`.
        policy: As for `simulate`.
        policies: In place of ``policy``: a function from the seed of a run to its policy.
        duration: As for `simulate`.
        stop: As for `simulate`. The robustness of a stopped run covers the samples until the stop;
            its bounds contain the robustness of every continuation.
        batch: The maximum number of cases side by side.
        **reading: Evaluation options.

    Raises:
        SpecificationError: If a requirement is wrong.
        InputError: If an environment, a requirement or an option is wrong.
        InputTypeError: If the system cannot be restarted.

    Example:
        >>> with Runner("rtamt/RequestGrant-v0", stop="violation") as runner:
        ...     [(_, row)] = runner.run([{"limit": 1.0}], seeds=[0])
        >>> row.ended, row.outcomes["granted"].robustness
        ('violation', -2.0)
    """

    evaluation_options: EvaluationOptions
    signals: Mapping[str, SignalLike] | None
    _ready: Simulator | None

    reading = OldName("evaluation_options")
    in_lanes = OldName("vectorized")

    def __init__(
        self,
        system: Any,  # noqa: ANN401 - MuJoCo is not typed
        requirements: Requirements | None = None,
        *,
        signals: Mapping[str, SignalLike] | None = None,
        policy: Policy | None = None,
        policies: SeededPolicy | None = None,
        duration: float | None = None,
        stop: Stop = "end",
        batch: int = 100,
        **reading: Unpack[EvaluationKeywords],
    ) -> None:
        check_choice("stop", stop, get_args(Stop))
        options = checked_options(reading, type(self), "runs")
        check_count(Argument("batch"), batch)
        if duration is not None and duration != math.inf:
            duration = check_number("duration", duration)
        _check_system(system)
        self._made = make(system) if isinstance(system, str) else None
        self._system = self._made if self._made is not None else system
        self._policies = policies
        self._rollouts: NativeRollouts | None = None
        self._ready = None
        try:
            requirements, self.signals, self.evaluation_options = with_own_monitor(
                monitor_of(self._system), requirements, signals, options
            )
            simulation = getattr(self._system, "unwrapped", None)
            ran = as_system(self._system, policy)
            self.name = ran.name
            own = getattr(simulation, "requirements", {})
            self.requirements = load_requirements(requirements, own, self.name)
            self.stop = stop
            self._of_runs: dict[str, Any] = {"policy": policy, "duration": duration, "stop": stop}
            scenario = getattr(simulation, "scenario", None)
            self.inputs: tuple[Signal | Parameter, ...] = getattr(scenario, "inputs", ())
            self.duration = _duration_of(ran, duration, self.evaluation_options.period)
            self.period = (
                ran.period
                if self.evaluation_options.period is None
                else self.evaluation_options.period
            )
            if policy is None and policies is None and batch > 1:
                judging = Judging(self.requirements, self.signals, self.evaluation_options)
                self._rollouts = NativeRollouts.of(self._system, judging, duration, stop, batch)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the environments that the runner has made."""
        if self._made is not None:
            self._made.close()
        if self._rollouts is not None:
            self._rollouts.close()

    @property
    def system(self) -> Any:  # noqa: ANN401 - MuJoCo is not typed
        """The system; for an id, the environment that was made."""
        return self._system

    @property
    def origin(self) -> Any:  # noqa: ANN401
        """The object that other processes make the system from."""
        return self._system

    def fingerprint(self) -> Fingerprint:
        """Return hashes and versions of the system, its signals and its policy as they are now."""
        signals = [
            read if callable(read) else read[0]
            for read in (self.signals or {}).values()
            if callable(read) or (isinstance(read, tuple) and callable(read[0]))
        ]
        return fingerprint_of([self.origin, self.system, *signals], self._acting)

    @property
    def _acting(self) -> Sequence[object]:
        """The policy of the system."""
        return [self._of_runs["policy"], self._policies]

    @property
    def options(self) -> Mapping[str, Any]:
        """The options of every call of `rtamt_gym.simulate`."""
        return {"signals": self.signals, **self.evaluation_options.options(), **self._of_runs}

    @property
    def arguments(self) -> Mapping[str, Any]:
        """The keyword arguments that make an equal runner of the same system and requirements."""
        more = {} if self._policies is None else {"policies": self._policies}
        return {**self.options, "batch": self.batch, **more}

    @property
    def takes_seeds(self) -> bool:
        """Whether the system is an environment, with a seed at reset."""
        return isinstance(self._system, gym.Env)

    @property
    def vectorized(self) -> bool:
        """Whether cases run side by side by native rollouts."""
        return self._rollouts is not None

    @property
    def batch(self) -> int:
        """The maximum number of cases that run side by side; 1 if they run one by one."""
        return 1 if self._rollouts is None else self._rollouts.size

    def run(
        self,
        cases: Iterable[CaseLike],
        seeds: Sequence[int] | None = None,
        *,
        keep: Callable[[int, SimulatedTrace], object] | None = None,
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """Run cases; yield the row of each with the index of the case, soon after it is over.

        Rows may come in another order than cases. A row depends only on its case and seed. An error
        of a simulation is in its row, as its type and text, with the results of the samples before
        it.

        Args:
            cases: The inputs of the simulations.
            seeds: The seed of each reset, for an environment. None: no seeds.
            keep: Called with the index of a case and its samples before its row is yielded.
            above: As for `rtamt_gym.simulate`.

        Raises:
            InputError: If there are not as many seeds as cases, or the system takes none.
        """
        tasks = self._tasks(cases, seeds)
        for task, trial, episode in self._play(tasks, above, keeps=keep is not None):
            if keep is not None and not trial.error and episode is not None:
                trace = episode.trace
                if trace is not None:
                    keep(task.number, trace)
            yield task.number, trial

    def whole(
        self, cases: Iterable[CaseLike], seeds: Sequence[int] | None = None
    ) -> Iterator[tuple[int, Trial, SimulatedTrace]]:
        """Run cases to their end, by native rollouts without monitors; leave out errors.

        Yields:
            The index of the case, its row without outcomes, and its samples.

        Raises:
            InputError: As `run` does.
        """
        for group, rollouts in self._groups(self._tasks(cases, seeds)):
            batch = self._one_by_one(None, stop="end")
            if rollouts is not None:
                batch = NativeBatch(rollouts, len(group), None, keeps=True)
            with suppress(Exception):  # `run` reports it in the rows of the cases
                for task, trial, episode in play(batch, group):
                    if not trial.error and episode is not None and episode.trace is not None:
                        yield task.number, replace(trial, outcomes={}), episode.trace

    def simulate(
        self,
        case: CaseLike,
        seed: int | None = None,
        above: Mapping[str, float] | None = None,
        stop: Stop | None = None,
        *,
        policy: Policy | None = None,
        at_termination: AtTermination | None = None,
    ) -> Run:
        """Run one case and keep every sample; the arguments replace the options of the runner.

        Raises:
            RtamtError: As `rtamt_gym.simulate` does.
        """
        simulator = None
        if at_termination is not None:
            reading = self.evaluation_options.having(at_termination=at_termination)
            simulator = self._simulator(reading)
        simulation = self._begin(Case(case), seed, above, stop, policy, simulator)
        simulation.play()
        assert simulation.run is not None, "the run was asked for"  # noqa: S101 - for mypy
        return simulation.run

    def check(self, case: CaseLike) -> None:
        """Raise the errors of every simulation, before the first simulation.

        The first case may change the period, so an error without a case must also occur with it.
        """
        if self._rollouts is None and self._ready is None:
            with no_exit(self.name):
                try:
                    self._ready = self._simulator(self.evaluation_options)
                except RtamtError:
                    self._simulator(self.evaluation_options, Case(case))

    def judge(self, name: str, trace: SimulatedTrace) -> float:
        """Return the robustness of a requirement on recorded samples."""
        spec = self.requirements[name]
        reading = self.evaluation_options.having(period=trace.period)
        options = reading.from_monitors({name: spec})[name]
        values = rtamt.evaluate(spec, trace.signals, n=trace.samples, **options)
        return float(values.min() if self.evaluation_options.view == "step" else values[0])

    def _simulator(
        self,
        reading: EvaluationOptions,
        case: Case | None = None,
        env: gym.Env[Any, Any] | None = None,
    ) -> Simulator:
        """Return a simulator of the system, or of another environment like it."""
        return Simulator(
            self._system if env is None else env,
            self.requirements,
            self.signals,
            reading,
            case=case,
            policy=self._of_runs["policy"],
            duration=self._of_runs["duration"],
        )

    def _begin(
        self,
        case: Case,
        seed: int | None,
        above: Mapping[str, float] | None,
        stop: Stop | None = None,
        policy: Policy | None = None,
        simulator: Simulator | None = None,
        *,
        light: bool = False,
    ) -> Simulation:
        """Start the simulation of a case."""
        own: Case | None = case
        with no_exit(self.name):
            if simulator is None:
                self.check(case)
                simulator = self._ready
            if simulator is None:
                simulator, own = self._simulator(self.evaluation_options, case), None
            if policy is None and self._policies is not None:
                policy = self._policies(seed or 0)
            return simulator.begin(
                own,
                policy=policy,
                seed=seed if self.takes_seeds else None,
                stop=self._of_runs["stop"] if stop is None else stop,
                above=above,
                light=light,
            )

    def _tasks(self, cases: Iterable[CaseLike], seeds: Sequence[int] | None) -> list[Task]:
        listed = [Case(case) for case in cases]
        if seeds is not None and len(seeds) != len(listed):
            raise InputError(f"expected {len(listed)} seeds, one for each case, got {len(seeds)}")
        if seeds is not None and not self.takes_seeds:
            raise InputError(f"seeds= are for environments, got some for {self.name}")
        return [Task(i, case, seeds[i] if seeds else None) for i, case in enumerate(listed)]

    def _play(
        self, tasks: Sequence[Task], above: Mapping[str, float] | None, *, keeps: bool
    ) -> Iterator[Played]:
        """Play tasks; `keeps` asks for their samples."""
        if tasks:
            self.check(tasks[0].case)
        for group, rollouts in self._groups(tasks):
            if rollouts is None:
                yield from play(self._one_by_one(above, light=not keeps), group)
            else:
                batch = NativeBatch(rollouts, len(group), above or {}, keeps=keeps)
                yield from self._played(batch, group, above, light=not keeps, warns=True)

    def _alone(
        self, task: Task, above: Mapping[str, float] | None, *, light: bool
    ) -> Iterator[Played]:
        """Play one task while no other task runs."""
        return play(self._one_by_one(above, light=light), [task])

    def _one_by_one(
        self, above: Mapping[str, float] | None, stop: Stop | None = None, *, light: bool = False
    ) -> PlayBatch:
        return OneByOne(lambda task: self._begin(task.case, task.seed, above, stop, light=light))

    def _groups(
        self, tasks: Sequence[Task]
    ) -> Iterator[tuple[Sequence[Task], NativeRollouts | None]]:
        """Yield tasks that run side by side, with their rollouts; None: one by one."""
        rollouts = self._rollouts
        if rollouts is None:
            yield tasks, None
            return
        kinds = sorted(
            ((rollouts.kind(task.case) or "", task.number, task) for task in tasks),
            key=itemgetter(0, 1),
        )
        for kind, entries in groupby(kinds, itemgetter(0)):
            group = [task for _, _, task in entries]
            if not kind:
                yield group, None
                continue
            for start in range(0, len(group), rollouts.size):
                yield group[start : start + rollouts.size], rollouts

    def _played(
        self,
        batch: PlayBatch,
        tasks: Sequence[Task],
        above: Mapping[str, float] | None,
        *,
        light: bool,
        warns: bool = False,
    ) -> Iterator[Played]:
        """Play tasks in a batch; after an error of the batch, play the remaining tasks alone."""
        left = {task.number: task for task in tasks}
        try:
            for played in play(batch, tasks):
                del left[played.task.number]
                yield played
        except (Exception, SystemExit) as error:  # noqa: BLE001 - the row of its episode has it
            known = False
            for task in left.values():
                try:
                    (again,) = self._alone(task, above, light=light)
                except Exception as own:  # noqa: BLE001
                    again = Played(task, failed(own, task.case, task.seed, 0.0), None)
                known = known or bool(again.trial.error)
                yield again
            if warns and not known:
                warnings.warn(
                    f"the vector environment of {self.name} raised {type(error).__name__}: "
                    f"{error}; the cases ran one by one without an error",
                    RuntimeWarning,
                    stacklevel=caller_level(),
                )


def _check_system(system: object) -> None:
    """Raise InputTypeError if a system cannot be restarted or is a vector environment."""
    if isinstance(system, Iterator) or type(system).__name__ == "StepMonitor":
        raise InputTypeError(
            "expected a system that restarts for each case, such as the id of an environment, a "
            f"pair (model, data) or a function, got {system!r}"
        )
    if isinstance(system, VectorEnv):
        raise InputTypeError(
            f"expected one environment, or its id, got {system}; pass its id, and the search "
            "vectorizes it if it can"
        )
    if isinstance(system, str) and system.endswith(".fmu"):
        raise InputTypeError(
            f"expected a system to run, got the name of a file; write Fmus({system!r})"
        )


def _duration_of(ran: System, duration: float | None, period: Period | None) -> float | None:
    """Return the maximum duration of a run: the argument, or the limit of an environment."""
    if duration is not None:
        return None if duration == math.inf else duration
    if not isinstance(ran, Environment) or ran.limit is None:
        return None
    step = seconds_of(ran.period if period is None else period)
    return None if step is None else float(step * ran.limit)


def load_requirements(
    requirements: Requirements | None, own: Mapping[str, rtamt.Specification], system: str
) -> dict[str, rtamt.Specification]:
    """Load requirements, by name; None: all requirements of the system."""
    if requirements is None:
        if not own:
            raise InputError(
                f"{system} has no requirements of its own; give them after the system, such as "
                '"always(x < 1)"'
            )
        return dict(own)
    if isinstance(requirements, Mapping):
        return load_specs(
            {
                name: own[spec] if isinstance(spec, str) and spec in own else spec
                for name, spec in requirements.items()
            }
        )
    if not isinstance(requirements, Sequence) or isinstance(requirements, str):
        return _named_requirements(requirements, own, system)
    if not requirements:
        raise InputError("expected at least one requirement, got none")
    loaded: dict[str, rtamt.Specification] = {}
    for entry in requirements:
        for name, spec in _named_requirements(entry, own, system).items():
            # Formulas without a name are called "spec", "spec2" and so on.
            new = f"{name}{len(loaded) + 1}" if name in loaded and name == "spec" else name
            if new in loaded:
                raise InputError(f"expected one requirement {new!r}, got two; name them: {{...}}")
            loaded[new] = spec
    return loaded


def _named_requirements(
    requirement: Any,  # noqa: ANN401 - other types are refused
    own: Mapping[str, rtamt.Specification],
    system: str,
) -> dict[str, rtamt.Specification]:
    if isinstance(requirement, str):
        if requirement in own:
            return {requirement: own[requirement]}
        if requirement.isidentifier():
            raise InputError(
                f"{system} has no requirement {requirement!r}; it has {listing(own)}"
                f"{nearest(requirement, own)}"
            )
    if isinstance(requirement, bytes | int | float):
        raise InputTypeError(f"expected the name or the text of a requirement, got {requirement!r}")
    return load_specs(requirement)
