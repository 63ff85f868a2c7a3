"""`rtamt check`: its output, its files and its exit codes."""

import json
import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from command_line import run_without

from rtamt.checking.answers import ExampleTrace
from rtamt_gym.__main__ import main
from rtamt_gym.commands.example_traces import draw_traces

RESPONSE = "always(req >= 3 implies eventually[0:5](gnt >= 3))"


def test_a_requirement_in_which_nothing_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", RESPONSE]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:4] == [
        f"spec: {RESPONSE}",
        "  satisfied  yes, in 1 sample",
        "  violated   yes, in 8 samples",
        "  triggered  yes, in 1 sample: req >= 3 implies eventually[0:5](gnt >= 3)",
    ]
    assert lines[-1] == "no problems found"
    assert "spec violated:" in lines
    assert all(len(line) <= 80 for line in lines)


def test_requirements_that_do_not_agree(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "low = always(x < 3); high = eventually(x > 5)"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "  together   no, by no trace of up to 16 samples, its end repeated" in lines
    assert "  conflict   low, high" in lines
    assert lines[-1] == "problems found: see above"


def test_clashes_and_idle_parts_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "a=always(x > 1 and x < 0)", "b=always[0:1](x > 1 and x > 0)"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:4] == [
        "  satisfied  no",
        "             clashes: always(x > 1) at 1:12",
        "             clashes: always(x < 0) at 1:22",
    ]
    assert "  redundant  x > 0 demands nothing more" in lines


def test_what_is_unknown_is_no_pass(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "x * x >= 0"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert "  violated   unknown: it is not linear (mul)" in lines
    assert lines[-1] == "no problems found, but some answers are unknown: see above"


def test_parts_of_which_nothing_is_known_are_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "a = y * y >= 1", "b = x * x * y > 3 and y * y >= 0"]) == 3
    out = " ".join(capsys.readouterr().out.split())
    assert "parts unknown whether y * y >= 0 decides something: it is not linear (mul)" in out
    assert "unknown whether a or b implies the other: it is not linear (mul)" in out
    assert "no problems found, but some answers are unknown: see above" in out


def test_what_requirements_say_of_each_other_is_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    texts = [
        "a = always[0:5](x > 0 implies y > 0)",
        "b = always[0:5](x <= 0)",
        "c = always[0:5](x <= 1)",
        "d = always[0:5](not (x > 0))",
    ]
    assert main(["check", *texts]) == 1
    out = capsys.readouterr().out
    assert (
        """\
  together   yes, in 6 samples
  triggered  a, where all are satisfied: no: x > 0 implies y > 0
  implied    a by b
  implied    c by b
  equal      b and d
"""
        in out
    )


@pytest.mark.parametrize(
    ("options", "drawn"),
    [
        (["eventually[0:2](false)"], "spec violated:\n  any 1 sample\n"),
        (
            ["always(eventually(x > 0))", "--end", "open"],
            "  x         0\n  the last 1 sample again and again\n",
        ),
    ],
)
def test_a_trace_may_have_no_variables_and_no_end(
    options: list[str], drawn: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["check", *options])
    assert drawn in capsys.readouterr().out


def test_a_trace_is_drawn_by_its_changes(capsys: pytest.CaptureFixture[str]) -> None:
    text = "always[0:9](x > 0) and eventually[10:20](x < 0 and y == 2)"
    assert main(["check", text, "--assume", "always(y >= 1)"]) == 0
    out = capsys.readouterr().out
    assert "  sample" in out
    assert all(len(line) <= 80 for line in out.splitlines())


def test_json_has_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "a = always(x < 3); b = always(x < 2)", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    head = {name: data[name] for name in ("format", "version", "kind", "period", "end", "horizon")}
    assert head == {
        "format": "rtamt result",
        "version": 2,
        "kind": "check",
        "period": None,
        "end": "cut",
        "horizon": 10_000,
    }
    assert data["requirements"] == {"a": "always(x < 3)", "b": "always(x < 2)"}
    assert data["says"] == "yes"
    assert data["implied"] == {"a": "b"}
    assert data["results"]["a"]["falsifiable"]["trace"] == {
        "samples": 1,
        "repeats": 0,
        "columns": {"x": [3.0]},
    }
    assert data["results"]["a"]["idle"] == []


def test_a_report_of_answers_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "x > 1", "--json"]) == 0
    path = tmp_path / "check.json"
    path.write_text(capsys.readouterr().out)
    assert main(["report", str(path), "-o", str(tmp_path / "page.html")]) == 2
    said = capsys.readouterr().err
    assert f"{path} holds no result but a result of kind 'check': expected a file that" in said


