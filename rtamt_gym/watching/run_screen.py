"""Simulations on the screen: an episode is drawn while it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Final, Unpack

from rtamt import InputError, Verdict
from rtamt_gym.judging.monitor_set import MonitorSetResult
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options
from rtamt_gym.play.history import Stop
from rtamt_gym.play.run import Run
from rtamt_gym.play.simulate import Simulator, simulate
from rtamt_gym.play.simulation import Simulation
from rtamt_gym.results.outcome import Moment
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.system import Policy, no_exit
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.screen import Screen

if TYPE_CHECKING:
    from rtamt_gym.live.view import RerunView

_STEP: Final = 0.05
"""The longest pause in seconds, after which the picture may be drawn again."""


class RunScreen:
    """Runs episodes on a screen.

    Args:
        screen: The view.
        speed: The simulated seconds in a second; None: as fast as possible.
        clock: Returns seconds.
        pause: Waits for some seconds.
    """

    def __init__(
        self,
        screen: Screen,
        speed: float | None = None,
        clock: Callable[[], float] = monotonic,
        pause: Callable[[float], None] = sleep,
    ) -> None:
        self._screen, self._speed, self._clock, self._pause = screen, speed, clock, pause

    def simulate(
        self,
        title: str,
        system: Any,  # noqa: ANN401 - of any kind that `simulate` takes
        specs: SpecsLike,
        signals: Mapping[str, SignalLike],
        *,
        policy: Policy | None = None,
        seed: int | None = None,
        stop: Stop = "violation",
        live: RerunView | None = None,
        **reading: Unpack[EvaluationKeywords],
    ) -> Run:
        """Run a simulation as `rtamt_gym.simulate` does, and show each of its samples.

        Args:
            title: The title of the view.
            system: The simulation, such as a Gymnasium environment.
            specs: The specifications by name.
            signals: The sources of the variables.
            policy: A function of the observation.
            seed: The seed of the reset.
            stop: When to stop.
            live: A view in Rerun that shows each sample too; None: none.
            **reading: Evaluation options.

        Raises:
            InputError: If the speed is set and the period is not known.
        """
        options = checked_options(reading, simulate, "runs")
        self._screen.restart(title)
        with no_exit("the system"):
            simulator = Simulator(system, specs, signals, options, policy=policy)
            simulation = simulator.begin(seed=seed, stop=stop, live=live)
            begin = self._clock()
            while not simulation.step():
                self._show(simulation)
                self._wait(simulation, begin)
        run = simulation.run
        assert run is not None  # noqa: S101 - for mypy
        self._screen.update(_finals(run), run.last_sample + 1)
        self._screen.end(f"ended: {run.ended}")
        return run

    def _show(self, simulation: Simulation) -> None:
        moment = simulation.moment
        assert moment.sample is not None  # noqa: S101 - for mypy
        period = simulation.period
        lines = (_line(result, moment, period) for result in simulation.results())
        self._screen.update(lines, moment.sample + 1)

    def _wait(self, simulation: Simulation, begin: float) -> None:
        """Wait until the next sample is due."""
        if self._speed is None:
            return
        moment, period = simulation.moment, simulation.period
        if period is None or moment.seconds is None:
            raise InputError("--speed needs the time between samples. Give --period.")
        due = begin + (moment.seconds + float(period)) / self._speed
        while (left := due - self._clock()) > 1e-9:
            self._pause(min(left, _STEP))
            self._screen.update((), (moment.sample or 0) + 1)


def _line(result: MonitorSetResult, moment: Moment, period: Fraction | None) -> Line:
    name, bounds, verdict, decided, _ = result
    at = None if decided is None else Moment.of(decided, period).time
    return Line(name, None, moment.seconds, moment.sample, verdict, *bounds, decided_at=at)


def _finals(run: Run) -> Iterator[Line]:
    last = Moment.of(run.last_sample, run.period)
    for name, history in run.histories.items():
        verdict: Verdict = history.verdict
        bounds = history.final, float(history.lower[-1]), float(history.upper[-1])
        result = name, bounds, verdict, history.decided_at, history.ended_at
        yield _line(result, last, run.period)._replace(final=True)
