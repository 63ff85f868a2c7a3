"""An FMU that runs, with the same methods for FMI 2.0 and 3.0."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

import fmpy  # type: ignore[import-untyped]
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from fmpy.fmi2 import fmi2Discard, fmi2Fatal, fmi2Terminated  # type: ignore[import-untyped]

from rtamt import InputError, StateError
from rtamt_gym.simulation.fmi_variables import TYPES

__all__ = ["Instance", "Reader", "Writer"]

Reader = Callable[[], Sequence[float]]
Writer = Callable[[Sequence[float]], None]

_MESSAGES: Final = 3
"""The number of an FMU's latest messages that an error repeats."""


class Instance:
    """An instance of an FMU for co-simulation.

    Attributes:
        ended: Whether it asks for the simulation to end.

    Args:
        name: Its name, for messages.
        described: Its model description.
        folder: The folder that it was unpacked to.

    Raises:
        InputError: If its library cannot be loaded, for example because it has none for this
            platform.
    """

    def __init__(self, name: str, described: Any, folder: Path) -> None:  # noqa: ANN401
        self._name = name
        self._messages: list[str] = []
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
            raise InputError(
                f"cannot load the FMU {name!r}: {error}{self._last_messages()}"
            ) from error

    def enter(self, start_values: Sequence[tuple[Any, float]]) -> None:
        """Sets start values and begins the initialization."""
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
        """Makes a communication step; returns False if the FMU ended before the end of the step.

        Raises:
            StateError: If it fails.
        """
        self._now = now
        try:
            answer = self._fmu.doStep(now, size)
        except FMICallException as error:
            discarded = self._version == 2 and error.status == fmi2Discard
            if discarded and self._fmu.getBooleanStatus(fmi2Terminated):
                self.ended = True
                return False
            self._fail(error)
        if answer is None:  # as in FMI 2.0
            return True
        _, self.ended, _, reached = answer
        return not self.ended or bool(reached >= now + 0.5 * size)

    def reader(self, variables: Sequence[Any]) -> Reader:
        """The function that reads variables, one call into the FMU for each type."""
        groups = self._groups("Get", variables)
        if len(groups) == 1:  # by far the most frequent case
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
        """Terminates the instance if its state allows it, and frees it.

        Raises:
            StateError: If it fails to terminate; it is freed nevertheless.
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
        """For each type: its function, the arguments, the values in them, the indices."""
        types = TYPES[self._version]
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
            f"FMU {self._name!r} failed at {self._now:g} s: {error}{self._last_messages()}"
        ) from error

    def _listen(self, *message: Any) -> None:  # noqa: ANN401 - not the same in FMI 2.0 and 3.0
        self._messages.append(message[-1].decode(errors="replace"))

    def _last_messages(self) -> str:
        last = "; ".join(self._messages[-_MESSAGES:])
        return f" It said: {last}" if last else ""