def test_rates_are_read_and_named(capsys: pytest.CaptureFixture[str]) -> None:
    text = "x < 1 and eventually[0:200ms](x > 5)"
    rate = ["--period", "100ms", "--rate", "x in [-inf, 2]"]
    assert main(["check", text, *rate]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "             clashes: rate: x in [-inf, 2] per second" in lines
    assert main(["check", text, *rate, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["rates"] == {"x": ["-inf", 2.0]}


@pytest.mark.parametrize(
    ("rates", "message"),
    [
        (
            ["x < 2"],
            (
                "--rate: expected a variable and the range of its change, such as 'x in [-2, 2]', "
                "got 'x < 2'"
            ),
        ),
        (
            ["x in [-2, fast]"],
            (
                "--rate: expected a variable and the range of its change, such as 'x in [-2, 2]', "
                "got 'x in [-2, fast]'"
            ),
        ),
        (["x in [0, 1]", "x in [0, 2]"], "--rate: 'x' has two rates; give one rate"),
        (
            ["y in [0, 1]"],
            "--rate expected variables of the specification, which are x, got 'y'",
        ),
        (
            ["x in [2, 1]"],
            "--rate 'x': expected (lower, upper) with lower <= upper, got (2.0, 1.0)",
        ),
    ],
)
def test_wrong_rates_are_errors(
    rates: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [part for rate in rates for part in ("--rate", rate)]
    assert main(["check", "x > 1", *options]) == 2
    assert capsys.readouterr().err == f"rtamt: error: {message}\n"


def test_traces_are_drawn_in_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "traces.svg"
    text = "always(x > 3 implies eventually[0:3](y > 1))"
    assert main(["check", text, "--plot", str(path)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"picture: {path}"
    assert path.read_text().startswith("<?xml")
    assert main(["check", "x > 1", "--same-as", "x > 1", "--plot", str(tmp_path / "none.png")]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == f"no picture: there is no trace to draw in {tmp_path / 'none.png'}"
    assert not (tmp_path / "none.png").exists()
    assert main(["check", text, "--plot", "traces.txt"]) == 2
    assert "expected a name that ends in .png, .svg or .pdf" in capsys.readouterr().err


def test_a_picture_has_a_point_for_each_change_and_shades_what_repeats() -> None:
    named: list[tuple[str, ExampleTrace]] = [
        ("moving", ExampleTrace({"x": (1.0, 1.0, 3.0, 3.0, 2.0)}, 5, 2)),
        ("infinite", ExampleTrace({"x": (math.inf, 0.0)}, 2, 0)),
        ("empty", ExampleTrace({}, 3, 0)),
    ]
    figure = draw_traces(named, Fraction(1, 2))
    moving, infinite, empty = (part.axes[0] for part in figure.subfigs)
    (line,) = moving.lines
    assert np.asarray(line.get_xdata()).tolist() == [0.0, 1.0, 2.0, 2.5]
    assert np.asarray(line.get_ydata()).tolist() == [1.0, 3.0, 2.0, 2.0]
    (shade,) = moving.patches
    assert shade.get_extents().transformed(moving.transData.inverted()).intervalx == pytest.approx(
        [1.5, 2.5]
    )
    assert moving.get_xlabel() == "time in s; shaded: again and again"
    assert np.asarray(infinite.lines[0].get_ydata()).tolist() == [1.0, 0.0, 0.0]  # at the edge
    assert infinite.get_xlabel() == "time in s"
    assert not infinite.patches
    assert ([text.get_text() for text in empty.texts], empty.axison) == (["any 3 samples"], False)


def test_a_picture_has_twelve_traces() -> None:
    trace = ExampleTrace({"x": (1.0,)}, 1, 0)
    for count, title in ((12, ""), (13, "12 of 13 traces")):
        figure = draw_traces([(str(i), trace) for i in range(count)], None)
        assert len(figure.subfigs) == 12
        assert figure.get_suptitle() == title
        assert figure.subfigs[0].axes[0].get_xlabel() == "samples"


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
        "rtamt: error: --period: spec has bounds with units, and the period of the samples is "
        "unknown; give it, such as --period 100ms\n"
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
        "no difference found, but some answers are unknown: see above"
    )


def test_what_is_compared_is_json_too(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["check", "a = x > 1; b = x > 2", "--same-as", "b = x > 3; a = not x <= 1"]
    assert main([*arguments, "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert {name: found[name] for name in ("kind", "requirements", "says", "results")} == {
        "kind": "equivalence",
        "requirements": {"a": "x > 1", "b": "x > 2"},
        "says": "no",
        "results": {
            "a": {"other": "not (x <= 1)", "says": "yes", "samples": None},
            "b": {
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
    found = json.loads(capsys.readouterr().out)
    assert found["ids"]["near"]["id"] == "SYS-REQ-7"
    clash = found["results"]["near"]["satisfiable"]["clash"]
    assert {"text": "always(d > 20)", "place": [4, 9]} in clash


def test_without_the_solver_it_names_the_extra() -> None:
    found = run_without(["z3"], ["check", "x > 0"])
    assert found.returncode == 2
    assert "pip install '.[check]'" in found.stderr
