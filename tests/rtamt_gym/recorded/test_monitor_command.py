"""Verdicts of rtamt monitor: semantics, times, dense time, processes."""

from __future__ import annotations

import csv
import json
import os
import random
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import write_files

import rtamt
from rtamt.typing import SemanticsName
from rtamt_gym.__main__ import main
from rtamt_gym.commands import judging
from rtamt_gym.results.trial import Trial

Output = pytest.CaptureFixture[str]
TEXT = """\
input float req
output float gnt
granted = eventually[0:0.5](gnt >= 3)
always(req >= 3 implies granted)
"""
COLUMNS = {"req": np.array([0.0, 5.0, 0.0, 0.0]), "gnt": np.array([0.0, 0.0, 1.0, 4.0])}


@pytest.fixture(autouse=True)
def folder(folder: Path) -> Path:
    """The working directory, with a text that declares input and output, and traces."""
    write_files(folder)
    (folder / "roles.stl").write_text(TEXT)
    return folder


@pytest.mark.parametrize("semantics", ["output-robustness", "input-robustness", "output-vacuity"])
def test_semantics_applies_to_all_formulas(
    semantics: SemanticsName, folder: Path, capsys: Output
) -> None:
    command = ["monitor", "roles.stl", "even.csv", "--semantics", semantics, "--out", "out.csv"]
    code = main(command)
    spec = rtamt.parse(TEXT)
    expected = rtamt.evaluate(spec, COLUMNS, 0.5, semantics=semantics)
    assert code == (1 if expected[0] < 0.0 else 3 if semantics == "output-vacuity" else 0)
    assert f"robustness {expected[0] + 0.0:g}" in capsys.readouterr().out
    with (folder / "out.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["robustness"]) for row in rows] == expected.tolist()
    inner = rtamt.evaluate(
        spec.formulas["granted"],
        {"gnt": COLUMNS["gnt"]},
        0.5,
        semantics=semantics,
        inputs=(),
        outputs=("gnt",),
    )
    assert [float(row["granted"]) for row in rows] == inner.tolist()


def test_events_are_judged_under_the_semantics(capsys: Output) -> None:
    command = ["monitor", "--dense", "roles.stl", "long.csv"]
    assert main(command) == 1
    assert "VIOLATED, robustness -2, " in capsys.readouterr().out
    assert main([*command, "--semantics", "output-robustness"]) == 1
    assert "VIOLATED, robustness -3, " in capsys.readouterr().out


def test_an_explanation_is_about_the_semantics(capsys: Output) -> None:
    assert main(["explain", "roles.stl", "even.csv", "--semantics", "output-robustness"]) == 1
    assert capsys.readouterr().out.startswith("robustness -2 at 0 s, decided by gnt >= 3 at 1 s\n")


def test_episodes_are_judged_under_the_semantics(folder: Path) -> None:
    text = "output float angle; input float x; always(abs(angle) < 9 and abs(x) < 8)"
    command = ["run", "CartPole-v1", "--spec", text, "--signal", "angle=obs[2]"]
    command += ["--signal", "x=obs[0]", "--json", "out.json"]
    found = {}
    for semantics in ("standard", "output-robustness"):
        assert main([*command, "--semantics", semantics]) == 0
        (episode,) = json.loads((folder / "out.json").read_text())["trials"]
        found[semantics] = episode["outcomes"]["spec"]["robustness"]
    assert found["standard"] < 8.0 < found["output-robustness"] < 9.0


@pytest.mark.parametrize(
    ("semantics", "message"),
    [
        (
            "output-robustness",
            (
                "--semantics output-robustness needs output variables, and none are declared; "
                "declare them in the text (output float gnt)"
            ),
        ),
        ("output", "argument --semantics: invalid choice: 'output' (choose from 'standard', "),
    ],
)
def test_unfit_semantics_error(semantics: str, message: str, capsys: Output) -> None:
    assert main(["monitor", "spec.stl", "even.csv", "--semantics", semantics]) == 2
    assert capsys.readouterr().err.startswith(f"rtamt: error: {message}")


SPEC = "always[0:1](x < 30)"
"""With a sample every 10 ms, it is violated at sample 50; two samples alone satisfy it."""

X = [10.0] * 50 + [31.0] * 150
MS = [10 * i for i in range(200)]
EPOCH = 1_700_000_000_000


def write(name: str, times: Sequence[object]) -> None:
    pd.DataFrame({name: times, "x": X}).to_csv("trace.csv", index=False)


DATES = pd.to_datetime(np.array(MS) + EPOCH, unit="ms")


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("time", [ms / 1000 for ms in MS]),
        ("timestamp", [ms / 1000 for ms in MS]),
        ("timestamp", [(ms + EPOCH) / 1000 for ms in MS]),
        ("Time [ms]", MS),
        ("t", [ms / 1000 for ms in MS]),
        ("time_ns", [(ms + EPOCH) * 10**6 for ms in MS]),
        ("timestamp", DATES.strftime("%Y-%m-%dT%H:%M:%S.%fZ").tolist()),
        ("recorded at", DATES.strftime("%Y-%m-%d %H:%M:%S.%f").tolist()),
    ],
)
def test_times_are_not_taken_for_an_index(
    name: str, times: Sequence[object], capsys: pytest.CaptureFixture[str]
) -> None:
    write(name, times)
    assert main(["monitor", SPEC, "trace.csv"]) == 1
    out = capsys.readouterr().out
    assert out.startswith("VIOLATED, robustness -1, certain from ")
    assert "200 samples, one every 0.01 s, " in out


