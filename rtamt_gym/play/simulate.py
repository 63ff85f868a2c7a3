"""`simulate`: runs one simulation under specifications; `Simulator` prepares many runs."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Unpack, cast, get_args

import gymnasium as gym

import rtamt
from rtamt import InputError, InputTypeError
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_choice, check_known
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.judging.judge import Judge, MonitorSetValues, TriggerCounter
from rtamt_gym.judging.specs import (
    SpecsLike,
    check_period,
    load_specs,
    own_requirements,
    with_unknown_start,
)
from rtamt_gym.options.evaluation import (
    EvaluationKeywords,
    EvaluationOptions,
    checked_options,
    documents_options,
)
from rtamt_gym.play.history import Stop
from rtamt_gym.play.run import Run
from rtamt_gym.play.simulation import BoundSystem, Recorder, Simulation
from rtamt_gym.signals.periods import warn_of_unverified_period, why_no_period
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.adapters import as_system, driven
from rtamt_gym.systems.environment import Environment, with_own_monitor
from rtamt_gym.systems.system import Policy, System, no_exit, step_limit
from rtamt_gym.wrappers.monitor import monitor_of

if TYPE_CHECKING:  # they import MuJoCo and Rerun, which are optional
    from rtamt_gym.live.view import RerunView
    from rtamt_gym.mujoco.snapshots import Snapshot
    from rtamt_gym.mujoco.step_monitor import StepMonitor


@documents_options("runs")
def simulate(
    system: Any,  # noqa: ANN401 - MuJoCo is not typed
    specs: SpecsLike | None = None,
    signals: Mapping[str, SignalLike] | None = None,
    *,
    case: Mapping[str, float | Waveform] | None = None,
    start: Snapshot | None = None,
    policy: Policy | None = None,
    seed: int | None = None,
    duration: float | None = None,
    stop: Stop = "violation",
    above: Mapping[str, float] | None = None,
    label: str = "",
    live: RerunView | None = None,
    **reading: Unpack[EvaluationKeywords],
) -> Run:
    """Run a simulation under specifications until a violation is certain; record every sample.

    Sample 0 is the state before the first step. An environment with an `StlMonitor` or `StlReward`
    uses its specifications, signals, period and options unless ``specs`` is given; the monitor
    ends no episode here. docs/simulations.md describes systems, cases, ends and branches.

    Args:
        system: A Gymnasium environment, ``(model, data)`` of MuJoCo, a `StepMonitor` (from its
            current state on), `Fmus`, a function from time to sample, or an iterable of samples. A
            sample is a mapping from names to numbers.
        specs: A specification (text, path of a ``.stl`` file, formula, `rtamt.Specification` or the
            name of an environment's own requirement), or several by name. Default: the
            specifications of the environment or its monitor.
        signals: The sources of the variables, and further signals to record: selectors, variables
            of FMUs or keys of samples. Default: the system's own signals, and keys by name.
        case: Numbers and waveforms by name, such as a `Case`; attributes, model and data are
            restored afterwards.
        start: The snapshot where the branch of a `StepMonitor` starts. Default: its current state.
        policy: A function of the observation, or of model and data. Default: the ``baseline`` of
            the environment, if it has one.
        seed: The seed of an environment's reset.
        duration: The maximum simulated time in seconds, at least a step; the period must be known.
            ``math.inf``: no limit. Default: until the system ends by itself.
        stop: ``"violation"``: at the first certain violation; ``"decided"``: also once every
            verdict is certain; ``"known"``: also once every robustness is known, checked every
            tenth sample; ``"verdicts"``: only once all verdicts are certain; ``"end"``: never.
        above: Numbers by specification, for ``stop="known"``: a robustness that certainly stays
            above its number counts as known.
        label: A name for tables and pictures.
        live: A view that shows each sample, such as ``rtamt_gym.live.RerunView()``; further runs
            with it are further episodes. Default: no view.
        **reading: Evaluation options.

    Returns:
        The signals, the robustness, bounds and verdicts at every sample, and the reason for the
        end. Verdicts stay UNDECIDED after a stop, and when a `StepMonitor` only pauses.

    Raises:
        SpecificationError: If a specification is wrong or needs a period.
        InputError: If a variable cannot be read, an argument is missing or wrong, or a signal is
            nan. An error after sample 0 and Ctrl-C keep their type and get the samples so far as
            their attribute ``run``, a `Run` with ``ended="error"``.
        InputTypeError: If the system has another type, or specifications are missing.
        StateError: If the simulation is unstable, or a `StepMonitor` has finished.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import simulate
        >>> env = gym.make("CartPole-v1")
        >>> specs = {"upright": "always(abs(angle) < 0.1)", "near": "always(abs(x) < 1)"}
        >>> signals = {"angle": "obs[2]", "x": "obs[0]"}
        >>> run = simulate(env, specs, signals, policy=lambda obs: int(obs[3] > 0), seed=1)
        >>> run
        <Run of CartPole-v1: violation of near at 2.36 s, 119 samples>
    """
    options = checked_options(reading, simulate, "runs")
    specs, signals, options = with_own_monitor(monitor_of(system), specs, signals, options)
    monitor = system if isinstance(system, MonitorSetValues) else monitor_of(system)
    if live is not None and monitor is not None and monitor.shown_live:
        raise InputError(
            f"expected live= of simulate or of the {type(monitor).__name__}, got both; leave one "
            "out"
        )
    with no_exit("the system"):
        simulator = Simulator(
            system,
            specs,
            signals,
            options,
            case=case,
            start=start,
            policy=policy,
            duration=duration,
        )
        simulation = simulator.begin(seed=seed, stop=stop, above=above, label=label, live=live)
        simulation.play()
    assert simulation.run is not None  # noqa: S101 - for mypy
    return simulation.run


class Simulator:
    """A system under specifications, checked, bound and compiled once for many runs.

    `rtamt_gym.simulate` documents the arguments. Every run has the same case.
    """

    def __init__(
        self,
        system: Any,  # noqa: ANN401 - MuJoCo is not typed
        specs: SpecsLike | None,
        signals: Mapping[str, SignalLike] | None,
        reading: EvaluationOptions,
        *,
        case: Mapping[str, float | Waveform] | None = None,
        start: Snapshot | None = None,
        policy: Policy | None = None,
        duration: float | None = None,
    ) -> None:
        if reading.substeps and not isinstance(system, gym.Env):
            raise InputError(
                Argument("substeps", value=True),
                f" is for environments with several physics steps per step, got {system!r}; give "
                "a smaller ",
                Argument("period"),
                " if the system takes a period",
            )
        self._given, self._policy, self._duration = system, policy, duration
        self._case = None if case is None else Case(case)
        self._plain = as_system(system, policy, start, substeps=reading.substeps)
        ran = self._plain if self._case is None else driven(self._plain, self._case)
        self.name, self.start = ran.name, start
        self.monitor = cast("StepMonitor", system) if isinstance(system, MonitorSetValues) else None
        if self.monitor is not None:
            _refuse_options({"specs": specs, "signals": signals})
            reading = reading.over(self.monitor.reading, "the StepMonitor", "leave it out")
            self.specs: Mapping[str, rtamt.Specification] = self.monitor.specs
            signals = dict.fromkeys(self.monitor.signals, "")
        else:
            self.specs = _loaded(specs, system, ran.name)
            if isinstance(self._plain, Environment):
                reading = self._read_environment(
                    self._plain, cast("Environment", ran), signals, reading
                )
            elif reading.below:
                raise InputError(
                    Argument("below", value=True),
                    f" is for environments, which have wrappers, got {system!r}; leave it out",
                )
        self.signals, self.reading = signals, reading
        self._judge: Judge | None = None
        self._free: list[Recorder] = []  # of the judge
        self._trigger_counter: TriggerCounter | None = None  # of a `StepMonitor`
        self._bound = self._bind(ran)

    def _read_environment(
        self,
        plain: Environment,
        ran: Environment,
        signals: Mapping[str, SignalLike] | None,
        reading: EvaluationOptions,
    ) -> EvaluationOptions:
        """Pass options to an environment; return the options of its monitors."""
        known = plain.known(signals)
        read = {name: known.get(name) for name in _variables(self.specs)}
        reading, refuse_nan = with_unknown_start(reading, read)
        timed = any(spec.timed for spec in self.specs.values())
        own = plain.period is not None and reading.period is None
        if own and timed and not reading.substeps:
            warn_of_unverified_period(self._given)
        for system in (plain, ran):
            system.refuses_nan, system.timed = refuse_nan, timed
            system.below, system.rescaled = reading.below, reading.rescaled
        return reading

    def begin(
        self,
        case: Case | None = None,
        *,
        policy: Policy | None = None,
        seed: int | None = None,
        stop: Stop = "violation",
        above: Mapping[str, float] | None = None,
        label: str = "",
        light: bool = False,
        live: RerunView | None = None,
    ) -> Simulation:
        """Start a run; `rtamt_gym.simulate` documents the arguments."""
        check_choice("stop", stop, get_args(Stop))
        if above is not None and stop != "known":
            raise InputError(f"expected above= with stop='known' alone, got stop={stop!r}")
        if self.monitor is not None:
            _refuse_options({"above": above})
        above = {} if above is None else above
        check_known("above", above, self.specs)
        bound, plain = self._bound, self._plain
        if isinstance(plain, Environment):
            acting = self._policy if policy is None else policy
            if case:
                bound = self._bind(driven(plain.again(acting, seed), case))
            else:
                system = cast("Environment", bound.system).again(acting, seed)
                bound = bound._replace(system=system)
        else:
            if seed is not None:
                got = Argument("seed", seed), f" for {self._given!r}"
                raise InputError(Argument("seed"), " is for environments, got ", *got)
            if case is not None:  # also an empty one: a MuJoCo model starts again as a copy
                bound = self._bind(driven(plain, case))
        case = self._case if case is None else case
        return Simulation(bound, case, seed, stop, above, label, light=light, live=live)

    def of(self, system: System) -> Simulator:
        """Return a simulator of another system like this one, with bound signals."""
        other = copy.copy(self)
        other.__dict__ |= {"_plain": system, "_bound": self._bound._replace(system=system)}
        return other

    def _bind(self, ran: System) -> BoundSystem:
        """Compile the specifications for the period of a system, and bind its signals."""
        monitor, judge, reads = self.monitor, None, None
        if monitor is None:
            judge = self._judge_of(ran)
            variables, period, counter = judge.variables, judge.period, judge.trigger_counter
            step = period
        else:
            variables, period = _variables(self.specs), monitor.period
            step = None if ran.period is None else exact(ran.period)
            if self._trigger_counter is None:
                self._trigger_counter = TriggerCounter(self.specs, monitor.reading)
            counter = self._trigger_counter
        most = step_limit(self._duration, step, ran.name, endless=ran.endless)
        ran.bind(variables, self.signals, period)
        if isinstance(ran, Environment) and ran.plain:
            reads = ran.reads
        return BoundSystem(
            system=ran,
            reads=reads,
            specs=self.specs,
            signals=self.signals or {},
            reading=self.reading,
            variables=variables,
            period=period,
            most=most,
            monitor=monitor,
            goes_on=monitor is not None and self.start is None,
            judge=judge,
            free=self._free,
            trigger_counter=counter,
        )

    def _judge_of(self, ran: System) -> Judge:
        """Return the judge for the period of a system."""
        reading = self.reading
        if reading.period is None:
            reading = reading.having(period=ran.period)
        if reading.period is None and ran.needs_period:
            lacks = ran.needs_period
            reason = lacks if isinstance(lacks, str) else "does not state the duration of a step"
            raise InputError(f"{ran.name} {reason}; give ", Argument("period"), " in seconds")
        why = why_no_period(self._given) if isinstance(self._given, gym.Env) else ""
        if reading.period is None:  # before the bounds: the error states both
            step_limit(self._duration, None, ran.name, endless=ran.endless)
        check_period(self.specs, reading.period, ran.name, why)
        if self._judge is None or self._judge.reading.period != reading.period:
            self._judge, self._free = Judge(self.specs, reading), []
        return self._judge


def _variables(specs: Mapping[str, rtamt.Specification]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for spec in specs.values() for name in spec.variables))


def _loaded(specs: SpecsLike | None, system: object, name: str) -> dict[str, rtamt.Specification]:
    """Load specifications; None: the environment's own."""
    own = own_requirements(system)
    if specs is None and not own:
        raise InputTypeError(
            f"expected specifications for {name}, got none; "
            'write simulate(system, "always(x < 1)", ...)'
        )
    return load_specs(own if specs is None else specs, own)


def _refuse_options(options: Mapping[str, object]) -> None:
    """Refuse options that a `StepMonitor` has of its own."""
    if type(options.get("specs")).__name__ == "Snapshot":
        raise InputTypeError(
            "expected a snapshot as start=, got it as specs; "
            "write simulate(monitor, start=snapshot)"
        )
    for name, value in options.items():
        if value is not None:
            raise InputError(
                f"{name}= is for systems without a monitor, got {name}={value!r} for a "
                f"StepMonitor, which has its own; give it to StepMonitor(...)"
            )
