"""Rare errors of units: odd pointers, locations, kinds and programs."""

from __future__ import annotations

import ctypes
import math
import re
import struct
from pathlib import Path
from typing import Any

import pytest
from fmu_calls import (
    DISCARD,
    ERROR,
    FIRST,
    OK,
    ROBUSTNESS,
    TOKEN,
    Unit,
    Version,
    dense,
    library,
    sampled,
    unit,
    versions,
    write,
)
from fuzz_units import programs

pytest.importorskip("rtamt._native", reason="no compiler was at hand")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write(tmp_path, sampled("always(x > 0)", "100ms"), stop=True)


def begun(made: Unit, x: float = 1.0) -> None:
    assert made.set([FIRST], [x]) == OK
    made.begin()
    assert made.step(0.0, 0.1) in {OK, DISCARD}


# Instances. --------------------------------------------------------------------------------------


def refusal(version: Version, folder: Path, **changes: Any) -> str:  # noqa: ANN401 - arguments of C
    """Return the reason why these arguments create no instance."""
    given = {
        "name": b"unit",
        "kind": 1,
        "token": TOKEN.encode(),
        "location": (folder.as_uri() if version == 2 else str(folder)).encode(),
        **changes,
    }
    said = list[tuple[int, str, str]]()
    spare = Unit(version, folder)  # provides the logger and callbacks
    spare.log = said
    function = spare.function("Instantiate" if version == 2 else "InstantiateCoSimulation")
    function.restype = ctypes.c_void_p
    token, path, off = given["token"], given["location"], ctypes.c_bool()
    if version == 2:
        callbacks = ctypes.byref(spare._callbacks)
        pointer = function(given["name"], given["kind"], token, path, callbacks, 0, 0)
    else:
        flags = [off] * 4
        nothing = (None, ctypes.c_size_t(0), None)
        pointer = function(given["name"], token, path, *flags, *nothing, spare._logger, None)
    spare.free()
    assert pointer is None
    ((status, category, text),) = said
    assert (status, category) == (ERROR, "logStatusError")
    return text.partition(": ")[2]


@versions
def test_an_instance_has_a_name_a_token_and_a_folder(version: Version, folder: Path) -> None:
    for name in (None, b""):
        assert refusal(version, folder, name=name) == "expected a name of the instance"
    assert refusal(version, folder, token=None) == (
        "expected the token {token} of program.rtamt, got ''; "
        "the files of the unit do not belong together"
    )
    if version == 3:
        assert refusal(3, folder, location=None) == "expected the folder of the resources"
        assert refusal(3, folder, location=b"") == (
            "expected the file program.rtamt, which cannot be read"
        )
        return
    assert refusal(2, folder, kind=0) == "expected co-simulation, got model exchange"
    assert refusal(2, folder, location=None) == (
        "expected the location of the resources as a URI such as file:///tmp/unit, got ''"
    )
    assert refusal(2, folder, location=b"file:") == (
        "expected the file program.rtamt, which cannot be read"
    )


@pytest.mark.parametrize(
    ("coded", "plain"),
    [
        ("%61%7a%7A", "azz"),
        ("%C3%BC%c3%bc", "üü"),
        ("a%", "a%"),
        ("a%6", "a%6"),
        ("%6", "%6"),
        ("%g1%1g", "%g1%1g"),
        ("%G1%1G", "%G1%1G"),
        ("%/1", "%/1"),
        ("%:1%1:", "%:1%1:"),
        ("%@1%1@", "%@1%1@"),
        ("%`1%1`", "%`1%1`"),
        ("%%61", "%a"),
        ("%2541", "%41"),
    ],
)
def test_codes_in_locations_are_two_hexadecimal_digits(
    coded: str, plain: str, folder: Path
) -> None:
    said = refusal(2, folder, location=f"file:///nowhere/{coded}".encode())
    place = plain.replace("%", "%%")  # the text is a format of printf
    assert said == f"expected the file /nowhere/{place}/program.rtamt, which cannot be read"


