"""Exported monitors run next to a plant, like other FMUs."""

from pathlib import Path
from typing import Any

import pytest
from bits import identical
from fmus import library, write_fmu

from rtamt import EpisodeMonitor
from rtamt.export.fmu import export_fmu
from rtamt_gym import Fmus, simulate

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

OPEN = "always(monitor.verdict >= -1 and tank.level < 99)"
"""What holds anyway, so that it ends no simulation."""

TEXT = "const float most = 3; rises = inflow > 1; safe = always(rises implies level < most)"


@pytest.fixture(scope="module", params=[2, 3])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tank and a monitor of it, both of one version of FMI."""
    fmi: Any = request.param
    folder = tmp_path_factory.mktemp(f"monitored{fmi}")
    write_fmu(folder / "tank.fmu", library(fmi, folder), fmi)
    export_fmu(TEXT, folder / "monitor.fmu", period="100ms", fmi=fmi)
    return folder


def coupled(folder: Path, **parameters: float) -> Fmus:
    """The tank with the monitor beside it, and an inflow that grows."""
    return Fmus(
        [folder / "tank.fmu", folder / "monitor.fmu"],
        inputs={
            "tank.inflow": lambda t: t,
            "monitor.inflow": lambda t: t,
            "monitor.level": "tank.level",
        },
        parameters={f"monitor.{name}": value for name, value in parameters.items()},
    )


def test_a_monitor_beside_a_plant_sees_what_the_plant_does(folder: Path) -> None:
    run = simulate(coupled(folder), OPEN, duration=6)
    episode = EpisodeMonitor(TEXT, 0.1)
    expected = [0]
    for i, level in enumerate(run.signals["tank.level"]):
        episode.update(inflow=i / 10, level=level)
        expected.append(episode.verdict)
    assert -1 in expected
    assert identical(run.signals["monitor.verdict"], expected[:-1])


def test_a_violation_ends_the_simulation_at_once(folder: Path) -> None:
    whole = simulate(coupled(folder), OPEN, duration=6)
    first = whole.signals["monitor.verdict"].tolist().index(-1)
    system = coupled(folder, stop_on_violation=1)
    ended = simulate(system, OPEN, duration=6)
    assert ended.ended == "terminated"
    assert ended.signals["monitor.verdict"].tolist() == [0] * first + [-1]


def test_a_parameter_moves_the_violation(folder: Path) -> None:
    result = []
    for most in (1.5, 2.5, 99.0):
        run = simulate(coupled(folder, most=most), OPEN, duration=6)
        result.append(run.signals["monitor.verdict"].tolist().count(-1))
    assert result[0] > result[1] > result[2] == 0
