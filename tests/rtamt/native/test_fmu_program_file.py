"""Damaged or forged files of exported monitors are refused, or harmless."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from fmu_calls import ERROR, FIRST, LOWER, OK, ROBUSTNESS, TOKEN, UPPER, Unit, unit
from fmu_calls import write as written
from fuzz_units import TEXTS, programs

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

kinds = pytest.mark.parametrize("kind", TEXTS)


def lines_of(kind: str, folder: Path) -> list[str]:
    """Return the lines of a file without the last, which is their hash."""
    return (written(folder, programs(kind)) / "program.rtamt").read_text().splitlines()[:-1]


def write(folder: Path, lines: list[str]) -> Path:
    """Write a file with the hash of its lines."""
    text = "".join(f"{line}\n" for line in lines).encode()
    value = 0xCBF29CE484222325
    for byte in text:
        value = ((value ^ byte) * 0x100000001B3) % 2**64
    (folder / "program.rtamt").write_bytes(text + f"end {value:016x}\n".encode())
    return folder


def refused(folder: Path) -> str:
    made = Unit(3, folder)
    assert made.pointer is None
    ((status, category, text),) = made.log
    assert (status, category) == (ERROR, "logStatusError")
    return text.removeprefix("fmi3InstantiateCoSimulation: ")


def test_the_lines_of_a_file_are_read_as_they_are_written(tmp_path: Path) -> None:
    for kind in TEXTS:
        with unit(3, write(tmp_path, lines_of(kind, tmp_path))) as made:
            run(made)


def run(made: Unit) -> None:
    """Step with any inputs of the program; it may refuse them."""
    rng = random.Random(1)
    assert made.enter() == OK
    if made.call("ExitInitializationMode") == OK:
        for i in range(12):
            for reference in (FIRST, FIRST + 1):
                made.set([reference], [rng.gauss(0, 3)])
            made.step(i / 2, 0.5)
            made.get(ROBUSTNESS, LOWER, UPPER)
            made.verdict()
            made.take()


@kinds
def test_a_damaged_file_is_refused(kind: str, tmp_path: Path) -> None:
    rng = random.Random(kind)
    lines_of(kind, tmp_path)
    file = tmp_path / "program.rtamt"
    data = file.read_bytes()
    damaged = [b"", b"end ", data[:-1], data[:-30], data + b"\n", b" " + data]
    for _ in range(60):
        changed = bytearray(data)
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        damaged.append(bytes(changed))
    for each in damaged:
        file.write_bytes(each)
        assert refused(tmp_path) == "program.rtamt is damaged; export the unit again"


def test_the_place_of_a_fault_is_said(tmp_path: Path) -> None:
    lines = lines_of("samples", tmp_path)

    def said(begin: str, instead: str) -> str:
        at = next(i for i, line in enumerate(lines) if line.startswith(begin))
        changed = [*lines[:at], *([instead] if instead else []), *lines[at + 1 :]]
        text = refused(write(tmp_path, changed))
        assert text.startswith("program.rtamt, line ")
        assert text.endswith("; export the unit again")
        number, _, rest = text.removeprefix("program.rtamt, line ").partition(": ")
        assert int(number) in {at + 1, len(changed)}
        return rest.removesuffix("; export the unit again")

    assert said("rtamt-program", "rtamt-program 2") == "expected version 3 of the format, got '2'"
    assert said("rtamt-program", "something") == "expected a program of rtamt, got 'something'"
    assert said("token", "") == "expected a token and programs"
    assert said("samples", "samples 1 0") == "expected a period"
    assert said("samples", "ticks 0 1 1") == "expected a clock that counts"
    assert said("samples", "ticks 1 1 1") == "expected a token and programs"
    assert said("input x", "input x") == "expected another field"
    assert said("input x", "input x y") == "expected a number, got 'y'"
    assert said("input x", "input x 0.0 1") == "expected the end of the line, got '1'"
    assert said("derived", "derived sine %0 %0") == "expected a function, got 'sine'"
    assert said("derived", "derived mul %1 %0") == "expected a number that is known here, got '%1'"
    assert said("derived", "derived mul 2.0 $0") == (
        "expected a number that is known here, got '$0'"
    )
    assert (
        said("formula-row", "formula-row WINDOW min 0 0 3 2 0 0") == "expected a window in samples"
    )
    assert said("formula-row", "row") == "expected a record that fits here, got 'row'"
    assert said("sample-row", "sample-row 99999999 LOAD x 0 0 0.0 0 0") == (
        "expected a register, got '99999999'"
    )
    neither = "expected a register or an episode for each named formula"
    assert said("observed", "") == neither
    assert said("formula near", "formula near 1") == neither
    assert said("formula near", "formula near 2") == neither
    assert said("episodes", "") == "expected a token and programs"
    assert said("episodes", "episodes 3") == "expected a token and programs"


def test_a_fold_that_is_listed_twice_is_refused(tmp_path: Path) -> None:
    lines = lines_of("dense", tmp_path)
    at = lines.index("initial 9 12 13")
    twice = [*lines[:at], "initial 9 12 12", *lines[at + 1 :]]
    assert refused(write(tmp_path, twice)) == "expected a program over regions"


@kinds
def test_forged_files_are_refused_or_harmless(kind: str, tmp_path: Path) -> None:
    rng = random.Random(kind)
    lines = lines_of(kind, tmp_path)
    words = sorted({word for line in lines for word in line.split()})
    words += ["-1", "0", "1", "2", "7", "99", "-", "nan", "-inf", "1e308", "%0", "$0", "$1"]
    made = 0
    for _ in range(250):
        changed = list(lines)
        for _ in range(rng.randint(1, 2)):
            at = rng.randrange(len(changed))
            fields = changed[at].split(" ")
            fields[rng.randrange(len(fields))] = rng.choice(words)
            changed[at] = " ".join(fields)
            if rng.random() < 0.2:
                del changed[at]
            elif rng.random() < 0.2:
                changed.insert(at, rng.choice(lines))
        each = Unit(2, write(tmp_path, changed))
        if each.pointer is None:
            assert re.match("fmi2Instantiate: ", each.said)
        elif any(line == f"token {TOKEN}" for line in changed):
            made += 1
            run(each)
            each.free()
    assert made > 10
