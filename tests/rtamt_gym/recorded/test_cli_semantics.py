"""`--semantics` of the commands: what predicates count on a recorded trace and in an episode."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from command_line import write_files

import rtamt
from rtamt import SemanticsName
from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
TEXT = """\
input float req
output float gnt
granted = eventually[0:0.5](gnt >= 3)
always(req >= 3 implies granted)
"""
COLUMNS = {"req": np.array([0.0, 5.0, 0.0, 0.0]), "gnt": np.array([0.0, 0.0, 1.0, 4.0])}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a text that declares input and output, and traces."""
    monkeypatch.chdir(tmp_path)
    write_files(tmp_path)
    (tmp_path / "roles.stl").write_text(TEXT)
    return tmp_path


@pytest.mark.parametrize("semantics", ["output-robustness", "input-robustness", "output-vacuity"])
def test_every_formula_of_a_trace_is_judged_under_the_semantics(
    semantics: SemanticsName, folder: Path, capsys: Output
) -> None:
    command = ["monitor", "roles.stl", "even.csv", "--semantics", semantics, "--out", "out.csv"]
    code = main(command)
    spec = rtamt.parse(TEXT)
    expected = rtamt.evaluate(spec, COLUMNS, 0.5, semantics=semantics)
    assert code == (1 if expected[0] < 0.0 else 3 if semantics == "output-vacuity" else 0)
    assert f"robustness {expected[0] + 0.0:g}" in capsys.readouterr().out
    with (folder / "out.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["robustness"]) for row in rows] == expected.tolist()
    inner = rtamt.evaluate(
        spec.formulas["granted"],
        {"gnt": COLUMNS["gnt"]},
        0.5,
        semantics=semantics,
        inputs=(),
        outputs=("gnt",),
    )
    assert [float(row["granted"]) for row in rows] == inner.tolist()


def test_events_are_judged_under_the_semantics(capsys: Output) -> None:
    command = ["monitor", "--dense", "roles.stl", "long.csv"]
    assert main(command) == 1
    assert "VIOLATED, robustness -2, " in capsys.readouterr().out
    assert main([*command, "--semantics", "output-robustness"]) == 1
    assert "VIOLATED, robustness -3, " in capsys.readouterr().out


def test_an_explanation_is_about_the_semantics(capsys: Output) -> None:
    assert main(["explain", "roles.stl", "even.csv", "--semantics", "output-robustness"]) == 1
    assert capsys.readouterr().out.startswith("robustness -2 at 0 s, decided by gnt >= 3 at 1 s\n")


def test_episodes_are_judged_under_the_semantics(folder: Path) -> None:
    text = "output float angle; input float x; always(abs(angle) < 9 and abs(x) < 8)"
    command = ["run", "CartPole-v1", "--spec", text, "--signal", "angle=obs[2]"]
    command += ["--signal", "x=obs[0]", "--json", "out.json"]
    found = {}
    for semantics in ("standard", "output-robustness"):
        assert main([*command, "--semantics", semantics]) == 0
        (episode,) = json.loads((folder / "out.json").read_text())["trials"]
        found[semantics] = episode["outcomes"]["spec"]["robustness"]
    assert found["standard"] < 8.0 < found["output-robustness"] < 9.0


@pytest.mark.parametrize(
    ("semantics", "message"),
    [
        (
            "output-robustness",
            (
                "--semantics output-robustness is about outputs, and there are none; declare them "
                "in the text (output float gnt)"
            ),
        ),
        ("output", "argument --semantics: invalid choice: 'output' (choose from 'standard', "),
    ],
)
def test_a_semantics_that_does_not_fit_is_refused(
    semantics: str, message: str, capsys: Output
) -> None:
    assert main(["monitor", "spec.stl", "even.csv", "--semantics", semantics]) == 2
    assert capsys.readouterr().err.startswith(f"rtamt: error: {message}")
