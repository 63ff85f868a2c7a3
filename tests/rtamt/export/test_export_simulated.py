"""Exported monitors in the simulation of FMPy, and next to a plant in a loop of steps."""

from collections.abc import Sequence
from pathlib import Path

import fmpy  # type: ignore[import-untyped]
import numpy as np
import pytest
from bits import identical
from exported import Unit, exported
from fmpy import simulate_fmu
from fmus import library, write_fmu
from numpy.typing import NDArray

import rtamt
from rtamt import EpisodeMonitor, Monitor, Verdict, judge, parse
from rtamt.export.fmu import Fmi, export_fmu

TEXT = """
const float limit = 4
fast = abs(x) > limit
always(fast implies eventually[0:1](y > 0)) and always(abs(x) < 7)
"""
OUTPUTS = ("robustness", "lower", "upper", "verdict", "fast")


def signals(n: int) -> NDArray[np.void]:
    """Return random samples of x and y, 250 ms apart."""
    rng = np.random.default_rng(n)
    kinds = [(name, np.float64) for name in ("time", "x", "y")]
    rows = [(i / 4, *rng.integers(-24, 24, 2) / 4) for i in range(n)]
    return np.array(rows, dtype=kinds)


def rows_of(text: str, samples: NDArray[np.void]) -> list[list[float]]:
    """Return the outputs after each sample; the first row is a new monitor."""
    episode = EpisodeMonitor(text, "250ms", backend="python")
    fast = Monitor(parse(text).formulas["fast"], backend="python")
    rows = [[episode.robustness, *episode.bounds(), float(episode.verdict), np.nan]]
    for _, x, y in samples:
        robustness = episode.update(x=x, y=y)
        rows.append([robustness, *episode.bounds(), float(episode.verdict), fast.update(x=x)])
    return rows


def table(result: NDArray[np.void]) -> list[list[float]]:
    return [[float(row[name]) for name in OUTPUTS] for row in result]


def same(x: Sequence[Sequence[float]], y: Sequence[Sequence[float]]) -> bool:
    return len(x) == len(y) and all(identical(a, b) for a, b in zip(x, y, strict=True))


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("limit", [4.0, 2.5])
def test_fmpy_simulates_the_episode_monitor(tmp_path: Path, fmi: Fmi, limit: float) -> None:
    path, samples = tmp_path / "monitor.fmu", signals(60)
    export_fmu(TEXT, path, period="250ms", fmi=fmi)
    simulated = simulate_fmu(
        path,
        input=samples,
        start_values={"limit": limit},
        stop_time=15,
        output=OUTPUTS,
    )
    expected = rows_of(TEXT.replace("= 4", f"= {limit}"), samples)
    assert same(table(simulated), expected)
    assert {row[3] for row in expected} == {0, -1}


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("pulse", [1, 29, 57, 113, 150, 199])
def test_pulse_of_one_sample_is_seen(tmp_path: Path, fmi: Fmi, pulse: int) -> None:
    kinds = [("time", np.float64), ("x", np.float64)]
    rows = [(float(f"{k * 0.01:.2f}"), float(k == pulse)) for k in range(201)]
    export_fmu("always(x < 1)", tmp_path / "monitor.fmu", period="10ms", fmi=fmi)
    simulated = simulate_fmu(
        tmp_path / "monitor.fmu",
        input=np.array(rows, dtype=kinds),
        stop_time=2.01,
        step_size=0.01,
        output=("verdict", "robustness"),
    )
    values = {"x": [x for _, x in rows]}
    judgement = judge("always(x < 1)", values, period="10ms")
    assert judgement.verdict is Verdict.VIOLATED
    assert simulated["verdict"][-1] == -1
    assert identical([float(simulated["robustness"][-1])], [judgement.robustness])


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    "text", ["always(x < 1)", "always(x > 0 implies eventually[0:0.02](y > 0))"]
)
@pytest.mark.parametrize("seed", range(4))
def test_dense_monitor_sees_events_between_steps(
    tmp_path: Path, fmi: Fmi, text: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    instants = np.sort(rng.permutation(989)[:40] + 1)
    times = [0.0, *(float(f"{k / 1000:.3f}") for k in instants)]
    rows = [(t, *(rng.random(2) < (0.03, 0.5)).astype(float)) for t in times]
    rows.append((0.99, 0.0, 1.0 - rows[-1][2]))
    export_fmu(text, tmp_path / "monitor.fmu", dense=True, fmi=fmi)
    outputs = ("robustness", "lower", "upper", "verdict")
    simulated = simulate_fmu(
        tmp_path / "monitor.fmu",
        input=np.array(rows, dtype=[(name, np.float64) for name in ("time", "x", "y")]),
        stop_time=1.0,
        output_interval=0.1,
        output=outputs,
    )
    monitor = rtamt.dense.EpisodeMonitor(text)
    for t, x, y in rows:
        values = {"x": x, "y": y}
        monitor.update({name: [(t, values[name])] for name in monitor.variables})
    expected = [monitor.robustness, monitor.lower, monitor.upper, float(monitor.verdict)]
    assert identical([float(simulated[name][-1]) for name in outputs], expected)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("stops", ["by default", "by parameter", "not"])
def test_the_first_certain_violation_ends_the_simulation(
    tmp_path: Path, fmi: Fmi, stops: str
) -> None:
    path, samples = tmp_path / "monitor.fmu", signals(60)
    export_fmu(TEXT, path, period="250ms", fmi=fmi, stop_on_violation=stops == "by default")
    starts = {"stop_on_violation": True} if stops == "by parameter" else {}
    simulated = simulate_fmu(path, input=samples, start_values=starts, stop_time=15, output=OUTPUTS)
    expected = rows_of(TEXT, samples)
    violated = [row[3] for row in expected].index(-1)
    assert 1 < violated < 50
    assert same(table(simulated), expected if stops == "not" else expected[: violated + 1])


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_monitor_beside_a_plant_sees_every_sample(tmp_path: Path, fmi: Fmi) -> None:
    text = "const float most = 3; rises = inflow > 1; always(rises implies level < most)"
    tank = write_fmu(tmp_path / "tank.fmu", library(fmi, tmp_path), fmi)
    plant = Unit(tank, Path(fmpy.extract(tank, tmp_path / "tank")))
    episode = EpisodeMonitor(text, 0.1, backend="python")
    rises = Monitor("inflow > 1", backend="python")
    with exported(text, fmi, period=0.1) as monitor:
        plant.begin()
        monitor.begin()
        verdicts = []
        for i in range(60):
            inputs = {"inflow": i / 10, "level": plant.get("level")[0]}
            monitor.step(i * 0.1, 0.1, inputs)
            plant.step(i * 0.1, 0.1, {"inflow": i / 10})
            robustness = episode.update(inputs)
            expected = [robustness, *episode.bounds(), episode.verdict, rises.update(i / 10)]
            simulated = monitor.get("robustness", "lower", "upper", "verdict", "rises")
            assert identical(simulated, expected)
            verdicts.append(int(episode.verdict))
        assert set(verdicts) == {0, -1}
    plant.fmu.freeInstance()
