"""The command line: its output, its errors and its exit codes."""

import io
import json
import os
import subprocess
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.commands import COMMANDS, monitor

SPEC = """\
safe = speed < 30
out = always(req >= 3 implies eventually[0:1](gnt >= 3)) and always(safe)
"""
TRACE = """\
time,req,gnt,speed,note
0,0,0,10,
0.5,4,0,20,a request
1.0,0,3.5,31,granted
1.5,4,0,29,another
2.0,0,0,28,
2.5,0,0,20,
"""


class Ramp(gym.Env[Any, Any]):
    """x rises by the action, 0 or 1, ten times a second."""

    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = spaces.Discrete(2, start=1)
    control_timestep = 0.1

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.x = float(seed or 0)
        return np.array([self.x]), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.x += action
        return np.array([self.x]), 0.0, False, False, {}


@pytest.fixture
def ramp() -> Iterator[str]:
    gym.register("RtamtRamp-v0", lambda **_: Ramp(), max_episode_steps=8)
    yield "RtamtRamp-v0"
    del gym.registry["RtamtRamp-v0"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with a specification and a trace."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.stl").write_text(SPEC)
    (tmp_path / "trace.csv").write_text(TRACE)
    return tmp_path


Output = pytest.CaptureFixture[str]


@pytest.mark.usefixtures("folder")
def test_monitor_prints_the_verdict_and_where_every_named_formula_fails(capsys: Output) -> None:
    assert main(["monitor", "spec.stl", "trace.csv"]) == 1
    assert capsys.readouterr().out == (
        "VIOLATED, robustness -1, certain from 1 s on\n"
        "    why: decided by req >= 3 at 1.5 s, where req = 4\n"
        "    triggered 2 times, first at 0.5 s\n"
        "trace.csv: 6 samples, one every 0.5 s, 0 s to 2.5 s\n"
        "  2.5 s long, longest gap 0.5 s\n"
        "\n"
        "formula  at the start  minimum   at  violated from\n"
        "safe               20       -1  1 s            1 s\n"
        "out                -1       -1  0 s            0 s\n"
    )


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("arguments", "code", "first"),
    [
        (["always(speed <= 31)"], 0, "SATISFIED, robustness 0, at the end of the trace"),
        (["always(speed < 32)"], 0, "SATISFIED, robustness 1, at the end of the trace"),
        (["eventually(speed > 30)"], 0, "SATISFIED, robustness 1, certain from 1 s on"),
        (["always[0:1.5](speed < 32)"], 0, "SATISFIED, robustness 1, certain from 1.5 s on"),
        (["always eventually(gnt > 3)"], 1, "VIOLATED, robustness -3, at the end of the trace"),
        (["speed < 30", "--view", "step"], 1, "VIOLATED, robustness -1, certain from 1 s on"),
        (["(true)", "--view", "step"], 0, "SATISFIED, robustness inf, certain from 0 s on"),
        (
            ["always[0:3ms](speed < 30)", "--period", "1ms"],
            1,
            "VIOLATED, robustness -1, certain from 0.002 s on",
        ),
    ],
)
def test_monitor_exits_1_only_on_a_violation(
    capsys: Output, arguments: list[str], code: int, first: str
) -> None:
    spec, *options = arguments
    assert main(["monitor", spec, "trace.csv", *options]) == code
    assert capsys.readouterr().out.splitlines()[0] == first


def test_monitor_reads_samples_without_times_from_stdin(
    capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("y, x\n1, 5\n2, 4\n3, -inf\n\n"))
    assert main(["monitor", "always[0:2](x > 1)", "-"]) == 1
    assert capsys.readouterr().out == (
        "VIOLATED, robustness -inf, certain from sample 2 on\n"
        "    why: decided by x > 1 at sample 2, where x = -inf\n"
        "stdin: 3 samples, bounds count samples\n"
        "\n"
        "formula   at the start  minimum        at  violated from\n"
        "(result)          -inf     -inf  sample 0       sample 0\n"
    )


