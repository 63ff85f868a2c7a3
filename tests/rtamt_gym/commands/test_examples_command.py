"""`rtamt examples`: its output, its files and its exit codes."""

import json
from pathlib import Path

import pytest
from command_line import run_without

from rtamt_gym.__main__ import main

RESPONSE = "always(req >= 3 implies eventually[0:5](gnt >= 3))"


def test_examples_are_tables_with_a_reason(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["examples", RESPONSE]) == 0
    out = capsys.readouterr().out
    assert out.startswith(
        f"spec: {RESPONSE}\n\n1 satisfied, robustness 1: triggered and answered\n"
    )
    last = """\
4 satisfied, robustness 1: gnt >= 3 comes at the last moment of eventually[0:5]
  sample  0  1-4  5
  req     4    0  0
  gnt     0    0  4
"""
    assert last in out
    assert all(len(line) <= 80 for line in out.splitlines())


def test_no_more_than_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["examples", RESPONSE, "--count", "3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line[0] for line in lines if line[:1].isdigit()] == ["1", "2", "3"]


def test_saved_examples_are_judged_alike_by_monitor(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["examples", RESPONSE, "--save", str(tmp_path), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["format"], data["kind"], data["period"]) == ("rtamt result", "examples", None)
    assert data["requirements"] == {"spec": RESPONSE}
    shown = data["results"]["spec"]["examples"]
    names = sorted(path.name for path in tmp_path.iterdir())
    assert len(names) == len(shown)
    assert names[3] == "spec-04-satisfied-last_moment.csv"
    traces = [str(tmp_path / name) for name in names]
    assert main(["monitor", RESPONSE, "--period", "1", "--json", "--", *traces]) == 1
    rows = json.loads(capsys.readouterr().out)["trials"]
    said = [row["outcomes"]["spec"]["verdict"] for row in rows]
    assert said == [each["verdict"] for each in shown]
    assert [row["outcomes"]["spec"]["robustness"] for row in rows] == [
        each["robustness"] for each in shown
    ]


def test_what_no_trace_satisfies_or_violates(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["examples", "always(x > 1 and x < 0)"]) == 1
    out = capsys.readouterr().out
    assert "no trace satisfies it: rtamt check shows why" in out
    assert main(["examples", "always[0:1](x > 1 implies x > 0)"]) == 1
    out = capsys.readouterr().out
    assert "no trace violates it: rtamt check shows why" in out
    assert "satisfied, robustness" in out


def test_what_is_unknown_is_no_pass(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["examples", "x * x >= 0"]) == 3
    out = capsys.readouterr().out
    assert "not known whether a trace violates it: it is not linear (mul)" in out


def test_an_answer_that_is_missing_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    text = "always((x > 1 and x < 0) implies y > 0) and eventually(y < 0)"
    assert main(["examples", text]) == 0
    assert "no trace shows it: triggered and answered" in capsys.readouterr().out


def test_what_nobody_knows_and_the_next_requirement_are_said(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["examples", "a = x > 0 and y * y >= 0", "b = eventually[0:2](true)"]) == 1
    out = capsys.readouterr().out
    assert (
        """
not known whether there is one: broken by y * y >= 0 alone (it is not linear
  (mul))
not known whether there is one: y * y >= 0 just fails (it is not linear (mul))

b: eventually[0:2] true
no trace violates it: rtamt check shows why

1 satisfied, robustness inf: a trace that satisfies it
  any 3 samples
"""
        in out
    )


def test_bounds_with_units_need_a_period(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["examples", "eventually[0:1s](x > 1)"]) == 2
    assert "--period" in capsys.readouterr().err
    assert main(["examples", "eventually[0:1s](x > 1)", "--period", "500ms"]) == 0


def test_without_the_solver_it_names_the_extra() -> None:
    done = run_without(["z3"], ["examples", "x > 0"])
    assert done.returncode == 2
    assert "pip install '.[check]'" in done.stderr
