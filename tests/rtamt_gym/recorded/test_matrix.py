"""`rtamt monitor SPEC... -- TRACE...`: the table, the worst cells, and exit codes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.recorded import judge

Output = pytest.CaptureFixture[str]
TEXT = """\
near = always(gap > 2)
slow = always(speed < 30)
answered = always(req >= 3 implies eventually[0:1](gnt >= 3))
"""
HEAD = "time,gap,speed,req,gnt\n"
TRACES = {
    "a.csv": HEAD + "0,5,10,0,0\n0.5,4,12,4,0\n1,5,14,0,5\n1.5,6,9,0,0\n",
    "b.csv": HEAD + "0,5,10,0,0\n0.5,1.5,31,0,0\n1,5,14,0,0\n1.5,6,9,0,0\n",
    "c.csv": HEAD + "0,2,10,0,0\n0.5,4,12,0,0\n1,5,14,4,0\n1.5,6,9,0,0\n",
    "d.csv": HEAD + "0,5,20,0,0\n0.5,4,22,0,0\n1,5,24,0,0\n1.5,6,29,4,0\n",
    ".notes.md": "no trace",
}


@pytest.fixture(autouse=True)
def folder(folder: Path) -> Path:
    """The working directory, with three requirements and a folder of traces."""
    (folder / "req.stl").write_text(TEXT)
    (folder / "runs").mkdir()
    for name, text in TRACES.items():
        (folder / "runs" / name).write_text(text)
    return folder


def test_matrix_shows_all_verdicts(capsys: Output) -> None:
    assert main(["monitor", "req.stl", "--", "runs"]) == 1
    out, err = capsys.readouterr()
    assert out == (
        "trace       length  period  verdict    near    slow    answered  triggers\n"
        "runs/a.csv   1.5 s   0.5 s  SATISFIED     2      16           2        1x\n"
        "runs/b.csv   1.5 s   0.5 s  VIOLATED   -0.5 V    -1 V         3        0x\n"
        "runs/c.csv   1.5 s   0.5 s  VIOLATED      0 V    16          -1 U      1x\n"
        "runs/d.csv   1.5 s   0.5 s  UNDECIDED     2       1          -1 U      1x\n"
        "\n"
        "numbers are robustness; V: violated, U: undecided, E: error, otherwise satisfied\n"
        "4 traces, 3 requirements: 3 violated, 2 undecided, 7 satisfied\n"
        "worst requirement: near, violated in 2 of 4 traces, minimum -0.5 in runs/b.csv\n"
        "worst trace: runs/b.csv, 2 of 3 requirements violated, minimum -1 of slow\n"
        "triggered: answered in 3 of 4 traces\n"
        "note on runs/b.csv: constant over the whole trace: req (0), gnt (0)\n"
        "note on runs/c.csv and 1 more: constant over the whole trace: gnt (0)\n"
        "\n"
        "answered is undecided in runs/c.csv and 1 more\n"
        "    eventually[0:1](gnt >= 3) at 1 s: not recorded: 2 s\n"
        "    if nothing follows (--end complete), the verdict is VIOLATED\n"
    )
    assert err == ""


@pytest.mark.parametrize(
    "traces",
    [
        ["runs/a.csv", "runs/b.csv", "runs/c.csv", "runs/d.csv"],
        ["runs/*.csv"],
        ["**/*.csv"],
        ["runs/[a-d].csv"],
        ["runs/a.csv", "runs", "runs/d.csv"],
        ["./runs"],
    ],
)
def test_files_folders_and_patterns_match(traces: list[str], capsys: Output) -> None:
    assert main(["monitor", "req.stl", "--", "runs"]) == 1
    expected = capsys.readouterr().out
    assert main(["monitor", "req.stl", "--", *traces]) == 1
    assert capsys.readouterr().out == expected


def test_options_may_stand_anywhere(capsys: Output) -> None:
    said = []
    for words in (
        ["--end", "complete", "req.stl", "--", "runs/a.csv", "runs/c.csv"],
        ["req.stl", "--end", "complete", "--", "runs/a.csv", "runs/c.csv"],
        ["req.stl", "--", "--end", "complete", "runs/a.csv", "runs/c.csv"],
        ["req.stl", "--", "runs/a.csv", "--end", "complete", "runs/c.csv"],
        ["req.stl", "--", "runs/a.csv", "runs/c.csv", "--end", "complete"],
    ):
        assert main(["monitor", *words]) == 1
        said.append(capsys.readouterr().out)
    assert len(set(said)) == 1
    assert "4 satisfied" in said[0]


def test_one_trace_has_single_report(capsys: Output) -> None:
    assert main(["monitor", "req.stl", "runs/b.csv"]) == 1
    expected = capsys.readouterr().out
    assert main(["monitor", "req.stl", "--", "runs/b.csv"]) == 1
    assert capsys.readouterr().out == expected


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("workers", ["1", "2", "9"])
def test_unreadable_trace_does_not_stop_others(workers: str, folder: Path, capsys: Output) -> None:
    (folder / "runs" / "aa.csv").write_text(HEAD + "0,1,2,x,4\n")
    (folder / "runs" / "bb.csv").write_text("time,gap\n0,1\n0.5,2\n")
    traces = ["runs", "no.csv"]
    assert main(["monitor", "req.stl", "--", *traces, "-j", workers]) == 2
    out, err = capsys.readouterr()
    assert out == (
        "trace        length  period  verdict    near    slow    answered  triggers\n"
        "runs/a.csv    1.5 s   0.5 s  SATISFIED     2      16           2        1x\n"
        "runs/aa.csv     0 s          ERROR        -1 V    28             E\n"
        "runs/b.csv    1.5 s   0.5 s  VIOLATED   -0.5 V    -1 V         3        0x\n"
        "runs/bb.csv   0.5 s   0.5 s  ERROR        -1 V       E           E\n"
        "runs/c.csv    1.5 s   0.5 s  VIOLATED      0 V    16          -1 U      1x\n"
        "runs/d.csv    1.5 s   0.5 s  UNDECIDED     2       1          -1 U      1x\n"
        "no.csv                       ERROR           E       E           E\n"
        "\n"
        "numbers are robustness; V: violated, U: undecided, E: error, otherwise satisfied\n"
        "7 traces, 3 requirements: 6 errors, 5 violated, 2 undecided, 8 satisfied\n"
        "worst requirement: near, violated in 4 of 6 traces, minimum -1 in runs/aa.csv\n"
        "worst trace: runs/b.csv, 2 of 3 requirements violated, minimum -1 of slow\n"
        "triggered: answered in 3 of 4 traces\n"
        "note on runs/b.csv: constant over the whole trace: req (0), gnt (0)\n"
        "note on runs/c.csv and 1 more: constant over the whole trace: gnt (0)\n"
        "\n"
        "answered is undecided in runs/c.csv and 1 more\n"
        "    eventually[0:1](gnt >= 3) at 1 s: not recorded: 2 s\n"
        "    if nothing follows (--end complete), the verdict is VIOLATED\n"
    )
    assert err == (
        "rtamt: error: runs/aa.csv, line 2, column 'req': expected a number, got 'x'\n"
        "rtamt: error: runs/bb.csv: no column 'speed', which the specification reads; "
        "the columns are time, gap; give --signal speed=COLUMN\n"
        "rtamt: error: runs/bb.csv: no column 'req', which the specification reads; "
        "the columns are time, gap; give --signal req=COLUMN\n"
        "rtamt: error: cannot open no.csv: No such file or directory\n"
    )


def test_only_errors_leave_nothing_that_is_worst(folder: Path, capsys: Output) -> None:
    (folder / "runs" / "b.csv").write_text("")
    assert main(["monitor", "req.stl", "--", "no.csv", "runs/b.csv"]) == 2
    assert capsys.readouterr().out.splitlines()[4:] == [
        "numbers are robustness; V: violated, U: undecided, E: error, otherwise satisfied",
        "2 traces, 3 requirements: 6 errors",
    ]


def test_unfit_requirement_is_its_own_error(folder: Path, capsys: Output) -> None:
    (folder / "runs" / "b.csv").write_text("time,gap\n0,1\n0.4,2\n0.8,2\n")
    text = "near = always[0:0.5](gap > 2); far = always(gap > 0)"
    assert main(["monitor", text, "--", "runs/a.csv", "runs/b.csv"]) == 2
    out, err = capsys.readouterr()
    assert out.splitlines()[1:3] == [
        "runs/a.csv   1.5 s   0.5 s  SATISFIED     2      4",
        "runs/b.csv   0.8 s   0.4 s  ERROR           E    1",
    ]
    assert err.startswith(
        "rtamt: error: runs/b.csv: STL:1:14: bound 0.5 s is not a multiple of the period 0.4 s"
    )
    assert main(["monitor", text, "runs/b.csv"]) == 2
    out, err = capsys.readouterr()
    assert out.startswith("SATISFIED, robustness 1, at the end of the trace\n")
    assert err.startswith("rtamt: error: STL:1:14: bound 0.5 s is not a multiple")
    assert main(["monitor", text, "runs/b.csv", "--align", "outward"]) == 1


def test_many_requirements_fit_80_columns(capsys: Output) -> None:
    names = [f"requirement_number_{i}" if i % 3 else f"r{i}" for i in range(30)]
    text = "; ".join(f"{name} = always(gap > {i}.123456)" for i, name in enumerate(names))
    assert main(["monitor", text, "--", "runs/a.csv", "runs/b.csv"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    heads = [line.split() for line in lines if line.startswith("trace ")]
    assert heads[0][:4] == ["trace", "length", "period", "verdict"]
    shown = [name for head in heads for name in head[1:] if name not in heads[0][1:4]]
    assert shown == [name if len(name) <= 16 else "requirement_n..." for name in names]
    cells = [line.split()[1:] for line in lines if line.startswith("runs/a.csv ")]
    numbers = [c for row in cells for c in row if c not in ("VIOLATED", "V", "s")][2:]
    assert [float(number) for number in numbers] == pytest.approx(
        [4 - i - 0.123456 for i in range(30)], rel=1e-3
    )


def test_trace_names_are_shortened_at_start(folder: Path, capsys: Output) -> None:
    deep = folder / ("a_folder_with_a_long_name" * 2)
    deep.mkdir()
    for name in ("first.csv", "second.csv"):
        (deep / name).write_text(TRACES["a.csv"])
    assert main(["monitor", "req.stl", "--", str(deep)]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert rows[1].split()[0].startswith("...")
    assert rows[1].split()[0].endswith("/first.csv")
    assert max(map(len, rows[:4])) <= 80


def oracle(formulas: dict[str, str], trace: Any, end: Any) -> dict[str, rtamt.Judgement]:  # noqa: ANN401
    return {name: rtamt.judge(text, trace, 0.5, end) for name, text in formulas.items()}


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("end", ["cut", "complete", "open"])
def test_matrix_matches_judgements(end: str, folder: Path, capsys: Output) -> None:
    rng = np.random.default_rng(7)
    formulas = {
        "low": "always(x < 3)",
        "soon": "eventually[0:1](x > 1)",
        "late": "always[2:4](y > -2)",
        "reply": "always(x > 1 implies eventually[0:1](y > 0))",
        "mode": "eventually(x == 2)",
    }
    (folder / "all.stl").write_text("\n".join(f"{n} = {f}" for n, f in formulas.items()))
    codes = set()
    for case in range(25):
        expected = {}
        paths = []
        for trace in range(int(rng.integers(2, 5))):
            data = {v: rng.integers(-2, 4, rng.integers(1, 9)).astype(float) for v in ("x",)}
            n = max(2, len(data["x"]))
            data = {v: rng.integers(-2, 4, n).astype(float) for v in ("x", "y")}
            rows = [f"{i / 2},{a},{b}" for i, (a, b) in enumerate(zip(*data.values(), strict=True))]
            path = f"case{case}_{trace}.csv"
            (folder / path).write_text("\n".join(["time,x,y", *rows]))
            paths.append(path)
            expected[path] = oracle(formulas, data, end)
        code = main(["monitor", "all.stl", "--end", end, "--json", "--", *paths])
        found = json.loads(capsys.readouterr().out)
        verdicts = {j.verdict.name for row in expected.values() for j in row.values()}
        assert code == found["exit_code"]
        assert code == next(
            c for c, v in ((1, "VIOLATED"), (3, "UNDECIDED"), (0, "SATISFIED")) if v in verdicts
        )
        codes.add(code)
        for row in found["trials"]:
            for name, cell in row["outcomes"].items():
                judgement = expected[row["name"]][name]
                assert cell["verdict"] == judgement.verdict.name
                assert float(cell["robustness"]) == judgement.robustness
                assert (float(cell["lower"]), float(cell["upper"])) == (
                    *(judgement.lower, judgement.upper),
                )
                at = judgement.decided_at
                decided = cell["decided_at"]
                assert decided == (at if at is None else {"sample": at, "seconds": at / 2})
                assert cell.get("not_recorded", []) == [str(u) for u in judgement.unrecorded]

        def badness(judgements: list[rtamt.Judgement]) -> tuple[int, int, float]:
            names = [j.verdict.name for j in judgements]
            least = min(j.robustness for j in judgements)
            return names.count("VIOLATED"), names.count("UNDECIDED"), -least

        columns = {n: badness([row[n] for row in expected.values()]) for n in formulas}
        traces = {path: badness(list(row.values())) for path, row in expected.items()}
        assert columns[found["worst_requirement"]] == max(columns.values())
        assert traces[found["worst_trace"]] == max(traces.values())
    assert 1 in codes


def test_internal_error_exits_with_2(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    judged = judge.judge

    def divide(*arguments: Any, **named: Any) -> Any:  # noqa: ANN401
        if arguments[1].source == "runs/a.csv":
            return 1 / 0
        return judged(*arguments, **named)

    monkeypatch.setattr(judge, "judge", divide)
    assert main(["monitor", "req.stl", "--", "runs"]) == 2
    out, err = capsys.readouterr()
    assert out.splitlines()[1:3] == [
        "runs/a.csv   1.5 s   0.5 s  ERROR           E       E           E",
        "runs/b.csv   1.5 s   0.5 s  VIOLATED   -0.5 V    -1 V         3        0x",
    ]
    assert err.startswith("Traceback (most recent call last):\n")
    assert err.count("ZeroDivisionError: division by zero") == 2
    assert err.splitlines()[-1] == (
        "rtamt: error: runs/a.csv: unexpected ZeroDivisionError: division by zero"
    )


def test_explain_many_traces_exit_code(capsys: Output) -> None:
    words = ["req.stl", "--only", "near", "--", "runs/a.csv", "runs/b.csv", "no.csv"]
    assert main(["explain", *words]) == 2
    out, err = capsys.readouterr()
    assert out == (
        "runs/a.csv:\n"
        "robustness 2 at 0 s, decided by gap > 2 at 0.5 s\n"
        "\n"
        "   at  value  formula\n"
        "  0 s      2  near = always(gap > 2)\n"
        "0.5 s      2  gap > 2\n"
        "0.5 s      4  gap\n"
        "\n"
        "runs/b.csv:\n"
        "robustness -0.5 at 0 s, decided by gap > 2 at 0.5 s\n"
        "\n"
        "   at  value  formula\n"
        "  0 s   -0.5  near = always(gap > 2)\n"
        "0.5 s   -0.5  gap > 2\n"
        "0.5 s    1.5  gap\n"
        "\n"
        "runs/a.csv: 4 samples, one every 0.5 s, 0 s to 1.5 s\n"
        "  1.5 s long, longest gap 0.5 s\n"
        "runs/b.csv: 4 samples, one every 0.5 s, 0 s to 1.5 s\n"
        "  1.5 s long, longest gap 0.5 s\n"
    )
    assert err == ("rtamt: error: cannot open no.csv: No such file or directory\n")
    assert main(["explain", *words[:-1]]) == 1
    assert main(["explain", "req.stl", "--only", "answered", "runs/d.csv"]) == 3
    assert capsys.readouterr().out.endswith(
        "1.5 s      4  req\n"
        "1.5 s     -3  missing: gnt >= 3\n"
        "\n"
        "UNDECIDED, robustness -1\n"
        "    eventually[0:1](gnt >= 3) at 1.5 s: not recorded: 2 s to 2.5 s\n"
        "    if nothing follows (--end complete), the verdict is VIOLATED\n"
        "\n"
        "runs/d.csv: 4 samples, one every 0.5 s, 0 s to 1.5 s\n"
        "  1.5 s long, longest gap 0.5 s\n"
        "note: constant over the whole trace: gnt (0)\n"
    )


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("end", ["cut", "complete", "open"])
def test_event_cells_match_dense_judgements(
    end: Any,  # noqa: ANN401 - a reading of the end
    folder: Path,
    capsys: Output,
) -> None:
    rng = np.random.default_rng(11)
    formulas = {
        "low": "always(x < 3)",
        "soon": "eventually[0:1.5](x > 1)",
        "mode": "always(y == 1)",
    }
    (folder / "all.stl").write_text("\n".join(f"{n} = {f}" for n, f in formulas.items()))
    for case in range(15):
        paths, expected = [], {}
        for trace in range(2):
            n = int(rng.integers(2, 7))
            times = np.cumsum(rng.integers(1, 9, n)) / 4 + 20
            signals = {v: np.column_stack([times, rng.integers(0, 4, n)]) for v in ("x", "y")}
            rows = [f"{t},{x},{y}" for (t, x), (_, y) in zip(*signals.values(), strict=True)]
            paths.append(f"dense{case}_{trace}.csv")
            (folder / paths[-1]).write_text("\n".join(["time,x,y", *rows]))
            expected[paths[-1]] = {
                name: rtamt.dense.judge(
                    text, {v: signals[v] for v in rtamt.parse(text).variables}, end
                )
                for name, text in formulas.items()
            }
        code = main(["monitor", "all.stl", "--dense", "--end", end, "--json", "--", *paths])
        found = json.loads(capsys.readouterr().out)
        assert code == found["exit_code"]
        for row in found["trials"]:
            for name, cell in row["outcomes"].items():
                judgement = expected[row["name"]][name]
                assert cell["verdict"] == judgement.verdict.name
                assert float(cell["robustness"]) == judgement.robustness
                at = judgement.decided_at
                decided = cell["decided_at"]
                assert decided == (at if at is None else {"sample": None, "seconds": at})
                assert cell.get("not_recorded", []) == [str(u) for u in judgement.unrecorded]