def test_monitor_reads_the_period_through_rounding_and_from_times_of_day(
    capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    for start, step in ((0.0, 0.1), (1.7e9, 0.01), (3.0, 1 / 15)):
        lines = [f"{start + i * step!r},1" for i in range(20)]
        monkeypatch.setattr(sys, "stdin", io.StringIO("\n".join(["time,x", *lines])))
        bound = f"{round(step * 30, 9):g}"
        assert main(["monitor", f"eventually[0:{bound}](x > 0)", "-"]) == 0
        assert f"one every {step:.6g} s" in capsys.readouterr().out


def test_run_prints_a_row_for_every_specification_of_every_episode(
    capsys: Output, ramp: str, folder: Path
) -> None:
    (folder / "low.stl").write_text("always(x < 5.5)")
    arguments = f"run {ramp} --spec low.stl --signal x=obs[0] --policy zero --episodes 2".split()
    assert main([*arguments, "--spec", "soon = eventually[0:0.3](x > 1.5)"]) == 0
    assert capsys.readouterr().out == (
        "low: always(x < 5.5)\n"
        "soon: eventually[0:0.3](x > 1.5)\n"
        "\n"
        "ep  steps  stopped  spec  robustness  verdict    saved\n"
        " 1      6    0.6 s  low         -0.5  VIOLATED   0.2 s\n"
        "                    soon        +1.5  SATISFIED\n"
        " 2      5    0.5 s  low         -0.5  VIOLATED   0.3 s\n"
        "                    soon        +2.5  SATISFIED\n"
        "\n"
        "saved: simulated time from the stop to the time limit. An environment that ends\n"
        "by itself, as after a fall or a crash, might not have used all of it.\n"
    )


def test_run_that_only_reports_says_when_verdicts_were_certain(capsys: Output, ramp: str) -> None:
    arguments = f"run {ramp} --signal x=obs[0] --policy zero --on-violation report".split()
    specs = ["--spec", "always(x < 5.5)", "--spec", "always(x < 9)"]
    assert main([*arguments, *specs, "--max-steps", "7", "--seed", "1"]) == 0
    assert capsys.readouterr().out.splitlines()[3:] == [
        "ep  steps  certain  spec   robustness  verdict",
        " 1      7    0.5 s  spec         -2.5  VIOLATED",
        "           the end  spec2          +1  SATISFIED",
    ]


def test_run_can_ask_a_formula_of_every_step(capsys: Output, ramp: str) -> None:
    arguments = f"run {ramp} --signal x=obs[0] --policy zero --view step --spec x<2.5".split()
    assert main(arguments) == 0
    assert capsys.readouterr().out.splitlines()[3:5] == [
        " 1      3    0.3 s  spec        -0.5  VIOLATED  0.5 s",
        "",
    ]


def test_run_writes_strict_json_with_infinities_as_text(
    capsys: Output, ramp: str, folder: Path
) -> None:
    arguments = f"run {ramp} --signal x=obs[0] --policy zero".split()
    assert main([*arguments, "--spec", "low = always(x < 5.5)", "--json", "o.json"]) == 0
    assert "outcomes: o.json" in capsys.readouterr().out

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    kept = json.loads((folder / "o.json").read_text(), parse_constant=refuse)
    assert kept.pop("results")["low"]["violated"] == 1
    assert kept["trials"][0].pop("wall") > 0
    assert kept.pop("versions")["rtamt"] == rtamt.__version__
    assert kept == {
        "format": "rtamt result",
        "version": 2,
        "kind": "runs",
        "rtamt": rtamt.__version__,
        "system": ramp,
        "period": "1/10",
        "limit": 0.8,
        "reading": {
            "on_violation": "terminate",
            "at_termination": None,
            "at_truncation": "cut",
        },
        "requirements": {"low": "always(x < 5.5)"},
        "trials": [
            {
                "seed": 0,
                "ended": "violation",
                "simulated": 0.6,
                "return": 0.0,
                "outcomes": {
                    "low": {
                        "verdict": "VIOLATED",
                        "robustness": -0.5,
                        "lower": "-inf",
                        "upper": -0.5,
                        "decided_at": {"sample": 6, "seconds": 0.6},
                        "asked": [],
                    }
                },
                "steps": 6,
                "steps_saved": 2,
                "violated_by": "low",
            }
        ],
    }


def test_run_draws_the_first_violated_episode(capsys: Output, ramp: str, folder: Path) -> None:
    arguments = f"run {ramp} --signal x=obs[0] --policy zero --episodes 3 --max-steps 4".split()
    assert main([*arguments, "--spec", "always(x < 5.5)", "--plot", "e.png"]) == 0
    assert "picture of episode 3: e.png" in capsys.readouterr().out
    assert (folder / "e.png").read_bytes().startswith(b"\x89PNG")


def test_run_gives_the_same_episodes_for_the_same_seed(capsys: Output) -> None:
    arguments = ["run", "CartPole-v1", "--spec", "always(abs(x) < 0.1)", "--signal", "x=obs[2]"]
    outputs = []
    for seed in ("5", "5", "6"):
        assert main([*arguments, "--seed", seed]) == 0
        outputs.append(capsys.readouterr().out)
    assert outputs[0] == outputs[1] != outputs[2]


def test_run_closes_the_environment_after_an_error_too(
    capsys: Output, monkeypatch: pytest.MonkeyPatch, ramp: str
) -> None:
    closed = []
    monkeypatch.setattr(Ramp, "close", lambda _self: closed.append(True), raising=False)
    assert main(["run", ramp, "--spec", "always(x < 5)", "--signal", "x=obs[9]"]) == 2
    assert "signal 'x': obs[9] does not fit" in capsys.readouterr().err
    assert closed == [True]


def test_run_reads_the_action_with_its_value_at_reset(capsys: Output) -> None:
    arguments = ["run", "Pendulum-v1", "--spec", "always(abs(u) < 2.5)", "--max-steps", "5"]
    assert main([*arguments, "--signal", "u=action[0],0"]) == 0
    assert "SATISFIED" in capsys.readouterr().out


def test_version_says_which_machines_run(capsys: Output) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"rtamt {rtamt.__version__} ({rtamt.BACKEND})\n"


def test_help_fits_80_columns(capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for command in ([], *([name] for name in COMMANDS)):
        assert main([*command, "--help"]) == 0
        assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


def test_a_row_and_a_module_make_a_command(capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("rtamt_gym.commands.count")
    module.add_arguments = lambda parser: parser.add_argument("up_to", type=int)  # type: ignore[attr-defined]
    module.run = lambda options: len(range(options.up_to))  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(COMMANDS, "count", "count up to a number")
    assert main(["count", "3"]) == 3
    assert main(["--help"]) == 0
    assert "count     count up to a number" in capsys.readouterr().out
    assert main(["count"]) == 2
    error = "the following arguments are required: up_to; see rtamt count --help"
    assert capsys.readouterr().err == f"rtamt: error: {error}\n"


def test_a_command_loads_no_other() -> None:
    code = (
        "import sys; from rtamt_gym.__main__ import main; main(['monitor', '--help']);"
        "sys.exit(' '.join(m for m in sys.modules if m.startswith('rtamt_gym.commands.')))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    loaded = {name.rpartition(".")[2] for name in ran.stderr.split()}
    assert loaded & set(COMMANDS) == {"monitor"}


def test_an_interrupt_exits_130_without_a_word(
    capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_arguments: list[str]) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(monitor, "read_arguments", interrupted)
    assert main(["monitor", "spec.stl", "trace.csv"]) == 130
    assert capsys.readouterr() == ("", "")


@pytest.mark.usefixtures("folder")
def test_a_reader_that_leaves_is_no_error() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "rtamt_gym", "monitor", "spec.stl", "trace.csv"]
    ran = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (ran.returncode, ran.stderr) == (141, "")