def test_an_instance_without_a_logger_refuses_silently(folder: Path) -> None:
    make = library()["fmi2Instantiate"]
    make.restype = ctypes.c_void_p
    silent = (ctypes.c_void_p * 5)()
    location = folder.as_uri().encode()
    assert make(b"unit", 1, b"another", location, ctypes.byref(silent), 0, 0) is None
    pointer = ctypes.c_void_p(
        make(b"unit", 1, TOKEN.encode(), location, ctypes.byref(silent), 0, 0)
    )
    assert pointer.value
    assert library()["fmi2Terminate"](pointer) == ERROR
    free = library()["fmi2FreeInstance"]
    free.restype = None
    free(pointer)


# Calls. ------------------------------------------------------------------------------------------


@versions
def test_initialization_is_over_after_the_first_step(version: Version, folder: Path) -> None:
    with unit(version, folder) as made:
        begun(made)
        assert made.enter() == ERROR
        assert made.said.endswith(
            "expected the call before initialization, got it after initialization"
        )
        assert made.call("Reset") == OK
        assert made.enter(0.0, math.nan) == ERROR
        assert made.said.endswith("expected times that are numbers, got 0 to nan")
        one = (ctypes.c_char_p * 1)(None)
        assert made.call("SetDebugLogging", 1, ctypes.c_size_t(1), one) == ERROR
        assert made.said.endswith("expected the categories logStatusError and logEvents, got ''")


def test_each_status_of_fmi_2_has_its_kind(folder: Path) -> None:
    do_step, pending, last, terminated = range(4)
    with unit(2, folder) as made:
        begun(made)
        numbers: dict[str, tuple[int, str, Any, object]] = {
            "Status": (do_step, "fmi2DoStepStatus", ctypes.c_int(9), OK),
            "RealStatus": (last, "fmi2LastSuccessfulTime", ctypes.c_double(9), 0.1),
            "BooleanStatus": (terminated, "fmi2Terminated", ctypes.c_int(9), 0),
            "StringStatus": (pending, "fmi2PendingStatus", ctypes.c_char_p(b"9"), b""),
        }
        for name, (own, text, place, expected) in numbers.items():
            for kind in range(-1, 5):
                before = place.value
                status = made.call(f"Get{name}", kind, ctypes.byref(place))
                assert status == (OK if kind == own else ERROR)
                if status == OK:
                    assert place.value == expected
                else:
                    assert place.value == before
                    assert made.said == f"fmi2Get{name}: expected the kind {text}"
            assert made.call(f"Get{name}", own, None) == ERROR
            assert made.said.endswith("expected an array, got a null pointer")
    with unit(2, folder) as made:
        begun(made, -1.0)
        last_step = ctypes.c_int(9)
        assert made.call("GetStatus", do_step, ctypes.byref(last_step)) == OK
        assert (last_step.value, *made.ended()) == (DISCARD, True, 0.1)


# Dense time. -------------------------------------------------------------------------------------


@versions
@pytest.mark.parametrize(
    "text", ["always(sqrt(x) > 0)", "near = sqrt(x) > 0\nwhole = always(near)"]
)
def test_a_dense_unit_refuses_what_is_no_number(
    version: Version, text: str, tmp_path: Path
) -> None:
    with unit(version, write(tmp_path, dense(text))) as made:
        assert made.set([FIRST], [4.0]) == OK
        made.begin()
        assert made.step(0.0, 1.0) == OK
        for x, said in (
            (math.nan, "expected a number as input 'x', got nan, at 1 s"),
            (-1.0, "a term of the specification is not a number for x=-1, at 1 s"),
        ):
            assert made.set([FIRST], [x]) == OK
            assert made.step(1.0, 1.0) == ERROR
            assert made.said.endswith(said)
            assert made.get(0, ROBUSTNESS) == [1.0, 2.0]
        assert made.set([FIRST], [1.0]) == OK
        assert made.step(1.0, 1.0) == OK
        assert made.get(ROBUSTNESS) == [1.0]
        state = made.take()
        assert made.set([FIRST], [0.25]) == OK
        assert made.step(2.0, 1.0) == OK
        assert made.get(ROBUSTNESS) == [0.5]
        assert made.restore(state) == OK
        assert made.get(0, ROBUSTNESS) == [2.0, 1.0]


