"""Robustness 0 in runs, in loops of MuJoCo, on recorded traces: tables, pictures and exit codes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

import rtamt
from rtamt_gym import StepMonitor, simulate
from rtamt_gym.__main__ import main
from rtamt_gym.play.run import draw
from rtamt_gym.play.summaries import run_table, runs_json
from rtamt_gym.results import Run

Output = pytest.CaptureFixture[str]
GEARS = [{"gear": 1.0, "x": x} for x in (2.0, 1.0, 0.0, 1.0)]
SPECS = {"kept": "always(gear == 1)", "above": "always(x > 0)", "reached": "eventually(x <= 0)"}
SLIDE = """
<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="up" type="slide" axis="0 0 1"/>
<geom size=".1"/></body></worldbody></mujoco>"""


def run_to_the_end() -> Run:
    return simulate(GEARS, SPECS, period=0.5, stop="end")


def test_a_run_decides_by_the_sign_of_zeros(tmp_path: Path) -> None:
    run = run_to_the_end()
    kept, above, reached = run.histories.values()
    assert [course.verdict.name for course in run.histories.values()] == [
        *("SATISFIED", "VIOLATED", "SATISFIED")
    ]
    assert kept.verdicts.tolist() == [0, 0, 0, 1]
    assert above.verdicts.tolist() == [0, 0, -1, -1]
    assert reached.verdicts.tolist() == [0, 0, 1, 1]
    assert (run.violated_by, run.violated_at) == ("above", 2)
    assert [rtamt.holds(c.final) for c in run.histories.values()] == [True, False, True]
    run.save(tmp_path / "run.parquet")
    again = Run.load(tmp_path / "run.parquet")
    for name, course in run.histories.items():
        assert np.array_equal(np.signbit(again.histories[name].upper), np.signbit(course.upper))
        assert np.signbit(again.histories[name].final) == np.signbit(course.final)
        assert rtamt.holds(again.replay()[name][0]) == (course.verdict == 1)
    assert simulate(GEARS, SPECS, period=0.5).steps == 2
    assert simulate(GEARS, SPECS["reached"], period=0.5, stop="decided").steps == 2


def test_tables_and_pictures_say_what_a_zero_means() -> None:
    run = run_to_the_end()
    shown = "\n".join(run_table([run]))
    for line in ("kept              0  SATISFIED", "above             0  VIOLATED"):
        assert line in shown
    assert repr(run.histories["kept"]) == (
        "<History of always(gear == 1): SATISFIED at the end, robustness 0>"
    )
    labels = [axes.get_xlabel() for axes in draw([run]).axes]
    assert "SATISFIED, 0, at the end" in labels
    assert "VIOLATED, 0, at 1 s" in labels
    (episode,) = json.loads(runs_json([run], {}))["trials"]
    assert episode["outcomes"]["above"]["verdict"] == "VIOLATED"


@pytest.mark.parametrize(
    ("text", "verdicts"),
    [
        ("always(z == 0)", ["UNDECIDED"] * 3 + ["SATISFIED"]),
        ("always(z > 0)", ["VIOLATED"] * 4),
        ("eventually(z >= 0)", ["SATISFIED"] * 4),
        ("always[0:0.002](z >= 0)", ["UNDECIDED", "SATISFIED", "SATISFIED", "SATISFIED"]),
    ],
)
def test_a_step_monitor_decides_by_the_sign_of_zeros(text: str, verdicts: list[str]) -> None:
    model = mujoco.MjModel.from_xml_string(SLIDE)
    monitor = StepMonitor(model, mujoco.MjData(model), text, {"z": "joint:up.qpos"})
    monitor.reset()
    result = [monitor.verdict.name]
    for _ in range(2):
        monitor.step()
        result.append(monitor.verdict.name)
    monitor.finish()
    result.append(monitor.verdict.name)
    assert result == verdicts
    assert (monitor.violated_at == 0) == (verdicts[0] == "VIOLATED")
    monitor.reset()
    assert monitor.run(0.004).name == verdicts[2]
    assert monitor.samples == (1 if verdicts[0] == "VIOLATED" else 3)


def write(folder: Path) -> None:
    lines = [f"{0.5 * i},{row['gear']},{row['x']}" for i, row in enumerate(GEARS)]
    (folder / "trace.csv").write_text("\n".join(["time,gear,x", *lines]))


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("dense", [[], ["--dense"]])
@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("always(gear == 1)", 0, "SATISFIED, robustness 0, "),
        ("always(gear != 1)", 1, "VIOLATED, robustness 0, "),
        ("always(x >= 0)", 0, "SATISFIED, robustness 0, "),
        ("always(x > 0)", 1, "VIOLATED, robustness 0, "),
        ("not (eventually(x <= 0))", 1, "VIOLATED, robustness 0, "),
    ],
)
def test_exit_codes_follow_the_sign_of_zeros(
    dense: list[str],
    text: str,
    code: int,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Output,
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path)
    assert main(["monitor", text, "trace.csv", *dense, "--plot", "out.png"]) == code
    out = capsys.readouterr().out
    assert out.startswith(said)
    assert ("0, violated" in out) == bool(code)
    if not dense:
        assert main(["explain", text, "trace.csv"]) == code


def test_the_first_violation_by_no_margin_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path)
    assert main(["monitor", "safe = x > 0; always(safe)", "trace.csv"]) == 1
    assert capsys.readouterr().out.splitlines()[5:] == [
        "formula   at the start      minimum   at  violated from",
        "safe                 2  0, violated  1 s            1 s",
        "(result)   0, violated  0, violated  0 s            0 s",
    ]


@pytest.mark.parametrize("command", ["monitor", "explain", "--dense"])
@pytest.mark.parametrize("text", ["always(x > 0)", "always(not (x > 0))"])
def test_a_zero_of_a_predicate_left_out_is_no_violation(
    command: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path)
    declared = f"input float x; output float gear; {text}"
    words: Any = ["monitor", "--dense"] if command == "--dense" else [command]
    assert main([*words, declared, "trace.csv", "--semantics", "output-vacuity"]) == 3
    out = capsys.readouterr().out
    assert "violated," not in out
    assert "robustness 0" in out
    if command != "explain":
        assert out.startswith(
            "UNDECIDED, robustness 0\n"
            "    undecided under every --end: it depends on a predicate that counts 0\n"
        )
