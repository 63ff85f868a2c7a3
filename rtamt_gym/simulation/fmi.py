"""`Fmus`: functional mock-up units for co-simulation, connected, as a system for `simulate`."""

from __future__ import annotations

import math
import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import fmpy  # type: ignore[import-untyped]

from rtamt import InputError, InputTypeError
from rtamt_gym.checks.arguments import check_number
from rtamt_gym.checks.names import listing, nearest
from rtamt_gym.simulation.fmi_instance import Instance, Reader, Writer, kind_of
from rtamt_gym.simulation.systems import SystemEnd, named_signals

__all__ = ["Fmus"]

_Path = str | os.PathLike[str]

_Source = str | float | Callable[[float], float]
"""What an input receives: the value of another variable, a number, or a function of time."""

_Give = int | Callable[[float], float]
"""What an input is given: a number of the outputs that are connected, or a function of time."""


class _Place(NamedTuple):
    """A variable: its name with that of its FMU, the number of its FMU, and its description."""

    name: str
    fmu: int
    variable: Any


class Fmus:
    """FMUs for co-simulation, connected: what Simulink, Modelica tools and others export.

    All FMUs step from one communication point to the next; then outputs are handed to the inputs
    that they are connected to. The order of the FMUs means nothing, and an output that depends on
    an input at once is late by a communication step. FMI 2.0 and 3.0, single numbers only.

    A variable is called ``"plant.level"``: the name of its FMU, a dot, its own name. Where there is
    one FMU, its variables go by their own names as well.

    Args:
        fmus: The path of an FMU; or of several, which are named after their files; or several with
            their names.
        inputs: For input variables what they receive: another variable, a number, or a function of
            time. Others keep the value that their FMU gives them.
        parameters: Numbers for parameters, and for other variables that have a start value.
        step: Seconds between communication points. None: the period of the samples, which is the
            step size that the FMUs were exported with unless `simulate` is told another.

    Raises:
        InputError: If a file is no FMU for co-simulation of FMI 2.0 or 3.0, if there is no such
            variable (names the nearest), or if one cannot be read, set or connected.
        InputTypeError: On what is no path, no name, no number.

    Example:
        A controller and its plant::

            system = Fmus(
                ["controller.fmu", "plant.fmu"],
                inputs={
                    "plant.valve": "controller.valve",
                    "controller.level": "plant.level",
                    "controller.wanted": lambda t: 1.0 if t < 20 else 2.0,
                },
                parameters={"plant.area": 0.5},
            )
            simulate(system, "always(plant.level < 2.2)", duration=60).plot("levels.png")

    Source: Functional Mock-up Interface 2.0.4 and 3.0.1, Modelica Association; run by FMPy.
    """

    needs_period = True
    endless = True

    def __init__(
        self,
        fmus: _Path | Sequence[_Path] | Mapping[str, _Path],
        *,
        inputs: Mapping[str, _Source] | None = None,
        parameters: Mapping[str, float] | None = None,
        step: float | None = None,
    ) -> None:
        self._paths = _named(fmus)
        self.name = ", ".join(self._paths)
        self.limit: int | None = None
        self.ended: SystemEnd = ""
        self._step = None if step is None else check_number("step", step, 0.0)
        self._described = [_describe(path) for path in self._paths.values()]
        self._places: dict[str, _Place] = {}
        for i, (name, described) in enumerate(zip(self._paths, self._described, strict=True)):
            for variable in described.modelVariables:
                place = _Place(f"{name}.{variable.name}", i, variable)
                self._places[place.name] = place
                if len(self._paths) == 1:
                    self._places[variable.name] = place
        self._start_values: list[tuple[_Place, float]] = []
        for name, value in (parameters or {}).items():
            place = self._parameter(name)
            self._start_values.append((place, _fit(place, value)))
        self._wires: list[tuple[_Place, _Place | Callable[[float], float]]] = []
        for name, source in (inputs or {}).items():
            self._connect(self._input(name), source)
        self._folders: list[Path] = []
        self._instances: list[Instance] = []

    @property
    def period(self) -> float | None:
        """The step, else the one that all FMUs were exported with."""
        experiments = [described.defaultExperiment for described in self._described]
        sizes = {float(each.stepSize) for each in experiments if each and each.stepSize}
        return self._step or (sizes.pop() if len(sizes) == 1 else None)

    def bind(
        self,
        variables: Sequence[str],
        signals: Mapping[str, Any] | None,
        period: Fraction | None,
    ) -> None:
        """Finds the variables, and how many communication steps make a period."""
        self._reads = [self._find(name) for name in named_signals(variables, signals)]
        period = period or Fraction(1)
        self._h = period if self._step is None else _exactly(self._step)
        self._substeps = _multiple(period, self._h, "period", "communication step")
        for name, described in zip(self._paths, self._described, strict=True):
            if fixed := described.coSimulation.fixedInternalStepSize:
                inner = _exactly(float(fixed))
                _multiple(self._h, inner, "communication step", f"fixed step of {name!r},")

    def start(self) -> Sequence[float]:
        """Loads and initializes the FMUs; their values at time 0."""
        self.ended = ""
        self._count = 0
        self._now = 0.0
        self._unpack()
        for name, described, folder in zip(
            self._paths, self._described, self._folders, strict=True
        ):
            self._instances.append(Instance(name, described, folder))
        for i, instance in enumerate(self._instances):
            instance.enter([(v, value) for (_, fmu, v), value in self._start_values if fmu == i])
        sources = [source for _, source in self._wires if isinstance(source, _Place)]
        self._outputs = self._reader(list(dict.fromkeys(sources)))
        self._feeds = self._feeders(list(dict.fromkeys(sources)))
        for _ in self._instances:  # as often as it takes to hand a value on through all FMUs
            self._exchange()
        for instance in self._instances:
            instance.exit()
        self._read = self._reader(self._reads)
        return self._read()

    def advance(self) -> Sequence[float] | None:
        """Makes the communication steps of a period; None if an FMU ends before the last."""
        numerator, denominator = self._h.as_integer_ratio()
        step = float(self._h)
        for left in range(self._substeps - 1, -1, -1):
            reached = True
            for instance in self._instances:
                reached &= instance.step(self._now, step)
                if instance.ended:
                    self.ended = "terminated"
            if not reached or (self.ended and left):
                return None
            self._count += 1
            self._now = self._count * numerator / denominator  # exact, and faster than a Fraction
            if self._feeds:
                self._exchange()
        return self._read()

    def close(self) -> None:
        """Frees the FMUs; what was unpacked stays for the next run."""
        with ExitStack() as stack:  # all of them, also where one fails to end
            while self._instances:
                stack.callback(self._instances.pop(0).close)
        for bound in ("_outputs", "_feeds", "_read"):
            self.__dict__.pop(bound, None)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_folders": []}  # a copy unpacks for itself

    def _unpack(self) -> None:
        if self._folders:
            return
        top = Path(tempfile.mkdtemp(prefix="rtamt-fmu-"))
        weakref.finalize(self, shutil.rmtree, top, ignore_errors=True)
        folders = [top / str(i) for i in range(len(self._paths))]
        for path, folder in zip(self._paths.values(), folders, strict=True):
            fmpy.extract(path, folder)
        self._folders = folders

    def _reader(self, places: Sequence[_Place]) -> Reader:
        """The function that reads variables of several FMUs."""
        parts = []
        for i, instance in enumerate(self._instances):
            at = [k for k, place in enumerate(places) if place.fmu == i]
            if at:
                parts.append((at, instance.reader([places[k].variable for k in at])))
        if len(parts) == 1:
            return parts[0][1]

        def read() -> list[float]:
            values = [0.0] * len(places)
            for at, part in parts:
                for k, value in zip(at, part(), strict=True):
                    values[k] = value
            return values

        return read

    def _feeders(self, sources: Sequence[_Place]) -> list[tuple[Writer, list[_Give]]]:
        """For every FMU with connected inputs, what writes them, and what it is given."""
        feeders = []
        for i, instance in enumerate(self._instances):
            mine = [(target, source) for target, source in self._wires if target.fmu == i]
            if mine:
                write = instance.writer([target.variable for target, _ in mine])
                gives = [
                    sources.index(source) if isinstance(source, _Place) else source
                    for _, source in mine
                ]
                feeders.append((write, gives))
        return feeders

    def _exchange(self) -> None:
        """Hands outputs to inputs."""
        outputs, now = self._outputs(), self._now
        for write, gives in self._feeds:
            write([outputs[give] if isinstance(give, int) else give(now) for give in gives])

    def _connect(self, target: _Place, source: object) -> None:
        if isinstance(source, str):
            place = self._find(source)
            if kind_of(target.variable) is int and kind_of(place.variable) is float:
                raise InputError(
                    f"input {target.name!r} takes whole numbers, and {place.name!r} is a "
                    f"{place.variable.type}"
                )
            self._wires.append((target, place))
        elif callable(source):
            self._wires.append((target, source))
        elif isinstance(source, Real):
            self._start_values.append((target, _fit(target, source)))
        else:
            raise InputTypeError(
                f"input {target.name!r}: expected the name of a variable, a number or a function "
                f"of time, got {source!r}"
            )

    def _find(self, name: str) -> _Place:
        """The variable of a name; a single number."""
        if name not in self._places:
            outputs = [place.name for place in self._all() if place.variable.causality == "output"]
            raise InputError(
                f"no variable {name!r} in {self.name}"
                + (nearest(name, self._places) or f"; the outputs are {listing(outputs)}")
            )
        place = self._places[name]
        if kind_of(place.variable) is None:
            raise InputError(f"{name!r} is a {place.variable.type}, expected a number")
        if place.variable.dimensions:
            raise InputError(f"{name!r} is an array, expected a single number")
        return place

    def _input(self, name: str) -> _Place:
        place = self._find(name)
        if place.variable.causality != "input":
            inputs = [place.name for place in self._all() if place.variable.causality == "input"]
            raise InputError(
                f"expected an input, got {name!r}, which is of causality "
                f"{place.variable.causality!r}; the inputs are {listing(inputs)}"
            )
        return place

    def _parameter(self, name: str) -> _Place:
        place = self._find(name)
        variable = place.variable
        if variable.causality == "input":
            raise InputError(f"{name!r} is an input: give it in inputs=")
        if variable.variability == "constant" or variable.initial not in {"exact", "approx"}:
            raise InputError(
                f"expected a variable with a start value, got {name!r}, which is of causality "
                f"{variable.causality!r} and calculated"
            )
        return place

    def _all(self) -> list[_Place]:
        return list(dict.fromkeys(self._places.values()))