@versions
def test_a_dense_trace_is_shorter_than_its_clock(version: Version, tmp_path: Path) -> None:
    with unit(version, write(tmp_path, dense("always[0:3](x > 0)"))) as made:
        assert made.set([FIRST], [1.0]) == OK
        made.begin(-4e9)
        assert made.step(-4e9, 4.5e9) == OK
        assert made.step(5e8, 4e9) == OK
        before = made.get(0, ROBUSTNESS)
        assert made.step(4.5e9, 1.0) == ERROR
        assert made.said.endswith(
            "expected a trace of less than 2^62 ticks with the bounds of the formula, "
            "got a step at 4.5e+09 s; export with a greater resolution"
        )
        assert made.get(0, ROBUSTNESS) == before


# States. -----------------------------------------------------------------------------------------


def signed(data: bytes) -> bytes:
    """Return the bytes of a state with their hash, the hash of all programs here."""
    return data + struct.pack("=Q", fnv(data))


def fnv(data: bytes) -> int:
    value = 0xCBF29CE484222325
    for byte in data:
        value = ((value ^ byte) * 0x100000001B3) % 2**64
    return value


TIME, INPUTS = 8 + 3, 8 + 3 + 3 * 8
"""After the mark of the program, the phase and two flags; after three times."""


def test_times_in_a_state_are_finite(tmp_path: Path) -> None:
    with unit(3, write(tmp_path, sampled("always(x > 0)"))) as made:
        begun(made)
        data = made.written(made.take())[:-8]
        for i, wrong in (
            (0, (math.nan, math.inf, -math.inf)),
            (1, (math.nan,)),
            (2, (-0.5, 1.0, math.nan)),
        ):
            at = TIME + 8 * i
            for time in wrong:
                forged = data[:at] + struct.pack("=d", time) + data[at + 8 :]
                assert made.read(signed(forged))[0] == ERROR
                assert made.said.endswith("expected a whole state, got a damaged one")
        assert made.read(signed(data))[0] == OK


def parts(data: bytes) -> tuple[bytes, bytes, bytes]:
    """Return the parts of a state of one input: before the machine of its named formula, it, and
    the rest.
    """
    at = INPUTS + 8
    (size,) = struct.unpack_from("=Q", data, at)
    end = at + 8 + size
    return data[:at], data[at:end], data[end:-8]


def test_the_machines_of_a_dense_unit_have_seen_the_same(tmp_path: Path) -> None:
    text = "near = once[0:3](x > 0)\nwhole = always(near)"
    with unit(3, write(tmp_path, dense(text))) as made:
        made.begin()
        states = []
        for i in range(2):
            assert made.step(float(i), 1.0) == OK
            states.append(parts(made.written(made.take())))
        (before, machine, rest), (_, later, _) = states
        assert machine != later
        assert made.read(signed(before + machine + rest))[0] == OK
        assert made.read(signed(before + later + rest))[0] == ERROR
        assert made.said.endswith("expected a whole state, got a damaged one")


# Programs. ---------------------------------------------------------------------------------------

