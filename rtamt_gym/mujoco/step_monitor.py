"""`StepMonitor`: a loop of `mj_step` monitored against specifications."""

from __future__ import annotations

import ctypes
import math
import warnings
from _ctypes import CFuncPtr  # the class of all functions of ctypes
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, Unpack, get_args

import mujoco  # type: ignore[import-untyped]

from rtamt import InputError, StateError, Verdict
from rtamt.renamed import OldName
from rtamt_gym.checks.arguments import check_choice, check_number
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.judging.judge import Judging, MonitorSetValues
from rtamt_gym.judging.monitor_set import Assessment, Feed, MonitorSet, SeeValues
from rtamt_gym.judging.specs import SpecsLike, load_specs
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.signals.mujoco import StepSignal, bind_signal, check_pair, derive
from rtamt_gym.signals.signals import parse_signals
from rtamt_gym.signals.sources import MUJOCO

if TYPE_CHECKING:
    from rtamt_gym.live.view import RerunView

_TOLERANCE = 0.01
"""In timesteps; the time of a simulation is a sum of timesteps, which rounding changes by less."""

_CHECKED = 16
"""Samples between two checks of the time; a check costs as much as a sample."""

_MOVED = 0.25
"""In timesteps; a simulation with a time further ahead has left its last sample."""

_SLACK = 1e-6
"""Relative difference between a period and a timestep that counts as rounding."""

_UNPICKLED = frozenset({"_reads", "_feed", "_feed_values", "_live"})

_WIDTH, _HEIGHT = 480, 360
"""The maximum size of rendered pictures."""

_mj_step = mujoco.mj_step

Controller = Callable[[Any, Any], object]
"""Called with model and data before a step, to set ``data.ctrl``."""

OnStepViolation = Literal["stop", "report"]
"""The effect of a certain violation on a run."""


