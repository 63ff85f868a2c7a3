"""`simulate`: runs one simulation of any kind under specifications."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple, cast, get_args

import gymnasium as gym

import rtamt
from rtamt import InputError, InputTypeError
from rtamt_gym.checks.arguments import check_choice, check_known, check_number
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.judges.ends import AtTermination, AtTruncation, warn_of_open_end
from rtamt_gym.judges.interface import Interface, Names, Semantics
from rtamt_gym.judges.panel import Panel
from rtamt_gym.judges.specs import (
    Align,
    Nan,
    SpecsLike,
    View,
    check_period,
    load_specs,
    own_requirements,
    why_no_period,
)
from rtamt_gym.mujoco.values import PanelValues
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.simulation.crashes import carry
from rtamt_gym.simulation.kinds import as_system
from rtamt_gym.simulation.record import KNOWN_EVERY, RunEnd, Stop
from rtamt_gym.simulation.recorder import Recorder
from rtamt_gym.simulation.run import Run
from rtamt_gym.simulation.systems import Environment, Policy, System

if TYPE_CHECKING:  # it imports MuJoCo, which is optional
    from rtamt_gym.mujoco.snapshots import Snapshot
    from rtamt_gym.mujoco.step_monitor import StepMonitor

__all__ = ["simulate"]


def simulate(
    system: Any,  # noqa: ANN401 - MuJoCo is not typed
    specs: SpecsLike | None = None,
    signals: Mapping[str, SignalLike] | None = None,
    *,
    case: Mapping[str, float | Waveform] | None = None,
    start: Snapshot | None = None,
    policy: Policy | None = None,
    seed: int | None = None,
    period: float | str | None = None,
    duration: float | None = None,
    stop: Stop = "violation",
    above: Mapping[str, float] | None = None,
    view: View = "episode",
    nan: Nan = "raise",
    align: Align | None = None,
    semantics: Semantics = "standard",
    inputs: Names | None = None,
    outputs: Names | None = None,
    label: str = "",
    substeps: bool = False,
    at_termination: AtTermination | None = None,
    at_truncation: AtTruncation = "cut",
) -> Run:
    """Runs a simulation under specifications until a violation is certain; records every sample.

    | system | ``signals`` | ``policy`` |
    |---|---|---|
    | a Gymnasium environment | selectors, as for `StlMonitor` | the action for an observation |
    | ``(model, data)`` of MuJoCo | selectors, as for `StepMonitor` | sets ``data.ctrl``; optional |
    | a `StepMonitor`, from its present state on | its own | sets ``data.ctrl``; optional |
    | `Fmus`: FMUs connected | names of their variables | |
    | a function from time to sample | keys of the sample | |
    | an iterable of samples, or a generator function | keys of the sample | |

    A sample is a mapping from names to numbers. For the last three systems, a variable that is not
    in ``signals`` reads the value of its own name; for an environment that has ``signals`` of its
    own, as scenarios do, what that says.

    A ``case`` is what this run is given by name, numbers and waveforms: actions, parameters and
    attributes of an environment; controls, initial states and constants of a model; inputs and
    parameters of FMUs; keyword arguments of a function or a generator function. A step of the
    simulation gets the value of a waveform at its start with ``"hold"``, at its end with
    ``"linear"`` and ``"pchip"``; a function gets the waveform itself, which is a function of time.
    Attributes, model and data are as before afterwards. docs/simulations.md lists the names.

    Sample 0 is the state before the first step: an environment's observation at reset, the present
    state of a MuJoCo model's data, an FMU's outputs after its initialization.

    What an open verdict becomes at the end of the run is said by ``at_termination``, where the
    system ends by itself, and by ``at_truncation``, where a time limit of the system or
    ``duration`` cuts the run short. A run that was stopped decides nothing more, nor does the
    ``duration`` of a `StepMonitor` that goes on afterwards: open verdicts stay UNDECIDED.

    A `StepMonitor` has specifications and options of its own. Its run goes on as `StepMonitor.run`
    does, to the last bit: robustness, bounds and verdicts are those of the whole episode, and the
    first recorded sample is the monitor's last one, or sample 0 if it has none. Afterwards the
    monitor stands at the end of the run. With ``start=snapshot`` the run is a branch: it goes on
    from the snapshot, and afterwards monitor and simulation are what they were before the call, to
    the last bit. A policy may make such branches of the monitor that it drives.

    An error of the system, the policy or a signal after sample 0, and Ctrl-C too, comes with its
    own type, and with the samples so far as its attribute ``run``: a `Run` whose ``ended`` is
    ``"error"``, with the verdicts that these samples leave.

    Args:
        system: The simulation to run, one of those above.
        specs: A specification (text, path of a ``.stl`` file, formula, or `rtamt.Specification`),
            or several with their names; of a text, every formula that no other formula uses is
            one by itself. The name of a requirement that an environment has of its own
            (``"AT1"``) is that requirement, and None all of them. None for a `StepMonitor`.
        signals: What the variables of the specifications read, and what else to record: signals
            that no specification reads are in the run and its picture too.
        case: Numbers and waveforms by name, such as a `Case`, for this run.
        start: Where a `StepMonitor` branches off. None: it runs on from its present state.
        policy: The function that acts. Its arguments are the observation, or model and data. For
            more of an environment, use a closure: ``lambda obs: act(env.unwrapped)``. What a case
            drives, the policy does not. None: the ``baseline`` of an environment that has one.
        seed: The seed of an environment's reset.
        period: Time between samples, in seconds or as text with a unit. None: the system's own. For
            a system without one, ``1`` makes bounds in the default unit count steps.
        duration: The longest simulated time, in seconds (in steps without a period). None: until
            the system ends by itself. A model, an FMU or a function of time never does; with
            ``math.inf`` they run until they are stopped.
        stop: When to stop. ``"violation"``: at the first certain violation; ``"decided"``: also
            once every verdict is certain; ``"known"``: also once every robustness is known, which
            is looked at after every tenth sample; ``"end"``: not before the end.
        above: Numbers by specification, for ``stop="known"``: a robustness that is certain to stay
            above its number is known. Without one, it is known once it cannot change any more.
        view: ``"episode"``: a formula is about the run from sample 0 on; ``"step"``: about every
            instant.
        nan: ``"raise"`` refuses a signal that is nan; ``"hold"`` keeps its last value, in the
            record too.
        align: How a bound that is no multiple of the period becomes samples, as for
            `rtamt.Monitor`; None refuses it.
        semantics: How predicates count, as for `rtamt.Monitor`.
        inputs: Variables that the system reads, for interface-aware semantics; None: those that the
            texts declare ``input``.
        outputs: Variables that the system sets; None: those that the texts declare ``output``.
        label: A name for tables and pictures that tells who acted.
        substeps: Whether to take a sample after every step of the simulation that an environment
            makes inside of its own, as for `StlMonitor`. The run then stops at the sample that
            shows the violation, though the environment has made the whole step.
        at_termination: How an end of the system itself is read: ``"complete"``, the run is all
            there is (an invariant that held is satisfied, a goal not reached is violated);
            ``"cut"``, as a time limit; ``"failure"``, what is not decided yet is violated, whatever
            its robustness is. None is ``"complete"``, and warns where an environment's end so
            satisfies what was open.
        at_truncation: How a time limit is read: ``"cut"``, an ``always`` without bounds that held
            is satisfied, an ``eventually`` without bounds violated, and windows that were not seen
            to their end stay open; ``"complete"``; or ``"open"``, the run could have gone on, and
            open verdicts stay UNDECIDED.

    Returns:
        The signals, the robustness with its bounds and verdicts at every sample, and why it ended.

    Raises:
        SpecificationError: If a specification is wrong, reads the first sample only, has a bound
            that is not a multiple of the period without ``align``, or needs a period and has none.
        InputError: If a variable cannot be read, a policy, a period or a duration is missing, a
            signal is nan, the semantics is unknown, or a name in ``inputs`` or ``outputs`` is no
            variable; if a `StepMonitor` is given what it has of its own.
        InputTypeError: If the system is not one of those above, or specifications are missing.
        StateError: If the simulation is unstable; if a `StepMonitor` has finished.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import simulate
        >>> run = simulate(
        ...     gym.make("CartPole-v1"),
        ...     {"upright": "always(abs(angle) < 0.1)", "near": "always(abs(x) < 1)"},
        ...     {"angle": "obs[2]", "x": "obs[0]"},
        ...     policy=lambda obs: int(obs[3] > 0),
        ...     seed=1,
        ... )
        >>> run
        <Run of CartPole-v1: violation of near at 2.36 s, 119 samples>
        >>> run.courses["near"].verdict.name, run.courses["upright"].verdict.name
        ('VIOLATED', 'UNDECIDED')
    """
    _check_stop(stop, above)
    check_choice("view", view, get_args(View))
    check_choice("nan", nan, get_args(Nan))
    check_choice("align", align, (None, *get_args(Align)))
    check_choice("at_termination", at_termination, (None, *get_args(AtTermination)))
    check_choice("at_truncation", at_truncation, get_args(AtTruncation))
    if substeps and not isinstance(system, gym.Env):
        raise InputError(
            f"substeps=True is for environments, whose step makes several, got {system!r}; give a "
            "smaller period= where the system takes one"
        )
    given = None if case is None else Case(case)
    ran = as_system(system, policy, seed, start, given, substeps=substeps)
    monitor = cast("StepMonitor", system) if isinstance(system, PanelValues) else None
    if monitor is not None:
        _refuse_options(
            {"specs": specs, "signals": signals, "period": period, "inputs": inputs}
            | {"outputs": outputs, "align": align}
            | {"view": view if view not in {"episode", monitor.view} else None}
            | {"above": above}
            | {"nan": nan if nan not in {"raise", monitor.nan} else None}
            | {"semantics": semantics if semantics != "standard" else None}
        )
        loaded, panel, view, nan = monitor.specs, monitor.panel, monitor.view, monitor.nan
        align, signals = monitor.align, dict.fromkeys(monitor.signals, "")
        most = _most(duration, exact(ran.period or 1), ran)
    else:
        loaded = _loaded(specs, system, ran.name)
        if period is None:
            period = ran.period
        if period is None and ran.needs_period:
            raise InputError(
                f"{ran.name} does not say how long a step lasts; give period= in seconds"
            )
        why = why_no_period(system) if isinstance(system, gym.Env) else ""
        check_period(loaded, period, ran.name, why)
        interface = Interface(semantics, inputs, outputs)
        check_known("above", above or {}, loaded)
        panel = Panel(loaded, period, view, interface=interface, align=align)
        most = _most(duration, panel.period, ran)
    variables = list(dict.fromkeys(name for spec in loaded.values() for name in spec.variables))
    ran.bind(variables, signals, panel.period)
    limits = [steps for steps in (most, ran.limit) if steps is not None]
    goes_on = monitor is not None and start is None
    ends = _Ends(at_termination, at_truncation, isinstance(ran, Environment), goes_on)
    begin = time.perf_counter()
    record = Recorder(panel, variables, signals or {}, nan, fed=monitor is not None)
    ended: RunEnd = "error"

    def made() -> Run:
        return Run(
            system=ran.name,
            signals=record.signals(),
            courses=record.courses(loaded),
            ended=ended,
            violated_by=panel.violated_by,
            period=panel.period,
            view=view,
            stop=stop,
            limit=min(limits, default=None),
            seed=seed,
            label=label,
            wall_time=time.perf_counter() - begin,
            align=align,
            first_sample=record.first_sample,
            case=given,
            reward=getattr(ran, "reward", None),
        )

    run: Run | None = None
    try:
        with closing(ran):
            try:
                ended = _loop(ran, panel, record, stop, above or {}, most)
                _finish(record, panel, ended, ends)
            finally:
                if ended == "error":
                    record.rewind()
                run = made() if len(record) else None
    except BaseException as error:
        if run is not None:
            carry(error, run)
        raise
    return cast("Run", run)  # without an error there is a sample


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
    at_truncation: AtTruncation
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


def _loop(
    system: System,
    panel: Panel,
    record: Recorder,
    stop: Stop,
    above: Mapping[str, float],
    most: int | None,
) -> RunEnd:
    """Feeds samples to the monitors until the run is over; returns why it is."""
    values: Sequence[float] | None = system.start()
    steps = 0
    while values is not None:
        record.take(values)
        if system.ended:
            break
        if stop != "end" and panel.violated_by is not None:
            return "violation"
        if stop == "decided" and panel.all_decided:
            return "decided"
        if stop == "known" and steps % KNOWN_EVERY == 0 and panel.knows(above):
            return "known"
        if steps == most:
            return "duration"
        values = system.advance()
        steps += 1
    return system.ended or "terminated"


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
                f"{system.name} does not end by itself; give duration= in seconds, or "
                "duration=math.inf to run until it is stopped"
            )
        return None
    if duration == math.inf:
        return None
    # A duration that is a float may lie a little below a whole number of periods.
    return int(exact(check_number("duration", duration)) / (period or 1))
