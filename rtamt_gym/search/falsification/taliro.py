"""psy-taliro in both directions: it searches rtamt's systems, and `falsify` searches its models."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final, Unpack

import numpy as np

from rtamt import InputError, InputTypeError
from rtamt.errors import nearest
from rtamt_gym.checks.arguments import check_number
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case, Waveform, WaveformInterpolation
from rtamt_gym.inputs.space import Parameter, Signal, Space, SpaceLike
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.play.run import Run
from rtamt_gym.play.runner import Requirements, Runner
from rtamt_gym.search.sweeps.sweep import space_of
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.system import (
    Policy,
    Signals,
    System,
    as_number,
    named_signals,
    refuse_unknown,
)

try:
    import staliro
    from staliro.models import Model
    from staliro.optimizers import Sample
    from staliro.signals import SignalInput, pchip, piecewise_constant, piecewise_linear
except ModuleNotFoundError as error:
    raise naming_extra(error, "rtamt_gym.search.falsification.taliro") from error

if TYPE_CHECKING:
    from staliro.cost_func import Inputs, Result

__all__ = ["TaliroProblem", "TaliroSystem"]

State = dict[str, float]


@documents_options("episodes")
class TaliroProblem(Model[State, Case, Sample]):  # type: ignore[misc]  # it has no types here
    """A system with its requirements, as a model and a specification of psy-taliro.

    Each column of the space becomes a static input from 0 to 1. The trace of a simulation has the
    signals by name, so that specifications of psy-taliro can read them too. The ``extra.model`` of
    an evaluation is the case.

    Attributes:
        space: The space of the search.
        static_inputs: The argument of this name of ``staliro.TestOptions``.
        requirement: The minimum robustness of the requirements, as a specification.

    Args:
        system: As for `rtamt_gym.sweep`.
        requirements: As for `rtamt_gym.sweep`.
        space: As for `rtamt_gym.sweep`.
        fixed: Values that are the same in every simulation.
        seed: The seed of every simulation of an environment.
        signals: As for `rtamt_gym.simulate`.
        policy: As for `rtamt_gym.simulate`.
        duration: As for `rtamt_gym.simulate`.
        **reading: Evaluation options, as for `rtamt_gym.sweep`.

    Raises:
        RtamtError: As `rtamt_gym.sweep` does.

    Example:
        >>> import staliro
        >>> from staliro.optimizers import UniformRandom
        >>> from rtamt_gym import Parameter
        >>> space = [Parameter("height", 2, 8), Parameter("limit", 1, 4)]
        >>> problem = TaliroProblem("rtamt/RequestGrant-v0", "granted", space)
        >>> options = staliro.TestOptions(
        ...     static_inputs=problem.static_inputs, iterations=100, seed=1
        ... )
        >>> (run,) = staliro.test(problem, problem.requirement, UniformRandom(0.0), options)
        >>> last = run.evaluations[-1]
        >>> last.cost < 0, last.extra.model["height"] > 3
        (True, True)
    """

    def __init__(
        self,
        system: Any,  # noqa: ANN401 - MuJoCo is not typed
        requirements: Requirements | None = None,
        space: SpaceLike | None = None,
        *,
        fixed: Mapping[str, float | Waveform] | None = None,
        seed: int = 0,
        signals: Mapping[str, SignalLike] | None = None,
        policy: Policy | None = None,
        duration: float | None = None,
        **reading: Unpack[EvaluationKeywords],
    ) -> None:
        self._runner = Runner(
            system,
            requirements,
            signals=signals,
            policy=policy,
            duration=duration,
            batch=1,
            **checked_options(reading, type(self), "episodes").options(),
        )
        self.space = space_of(self._runner, space, "TaliroProblem")
        self.static_inputs = dict.fromkeys(self.space.columns, (0.0, 1.0))
        self.requirement: staliro.Specification[State, float, None] = _Requirement()
        self._fixed = fixed or {}
        self._seed = seed if self._runner.takes_seeds else None

    def simulate(self, inputs: Inputs[Sample]) -> Result[staliro.Trace[State], Case]:
        """Run the case of a sample to its end."""
        case = Case({**self.space.case(inputs.sample.values), **self._fixed})
        trace: staliro.Trace[State] = _RunTrace(self._runner.simulate(case, self._seed))
        return staliro.Result(trace, case)


class _RunTrace(staliro.Trace[State]):  # type: ignore[misc]  # it has no types here
    """The trace of a run, with the run."""

    def __init__(self, run: Run) -> None:
        samples = zip(*(values.tolist() for values in run.signals.values()), strict=True)
        states = [dict(zip(run.signals, sample, strict=True)) for sample in samples]
        super().__init__(times=run.times.tolist(), states=states)
        self.run = run


class _Requirement(staliro.Specification[State, float, None]):  # type: ignore[misc]  # it has no types here
    """The minimum robustness of the requirements at the end of a run."""

    def evaluate(self, trace: staliro.Trace[State], /) -> Result[float, None]:
        if not isinstance(trace, _RunTrace):
            raise InputTypeError(
                "expected a trace of a TaliroProblem, which has the robustness, got another; "
                "staliro.specifications.rtamt reads any trace"
            )
        return staliro.Result(min(entry.final for entry in trace.run.histories.values()), None)


class TaliroSystem(System):
    """A model of psy-taliro as a system that `rtamt_gym.falsify`, `sweep` and `simulate` run.

    Static inputs become parameters of `space`. A signal input with even control points of one range
    becomes a signal with the same control points. Any other signal input becomes a parameter for
    each control point: ``name[0]`` and so on. If a signal gets other control points, as in the
    reduction of a violating input, psy-taliro gets its values at the original times, and its
    factory interpolates between them.

    Attributes:
        space: The space of the search.

    Args:
        model: The model.
        options: The description of its inputs: ``tspan``, ``static_inputs`` and ``signals``.
        period: Seconds between samples. A trace with other times, such as the solution of a
            differential equation, is interpolated linearly.
        columns: The positions of variables in the states, ``{"gap": 0}``. Default: states have
            names.

    Raises:
        InputError: If there are no inputs, or signals without ``tspan``.
        InputTypeError: If model or options do not belong to psy-taliro.

    Example:
        >>> import staliro
        >>> from rtamt_gym import falsify
        >>> @staliro.model
        ... def tank(inputs):
        ...     inflow, levels = inputs.static["inflow"], [1.0]
        ...     for _ in range(20):
        ...         levels.append(0.9 * levels[-1] + inflow)
        ...     return staliro.Trace(times=range(21), states=[{"level": x} for x in levels])
        >>> options = staliro.TestOptions(static_inputs={"inflow": (0.0, 0.25)})
        >>> system = TaliroSystem(tank, options, period=1)
        >>> falsify(system, "always(level < 2)", system.space).input
        Case({'inflow': 0.25})
    """

    needs_period = True

    def __init__(
        self,
        model: staliro.models.Model[Any, Any, Sample],
        options: staliro.TestOptions,
        *,
        period: float,
        columns: Mapping[str, int] | None = None,
    ) -> None:
        for phrase, value, kind in (
            ("a model", model, Model),
            ("staliro.TestOptions", options, staliro.TestOptions),
        ):
            if not isinstance(value, kind):
                raise InputTypeError(f"expected {phrase} of psy-taliro, got {value!r}")
        self.name = getattr(model, "__name__", type(model).__name__)
        self.period = check_number("period", period)
        if options.signals and not np.isfinite(options.tspan.as_tuple()).all():
            raise InputError("expected options with tspan=(0, 30), which signals need, got none")
        self._inputs: list[_Static | _Driven] = [
            *(_Static(name, span.start, span.end) for name, span in options.static_inputs.items()),
            *(_Driven(name, signal, options.tspan) for name, signal in options.signals.items()),
        ]
        if not self._inputs:
            raise InputError("expected options with static_inputs= or signals=, got neither")
        self.space = Space([entry for source in self._inputs for entry in source.entries])
        self._model = model
        self._options = options
        self._columns = columns
        self._case: Case | None = None

    def driven(self, case: Case) -> TaliroSystem:
        """Return a copy of the model that runs with the inputs of a case."""
        for name in case:
            if name not in self.space.entries:
                refuse_unknown(self.name, name, self.space.entries)
        system = copy.copy(self)
        vars(system)["_case"] = case
        return system

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Store the recorded names and the period."""
        self._reads = named_signals(variables, signals)
        self._step = float(period or 1)

    def start(self) -> list[float]:
        """Run the model; return its first sample."""
        self.ended = ""
        case = self._case or Case({})
        missing = next((name for name in self.space.entries if name not in case), None)
        if missing is not None:
            raise InputError(
                f"{self.name} needs all of its inputs, {listing(self.space.entries)}, got no "
                f"{missing!r}; system.space.case(point) sets all"
            )
        values = [value for entry in self._inputs for value in entry.values(case)]
        trace = self._model.simulate(self._options.parse_sample(Sample(values))).value
        self._samples: Iterator[list[float]] = iter(self._table(trace).tolist())
        return next(self._samples)

    def advance(self) -> list[float] | None:
        """Return the next sample; None after the last."""
        sample = next(self._samples, None)
        if sample is None:
            self.ended = "terminated"
        return sample

    def close(self) -> None:
        """Keep nothing open."""

    def _table(self, trace: staliro.Trace[Any]) -> np.ndarray:
        """Return the samples of a trace, one period apart, shape (samples, values)."""
        times = np.array([*trace.times], np.float64)
        if not len(times):
            raise InputError(f"expected a trace with states from {self.name}, got an empty one")
        values = np.array([self._read(state) for state in trace.states], np.float64)
        steps = np.arange(round((times[-1] - times[0]) / self._step * (1 + 1e-12)) + 1)
        even = times[0] + steps * self._step
        if len(even) == len(times) and np.allclose(times, even, 0.0, 1e-6 * self._step):
            return values
        even = even[even <= times[-1]]
        return np.array([np.interp(even, times, column) for column in values.T]).T

    def _read(self, state: Any) -> list[float]:  # noqa: ANN401 - of a model
        if self._columns is not None:
            known: Any = self._columns
            values = {name: state[column] for name, column in self._columns.items()}
        elif isinstance(state, Mapping):
            known, values = state, {**state}
        else:
            raise InputError(
                f"expected the names of the states of {self.name}, which are numbers in a row; "
                'write columns={"gap": 0, ...}'
            )
        for name in self._reads:
            if name not in values:
                raise InputError(
                    f"{self.name} has no {name!r}; it has {listing(known)}{nearest(name, known)}"
                )
        return [values[name] for name in self._reads]


