"""`Runner`: runs cases of one system, one by one or side by side; searches and campaigns use it."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple, Self, Unpack, cast, get_args

import gymnasium as gym
from gymnasium.vector import VectorEnv

import rtamt
from rtamt import InputError, InputTypeError, Period, RtamtError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.arguments import check_choice, check_count, check_number
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.ranges import Parameter, Signal
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.specs import SpecLike, load_specs
from rtamt_gym.options.evaluation import (
    AtTermination,
    EvaluationKeywords,
    Reading,
    checked_options,
    documents_options,
    seconds_of,
)
from rtamt_gym.play.loop import SimulatedTrace
from rtamt_gym.play.native import NativeLanes, lanes_of
from rtamt_gym.play.recorder import failed
from rtamt_gym.play.run import Run
from rtamt_gym.play.run_record import Stop
from rtamt_gym.play.simulation import Simulation, Simulator
from rtamt_gym.results.fingerprint import Fingerprint
from rtamt_gym.results.trial import Trial
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.environment import Environment, monitor_of, with_own_monitor
from rtamt_gym.systems.fingerprints import fingerprint_of
from rtamt_gym.systems.kinds import as_system
from rtamt_gym.systems.policies import SeededPolicy
from rtamt_gym.systems.registry import make
from rtamt_gym.systems.system import Policy, System, no_exit

CaseLike = Mapping[str, float | Waveform]
"""What one simulation is given: a number or a waveform for each name."""


@documents_options("runs")
class Runner:
    """Runs cases of one system under requirements, each to a `Trial`.

    Cases run side by side in lanes where the system is a registered environment with a native
    vector environment that has ``rollout``, its variables read elements of the observation, and no
    ``policy`` is given; otherwise one by one, by `rtamt_gym.simulate`. The rows are equal to the
    last bit, but for their wall times.

    A runner is a context manager, and closes what it has made when it is left.

    Attributes:
        name: The name of the system.
        requirements: The requirements by name.
        signals: What their variables read, as far as it was given.
        reading: How runs are judged.
        inputs: What the system itself says is to be varied; empty where it says nothing.
        duration: The longest duration of a run in seconds, as far as it is known.
        period: Seconds between samples, or as text with a unit; None where they are not known.

    Args:
        system: The id of an environment, or what `rtamt_gym.simulate` takes; several times one
            after the other, so it is neither a `StepMonitor` nor an iterator of samples.
        requirements: The name of one of the system's own (``"AT6a"``), a specification as for
            `rtamt_gym.simulate`, or several; None: all of the system's own.
        signals: As for `rtamt_gym.simulate`.
        policy: As for `rtamt_gym.simulate`.
        policies: In place of ``policy``: makes the policy of a run from the seed of the run.
        duration: As for `rtamt_gym.simulate`.
        stop: As for `rtamt_gym.simulate`. The robustness of a stopped run counts
            the samples until the stop, and its bounds say what it could still have become.
        batch: How many lanes there are at most.
        **reading: How samples are judged, as for `rtamt_gym.simulate`.

    Raises:
        SpecificationError: If a requirement is wrong.
        InputError: If there is no such environment or requirement, or an option is wrong.
        InputTypeError: If the system cannot be run several times.

    Example:
        >>> def tank(inflow):
        ...     level = 1.0
        ...     for _ in range(20):
        ...         yield {"level": level}
        ...         level += inflow - 0.1 * level
        >>> with Runner(tank, {"dry": "always(level < 2)"}, period=1, stop="violation") as runner:
        ...     for number, row in runner.run([{"inflow": 0.1}, {"inflow": 0.3}]):
        ...         print(number, row.ended, round(row.outcomes["dry"].robustness, 3))
        0 terminated 1.0
        1 violation -0.043
    """

    reading: Reading
    signals: Mapping[str, SignalLike] | None
    _ready: Simulator | None

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
        given = checked_options(reading, type(self), "runs")
        check_count(Argument("batch"), batch)
        if duration is not None and duration != math.inf:
            duration = check_number("duration", duration)
        check_system(system)
        self._made = make(system) if isinstance(system, str) else None
        self._system = self._made if self._made is not None else system
        self._policies = policies
        try:
            requirements, self.signals, self.reading = with_own_monitor(
                monitor_of(self._system), requirements, signals, given
            )
            simulation = getattr(self._system, "unwrapped", None)
            ran = as_system(self._system, policy, None, None, None, substeps=False)
            self.name = ran.name
            own = getattr(simulation, "requirements", {})
            self.requirements = load_requirements(requirements, own, self.name)
            self.stop = stop
            self._of_runs: dict[str, Any] = {"policy": policy, "duration": duration, "stop": stop}
            scenario = getattr(simulation, "scenario", None)
            self.inputs: tuple[Signal | Parameter, ...] = getattr(scenario, "inputs", ())
            self.duration = duration_of(ran, duration, self.reading.period)
            self.period = ran.period if self.reading.period is None else self.reading.period
            self._lanes, self._ready = None, None
            if policy is None and policies is None and batch > 1:
                judging = Judging(self.requirements, self.signals, self.reading)
                self._lanes = lanes_of(self._system, judging, duration, stop, batch)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the environments that the runner has made."""
        if self._made is not None:
            self._made.close()
        if getattr(self, "_lanes", None) is not None:
            cast("NativeLanes", self._lanes).close()

    @property
    def system(self) -> Any:  # noqa: ANN401 - MuJoCo is not typed
        """What it runs; of an id, the environment that it has made."""
        return self._system

    @property
    def origin(self) -> Any:  # noqa: ANN401
        """What another process makes the system of."""
        return self._system

    def fingerprint(self) -> Fingerprint:
        """Return hashes and versions of the system, its signals and its policy as they are now."""
        signals = [
            each if callable(each) else each[0]
            for each in (self.signals or {}).values()
            if callable(each) or (isinstance(each, tuple) and callable(each[0]))
        ]
        return fingerprint_of([self.origin, self.system, *signals], self._acting)

    @property
    def _acting(self) -> Sequence[object]:
        """What acts in the system."""
        return [self._of_runs["policy"], self._policies]

    @property
    def options(self) -> Mapping[str, Any]:
        """What every call of `rtamt_gym.simulate` is given."""
        return {"signals": self.signals, **self.reading.options(), **self._of_runs}

    @property
    def arguments(self) -> Mapping[str, Any]:
        """The keyword arguments that make an equal runner of the same system and requirements."""
        more = {} if self._policies is None else {"policies": self._policies}
        return {**self.options, "batch": self.batch, **more}

    @property
    def takes_seeds(self) -> bool:
        """Whether a seed goes to the reset of the system: it is an environment."""
        return isinstance(self._system, gym.Env)

    @property
    def in_lanes(self) -> bool:
        """Whether cases run side by side."""
        return self._lanes is not None

    @property
    def batch(self) -> int:
        """How many cases run side by side at most; 1 if they run one by one."""
        return 1 if self._lanes is None else self._lanes.size

    def run(
        self,
        cases: Iterable[CaseLike],
        seeds: Sequence[int] | None = None,
        *,
        keep: Callable[[int, SimulatedTrace], object] | None = None,
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """Runs cases; gives the row of each with the index of the case, soon after it is over.

        Rows come in another order than cases: a lane that is stopped is given before others. A row
        depends on its case and seed alone. An error of a simulation is in its row, as its type and
        its text, with what the samples before it have left.

        Args:
            cases: What the simulations are given.
            seeds: The seed of the reset of each, of an environment. None: none.
            keep: Is called with the index of a case and its samples before its row is given.
            above: As for `rtamt_gym.simulate`.

        Raises:
            InputError: If there are not as many seeds as cases, or the system takes none.
        """
        task = self._task(cases, seeds, keep, above)
        if task.cases:
            self.check(task.cases[0])
        for indices, lanes in self._groups(task.cases):
            if lanes is None:
                for index in indices:
                    yield index, self._row(task, index)
            else:
                yield from self._batch(lanes, task, indices)

    def whole(
        self, cases: Iterable[CaseLike], seeds: Sequence[int] | None = None
    ) -> Iterator[tuple[int, Trial, SimulatedTrace]]:
        """Runs cases to their end, in lanes without monitors; leaves out those that fail.

        Gives the row of each, without outcomes, and its samples, with the index of the case.

        Raises:
            InputError: As `run` does.
        """
        task = self._task(cases, seeds, None, None)
        for indices, lanes in self._groups(task.cases):
            for each in [indices] if lanes is not None else [[index] for index in indices]:
                found: list[tuple[Trial, SimulatedTrace]] = []
                own, given = [task.cases[i] for i in each], [task.seeds[i] for i in each]
                with suppress(Exception):  # `run` has it in the rows of the cases
                    if lanes is not None:
                        found = lanes.whole(own, given)
                    else:
                        run = self.simulate(own[0], given[0], stop="end")
                        row = replace(run.trial(own[0]), outcomes={})
                        found = [(row, SimulatedTrace(run.signals, run.period))]
                for index, (row, trace) in zip(each, found, strict=False):
                    yield index, row, trace

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
        """Runs one case and keeps every sample; what is given stands in place of its own options.

        Raises:
            RtamtError: As `rtamt_gym.simulate` does.
        """
        simulator = None
        if at_termination is not None:
            reading = self.reading.having(at_termination=at_termination)
            simulator = self._simulator(reading)
        return self._begin(Case(case), seed, above, stop, policy, simulator).go()

    def check(self, case: CaseLike) -> None:
        """Refuses what every simulation would be refused for, before the first.

        A case may change the period, so that what fails without one has to fail with one too.

        Args:
            case: The first case.

        Raises:
            RtamtError: If a signal or a period does not fit, or an option of the reading.
        """
        if self._lanes is None and self._ready is None:
            with no_exit(self.name):
                try:
                    self._ready = self._simulator(self.reading)
                except RtamtError:
                    self._simulator(self.reading, Case(case))

    def _simulator(self, reading: Reading, case: Case | None = None) -> Simulator:
        given, duration = self._of_runs["policy"], self._of_runs["duration"]
        return Simulator(
            self._system,
            self.requirements,
            self.signals,
            reading,
            case=case,
            policy=given,
            duration=duration,
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
        """Begins the simulation of a case."""
        given: Case | None = case
        with no_exit(self.name):
            if simulator is None:
                self.check(case)
                simulator = self._ready
            if simulator is None:
                simulator, given = self._simulator(self.reading, case), None
            if policy is None and self._policies is not None:
                policy = self._policies(seed or 0)
            return simulator.begin(
                given,
                policy=policy,
                seed=seed if self.takes_seeds else None,
                stop=self._of_runs["stop"] if stop is None else stop,
                above=above,
                light=light,
            )

    def judge(self, name: str, trace: SimulatedTrace) -> float:
        """The robustness of a requirement on samples that were kept."""
        spec = self.requirements[name]
        options = self.reading.having(period=trace.period).of_monitors({name: spec})[name]
        heights = rtamt.evaluate(spec, trace.signals, n=trace.samples, **options)
        return float(heights.min() if self.reading.view == "step" else heights[0])

    def _task(
        self,
        cases: Iterable[CaseLike],
        seeds: Sequence[int] | None,
        keep: Callable[[int, SimulatedTrace], object] | None,
        above: Mapping[str, float] | None,
    ) -> _Task:
        listed = [Case(case) for case in cases]
        given: list[int | None] = [None] * len(listed) if seeds is None else list(seeds)
        if len(given) != len(listed):
            raise InputError(f"expected {len(listed)} seeds, one for each case, got {len(given)}")
        if seeds is not None and not self.takes_seeds:
            raise InputError(f"seeds= are for environments, got some for {self.name}")
        return _Task(listed, given, keep, above)

    def _groups(self, cases: Sequence[Case]) -> Iterator[tuple[list[int], NativeLanes | None]]:
        """The indices of cases that run side by side, with their lanes; None: one by one."""
        lanes = self._lanes
        if lanes is None:
            yield list(range(len(cases))), None
            return
        kinds = ((lanes.kind(case), index) for index, case in enumerate(cases))
        for kind, group in groupby(sorted(kinds, key=_sort_key), itemgetter(0)):
            indices = [index for _, index in group]
            if kind is None:
                yield indices, None
                continue
            for begin in range(0, len(indices), lanes.size):
                yield indices[begin : begin + lanes.size], lanes

    def _batch(
        self, lanes: NativeLanes, task: _Task, indices: list[int]
    ) -> Iterator[tuple[int, Trial]]:
        """Runs a batch in lanes; after an error, those that are not over one by one."""
        left = dict.fromkeys(indices)
        keep = None if task.keep is None else _renumbered(task.keep, indices)
        cases, seeds = [task.cases[i] for i in indices], [task.seeds[i] for i in indices]
        try:
            for lane, row in lanes.run(cases, seeds, keep, task.above):
                del left[indices[lane]]
                yield indices[lane], row
        except Exception as error:  # noqa: BLE001 - it stands in the row of the case that has it
            known = False
            for index in left:
                row = self._row(task, index)
                known = known or bool(row.error)
                yield index, row
            if not known:
                warnings.warn(
                    f"lanes of {self.name} raised {type(error).__name__}: {error}; the cases ran "
                    "one by one, which raised nothing",
                    RuntimeWarning,
                    stacklevel=caller_level(),
                )

    def _row(self, task: _Task, index: int) -> Trial:
        case, seed = task.cases[index], task.seeds[index]
        begin = time.perf_counter()
        simulation = None
        try:
            simulation = self._begin(case, seed, task.above, light=task.keep is None)
            simulation.play()
            if task.keep is not None and simulation.run is not None:
                run = simulation.run
                task.keep(index, SimulatedTrace(run.signals, run.period))
            return simulation.trial(case)
        except Exception as error:  # noqa: BLE001 - the row has it
            if simulation is not None:
                return simulation.trial(case, f"{type(error).__name__}: {error}")
            return failed(error, case, seed, time.perf_counter() - begin)


class _Task(NamedTuple):
    """The cases to run with their seeds, who gets their samples, and what is known of them."""

    cases: list[Case]
    seeds: list[int | None]
    keep: Callable[[int, SimulatedTrace], object] | None
    above: Mapping[str, float] | None


def _renumbered(
    keep: Callable[[int, SimulatedTrace], object], indices: list[int]
) -> Callable[[int, SimulatedTrace], object]:
    """Keeps the samples of a lane under the index of its case."""
    return lambda lane, trace: keep(indices[lane], trace)


def _sort_key(item: tuple[str | None, int]) -> tuple[str, int]:
    return item[0] or "", item[1]


Requirements = SpecLike | Sequence[str] | Mapping[str, SpecLike]
"""A requirement or several: the name of one that the system has (``"AT6a"``), a specification as
for `rtamt_gym.simulate`, a sequence of names and texts, or a mapping from names to specifications.
"""


def load_requirements(
    given: Requirements | None, own: Mapping[str, rtamt.Specification], system: str
) -> dict[str, rtamt.Specification]:
    """Loads requirements, by name.

    Args:
        given: What is required; None: all that the system has of its own.
        own: The requirements that the system has, by name.
        system: The name of the system.

    Raises:
        SpecificationError: If a specification is wrong.
        InputError: If none is given and the system has none, or two have one name.
        InputTypeError: If one is no specification.
    """
    if given is None:
        if not own:
            raise InputError(
                f"{system} has no requirements of its own; give them after the system, such as "
                '"always(x < 1)"'
            )
        return dict(own)
    if isinstance(given, Mapping):
        return load_specs({name: _own(spec, own) for name, spec in given.items()})
    if not isinstance(given, Sequence) or isinstance(given, str):
        return _named(given, own, system)
    if not given:
        raise InputError("expected one requirement at least, got none")
    loaded: dict[str, rtamt.Specification] = {}
    for each in given:
        for name, spec in _named(each, own, system).items():
            # Formulas without a name are called "spec", "spec2" and so on.
            new = f"{name}{len(loaded) + 1}" if name in loaded and name == "spec" else name
            if new in loaded:
                raise InputError(f"expected one requirement {new!r}, got two; name them: {{...}}")
            loaded[new] = spec
    return loaded


def _own(spec: Any, own: Mapping[str, rtamt.Specification]) -> Any:  # noqa: ANN401
    return own[spec] if isinstance(spec, str) and spec in own else spec


def _named(
    given: Any,  # noqa: ANN401 - what is no specification is refused
    own: Mapping[str, rtamt.Specification],
    system: str,
) -> dict[str, rtamt.Specification]:
    if isinstance(given, str):
        if given in own:
            return {given: own[given]}
        if given.isidentifier():
            raise InputError(
                f"{system} has no requirement {given!r}; it has {listing(own)}{nearest(given, own)}"
            )
    if isinstance(given, bytes | int | float):
        raise InputTypeError(f"expected the name or the text of a requirement, got {given!r}")
    return load_specs(given)


def check_system(system: object) -> None:
    """Refuses a system that is not the same a second time, or that is many."""
    if isinstance(system, Iterator) or type(system).__name__ == "StepMonitor":
        raise InputTypeError(
            "expected a system that starts anew for each case, such as the id of an environment, "
            f"a pair (model, data) or a function, got {system!r}"
        )
    if isinstance(system, VectorEnv):
        raise InputTypeError(
            f"expected one environment, or its id, got {system}; lanes are made of it where it has "
            "them"
        )
    if isinstance(system, str) and system.endswith(".fmu"):
        raise InputTypeError(
            f"expected a system to run, got the name of a file; write Fmus({system!r})"
        )


def duration_of(ran: System, duration: float | None, period: Period | None) -> float | None:
    """The longest duration of a run: that which is given, or the time limit of an environment."""
    if duration is not None:
        return None if duration == math.inf else duration
    if not isinstance(ran, Environment) or ran.limit is None:
        return None
    step = seconds_of(ran.period if period is None else period)
    return None if step is None else float(step * ran.limit)
