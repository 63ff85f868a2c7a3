"""`simulate`: runs one simulation of any kind under specifications."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from fractions import Fraction
from numbers import Real
from typing import Any, Literal, get_args

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv

import rtamt
from rtamt import InputError, InputTypeError
from rtamt_gym.checks.arguments import check_choice, check_number
from rtamt_gym.judges.interface import EXACT, Interface, Names, Semantics
from rtamt_gym.judges.panel import Assessment, Panel
from rtamt_gym.judges.specs import Align, Nan, SpecsLike, View, check_period, load_specs
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.simulation.record import Course, Floats, RunEnd, Stop
from rtamt_gym.simulation.run import Run
from rtamt_gym.simulation.systems import Environment, Policy, SampleSource, System, exact

__all__ = ["simulate"]


def simulate(
    system: Any,  # noqa: ANN401 - MuJoCo is not typed
    specs: SpecsLike,
    signals: Mapping[str, SignalLike] | None = None,
    *,
    policy: Policy | None = None,
    seed: int | None = None,
    period: float | str | None = None,
    duration: float | None = None,
    stop: Stop = "violation",
    view: View = "episode",
    nan: Nan = "raise",
    align: Align | None = None,
    semantics: Semantics = "standard",
    inputs: Names | None = None,
    outputs: Names | None = None,
    label: str = "",
    substeps: bool = False,
) -> Run:
    """Runs a simulation under specifications until a violation is certain; records every sample.

    | system | ``signals`` | ``policy`` |
    |---|---|---|
    | a Gymnasium environment | selectors, as for `StlMonitor` | the action for an observation |
    | ``(model, data)`` of MuJoCo | selectors, as for `StepMonitor` | sets ``data.ctrl``; optional |
    | `Fmus`: FMUs connected | names of their variables | |
    | a function from time to sample | keys of the sample | |
    | an iterable of samples, or a generator function | keys of the sample | |

    A sample is a mapping from names to numbers. For the last three systems, a variable that is not
    in ``signals`` reads the value of its own name.

    Sample 0 is the state before the first step: an environment's observation at reset, the present
    state of a MuJoCo model's data, an FMU's outputs after its initialization. If a system ends by
    itself, the trace is complete and the verdicts are final. If it is cut short by a time limit or
    by ``duration``, it could have gone on, so an open verdict stays UNDECIDED. Write
    ``always[0:10]`` for a verdict after 10 s.

    Args:
        system: The simulation to run, one of those above.
        specs: A specification (text, path of a ``.stl`` file, formula, or `rtamt.Specification`),
            or several with their names.
        signals: What the variables of the specifications read, and what else to record: signals
            that no specification reads are in the run and its picture too.
        policy: The function that acts. Its arguments are the observation, or model and data. For
            more of an environment, use a closure: ``lambda obs: act(env.unwrapped)``.
        seed: The seed of an environment's reset.
        period: Time between samples, in seconds or as text with a unit. None: the system's own. For
            a system without one, ``1`` makes bounds in the default unit count steps.
        duration: The longest simulated time, in seconds (in steps without a period). None: until
            the system ends by itself. A model, an FMU or a function of time never does; with
            ``math.inf`` they run until they are stopped.
        stop: When to stop. ``"violation"``: at the first certain violation; ``"decided"``: also
            once every verdict is certain; ``"end"``: not before the end.
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

    Returns:
        The signals, the robustness with its bounds and verdicts at every sample, and why it ended.

    Raises:
        SpecificationError: If a specification is wrong, reads the first sample only, has a bound
            that is not a multiple of the period without ``align``, or needs a period and has none.
        InputError: If a variable cannot be read, a policy, a period or a duration is missing, a
            signal is nan, the semantics is unknown, or a name in ``inputs`` or ``outputs`` is no
            variable.
        InputTypeError: If the system is not one of those above.

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
    check_choice("stop", stop, get_args(Stop))
    check_choice("view", view, get_args(View))
    check_choice("nan", nan, get_args(Nan))
    check_choice("align", align, (None, *get_args(Align)))
    if substeps and not isinstance(system, gym.Env):
        raise InputError(
            f"substeps=True is for environments, whose step makes several, got {system!r}; give a "
            "smaller period= where the system takes one"
        )
    loaded = load_specs(specs)
    ran = _as_system(system, policy, seed, substeps=substeps)
    if period is None:
        period = ran.period
    if period is None and ran.needs_period:
        raise InputError(f"{ran.name} does not say how long a step lasts; give period= in seconds")
    check_period(loaded, period, ran.name)
    interface = Interface(semantics, inputs, outputs)
    panel = Panel(loaded, period, view, interface=interface, align=align)
    most = _most(duration, panel.period, ran)
    limits = [steps for steps in (most, ran.limit) if steps is not None]
    variables = list(dict.fromkeys(name for spec in loaded.values() for name in spec.variables))
    ran.bind(variables, signals, panel.period)
    with closing(ran):
        begin = time.perf_counter()
        record = _Recorder(panel, variables, signals or {}, nan)
        ended = _loop(ran, panel, record, stop, most)
        wall_time = time.perf_counter() - begin
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
        wall_time=wall_time,
        align=align,
    )