@documents_options("instants")
class StepMonitor(MonitorSetValues):
    """Monitors a MuJoCo simulation against specifications, one sample for every ``mj_step``.

    Sample 0 is the state before the first step; every later sample is the state after a step.
    Variables of the specifications read numbers of the simulation by selectors:

    * ``time``, ``qpos[2]``, ``qvel[0]``, ``qacc[0]``, ``act[0]``, ``ctrl[0]``, ``sensordata[3]``
    * the fields that ``MjData`` has by name: ``sensor:imu[0]``, ``body:torso.xpos[2]``,
      ``joint:hip.qvel``, ``geom:foot.xpos[2]``, ``site:grip.xpos[0]``, ``actuator:motor.force``,
      ``tendon:cord.length``; a single number needs no index
    * ``contact:foot,floor``: 1 while the two geoms touch; otherwise 0. ``contact:foot,floor.force``
      is the sum of the normal forces between them, in newtons. A body name means all its geoms; one
      name alone means contact with anything; only contacts that MuJoCo's solver includes count
    * a function of model and data

    Quote names with dots, commas, colons, brackets or blanks: ``body:'arm.left'.xpos[2]``.
    After ``mj_step``, derived quantities (``xpos``, ``sensordata``, contacts, forces, ``qacc``) are
    one step late; ``forward=True`` computes all values of a sample for one instant.

    Args:
        model: A ``mujoco.MjModel``, kept as an attribute.
        data: A ``mujoco.MjData`` of the model, kept as an attribute.
        specs: As for `simulate`.
        signals: A selector or a function for every variable, and further signals to record.
        forward: Whether to call ``mj_forward`` after every step.
        live: A view that shows each sample with all signals, such as
            ``rtamt_gym.live.RerunView()``; copies do not show theirs. Default: no view.
        **reading: The evaluation options of `rtamt_gym.EvaluationOptions`. ``period=None`` reads
            ``model.opt.timestep``; another value causes a warning, except 1, which counts steps.

    Raises:
        SpecificationError: If a specification is wrong, or depends on the first sample only.
        InputError: If a variable has no signal, or a selector or an option is wrong.

    Example:
        >>> import mujoco
        >>> model = mujoco.MjModel.from_xml_string('''
        ...     <mujoco><worldbody><body name="ball" pos="0 0 1"><freejoint/><geom size=".1"/>
        ...     </body></worldbody></mujoco>''')
        >>> data = mujoco.MjData(model)
        >>> monitor = StepMonitor(model, data, "always(z > 0.5)", {"z": "qpos[2]"})
        >>> monitor.run(10.0).name, monitor.violated_at, round(data.time, 3)
        ('VIOLATED', 160, 0.32)
    """

    _feed: Feed

    panel = OldName("monitor_set")

    def __init__(
        self,
        model: Any,
        data: Any,
        specs: SpecsLike,
        signals: Mapping[str, StepSignal],
        *,
        forward: bool = False,
        live: RerunView | None = None,
        **reading: Unpack[EvaluationKeywords],
    ) -> None:
        read = checked_options(reading, type(self), "instants")
        check_pair(model, data)
        self.model, self.data = model, data
        self.specs = load_specs(specs)
        self._reads_period = read.period is None
        period = float(model.opt.timestep) if read.period is None else read.period
        self.reading = read.having(period=period).complete("instants")
        variables = dict.fromkeys(name for spec in self.specs.values() for name in spec.variables)
        self._signals = parse_signals(signals, variables, MUJOCO, extra=True)
        self._count = len(variables)
        for signal in self._signals:
            if signal.default is not None:
                raise InputError(
                    f"signal {signal.name!r}: {signal} can be read at sample 0 too, got a default "
                    f"{signal.default!r}; leave it out"
                )
        self.monitor_set = MonitorSet(self.specs, self.reading)
        self.forward = forward
        if live is not None:
            self._show(live)
        self._bind_signals()
        self._clock = StepClock()
        self._unchecked = 0
        self._tries = False
        self._pending: list[float] | None = None
        self._offered = False  # whether the last sample was offered inside of mj_step
        self._running = False
        self._seen_timestep = math.nan
        self._check_timestep()

    def reset(self) -> None:
        """Discard all samples, and take the state of the simulation now as sample 0.

        Calls ``mj_forward`` first, which derives the numbers that signals may read.

        Raises:
            StateError: If the timestep of the model has changed since construction, ``period`` was
                not set, and a specification has bounds in time.
            InputError: If a signal is nan or cannot be read.
        """
        self._running = False
        self._check_timestep()
        derive(self.model, self.data)
        self.monitor_set.reset()
        if self._live is not None:
            self._live.begin()
        self._pending, self._offered = None, False
        self._clock.start(self.data.time, float(self.model.opt.timestep))
        self._unchecked = 0
        self._take()
        self._running = True

    def step(self) -> float:
        """Step the simulation, take one sample, and return the robustness.

        The first step takes sample 0 before, unless `reset` did.

        Raises:
            StateError: After `finish` and after an error; and if the simulation is not at the time
                of the sample, because something else stepped or reset it, its timestep was changed,
                or MuJoCo reset an unstable simulation. The time is checked every 16 samples, and
                before any verdict is decided.
            InputError: If a signal is nan or cannot be read.
        """
        if not self._running:
            self._begin()
        _mj_step(self.model, self.data)
        if self.forward:
            derive(self.model, self.data)
        self._unchecked += 1
        if self._unchecked == _CHECKED:
            self._check_time(self.samples)
        return self._take()

    def run(
        self,
        duration: float,
        controller: Controller | None = None,
        *,
        on_violation: OnStepViolation = "stop",
    ) -> Verdict:
        """Step the simulation for some time, and return the verdict.

        Args:
            duration: Seconds of simulated time; the number of steps is the nearest.
            controller: Called with model and data before every step, to set ``data.ctrl``.
            on_violation: ``"stop"`` as soon as a violation is certain, or only ``"report"`` it.

        Raises:
            StateError: As `step` does.
            InputError: As `step` does; and if the duration is not a positive number.
        """
        check_choice("on_violation", on_violation, get_args(OnStepViolation))
        steps = round(check_number("duration", duration) / self.model.opt.timestep)
        if not self._running:
            self._begin()
        stops = on_violation == "stop"
        for _ in range(steps):
            if stops and self.monitor_set.violated_by is not None:
                break
            if controller is not None:
                controller(self.model, self.data)
            self.step()
        return self.verdict

    def attached(self) -> AbstractContextManager[None]:
        """Return a context that monitors a program with a loop of its own.

        Samples come from ``mjcb_control``, which MuJoCo calls inside ``mj_step``, one for every
        step. The first is sample 0, unless `reset` took it. The state after the last step is
        added at the end. A controller that was set before is called too.

        A sample is the state that a step starts from, not a state that the program only evaluates
        with ``mj_forward`` and then replaces. To distinguish them, the monitor takes a sample when
        the next one starts, so its robustness is one step late inside the context. Positions belong
        to the sample. Forces, accelerations and their sensors belong to the evaluation before it,
        which may be a trial: use `step` with ``forward=True`` for these.

        The callback is global for the process, and MuJoCo compiles no model while it is set: prefer
        `step` where the loop can be changed.

        Raises:
            StateError: At the end of the context, if a sample was missed: the program changed the
                time of the simulation, its timestep, or the callback. Steps of a trial that the
                program takes back change the time too.
            InputError: At the end of the context, if a signal was nan or could not be read.

        Example:
            >>> import mujoco
            >>> model = mujoco.MjModel.from_xml_string('''
            ...     <mujoco><worldbody><body><joint type="slide" axis="0 0 1" name="lift"/>
            ...     <geom size=".1"/></body></worldbody></mujoco>''')
            >>> data = mujoco.MjData(model)
            >>> monitor = StepMonitor(model, data, "always(z > -1)", {"z": "joint:lift.qpos"})
            >>> with monitor.attached():
            ...     mujoco.mj_step(model, data, nstep=100)
            >>> monitor.samples, monitor.verdict.name
            (101, 'UNDECIDED')
        """
        return attached(self.data, self._offer, self._offer_last)

    def finish(self) -> float:
        """End the trace with the last sample, and return its robustness.

        A run that a time limit cuts short has not ended: leave its verdict open. `step` raises
        until `reset`.

        Raises:
            StateError: Before sample 0.
        """
        if self._running:
            self._check_time(self.samples - 1)
        self.monitor_set.finish()
        if self._live is not None:
            self._live.end(self.monitor_set.describe())
        self._running = False
        return self.robustness

    @property
    def values(self) -> dict[str, float]:
        """The value of every signal now, also of signals that no specification reads."""
        return {
            signal.name: read() for signal, read in zip(self._signals, self._reads, strict=True)
        }

    @property
    def judging(self) -> Judging:
        """Specifications and evaluation options; the signals are its own."""
        return Judging(self.specs, None, self.reading)

    @property
    def signals(self) -> list[str]:
        """The names of all signals: first the variables of the specifications."""
        return [signal.name for signal in self._signals]

    @contextmanager
    def recorded(self, keep: Callable[[list[float]], object]) -> Iterator[None]:
        """Call ``keep`` with the values of all signals at every sample in this context.

        Every signal is read once for a sample: a function may count its calls.
        """
        feed = self.monitor_set.feeder(self.signals, decide=self._decide, keep=self._shown())

        def read_and_feed() -> Assessment:
            values = [read() for read in self._reads]
            assessment = feed(values)
            keep(values)
            return assessment

        before, self._feed = self._feed, read_and_feed
        try:
            yield
        finally:
            self._feed = before

    def begin(self) -> None:
        """Take sample 0, unless it was taken; then the simulation must be at the last sample.

        Raises:
            StateError: After `finish` and after an error; if something else stepped or reset it.
            InputError: If a signal is nan or cannot be read.
        """
        if self._running:
            self._check_time(self.samples - 1)
        else:
            self._begin()

    def state(self) -> tuple[Any, ...]:
        """Return the state of the monitors for `restore`, without the state of the simulation."""
        offers = self._pending, self._offered
        return self.monitor_set.state(), replace(self._clock), self._running, offers

    def restore(self, state: tuple[Any, ...]) -> None:
        """Restore a `state` of a monitor of the same specifications.

        Restore the simulation too: ``mj_setState`` with ``mjSTATE_INTEGRATION``.
        """
        monitor_set, clock, running, offers = state
        self.monitor_set.restore(monitor_set)
        self._clock, self._running, self._unchecked = replace(clock), running, 0
        self._pending, self._offered = offers

    def __getstate__(self) -> dict[str, Any]:
        return {name: self.__dict__[name] for name in self.__dict__ if name not in _UNPICKLED}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._bind_signals()

    def __repr__(self) -> str:
        return f"<StepMonitor of {', '.join(self.monitors)}, {self.verdict.name}>"

    def _bind_signals(self) -> None:
        """Make the functions that read this simulation, which pickle cannot carry."""
        self._reads = [bind_signal(signal, self.model, self.data) for signal in self._signals]
        # Without a view, a step does not read signals without a specification.
        self._fed = slice(self._count if self._live is None else None)
        names, keep = self.signals[self._fed], self._shown()
        self._feed = self.monitor_set.feeder(
            names, self._reads[self._fed], decide=self._decide, keep=keep
        )
        self._feed_values = self.monitor_set.feeder(names, decide=self.monitor_set.note, keep=keep)

    def _show(self, live: RerunView) -> None:
        """Show the samples in a live view."""
        period = self.period
        self._live = live.track(
            self.signals, [*self.specs], None if period is None else float(period)
        )
        if live.pictures is not None:
            self._live.draw(renderer(self.model, self.data), live.pictures)

    def _shown(self) -> SeeValues | None:
        """Return the function that shows the values of a sample in the live view, or None."""
        if self._live is None:
            return None
        self._live.follow(self.monitor_set.monitors)
        return self._live.sample

    def _begin(self) -> None:
        if self.monitor_set.samples:
            raise StateError(
                "expected a running simulation, got step() after finish() or after an error; "
                "call reset()"
            )
        self.reset()

    def _take(self) -> float:
        """Take a sample; return the robustness."""
        try:
            return self._feed()[0]
        except BaseException:
            # After a missed sample the monitor would count wrong.
            self._running = False
            raise

    def _check_timestep(self) -> None:
        """Refuse a timestep other than the period, or warn where bounds do not depend on it.

        An explicit period is the user's decision, so a difference is a warning. 1 counts steps.
        """
        timestep, period = float(self.model.opt.timestep), self.monitor_set.period
        if timestep == self._seen_timestep or period is None:
            return
        if math.isclose(timestep, period, rel_tol=_SLACK):
            self._seen_timestep = timestep
            return
        if not self._reads_period:
            self._seen_timestep = timestep
            if period != 1:
                warnings.warn(
                    f"period= is {float(period):g} s, but the timestep of the model is "
                    f"{timestep:g} s and every step is a sample, so bounds last "
                    f"{timestep / float(period):g} times as long as written; leave period= out, or "
                    "set period=1 to count steps",
                    UserWarning,
                    stacklevel=caller_level(),
                )
            return
        message = (
            f"the timestep of the model was {float(period):g} s when the monitor was made, and is "
            f"{timestep:g} s now; make a new StepMonitor"
        )
        if any(spec.timed for spec in self.specs.values()):
            raise StateError(message)
        self._seen_timestep = timestep
        warnings.warn(message, UserWarning, stacklevel=caller_level())

    def _offer(self) -> None:
        """Keep the state inside ``mj_step`` as the next sample, unless it is a trial.

        The time distinguishes trials. The simulation continued from the last state that was
        offered at a time, so a sample is taken when the time has moved on.
        """
        now, clock = self.data.time, self._clock
        if self.samples == 0 and self._pending is None:
            self._check_timestep()
            clock.start(now, float(self.model.opt.timestep))
            self._running = True
        elif not self._running:
            self._begin()
        if self._pending is not None and clock.ahead(now, self.samples) > _MOVED:
            self._feed_pending()
        sample = self.samples
        ahead = clock.ahead(now, sample)
        if clock.near(ahead, -0.5):  # RK4 tries the half of the step, twice, and then its end
            self._tries = True
        elif clock.near(ahead, 0.0) and self._tries:
            self._tries = False
        elif self._offered or self._pending is not None or not clock.near(ahead, -1.0):
            self._check_time(sample)
            self._pending = [read() for read in self._reads[self._fed]]
        # Otherwise reset() or step() took this sample before.

    def _offer_last(self) -> None:
        """Take the state after the last ``mj_step`` as a sample."""
        self._tries = False
        # A state that was evaluated since the last step may not be the present one.
        evaluated = self._pending is not None and (
            self._clock.ahead(self.data.time, self.samples) < _MOVED
        )
        if self.forward or evaluated:
            derive(self.model, self.data)
        self._offer()
        if self._pending is not None:
            self._feed_pending()
        self._offered = False

    def _feed_pending(self) -> None:
        """Take the pending sample; its time was checked when it was offered."""
        values, self._pending, self._offered = self._pending, None, True
        try:
            self._feed_values(values)
        except BaseException:
            self._running = False
            raise

    def _decide(self) -> None:
        """Record new verdicts, if the simulation is at the time of the sample."""
        self._check_time(self.samples - 1)
        self.monitor_set.note()

    def _check_time(self, sample: int) -> None:
        self._unchecked = 0
        try:
            self._clock.check(self.data.time, sample)
        except StateError:
            self._running = False
            raise


