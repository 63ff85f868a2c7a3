"""The shared library of exported monitors, called through the C functions of FMI as tools do."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, cast

import pytest
from bits import bits

from rtamt.export.program_file import Programs, dense_programs, sampled_programs
from rtamt.language.parser import as_specification, traced
from rtamt.monitors.options import SampleOptions, Spec

OK, WARNING, DISCARD, ERROR = range(4)
Version = Literal[2, 3]
versions = pytest.mark.parametrize("version", [2, 3])
TOKEN = "{token}"  # noqa: S105 - it names a unit

ROBUSTNESS, LOWER, UPPER, VERDICT, STOP, FIRST = 1, 2, 3, 4, 5, 8
"""Value references."""

_LOG_2 = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p
)
_LOG_3 = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)


class _Callbacks(ctypes.Structure):
    _fields_ = [
        ("logger", _LOG_2),
        ("allocate", ctypes.c_void_p),
        ("free", ctypes.c_void_p),
        ("finished", ctypes.c_void_p),
        ("environment", ctypes.c_void_p),
    ]


def library() -> ctypes.CDLL:
    """Return the library, which lies next to the native module."""
    native = find_spec("rtamt._native")
    assert native is not None
    assert native.origin is not None
    return ctypes.CDLL(str(Path(native.origin).with_name("rtamt_monitor.so")))


def sampled(spec: Spec, period: float | str = 1, **options: Any) -> Programs:  # noqa: ANN401
    """Return the programs of a unit that takes samples."""
    known = traced(as_specification(spec))
    return sampled_programs(sampled, known, period, cast("SampleOptions", options))


def dense(spec: Spec, resolution: str = "1ns") -> Programs:
    """Return the programs of a unit in dense time."""
    return dense_programs(dense, traced(as_specification(spec)), resolution, {})


def write(folder: Path, programs: Programs, *, stop: bool = False) -> Path:
    """Write the file of a unit, and return its folder."""
    text = programs.text(token=TOKEN, stop=stop)
    (folder / "program.rtamt").write_bytes(text.encode())
    return folder


class Unit:
    """An instance of a unit, whose calls go to the library at any status.

    Args:
        version: The version of FMI.
        folder: The folder of the program.
        token: The token for the instantiation.
        logging: Whether events are logged.
        prefix: The prefix of the location in FMI 2; None for a URI.
    """

    def __init__(
        self,
        version: Version,
        folder: Path,
        token: str = TOKEN,
        *,
        logging: bool = False,
        prefix: bytes | None = None,
    ) -> None:
        self.version, self.log = version, list[tuple[int, str, str]]()
        self.library = library()
        make = self.function("Instantiate" if version == 2 else "InstantiateCoSimulation")
        make.restype = ctypes.c_void_p
        if version == 2:
            self._logger: Any = _LOG_2(lambda _, _name, *said: self._keep(*said))
            self._callbacks = _Callbacks(self._logger, None, None, None, None)
            location = folder.resolve().as_uri().encode()
            if prefix is not None:
                location = prefix + str(folder).encode()
            given: tuple[Any, ...] = (
                b"unit",
                1,
                token.encode(),
                location,
                ctypes.byref(self._callbacks),
                0,
            )
            self.pointer = make(*given, int(logging))
        else:
            self._logger = _LOG_3(lambda _, *said: self._keep(*said))
            path = str(folder).encode()
            flags = [ctypes.c_bool(flag) for flag in (False, logging, False, False)]
            given = (b"unit", token.encode(), path, *flags, None, ctypes.c_size_t(0), None)
            self.pointer = make(*given, self._logger, None)

    def _keep(self, status: int, category: bytes, text: bytes) -> None:
        self.log.append((status, category.decode(), text.decode()))

    def function(self, name: str) -> Any:  # noqa: ANN401 - a function of C
        return self.library[f"fmi{self.version}{name}"]

    def call(self, name: str, *args: Any) -> int:  # noqa: ANN401 - arguments of C
        """Return the status of a call; names that differ between FMI 2 and 3 are from FMI 3."""
        if self.version == 2:
            name = _NAMES_2.get(name, name)
        status = self.function(name)(ctypes.c_void_p(self.pointer), *args)
        assert isinstance(status, int)
        return status

    @property
    def said(self) -> str:
        """Return the last logged text."""
        return self.log[-1][2]

    # The phases.

    def enter(self, start: float = 0.0, stop: float | None = None) -> int:
        times = (ctypes.c_double(start), _flag(stop is not None), ctypes.c_double(stop or 0.0))
        if self.version == 3:
            return self.call("EnterInitializationMode", _flag(0), ctypes.c_double(0.0), *times)
        status = self.call("SetupExperiment", _flag(0), ctypes.c_double(0.0), *times)
        return status or self.call("EnterInitializationMode")

    def begin(self, start: float = 0.0, stop: float | None = None) -> None:
        assert self.enter(start, stop) == OK
        assert self.call("ExitInitializationMode") == OK

    def step(self, time: float, size: float) -> int:
        """Return the status of a step; if it ends the simulation, the status of FMI 2."""
        given = (ctypes.c_double(time), ctypes.c_double(size), _flag(1))
        if self.version == 2:
            return self.call("DoStep", *given)
        event, ends, early = (ctypes.c_bool(1) for _ in range(3))
        last = ctypes.c_double()
        out = [ctypes.byref(each) for each in (event, ends, early, last)]
        status = self.call("DoStep", *given, *out)
        if status == OK:
            assert (event.value, early.value, last.value) == (False, False, time + size)
        return DISCARD if status == OK and ends.value else status

    def ended(self) -> tuple[bool, float]:
        """Return whether the last step ended the simulation, and its end; in FMI 2."""
        ends, time = ctypes.c_int(), ctypes.c_double()
        assert self.call("GetBooleanStatus", 3, ctypes.byref(ends)) == OK
        assert self.call("GetRealStatus", 2, ctypes.byref(time)) == OK
        return bool(ends.value), time.value

    def free(self) -> None:
        function = self.function("FreeInstance")
        function.restype = None
        function(ctypes.c_void_p(self.pointer))

    # Variables.

    def set(self, references: Sequence[int], values: Sequence[float]) -> int:
        n, data = len(references), (ctypes.c_double * len(values))(*values)
        return self.call(self._real("Set"), _references(references), _size(n), data, *self._n(n))

    def get(self, *references: int) -> list[float]:
        n = len(references)
        data = (ctypes.c_double * n)()
        status = self.call(self._real("Get"), _references(references), _size(n), data, *self._n(n))
        assert status == OK, self.said
        return list(data)

    def verdict(self) -> int:
        data = (ctypes.c_int32 * 1)()
        assert self.call("GetInt32", _references([VERDICT]), _size(1), data, *self._n(1)) == OK
        return data[0]

    def outputs(self, *others: int) -> list[int]:
        """Return the bits of robustness, bounds, verdict, and other variables by reference."""
        known = self.get(ROBUSTNESS, LOWER, UPPER)
        return bits([*known, self.verdict(), *self.get(*others)])

    def set_stop(self, stop: bool) -> int:  # noqa: FBT001 - the value
        data = ((ctypes.c_int if self.version == 2 else ctypes.c_bool) * 1)(stop)
        return self.call("SetBoolean", _references([STOP]), _size(1), data, *self._n(1))

    def _real(self, way: str) -> str:
        return f"{way}{'Real' if self.version == 2 else 'Float64'}"

    def _n(self, n: int) -> tuple[ctypes.c_size_t, ...]:
        return () if self.version == 2 else (_size(n),)

    # States.

    def take(self) -> ctypes.c_void_p:
        state = ctypes.c_void_p()
        assert self.call("GetFMUState", ctypes.byref(state)) == OK
        return state

    def restore(self, state: ctypes.c_void_p) -> int:
        return self.call("SetFMUState", state)

    def written(self, state: ctypes.c_void_p) -> bytes:
        size = ctypes.c_size_t()
        assert self.call("SerializedFMUStateSize", state, ctypes.byref(size)) == OK
        data = ctypes.create_string_buffer(size.value)
        assert self.call("SerializeFMUState", state, data, size) == OK
        return data.raw

    def read(self, data: bytes) -> tuple[int, ctypes.c_void_p]:
        state = ctypes.c_void_p()
        given = ctypes.create_string_buffer(data, len(data) or 1)
        return self.call("DeserializeFMUState", given, _size(len(data)), ctypes.byref(state)), state


_NAMES_2 = {
    "GetInt32": "GetInteger",
    "GetFMUState": "GetFMUstate",
    "SetFMUState": "SetFMUstate",
    "FreeFMUState": "FreeFMUstate",
    "SerializedFMUStateSize": "SerializedFMUstateSize",
    "SerializeFMUState": "SerializeFMUstate",
    "DeserializeFMUState": "DeSerializeFMUstate",
}


@contextmanager
def unit(version: Version, folder: Path, **options: Any) -> Iterator[Unit]:  # noqa: ANN401
    """Return an instance, and free it at the end."""
    made = Unit(version, folder, **options)
    assert made.pointer, made.log
    try:
        yield made
    finally:
        made.free()


def _references(numbers: Sequence[int]) -> ctypes.Array[ctypes.c_uint32]:
    return (ctypes.c_uint32 * len(numbers))(*numbers)


def _size(n: int) -> ctypes.c_size_t:
    return ctypes.c_size_t(n)


def _flag(value: float) -> ctypes.c_int:  # a bool of C is passed as an int
    return ctypes.c_int(bool(value))
