"""Cells and messages without a number as unknown samples, `--missing unknown`."""

from __future__ import annotations

import json
import math
import tempfile
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
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
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled

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
def folder(folder: Path) -> Path:
    (folder / "specs.stl").write_text(SPECS)
    (folder / "run.csv").write_text(TABLE)
    return folder


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
    """The outcome equals the file without the row."""
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


# Tables in which rows would be lost, joined or taken in without a word, with verdicts by hand. ---


INVARIANT = "always(x > 0)"
NOTE = 40 * "a"


def judged(capsys: Output, table: str, *options: str, text: str = INVARIANT) -> tuple[int, str]:
    """Return the exit code and the output on one line, for a table with a semicolon per line."""
    Path("log.csv").write_text(table.replace("; ", "\n") + "\n")
    code = main(["monitor", text, *options, "--", "log.csv"])
    output = capsys.readouterr()
    return code, " ".join((output.out + output.err).split())


@pytest.mark.parametrize("last", ["", 'e"'])
@pytest.mark.parametrize("rows", [1, 300, pytest.param(30_000, marks=pytest.mark.slow)])
def test_quote_over_rows_is_refused(capsys: Output, last: str, rows: int) -> None:
    before = "; ".join(f"{i},1,{NOTE}" for i in range(rows))
    table = f'time,x,note; {before}; {rows},1,"abc; {rows + 1},-1,d; {rows + 2},1,{last}'
    code, text = judged(capsys, table)
    assert code == 2
    assert ("lines that may be rows" if last else "expected the end of a quoted cell") in text
    assert f"{rows + 2}" in text


@pytest.mark.parametrize("note", ['"two; lines"', '"two; ; lines"', '"a ""b"", c"', '5"'])
def test_quoted_cells_are_read(capsys: Output, note: str) -> None:
    code, text = judged(capsys, f"time,x,note; 0,1,{note}; 1,-1,a")
    assert (code, "2 samples" in text) == (1, True)


def test_quoted_cell_over_lines_of_a_long_file(capsys: Output) -> None:
    before = "; ".join(f"{i},1,{NOTE}" for i in range(30_000))
    code, text = judged(capsys, f'time,x,note; {before}; 30000,-1,"two; lines"')
    assert (code, "30001 samples" in text) == (1, True)


LATE = "0,1; 1,1; 2,1; 2.1,-1; 2.2,1; 3,1; 4,1; 5,1"


def test_row_between_resampled_samples_matters(capsys: Output) -> None:
    code, text = judged(capsys, f"time,x; {LATE}", "--jitter", "5%")
    assert code == 2
    assert "log.csv, line 5: SATISFIED if samples are resampled, but this depends on 1 row" in text
    assert judged(capsys, f"time,x; {LATE}", "--dense")[0] == 1


def test_violation_between_rows_that_were_passed(capsys: Output) -> None:
    table = "time,x; 0,1; 1,1; 2,1; 2.7,1; 3,-1; 4,1"
    code, text = judged(capsys, table, "--jitter", "5%")
    assert code == 1
    assert "left out between samples: 1 row with another value, first log.csv, line 5" in text


def test_row_after_the_last_sample_matters(capsys: Output) -> None:
    table = "time,x; 0,1; 1,1; 2,1; 3.3,1; 4.4,1; 5.4,-1"
    assert judged(capsys, table, "--jitter", "5%")[0] == 2


@pytest.mark.parametrize("bound", ["x > -2", "x < 2", "y > 0"])
def test_harmless_rows_between_samples(capsys: Output, bound: str) -> None:
    table = "time,x,y; 0,1,1; 1,1,1; 2,1,1; 2.1,-1,1; 3,1,1; 4,1,1"
    assert judged(capsys, table, "--jitter", "5%", text=f"always({bound})")[0] == 0


@pytest.mark.parametrize(
    "table",
    [
        "name,x; Berlin,1; Paris,1; Rome,1; {},-1",
        "x,note; 1,; 1,; 1,; -1,{}",
        "time,n,x; 0,1,1; 1,2,1; 2,3,1; 3,{},-1",
    ],
)
@pytest.mark.parametrize("name", ["Total", "Grand total:", "mean", "Summe"])
def test_named_row_of_totals_is_refused(capsys: Output, table: str, name: str) -> None:
    code, text = judged(capsys, table.format(name), text="eventually(x < 0)")
    assert code == 2
    assert f"'{name}' in" in text
    options = ("--one-trace",)
    assert judged(capsys, table.format(name), *options, text="eventually(x < 0)")[0] == 0


