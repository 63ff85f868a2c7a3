"""`Simulation`: one simulation under specifications, which can be made step by step."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple, cast, get_args

import gymnasium as gym

import rtamt
from rtamt import Asked, End, Evidence, InputError, InputTypeError
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_choice, check_known, check_number
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.judging.ends import assumed, warn_of_open_end
from rtamt_gym.judging.judge import Judge
from rtamt_gym.judging.panel import PanelResult
from rtamt_gym.judging.questions import Questions
from rtamt_gym.judging.specs import SpecsLike, check_period, load_specs, own_requirements
from rtamt_gym.judging.unknown import with_unknown_start
from rtamt_gym.mujoco.values import PanelValues
from rtamt_gym.options.evaluation import AtTermination, Reading
from rtamt_gym.play.recorder import Recorder, Tally, carry
from rtamt_gym.play.run import Run
from rtamt_gym.play.run_record import AT_VERDICTS, AT_VIOLATION, KNOWN_EVERY, Stop
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.trial import RunEnd, Trial
from rtamt_gym.signals.periods import warn_of_unverified_period, why_no_period
from rtamt_gym.signals.signals import Read, SignalLike
from rtamt_gym.systems.environment import Environment
from rtamt_gym.systems.kinds import as_system, driven, refuse_seed
from rtamt_gym.systems.system import Policy, System, exited

if TYPE_CHECKING:
    from rtamt_gym.mujoco.snapshots import Snapshot
    from rtamt_gym.mujoco.step_monitor import StepMonitor


class _Bound(NamedTuple):
    """A system whose signals are bound, with what judges it.

    Attributes:
        system: The system.
        reads: What reads the variables after a step of an environment, where each is a sample.
        judge: Its monitors; None of a `StepMonitor`, which has its own.
        tallies: What has fed monitors of the judge in runs that are over, for further runs.
        variables: The names that the specifications read.
        period: Seconds between samples.
        most: The number of steps after which a run is cut short, or None.
        questions: Counts how often a run puts the specifications to the test.
    """

    system: System
    reads: Sequence[Read] | None
    judge: Judge | None
    tallies: list[Tally]
    variables: Sequence[str]
    period: Fraction | None
    most: int | None
    questions: Questions

    def tally(self) -> Tally:
        """What feeds the samples of a run that begins, to monitors that have none."""
        if self.tallies:
            tally = self.tallies.pop()
            tally.reset()
        else:
            panel = cast("Judge", self.judge).begin()
            tally = Tally(panel, self.variables, keeps=bool(self.questions))
        return tally


class Simulator:
    """A system under specifications: checked, bound and compiled once, for any number of runs.

    `rtamt_gym.simulate` documents the arguments. A case is the same for all runs.

    Raises:
        RtamtError: What every run would raise before its first sample.
    """

    def __init__(
        self,
        system: Any,  # noqa: ANN401 - MuJoCo is not typed
        specs: SpecsLike | None,
        signals: Mapping[str, SignalLike] | None,
        reading: Reading,
        *,
        case: Mapping[str, float | Waveform] | None = None,
        start: Snapshot | None = None,
        policy: Policy | None = None,
        duration: float | None = None,
    ) -> None:
        if reading.substeps and not isinstance(system, gym.Env):
            raise InputError(
                Argument("substeps", value=True),
                f" is for environments, whose step makes several, got {system!r}; give a smaller ",
                Argument("period"),
                " where the system takes one",
            )
        self._given, self._policy, self._duration = system, policy, duration
        self._case = None if case is None else Case(case)
        self._plain = as_system(system, policy, None, start, None, substeps=reading.substeps)
        ran = self._plain if self._case is None else driven(self._plain, self._case)
        self.name, self.start = ran.name, start
        self.monitor = cast("StepMonitor", system) if isinstance(system, PanelValues) else None
        if self.monitor is not None:
            _refuse_options({"specs": specs, "signals": signals})
            reading = reading.over(self.monitor.reading, "the StepMonitor", "leave it out")
            self.specs: Mapping[str, rtamt.Specification] = self.monitor.specs
            signals = dict.fromkeys(self.monitor.signals, "")
        else:
            self.specs = _loaded(specs, system, ran.name)
            if isinstance(self._plain, Environment):
                known = self._plain.known(signals)
                read = {name: known.get(name) for name in _variables(self.specs)}
                reading, refuse_nan = with_unknown_start(reading, read)
                timed = any(spec.timed for spec in self.specs.values())
                own = self._plain.period is not None and reading.period is None
                if own and timed and not reading.substeps:
                    warn_of_unverified_period(system)
                for each in (self._plain, cast("Environment", ran)):
                    each.refuses_nan, each.timed = refuse_nan, timed
                    each.below, each.rescaled = reading.below, reading.rescaled
            elif reading.below:
                raise InputError(
                    Argument("below", value=True),
                    f" is for environments, which have wrappers, got {system!r}; leave it out",
                )
        self.signals, self.reading = signals, reading
        self._judge: Judge | None = None
        self._tallies: list[Tally] = []  # of the judge
        self._questions: Questions | None = None  # of a `StepMonitor`
        self.of_environment = isinstance(self._plain, Environment)
        self._bound = self._bind(ran)

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
    ) -> Simulation:
        """Begins a run.

        Args:
            case: What the run is given; None: what all are.
            policy: Who acts in an environment; None: who does in all.
            seed: As for `rtamt_gym.simulate`.
            stop: As for `rtamt_gym.simulate`.
            above: As for `rtamt_gym.simulate`.
            label: As for `rtamt_gym.simulate`.
            light: Whether only the trial is asked for, and not the run.

        Raises:
            RtamtError: If the case, the seed or what stops the run does not fit.
        """
        _check_stop(stop, above)
        if self.monitor is not None:
            _refuse_options({"above": above})
        if above is None:
            above = {}
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
            if case is not None:  # an empty one too: a model of MuJoCo begins anew with a copy
                bound = self._bind(driven(plain, case))
                system = bound.system
        case = self._case if case is None else case
        return Simulation(self, bound, system, case, seed, stop, above, label, light)

    def of(self, system: System) -> Simulator:
        """A simulator of another system like this one, whose signals are bound already."""
        made = copy.copy(self)
        made.__dict__ |= {"_plain": system, "_bound": self._bound._replace(system=system)}
        made.of_environment = isinstance(system, Environment)
        return made

    def _bind(self, ran: System) -> _Bound:
        """Compiles the specifications for the period of a system, and binds its signals."""
        variables: Sequence[str]
        if self.monitor is not None:
            variables = _variables(self.specs)
            ran.bind(variables, self.signals, self.monitor.period)
            most = _most(self._duration, exact(ran.period or 1), ran)
            if self._questions is None:
                self._questions = Questions(self.specs, self.monitor.reading)
            its = self.monitor.period, most, self._questions
            return _Bound(ran, None, None, [], variables, *its)
        reading = self.reading
        if reading.period is None:
            reading = reading.having(period=ran.period)
        if reading.period is None and ran.needs_period:
            lacks = ran.needs_period
            reason = lacks if isinstance(lacks, str) else "does not say how long a step lasts"
            raise InputError(f"{ran.name} {reason}; give ", Argument("period"), " in seconds")
        why = why_no_period(self._given) if isinstance(self._given, gym.Env) else ""
        check_period(self.specs, reading.period, ran.name, why)
        judge = self._judge
        if judge is None or judge.reading.period != reading.period:
            judge = self._judge = Judge(self.specs, reading)
            self._tallies = []
        most = _most(self._duration, judge.period, ran)
        ran.bind(judge.variables, self.signals, judge.period)
        reads = ran.reads if isinstance(ran, Environment) and ran.plain else None
        its = judge.period, most, judge.questions
        return _Bound(ran, reads, judge, self._tallies, judge.variables, *its)


class Simulation:
    """One run of a simulation under specifications; a `Simulator` begins it.

    Attributes:
        run: The run; None as long as the simulation is not over, where an error came before
            sample 0, and where only the trial was asked for.
        over: Whether it is over.
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
    ) -> None:
        monitor, variables = simulator.monitor, bound.variables
        self._simulator, self._bound, self._system = simulator, bound, system
        self._case, self._seed, self._label = case, seed, label
        self._stop, self._above, self._most = stop, above, bound.most
        signals = simulator.signals or {}
        self._record: Recorder | Tally
        if light and monitor is None and all(name in variables for name in signals):
            self._record = tally = bound.tally()
            self._panel = tally.panel
        else:
            judge, fed = bound.judge, monitor is not None
            panel = self._panel = judge.begin() if judge else cast("StepMonitor", monitor).panel
            self._record = Recorder(panel, variables, signals, simulator.reading.nan, fed=fed)
        self._ended: RunEnd = "error"
        self._steps = 0  # and one more once sample 0 was taken
        self._samples = 0  # once it is over
        self.over = False
        self._outcomes: Mapping[str, Outcome] = {}
        self._wall = 0.0
        self._begin = time.perf_counter()

    def go(self) -> Run:
        """Runs the simulation until it is over."""
        self.play()
        assert self.run is not None, "it was not asked for its trial alone"  # noqa: S101 - for mypy
        return self.run

    def play(self) -> None:
        """Runs the simulation until it is over; what it came to is its run, or its trial."""
        try:
            self._step()
            if self._bound.reads is not None and isinstance(self._record, Tally):
                self._play_on(cast("Environment", self._system), self._bound.reads)
            while not self.over:
                self._step()
        except SystemExit as end:
            error = exited(self._system.name, end)
            self._fail(error)
            raise error from end
        except BaseException as error:
            self._fail(error)
            raise

    def step(self) -> bool:
        """Takes sample 0, or makes a step and takes the sample after it; whether it is over."""
        try:
            self._step()
        except SystemExit as end:
            error = exited(self._system.name, end)
            self._fail(error)
            raise error from end
        except BaseException as error:
            self._fail(error)
            raise
        return self.over

    def leave(self) -> None:
        """Ends a simulation that nobody goes on with: what it changed of the system is undone."""
        if not self.over:
            self._close()

    def trial(self, case: Case, error: str = "") -> Trial:
        """What the simulation came to; with the error that has ended it, if one did."""
        reported = getattr(self._system, "reported", None)
        if self.run is not None:
            return replace(self.run.trial(case, error), reported=reported)
        reward, simulated = None, 0.0
        if self._outcomes:
            reward = getattr(self._system, "reward", None)
            simulated = float(Moment.of(self._samples - 1, self._bound.period).time or 0)
        return Trial(
            case,
            self._seed,
            self._outcomes,
            self._ended,
            simulated,
            self._wall,
            error,
            reward,
            reported=reported,
        )

    @property
    def observation(self) -> Any:  # noqa: ANN401
        """What an environment has shown last, on which the next step acts."""
        return cast("Environment", self._system).observation

    def _step(self) -> None:
        system = self._system
        values = system.advance() if self._steps else system.start()
        why = (system.ended or "terminated") if values is None else self._take(values)
        self._steps += 1
        if why is not None:
            self._conclude(why)

    def _play_on(self, system: Environment, reads: Sequence[Read]) -> None:
        """Runs an environment to its end or to a stop, without a call between step and monitors."""
        tally, known = cast("Tally", self._record), self._stop == "known"
        most, feed = math.inf if self._most is None else self._most, tally.feeder(reads)
        while not self.over:
            last = self._steps - 1
            pause = min(most, (last // KNOWN_EVERY + 1) * KNOWN_EVERY) if known else most
            system.play(self._panel, feed, pause - last)
            self._steps = len(tally) - 1
            why = self._why()
            self._steps += 1
            if why is not None:
                self._conclude(why)

    def _take(self, values: Sequence[float]) -> RunEnd | None:
        """Feeds a sample to the monitors; returns why the run is over, if it is."""
        self._record.take(values)
        return self._why()

    def _why(self) -> RunEnd | None:
        """Why the run is over with the last sample, if it is."""
        panel, stop = self._panel, self._stop
        if self._system.ended:
            return self._system.ended
        if stop in AT_VIOLATION and panel.violated_by is not None:
            return "violation"
        if stop in AT_VERDICTS and panel.all_decided:
            return "decided"
        if stop == "known" and self._steps % KNOWN_EVERY == 0 and panel.knows(self._above):
            return "known"
        return "duration" if self._steps == self._most else None

    def _conclude(self, why: RunEnd) -> None:
        """Reads the end of the run, and closes it."""
        self._ended = why
        panel, end = self._panel, self._reading
        unasked = (
            why == "terminated"
            and self._simulator.reading.at_termination is None
            and self._simulator.of_environment
        )
        undecided, windows = (panel.undecided, panel.cut_windows()) if unasked else ([], ())
        if end is not None:
            self._record.finish(end)
        if unasked:
            told = assumed([name for name in undecided if panel.satisfies(name)], windows)
            if told is not None:
                warn_of_open_end(told[0], window=told[1])
        self._close()

    @property
    def _reading(self) -> AtTermination | End | None:
        """How the end is read; None of a run that was stopped or goes on, which has none."""
        simulator, ended = self._simulator, self._ended
        goes_on = simulator.monitor is not None and simulator.start is None
        if ended == "truncated" or (ended == "duration" and not goes_on):
            return simulator.reading.at_truncation
        return (simulator.reading.at_termination or "complete") if ended == "terminated" else None

    def _close(self) -> None:
        """Makes the run or the outcomes, if there is a sample, and closes the system."""
        record, bound, self.over = self._record, self._bound, True
        try:
            if self._ended == "error":
                record.rewind()
            self._samples = len(record)
            if isinstance(record, Tally):
                self._outcomes = self._found(record) if self._samples else {}
                self._wall = time.perf_counter() - self._begin
            else:
                self.run = self._made(record) if self._samples else None
        finally:
            self._system.close()
        # What came of it is copied, and an error has left it whole.
        if isinstance(record, Tally):
            bound.tallies.append(record)
        elif bound.judge is not None:
            bound.judge.end(self._panel)

    def _found(self, record: Tally) -> dict[str, Outcome]:
        """What the specifications have become."""
        results, period = self._panel.results(), self._bound.period
        stands_on, progress = self._stands_on(record, results), self._panel.progress
        return {
            name: Outcome.at(
                bounds, verdict, decided, period, stands_on[name], progress.get(name), ended=ended
            )
            for name, bounds, verdict, decided, ended in results
        }

    def _stands_on(
        self, record: Tally | Recorder, results: Sequence[PanelResult]
    ) -> Mapping[str, Evidence[Asked]]:
        """How often the samples of a whole run have put the specifications to the test."""
        verdicts = {name: verdict for name, _, verdict, *_ in results}
        questions = self._bound.questions
        samples = record.columns() if questions else {}
        return questions.answers(samples, len(record), self._reading, verdicts)

    def _made(self, record: Recorder) -> Run:
        simulator, bound, system = self._simulator, self._bound, self._system
        # One that goes on lacks the samples before it.
        results = self._panel.results()
        stands_on = {} if record.first_sample else self._stands_on(record, results)
        limits = [steps for steps in (self._most, system.limit) if steps is not None]
        return Run(
            system=system.name,
            signals=record.signals(),
            courses=record.courses(simulator.specs, stands_on),
            ended=self._ended,
            violated_by=self._panel.violated_by,
            period=bound.period,
            view=simulator.reading.view,
            align=simulator.reading.align,
            stop=self._stop,
            limit=min(limits, default=None),
            wall_time=time.perf_counter() - self._begin,
            first_sample=record.first_sample,
            reward=getattr(system, "reward", None),
            case=self._case,
            seed=self._seed,
            label=self._label,
        )

    def _fail(self, error: BaseException) -> None:
        """Ends the simulation with an error, which carries the run."""
        if not self.over:
            self._close()
        if self.run is not None:
            carry(error, self.run)


def _variables(specs: Mapping[str, rtamt.Specification]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for spec in specs.values() for name in spec.variables))


def _loaded(specs: SpecsLike | None, system: object, name: str) -> dict[str, rtamt.Specification]:
    """The specifications; None: those that an environment has of its own."""
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


def _refuse_options(given: Mapping[str, object]) -> None:
    """Refuses what a monitor has of its own."""
    if type(given.get("specs")).__name__ == "Snapshot":
        raise InputTypeError(
            "expected a snapshot as start=, got it as specs; "
            "write simulate(monitor, start=snapshot)"
        )
    for name, value in given.items():
        if value is not None:
            raise InputError(
                f"{name}= is for systems without a monitor, got {name}={value!r} for a "
                f"StepMonitor, which has its own; give it to StepMonitor(...)"
            )


def _most(duration: float | None, period: Fraction | None, system: System) -> int | None:
    """The number of steps after which a run is cut short, or None.

    Raises:
        InputError: If it might go on for ever, or the duration is not positive.
    """
    if duration is None:
        if system.endless:
            raise InputError(
                f"{system.name} does not end by itself; give ",
                Argument("duration"),
                " in seconds, or ",
                Argument("duration", "inf", words="duration=math.inf"),
                " to run until it is stopped",
            )
        return None
    if duration == math.inf:
        return None
    # A duration that is a float may lie a little below a whole number of periods.
    return int(exact(check_number("duration", duration)) / (period or 1))
