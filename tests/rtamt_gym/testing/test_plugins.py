"""Other packages add formats of traces and optimizers by entry points."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = '''
from contextlib import contextmanager
from pathlib import Path
import numpy as np
from rtamt_gym.recorded.arrays import ArrayRecording
from rtamt_gym.recorded.readers import Format

FORMAT = Format("words", (".words",), "plant_tools")

@contextmanager
def open_file(path, columns):
    name, *numbers = Path(path).read_text().split()
    yield ArrayRecording(path, {name: np.array(numbers, float)})

def darts(evaluate, dimension, rng):
    """Points that nobody aims."""
    while True:
        evaluate(rng.random((4, dimension)))
'''


def added(folder: Path, entries: str) -> None:
    """Installs a package with entry points into a folder."""
    (folder / "plant_tools.py").write_text(PACKAGE)
    about = folder / "plant_tools-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: plant-tools\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(entries)


def rtamt(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"}
    command = [sys.executable, "-m", "rtamt_gym", *arguments]
    return subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)


def test_a_format_and_an_optimizer_of_another_package_are_there(tmp_path: Path) -> None:
    added(
        tmp_path,
        "[rtamt.trace_formats]\nwords = plant_tools:FORMAT\n"
        "[rtamt.optimizers]\ndarts = plant_tools:darts\n",
    )
    (tmp_path / "speed.words").write_text("speed 1 2 31")
    judged = rtamt(tmp_path, "monitor", "always(speed < 30)", "speed.words")
    assert (judged.returncode, judged.stderr) == (1, "")
    said = rtamt(tmp_path, "falsify", "--help").stdout
    assert "darts: Points that nobody aims" in " ".join(said.split())
    system = "rtamt/RequestGrant-v0"
    found = rtamt(tmp_path, "falsify", system, "--optimizer", "darts", "--budget", "2")
    assert "optimizer darts" in found.stdout
    assert found.stderr == ""


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ("[rtamt.trace_formats]\nwords = plant_tools:ABSENT\n", "plant-tools adds to"),
        ("[rtamt.trace_formats]\nwords = plant_tools:darts\n", "expected a Format"),
    ],
)
def test_an_entry_that_is_wrong_is_named(tmp_path: Path, entries: str, words: str) -> None:
    added(tmp_path, entries)
    (tmp_path / "speed.csv").write_text("speed\n1\n")
    judged = rtamt(tmp_path, "monitor", "always(speed < 30)", "speed.csv")
    assert judged.returncode == 2
    assert words in judged.stderr
    assert "Traceback" not in judged.stderr
