"""Columns that a specification names with ``@ column``, in the commands that read traces."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
SPEC = """\
@ column(level, "Level [mm]")
@ column(flow, "Flow")
high = always(level < 5)
low = always(flow > 0)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.stl").write_text(SPEC)
    (tmp_path / "tank.csv").write_text("time,Level [mm],Flow,level\n0,1,1,0\n1,9,2,0\n2,1,3,0\n")
    return tmp_path


@pytest.mark.parametrize("words", [[], ["--dense"]])
def test_monitor_reads_the_named_columns(words: list[str], capsys: Output) -> None:
    assert main(["monitor", "tank.stl", "tank.csv", "--json", *words]) == 1
    found = json.loads(capsys.readouterr().out)
    outcomes = found["trials"][0]["outcomes"]
    assert (outcomes["high"]["robustness"], outcomes["low"]["robustness"]) == (-4, 1)
    assert found["reading"]["columns"]["signals"] == {"level": "Level [mm]", "flow": "Flow"}


def test_signal_overrides_an_annotation() -> None:
    assert main(["monitor", "tank.stl", "tank.csv"]) == 1
    assert main(["monitor", "tank.stl", "tank.csv", "--signal", "level=level"]) == 0


def test_explain_reads_the_named_columns(capsys: Output) -> None:
    assert main(["explain", "tank.stl", "tank.csv", "--only", "high"]) == 1
    assert "robustness -4 at 0 s" in capsys.readouterr().out


def test_unselected_requirements_need_no_column(folder: Path, capsys: Output) -> None:
    (folder / "short.csv").write_text("time,Level [mm]\n0,1\n1,2\n")
    assert main(["monitor", "tank.stl", "short.csv", "--only", "high"]) == 0
    assert main(["monitor", "tank.stl", "short.csv"]) == 2
    assert "Flow" in capsys.readouterr().err


def test_signal_of_an_unselected_requirement_is_ignored(capsys: Output) -> None:
    words = ["monitor", "tank.stl", "tank.csv", "--only", "high"]
    assert main([*words, "--signal", "flow=Nowhere"]) == 1
    assert main([*words, "--signal", "height=Nowhere"]) == 2
    assert "no specification reads 'height'" in capsys.readouterr().err


def test_two_columns_of_one_variable_are_refused(folder: Path, capsys: Output) -> None:
    (folder / "other.stl").write_text('@ column(level, "level")\nother = always(level < 5)')
    words = ["monitor", "tank.stl", "other.stl", "--", "tank.csv"]
    assert main(words) == 2
    assert (
        "two specifications name different columns of 'level', 'Level [mm]' and 'level'. "
        "Give --signal level=COLUMN, or rename one variable."
    ) in capsys.readouterr().err
    assert main([*words, "--signal", "level=level"]) == 0


def test_report_page_reads_the_trace_again(folder: Path, capsys: Output) -> None:
    main(["monitor", "tank.stl", "tank.csv", "--json"])
    (folder / "outcomes.json").write_text(capsys.readouterr().out)
    assert main(["report", "outcomes.json", "-o", "page.html"]) == 0
    assert "is not shown in full" not in (folder / "page.html").read_text()


def test_stored_outcomes_depend_on_the_named_columns(folder: Path, capsys: Output) -> None:
    words = ["monitor", "tank.stl", "--results", "kept", "--", "tank.csv"]
    assert main(words) == 1
    (folder / "tank.stl").write_text(SPEC.replace("Level [mm]", "level"))
    assert main(words) != 1  # judged again, or refused, and not the outcome of before
    capsys.readouterr()


def test_clips_keep_the_named_columns(folder: Path) -> None:
    assert main(["monitor", "tank.stl", "tank.csv", "--clip", "clips", "--clip-around", "1s"]) == 1
    (clip,) = (folder / "clips").iterdir()
    assert clip.read_text() == (folder / "tank.csv").read_text()