def test_period_with_jitter_error(capsys: pytest.CaptureFixture[str]) -> None:
    write("time", MS)
    assert main(["monitor", SPEC, "trace.csv", "--period", "10ms", "--jitter", "5%"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: expected --period, which leaves the times aside, or --jitter\n"
    )


@pytest.mark.parametrize(
    ("formula", "headline", "row"),
    [
        # x is 1 at 4 s, the last instant, which only the window of 0 s reaches.
        ("always[4:4](x < 0)", "VIOLATED, robustness -1,", ["-1", "-1", "0", "s", "0", "s"]),
        ("eventually[4:4](x > 0)", "SATISFIED, robustness 1,", ["1", "-inf", "0", "s", "0", "s"]),
        ("always[0:1](x > 0)", "VIOLATED, robustness -1,", ["-1", "-1", "0", "s", "0", "s"]),
    ],
)
def test_table_has_the_robustness_of_the_headline(
    formula: str,
    headline: str,
    row: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "d.csv"
    path.write_text("time,x\n0,1\n1,-1\n1.5,2\n4,1\n")
    main(["monitor", formula, str(path), "--dense", "--time-unit", "s"])
    first, *_, last = capsys.readouterr().out.splitlines()
    assert first.startswith(headline)
    assert last.split() == ["(result)", *row]


def test_interrupt_reaches_main_process() -> None:
    code = (
        "import os, signal, rtamt_gym.commands.judging as j; j._begin_worker();"
        "os.kill(os.getpid(), signal.SIGINT); print('at work')"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "at work\n", "")


work = judging._row_of_file


def dying(path: str) -> tuple[Trial, judging.Seen]:
    """Judge a trace as a worker does, but die at one of this name."""
    if path == "deadly.csv":
        os._exit(9)
    return work(path)


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, 200])  # the processes get one trace at a time, or several
def test_dead_process_does_not_stop_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output, count: int
) -> None:
    monkeypatch.setattr(judging, "_row_of_file", dying)
    names = [f"t{i}.csv" for i in range(count)]
    for name in names:
        (tmp_path / name).write_text("time,x\n0,1\n1,2\n")
    paths = [*names[:3], "deadly.csv", *names[3:]]
    assert main(["monitor", "p = always(x > 0)", "-j", "2", "--json", "--", *paths]) == 2
    said = capsys.readouterr()
    trials = json.loads(said.out)["trials"]
    assert [row["name"] for row in trials] == paths
    cells = {row["name"]: row["outcomes"]["p"] for row in trials}
    message = "deadly.csv: the process that judged it died, perhaps for lack of memory"
    assert said.err == f"rtamt: error: {message}\n"
    assert cells.pop("deadly.csv") == {"verdict": "ERROR", "error": message}
    assert {name: cell["verdict"] for name, cell in cells.items()} == dict.fromkeys(
        names, "SATISFIED"
    )


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads there")
def test_only_a_process_of_one_thread_forks() -> None:
    code = (
        "from threading import Thread, Event; import rtamt_gym.commands.judging as j\n"
        "print(j._context().get_start_method())\n"
        "event = Event(); thread = Thread(target=event.wait); thread.start()\n"
        "print(j._context().get_start_method()); event.set(); thread.join()\n"
    )
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment
    )
    assert (ran.stdout, ran.stderr) == ("fork\nforkserver\n", "")