@dataclass(slots=True)
class StepClock:
    """The times of samples, counted from the last checked sample; in seconds."""

    time: float = math.nan
    sample: int = 0
    timestep: float = math.nan

    def start(self, now: float, timestep: float) -> None:
        """Set the time of sample 0."""
        self.time, self.sample, self.timestep = now, 0, timestep

    def ahead(self, now: float, sample: int) -> float:
        """Return the number of timesteps from the due time of a sample to ``now``."""
        return (now - self.time) / self.timestep - (sample - self.sample)

    def near(self, ahead: float, steps: float) -> bool:
        """Whether two numbers of timesteps are equal, up to rounding."""
        return abs(ahead - steps) < _TOLERANCE

    def check(self, now: float, sample: int) -> None:
        """Raise a `StateError` at another time than the sample's: samples are missing or extra."""
        if not self.near(self.ahead(now, sample), 0.0):
            due = self.time + (sample - self.sample) * self.timestep
            raise StateError(
                f"expected the time {due:.12g} s at sample {sample}, got {now:.12g} s: the "
                "simulation was stepped or reset by others, its timestep was changed, or it was "
                "unstable, so that MuJoCo reset it (data.warning); call reset()"
            )
        self.time, self.sample = now, sample  # rounding does not add up


def renderer(model: Any, data: Any) -> Callable[[], Any]:
    """Return a function that renders the simulation as an array of shape (height, width, 3)."""
    size = model.vis.global_
    scene = mujoco.Renderer(
        model, height=min(_HEIGHT, size.offheight), width=min(_WIDTH, size.offwidth)
    )

    def render() -> Any:
        scene.update_scene(data)
        return scene.render()

    return render