def _named(fmus: object) -> dict[str, Path]:
    """The paths by name."""
    if isinstance(fmus, str | os.PathLike):
        fmus = [fmus]
    if not isinstance(fmus, Mapping):
        if not isinstance(fmus, Sequence) or not all(
            isinstance(f, str | os.PathLike) for f in fmus
        ):
            raise InputTypeError(f"expected the path of an FMU, or several, got {fmus!r}")
        stems = [Path(path).stem for path in fmus]
        if twice := {stem for stem in stems if stems.count(stem) > 1}:
            raise InputError(
                f"expected FMUs of different names, got {min(twice)!r} more than once; "
                f'name them: {{"first": {str(fmus[0])!r}, ...}}'
            )
        fmus = dict(zip(stems, fmus, strict=True))
    if not fmus:
        raise InputError("expected at least one FMU, got none")
    return {str(name): Path(path) for name, path in fmus.items()}


def _describe(path: Path) -> Any:  # noqa: ANN401 - FMPy is not typed
    """The model description of an FMU."""
    try:
        described = fmpy.read_model_description(path)
    except OSError:
        raise
    except Exception as error:  # FMPy has no class of its own for what it refuses
        raise InputError(f"cannot read the FMU {path}: {error}") from error
    if described.fmiVersion == "1.0":
        raise InputError(f"expected an FMU of FMI 2.0 or 3.0, got 1.0 in {path}")
    if described.coSimulation is None:
        raise InputError(
            f"expected an FMU for co-simulation, got {path}, which is for model exchange"
        )
    return described


def _fit(place: _Place, value: object) -> float:
    """The number as the variable takes it."""
    if not isinstance(value, Real):
        raise InputTypeError(f"expected a number for {place.name!r}, got {value!r}")
    number = float(value)
    if kind_of(place.variable) is float:
        return number
    if not number.is_integer():
        raise InputError(
            f"expected a whole number for {place.name!r}, a {place.variable.type}, got {value!r}"
        )
    return int(number)


def _exactly(seconds: float) -> Fraction:
    return Fraction(seconds).limit_denominator(10**12)


def _multiple(whole: Fraction, part: Fraction, what: str, of: str) -> int:
    """How many parts make the whole.

    Raises:
        InputError: If it is no whole number.
    """
    count = whole / part
    if count.denominator != 1:
        less, more = math.floor(count) * part, math.ceil(count) * part
        ways = f"{float(less):g} s or {float(more):g} s" if less else f"{float(more):g} s"
        raise InputError(
            f"the {what} {float(whole):g} s is not a multiple of the {of} {float(part):g} s "
            f"({float(count):g} steps); use {ways}"
        )
    return count.numerator
