"""Cells and messages without a number as unknown samples, `--missing unknown`."""

from __future__ import annotations

import json
import math
import tempfile
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from bags import START, twist, write_bag
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

import rtamt
from rtamt import Verdict
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import judge
from rtamt_gym.recorded.ruled import read_ruled
from rtamt_gym.recorded.trace import EventTrace, Trace

UNKNOWN = Columns(missing="unknown")
SPECS = """\
late = always(req >= 3 implies eventually[0:2](gnt >= 3))
calm = always(req < 9)
worst = always(req < 3 and gnt > -9)
"""
TABLE = "time_s,req,gnt\n5,4,0\n6,0,\n7,0,1\n8,0,0\n"
FORMULAS = [
    "always(x > 1 implies eventually[0:1](y > 0))",
    "eventually(x > 0 and once[0:1](y < 1))",
    "(x > -1) until[0:2] (y > 0)",
    "always(abs(x) >= 0)",
]

Output = pytest.CaptureFixture[str]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "specs.stl").write_text(SPECS)
    (tmp_path / "run.csv").write_text(TABLE)
    return tmp_path


def columns() -> st.SearchStrategy[list[tuple[int | None, int | None]]]:
    cell = st.none() | st.integers(-2, 3)
    return st.lists(st.tuples(cell, cell), min_size=1, max_size=6)


@settings(max_examples=examples(60), deadline=None)
@given(
    rows=columns(),
    text=st.sampled_from(FORMULAS),
    end=st.sampled_from(["complete", "cut", "open"]),
    fills=st.lists(st.integers(-4, 4), min_size=12, max_size=12),
)
def test_cell_fillings_stay_within_bounds(
    rows: list[tuple[int | None, int | None]], text: str, end: rtamt.typing.End, fills: list[int]
) -> None:
    cells = [",".join("" if each is None else str(each) for each in row) for row in rows]
    spec = rtamt.parse(text)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "run.csv"
        path.write_text("\n".join(["x,y", *(cell if cell != "," else '"",' for cell in cells)]))
        trace, period = read_ruled(str(path), {"": spec}, EvaluationOptions(), UNKNOWN)
    assert isinstance(trace, Trace)
    found = judge(spec, trace, period, EvaluationOptions(end=end))
    names = tuple(
        name
        for i, name in enumerate("xy")
        if name in spec.variables and any(row[i] is None for row in rows)
    )
    assert found.found.unknown == names
    assert bool(found.series) == (not names)
    given_back = {
        name: [math.nan if row[i] is None else float(row[i] or 0) for row in rows]
        for i, name in enumerate("xy")
    }
    asked = rtamt.judge(spec, given_back, end=end, nan="unknown")
    assert (found.verdict, found.found.lower, found.found.upper) == (
        asked.verdict,
        asked.lower,
        asked.upper,
    )
    left = iter(fills)
    filled = {
        name: [next(left) if row[i] is None else float(row[i] or 0) for row in rows]
        for i, name in enumerate("xy")
    }
    whole = rtamt.judge(spec, filled, end=end)
    assert found.found.lower <= whole.lower
    assert whole.upper <= found.found.upper
    if found.verdict is not Verdict.UNDECIDED:
        assert whole.verdict is found.verdict


def test_report_states_unknown_values(folder: Path, capsys: Output) -> None:
    assert folder.is_dir()
    assert main(["monitor", "specs.stl", "run.csv", "--missing", "unknown"]) == 1
    assert capsys.readouterr().out == (
        "late: UNDECIDED, robustness between -1 and inf\n"
        "    undecided under every --end: it depends on values of gnt that are not known\n"
        "    triggered 1 time, first at 5 s\n"
        "calm: SATISFIED, robustness 5, at the end of the trace\n"
        "    why: decided by req < 9 at 5 s, where req = 4\n"
        "worst: VIOLATED, robustness between -inf and -1, certain from 5 s on\n"
        "run.csv: 4 samples, one every 1 s, 5 s to 8 s, 3 s long, longest gap 2 s of gnt\n"
        "note: empty cells are unknown samples (gnt: 1, the first in run.csv, line 3)\n"
        "note: no robustness over time of late, worst: values of gnt are not known\n"
        "\n"
        "spec  formula  at the start  minimum   at  violated from\n"
        "calm  calm                5        5  5 s              -\n"
    )


