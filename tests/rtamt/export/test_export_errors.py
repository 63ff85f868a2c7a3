"""Errors of exports, before a file is written."""

import platform
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any

import pytest

from rtamt import InputError, InputTypeError, RtamtError, SpecificationError
from rtamt.export import fmu
from rtamt.export.fmu import export_fmu

TIMED = "const float T = 2; always(x > 1 implies eventually[0:T](y > 0))"


@pytest.mark.parametrize(
    ("text", "options", "error", "message"),
    [
        (
            TIMED,
            {},
            InputError,
            (
                "expected the time between samples, period= in seconds or as text such as '100ms', "
                "or dense=True"
            ),
        ),
        (
            TIMED,
            {"period": 1, "dense": True},
            InputError,
            "expected period= or dense=True, which takes events at any time",
        ),
        (
            TIMED,
            {"align": "outward", "dense": True},
            InputError,
            "align= rounds bounds to samples, which dense time does not have",
        ),
        (TIMED, {"period": 1, "fmi": 1}, InputError, "expected fmi=2 or fmi=3, got 1"),
        (
            TIMED,
            {"period": 3},
            SpecificationError,
            (
                "STL:1:51: bound 2 s is not a multiple of the period 3 s (0.666667 steps)\n"
                "  const float T = 2; always(x > 1 implies eventually[0:T](y > 0))\n"
                "                                                    ^\n"
                "  hint: use 0 s or 3 s, take samples 1 s apart, or let align= round it"
            ),
        ),
        (
            "lower = x > 0; always(lower)",
            {"period": 1},
            SpecificationError,
            (
                "'lower' is a variable of every exported monitor; "
                "rename the 'lower' of the specification"
            ),
        ),
        (
            "const float upper = 3; always(x < upper)",
            {"dense": True},
            SpecificationError,
            (
                "'upper' is a variable of every exported monitor; "
                "rename the 'upper' of the specification"
            ),
        ),
        (
            "rise(x > 1)",
            {"dense": True},
            SpecificationError,
            (
                "STL:1:1: 'rise' reads the next or previous sample, and dense time has events "
                "only\n  rise(x > 1)\n  ^\n  hint: look a time d away with once[0:d], or use "
                "Monitor with a period"
            ),
        ),
    ],
)
def test_what_cannot_be_exported_is_refused(
    tmp_path: Path, text: str, options: dict[str, Any], error: type[RtamtError], message: str
) -> None:
    with pytest.raises(error) as raised:
        export_fmu(text, tmp_path / "monitor.fmu", **options)
    assert str(raised.value) == message
    assert list(tmp_path.iterdir()) == []


def test_a_path_is_text_or_a_path() -> None:
    with pytest.raises(InputTypeError) as raised:
        export_fmu(TIMED, 3, period=1)  # type: ignore[arg-type]
    assert str(raised.value) == "expected the path of a file as text or a Path, got 3"


def test_a_file_that_no_tool_takes_is_not_written(tmp_path: Path) -> None:
    for name in ("x.txt", "monitor", "fmu"):
        with pytest.raises(InputError) as raised:
            export_fmu(TIMED, tmp_path / name, period=1)
        assert str(raised.value) == (
            f"cannot write {tmp_path / name}: expected a name that ends in .fmu"
        )
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