def test_processes_ignore_early_interrupts() -> None:
    code = (
        "import signal, sys; from concurrent.futures import ProcessPoolExecutor;"
        "from multiprocessing import get_context; import rtamt_gym.commands.judging as j\n"
        "if __name__ == '__main__':\n"
        "    before = signal.getsignal(signal.SIGINT)\n"
        "    with ProcessPoolExecutor(1, get_context('spawn')) as pool:\n"
        "        print(*j._begin(pool, signal.getsignal, [signal.SIGINT]), int(signal.SIG_IGN))\n"
        "    print(signal.getsignal(signal.SIGINT) == before)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ran.stdout, ran.stderr) == ("1 1\nTrue\n", "")


# The line `why` of `rtamt monitor`: the predicate, time and values that decided a verdict. -------


def write_values(values: list[float]) -> str:
    rows = [f"{0.5 * i},{value}" for i, value in enumerate(values)]
    Path("run.csv").write_text("\n".join(["time,x", *rows, ""]))
    return "run.csv"


def reasons(capsys: Output, *arguments: str) -> list[str]:
    main(["monitor", *arguments])
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    return [line for line in lines if line.startswith("    why: ")]


@pytest.mark.parametrize("dense", [[], ["--dense"]], ids=["sampled", "dense"])
@pytest.mark.parametrize("seed", range(5))
def test_why_names_first_extreme_sample(seed: int, dense: list[str], capsys: Output) -> None:
    values = [float(random.Random(seed + i).randint(-9, 9)) for i in range(12)]
    for formula, predicate, extreme in (
        ("always(x < 3)", "x < 3", max(values)),
        ("always(x > -99)", "x > -99", min(values)),
        ("eventually(x > 3)", "x > 3", max(values)),
    ):
        time = 0.5 * values.index(extreme)
        expected = f"    why: decided by {predicate} at {time:g} s, where x = {extreme:g}"
        assert reasons(capsys, formula, write_values(values), *dense) == [expected]


def test_why_of_each_decided_requirement(capsys: Output) -> None:
    trace = write_values([1, 5, 2])
    low, late = "low = always(x < 4)", "late = always[20:30](x < 4)"
    assert reasons(capsys, low, late, "some = eventually(x > 4)", trace) == [
        "    why: decided by x < 4 at 0.5 s, where x = 5",
        "    why: decided by x > 4 at 0.5 s, where x = 5",
    ]


def test_no_why_of_unknown_values(capsys: Output) -> None:
    Path("gaps.csv").write_text("time,x\n0,1\n1,\n2,9\n")
    assert reasons(capsys, "always(x < 4)", "gaps.csv", "--missing", "unknown") == []


def test_why_names_all_variables_of_the_predicate(capsys: Output) -> None:
    Path("two.csv").write_text("time,x,y\n0,1,2\n1,3,2.5\n2,1,1\n")
    assert reasons(capsys, "always(x - y < 0.25)", "two.csv") == [
        "    why: decided by x - y < 0.25 at 1 s, where x = 3 and y = 2.5"
    ]


@pytest.mark.parametrize("dense", [[], ["--dense"]], ids=["sampled", "dense"])
def test_why_names_no_undecided_request(dense: list[str], capsys: Output) -> None:
    rows = ["0,0,0", "1,5,0", "2,0,2", "3,0,2", "4,0,0", "5,5,-10"]
    Path("late.csv").write_text("\n".join(["time,req,gnt", *rows, ""]))
    formula = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
    expected = ["    why: decided by gnt >= 3 at 2 s, where gnt = 2"]
    assert reasons(capsys, formula, "late.csv", *dense) == expected
    main(["monitor", formula, "late.csv", *dense, "--junit", "out.xml"])
    assert "at 5 s" not in Path("out.xml").read_text()
    capsys.readouterr()
    main(["explain", formula, "late.csv", *dense])
    text = capsys.readouterr().out
    assert "VIOLATED, robustness -2, certain from 3 s on\nunder --end cut its upper bound" in text
    assert "robustness -1 at 0 s, decided by gnt >= 3 at 2 s" in text
    main(["explain", formula, "late.csv", *dense, "--end", "complete"])
    assert "bound decides" not in capsys.readouterr().out


def test_why_of_every_instant(capsys: Output) -> None:
    Path("x.csv").write_text("time,x\n0,5\n1,-1\n2,-1\n3,5\n4,-9\n")
    assert reasons(capsys, "eventually[0:1](x > 0)", "x.csv", "--view", "step") == [
        "    why: decided by x > 0 at 1 s, where x = -1"
    ]


def test_why_under_an_open_end(capsys: Output) -> None:
    assert reasons(capsys, "always(x < 3)", write_values([1, 5, 2, 4]), "--end", "open") == [
        "    why: decided by x < 3 at 0.5 s, where x = 5"
    ]