def _loop(system: System, panel: Panel, record: _Recorder, stop: Stop, most: int | None) -> RunEnd:
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
        if steps == most:
            return "duration"
        values = system.advance()
        steps += 1
    if system.ended == "truncated":
        return "truncated"
    panel.finish()
    record.amend()
    return "terminated"


class _Recorder:
    """Feeds samples to the monitors; keeps the samples and the values of the monitors."""

    def __init__(
        self, panel: Panel, variables: Sequence[str], signals: Iterable[str], nan: Nan
    ) -> None:
        self._panel = panel
        self._holds = nan == "hold"
        self._names = list(dict.fromkeys([*variables, *signals]))
        self._unread = range(len(variables), len(self._names))
        self._samples: list[Sequence[float]] = []
        self._curves: dict[str, list[Assessment]] = {name: [] for name in panel.monitors}
        self._feed = panel.feeder(variables)
        self._monitors = [
            (source, judge, self._curves[name].append)
            for name, (source, judge) in panel.monitors.items()
        ]

    def take(self, values: Sequence[float]) -> None:
        """Feeds and keeps a sample: the variables, then the signals that are not variables."""
        if self._holds and self._samples:
            last = self._samples[-1]
            values = [kept if new != new else new for new, kept in zip(values, last, strict=True)]  # noqa: PLR0124 - nan
        self._feed(values)
        for source, judge, keep in self._monitors:
            keep((source.robustness, judge.lower, judge.upper))
        for index in self._unread:  # values that no monitor reads, and so checks
            value: object = values[index]
            if not isinstance(value, Real):
                raise InputTypeError(
                    f"expected a number for {self._names[index]!r} at sample {len(self._samples)}, "
                    f"got {type(value).__name__} {value!r}"
                )
        self._samples.append(tuple(values))

    def amend(self) -> None:
        """Replaces the last values of the monitors by those after the end of the trace."""
        for name, (monitor, judge) in self._panel.monitors.items():
            self._curves[name][-1] = monitor.robustness, judge.lower, judge.upper

    def signals(self) -> dict[str, Floats]:
        """The values of every signal."""
        shape = len(self._samples), len(self._names)
        table = np.array(self._samples, dtype=np.float64).reshape(shape)
        return dict(zip(self._names, np.ascontiguousarray(table.T), strict=True))

    def courses(self, specs: Mapping[str, rtamt.Specification]) -> dict[str, Course]:
        """The course of every specification."""
        outcomes = self._panel.outcomes()
        courses = {}
        for name, (_, judge) in self._panel.monitors.items():
            robustness, lower, upper = np.ascontiguousarray(np.array(self._curves[name]).T)
            courses[name] = Course(
                str(specs[name].formula),
                robustness,
                lower,
                upper,
                judge.robustness,
                judge.verdict,
                outcomes[name].get("decided_at"),
                specs[name].unit,
                judge.interface.semantics,
                _of_role("input", judge),
                _of_role("output", judge),
            )
        return courses


def _of_role(role: Literal["input", "output"], judge: rtamt.EpisodeMonitor) -> tuple[str, ...]:
    """The variables of a formula that have a role; none under semantics that ask for no roles."""
    if judge.interface.semantics in EXACT:
        return ()
    variables = judge.specification.formula.variables
    return tuple(name for name in variables if judge.interface.role(name) == role)


def _as_system(
    system: Any,  # noqa: ANN401
    policy: Policy | None,
    seed: int | None,
    *,
    substeps: bool,
) -> System:
    """The caller's simulation as a `System`."""
    if isinstance(system, gym.Env):
        return Environment(system, policy, seed, substeps=substeps)
    if isinstance(system, VectorEnv):
        raise InputError(
            f"expected one environment, got {system}; VectorStlMonitor monitors many at once"
        )
    if isinstance(system, str | os.PathLike):
        fmu = os.fspath(system).endswith(".fmu")
        raise InputTypeError(
            "expected a system to run, got its name; write "
            f"{'Fmus' if fmu else 'gym.make'}({os.fspath(system)!r})"
        )
    if seed is not None:
        raise InputError(f"seed= is for environments, got seed={seed!r} for {system!r}")
    if isinstance(system, tuple | list) and {type(part).__name__ for part in system} == _MUJOCO:
        from rtamt_gym.simulation.mujoco import Model

        model, data = system
        return Model(model, data, policy)
    if policy is not None:
        raise InputError(
            f"policy= is for environments and MuJoCo models, got {policy!r} for {system!r}"
        )
    if isinstance(system, System):
        return system
    if hasattr(system, "keys"):
        raise InputTypeError(
            "expected samples one after the other, got columns; rtamt.evaluate takes these, and "
            "to_dict('records') makes samples of a data frame"
        )
    if callable(system) or isinstance(system, Iterable):
        return SampleSource(system)
    raise InputTypeError(
        "expected an environment, a pair (model, data) of MuJoCo, Fmus, a function of time or an "
        f"iterable of samples, got {system!r}"
    )


_MUJOCO = {"MjModel", "MjData"}


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