@pytest.mark.parametrize(("only", "code"), [("late", 3), ("calm", 0), ("worst", 1)])
def test_the_exit_code_is_that_of_the_verdict(
    folder: Path, capsys: Output, only: str, code: int
) -> None:
    assert folder.is_dir()
    arguments = ["specs.stl", "run.csv", "--missing", "unknown", "--only", only]
    assert main(["monitor", *arguments]) == code
    out = capsys.readouterr().out
    left_out = "note: no robustness over time: values of gnt are not known\n"
    assert out.endswith(left_out) == (only != "calm")
    assert ("empty cells" in out) == (only != "calm")


def test_irrelevant_unknown_value_keeps_verdict(folder: Path, capsys: Output) -> None:
    (folder / "run.csv").write_text('x\n4\n""\nnan\n')
    assert main(["monitor", "always(abs(x) >= 0)", "run.csv", "--missing", "unknown"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(
        "SATISFIED, robustness between 0 (holds) and 4, at the end of the trace\n"
    )
    assert "(x: 2, the first in run.csv, line 3)" in out


def test_unknown_value_lasts_until_next_row(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time,x\n0,1\n1,\n2,3\n4,4\n5,5\n6,\n8,6\n9,7\n")
    spec = rtamt.parse("always(x > 0)")
    sampled = Columns(missing="unknown", jitter=0.05)
    trace, period = read_ruled(str(path), {"": spec}, EvaluationOptions(), sampled)
    assert isinstance(trace, Trace)
    values = [None if math.isnan(x) else x for x in trace.columns["x"].tolist()]
    assert values == [1, None, 3, 3, 4, 5, None, None, 6, 7]
    found = judge(spec, trace, period, EvaluationOptions())
    assert (found.found.lower, found.found.upper) == (-math.inf, 1.0)


ROWS = "0,1\n0.1,1\n0.2,1\n0.215,{}\n0.3,1\n0.4,3\n0.5,1\n"


@pytest.mark.parametrize("wide", [False, True])
def test_unknown_row_that_resampling_leaves_out(
    folder: Path, capsys: Output, *, wide: bool
) -> None:
    """The outcome is that of the file without the row."""
    found = []
    for text in (ROWS.format(""), ROWS.replace("0.215,{}\n", "")):
        lines = text.splitlines()
        if wide:
            lines = ["time,name,x", *(",A,".join(line.split(",")) for line in lines)]
        else:
            lines = ["time,x", *lines]
        (folder / "log.csv").write_text("\n".join(lines) + "\n")
        words = ["--wide", "name"] if wide else ["--missing", "unknown"]
        spec = f"always({'x.A' if wide else 'x'} < 4)"
        assert main(["monitor", spec, "log.csv", "--jitter", "5%", "--json", *words]) == 0
        found.append(json.loads(capsys.readouterr().out)["trials"][0]["outcomes"])
    assert found[0] == found[1]


def test_unknown_values_before_start_are_ignored() -> None:
    values = {"x": np.array([1, np.nan, 1, 1]), "y": np.array([np.nan, np.nan, 2, 3])}
    trace = Trace("run", values, 4, None, str, known_from={"y": 2}, unknown=["x"])
    found = judge(rtamt.parse("always(x + y < 5)"), trace, None, EvaluationOptions())
    assert found.found.robustness == 1


def test_outcome_files_show_unknown_values(folder: Path, capsys: Output) -> None:
    assert main(["monitor", "specs.stl", "run.csv", "--missing", "unknown", "--json"]) == 1
    text = capsys.readouterr().out
    kept = json.loads(text)
    assert kept["reading"]["columns"] == {"missing": "unknown"}
    (trial,) = kept["trials"]
    assert trial["notes"] == [
        "empty cells are unknown samples (gnt: 1, the first in run.csv, line 3)"
    ]
    late, worst = trial["outcomes"]["late"], trial["outcomes"]["worst"]
    assert (late["verdict"], late["lower"], late["upper"]) == ("UNDECIDED", -1.0, "inf")
    assert late["way_out"].endswith("it depends on values of gnt that are not known")
    assert (worst["lower"], worst["upper"]) == ("-inf", -1.0)
    assert worst["explanation"] == "not explained: values of gnt are not known"
    (folder / "outcomes.json").write_text(text)
    assert main(["report", "outcomes.json", "-o", "page.html"]) == 0
    page = (folder / "page.html").read_text()
    assert page.count("is not shown in full: values of gnt are not known.") == 2


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["monitor", "--out", "o.csv"], "--missing: --out needs the robustness at every sample"),
        (["monitor", "--plot", "o.png"], "--missing: --plot needs the robustness at every sample"),
        (
            ["monitor", "--write-mcap", "o.mcap"],
            "--missing: --write-mcap needs the robustness at every sample",
        ),
        (["mine", "--range", "v=0:9"], "--missing: rtamt mine compares the robustness of traces"),
    ],
)
def test_robustness_of_unknown_values_error(
    folder: Path, capsys: Output, command: list[str], message: str
) -> None:
    spec = "always(req < ?v)" if "mine" in command else "specs.stl"
    arguments = [command[0], spec, "run.csv", "--missing", "unknown", *command[1:]]
    before = sorted(folder.iterdir())
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"rtamt: error: {message}")
    assert said.err.endswith("give --missing hold or --missing drop\n")
    assert sorted(folder.iterdir()) == before


