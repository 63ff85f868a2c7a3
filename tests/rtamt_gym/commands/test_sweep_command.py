"""`rtamt sweep`: its output, its files, and errors."""

import json
import re
import shlex
from pathlib import Path
from typing import get_args

import pytest
from catalogue import entries
from fmus import library, write_fmu
from named_systems import pump

from rtamt_gym import Parameter, sweep
from rtamt_gym.__main__ import main
from rtamt_gym.results import Record, Sweep
from rtamt_gym.results.codec import trials_of
from rtamt_gym.search.sweeps.samplers import Sampler

SYSTEM = "rtamt/RequestGrant-v0"
HEAT_MAP = ["--vary", "height=2:8", "--vary", "limit=1:4", "--heat-map", "a.png", "--samples", "1"]
Output = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def lines(capsys: Output, *arguments: str) -> list[str]:
    """Return the output of the command; no line is too long."""
    assert main(["sweep", *arguments]) == 0
    out = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in out)
    return out


def test_every_sampler_can_be_named(capsys: Output) -> None:
    assert main(["sweep", "--help"]) == 0
    found = re.search(r"--sampler \{(.*?)\}", capsys.readouterr().out)
    assert found is not None
    assert sorted(found[1].split(",")) == sorted(get_args(Sampler))


def test_a_grid_prints_its_map(capsys: Output) -> None:
    arguments = [SYSTEM, "--vary", "height=2:8", "--vary", "limit=1:4"]
    assert lines(capsys, *arguments, "--sampler", "grid", "--samples", "height=3,limit=2") == [
        "granted: always[0:10s](req >= 3 implies eventually[0:5s](gnt >= 3))",
        "",
        "requirement  satisfied  violated  triggered  minimum  median  maximum",
        "granted              4         2     4 of 6       -2       1        1",
        "",
        "6 simulations, 90 simulated seconds",
        "",
        "robustness of granted over limit:",
        "height       1      4",
        "     2   1.000  1.000",
        "     5  -2.000  1.000",
        "     8  -2.000  1.000",
        "",
        "worst of granted: -2 in simulation 2: height=5, limit=1",
    ]


def test_files_are_written_and_hold_what_was_printed(capsys: Output) -> None:
    files = ["--save", "a.parquet", "--json", "a.json", "--heat-map", "a.png", "--scatter", "a.svg"]
    vary = ["--vary", "height", "--vary", "delay=1:4,log", "--set", "limit=4"]
    shown = lines(capsys, SYSTEM, *vary, "--samples", "4", "--seed", "7", *files)
    assert shown[-4:] == [
        "record: a.parquet",
        "record: a.json",
        "heat map: a.png",
        "scatter: a.svg",
    ]
    saved = Sweep.load("a.parquet")
    assert saved.record == Record.load("a.parquet")
    assert list(saved.space.entries) == ["height", "delay"]
    kept = json.loads(Path("a.json").read_text())
    assert (kept["system"], kept["sampler"], kept["seed"]) == (SYSTEM, "sobol", 7)
    assert trials_of(kept) == list(saved.record)
    for place, row in enumerate(saved.record):
        assert row.case["limit"] == 4.0
        assert row.seed == 7 + place
    assert Path("a.png").stat().st_size > 1000
    assert Path("a.svg").stat().st_size > 1000


def test_morris_prints_what_moves_a_requirement_or_why_nothing_does(capsys: Output) -> None:
    arguments = ["--sampler", "morris", "--samples", "4"]
    moved = lines(capsys, SYSTEM, "--vary", "limit=0:2", "--vary", "delay=0:1", *arguments)
    assert moved[-6:-2] == [
        "what moves granted:",
        "varied  mu*  mu* +-  mu  sigma",
        "limit     2       0   2      0",
        "delay     0       0   0      0",
    ]
    still = lines(capsys, SYSTEM, "--vary", "delay=0:1", *arguments)
    assert still[-2:] == [
        "no indices of granted: the robustness of 'granted' is 3 in every simulation:",
        "nothing moves it",
    ]


def test_requirements_are_names_formulas_and_files(capsys: Output) -> None:
    Path("low.stl").write_text("low = always(gnt < 9)")
    arguments = ["--requirement", "granted", "--requirement", "low.stl"]
    arguments += ["--requirement", "always(req < 9)", "--samples", "1"]
    shown = lines(capsys, SYSTEM, *arguments)
    assert [line.partition(":")[0] for line in shown[:3]] == ["granted", "low", "spec3"]


def test_signals_are_varied_over_time_and_other_environments_are_run(capsys: Output) -> None:
    vary = ["--vary", "request=0:8,points=2,pchip", "--duration", "4"]
    assert lines(capsys, SYSTEM, *vary, "--samples", "2")
    arguments = ["--requirement", "always(abs(angle) < 0.1)", "--signal", "angle=obs[2]"]
    arguments += ["--vary", "env.gravity=5|15", "--sampler", "grid", "--samples", "1"]
    shown = lines(capsys, "CartPole-v1", *arguments, "--policy", "zero")
    assert "env.gravity=5" in shown[-3]


def test_functions_and_fmus_are_run_as_in_python(capsys: Output, tmp_path: Path) -> None:
    low = ["--requirement", "low = always(x < 2)", "--period", "1", "--samples", "3"]
    vary = ["--vary", "inflow=0.1:0.5", "--set", "leak=0.1"]
    shown = lines(capsys, "named_systems:pump", *low, *vary, "--save", "a.parquet")
    found = sweep(
        pump,
        {"low": "always(x < 2)"},
        [Parameter("inflow", 0.1, 0.5)],
        fixed={"leak": 0.1},
        samples=3,
        period=1,
    )
    kept = Record.load("a.parquet")
    assert [row.case for row in kept] == [row.case for row in found.record]
    assert [row.outcomes for row in kept] == [row.outcomes for row in found.record]
    assert shown[0] == "low: always(x < 2)"
    assert {row.outcomes["low"].verdict.name for row in kept} == {"SATISFIED", "VIOLATED"}
    write_fmu(tmp_path / "tank.fmu", library(3, tmp_path), 3)
    vary = ["--vary", "inflow=0:3,points=2", "--duration", "2"]
    shown = lines(capsys, "tank.fmu", "--requirement", "always(level < 2)", *vary, "--samples", "2")
    assert "2 simulations, 4 simulated seconds" in shown


@pytest.mark.parametrize(("arguments", "message"), entries(Path(__file__).with_name("sweep.txt")))
def test_mistakes_are_told_before_anything_runs(
    capsys: Output, arguments: str, message: str
) -> None:
    assert main(["sweep", *shlex.split(arguments)]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", f"rtamt: error: {message}\n")


def test_the_columns_of_a_map_may_be_those_of_the_scenario(capsys: Output) -> None:
    axes = ["--heat-map", "map.png", "--x", "throttle[0]", "--y", "brakes[1]", "--samples", "1"]
    assert main(["sweep", "rtamt/ChasingCars-v0", "--requirement", "CC1", *axes]) == 2
    said = capsys.readouterr().err
    assert said.startswith("rtamt: error: unknown column 'brakes[1]'; the space has 'throttle")
    assert "'brake[1]'" in said
    assert not Path("map.png").exists()
