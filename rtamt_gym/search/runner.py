"""`Runner`: runs cases of one system, one by one or side by side; searches and campaigns use it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple, Self, TypedDict, Unpack, cast, get_args

import gymnasium as gym
from gymnasium.vector import VectorEnv

import rtamt
from rtamt import InputError, InputTypeError
from rtamt_gym.checks.arguments import check_choice, check_count, check_number
from rtamt_gym.checks.names import listing, nearest
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.ranges import Parameter, Signal
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.judges.ends import AtTermination, AtTruncation
from rtamt_gym.judges.interface import Interface, Names, Semantics
from rtamt_gym.judges.panel import Panel
from rtamt_gym.judges.specs import Align, Nan, View, read_period
from rtamt_gym.search.lanes import Judging, Lanes
from rtamt_gym.search.requirements import Requirements, load_requirements
from rtamt_gym.search.rows import Row
from rtamt_gym.search.trace import Trace
from rtamt_gym.signals.signals import Element, SignalLike, own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.simulation.environments import make
from rtamt_gym.simulation.record import Stop
from rtamt_gym.simulation.run import Run
from rtamt_gym.simulation.simulate import simulate
from rtamt_gym.simulation.systems import Policy

__all__ = ["CaseLike", "Options", "Runner"]

CaseLike = Mapping[str, float | Waveform]
"""What one simulation is given: a number or a waveform for each name."""


class Options(TypedDict, total=False):
    """How runs are judged: options of `rtamt_gym.simulate`, which describes them."""

    view: View
    nan: Nan
    align: Align | None
    semantics: Semantics
    inputs: Names | None
    outputs: Names | None
    at_termination: AtTermination | None
    at_truncation: AtTruncation


class Runner:
    """Runs cases of one system under requirements, each to a `Row`.

    Cases run side by side in lanes where the system is a registered environment with a native
    vector environment that has ``rollout``, its variables read elements of the observation, and no
    ``policy`` is given; otherwise one by one, by `rtamt_gym.simulate`. The rows are equal to the
    last bit, but for their wall times.

    A runner is a context manager, and closes what it has made when it is left.

    Attributes:
        name: The name of the system.
        requirements: The requirements by name.
        inputs: What the system itself says is to be varied; empty where it says nothing.
        duration: The longest duration of a run in seconds, as far as it is known.

    Args:
        system: The id of an environment, or what `rtamt_gym.simulate` takes; several times one
            after the other, so it is neither a `StepMonitor` nor an iterator of samples.
        requirements: The name of one of the system's own (``"AT6a"``), a specification as for
            `rtamt_gym.simulate`, or several; None: all of the system's own.
        signals: As for `rtamt_gym.simulate`.
        policy: As for `rtamt_gym.simulate`.
        duration: As for `rtamt_gym.simulate`.
        period: As for `rtamt_gym.simulate`.
        stop: As for `rtamt_gym.simulate`. The robustness of a stopped run is that at the stop,
            and its bounds say what it could still have become.
        batch: How many lanes there are at most.
        **options: Further options of `rtamt_gym.simulate`, see `Options`.

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

    def __init__(
        self,
        system: Any,  # noqa: ANN401 - MuJoCo is not typed
        requirements: Requirements | None = None,
        *,
        signals: Mapping[str, SignalLike] | None = None,
        policy: Policy | None = None,
        duration: float | None = None,
        period: float | str | None = None,
        stop: Stop = "end",
        batch: int = 100,
        **options: Unpack[Options],
    ) -> None:
        check_choice("stop", stop, get_args(Stop))
        _check_options(options)
        check_count("batch=", batch)
        if duration is not None and duration != math.inf:
            duration = check_number("duration", duration)
        _check_system(system)
        self._made = make(system) if isinstance(system, str) else None
        self._system = self._made if self._made is not None else system
        try:
            simulation = getattr(self._system, "unwrapped", None)
            self.name = _name_of(self._system)
            own = getattr(simulation, "requirements", {})
            self.requirements = load_requirements(requirements, own, self.name)
            self._simulated = {
                "signals": signals,
                "policy": policy,
                "duration": duration,
                "period": period,
                "stop": stop,
            } | options
            scenario = getattr(simulation, "scenario", None)
            self.inputs: tuple[Signal | Parameter, ...] = getattr(scenario, "inputs", ())
            self.duration = _duration_of(self._system, duration)
            judging = Judging(
                stop,
                options.get("view", "episode"),
                options.get("nan", "raise"),
                options.get("align"),
                Interface(
                    options.get("semantics", "standard"),
                    options.get("inputs"),
                    options.get("outputs"),
                ),
                options.get("at_truncation", "cut"),
            )
            self._lanes = None
            if policy is None and batch > 1:
                self._lanes = _lanes(
                    self._system, self.requirements, signals, duration, period, judging, batch
                )
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
            cast("Lanes", self._lanes).close()

    @property
    def system(self) -> Any:  # noqa: ANN401 - MuJoCo is not typed
        """What it runs; of an id, the environment that it has made."""
        return self._system

    @property
    def options(self) -> Mapping[str, Any]:
        """What every call of `rtamt_gym.simulate` is given."""
        return {**self._simulated}

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
        keep: Callable[[int, Trace], object] | None = None,
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Row]]:
        """Runs cases; gives the row of each with the index of the case, soon after it is over.

        The order is not that of the cases: a lane that is stopped is given before others. A row
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
        listed = [Case(case) for case in cases]
        given: list[int | None] = [None] * len(listed) if seeds is None else list(seeds)
        if len(given) != len(listed):
            raise InputError(f"expected {len(listed)} seeds, one for each case, got {len(given)}")
        if seeds is not None and not self.takes_seeds:
            raise InputError(f"seeds= are for environments, got some for {self.name}")
        task = _Task(listed, given, keep, above)
        lanes = self._lanes
        if lanes is None:
            for index in range(len(listed)):
                yield index, self._row(task, index)
            return
        kinds = ((lanes.kind(case), index) for index, case in enumerate(listed))
        for kind, group in groupby(sorted(kinds, key=_sort_key), itemgetter(0)):
            indices = [index for _, index in group]
            if kind is None:
                for index in indices:
                    yield index, self._row(task, index)
                continue
            for begin in range(0, len(indices), lanes.size):
                yield from self._batch(lanes, task, indices[begin : begin + lanes.size])

    def simulate(
        self, case: CaseLike, seed: int | None = None, above: Mapping[str, float] | None = None
    ) -> Run:
        """Runs one case and keeps every sample.

        Raises:
            RtamtError: As `rtamt_gym.simulate` does.
        """
        options: Any = self._simulated
        if self.takes_seeds:
            options = options | {"seed": seed}
        if above is not None:
            options = options | {"above": above}
        return simulate(self._system, self.requirements, case=Case(case), **options)

    def judge(self, name: str, trace: Trace) -> float:
        """The robustness of a requirement on samples that were kept."""
        options: Any = {
            option: self._simulated[option]
            for option in ("semantics", "inputs", "outputs", "nan", "align")
            if option in self._simulated
        }
        heights = rtamt.evaluate(
            self.requirements[name], trace.signals, trace.period, n=trace.samples, **options
        )
        return float(heights.min() if self._simulated.get("view") == "step" else heights[0])

    def _batch(self, lanes: Lanes, task: _Task, indices: list[int]) -> Iterator[tuple[int, Row]]:
        """Runs a batch in lanes; after an error, those that are not over one by one."""
        left = dict.fromkeys(indices)
        keep = None if task.keep is None else _renumbered(task.keep, indices)
        cases, seeds = [task.cases[i] for i in indices], [task.seeds[i] for i in indices]
        try:
            for lane, row in lanes.run(cases, seeds, keep, task.above):
                del left[indices[lane]]
                yield indices[lane], row
        except Exception:  # noqa: BLE001 - it stands in the row of the case that has it
            for index in left:
                yield index, self._row(task, index)

    def _row(self, task: _Task, index: int) -> Row:
        case, seed = task.cases[index], task.seeds[index]
        begin = time.perf_counter()
        try:
            run = self.simulate(case, seed, task.above)
            if task.keep is not None:
                task.keep(index, Trace(run.signals, run.period))
            return Row.of(run, case)
        except Exception as error:  # noqa: BLE001 - the row has it
            text = f"{type(error).__name__}: {error}"
            crashed = getattr(error, "run", None)
            if isinstance(crashed, Run):
                return Row.of(crashed, case, text)
            return Row(case, seed, {}, "error", 0.0, time.perf_counter() - begin, text)


class _Task(NamedTuple):
    """The cases to run with their seeds, who gets their samples, and what is known of them."""

    cases: list[Case]
    seeds: list[int | None]
    keep: Callable[[int, Trace], object] | None
    above: Mapping[str, float] | None


def _renumbered(
    keep: Callable[[int, Trace], object], indices: list[int]
) -> Callable[[int, Trace], object]:
    """Keeps the samples of a lane under the index of its case."""
    return lambda lane, trace: keep(indices[lane], trace)


def _sort_key(item: tuple[str | None, int]) -> tuple[str, int]:
    return item[0] or "", item[1]


def _check_options(options: Mapping[str, Any]) -> None:
    """Refuses options that `simulate` does not have, or that have no such value."""
    known = Options.__annotations__
    for name in options:
        if name not in known:
            raise InputTypeError(
                f"expected options that simulate has, one of {listing(known)}, got {name}="
                f"{nearest(name, known)}"
            )
    choices = {"view": View, "nan": Nan, "at_truncation": AtTruncation}
    for name, values in choices.items():
        if name in options:
            check_choice(name, options[name], get_args(values))


def _check_system(system: object) -> None:
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


def _name_of(system: Any) -> str:  # noqa: ANN401
    if isinstance(system, gym.Env):
        return system.spec.id if system.spec else type(system.unwrapped).__name__
    return str(getattr(system, "name", "") or getattr(system, "__name__", type(system).__name__))


def _duration_of(system: Any, duration: float | None) -> float | None:  # noqa: ANN401
    """The longest duration of a run: that which is given, or the time limit of an environment."""
    if duration is not None:
        return None if duration == math.inf else duration
    if not isinstance(system, gym.Env) or system.spec is None:
        return None
    period, limit = read_period(system), system.spec.max_episode_steps
    return None if period is None or limit is None else float(exact(period) * limit)


def _lanes(
    system: Any,  # noqa: ANN401
    specs: Mapping[str, rtamt.Specification],
    signals: Mapping[str, SignalLike] | None,
    duration: float | None,
    period: float | str | None,
    judging: Judging,
    batch: int,
) -> Lanes | None:
    """The lanes that run the cases of an environment; None if it has none, or they do not do."""
    spec = system.spec if isinstance(system, gym.Env) else None
    if spec is None or spec.vector_entry_point is None or spec.additional_wrappers:
        return None
    elements = _elements(system, specs, signals)
    vector = gym.make_vec(spec, num_envs=1)
    has_rollout = hasattr(vector.unwrapped, "rollout")
    vector.close()
    if elements is None or not has_rollout or spec.max_episode_steps is None:
        return None
    period = read_period(system) if period is None else period
    panel = Panel(specs, period, judging.view, interface=judging.interface, align=judging.align)
    most = None
    if duration is not None and duration != math.inf:
        most = int(exact(duration) / (panel.period or 1))
    return Lanes(system, specs, elements, period, most, judging, batch)


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
    if not all(isinstance(read, Element) for read in bound):
        return None
    return dict(zip(variables, (cast("Element", read).index for read in bound), strict=True))