def test_known_verdicts_are_explained(folder: Path, capsys: Output) -> None:
    assert folder.is_dir()
    assert main(["explain", "specs.stl", "run.csv", "--missing", "unknown"]) == 1
    said = capsys.readouterr().out
    assert "late:\nnot explained: values of gnt are not known\n" in said
    assert "calm:\nrobustness 5 at 5 s, decided by req < 9 at 5 s\n" in said


@settings(max_examples=examples(60), deadline=None)
@given(
    rows=columns(),
    text=st.sampled_from([f for f in FORMULAS if "once" not in f]),
    end=st.sampled_from(["complete", "cut", "open"]),
    fills=st.lists(st.integers(-4, 4), min_size=12, max_size=12),
)
def test_dense_cell_fillings_stay_within_bounds(
    rows: list[tuple[int | None, int | None]], text: str, end: rtamt.typing.End, fills: list[int]
) -> None:
    rows = [(0, 0), *rows, (0, 0)]
    cells = (["" if cell is None else str(cell) for cell in row] for row in rows)
    lines = [f"{i},{','.join(row)}" for i, row in enumerate(cells)]
    spec = rtamt.parse(text)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        path.write_text("\n".join(["time_s,x,y", *lines]))
        trace, _ = read_ruled(str(path), {"": spec}, EvaluationOptions(dense=True), UNKNOWN)
    assert isinstance(trace, EventTrace)
    assert {*trace.unknown} == {
        name
        for i, name in enumerate("xy")
        if name in spec.variables and any(row[i] is None for row in rows)
    }
    found = judge(spec, trace, None, EvaluationOptions(dense=True, end=end)).found
    left = iter(fills)
    filled = {
        name: [
            (float(t), float(next(left, 0) if row[i] is None else row[i] or 0))
            for t, row in enumerate(rows)
        ]
        for i, name in enumerate("xy")
    }
    whole = rtamt.dense.judge(spec, filled, end)
    assert found.lower <= whole.lower
    assert whole.upper <= found.upper
    assert found.verdict in (whole.verdict, Verdict.UNDECIDED)


def test_events_without_a_number_are_said(folder: Path, capsys: Output) -> None:
    assert folder.is_dir()
    assert main(["monitor", "specs.stl", "run.csv", "--missing", "unknown", "--dense"]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "note: events without a number are unknown (gnt: 1, the first at 6 s)" in said
    assert "late: UNDECIDED, robustness between -1 and inf" in said


def test_message_without_number_is_unknown(
    tmp_path: Path,
) -> None:
    spec = rtamt.parse("""
        from geometry_msgs.msg import Twist
        input Twist cmd
        @ topic(cmd, robot0/cmd_vel)
        out = always(cmd.linear.x > 0.5)
    """)
    speeds = {0: math.nan, 2: 2.0, 5: math.nan, 7: 1.0, 8: 3.0}
    said = [twist(START + second * 10**9, x) for second, x in speeds.items()]
    path = str(write_bag(tmp_path / "run.mcap", said))
    rules = EvaluationOptions(period=Fraction(1))
    trace, period = read_ruled(path, {"": spec}, rules, UNKNOWN)
    assert isinstance(trace, Trace)
    values = trace.columns["cmd.linear.x"].tolist()
    expected = [None, None, 2, 2, 2, None, None, 1, 3]
    assert [None if math.isnan(x) else x for x in values] == expected
    note = "messages without a number leave the value unknown until the next (cmd.linear.x: 2)"
    assert note in trace.notes
    found = judge(spec, trace, period, rules)
    assert found.found.unknown == ("cmd.linear.x",)
    assert (found.found.lower, found.found.upper) == (-math.inf, 0.5)
    assert found.verdict is Verdict.UNDECIDED
