"""An FMU that runs: what FMI 2.0 and 3.0 call differently is the same here."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

import fmpy  # type: ignore[import-untyped]
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from fmpy.fmi2 import fmi2Discard, fmi2Fatal, fmi2Terminated  # type: ignore[import-untyped]

from rtamt import InputError, StateError

__all__ = ["Instance", "Reader", "Writer", "kind_of"]

Reader = Callable[[], Sequence[float]]
Writer = Callable[[Sequence[float]], None]

_TYPES: Final[Mapping[str, tuple[str, type[Any]]]] = {
    "Real": ("Real", ctypes.c_double),
    "Integer": ("Integer", ctypes.c_int),
    "Enumeration": ("Integer", ctypes.c_int),
    "Boolean": ("Boolean", ctypes.c_int),
}
"""Of FMI 2.0: what the functions that read and write a type are called, and the type in C."""

_TYPES_3: Final[Mapping[str, tuple[str, type[Any]]]] = {
    "Float32": ("Float32", ctypes.c_float),
    "Float64": ("Float64", ctypes.c_double),
    "Boolean": ("Boolean", ctypes.c_bool),
    "Enumeration": ("Int64", ctypes.c_int64),
    **{f"Int{n}": (f"Int{n}", getattr(ctypes, f"c_int{n}")) for n in (8, 16, 32, 64)},
    **{f"UInt{n}": (f"UInt{n}", getattr(ctypes, f"c_uint{n}")) for n in (8, 16, 32, 64)},
}
"""The same of FMI 3.0."""

_LAST_WORDS: Final = 3
"""Messages of an FMU that an error repeats."""


def kind_of(variable: Any) -> type[float | int] | None:  # noqa: ANN401 - FMPy is not typed
    """What a variable holds: float, int, or no number."""
    if variable.type in {"Real", "Float32", "Float64"}:
        return float
    return int if variable.type in _TYPES or variable.type in _TYPES_3 else None


class Instance:
    """An instance of an FMU for co-simulation.

    Attributes:
        ended: Whether it wants the simulation to end.

    Args:
        name: What messages call it.
        described: Its model description.
        folder: Where it was unpacked.

    Raises:
        InputError: If its library cannot be loaded, as where it has none for this platform.
    """

    def __init__(self, name: str, described: Any, folder: Path) -> None:  # noqa: ANN401
        self._name = name
        self._said: list[str] = []
        self._now = 0.0
        self._steps = False
        self._dead = False
        self.ended = False
        self._version = 2 if described.fmiVersion == "2.0" else 3
        try:
            self._fmu = fmpy.instantiate_fmu(
                str(folder), described, fmi_type="CoSimulation", logger=self._listen
            )
        except Exception as error:  # FMPy has no class of its own for what it refuses
            raise InputError(f"cannot load the FMU {name!r}: {error}{self._words()}") from error

    def enter(self, start_values: Sequence[tuple[Any, float]]) -> None:
        """Sets start values and enters the initialization."""
        variables = [variable for variable, _ in start_values]
        self.writer(variables)([value for _, value in start_values])
        if self._version == 2:
            self._call(self._fmu.setupExperiment)
        self._call(self._fmu.enterInitializationMode)

    def exit(self) -> None:
        """Ends the initialization."""
        self._call(self._fmu.exitInitializationMode)
        self._steps = True

    def step(self, now: float, size: float) -> bool:
        """Goes on by a communication step; False if the FMU has ended before the end of it.

        Raises:
            StateError: If it fails.
        """
        self._now = now
        try:
            told = self._fmu.doStep(now, size)
        except FMICallException as error:
            discarded = self._version == 2 and error.status == fmi2Discard
            if discarded and self._fmu.getBooleanStatus(fmi2Terminated):
                self.ended = True
                return False
            self._fail(error)
        if told is None:  # FMI 2.0 says nothing more
            return True
        _, self.ended, _, last = told
        return not self.ended or bool(last >= now + 0.5 * size)

    def reader(self, variables: Sequence[Any]) -> Reader:
        """The function that reads variables, one call into the FMU for each type."""
        groups = self._groups("Get", variables)
        if len(groups) == 1:  # what comes by far most often
            (call, arguments, values, _) = groups[0]

            def read_one_type() -> Sequence[float]:
                try:
                    call(*arguments)
                except FMICallException as error:
                    self._fail(error)
                read: list[float] = values[:]
                return read

            return read_one_type

        def read() -> Sequence[float]:
            found = [0.0] * len(variables)
            for call, arguments, values, at in groups:
                self._call(call, *arguments)
                for k, value in zip(at, values, strict=True):
                    found[k] = value
            return found

        return read

    def writer(self, variables: Sequence[Any]) -> Writer:
        """The function that writes variables, one call into the FMU for each type."""
        groups = self._groups("Set", variables)

        def write(given: Sequence[float]) -> None:
            for call, arguments, values, at in groups:
                for i, k in enumerate(at):
                    values[i] = given[k]
                self._call(call, *arguments)

        return write

    def close(self) -> None:
        """Ends and frees the instance, as far as its state allows.

        Raises:
            StateError: If it fails to end; it is freed nevertheless.
        """
        try:
            if self._steps:
                self._call(self._fmu.terminate)
        finally:
            if not self._dead:
                self._fmu.freeInstance()

    def _groups(
        self, verb: str, variables: Sequence[Any]
    ) -> list[tuple[Callable[..., object], tuple[Any, ...], Any, list[int]]]:
        """Variables of one type: the function, its arguments, the values among them, and where."""
        types = _TYPES if self._version == 2 else _TYPES_3
        groups: dict[tuple[str, type[Any]], list[int]] = {}
        for k, variable in enumerate(variables):
            groups.setdefault(types[variable.type], []).append(k)
        made = []
        for (name, kind), at in groups.items():
            references = (ctypes.c_uint * len(at))(*(variables[k].valueReference for k in at))
            values = (kind * len(at))()
            call = getattr(self._fmu, f"fmi{self._version}{verb}{name}")
            arguments: tuple[Any, ...] = (self._fmu.component, references, len(at), values)
            made.append((call, arguments + (len(at),) * (self._version == 3), values, at))
        return made

    def _call(self, function: Callable[..., object], *arguments: Any) -> None:  # noqa: ANN401
        try:
            function(*arguments)
        except FMICallException as error:
            self._fail(error)

    def _fail(self, error: FMICallException) -> NoReturn:
        self._steps = False
        self._dead = error.status == fmi2Fatal  # of FMI 3.0 as well
        raise StateError(
            f"FMU {self._name!r} failed at {self._now:g} s: {error}{self._words()}"
        ) from error

    def _listen(self, *message: Any) -> None:  # noqa: ANN401 - as the version of FMI has it
        self._said.append(message[-1].decode(errors="replace"))

    def _words(self) -> str:
        said = "; ".join(self._said[-_LAST_WORDS:])
        return f" It said: {said}" if said else ""