@pytest.mark.parametrize("last", ["max", "count"])
def test_name_of_a_statistic_next_to_numbers(capsys: Output, last: str) -> None:
    table = f"time,n,x; 0,1,1; 1,2,1; 2,{last},-1"
    assert judged(capsys, table, text="eventually(x < 0)")[0] == 2
    states = f"time,fan,x; 0,low,1; 1,high,1; 2,{last},-1"
    assert judged(capsys, states, text="eventually(x < 0)")[0] == 0


def test_group_of_totals_is_refused(capsys: Output) -> None:
    table = "time,id,x; 0,a,1; 1,a,1; 0,b,1; 1,b,1; 1,Total,-1"
    code, text = judged(capsys, table, "--by", "id", text="eventually(x < 0)")
    assert code == 2
    assert "names a row of totals" in text


@pytest.mark.parametrize("column", ["frame", "step", "index"])
def test_missing_row_numbers_are_refused(capsys: Output, column: str) -> None:
    table = f"{column},x; 0,1; 1,1; 5,1; 6,-1"
    goal = "eventually[0:3](x < 0)"
    code, text = judged(capsys, table, text=goal)
    assert code == 2
    assert f"line 4: expected rows at even distances in '{column}', got 5 after 1" in text
    assert judged(capsys, table, "--period", "1", text=goal)[0] == 0
    options = ("--time", column, "--time-unit", "s", "--max-gap", "1")
    assert judged(capsys, table, *options, text=goal)[0] == 3


def test_even_row_numbers_count_rows(capsys: Output) -> None:
    assert judged(capsys, "x,step; 1,0; 1,10; -1,20", text="eventually[0:2](x < 0)")[0] == 0


IDS = "time,id,x; 0,7.0,1; 1,7,-1; 0,8,1; 1,8,1"


@pytest.mark.parametrize("options", [("--by", "id"), ("--where", "id=7"), ("--where", "id=7.0")])
def test_number_of_an_object_in_two_writings(capsys: Output, options: tuple[str, ...]) -> None:
    code, text = judged(capsys, IDS, *options)
    assert code == 2
    assert "the column 'id' has '7' and '7.0', which may be one object or two" in text


def test_wide_number_of_an_object_in_two_writings(capsys: Output) -> None:
    options = ("--wide", "id", "--signal", "a=x.7")
    assert judged(capsys, IDS, *options, text="always(a > 0)")[0] == 2


@pytest.mark.parametrize("options", [("--by", "id"), ("--where", "id=007")])
def test_leading_zeros_are_other_objects(capsys: Output, options: tuple[str, ...]) -> None:
    table = "time,id,x; 0,007,1; 1,007,1; 0,7,1; 1,7,1; 0,7.5,1; 1,7.5,1"
    assert judged(capsys, table, *options)[0] == 0


RUNS = "time,run,name,x; 0,1,E,1; 0,1,F,1; 1,1,E,1; 1,1,F,1; 2,2,E,1; 2,2,F,1; 3,2,E,1; 3,2,F,-1"


def test_wide_table_of_several_runs_is_refused(capsys: Output) -> None:
    goal = "eventually(x.F < 0)"
    code, text = judged(capsys, RUNS, "--wide", "name", text=goal)
    assert code == 2
    assert "expected one trace of 'E', got 2 values of 'run'" in text
    assert judged(capsys, RUNS, "--wide", "name", "--by", "run", text=goal)[0] == 1
    assert judged(capsys, RUNS, "--wide", "name", "--one-trace", text=goal)[0] == 0


def test_wide_table_with_a_second_name_of_objects(capsys: Output) -> None:
    table = RUNS.replace("run", "vehicle_id").replace(",2,E", ",1,E").replace(",1,F", ",2,F")
    assert judged(capsys, table, "--wide", "name", text="eventually(x.F < 0)")[0] == 0


