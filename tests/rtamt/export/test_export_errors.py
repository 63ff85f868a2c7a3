"""Refused exports; tests/rtamt/program/errors.txt has the other errors."""

import platform
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from rtamt import InputError, RtamtError
from rtamt.export import fmu
from rtamt.export.fmu import export_fmu

TIMED = "const float T = 2; always(x > 1 implies eventually[0:T](y > 0))"


def test_a_refused_export_writes_no_file(tmp_path: Path) -> None:
    for text, name in (("lower = x > 0; always(lower)", "x.fmu"), (TIMED, "x.txt"), (TIMED, "fmu")):
        with pytest.raises(RtamtError):
            export_fmu(text, tmp_path / name, period=1)
    assert list(tmp_path.iterdir()) == []
    export_fmu(TIMED, tmp_path / "M.FMU", period=1)


def test_without_the_library_nothing_is_exported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = ModuleSpec("rtamt._native", None, origin=str(tmp_path / "_native.so"))
    monkeypatch.setattr(fmu, "find_spec", lambda _: elsewhere)
    with pytest.raises(InputError) as raised:
        export_fmu(TIMED, tmp_path / "monitor.fmu", period=1)
    assert str(raised.value) == (
        "the FMU library rtamt_monitor.so was not built; reinstall rtamt with a C++20 compiler"
    )
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_platform_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    with pytest.raises(InputError) as raised:
        export_fmu(TIMED, tmp_path / "monitor.fmu", period=1)
    assert str(raised.value) == (
        "there is no FMU library for this platform, linux riscv64; export on linux x86_64"
    )
