"""`rtamt check`: what it prints, writes and exits with."""

import json
from pathlib import Path

import pytest
from command_line import run_without

from rtamt_gym.__main__ import main

RESPONSE = "always(req >= 3 implies eventually[0:5](gnt >= 3))"


def test_a_requirement_in_which_nothing_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", RESPONSE]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:4] == [
        f"spec: {RESPONSE}",
        "  satisfied  yes, in 1 sample",
        "  violated   yes, in 8 samples",
        "  asked      yes, in 1 sample: req >= 3 implies eventually[0:5](gnt >= 3)",
    ]
    assert lines[-1] == "nothing wrong was found"
    assert "spec violated:" in lines
    assert all(len(line) <= 80 for line in lines)


def test_requirements_that_do_not_agree(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "low = always(x < 3); high = eventually(x > 5)"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "  together   no, by no trace of up to 16 samples, its end repeated" in lines
    assert "  conflict   low, high" in lines
    assert lines[-1] == "something is wrong: see above"


def test_clashes_and_idle_parts_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "a=always(x > 1 and x < 0)", "b=always[0:1](x > 1 and x > 0)"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:4] == [
        "  satisfied  no",
        "             clashes: always(x > 1) at 1:12",
        "             clashes: always(x < 0) at 1:22",
    ]
    assert "  idle       x > 0 demands nothing more" in lines


def test_what_is_unknown_is_no_pass(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "x * x >= 0"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert "  violated   unknown: it is not linear (mul)" in lines
    assert lines[-1] == "nothing wrong was found, but not all is known: see above"


def test_a_trace_is_drawn_by_its_changes(capsys: pytest.CaptureFixture[str]) -> None:
    text = "always[0:9](x > 0) and eventually[10:20](x < 0 and y == 2)"
    assert main(["check", text, "--assume", "always(y >= 1)"]) == 0
    out = capsys.readouterr().out
    assert "  sample" in out
    assert all(len(line) <= 80 for line in out.splitlines())


def test_json_has_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "a = always(x < 3); b = always(x < 2)", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["says"] == "yes"
    assert data["implied"] == {"a": "b"}
    assert data["requirements"]["a"]["falsifiable"]["trace"] == {
        "samples": 1,
        "repeats": 0,
        "columns": {"x": [3.0]},
    }
    assert data["requirements"]["a"]["idle"] == []


def test_saved_traces_are_judged_as_they_show(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "spec.stl"
    spec.write_text("slow = always(v < 3)\nmeets = eventually[0:200ms](d < 1)\n")
    folder = tmp_path / "traces"
    assert main(["check", str(spec), "--period", "100ms", "--save", str(folder)]) == 0
    names = sorted(path.name for path in folder.iterdir())
    assert names == [
        "meets-satisfied.csv",
        "meets-violated.csv",
        "slow-satisfied.csv",
        "slow-violated.csv",
        "together.csv",
    ]
    for name, code in (("slow-violated", 1), ("slow-satisfied", 0)):
        of = [str(spec), "--only", "slow", str(folder / f"{name}.csv"), "--period", "100ms"]
        assert main(["monitor", *of]) == code
    capsys.readouterr()


def test_bounds_in_time_need_a_period(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "always[0:2s](x > 0)"]) == 2
    message = capsys.readouterr().err
    assert message == (
        "rtamt: error: --period: spec has bounds with units, and nobody said how long a sample "
        "is; give --period 100ms, for instance\n"
    )


def test_requirements_are_compared(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "always(x < 3)", "--same-as", "not eventually(x > 3)"]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "spec:",
        "  one        always(x < 3)",
        "  other      not eventually(x > 3)",
        "  same       no, in 1 sample: other is satisfied, one is violated",
        "",
        "spec apart:",
        "  sample  0",
        "  x       3",
        "",
        "they differ: see above",
    ]
    assert main(["check", "always[0:3](x < 3)", "--same-as", "not eventually[0:3](x >= 3)"]) == 0
    assert capsys.readouterr().out.splitlines()[3:] == [
        "  same       yes",
        "",
        "they are the same",
    ]
    assert main(["check", "x * x >= 0", "--same-as", "x >= 0 or x < 0"]) == 3
    assert capsys.readouterr().out.splitlines()[-1] == (
        "no difference was found, but not all is known: see above"
    )


def test_what_is_compared_is_json_too(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["check", "a = x > 1; b = x > 2", "--same-as", "b = x > 3; a = not x <= 1"]
    assert main([*arguments, "--json"]) == 1
    assert json.loads(capsys.readouterr().out) == {
        "says": "no",
        "same": {
            "a": {"one": "x > 1", "other": "not (x <= 1)", "says": "yes", "samples": None},
            "b": {
                "one": "x > 2",
                "other": "x > 3",
                "says": "no",
                "satisfied": "one",
                "trace": {"samples": 1, "repeats": 0, "columns": {"x": [3.0]}},
            },
        },
    }


def test_a_requirement_without_a_namesake_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "a = x > 1; b = x > 2", "--same-as", "b = x > 3; c = x > 1"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: --same-as expected requirements of the same names, or one and one; a, c are "
        "on one side only\n"
    )


def test_places_and_ids_are_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = Path("spec.stl")
    spec.write_text(
        '@ id(near, "SYS-REQ-7")\nfloat d in [0, 9]\nnear = always(d < 5\n  and d > 20)\n'
    )
    assert main(["check", str(spec)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "near (SYS-REQ-7): always(d < 5 and d > 20)"
    assert lines[1:4] == [
        "  satisfied  no",
        "             clashes: always(d > 20) at spec.stl:4:9",
        "             clashes: declared: d in [0, 9]",
    ]
    assert main(["check", str(spec), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["requirements"]["near"]
    assert found["id"] == "SYS-REQ-7"
    assert {"text": "always(d > 20)", "place": [4, 9]} in found["satisfiable"]["clash"]


def test_without_the_solver_it_names_the_extra() -> None:
    found = run_without(["z3"], ["check", "x > 0"])
    assert found.returncode == 2
    assert "pip install '.[check]'" in found.stderr
