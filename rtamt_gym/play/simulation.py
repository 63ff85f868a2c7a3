"""`Simulator` prepares a system for runs under monitors; `Simulation` is a run."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple, cast, get_args

import gymnasium as gym

import rtamt
from rtamt import InputError, InputTypeError
from rtamt.errors import Argument
from rtamt.monitors import Evidence, TriggerCount
from rtamt.typing import End
from rtamt_gym.checks.arguments import check_choice, check_known
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.judging.end_warnings import assumed, warn_of_open_end
from rtamt_gym.judging.judge import Judge, TriggerCounter
from rtamt_gym.judging.monitor_set import MonitorSetResult
from rtamt_gym.judging.specs import (
    SpecsLike,
    check_period,
    load_specs,
    own_requirements,
    with_unknown_start,
)
from rtamt_gym.mujoco.values import MonitorSetValues
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions
from rtamt_gym.play.run import Run
from rtamt_gym.play.run_record import (
    AT_VERDICTS,
    AT_VIOLATION,
    KNOWN_EVERY,
    HistoriesOnDemand,
    History,
    Recorder,
    SimulatedTrace,
    Stop,
)
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.trial import RunEnd, Trial
from rtamt_gym.signals.periods import warn_of_unverified_period, why_no_period
from rtamt_gym.signals.signals import Read, SignalLike
from rtamt_gym.systems.adapters import as_system, driven, refuse_seed
from rtamt_gym.systems.environment import Environment
from rtamt_gym.systems.system import Policy, System, exited, step_limit
from rtamt_gym.tables import sample_text

if TYPE_CHECKING:  # they import MuJoCo and Rerun, which are optional
    from rtamt_gym.live.track import Track
    from rtamt_gym.live.view import RerunView
    from rtamt_gym.mujoco.snapshots import Snapshot
    from rtamt_gym.mujoco.step_monitor import StepMonitor


class _Bound(NamedTuple):
    """A system with bound signals, and its monitors."""

    system: System
    reads: Sequence[Read] | None
    judge: Judge | None
    free: list[Recorder]
    variables: Sequence[str]
    period: Fraction | None
    most: int | None
    trigger_counter: TriggerCounter


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
        self.of_environment = isinstance(self._plain, Environment)
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
        _check_stop(stop, above)
        if self.monitor is not None:
            _refuse_options({"above": above})
        above = {} if above is None else above
        check_known("above", above, self.specs)
        bound, plain = self._bound, self._plain
        system = bound.system
        if self.of_environment:
            acting = self._policy if policy is None else policy
            if case:
                again = cast("Environment", plain).again(acting, seed)
                bound = self._bind(driven(again, case))
                system = bound.system
            else:
                system = cast("Environment", system).again(acting, seed)
        else:
            refuse_seed(seed, self._given)
            if case is not None:  # also an empty one: a MuJoCo model starts again as a copy
                bound = self._bind(driven(plain, case))
                system = bound.system
        case = self._case if case is None else case
        return Simulation(self, bound, system, case, seed, stop, above, label, light, live)

    def of(self, system: System) -> Simulator:
        """Return a simulator of another system like this one, with bound signals."""
        other = copy.copy(self)
        other.__dict__ |= {"_plain": system, "_bound": self._bound._replace(system=system)}
        other.of_environment = isinstance(system, Environment)
        return other

    def _bind(self, ran: System) -> _Bound:
        """Compile the specifications for the period of a system, and bind its signals."""
        variables: Sequence[str]
        if self.monitor is not None:
            variables = _variables(self.specs)
            ran.bind(variables, self.signals, self.monitor.period)
            step = None if ran.period is None else exact(ran.period)
            most = step_limit(self._duration, step, ran.name, endless=ran.endless)
            if self._trigger_counter is None:
                self._trigger_counter = TriggerCounter(self.specs, self.monitor.reading)
            period = self.monitor.period
            return _Bound(ran, None, None, [], variables, period, most, self._trigger_counter)
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
        judge = self._judge
        if judge is None or judge.reading.period != reading.period:
            judge = self._judge = Judge(self.specs, reading)
            self._free = []
        most = step_limit(self._duration, judge.period, ran.name, endless=ran.endless)
        ran.bind(judge.variables, self.signals, judge.period)
        reads = ran.reads if isinstance(ran, Environment) and ran.plain else None
        variables, trigger_counter = judge.variables, judge.trigger_counter
        return _Bound(ran, reads, judge, self._free, variables, judge.period, most, trigger_counter)


class Simulation:
    """One run of a system under specifications; `Simulator.begin` starts it.

    Attributes:
        run: The run; None while it is not over, if an error came before sample 0, and if only the
            trial is needed.
        over: Whether it is over.
        wall: Seconds that its steps took so far.
    """

    run: Run | None = None

    def __init__(
        self,
        simulator: Simulator,
        bound: _Bound,
        system: System,
        case: Case | None,
        seed: int | None,
        stop: Stop,
        above: Mapping[str, float],
        label: str,
        light: bool,  # noqa: FBT001 - `Simulator.begin` names it
        live: RerunView | None = None,
    ) -> None:
        monitor, variables = simulator.monitor, bound.variables
        self._simulator, self._bound, self._system = simulator, bound, system
        self._case, self._seed, self._label = case, seed, label
        self._stop, self._above, self._most = stop, above, bound.most
        signals = simulator.signals or {}
        self._light = light and monitor is None and all(name in variables for name in signals)
        if self._light and bound.free:
            self._record = bound.free.pop()
            self._record.reset()
        else:
            judge = bound.judge
            monitor_set = judge.begin() if judge else cast("StepMonitor", monitor).monitor_set
            self._record = Recorder(
                monitor_set,
                variables,
                () if self._light else signals,
                simulator.reading.nan,
                keeps=not self._light or bool(bound.trigger_counter),
                fed=monitor is not None,
                live=None if live is None else self._track(live),
            )
        self._monitor_set = self._record.monitor_set
        self._ended: RunEnd = "error"
        self._steps = 0  # plus one after sample 0
        self._samples = 0  # set at the end
        self.over = False
        self._outcomes: Mapping[str, Outcome] = {}
        self.wall = 0.0
        self._since: float | None = time.perf_counter()

    def _track(self, live: RerunView) -> Track:
        """Return the track of the run in a live view."""
        simulator, bound, system = self._simulator, self._bound, self._system
        period = None if bound.period is None else float(bound.period)
        names = list(dict.fromkeys([*bound.variables, *(simulator.signals or {})]))
        track = live.track(names, [*simulator.specs], period)
        if live.pictures is not None:
            make = getattr(system, "renderer", None)
            if make is None:
                raise InputError(
                    f"RerunView(pictures=) needs a system that renders pictures, got {system.name}"
                )
            track.draw(make(), live.pictures)
        return track

    def play(self) -> bool:
        """Run the simulation to its end; return True, since it is over."""
        return self._advance(to_end=True)

    def step(self) -> bool:
        """Take sample 0, or make a step and take its sample; return whether the run is over."""
        return self._advance(to_end=False)

    def leave(self) -> None:
        """Abandon a run that is not over, and undo its changes of the system."""
        if not self.over:
            self._close()

    def trial(self, case: Case, error: str = "") -> Trial:
        """Return the result of the run without its samples, with the error that ended it."""
        reward, simulated = None, 0.0
        if self._samples:
            reward = getattr(self._system, "reward", None)
            simulated = float(Moment.of(self._samples - 1, self._bound.period).time or 0)
        return Trial(
            case,
            self._seed,
            self._outcomes,
            self._ended,
            simulated,
            self.wall,
            error,
            reward,
            reported=getattr(self._system, "reported", None),
        )

    @property
    def moment(self) -> Moment:
        """The newest sample, before the run is over."""
        return Moment.of(len(self._record) - 1, self._bound.period)

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; None if they have no time."""
        return self._bound.period

    def results(self) -> list[MonitorSetResult]:
        """Return the result of each specification so far, before the run is over."""
        return self._monitor_set.results()

    @property
    def trace(self) -> SimulatedTrace | None:
        """The samples, if the run is there."""
        return None if self.run is None else SimulatedTrace(self.run.signals, self.run.period)

    @property
    def observation(self) -> Any:  # noqa: ANN401
        """The last observation of an environment, for the next action."""
        return cast("Environment", self._system).observation

    def _advance(self, *, to_end: bool) -> bool:
        if self._since is None:
            self._since = time.perf_counter()
        try:
            self._step()
            if to_end and self._bound.reads is not None and self._record.plain:
                self._play_on(cast("Environment", self._system), self._bound.reads)
            while to_end and not self.over:
                self._step()
        except SystemExit as end:
            error = exited(self._system.name, end)
            self._fail(error)
            raise error from end
        except BaseException as error:
            self._fail(error)
            raise
        if not self.over:
            self.wall += time.perf_counter() - self._since
            self._since = None
        return self.over

    def _step(self) -> None:
        system = self._system
        values = system.advance() if self._steps else system.start()
        if values is None:
            why: RunEnd | None = system.ended or "terminated"
        else:
            self._record.take(values)
            why = self._why()
        self._steps += 1
        if why is not None:
            self._conclude(why)

    def _play_on(self, system: Environment, reads: Sequence[Read]) -> None:
        """Run an environment to an end or a stop, with no call between step and monitors."""
        record, known = self._record, self._stop == "known"
        most, feed = math.inf if self._most is None else self._most, record.feeder(reads)
        while not self.over:
            last = self._steps - 1
            pause = min(most, (last // KNOWN_EVERY + 1) * KNOWN_EVERY) if known else most
            system.play(self._monitor_set, feed, pause - last)
            self._steps = len(record) - 1
            why = self._why()
            self._steps += 1
            if why is not None:
                self._conclude(why)

    def _why(self) -> RunEnd | None:
        """Return why the last sample ends the run, if it does."""
        monitor_set, stop = self._monitor_set, self._stop
        if self._system.ended:
            return self._system.ended
        if stop in AT_VIOLATION and monitor_set.violated_by is not None:
            return "violation"
        if stop in AT_VERDICTS and monitor_set.all_decided:
            return "decided"
        if stop == "known" and self._steps % KNOWN_EVERY == 0 and monitor_set.knows(self._above):
            return "known"
        return "duration" if self._steps == self._most else None

    def _conclude(self, why: RunEnd) -> None:
        """Evaluate the end of the run, and close it."""
        self._ended = why
        monitor_set, end = self._monitor_set, self._end
        default = (
            why == "terminated"
            and self._simulator.reading.at_termination is None
            and self._simulator.of_environment
        )
        undecided, windows = (
            (monitor_set.undecided, monitor_set.cut_windows()) if default else ([], ())
        )
        if end is not None:
            self._record.finish(end)
        if default:
            open_end = assumed([name for name in undecided if monitor_set.satisfies(name)], windows)
            if open_end is not None:
                warn_of_open_end(open_end[0], window=open_end[1])
        self._close()

    @property
    def _end(self) -> AtTermination | End | None:
        """How the end is evaluated; None if the run was stopped or the episode goes on."""
        simulator, ended = self._simulator, self._ended
        goes_on = simulator.monitor is not None and simulator.start is None
        if ended == "truncated" or (ended == "duration" and not goes_on):
            return simulator.reading.at_truncation
        return (simulator.reading.at_termination or "complete") if ended == "terminated" else None

    def _close(self) -> None:
        """Make the outcomes and the run, if there is a sample, and close the system."""
        record, bound, self.over = self._record, self._bound, True
        try:
            if self._ended == "error":
                record.rewind()
            self._samples = len(record)
            record.show_end()
            evidence = self._evidence() if self._samples else {}
            if self._samples:
                self._outcomes = self._find_outcomes(evidence)
            if self._since is not None:
                self.wall += time.perf_counter() - self._since
            if self._samples and not self._light:
                self.run = self._make_run(evidence)
        finally:
            self._system.close()
        # The results are copies, and after an error the monitors are complete.
        if self._light:
            bound.free.append(record)
        elif bound.judge is not None:
            bound.judge.end(self._monitor_set)

    def _evidence(self) -> Mapping[str, Evidence[TriggerCount]]:
        """Return how often the samples triggered implications; empty if samples are missing."""
        record, trigger_counter = self._record, self._bound.trigger_counter
        if record.first_sample:
            return {}
        verdicts = {name: verdict for name, _, verdict, *_ in self._monitor_set.results()}
        samples = record.columns() if trigger_counter else {}
        return trigger_counter.evidence(samples, len(record), self._end, verdicts)

    def _find_outcomes(self, evidence: Mapping[str, Evidence[TriggerCount]]) -> dict[str, Outcome]:
        period, progress = self._bound.period, self._monitor_set.progress
        return {
            name: Outcome.at(
                bounds,
                verdict,
                decided,
                period,
                evidence.get(name),
                progress.get(name),
                ended=ended,
            )
            for name, bounds, verdict, decided, ended in self._monitor_set.results()
        }

    def _make_run(self, evidence: Mapping[str, Evidence[TriggerCount]]) -> Run:
        simulator, bound, system = self._simulator, self._bound, self._system
        limits = [steps for steps in (self._most, system.limit) if steps is not None]
        return Run(
            system=system.name,
            signals=self._record.columns(),
            histories=self._histories(evidence),
            ended=self._ended,
            violated_by=self._monitor_set.violated_by,
            period=bound.period,
            view=simulator.reading.view,
            align=simulator.reading.align,
            stop=self._stop,
            limit=min(limits, default=None),
            wall_time=self.wall,
            first_sample=self._record.first_sample,
            reward=getattr(system, "reward", None),
            case=self._case,
            seed=self._seed,
            label=self._label,
        )

    def _histories(self, evidence: Mapping[str, Evidence[TriggerCount]]) -> Mapping[str, History]:
        """Return the histories; for monitors of a `Judge`, they are computed at their first use."""
        record, judge, specs, end = (
            self._record,
            self._bound.judge,
            self._simulator.specs,
            self._end,
        )
        if judge is None:
            return record.histories(specs, evidence)

        def compute() -> dict[str, History]:
            monitor_set = judge.begin()
            result = record.replayed(monitor_set, end).histories(specs, evidence)
            judge.end(monitor_set)
            return result

        return HistoriesOnDemand(tuple(specs), compute)

    def _fail(self, error: BaseException) -> None:
        """End the run with an error, which carries the run so far."""
        if not self.over:
            self._close()
        if self.run is not None:
            _carry(error, self.run)


def failed(error: Exception, case: Case, seed: int | None, wall: float) -> Trial:
    """Return the trial of a run that an error ended, with the samples that the error carries."""
    text = f"{type(error).__name__}: {error}"
    run = getattr(error, "run", None)
    if isinstance(run, Run):
        return run.trial(case, text)
    return Trial(case, seed, {}, "error", 0.0, wall, text)


def _carry(error: BaseException, run: Run) -> None:
    """Make a run the attribute ``run`` of an error, and add a note.

    The run replaces the run of a nested simulation that the error ended before.
    """
    before = getattr(error, "run", None)
    with suppress(AttributeError):  # some errors take no attributes
        crashed: Any = error
        crashed.run = run
        if isinstance(before, Run):
            crashed.__notes__.remove(_note(before))
        error.add_note(_note(run))


def _note(run: Run) -> str:
    samples = f"{run.steps + 1} samples" if run.steps else "1 sample"
    return f"error.run holds {samples}, up to {sample_text(run.last_sample, run.period)}"


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


def _check_stop(stop: Stop, above: Mapping[str, float] | None) -> None:
    check_choice("stop", stop, get_args(Stop))
    if above is not None and stop != "known":
        raise InputError(f"expected above= with stop='known' alone, got stop={stop!r}")


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
