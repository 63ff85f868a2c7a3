"""Values outside declared ranges, and variables that never change."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]

SPEC = "input float x in [0, 120]; float g; p = always(x < 500 and g > 0)"
OUTSIDE = "2 of 3 values of x are outside the declared range [0, 120], the first is 130 at 1 s"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("out.csv").write_text("time [s],x,g\n0,5,1\n1,130,1\n2,-1,1\n")
    Path("in.csv").write_text("time [s],x,g\n0,0,1\n1,120,2\n2,1,1\n")
    return tmp_path


def notes(arguments: list[str], code: int, capsys: Output) -> list[str]:
    """Return the notes on one trace, whose JSON has the expected exit code."""
    assert main(["monitor", *arguments, "--json"]) == code
    kept = json.loads(capsys.readouterr().out)
    assert kept["exit_code"] == code
    return list(kept["trials"][0].get("notes", []))


@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_values_outside_declared_ranges_are_counted(dense: list[str], capsys: Output) -> None:
    assert notes([SPEC, "in.csv", *dense], 0, capsys) == []
    assert notes([SPEC, "in.csv", "--strict-ranges", *dense], 0, capsys) == []
    constant = "constant over the whole trace: g (1)"
    assert notes([SPEC, "out.csv", *dense], 0, capsys) == [OUTSIDE, constant]
    assert notes([SPEC, "out.csv", "--strict-ranges", *dense], 3, capsys) == [OUTSIDE, constant]
    worse = SPEC.replace("500", "100")
    assert notes([worse, "out.csv", "--strict-ranges", *dense], 1, capsys) == [OUTSIDE, constant]


def test_types_are_ranges_and_unknown_values_are_not_compared(capsys: Output) -> None:
    Path("t.csv").write_text('gear\n0\n""\n300\n-1\n')
    words = ["uint8 gear; always(gear > -9)", "t.csv", "--missing", "unknown"]
    expected = (
        "2 of 4 values of gear are outside the declared range [0, 255], the first is 300 in "
        "t.csv, line 4"
    )
    assert notes([*words, "--strict-ranges"], 3, capsys)[1] == expected


def test_strict_ranges_fail_in_every_output(capsys: Output) -> None:
    words = ["monitor", SPEC, "free = always(g > 0)", "--strict-ranges", "--junit", "o.xml"]
    assert main([*words, "--", "out.csv", "in.csv"]) == 3
    assert capsys.readouterr().out.endswith("\n\noutside declared ranges: out.csv\n")
    failures = [
        (case.get("classname"), case.get("name"), failure.get("type"), failure.get("message"))
        for case in ET.parse("o.xml").iter("testcase")  # noqa: S314 - our own file
        for failure in case.iter("failure")
    ]
    assert failures == [("out.csv", "p", "out of range", OUTSIDE)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x,y\n1,2\n1,2\n", ["constant over the whole trace: x (1), y (2)"]),
        ("x,y\n1,2\n1,3\n", ["constant over the whole trace: x (1)"]),
        ("x,y\n1,2\n", []),
    ],
)
def test_constant_variables_are_noted(text: str, expected: list[str], capsys: Output) -> None:
    Path("t.csv").write_text(text)
    assert notes(["always(x < y)", "t.csv"], 0, capsys) == expected