TWO = "time,id,x; 0,a,1; 5,a,1; {}"
OTHERS = "; ".join(f"{i},b,1" for i in range(6))


@pytest.mark.parametrize("text", ["always[0:5](x > 0)", "always(x > 0)"])
def test_two_rows_with_a_step_or_a_gap(capsys: Output, text: str) -> None:
    table = TWO.format(OTHERS)
    code, output = judged(capsys, table, "--by", "id", text=text)
    assert code == 2
    assert "line 3: expected samples at even distances, got time 5 after 0, elsewhere 1 s" in output
    assert "--period 5s for this trace alone if 5s is its step, --max-gap 1s" in output
    assert judged(capsys, table, "--by", "id", "--max-gap", "1s", text=text)[0] == 3
    assert main(["monitor", text, "--period", "5s", "--", "log.csv[id=a]"]) == 0


@pytest.mark.parametrize(
    "others", ["0,b,1; 5,b,1", "0,b,1; 1,b,1; 0,c,1; 1,c,1", "0,b,1; 5,b,1; 10,b,1", "1,b,1"]
)
def test_two_rows_without_a_shorter_step(capsys: Output, others: str) -> None:
    assert judged(capsys, TWO.format(others), "--by", "id", text=INVARIANT)[0] == 0


def test_dates_of_two_rows_with_a_step_or_a_gap(capsys: Output) -> None:
    day = "2024-05-01T00:00:0"
    table = f"time,id,x; {day}0,a,1; {day}5,a,1; " + "; ".join(f"{day}{i},b,1" for i in range(6))
    assert judged(capsys, table, "--by", "id")[0] == 2


COUNTING = ["always[0:1](x > 0)", "always(next(x > 0))"]
"""Formulas that relate neighbouring rows if there are no times."""


@pytest.mark.parametrize("text", COUNTING)
@pytest.mark.parametrize(
    ("table", "line"),
    [
        ("mode,x; on,1; on,1; off,-1; on,1; on,1", 5),
        ("mode,x; on,1; off,-1; on,1; off,-1", 4),
        ("mode,x; on,1; off,-1; off,1; on,1; off,1; off,1; on,1", 5),
        ("mode,x; on,1; off,-1; on,1", 4),
        ("mode,x; on,1; off,-1; 7.0,1; on,1", 5),
    ],
)
def test_selection_between_counted_rows(capsys: Output, table: str, line: int, text: str) -> None:
    options = ("--where", "mode=on")
    code, output = judged(capsys, table, *options, text=text)
    assert code == 2
    assert f"line {line}: --where leaves out rows before this one" in output
    assert judged(capsys, table, *options, "--one-trace", text=text)[0] in {0, 3}
    assert judged(capsys, table, *options)[0] == 0  # counts nothing
    numbers = table.replace("on", "7.0").replace("off", "8")
    assert judged(capsys, numbers, "--where", "mode=7.0", text=text)[0] == 2


@pytest.mark.parametrize("text", COUNTING)
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_selection_between_counted_rows_of_groups(capsys: Output, text: str, suffix: str) -> None:
    rows = ["a,on,1", "b,on,1", "a,off,-1", "b,on,1", "a,on,1", "b,off,1"]
    frame = pd.DataFrame([row.split(",") for row in rows], columns=["id", "mode", "x"])
    frame["x"] = frame["x"].astype(float)
    getattr(frame, f"to_{suffix}")(f"log.{suffix}", index=False)
    arguments = ["monitor", text, "--by", "id", "--where", "mode=on"]
    assert main([*arguments, "--", f"log.{suffix}"]) == 2
    output = capsys.readouterr()
    fault = "--where leaves out rows before this one"
    assert (output.out + output.err).count(fault) == 1  # of a, not of b
    assert main([*arguments, "--one-trace", "--", f"log.{suffix}"]) in {0, 3}
    assert main(["monitor", INVARIANT, *arguments[2:], "--", f"log.{suffix}"]) == 0


def test_selection_of_sorted_groups_between_counted_rows(capsys: Output) -> None:
    frame = pd.DataFrame({"id": list("aaabbb"), "mode": list("iiikok"), "x": 1.0})
    frame.to_parquet("log.parquet", index=False)
    arguments = ["monitor", "always[0:1](x > 0)", "--by", "id", "--sorted", "--where"]
    assert main([*arguments, "mode=k", "--", "log.parquet"]) == 2
    assert "--where leaves out rows before this one" in "".join(capsys.readouterr())
    assert main([*arguments, "mode=i", "--", "log.parquet"]) == 0


