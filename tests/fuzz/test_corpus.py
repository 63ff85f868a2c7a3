"""Every input of the corpora is replayed, and every allocation of a unit fails once."""

from __future__ import annotations

import os
import subprocess
import sysconfig
from pathlib import Path

import pytest
from fuzz_targets import TARGETS
from fuzz_units import FOLDER, TEXTS, programs
from paths import ROOT, exclusive

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

HERE = Path(__file__).parent
BUILD = ROOT / "build" / "replay"


@pytest.mark.parametrize("name", TARGETS)
def test_inputs_of_python_targets_break_nothing(name: str, subtests: pytest.Subtests) -> None:
    paths = sorted((HERE / "corpus" / name).iterdir())
    assert paths
    for path in paths:
        with subtests.test(path.name):
            TARGETS[name](path.read_bytes())


@pytest.mark.parametrize("name", TEXTS)
def test_units_of_the_fuzzers_are_what_is_exported(name: str) -> None:
    held = (FOLDER / name / "program.rtamt").read_text()
    assert held == programs(name).text(token="{token}", stop=False)  # noqa: S106


@pytest.fixture(scope="module")
def replayers() -> Path:
    """Return the C++ programs, built with sanitizers."""
    search = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    environment = os.environ | {"PATH": search}
    source = str(HERE / "native")
    with exclusive(BUILD):
        for command in (
            ["cmake", "-S", source, "-B", str(BUILD), "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Debug"],
            ["cmake", "--build", str(BUILD)],
        ):
            done = subprocess.run(
                command, env=environment, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stdout + done.stderr
    return BUILD


@pytest.mark.slow
@pytest.mark.parametrize("name", ["program_file", "unit_calls"])
def test_inputs_of_native_targets_break_nothing(replayers: Path, name: str) -> None:
    inputs = sorted((HERE / "corpus" / name).iterdir())
    done = subprocess.run([replayers / name, *inputs], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, f"{len(inputs)}\n"), done.stderr
    assert inputs


@pytest.mark.slow
def test_every_failing_allocation_of_a_unit_is_an_error_of_fmi(replayers: Path) -> None:
    done = subprocess.run([replayers / "allocations"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 1_000  # of both interfaces and all units together
