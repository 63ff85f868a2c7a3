"""A running FMU, with the same methods for FMI 2.0 and 3.0."""

from __future__ import annotations

import ctypes
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn
from weakref import WeakValueDictionary

import fmpy  # type: ignore[import-untyped]
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from fmpy.fmi2 import (  # type: ignore[import-untyped]
    FMU2Slave,
    defaultCallbacks,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    fmi2Discard,
    fmi2Fatal,
    fmi2LastSuccessfulTime,
    fmi2Terminated,
)

from rtamt import InputError, StateError
from rtamt_gym.systems.fmi_variables import TYPES, Variable, size_of, start_values

Reader = Callable[[], Sequence[float]]
Writer = Callable[[Sequence[float]], None]

_MESSAGES: Final = 3
"""The number of messages of an FMU that an error repeats."""


class _Group(NamedTuple):
    """A call that reads or writes all variables of one type."""

    call: Callable[..., object]
    arguments: tuple[Any, ...]
    values: Any
    indices: list[int]
    places: list[int]


class Instance:
    """An instance of an FMU for co-simulation."""

    def __init__(self, name: str, described: Any, folder: Path) -> None:  # noqa: ANN401
        self._name = name
        self._messages: deque[bytes] = deque(maxlen=_MESSAGES)
        self._warnings: deque[bytes] = deque(maxlen=_MESSAGES)
        self._arrays: dict[int, list[float]] = {}
        self._now = 0.0
        self._steps = False
        self._dead = False
        self.ended = False
        self._version = 2 if described.fmiVersion == "2.0" else 3
        try:
            self._fmu = self._made(described, str(folder))
        except Exception as error:  # FMPy raises various classes
            raise InputError(
                f"cannot load the FMU {name!r}: {error}{self._last_messages()}"
            ) from error

    def _made(self, described: Any, folder: str) -> Any:  # noqa: ANN401 - FMPy has no types
        """Return the FMU of FMPy with debug logging, which many need to report why they fail."""
        if self._version == 3:
            return fmpy.instantiate_fmu(
                folder, described, fmi_type="CoSimulation", debug_logging=True, logger=self.listen
            )
        number = next(_numbers)
        _instances[number] = self
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = _LOGGER
        callbacks.allocateMemory = defaultCallbacks.allocateMemory
        callbacks.freeMemory = defaultCallbacks.freeMemory
        callbacks.componentEnvironment = number
        with suppress(ImportError, OSError):  # FMPy has no such library for every platform
            from fmpy.logging import addLoggerProxy  # type: ignore[import-untyped]

            addLoggerProxy(ctypes.byref(callbacks))
        fmu = FMU2Slave(
            guid=described.guid,
            unzipDirectory=folder,
            modelIdentifier=described.coSimulation.modelIdentifier,
        )
        fmu.instantiate(callbacks=callbacks, loggingOn=True)
        return fmu

    def enter(self, starts: Sequence[tuple[Variable, float]]) -> None:
        """Set start values and start the initialization."""
        for variable, value in starts:
            if variable.entry.shape:
                self._array(variable)[variable.element] = value
        self.writer([variable for variable, _ in starts])([value for _, value in starts])
        if self._version == 2:
            self._call(self._fmu.setupExperiment)
        self._call(self._fmu.enterInitializationMode)

    def exit(self) -> None:
        """End the initialization."""
        self._call(self._fmu.exitInitializationMode)
        self._steps = True

    def step(self, now: float, size: float) -> bool:
        """Make a communication step; return False if the FMU ended before its end."""
        self._now = now
        try:
            answer = self._fmu.doStep(now, size)
        except FMICallException as error:
            discarded = self._version == 2 and error.status == fmi2Discard
            if discarded and self._fmu.getBooleanStatus(fmi2Terminated):
                self.ended = True
                return self._reached(now + 0.5 * size)
            self._fail(error)
        if answer is None:  # as in FMI 2.0
            return True
        _, self.ended, _, reached = answer
        return not self.ended or bool(reached >= now + 0.5 * size)

    def _reached(self, time: float) -> bool:
        """Return whether an FMU of FMI 2.0 that has ended was successful up to a time."""
        try:
            return bool(self._fmu.getRealStatus(fmi2LastSuccessfulTime) >= time)
        except FMICallException:  # the FMU does not report it
            return False

    def reader(self, variables: Sequence[Variable]) -> Reader:
        """Return the function that reads variables, with one call of the FMU for each type."""
        groups = self._groups("Get", variables)
        if len(groups) == 1 and groups[0].places == list(range(len(groups[0].values))):
            (call, arguments, values, _, _) = groups[0]  # the most frequent case

            def read_one_type() -> Sequence[float]:
                try:
                    call(*arguments)
                except FMICallException as error:
                    self._fail(error)
                read: list[float] = values[:]
                return read

            return read_one_type

        def read() -> Sequence[float]:
            result = [0.0] * len(variables)
            for call, arguments, values, indices, places in groups:
                self._call(call, *arguments)
                for k, position in zip(indices, places, strict=True):
                    result[k] = values[position]
            return result

        return read

    def writer(self, variables: Sequence[Variable]) -> Writer:
        """Return the function that writes variables, with one call of the FMU for each type.

        An array is written completely: its other numbers keep their start values.
        """
        groups = self._groups("Set", variables)

        def write(numbers: Sequence[float]) -> None:
            for call, arguments, values, indices, places in groups:
                for k, position in zip(indices, places, strict=True):
                    values[position] = numbers[k]
                self._call(call, *arguments)

        return write

    def close(self) -> None:
        """Terminate the instance if its state allows it, and free it."""
        try:
            if self._steps:
                self._call(self._fmu.terminate)
        finally:
            if not self._dead:
                self._fmu.freeInstance()

    def _groups(self, verb: str, variables: Sequence[Variable]) -> list[_Group]:
        types = TYPES[self._version]
        chosen: dict[tuple[str, type[Any]], list[int]] = {}
        for k, variable in enumerate(variables):
            chosen.setdefault(types[variable.entry.type], []).append(k)
        groups = []
        for (name, kind), indices in chosen.items():
            begins: dict[int, int] = {}  # the place of the first number, by value reference
            held: list[float] = []
            for variable in (variables[k] for k in indices):
                if variable.entry.valueReference not in begins:
                    begins[variable.entry.valueReference] = len(held)
                    sets = verb == "Set" and variable.entry.shape
                    held += self._array(variable) if sets else [0] * size_of(variable.entry)
            references = (ctypes.c_uint * len(begins))(*begins)
            values = (kind * len(held))(*held)
            places = [
                begins[variables[k].entry.valueReference] + variables[k].element for k in indices
            ]
            call = getattr(self._fmu, f"fmi{self._version}{verb}{name}")
            arguments: tuple[Any, ...] = (self._fmu.component, references, len(begins), values)
            arguments += (len(held),) * (self._version == 3)
            groups.append(_Group(call, arguments, values, indices, places))
        return groups

    def _array(self, variable: Variable) -> list[float]:
        """Return the numbers of an array before the first step, some of them set."""
        reference = variable.entry.valueReference
        return self._arrays.setdefault(reference, start_values(variable.entry))

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

    def listen(self, *message: Any) -> None:  # noqa: ANN401 - not the same in FMI 2.0 and 3.0
        """Keep a message of the FMU."""
        *_, status, _, text = message
        (self._warnings if status else self._messages).append(text or b"")

    def _last_messages(self) -> str:
        """Return the last warnings and errors of the FMU; without any, its last messages."""
        texts = [text.decode(errors="replace").strip() for text in self._warnings or self._messages]
        return f" Its last messages: {'; '.join(texts)}" if texts else ""


_numbers = count(1)
_instances: WeakValueDictionary[int, Instance] = WeakValueDictionary()
"""Instances of FMI 2.0, by the number that their FMU gets as its environment."""


def _hear(environment: int | None, *message: Any) -> None:  # noqa: ANN401 - as of `Instance`
    """Keep a message of an FMU of FMI 2.0; without an environment it belongs to the last one."""
    instance = _instances.get(environment or 0) or next(reversed([*_instances.values()]), None)
    if instance is not None:
        instance.listen(*message)


_LOGGER: Final = fmi2CallbackLoggerTYPE(_hear)
"""The logger of all FMUs: FMPy calls the logger of the last FMU for all, even of a freed one."""