def test_selection_of_an_object_between_counted_rows(capsys: Output) -> None:
    table = "car,x; a,1; b,-1; b,-1; a,1"
    assert judged(capsys, table, "--where", "car=a", text="always[0:1](x > 0)")[0] == 0


SELECTED = (
    "run,car,mode,x; 7,1,on,1; 7,2,on,1; 7,1,off,-1; 7,2,on,1; 7,1,on,1; 7,2,on,1; 7,2,on,1; "
    "7,2,on,1"
)
"""Only the rows of object 1 have a row that ``--where mode=on`` leaves out."""


@pytest.mark.parametrize("more", [(), ("--by", "car"), ("--by", "run")])
@pytest.mark.parametrize(("car", "code"), [("1", 2), ("2", 0)])
def test_selection_of_an_object_and_a_state(
    capsys: Output, more: tuple[str, ...], car: str, code: int
) -> None:
    options = ("--where", "mode=on", "--where", f"car={car}")
    got, text = judged(capsys, SELECTED, *options, *more, text="always[0:1](x > 0)")
    assert got == code, text
    assert ("line 6: --where leaves out rows before this one" in text) == (code == 2)


def test_two_rows_of_an_object_and_a_state_are_not_a_step(capsys: Output) -> None:
    table = "time,car,mode,x; 0,1,on,1; 0,2,on,1; 1,1,off,-1; 1,2,on,1; 2,1,on,1; 2,2,on,1"
    options = ("--where", "mode=on", "--where", "car=1")
    code, text = judged(capsys, table, *options, text="always[0:1](x > 0)")
    assert code == 2, text
    assert "expected samples at even distances, got time 2 after 0, elsewhere 1 s" in text
    assert "the condition in the requirement instead of --where" in text
    assert "--period" not in text  # it would overlook the row between


def test_dropped_row_between_counted_rows(capsys: Output) -> None:
    table = "x,y; 1,1; ,1; 1,1; 1,1; -1,1"
    goal = "eventually[0:3](x < 0)"
    code, text = judged(capsys, table, "--missing", "drop", text=goal)
    assert code == 2
    assert "line 4: --missing drop leaves out the row before this one" in text
    assert judged(capsys, table, "--missing", "drop", "--one-trace", text=goal)[0] == 0
    assert judged(capsys, "x,y; ,1; 1,1; -1,1", "--missing", "drop", text=goal)[0] == 0


@pytest.mark.parametrize(
    ("table", "options"),
    [
        ("time,x; 0,1; 1,; 2,1", ("--missing", "drop")),
        ("time,id,x; 0,a,1; 1,a,; 2,a,1; 0,b,1; 1,b,1; 2,b,1", ("--missing", "drop", "--by", "id")),
        ("time,mode,x; 0,on,1; 1,off,-1; 2,on,1", ("--where", "mode=on")),
    ],
)
def test_two_rows_that_stay_are_not_a_step(
    capsys: Output, table: str, options: tuple[str, ...]
) -> None:
    code, text = judged(capsys, table, *options, text="always[0:2](x > 0)")
    assert code == 2
    assert "expected samples at even distances, got time 2 after 0, elsewhere 1 s" in text
    more = ("--max-gap", "1s") if "--where" in options else ("--missing", "unknown")
    assert judged(capsys, table, *options, *more, text="always[0:2](x > 0)")[0] == 3


def test_rows_that_stay_at_an_even_step(capsys: Output) -> None:
    table = "time,x; 0,1; 1,; 2,1; 3,; 4,1"
    assert judged(capsys, table, "--missing", "drop", text="always[0:4](x > 0)")[0] == 0


@pytest.mark.parametrize("options", [(), ("--dense",), ("--dense", "--one-trace")])
def test_names_without_rows(capsys: Output, options: tuple[str, ...]) -> None:
    code, text = judged(capsys, "x,y,z", *options, text="always[0:1](x > 0)")
    assert code == 2
    assert "unexpected" not in text