@contextmanager
def attached(data: Any, offer: Callable[[], None], last: Callable[[], None]) -> Iterator[None]:
    """Call ``offer`` for states of a simulation in this context, by ``mjcb_control``.

    The callback that was set before is called first. An exception of ``offer`` does not pass
    through MuJoCo: the first one is raised at the end of the context. ``last`` is called after the
    last step.
    """
    before = mujoco.get_mjcb_control()
    controller = _called_from_python(before)
    failed: Exception | None = None

    def control(model: Any, stepped: Any) -> None:
        nonlocal failed
        if controller is not None:
            controller(model, stepped)
        if stepped is data and failed is None:
            try:
                offer()
            except Exception as error:  # noqa: BLE001 - raised at the end of the context
                failed = error

    mujoco.set_mjcb_control(control)
    try:
        yield  # an error of the program passes through here, and comes first
    finally:
        replaced = mujoco.get_mjcb_control() is not control
        if not replaced:
            mujoco.set_mjcb_control(before)
    if failed is not None:
        raise failed
    if replaced:
        raise StateError(
            "expected mjcb_control as it was attached, but the program has set another callback: "
            "no samples came since; set the controller before, and the monitor calls it too"
        )
    last()


def _called_from_python(controller: Any) -> Any:
    """Return a function that calls a controller with model and data; None without a controller."""
    if not isinstance(controller, CFuncPtr):
        return controller
    # MuJoCo passes pointers, whatever argument types the controller declares; Numba makes functions
    # of ctypes too.
    pointed = ctypes.cast(controller, ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p))
    return lambda model, data: pointed(model._address, data._address)  # noqa: SLF001
