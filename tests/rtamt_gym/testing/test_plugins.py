"""Other packages add trace formats and optimizers by entry points."""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rtamt import InputError
from rtamt_gym.checks.extras import plugins
from rtamt_gym.recorded.readers import formats
from rtamt_gym.search.falsification.optimizers import optimizers

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
    """Install a package with entry points into a folder."""
    (folder / "plant_tools.py").write_text(PACKAGE)
    about = folder / "plant_tools-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: plant-tools\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(entries)


@contextmanager
def found_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Simulate that the packages of a folder are installed."""
    monkeypatch.syspath_prepend(folder)
    plugins.cache_clear()
    try:
        yield
    finally:
        plugins.cache_clear()
        sys.modules.pop("plant_tools", None)


def rtamt(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"}
    command = [sys.executable, "-m", "rtamt_gym", *arguments]
    return subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)


def test_plugins_are_found(tmp_path: Path) -> None:
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
    result = rtamt(tmp_path, "falsify", system, "--optimizer", "darts", "--budget", "2")
    assert "optimizer darts" in result.stdout
    assert result.stderr == ""


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


FORMATS, OPTIMIZERS = "rtamt.trace_formats", "rtamt.optimizers"


@pytest.mark.parametrize(
    ("group", "table", "entries", "message"),
    [
        (
            FORMATS,
            formats,
            "words = plant_tools:FORMAT\nother = plant_tools:FORMAT\n",
            (
                f"the entry point 'other' of {FORMATS} takes .words, which words has; give it "
                "another extension"
            ),
        ),
        (
            OPTIMIZERS,
            optimizers,
            "cma = plant_tools:darts\n",
            (
                f"expected a function with a name of its own as the entry point 'cma' of "
                f"{OPTIMIZERS}, got <function darts"
            ),
        ),
        (
            OPTIMIZERS,
            optimizers,
            "darts = plant_tools:FORMAT\n",
            (
                f"expected a function with a name of its own as the entry point 'darts' of "
                f"{OPTIMIZERS}, got Format("
            ),
        ),
    ],
)
def test_plugin_errors(
    group: str,
    table: Callable[[], object],
    entries: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    added(tmp_path, f"[{group}]\n{entries}")
    with found_in(tmp_path, monkeypatch), pytest.raises(InputError) as caught:
        table()
    assert str(caught.value).startswith(message)


def test_two_packages_do_not_add_one_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    added(tmp_path, f"[{OPTIMIZERS}]\ndarts = plant_tools:darts\n")
    other = tmp_path / "dart_board-2.0.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: dart-board\nVersion: 2.0\n")
    (other / "entry_points.txt").write_text(f"[{OPTIMIZERS}]\ndarts = plant_tools:darts\n")
    with found_in(tmp_path, monkeypatch), pytest.raises(InputError) as caught:
        optimizers()
    assert re.fullmatch(
        r"expected one 'darts' among the entry points rtamt.optimizers, "
        r"got a second from (plant-tools|dart-board); uninstall one package",
        str(caught.value),
    )