class _Static:
    """A static input: a parameter."""

    def __init__(self, name: str, low: float, high: float) -> None:
        self.entries: list[Signal | Parameter] = [Parameter(name, low, high)]
        self._name = name

    def values(self, case: Case) -> list[float]:
        return [as_number(self._name, case[self._name])]


class _Driven:
    """A signal input: a signal, or a parameter for each control point."""

    def __init__(self, name: str, signal: SignalInput, tspan: Any) -> None:  # noqa: ANN401
        points, begin, span = signal.control_points, tspan.start, tspan.end - tspan.start
        self._name = name
        self._count = len(points)
        at = (
            [time - begin for time in points]
            if isinstance(points, dict)
            else [span * i / self._count for i in range(self._count)]
        )
        ranges = [*points.values()] if isinstance(points, dict) else points
        self._distance = at[1] - at[0] if len(at) > 1 else span
        even = np.allclose(at, np.arange(self._count) * self._distance, 0.0, 1e-9 * span)
        kind = _KINDS.get(signal.factory)
        self._kind = kind if even and len(set(ranges)) == 1 else None
        self._times = np.array(at)
        if self._kind == "hold" or (self._kind is not None and self._count > 1):
            parts = self._count if self._kind == "hold" else self._count - 1
            self.entries: list[Signal | Parameter] = [
                Signal(
                    name,
                    *ranges[0],
                    points=self._count,
                    interpolation=self._kind,
                    duration=parts * self._distance,
                )
            ]
        else:
            self._kind = None
            self.entries = [
                Parameter(f"{name}[{i}]", entry.start, entry.end) for i, entry in enumerate(ranges)
            ]

    def values(self, case: Case) -> list[float]:
        """Return the values of the control points."""
        if self._kind is None:
            return [as_number(item.name, case[item.name]) for item in self.entries]
        entry = case[self._name]
        if not isinstance(entry, Waveform):
            return [entry] * self._count
        if len(entry.values) == self._count and entry.interpolation == self._kind:
            return [*entry.values]
        # The middle of a piece, where rounding cannot select the piece before.
        times = self._times + self._distance / 2 if self._kind == "hold" else self._times
        return list(map(float, entry.at(times)))


_KINDS: Final[Mapping[Any, WaveformInterpolation]] = {
    piecewise_constant: "hold",
    piecewise_linear: "linear",
    pchip: "pchip",
}
"""The interpolation of `Signal` for each signal factory of psy-taliro."""
