"""Times and periods whose unit is in doubt: errors and notes name the reading that fits."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
RESPONSE = "always(req > 0.5 implies eventually[0:0.2](gnt > 0.5))"
SLOWS = "always(speed > 30 implies eventually[0:0.2](speed < 30))"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = ["0,1,0", "100,0,", "200,0,", "300,0,", "400,0,1", "500,0,0", "600,0,0"]
    Path("late.csv").write_text("\n".join(["time,req,gnt", *rows]))
    Path("ms.csv").write_text("time,speed\n0,20\n100,40\n200,20\n300,20\n")
    Path("half.csv").write_text("time,speed\n0,20\n0.5,40\n1,20\n1.5,20\n")


@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_bounds_need_times(command: str, capsys: Output) -> None:
    words = [command, RESPONSE, "late.csv", "--time-unit", "ms", "--missing", "drop"]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "expected samples at even distances" in error
    assert "--period" not in error
    assert main([*words, "--jitter", "5%"]) == 1
    assert main([*words, "--dense"]) == 1
    capsys.readouterr()
    Path("uneven.csv").write_text("time,req\n0,1\n1,1\n5,1\n6,1\n7,1\n")
    assert main([command, "always(req < 2)", "uneven.csv"]) == 2
    assert "or --period to leave the column 'time' aside" in capsys.readouterr().err


def test_dropped_rows_keep_the_note_on_times(capsys: Output) -> None:
    assert main(["monitor", RESPONSE, "late.csv", "--missing", "drop", "--period", "100ms"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "--period leaves the column 'time' aside, which has the rows 100 s apart" in shown
    assert "400 s after late.csv, line 2: 600 s in all, not 0.3 s" in shown
    assert "longest gap" not in shown


@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_bound_without_unit_error(command: str, capsys: Output) -> None:
    assert main([command, SLOWS, "ms.csv"]) == 2
    error = capsys.readouterr().err
    assert "bound 0.2 s is not a multiple of the period 100 s" in error
    assert "if these are milliseconds, --time-unit ms; if seconds, --time-unit s" in error
    assert "--align" not in error
    assert main([command, SLOWS, "ms.csv", "--time-unit", "ms"]) == 0
    assert main([command, SLOWS, "ms.csv", "--time-unit", "s"]) == 2
    assert "let --align round it" in capsys.readouterr().err


@pytest.mark.parametrize(("period", "meant"), [("500", "500ms"), ("500000", "500000us")])
def test_period_in_other_unit(period: str, meant: str, capsys: Output) -> None:
    question = f"--period without a unit is in seconds; did you mean --period {meant}?"
    spec = SLOWS.replace("0.2", "0.5")
    assert main(["monitor", spec, "half.csv", "--period", period]) == 2
    assert f"hint: {question}" in capsys.readouterr().err
    assert main(["monitor", "always(speed < 50)", "half.csv", "--period", period]) == 0
    assert question in " ".join(capsys.readouterr().out.split())
    assert main(["monitor", spec, "half.csv", "--period", meant]) == 0
    assert "did you mean" not in capsys.readouterr().out