SAMPLED, DENSE = "samples", "dense"
WHICH = "expected a token and programs"
WINDOW = "expected a window in samples"
CHANGES: list[tuple[str, str, list[str], str]] = [
    (SAMPLED, "derived", ["derived mul"], "expected another field"),
    (SAMPLED, "derived", ["derived mul %0"], "expected another field"),
    (SAMPLED, "derived", ["derived sqrt %0 %0", "parameter z 1.0"], "before derived numbers"),
    (DENSE, "ticks", ["ticks inf 1 1"], "expected a clock that counts"),
    (DENSE, "ticks", ["ticks nan 1 1"], "expected a clock that counts"),
    (DENSE, "ticks", ["ticks 1.0 -1 1"], "expected a clock that counts"),
    (DENSE, "ticks", ["ticks 1.0 1 0"], "expected a clock that counts"),
    (SAMPLED, "sample-row 0", ["sample-row 0 LOAD x 0 0 0.0 0 -1"], WINDOW),
    (SAMPLED, "sample-row 0", [f"sample-row 0 LOAD x 0 0 0.0 0 {2**32 + 1}"], WINDOW),
    (SAMPLED, "sample-row 0", [f"sample-row 0 LOAD x 0 0 0.0 {2**32 + 1} 0"], WINDOW),
    (SAMPLED, "formula-row", [f"formula-row WINDOW min 7 7 {-(2**31) - 1} 0 0 0"], WINDOW),
    (SAMPLED, "formula-row", [f"formula-row WINDOW min 7 7 0 {2**31 + 1} 0 0"], WINDOW),
    (SAMPLED, "samples", ["samples 1 1", "ticks 1.0 1 1"], WHICH),
    (SAMPLED, "streams", ["regions 0"], WHICH),
    (SAMPLED, "streams", ["dense 0"], WHICH),
    (DENSE, "episodes", ["episodes 2"], WHICH),
    (DENSE, "episodes", ["episodes 1", "monitor 0"], ""),
    (DENSE, "observed", ["observed 10", "monitor 0"], WHICH),
]


def changed(kind: str, begin: str, instead: list[str], folder: Path) -> list[str]:
    """Return the lines of a program without the last, with others instead of one."""
    lines = (write(folder, programs(kind)) / "program.rtamt").read_text().splitlines()[:-1]
    at = next(i for i, line in enumerate(lines) if line.startswith(begin))
    if kind == DENSE and begin == "episodes" and len(instead) == 1:
        second = lines.index("regions 0")  # but one episode
        lines = lines[:second]
    return [*lines[:at], *instead, *lines[at + 1 :]]


def rewritten(folder: Path, text: str) -> Path:
    data = text.encode()
    (folder / "program.rtamt").write_bytes(data + f"end {fnv(data):016x}\n".encode())
    return folder


@pytest.mark.parametrize(("kind", "begin", "instead", "said"), CHANGES)
def test_a_program_with_another_line_is_refused(
    kind: str, begin: str, instead: list[str], said: str, tmp_path: Path
) -> None:
    lines = changed(kind, begin, instead, tmp_path)
    made = Unit(3, rewritten(tmp_path, "".join(f"{line}\n" for line in lines)))
    assert made.pointer is None
    text = re.escape(said)
    pattern = rf"fmi3\w+: program\.rtamt, line \d+: .*{text}.*; export the unit again"
    assert re.fullmatch(pattern, made.said), made.said


def test_the_last_line_of_a_program_may_lack_its_end(tmp_path: Path) -> None:
    lines = changed(SAMPLED, "stop", ["stop 0"], tmp_path)
    with unit(3, rewritten(tmp_path, "\n".join(lines))) as made:
        made.begin()


def test_the_hash_of_a_program_is_sixteen_digits_and_an_end(tmp_path: Path) -> None:
    text = "".join(f"{line}\n" for line in changed(SAMPLED, "stop", ["stop 0"], tmp_path))
    whole = rewritten(tmp_path, text) / "program.rtamt"
    data = whole.read_bytes()
    with unit(3, tmp_path):
        pass
    for end in (b"end " + b"z" * 16 + b"\n", data[-21:-1] + b" ", b"eNd " + data[-17:]):
        whole.write_bytes(data[:-21] + end)
        made = Unit(3, tmp_path)
        assert made.pointer is None
        assert made.said.endswith("program.rtamt is damaged; export the unit again")
