"""Calls of other kinds of units, null pointers, and units that cannot be created."""

from __future__ import annotations

import ctypes
from pathlib import Path

import pytest
from fmu_calls import (
    ERROR,
    FIRST,
    OK,
    TOKEN,
    Unit,
    Version,
    library,
    sampled,
    unit,
    versions,
    write,
)

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

NO_CALL = "this unit has no such call; modelDescription.xml says what it has"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write(tmp_path, sampled("always(x > y)", "100ms"))


def begun(made: Unit) -> None:
    made.begin()
    assert made.step(0.0, 0.1) == OK


# The arguments of these are not read before the call is refused.
UNSUPPORTED = {
    2: """GetDirectionalDerivative SetRealInputDerivatives GetRealOutputDerivatives CancelStep
    GetIntegerStatus""",
    3: """EnterEventMode EnterStepMode EnterConfigurationMode ExitConfigurationMode
    GetNumberOfVariableDependencies GetVariableDependencies GetDirectionalDerivative
    GetAdjointDerivative GetOutputDerivatives EvaluateDiscreteStates UpdateDiscreteStates
    EnterContinuousTimeMode CompletedIntegratorStep SetTime SetContinuousStates
    GetContinuousStateDerivatives GetEventIndicators GetContinuousStates
    GetNominalsOfContinuousStates GetNumberOfEventIndicators GetNumberOfContinuousStates
    ActivateModelPartition""",
}
TYPES = """Float32 Int8 UInt8 Int16 UInt16 UInt32 Int64 UInt64 String Binary Clock IntervalDecimal
    IntervalFraction ShiftDecimal ShiftFraction"""
ABSENT = {
    2: "GetString SetString SetInteger",
    3: " ".join(f"{way}{kind}" for kind in TYPES.split() for way in ("Get", "Set")) + " SetInt32",
}


@versions
def test_calls_of_other_kinds_of_units_are_refused(version: Version, folder: Path) -> None:
    with unit(version, folder) as made:
        begun(made)
        now = made.take()
        before = made.written(now)
        for name in UNSUPPORTED[version].split():
            assert made.call(name, *[None] * 8) == ERROR
            assert made.said == f"fmi{version}{name}: {NO_CALL}"
        one = ((ctypes.c_uint32 * 1)(FIRST), ctypes.c_size_t(1))
        for name in ABSENT[version].split():
            room = [ctypes.create_string_buffer(64) for _ in range(3)]
            assert made.call(name, *one, *room) == ERROR
            assert "expected no value references, as " in made.said
            assert made.call(name, None, ctypes.c_size_t(0), *room) == OK
        assert made.written(made.take()) == before


@versions
def test_null_pointers_are_refused(version: Version, folder: Path) -> None:
    with unit(version, folder) as made:
        begun(made)
        real = "Real" if version == 2 else "Float64"
        one, size = (ctypes.c_uint32 * 1)(FIRST), ctypes.c_size_t(1)
        values = (ctypes.c_double * 1)(3.0)
        last = [size] if version == 3 else []
        for way in ("Get", "Set"):
            assert made.call(f"{way}{real}", None, size, values, *last) == ERROR
            assert made.said.endswith("expected an array, got a null pointer")
            assert made.call(f"{way}{real}", one, size, None, *last) == ERROR
            assert (
                made.call(f"{way}{real}", None, ctypes.c_size_t(0), None, ctypes.c_size_t(0)) == OK
            )
        if version == 3:
            for way in ("Get", "Set"):
                given = (one, size, values, ctypes.c_size_t(2))
                assert made.call(f"{way}{real}", *given) == ERROR
                assert made.said.endswith("expected a value for each of 1 value references, got 2")
            step = (ctypes.c_double(0.1), ctypes.c_double(0.1), ctypes.c_int(0))
            flag = ctypes.byref(ctypes.c_bool())
            assert made.call("DoStep", *step, flag, flag, flag, None) == ERROR
            assert made.get(0) == [0.1]
        # Without an instance nothing can be logged.
        pointer, made.pointer = made.pointer, None
        for name in ("Terminate", "Reset", "ExitInitializationMode"):
            assert made.call(name) == ERROR
        made.free()
        made.pointer = pointer


@versions
def test_a_unit_of_something_else_is_not_made(version: Version, folder: Path) -> None:
    made = Unit(version, folder, "another")
    assert made.pointer is None
    name = "fmi2Instantiate" if version == 2 else "fmi3InstantiateCoSimulation"
    token = f"expected the token {TOKEN} of program.rtamt, got 'another'; "
    said = f"{name}: {token}the files of the unit do not belong together"
    assert made.log == [(ERROR, "logStatusError", said)]
    nowhere = folder / "a b%20c"
    made = Unit(version, nowhere)
    assert made.pointer is None
    # The text is a format of printf in FMI 2.
    percent = "%%" if version == 2 else "%"
    path = str(nowhere).replace("%", percent)
    assert made.said == f"{name}: expected the file {path}/program.rtamt, which cannot be read"


def test_locations_of_fmi_2_are_uris(folder: Path) -> None:
    named = folder / "a b%20ü"
    named.mkdir()
    (named / "program.rtamt").write_bytes((folder / "program.rtamt").read_bytes())
    with unit(2, named) as made:
        begun(made)
    for location in (b"file://localhost", b"file:"):
        with unit(2, folder, prefix=location) as made:
            begun(made)
    for location, text in ((b"", str(folder)), (b"http://x", f"http://x{folder}")):
        made = Unit(2, folder, prefix=location)
        assert made.pointer is None
        assert made.said == (
            "fmi2Instantiate: expected the location of the resources as a URI such as "
            f"file:///tmp/unit, got '{text}'"
        )


def test_versions_are_said() -> None:
    for name, text in (
        ("2GetVersion", b"2.0"),
        ("2GetTypesPlatform", b"default"),
        ("3GetVersion", b"3.0"),
    ):
        function = library()[f"fmi{name}"]
        function.restype = ctypes.c_char_p
        assert function() == text


def test_units_of_other_kinds_are_not_made(folder: Path) -> None:
    path = str(folder).encode()
    token, off = TOKEN.encode(), ctypes.c_bool()
    made = library()
    for name in ("ModelExchange", "ScheduledExecution"):
        function = made[f"fmi3Instantiate{name}"]
        function.restype = ctypes.c_void_p
        assert function(b"unit", token, path, off, off, None, None, None, None, None) is None
    function = made["fmi2Instantiate"]
    function.restype = ctypes.c_void_p
    assert function(b"unit", 1, token, f"file://{folder}".encode(), None, 0, 0) is None


@versions
def test_variables_are_set_all_or_none(version: Version, folder: Path) -> None:
    with unit(version, folder) as made:
        assert made.set([FIRST, FIRST + 1], [3.0, 4.0]) == OK
        assert made.set([FIRST, FIRST + 1, 99], [5.0, 6.0, 7.0]) == ERROR
        assert made.get(FIRST, FIRST + 1) == [3.0, 4.0]


def test_the_library_knows_no_python() -> None:
    data = Path(library()._name).read_bytes()
    assert b"fmi3DoStep" in data
    assert not [name for name in (b"PyObject", b"libpython", b"nanobind") if name in data]
