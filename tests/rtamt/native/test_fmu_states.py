"""States of exported monitors: saved states continue equally, damaged states are refused."""

from __future__ import annotations

import ctypes
import random
import struct
from pathlib import Path

import pytest
from fmu_calls import (
    ERROR,
    FIRST,
    LOWER,
    OK,
    ROBUSTNESS,
    UPPER,
    Unit,
    Version,
    dense,
    sampled,
    unit,
    versions,
    write,
)

from rtamt.export.program_file import Programs

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

TEXT = """
const float limit = 1
near = (x < limit) since[0:3] (y > 0)
done = eventually(always(y > limit))
whole = done and always(x > limit implies eventually[0:4](y > 0))
"""
DENSE = "near = once[0:3](x > 0)\nwhole = always((x < 1) since[0:3] (y > 0))"
EVERYTHING = (0, *range(FIRST, FIRST + 4))
"""Time, inputs, and the output after the parameter or instead of it."""
DAMAGED = "expected the bytes of a state, got damaged ones"

kinds = pytest.mark.parametrize("kind", ["samples", "neutral", "dense"])


def programs(kind: str) -> Programs:
    if kind == "dense":
        return dense(DENSE)
    # Neutral predicates have a machine for each bound.
    declared = "input float x\noutput float y" if kind == "neutral" else ""
    semantics = "output-vacuity" if kind == "neutral" else "standard"
    return sampled(declared + TEXT, semantics=semantics)


def go_on(made: Unit, begin: int, end: int, seed: int = 0) -> list[list[int]]:
    """Step by a half with random inputs; return the outputs after each."""
    found = []
    for i in range(begin, end):
        rng = random.Random(f"{seed} {i}")
        assert made.set([FIRST, FIRST + 1], [rng.choice((-1.0, 0.5, 2.0)), rng.gauss(0, 1)]) == OK
        assert made.step(i / 2, 0.5) == OK
        found.append(made.outputs(*EVERYTHING))
    return found


@versions
@kinds
@pytest.mark.parametrize("at", [0, 1, 5, 12])
def test_a_state_that_was_taken_goes_on_alike(
    version: Version, kind: str, at: int, tmp_path: Path
) -> None:
    folder = write(tmp_path, programs(kind))
    with unit(version, folder) as made, unit(version, folder) as other:
        if kind == "samples":
            assert made.set([FIRST + 2], [0.25]) == OK
        made.begin()
        go_on(made, 0, at)
        before = made.outputs(*EVERYTHING)
        state = made.take()
        after = go_on(made, at, 20)
        assert made.restore(state) == OK
        assert made.outputs(*EVERYTHING) == before
        assert go_on(made, at, 14, seed=1)
        assert made.restore(state) == OK
        assert go_on(made, at, 20) == after
        # Another instance, which has not started.
        status, twin = other.read(made.written(state))
        assert status == OK
        assert other.restore(twin) == OK
        assert other.written(other.take()) == made.written(state)
        assert go_on(other, at, 20) == after


@versions
def test_states_hold_what_was_set_before_initialization_ends(
    version: Version, tmp_path: Path
) -> None:
    with unit(version, write(tmp_path, programs("samples"))) as made:
        early = made.take()
        assert made.set([FIRST + 2], [0.25]) == OK
        assert made.set_stop(True) == OK
        set_ = made.take()
        assert made.enter(3.0, 9.0) == OK
        entered = made.take()
        assert made.call("ExitInitializationMode") == OK
        assert made.call("Terminate") == OK
        for state, parameter, phase in ((early, 1.0, 0), (set_, 0.25, 0), (entered, 0.25, 1)):
            assert made.restore(state) == OK
            assert made.get(FIRST + 2) == [parameter]
            if phase == 0:
                assert made.call("ExitInitializationMode") == ERROR
                assert made.enter(3.0, 9.0) == OK
            assert made.call("ExitInitializationMode") == OK
            assert made.get(0) == [3.0]


