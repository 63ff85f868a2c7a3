"""`Fmus`: connected functional mock-up units for co-simulation, as a system for `simulate`."""

from __future__ import annotations

import copy
import os
import shutil
import sys
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from importlib import import_module
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rtamt import InputError, InputTypeError
from rtamt_gym.checks.arguments import check_number
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.systems.fmi_variables import Variable, Variables, fit, kind_of
from rtamt_gym.systems.system import Signals, System, as_number, named_signals, whole_steps

if TYPE_CHECKING:
    from rtamt_gym.systems.fmi_instance import Instance, Reader, Writer


_Path = str | os.PathLike[str]

_Source = str | float | Callable[[float], float]
"""The value of an input: another variable by name, a number, or a function of time."""

_InputSource = int | Callable[[float], float]
"""The source of an input during a run: the index of a connected output, or a function of time."""


class Fmus(System):
    """Connected FMUs for co-simulation, as Simulink, Modelica tools and others export them.

    All FMUs (FMI 2.0 and 3.0) step to the next communication point; then outputs are copied to the
    connected inputs, in any order. An output that depends directly on an input is one step late.

    A variable is named ``"plant.level"``, by its FMU and its own name; a single FMU needs no
    prefix. Elements of FMI 3.0 arrays are separate numbers: ``"plant.grid[0][2]"``.

    Attributes:
        paths: The paths of the FMUs by name.
        arguments: The other arguments.

    Args:
        fmus: The path of an FMU, several paths (the names are the file names), or a mapping from
            names to paths.
        inputs: The sources of inputs: another variable, a number, or a function of time. Default:
            inputs keep their start values.
        parameters: Numbers for parameters and other variables with a start value.
        step: Seconds between communication points. Default: the period of the samples, by default
            the step size of the export.
        validate: Whether to refuse FMUs that break a rule of the standard, which FMPy checks.

    Raises:
        InputError: If a file is not a co-simulation FMU, or a variable does not exist or cannot be
            read, set or connected. Errors of an FMU repeat its last messages.
        InputTypeError: If an argument has a wrong type.
        ModuleNotFoundError: If FMPy, the extra ``fmi``, is not installed.

    Example:
        A controller and its plant::

            wires = {"plant.valve": "controller.valve", "controller.level": "plant.level"}
            system = Fmus(["controller.fmu", "plant.fmu"], wires, {"plant.area": 0.5})
            simulate(system, "always(plant.level < 2.2)", duration=60).plot("levels.png")

    Source: Functional Mock-up Interface 2.0.4 and 3.0.1, Modelica Association; run by FMPy.
    """

    needs_period: bool | str = True
    endless = True

    def __init__(
        self,
        fmus: _Path | Sequence[_Path] | Mapping[str, _Path],
        *,
        inputs: Mapping[str, _Source] | None = None,
        parameters: Mapping[str, float] | None = None,
        step: float | None = None,
        validate: bool = True,
    ) -> None:
        self.paths = _named(fmus)
        self.arguments: dict[str, Any] = {
            "inputs": None if inputs is None else dict(inputs),
            "parameters": None if parameters is None else dict(parameters),
            "step": step,
            "validate": validate,
        }
        self.name = ", ".join(self.paths)
        self._step = None if step is None else check_number("step", step)
        self._described = [_describe(path, validate=validate) for path in self.paths.values()]
        experiments = [described.defaultExperiment for described in self._described]
        sizes = {
            float(experiment.stepSize)
            for experiment in experiments
            if experiment and experiment.stepSize
        }
        if len(sizes) > 1:
            *others, last = (f"{size:g}" for size in sorted(sizes))
            self.needs_period = f"suggest steps of {', '.join(others)} and {last} s"
        self.period = self._step or (sizes.pop() if len(sizes) == 1 else None)
        self._variables = Variables(dict(zip(self.paths, self._described, strict=True)))
        self._start_values: list[tuple[Variable, float]] = []
        for name, value in (parameters or {}).items():
            variable = self._variables.parameter(name)
            self._start_values.append((variable, fit(variable, value)))
        self._wires: list[tuple[Variable, Variable | Waveform | Callable[[float], float]]] = []
        for name, source in (inputs or {}).items():
            self._connect(self._variables.input(name), source)
        self._folders: list[Path] = []
        self._instances: list[Instance] = []
        self._interrupts = Interrupts()

    def driven(self, case: Case) -> Fmus:
        """Return the FMUs with the inputs and parameters of a case, which replace their own."""
        self._unpack()  # once for all runs
        names: dict[Variable, str] = {}
        for name in case:
            variable = self._variables.find(name)
            if variable in names:
                raise InputError(
                    f"expected {variable.name!r} once in the case, got it as {names[variable]!r} "
                    f"and as {name!r}"
                )
            names[variable] = name
        wires = [wire for wire in self._wires if wire[0] not in names]
        starts = [start for start in self._start_values if start[0] not in names]
        for variable, name in names.items():
            entry = case[name]
            if variable.entry.causality != "input":
                number = as_number(name, entry, "inputs")
                starts.append((self._variables.parameter(name), fit(variable, number)))
            elif isinstance(entry, Waveform):
                _check_driven(variable, entry)
                wires.append((variable, entry))
            else:
                starts.append((variable, fit(variable, entry)))
        fmus = copy.copy(self)
        fmus.__dict__ |= {"_wires": wires, "_start_values": starts, "_interrupts": Interrupts()}
        # This object removes the folders when it is collected.
        fmus.__dict__ |= {"_folders": self._folders, "_unpacked_by": self}
        return fmus

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Find the variables and count the communication steps in a period."""
        self._reads = [self._variables.find(name) for name in named_signals(variables, signals)]
        period = period or Fraction(1)
        self._h = period if self._step is None else exact(self._step)
        self._substeps = whole_steps(period, self._h, "period", "communication step")
        for name, described in zip(self.paths, self._described, strict=True):
            if fixed := described.coSimulation.fixedInternalStepSize:
                inner = exact(float(fixed))
                whole_steps(self._h, inner, "communication step", f"fixed step of {name!r},")

    def start(self) -> Sequence[float]:
        """Load and initialize the FMUs; return the sample at time 0."""
        self.ended = ""
        self._count = 0
        self._now = 0.0
        self._unpack()
        self._interrupts.begin()
        from rtamt_gym.systems.fmi_instance import Instance

        for name, described, folder in zip(self.paths, self._described, self._folders, strict=True):
            self._instances.append(Instance(name, described, folder))
        for i, instance in enumerate(self._instances):
            instance.enter([(v, value) for v, value in self._start_values if v.fmu == i])
        sources = [source for _, source in self._wires if isinstance(source, Variable)]
        self._outputs = self._reader(list(dict.fromkeys(sources)))
        self._connections = self._connected(list(dict.fromkeys(sources)))
        for _ in self._instances:  # a value may pass through all FMUs
            self._exchange()
        for instance in self._instances:
            instance.exit()
        self._interrupts.check()
        self._read = self._reader(self._reads)
        return self._read()

    def advance(self) -> Sequence[float] | None:
        """Make the communication steps of a period; return None if an FMU ends before the last."""
        numerator, denominator = self._h.as_integer_ratio()
        step = float(self._h)
        for left in range(self._substeps - 1, -1, -1):
            reached = True
            for instance in self._instances:
                reached &= instance.step(self._now, step)
                if instance.ended:
                    self.ended = "terminated"
            self._interrupts.check()
            if not reached or (self.ended and left):
                return None
            self._count += 1
            self._now = self._count * numerator / denominator  # exact, and faster than a Fraction
            if self._connections:
                self._exchange()
        return self._read()

    def close(self) -> None:
        """Free the FMUs; their unpacked files stay for the next run."""
        with ExitStack() as stack:  # frees the others if one fails
            stack.callback(self._interrupts.end)
            while self._instances:
                stack.callback(self._instances.pop(0).close)
        for bound in ("_outputs", "_connections", "_read"):
            self.__dict__.pop(bound, None)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_folders": []}  # a copy unpacks its own files

    def _unpack(self) -> None:
        if self._folders:
            return
        top = Path(tempfile.mkdtemp(prefix="rtamt-fmu-"))
        weakref.finalize(self, shutil.rmtree, top, ignore_errors=True)
        folders = [top / str(i) for i in range(len(self.paths))]
        for path, folder in zip(self.paths.values(), folders, strict=True):
            _unpack(path, folder)
        self._folders = folders

    def _reader(self, variables: Sequence[Variable]) -> Reader:
        """Return the function that reads variables of one or several FMUs."""
        parts = []
        for i, instance in enumerate(self._instances):
            indices = [k for k, variable in enumerate(variables) if variable.fmu == i]
            if indices:
                parts.append((indices, instance.reader([variables[k] for k in indices])))
        if len(parts) == 1:
            return parts[0][1]

        def read() -> list[float]:
            values = [0.0] * len(variables)
            for indices, part in parts:
                for k, value in zip(indices, part(), strict=True):
                    values[k] = value
            return values

        return read

    def _connected(self, outputs: Sequence[Variable]) -> list[tuple[Writer, list[_InputSource]]]:
        """Return the function that writes the connected inputs of each FMU, and their sources."""
        connections = []
        for i, instance in enumerate(self._instances):
            mine = [(target, source) for target, source in self._wires if target.fmu == i]
            if mine:
                write = instance.writer([target for target, _ in mine])
                sources = [
                    outputs.index(source)
                    if isinstance(source, Variable)
                    else self._stepped(target, source)
                    if isinstance(source, Waveform)
                    else source
                    for target, source in mine
                ]
                connections.append((write, sources))
        return connections

    def _stepped(self, target: Variable, waveform: Waveform) -> Callable[[float], float]:
        """Return the function that computes the value of an input for the present step."""
        value, integral = waveform.stepper(self._h), kind_of(target.entry) is int
        return lambda _: int(value(self._count)) if integral else value(self._count)

    def _exchange(self) -> None:
        """Copy outputs to their connected inputs."""
        outputs, now = self._outputs(), self._now
        for write, sources in self._connections:
            write(
                [outputs[source] if isinstance(source, int) else source(now) for source in sources]
            )

    def _connect(self, target: Variable, source: object) -> None:
        if isinstance(source, str):
            variable = self._variables.find(source)
            if kind_of(target.entry) is int and kind_of(variable.entry) is float:
                raise InputError(
                    f"input {target.name!r} takes whole numbers, and {variable.name!r} is a "
                    f"{variable.entry.type}"
                )
            self._wires.append((target, variable))
        elif callable(source):
            self._wires.append((target, source))
        elif isinstance(source, Real):
            self._start_values.append((target, fit(target, source)))
        else:
            raise InputTypeError(
                f"input {target.name!r}: expected the name of a variable, a number or a function "
                f"of time, got {source!r}"
            )


def _check_driven(target: Variable, waveform: Waveform) -> None:
    """Raise InputError if an input does not take the values of a waveform."""
    for value in waveform.values:
        fit(target, value)
    if kind_of(target.entry) is int and waveform.interpolation != "hold":
        raise InputError(
            f"input {target.name!r} takes whole numbers: expected a waveform with "
            f"interpolation='hold', got {waveform!r}"
        )


def _named(fmus: object) -> dict[str, Path]:
    """Return the paths of the FMUs by name."""
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


def _unpack(path: Path, folder: Path) -> None:
    """Unpack an FMU into a folder."""
    try:
        _fmpy().extract(path, folder)
    except OSError:
        raise
    except Exception as error:  # FMPy raises various classes
        raise InputError(f"cannot unpack the FMU {path}: {error}") from error


def _describe(path: Path, *, validate: bool) -> Any:  # noqa: ANN401 - FMPy is not typed
    """Read the model description of an FMU."""
    fmpy = _fmpy()
    try:
        # FMPy leaves an entry of the archive open. If it then raises, the traceback keeps the file
        # open too, unless it is ours.
        with path.open("rb") as file:
            described = fmpy.read_model_description(file, validate=validate)
    except OSError:
        raise
    except Exception as error:  # FMPy raises various classes
        way_out = ""
        if isinstance(error, fmpy.model_description.ValidationError):
            way_out = "\nFmus(..., validate=False) takes it without this check"
        raise InputError(f"cannot read the FMU {path}: {error}{way_out}") from error
    if described.fmiVersion == "1.0":
        raise InputError(f"expected an FMU of FMI 2.0 or 3.0, got 1.0 in {path}")
    if described.coSimulation is None:
        raise InputError(
            f"expected an FMU for co-simulation, got {path}, which is for model exchange"
        )
    return described


def _fmpy() -> Any:  # noqa: ANN401 - FMPy is not typed
    try:
        return import_module("fmpy")
    except ModuleNotFoundError as error:
        raise naming_extra(error, "Fmus") from error


class Interrupts:
    """Stores a ``KeyboardInterrupt`` that comes while an FMU sends a message.

    Python raises it in the callback, and ctypes cannot pass it through the FMU.
    """

    def __init__(self) -> None:
        self._came = self._hears = False

    def begin(self) -> None:
        """Start to listen."""
        self._came, self._hears = False, True
        self._before = sys.unraisablehook
        sys.unraisablehook = self._hear

    def end(self) -> None:
        """Stop listening."""
        if self._hears:
            self._hears = False
            sys.unraisablehook = self._before

    def check(self) -> None:
        """Raise the ``KeyboardInterrupt`` that came since the last check, if any."""
        if self._came:
            self._came = False
            raise KeyboardInterrupt

    def _hear(self, unraisable: sys.UnraisableHookArgs) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            self._came = True
        else:
            self._before(unraisable)
