"""`Simulation`: one run of a system under specifications, and the recorder of its samples."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from itertools import pairwise
from numbers import Real
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, cast

import numpy as np

import rtamt
from rtamt import InputError, InputTypeError
from rtamt.monitors import Evidence, TriggerCount
from rtamt.typing import End, NanPolicy
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.end_warnings import assumed, warn_of_open_end
from rtamt_gym.judging.judge import Judge, TriggerCounter
from rtamt_gym.judging.monitor_set import Assessment, Feed, MonitorSet, MonitorSetResult
from rtamt_gym.judging.monitors import EXACT
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions
from rtamt_gym.play.history import Floats, HistoriesOnDemand, History, SimulatedTrace, Stop
from rtamt_gym.play.run import Run
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.trial import RunEnd, Trial
from rtamt_gym.signals.signals import Read, SignalLike
from rtamt_gym.systems.environment import Environment
from rtamt_gym.systems.system import System, exited
from rtamt_gym.tables import sample_text

if TYPE_CHECKING:  # they import MuJoCo and Rerun, which are optional
    from rtamt_gym.live.track import Track
    from rtamt_gym.live.view import RerunView
    from rtamt_gym.mujoco.step_monitor import StepMonitor

AT_VIOLATION: Final = frozenset[Stop]({"violation", "decided", "known"})
"""The stops at the first certain violation."""

AT_VERDICTS: Final = frozenset[Stop]({"decided", "verdicts"})
"""The stops once every verdict is certain."""

KNOWN_EVERY: Final = 10
"""The number of samples between checks whether every robustness is known, which are slow."""


class Recorder:
    """Updates the monitors with samples, and records the values that a run needs."""

    def __init__(
        self,
        monitor_set: MonitorSet,
        variables: Sequence[str],
        signals: Iterable[str] = (),
        nan: NanPolicy = "raise",
        *,
        keeps: bool = True,
        curves: bool = False,
        fed: bool = False,
        live: Track | None = None,
    ) -> None:
        self.monitor_set, self.first_sample = monitor_set, 0
        self.names = list(dict.fromkeys([*variables, *signals]))
        self._variables, self._holds, self._fed = variables, nan == "hold", fed
        self._further = range(len(variables), len(self.names))
        # One monitor takes a sample completely or not at all, so nothing has to be undone.
        single = len(monitor_set.monitors) == 1 and not keeps
        self._samples: list[Sequence[float]] | None = None if single else []
        self._curves: dict[str, list[Assessment]] = (
            {name: [] for name in monitor_set.monitors} if curves or fed else {}
        )
        self._state = monitor_set.state() if fed else None
        self._feed = monitor_set.feeder(variables)
        self._live = live
        if live is not None:
            live.follow(monitor_set.monitors)
            live.begin()
        self._reads: Sequence[Read] | None = None
        self._feed_step: Feed

    def __len__(self) -> int:
        """The number of samples."""
        return self.monitor_set.samples if self._samples is None else len(self._samples)

    @property
    def plain(self) -> bool:
        """True if monitors may read the steps of an environment without `take`."""
        return not self._further and not self._curves and self._live is None

    def reset(self) -> None:
        """Forget the samples, for another run."""
        self.monitor_set.reset()
        if self._samples is not None:
            self._samples.clear()

    def take(self, values: Sequence[float]) -> None:
        """Feed and keep a sample: the variables, then the further signals."""
        if self._fed:
            if not self._samples:
                self.first_sample = self.monitor_set.samples - 1
                self._state = self.monitor_set.state()
        else:
            self._feed(values)
        for index in self._further:  # values that no monitor reads, and so checks
            value: object = values[index]
            if type(value) is not float and not isinstance(value, Real):  # the second is slower
                raise InputTypeError(
                    f"expected a number for {self.names[index]!r} at sample {len(self)}, "
                    f"got {type(value).__name__} {value!r}"
                )
        self._keep(values)
        if self._live is not None:
            self._live.sample(values)

    def feeder(self, reads: Sequence[Read]) -> Feed:
        """Return the function that feeds a step of an environment; made again for other reads."""
        if reads is not self._reads:
            keep = None if self._samples is None else self._samples.append
            self._feed_step = self.monitor_set.feeder(self._variables, reads, keep=keep)
            self._reads = reads
        return self._feed_step

    def rewind(self) -> None:
        """Set the monitors to the last kept sample: an error may have come within the next one.

        Some monitors may have taken a sample that others have refused.
        """
        if self._samples is None:
            return
        samples = [*self._samples]
        self._samples.clear()
        for curve in self._curves.values():
            curve.clear()
        if self._state is None:
            self.monitor_set.reset()
        else:
            self.monitor_set.restore(self._state)
        for values in samples:
            if not self._fed or self._samples:
                self._feed(values)
            self._keep(values)

    def finish(self, end: AtTermination | End) -> None:
        """End the trace for the monitors; the last values of curves are those after the end."""
        self.monitor_set.finish(end)
        if self._curves:
            for name, state in self.monitor_set.describe().items():
                self._curves[name][-1] = state["robustness"], state["lower"], state["upper"]

    def show_end(self) -> None:
        """End the episode in the live view, if there is one."""
        if self._live is not None:
            self._live.end(self.monitor_set.describe())

    def columns(self) -> dict[str, Floats]:
        """Return the values of every variable and further signal; samples must be kept."""
        assert self._samples is not None  # noqa: S101 - as documented
        table = np.array(self._samples, np.float64).reshape(len(self._samples), len(self.names))
        if self._holds:
            for previous, values in pairwise(table):
                np.copyto(values, previous, where=np.isnan(values))
        return dict(zip(self.names, np.ascontiguousarray(table.T), strict=True))

    def replayed(self, monitor_set: MonitorSet, end: AtTermination | End | None) -> Recorder:
        """Feed the samples to further monitors, and keep the values of these at every sample."""
        other = Recorder(monitor_set, self._variables, self.names, curves=True)
        for values in self._samples or ():
            other.take(values)
        if end is not None:
            other.finish(end)
        return other

    def histories(
        self,
        specs: Mapping[str, rtamt.Specification],
        evidence: Mapping[str, Evidence[TriggerCount]],
    ) -> dict[str, History]:
        """Return the history of every specification."""
        outcomes = self.monitor_set.outcomes()
        histories = {}
        for name, (_, judge) in self.monitor_set.monitors.items():
            robustness, lower, upper = np.ascontiguousarray(np.array(self._curves[name]).T)
            outcome = outcomes[name]
            histories[name] = History(
                str(specs[name].formula),
                robustness,
                lower,
                upper,
                judge.robustness,
                rtamt.Verdict[outcome["verdict"]],
                outcome.get("decided_at"),
                specs[name].unit,
                judge.interface.semantics,
                _with_role("input", judge),
                _with_role("output", judge),
                None if name not in evidence else evidence[name].triggers,
                name in evidence and evidence[name].vacuous,
                outcome.get("progress"),
                outcome.get("ended_at"),
            )
        return histories

    def _keep(self, values: Sequence[float]) -> None:
        for name, curve in self._curves.items():
            source, judge = self.monitor_set.monitors[name]
            curve.append((source.robustness, judge.lower, judge.upper))
        if self._samples is not None:
            self._samples.append(tuple(values))


def _with_role(role: Literal["input", "output"], judge: rtamt.EpisodeMonitor) -> tuple[str, ...]:
    """Return the variables of a formula with a role; exact semantics do not use roles."""
    if judge.interface.semantics in EXACT:
        return ()
    variables = judge.specification.formula.variables
    return tuple(name for name in variables if judge.interface.role(name) == role)


class BoundSystem(NamedTuple):
    """A system with bound signals, its monitors and the options of its runs.

    Attributes:
        reads: The readers of the signals, if a step is one sample of an environment.
        most: The maximum number of steps.
        goes_on: Whether the episode goes on after the run, as for a `StepMonitor`.
        free: Recorders of finished runs without samples, for further runs.
    """

    system: System
    reads: Sequence[Read] | None
    specs: Mapping[str, rtamt.Specification]
    signals: Mapping[str, SignalLike]
    reading: EvaluationOptions
    variables: Sequence[str]
    period: Fraction | None
    most: int | None
    monitor: StepMonitor | None
    goes_on: bool
    judge: Judge | None
    free: list[Recorder]
    trigger_counter: TriggerCounter


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
        bound: BoundSystem,
        case: Case | None,
        seed: int | None,
        stop: Stop,
        above: Mapping[str, float],
        label: str,
        *,
        light: bool,
        live: RerunView | None,
    ) -> None:
        variables, signals, monitor = bound.variables, bound.signals, bound.monitor
        self._bound, self._system = bound, bound.system
        self._case, self._seed, self._label = case, seed, label
        self._stop, self._above, self._most = stop, above, bound.most
        self._light = light and monitor is None and all(name in variables for name in signals)
        if self._light and bound.free:
            self._record = bound.free.pop()
            self._record.reset()
        else:
            judge, monitored = bound.judge, cast("StepMonitor", monitor)
            self._record = Recorder(
                monitored.monitor_set if judge is None else judge.begin(),
                variables,
                () if self._light else signals,
                bound.reading.nan,
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
        bound, system = self._bound, self._system
        period = None if bound.period is None else float(bound.period)
        names = list(dict.fromkeys([*bound.variables, *bound.signals]))
        track = live.track(names, [*bound.specs], period)
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
            and self._bound.reading.at_termination is None
            and isinstance(self._system, Environment)
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
        reading, ended = self._bound.reading, self._ended
        if ended == "truncated" or (ended == "duration" and not self._bound.goes_on):
            return reading.at_truncation
        return (reading.at_termination or "complete") if ended == "terminated" else None

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
        bound, system = self._bound, self._system
        limits = [steps for steps in (self._most, system.limit) if steps is not None]
        return Run(
            system=system.name,
            signals=self._record.columns(),
            histories=self._histories(evidence),
            ended=self._ended,
            violated_by=self._monitor_set.violated_by,
            period=bound.period,
            view=bound.reading.view,
            align=bound.reading.align,
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
        record, judge, specs = self._record, self._bound.judge, self._bound.specs
        end = self._end
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