@versions
def test_a_state_is_kept_in_place_and_freed_once(version: Version, tmp_path: Path) -> None:
    folder = write(tmp_path, programs("samples"))
    with unit(version, folder) as made, unit(version, folder) as other:
        made.begin()
        other.begin()
        state, kept = made.take(), made.take()
        address = state.value
        go_on(made, 0, 3)
        assert made.call("GetFMUState", ctypes.byref(state)) == OK
        assert state.value == address
        now = made.outputs(*EVERYTHING)
        assert made.restore(kept) == OK
        assert made.restore(state) == OK
        assert made.outputs(*EVERYTHING) == now
        assert other.restore(state) == ERROR  # of another instance
        assert made.call("FreeFMUState", ctypes.byref(state)) == OK
        assert state.value is None
        assert made.call("FreeFMUState", ctypes.byref(state)) == OK  # of nothing
        again = ctypes.c_void_p(address)
        for call in ("FreeFMUState", "GetFMUState"):
            assert made.call(call, ctypes.byref(again)) == ERROR
        assert made.restore(again) == ERROR
        assert made.said.endswith(
            "expected a state that was taken of this instance and is not freed"
        )
        assert made.outputs(*EVERYTHING) == now


@versions
@kinds
def test_damaged_bytes_of_a_state_are_refused(version: Version, kind: str, tmp_path: Path) -> None:
    rng = random.Random(version)
    with unit(version, write(tmp_path, programs(kind))) as made:
        made.begin()
        go_on(made, 0, 9)
        data, now = made.written(made.take()), made.outputs(*EVERYTHING)
        damaged = [data[:n] for n in (0, 7, 8, 9, 40, len(data) - 1)] + [data + b"\0"]
        for _ in range(200):
            changed = bytearray(data)
            changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            damaged.append(bytes(changed))
        for each in damaged:
            status, state = made.read(each)
            assert (status, state.value) == (ERROR, None)
            assert made.said.endswith(DAMAGED)
        assert made.outputs(*EVERYTHING) == now


@versions
@kinds
def test_forged_bytes_of_a_state_break_nothing(version: Version, kind: str, tmp_path: Path) -> None:
    rng = random.Random(version)
    refused = 0
    with unit(version, write(tmp_path, programs(kind))) as made:
        made.begin()
        after = go_on(made, 0, 9)
        data = made.written(made.take())[:-8]
        for _ in range(400):
            changed = bytearray(data)
            for _ in range(rng.randint(1, 3)):
                changed[rng.randrange(len(data))] = rng.choice(
                    (0, 1, 0x7F, 0xFF, rng.randrange(256))
                )
            status, state = made.read(
                signed(bytes(changed[: rng.choice((None, None, rng.randrange(len(data))))]))
            )
            if status == OK:
                assert made.restore(state) == OK
                time = made.get(0)[0]
                made.step(time, 0.5)
                made.step(time + 0.5, 2.0)
                made.get(ROBUSTNESS, LOWER, UPPER, FIRST + 2, FIRST + 3)
                assert made.call("FreeFMUState", ctypes.byref(state)) == OK
            refused += status != OK
        assert refused > 50
        assert made.call("Reset") == OK
        made.begin()
        assert go_on(made, 0, 9) == after


def signed(data: bytes) -> bytes:
    value = 0xCBF29CE484222325
    for byte in data:
        value = ((value ^ byte) * 0x100000001B3) % 2**64
    return data + struct.pack("=Q", value)


@versions
def test_the_state_of_another_unit_is_refused(version: Version, tmp_path: Path) -> None:
    folders = [tmp_path / kind for kind in ("samples", "dense")]
    for folder in folders:
        folder.mkdir()
        write(folder, programs(folder.name))
    with unit(version, folders[0]) as made, unit(version, folders[1]) as other:
        assert other.read(made.written(made.take()))[0] == ERROR
        assert other.said.endswith("expected a state of this unit, got a state of another")


@versions
def test_room_for_a_state_is_asked_for(version: Version, tmp_path: Path) -> None:
    with unit(version, write(tmp_path, programs("samples"))) as made:
        state = made.take()
        size = len(made.written(state))
        room = ctypes.create_string_buffer(size)
        given = (state, room, ctypes.c_size_t(size - 1))
        assert made.call("SerializeFMUState", *given) == ERROR
        assert made.said.endswith(f"expected room for {size} bytes, got {size - 1}")


@versions
def test_a_reset_instance_is_a_new_one(version: Version, tmp_path: Path) -> None:
    with unit(version, write(tmp_path, programs("samples"))) as made:
        new = made.outputs(*EVERYTHING)
        made.begin()
        first = go_on(made, 0, 7)
        assert made.call("Terminate") == OK
        assert made.call("Reset") == OK
        assert made.outputs(*EVERYTHING) == new
        made.begin()
        assert go_on(made, 0, 7) == first
