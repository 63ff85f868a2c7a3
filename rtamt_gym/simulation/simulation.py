"""`Simulation`: one simulation under specifications, which can be made step by step."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple, cast, get_args

import gymnasium as gym

import rtamt
from rtamt import End, InputError, InputTypeError
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_choice, check_known, check_number
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.judging.ends import AtTermination, warn_of_open_end
from rtamt_gym.judging.panel import Panel
from rtamt_gym.judging.reading import Reading
from rtamt_gym.judging.specs import (
    SpecsLike,
    check_period,
    load_specs,
    own_requirements,
    why_no_period,
)
from rtamt_gym.mujoco.values import PanelValues
from rtamt_gym.results.trial import RunEnd
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.simulation.crashes import carry
from rtamt_gym.simulation.kinds import as_system
from rtamt_gym.simulation.record import AT_VERDICTS, AT_VIOLATION, KNOWN_EVERY, Stop
from rtamt_gym.simulation.recorder import Recorder
from rtamt_gym.simulation.run import Run
from rtamt_gym.simulation.systems import Environment, Policy, System

if TYPE_CHECKING:  # it imports MuJoCo, which is optional
    from rtamt_gym.mujoco.snapshots import Snapshot
    from rtamt_gym.mujoco.step_monitor import StepMonitor

__all__ = ["Simulation"]


class Simulation:
    """One simulation under specifications; `rtamt_gym.simulate` documents the arguments.

    Attributes:
        run: The run; None as long as the simulation is not over, and where an error came before
            sample 0.
    """

    run: Run | None = None

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
        seed: int | None = None,
        duration: float | None = None,
        stop: Stop = "violation",
        above: Mapping[str, float] | None = None,
        label: str = "",
    ) -> None:
        _check_stop(stop, above)
        if reading.substeps and not isinstance(system, gym.Env):
            raise InputError(
                Argument("substeps", value=True),
                f" is for environments, whose step makes several, got {system!r}; give a smaller ",
                Argument("period"),
                " where the system takes one",
            )
        given = None if case is None else Case(case)
        ran = as_system(system, policy, seed, start, given, substeps=reading.substeps)
        monitor = cast("StepMonitor", system) if isinstance(system, PanelValues) else None
        if monitor is not None:
            _refuse_options({"specs": specs, "signals": signals, "above": above})
            reading = reading.over(monitor.reading, "the StepMonitor", "leave it out")
            loaded, panel = monitor.specs, monitor.panel
            signals = dict.fromkeys(monitor.signals, "")
            most = _most(duration, exact(ran.period or 1), ran)
        else:
            loaded = _loaded(specs, system, ran.name)
            if reading.period is None:
                reading = reading.having(period=ran.period)
            if reading.period is None and ran.needs_period:
                lacks = ran.needs_period
                reason = lacks if isinstance(lacks, str) else "does not say how long a step lasts"
                raise InputError(f"{ran.name} {reason}; give ", Argument("period"), " in seconds")
            why = why_no_period(system) if isinstance(system, gym.Env) else ""
            check_period(loaded, reading.period, ran.name, why)
            check_known("above", above or {}, loaded)
            panel = Panel(loaded, reading)
            most = _most(duration, panel.period, ran)
        variables = list(dict.fromkeys(name for spec in loaded.values() for name in spec.variables))
        ran.bind(variables, signals, panel.period)
        limits = [steps for steps in (most, ran.limit) if steps is not None]
        goes_on = monitor is not None and start is None
        ends = _Ends(
            reading.at_termination, reading.at_truncation, isinstance(ran, Environment), goes_on
        )
        self._system, self._panel, self._ends, self._loaded = ran, panel, ends, loaded
        self._stop, self._above, self._most = stop, above or {}, most
        self._record = Recorder(
            panel, variables, signals or {}, reading.nan, fed=monitor is not None
        )
        self._ended: RunEnd = "error"
        self._steps = 0  # and one more once sample 0 was taken
        self._begin = time.perf_counter()
        self._told: dict[str, Any] = {
            "system": ran.name,
            "period": panel.period,
            "view": reading.view,
            "stop": stop,
            "limit": min(limits, default=None),
            "seed": seed,
            "label": label,
            "align": reading.align,
            "case": given,
        }

    def go(self) -> Run:
        """Runs the simulation until it is over."""
        try:
            while self.run is None:
                self._step()
        except BaseException as error:
            self._fail(error)
            raise
        return self.run

    def step(self) -> bool:
        """Takes sample 0, or makes a step and takes the sample after it; whether it is over."""
        try:
            self._step()
        except BaseException as error:
            self._fail(error)
            raise
        return self.run is not None

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
            self._ended = why
            _finish(self._record, self._panel, why, self._ends)
            self._close()

    def _take(self, values: Sequence[float]) -> RunEnd | None:
        """Feeds a sample to the monitors; returns why the run is over, if it is."""
        panel, stop = self._panel, self._stop
        self._record.take(values)
        if self._system.ended:
            return self._system.ended
        if stop in AT_VIOLATION and panel.violated_by is not None:
            return "violation"
        if stop in AT_VERDICTS and panel.all_decided:
            return "decided"
        if stop == "known" and self._steps % KNOWN_EVERY == 0 and panel.knows(self._above):
            return "known"
        return "duration" if self._steps == self._most else None

    def _close(self) -> None:
        """Makes the run, if there is a sample, and closes the system."""
        try:
            if self._ended == "error":
                self._record.rewind()
            self.run = self._made() if len(self._record) else None
        finally:
            self._system.close()

    def _made(self) -> Run:
        record = self._record
        return Run(
            signals=record.signals(),
            courses=record.courses(self._loaded),
            ended=self._ended,
            violated_by=self._panel.violated_by,
            wall_time=time.perf_counter() - self._begin,
            first_sample=record.first_sample,
            reward=getattr(self._system, "reward", None),
            **self._told,
        )

    def _fail(self, error: BaseException) -> None:
        """Ends the simulation with an error, which carries the run."""
        if self.run is None:
            self._close()
        if self.run is not None:
            carry(error, self.run)


def _loaded(specs: SpecsLike | None, system: object, name: str) -> dict[str, rtamt.Specification]:
    """The specifications; None: those that an environment has of its own."""
    own = own_requirements(system)
    if specs is None and not own:
        raise InputTypeError(
            f"expected specifications for {name}, got none; "
            'write simulate(system, "always(x < 1)", ...)'
        )
    return load_specs(own if specs is None else specs, own)


class _Ends(NamedTuple):
    """How the end of a run is read, and whether the system is there to go on after it."""

    at_termination: AtTermination | None
    at_truncation: End
    environment: bool
    goes_on: bool


def _finish(record: Recorder, panel: Panel, ended: RunEnd, ends: _Ends) -> None:
    """Reads the end of a run; a run that was stopped has none."""
    if ended == "truncated" or (ended == "duration" and not ends.goes_on):
        record.finish(ends.at_truncation)
    if ended != "terminated":
        return
    undecided = panel.undecided
    record.finish(ends.at_termination or "complete")
    settled = next((name for name in undecided if panel.satisfies(name)), None)
    if ends.environment and ends.at_termination is None and settled is not None:
        warn_of_open_end(settled)


def _check_stop(stop: Stop, above: Mapping[str, float] | None) -> None:
    check_choice("stop", stop, get_args(Stop))
    if above is not None and stop != "known":
        raise InputError(f"expected above= with stop='known' alone, got stop={stop!r}")


def _refuse_options(given: Mapping[str, object]) -> None:
    """Refuses what a monitor has of its own."""
    if type(given["specs"]).__name__ == "Snapshot":
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
