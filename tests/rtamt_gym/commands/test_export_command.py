"""`rtamt export`: its files, and errors."""

import shlex
from pathlib import Path

import pytest
from catalogue import entries
from fmpy import read_model_description  # type: ignore[import-untyped]
from fmpy.validation import validate_fmu  # type: ignore[import-untyped]

import rtamt
import rtamt.export.fmu
from rtamt_gym.__main__ import main

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

Output = pytest.CaptureFixture[str]
ONE = (
    "const float limit = 3; const float T = 2; "
    "always(req >= limit implies eventually[0:T](gnt > 1))"
)
TWO = "apart = always(gap > 1)\nslow = always(speed < 5)\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with two specifications."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.stl").write_text(ONE)
    (tmp_path / "two.stl").write_text(TWO)
    return tmp_path


def refused(words: list[str], capsys: Output) -> str:
    assert main(["export", *words]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert not Path("m.fmu").exists()
    return output.err.removeprefix("rtamt: error: ").removesuffix("\n")


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_it_writes_what_the_function_writes(capsys: Output, fmi: str) -> None:
    assert main(["export", "one.stl", "-o", "m.fmu", "--period", "100ms", "--fmi", fmi]) == 0
    assert capsys.readouterr().out == f"m.fmu: FMI {fmi}.0, inputs 'req', 'gnt'\n"
    rtamt.export.fmu.export_fmu(ONE, "same.fmu", period=0.1, fmi=3 if fmi == "3" else 2)
    assert Path("m.fmu").read_bytes() == Path("same.fmu").read_bytes()
    assert validate_fmu("m.fmu") == []


def test_a_text_that_does_not_look_ahead_is_noted(capsys: Output) -> None:
    assert main(["export", "speed < 30", "-o", "m.fmu", "--period", "1"]) == 0
    assert capsys.readouterr().out == (
        "m.fmu: FMI 2.0, inputs 'speed'\n"
        "note: robustness, lower, upper and verdict depend on the first sample only. To monitor "
        "the whole run, write always(speed < 30)\n"
    )
    assert main(["export", "speed < 30", "-o", "m.fmu", "--dense"]) == 0
    assert capsys.readouterr().out == (
        "m.fmu: FMI 2.0, inputs 'speed'\n"
        "note: robustness, lower, upper and verdict depend on the first instant only. To monitor "
        "the whole run, write always(speed < 30)\n"
    )


@pytest.mark.parametrize(
    ("text", "reason", "hint"),
    [
        (
            "always(next(x > 0))",
            "STL:1:8: 'next' reads the next or previous sample, and dense time has events only",
            "look a time d away with eventually[0:d], or leave out --dense",
        ),
    ],
)
def test_what_dense_time_does_not_have_is_left_with_dense(
    capsys: Output, text: str, reason: str, hint: str
) -> None:
    said = refused([text, "-o", "m.fmu", "--dense"], capsys).splitlines()
    assert (said[0], said[-1]) == (reason, f"  hint: {hint}")


def test_every_option_reaches_the_monitor() -> None:
    words = ["--dense", "--stop-on-violation", "--constant", "limit=4", "--constant", "T=1"]
    assert main(["export", "one.stl", "-o", "m.fmu", *words]) == 0
    spec = rtamt.parse(ONE, constants={"limit": 4, "T": 1})
    rtamt.export.fmu.export_fmu(spec, "same.fmu", dense=True, stop_on_violation=True)
    assert Path("m.fmu").read_bytes() == Path("same.fmu").read_bytes()
    words = ["--period", "0.3", "--align", "outward", "--semantics", "boolean"]
    assert main(["export", "one.stl", "-o", "m.fmu", *words]) == 0
    rtamt.export.fmu.export_fmu(ONE, "same.fmu", period=0.3, align="outward", semantics="boolean")
    assert Path("m.fmu").read_bytes() == Path("same.fmu").read_bytes()


def test_one_of_several_requirements_is_chosen(capsys: Output) -> None:
    words = ["two.stl", "-o", "m.fmu", "--period", "1"]
    assert refused(words, capsys) == (
        "expected one requirement, got 'apart', 'slow'; give --only with its name"
    )
    assert refused([*words, "--only", "slwo"], capsys) == (
        "--only: no requirement is called 'slwo'; did you mean 'slow'?"
    )
    assert main(["export", *words, "--only", "slow"]) == 0
    names = [each.name for each in read_model_description("m.fmu").modelVariables]
    assert names[5:] == ["speed", "slow"]


@pytest.mark.parametrize(("words", "message"), entries(Path(__file__).with_name("export.txt")))
def test_what_cannot_be_exported_is_refused(words: str, message: str, capsys: Output) -> None:
    assert refused(shlex.split(words), capsys) == message
