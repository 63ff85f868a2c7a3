"""The two forms of CSV that esmini writes, by hand: lines above the names, many objects."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
SPEEDS = np.random.default_rng(4).uniform(25, 35, (40, 2)).round(6)
NAMES = ("Ego", "Other")


@pytest.fixture
def rows(tmp_path: Path) -> Path:
    """Return a file of dat2csv."""
    lines = [
        "Version: 4, OpenDRIVE: road.xodr, 3DModel: road.osgb",
        "time, id, name, x, y, z, h, p, r, speed, wheel_angle, wheel_rot",
    ]
    for step, speeds in enumerate(SPEEDS):
        for index, (name, speed) in enumerate(zip(NAMES, speeds, strict=True)):
            cells = f"{step / 20:.3f}, {index}, {name}, 1, 2, 0, 0, 0, 0, {speed:.6f}, 0, 0"
            lines.append(cells)
    path = tmp_path / "scenario.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


@pytest.fixture
def columns(tmp_path: Path) -> Path:
    """Return a file of the logger."""
    fields = ("Entitity_Name [-]", "Entitity_ID [-]", "Current_Speed [m/s]")
    header = ["Index [-]", "TimeStamp [s]"]
    header += [f"#{index} {field}" for index in (1, 2) for field in fields]
    lines = ["esmini GIT REV: v2.40", "Scenario File Name: cut-in.xosc", "Number of Vehicles: 2"]
    lines.append(" , ".join([*header, ""]))
    for step, (ego, other) in enumerate(SPEEDS):
        lines.append(f"{step}, {step / 20:.6f}, Ego, 0, {ego:.6f}, Other, 1, {other:.6f}, ")
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


@pytest.mark.parametrize("name", NAMES)
def test_object_of_rows(name: str, rows: Path, capsys: Output) -> None:
    frame = pd.read_csv(rows, skiprows=1, skipinitialspace=True)
    least = 31 - frame[(frame.name == name) & (frame.time <= 1)].speed.max()
    command = ["monitor", "always[0:1](speed < 31)", str(rows), "--where", f"name={name}"]
    assert main(command) == (1 if least < 0 else 0)
    printed = capsys.readouterr().out
    assert f"robustness {least:.6g}" in printed
    assert "line 1 is skipped" in printed


def test_rows_without_a_choice_are_refused(rows: Path, capsys: Output) -> None:
    assert main(["monitor", "always(speed < 31)", str(rows)]) == 2
    assert "got 2 values of 'id', which no requirement reads" in capsys.readouterr().err


def test_two_objects_of_columns(columns: Path, capsys: Output) -> None:
    least = 5 - (SPEEDS[:21, 1] - SPEEDS[:21, 0]).max()
    names = {"ego": "#1 Current_Speed [m/s]", "other": "#2 Current_Speed [m/s]"}
    signals = [f"--signal={name}={column}" for name, column in names.items()]
    command = ["monitor", "always[0:1](other - ego < 5)", str(columns), *signals]
    assert main(command) == (1 if least < 0 else 0)
    printed = capsys.readouterr().out
    assert f"robustness {least:.6g}" in printed
    assert "40 samples, one every 0.05 s" in printed
    assert "lines 1 to 3 are skipped: the names of the columns are in line 4" in printed
