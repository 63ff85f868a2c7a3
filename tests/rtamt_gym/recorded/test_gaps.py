"""Holes in recordings: their description in the head, and `--max-gap`, which makes them unknown."""

from __future__ import annotations

import itertools
import json
import tempfile
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from bags import START, Said, twist, write_bag
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from profiles import examples

import rtamt
from rtamt import InputError
from rtamt_gym import EvaluationOptions, simulate
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns, read_seconds
from rtamt_gym.recorded.judge import extent_of, judge
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled

FORMULAS = [
    "always(x > 1 implies eventually[0:1](y > 0))",
    "eventually(x > 0 and once[0:1](y < 1))",
    "(x > -1) until[0:2] (y > 0)",
    "always[0:2](x > y)",
    "eventually[2:4](x > 1)",
]
Output = pytest.CaptureFixture[str]


def write(
    rows: Sequence[tuple[float, ...]], path: str | Path = "run.csv", head: str = "time,x"
) -> str:
    lines = [",".join(f"{cell:.15g}" for cell in row) for row in rows]
    Path(path).write_text("\n".join([head, *lines]))
    return str(path)


def read(path: str | Path, columns: Columns, text: str = "always(x > 0)") -> Trace:
    trace, _ = read_ruled(str(path), {"": rtamt.parse(text)}, EvaluationOptions(), columns)
    assert isinstance(trace, Trace)
    return trace


# The head says what was recorded. -----------------------------------------------------------------


@settings(max_examples=examples(40), deadline=None)
@given(
    step=st.sampled_from(["0.1", "0.5", "2", "0.04"]),
    start=st.sampled_from([0, 5, 1_700_000_000]),
    count=st.integers(4, 30),
    data=st.data(),
)
def test_header_counts_match_file(step: str, start: int, count: int, data: st.DataObject) -> None:
    kept = sorted(data.draw(st.sets(st.integers(0, count), min_size=3, max_size=count)))
    times = [Fraction(float(start + k * Fraction(step))) for k in kept]  # as the file has them
    with tempfile.TemporaryDirectory() as folder:
        path = write([(float(t), 1.0) for t in times], Path(folder) / "run.csv", "time_s,x")
        specs = {"": rtamt.parse("always(x > 0)")}
        trace, _ = read_ruled(path, specs, EvaluationOptions(dense=True), Columns())
        found = extent_of(trace)
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert found.events == len(kept)
    assert found.gap is not None
    assert found.gap.seconds == pytest.approx(float(max(gaps)))
    assert found.length == pytest.approx(float(times[-1] - times[0]))
    assert found.gap.usual == pytest.approx(float(np.median([float(gap) for gap in gaps])))
    longest = [float(t) for t, gap in zip(times, gaps, strict=False) if gap == max(gaps)]
    assert any(found.gap.begin == pytest.approx(t) for t in longest)


HEADS = {
    "sampled": (
        [(i / 2, 1.0) for i in range(7)],
        [],
        "run.csv: 7 samples, one every 0.5 s, 0 s to 3 s, 3 s long, longest gap 0.5 s",
    ),
    "one sample": ([(0.5, 1.0)], [], "run.csv: 1 sample, 0.5 s to 0.5 s, 0 s long"),
    "dense": (
        [(0.0, 1.0), (0.5, 1.0), (2.0, 1.0)],
        ["--dense"],
        "run.csv: 3 events, 0 s to 2 s, 2 s long, longest gap 1.5 s",
    ),
    "one event": ([(0.5, 1.0)], ["--dense"], "run.csv: 1 event, 0.5 s to 0.5 s, 0 s long"),
    "a period": (
        [(i / 2, 1.0) for i in range(7)],
        ["--period", "500ms"],
        "run.csv: 7 samples, one every 0.5 s, 0 s to 3 s, 3 s long, longest gap 0.5 s",
    ),
}


@pytest.mark.parametrize(("rows", "options", "head"), HEADS.values(), ids=HEADS)
def test_header_states_length_and_gap(
    rows: list[tuple[float, ...]], options: list[str], head: str, capsys: Output
) -> None:
    assert main(["monitor", "always(x > 0)", write(rows), *options]) == 0
    assert capsys.readouterr().out.splitlines()[2] == head


def test_gaps_are_per_variable(capsys: Output) -> None:
    Path("run.csv").write_text("time,x,y\n0,1,1\n0.5,1,\n1,1,\n1.5,1,1\n2,1,1\n")
    assert main(["monitor", "always(x > 0 and y > 0)", "run.csv", "--missing", "hold"]) == 0
    assert ", 2 s long, longest gap 1.5 s of y\n" in " ".join(
        capsys.readouterr().out.splitlines(keepends=True)[2:4]
    ).replace("\n   ", ", ")


HOLE = [(i / 10, 5.0) for i in range(200) if not 50 <= i < 160]
LONG = (
    "note: nothing was recorded for 11.1 s after 4.9 s, 111 usual steps: the last\n"
    "  values hold; --max-gap limits for how long\n"
)


@pytest.mark.parametrize("options", [["--dense"], ["--jitter", "5%"]])
def test_a_long_gap_is_noted_in_every_format(options: list[str], capsys: Output) -> None:
    write(HOLE)
    assert main(["monitor", "always(x > 0)", "run.csv", *options]) == 0
    assert LONG in capsys.readouterr().out
    files = ["--junit", "o.xml", "--markdown", "o.md"]
    write([(i / 10, 5.0) for i in range(20)], "short.csv")
    words = ["monitor", "always(x > 0)", *options, *files, "--", "short.csv", "run.csv"]
    assert main(words) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "note on run.csv: nothing was recorded for 11.1 s after 4.9 s, 111 usual steps" in said
    assert (
        "gaps of more than 10 usual steps in 1 of 2 traces, the longest 11.1 s in run.csv" in said
    )
    for path in ("o.xml", "o.md"):
        assert "nothing was recorded for 11.1 s after 4.9 s" in Path(path).read_text()
    assert main(["monitor", "always(x > 0)", "run.csv", "--json", *options]) == 0
    (trial,) = json.loads(capsys.readouterr().out)["trials"]
    assert any("nothing was recorded for 11.1 s" in note for note in trial["notes"])
    assert trial["extent"]["gap"] == pytest.approx({"seconds": 11.1, "begin": 4.9, "usual": 0.1})


@pytest.mark.parametrize("steps", [10, 11])
def test_a_gap_is_long_above_ten_usual_steps(steps: int, capsys: Output) -> None:
    times = [*range(8), *(7 + steps + i for i in range(8))]
    write([(t / 2, 1.0) for t in times])
    assert main(["monitor", "always(x > 0)", "run.csv", "--dense"]) == 0
    assert ("nothing was recorded for" in capsys.readouterr().out) is (steps > 10)


# A time column beside --period, and one without a unit. -------------------------------------------


@pytest.mark.parametrize(
    ("rows", "period", "said"),
    [
        ([(i / 10, 1.0) for i in range(10)], "0.1", None),
        ([(i / 10 + 0.003 * (i % 2), 1.0) for i in range(10)], "100ms", None),
        (
            [(i / 10, 1.0) for i in range(10)],
            "0.2",
            "0.1 s apart most of the time: 0.9 s in all, not 1.8 s",
        ),
        (
            [(0.0, 1.0), (0.1, 1.0), (0.2, 1.0), (36000.2, 1.0)],
            "0.1",
            "0.1 s apart most of the time, 36000 s after run.csv, line 4: 36000.2 s in all",
        ),
        (
            [(0.0, 1.0), (0.2, 1.0), (0.1, 1.0)],
            "0.1",
            "in an order that does not increase: 0.1 s in all, not 0.2 s",
        ),
    ],
)
@pytest.mark.parametrize("options", [[], ["--missing", "hold"]])
def test_period_contradiction_note(
    rows: list[tuple[float, ...]],
    period: str,
    said: str | None,
    options: list[str],
    capsys: Output,
) -> None:
    assert main(["monitor", "always(x > 0)", write(rows), "--period", period, *options]) == 0
    out = " ".join(capsys.readouterr().out.split())
    head = "note: --period leaves the column 'time' aside, which has the rows "
    assert (head in out) is (said is not None)
    assert said is None or f"{head}{said}" in out


@pytest.mark.parametrize(
    ("column", "step", "options", "noted"),
    [
        ("time", 10, [], 1),
        ("t", 1, ["--dense"], 1),
        ("timestamp", 1, ["--max-gap", "5s"], 1),
        ("time", 0.5, [], 0),
        ("time", 1.5, [], 1),
        ("time", 10, ["--time-unit", "ms"], 0),
        ("time", 10, ["--time-unit", "s"], 0),
        ("time_ms", 10, [], 0),
        ("Time [s]", 1, [], 0),
        ("time", 10, ["--period", "10"], 0),
    ],
)
def test_integer_times_without_unit_note(
    column: str, step: float, options: list[str], noted: int, capsys: Output
) -> None:
    write([(i * step, 1.0) for i in range(1001)], head=f"{column},x")
    assert main(["monitor", "always(x > 0)", "run.csv", *options]) == 0
    said = (
        f"note: the times have no unit and count as seconds, {1000 * step:g} s in all: if these "
        "are milliseconds, --time-unit ms"
    )
    assert " ".join(capsys.readouterr().out.split()).count(said) == noted


def test_late_fractional_time_means_seconds(capsys: Output) -> None:
    write([(i + 0.5 * (i == 150), 1.0) for i in range(200)])
    assert main(["monitor", "always(x > 0)", "run.csv", "--dense"]) == 0
    assert "the times have no unit" not in capsys.readouterr().out


def test_a_saved_run_has_seconds(folder: Path, capsys: Output) -> None:
    levels = [{"level": level} for level in (1.0, 2.0, 1.0)]
    run = simulate(levels, {"dry": "always(level < 3)"}, period=10)
    run.save(folder / "run.parquet")
    assert main(["monitor", "always(level < 3)", "run.parquet"]) == 0
    out = capsys.readouterr().out
    assert "3 samples, one every 10 s, 0 s to 20 s, 20 s long, longest gap 10 s\n" in out
    assert "note:" not in out


# Short traces. ------------------------------------------------------------------------------------


def test_short_trace_exits_with_3(capsys: Output) -> None:
    for name, count in {"a": 21, "b": 5, "c": 3, "d": 4, "e": 5}.items():
        write([(i / 2, 1.0) for i in range(count)], f"{name}.csv")
    words = ["always(x > 0)", "--min-duration", "10s"]
    for command in ("monitor", "explain"):
        assert main([command, *words, "a.csv"]) == 0
        assert "shorter than" not in capsys.readouterr().out
        assert main([command, *words, "b.csv"]) == 3
        assert capsys.readouterr().out.endswith("\nshorter than 10 s: b.csv (2 s)\n")
    assert main(["monitor", *words, "--", *(f"{name}.csv" for name in "abcde")]) == 3
    said = "\nshorter than 10 s: b.csv (2 s), c.csv (1 s), d.csv (1.5 s) and 1 more\n"
    assert capsys.readouterr().out.endswith(said)
    assert main(["monitor", *words, "b.csv", "--json"]) == 3
    out, err = capsys.readouterr()
    assert err == "shorter than 10 s: b.csv (2 s)\n"
    kept = json.loads(out)
    assert kept["exit_code"] == 3
    assert kept["reading"]["min_duration"] == "10"
    assert kept["trials"][0]["extent"]["length"] == 2.0
    assert kept["trials"][0]["notes"] == [
        "constant over the whole trace: x (1)",
        "it lasts 2 s, which is shorter than 10 s (--min-duration)",
    ]
    assert kept["shorter"] == ["b.csv"]
    assert main(["monitor", "always(x > 2)", *words[1:], "b.csv"]) == 1
    write([(0.5, 1.0)], "one.csv")
    assert main(["monitor", *words, "one.csv"]) == 3
    assert capsys.readouterr().out.endswith("\nshorter than 10 s: one.csv (0 s)\n")
    Path("none.csv").write_text("x\n1\n1\n")
    assert main(["monitor", *words, "none.csv"]) == 2
    assert "expected a column of times, by which --min-duration measures" in capsys.readouterr().err
    assert main(["monitor", *words, "none.csv", "--period", "20"]) == 0


def test_files_list_short_traces(capsys: Output) -> None:
    for name, count in {"a": 21, "b": 5, "c": 3}.items():
        write([(i / 2, 1.0) for i in range(count)], f"{name}.csv")
    judged = ["monitor", "always(x > 0)", "--json", "--junit", "o.xml"]

    def files(*more: str) -> tuple[object, dict[str, str | None]]:
        main([*judged, *more, "--", "a.csv", "b.csv", "c.csv", "absent.csv"])
        suites = ET.parse("o.xml").iter("testsuite")  # noqa: S314 - our own
        named = "properties/property[@name='shorter_than']"
        found = {suite.attrib["name"]: suite.find(named) for suite in suites}
        said = {name: None if each is None else each.get("value") for name, each in found.items()}
        return json.loads(capsys.readouterr().out).get("shorter"), said

    names = ("a.csv", "b.csv", "c.csv", "absent.csv")
    nothing = dict.fromkeys(names)
    assert files() == (None, nothing)
    assert files("--min-duration", "1s") == ([], nothing)
    short = nothing | dict.fromkeys(["b.csv", "c.csv"], "2.5 s")
    assert files("--min-duration", "2500ms") == (["b.csv", "c.csv"], short)


# Values are unknown where nothing was recorded. ---------------------------------------------------


@settings(max_examples=examples(60), deadline=None)
@given(
    count=st.integers(8, 16),
    text=st.sampled_from(FORMULAS),
    end=st.sampled_from(["complete", "cut", "open"]),
    data=st.data(),
)
def test_hole_fillings_stay_within_bounds(
    count: int, text: str, end: rtamt.typing.End, data: st.DataObject
) -> None:
    cell = st.integers(-2, 3)
    rows = data.draw(st.lists(st.tuples(cell, cell), min_size=count, max_size=count))
    removed = data.draw(st.sets(st.integers(1, count - 2), min_size=1, max_size=count // 3))
    kept = [k for k in range(count) if k not in removed]
    steps = np.diff(kept)
    assume(float(np.median(steps)) == 1)
    spec = rtamt.parse(text)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        write([(k / 2, *rows[k]) for k in kept], path, "time,x,y")
        columns = Columns(max_gap=Fraction(1, 2))
        trace, period = read_ruled(str(path), {"": spec}, EvaluationOptions(end=end), columns)
    assert isinstance(trace, Trace)
    assert (trace.samples, period) == (count, Fraction(1, 2))
    for name, values in trace.columns.items():
        assert np.flatnonzero(np.isnan(values)).tolist() == sorted(removed), name
    found = judge(spec, trace, period, EvaluationOptions(end=end)).found
    for _ in range(4):
        filled = [
            row if k not in removed else data.draw(st.tuples(cell, cell))
            for k, row in enumerate(rows)
        ]
        signals = {name: [float(row[i]) for row in filled] for i, name in enumerate("xy")}
        whole = rtamt.judge(spec, signals, period, end)
        assert found.lower <= whole.lower
        assert whole.upper <= found.upper
        assert found.verdict in (whole.verdict, rtamt.Verdict.UNDECIDED)


@settings(max_examples=examples(40), deadline=None)
@given(
    count=st.integers(6, 14),
    text=st.sampled_from([f for f in FORMULAS if "once" not in f]),
    end=st.sampled_from(["complete", "cut", "open"]),
    data=st.data(),
)
def test_dense_hole_fillings_stay_within_bounds(
    count: int, text: str, end: rtamt.typing.End, data: st.DataObject
) -> None:
    cell = st.integers(-2, 3)
    rows = data.draw(st.lists(st.tuples(cell, cell), min_size=count, max_size=count))
    removed = data.draw(st.sets(st.integers(1, count - 2), min_size=1, max_size=count - 3))
    spec = rtamt.parse(text)
    with tempfile.TemporaryDirectory() as folder:
        kept = [(k / 2, *row) for k, row in enumerate(rows) if k not in removed]
        path = write(kept, Path(folder) / "run.csv", "time_s,x,y")
        columns = Columns(max_gap=Fraction(1, 2))
        trace, _ = read_ruled(path, {"": spec}, EvaluationOptions(dense=True), columns)
    assert isinstance(trace, EventTrace)
    found = judge(spec, trace, None, EvaluationOptions(dense=True, end=end)).found
    for _ in range(3):
        drawn = {k: data.draw(st.tuples(cell, cell)) for k in sorted(removed)}
        filled = {
            name: [(k / 2, float(drawn.get(k, row)[i])) for k, row in enumerate(rows)]
            for i, name in enumerate("xy")
        }
        whole = rtamt.dense.judge(spec, filled, end)
        assert found.lower <= whole.lower
        assert whole.upper <= found.upper
        assert found.verdict in (whole.verdict, rtamt.Verdict.UNDECIDED)


@given(
    count=st.integers(10, 20), hole=st.integers(2, 9), most=st.integers(1, 12), phase=st.booleans()
)
@settings(max_examples=examples(40), deadline=None)
def test_a_hole_is_unknown_from_its_length_on(
    count: int, hole: int, most: int, *, phase: bool
) -> None:
    late = 0.5 * phase
    times = [*range(count), *(count - 1 + hole + late + k for k in range(count))]
    with tempfile.TemporaryDirectory() as folder:
        path = write([(t, k) for k, t in enumerate(times)], Path(folder) / "run.csv", "time_s,x")
        trace = read(path, Columns(max_gap=Fraction(most)))
    assert trace.period() == 1
    values = trace.columns["x"]
    for at, value in enumerate(values):
        if count - 1 < at < times[count]:
            assert np.isnan(value) if hole + late > most else value == count - 1
        else:
            assert value == max(k for k, t in enumerate(times) if t <= at)


def test_hole_note_and_verdict(capsys: Output) -> None:
    write(HOLE)
    assert main(["monitor", "always(x > 4)", "run.csv", "--max-gap", "1s"]) == 3
    assert capsys.readouterr().out == (
        "UNDECIDED, robustness between -inf and 1\n"
        "    undecided under every --end: it depends on values of x that are not known\n"
        "run.csv: 200 samples, one every 0.1 s, 0 s to 19.9 s\n"
        "  19.9 s long, longest gap 11.1 s\n"
        "note: values are unknown where nothing was recorded for more than 1 s (a hole of\n"
        "  11.1 s after 4.9 s)\n"
        "note: constant over the whole trace: x (5)\n"
        "note: no robustness over time: values of x are not known\n"
    )
    assert main(["monitor", "always[0:3](x > 4)", "run.csv", "--max-gap", "1s"]) == 0
    assert main(["monitor", "always(x > 5)", "run.csv", "--max-gap", "1s"]) == 1
    capsys.readouterr()
    assert main(["monitor", "always(x > 4)", "run.csv", "--max-gap", "20"]) == 0
    said = "note: resampled every 0.1 s: values hold in shorter gaps, the longest of 11.1 s\n"
    assert said in capsys.readouterr().out
    for dense in ([], ["--dense"]):
        words = ["always(x > 4)", "run.csv", "--max-gap", "1s", *dense]
        assert main(["explain", *words]) == 3
        assert "not explained: values of x are not known" in capsys.readouterr().out
        for end in ("open", "cut", "complete"):
            assert main(["monitor", *words, "--end", end]) == 3
        assert main(["monitor", "always[0:3](x > 4)", *words[1:]]) == 0
        assert main(["monitor", "always(x > 5)", *words[1:]]) == 1
        capsys.readouterr()


def test_cells_hold_for_no_longer_than_the_gap() -> None:
    rows = [f"{i / 10},5,{'' if 10 <= i < 30 or i in (40, 41) else 1}" for i in range(50)]
    Path("run.csv").write_text("\n".join(["time,x,y", *rows]))
    trace = read("run.csv", Columns(missing="hold", max_gap=Fraction(1)), "always(x > y)")
    assert np.flatnonzero(np.isnan(trace.columns["y"])).tolist() == list(range(10, 30))
    assert not np.isnan(trace.columns["x"]).any()
    assert trace.unknown == ["y"]
    hole = "a hole of 2.1 s after 0.9 s"
    assert trace.notes == [
        f"values are unknown where nothing was recorded for more than 1 s (y: {hole})",
        "empty cells hold the value before (y: 2)",
    ]
    Path("end.csv").write_text(
        "time,x\n" + "\n".join(f"{i},{1 if i < 3 else ''}" for i in range(9))
    )
    trace = read("end.csv", Columns(missing="hold", max_gap=Fraction(2), time_unit="s"))
    assert np.flatnonzero(np.isnan(trace.columns["x"])).tolist() == list(range(3, 9))


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("x\n1\n1\n", ["--max-gap", "1"], "expected a column of times, which --max-gap needs"),
        ("time,x\n0,1\n1,1\n", ["--max-gap", "1", "--period", "1"], "or --max-gap"),
        ("time,x\n0,1\n1,1\n", ["--max-gap", "0"], "--max-gap: expected a time above 0, such as"),
        ("time,x\n0,1\n1,1\n", ["--max-gap", "5 days"], "--max-gap: expected a time above 0"),
        ("time,x\n0,1\n1,1\n", ["--min-duration", "-1"], "--min-duration: expected a time above 0"),
        ("time,x\n0,1\n1,1\n", ["--max-gap", "1", "--out", "o.csv"], "--max-gap: --out needs the"),
        (
            "time,x\n0,1\n1,1\n1.3,1\n2.9,1\n4,1\n5,1\n",
            ["--max-gap", "1"],
            "expected samples at even distances, got time 1.3 after 1",
        ),
        (
            "time,x\n0,1\n0.1,1\n0.2,1\n1000000,1\n1000000.1,1\n",
            ["--max-gap", "1"],
            "expected a gap that can be resampled every 0.1 s, got 1e+06 s; cut the trace there",
        ),
        (
            "time,x\n0,1\n20,1\n40,1\n",
            ["--max-gap", "1s"],
            "got 1 s where samples are 20 s apart; the times have no unit and count as seconds, ",
        ),
        (
            "time,x\n0,1\n0.1,1\n0.2,1\n9,1\n9.1,1\n9.2,1\n",
            [],
            "or --max-gap 0.1s to take holes for unknown",
        ),
    ],
)
def test_what_no_gap_can_be_told_of_is_refused(
    text: str, options: list[str], said: str, capsys: Output
) -> None:
    Path("run.csv").write_text(text)
    assert main(["monitor", "always(x > 0)", "run.csv", *options]) == 2
    assert said.replace("or --max-gap 0.1s", "--max-gap 0.1s") in capsys.readouterr().err


def test_durations_with_units() -> None:
    texts = {"10": 10.0, "10s": 10.0, "500ms": 0.5, "1.5h": 5400.0, "2 min": 120.0, "5e-1": 0.5}
    assert [read_seconds("--x", text) for text in texts] == [*texts.values()]
    assert Columns(max_gap="1/2").max_gap == Fraction(1, 2)  # type: ignore[arg-type]
    for text in ("", "s", "-1", "nan", "inf", "1/0", "1 day", "٣", "1e999"):
        with pytest.raises(InputError, match="expected a time above 0"):
            read_seconds("--x", text)


def test_silent_topic_is_unknown_after_gap(folder: Path, capsys: Output) -> None:
    said = [twist(START + i * 10**8, 0.5) for i in (*range(20), *range(60, 80))]
    path = str(write_bag(folder / "quiet.bag", said))
    text = "cmd = always(speed < 1)"
    words = [text, path, "--period", "0.1", "--signal", "speed=/robot0/cmd_vel.linear.x"]
    assert main(["monitor", *words]) == 0
    assert "longest gap 4.1 s\n" in capsys.readouterr().out
    assert main(["monitor", *words, "--max-gap", "1s"]) == 3
    out = " ".join(capsys.readouterr().out.split())
    assert "for more than 1 s (a hole of 4.1 s after 1.9 s)" in out
    assert "is held for" not in out
    columns = Columns({"speed": "/robot0/cmd_vel.linear.x"}, max_gap=Fraction(1))
    spec = rtamt.parse(text)
    trace, _ = read_ruled(path, {"": spec}, EvaluationOptions(period=Fraction(1, 10)), columns)
    assert isinstance(trace, Trace)
    assert np.flatnonzero(np.isnan(trace.columns["speed"])).tolist() == list(range(20, 60))
    assert main(["monitor", text, path, "--dense", *words[4:], "--max-gap", "1s"]) == 3
    assert "(a hole of 4.1 s after 1.9 s)" in " ".join(capsys.readouterr().out.split())


def test_a_topic_with_one_message_has_no_hole(folder: Path) -> None:
    said = [twist(START + i * 10**8, 0.5) for i in (0, 20)]
    said.append(Said(START + 20 * 10**8, "/v", "std_msgs/Float64", {"data": 1.0}))
    path = str(write_bag(folder / "once.bag", said))
    signals = {"speed": "/robot0/cmd_vel.linear.x", "v": "/v.data"}
    columns = Columns(signals, max_gap=Fraction(1))
    spec = rtamt.parse("always(speed < v)")
    trace, _ = read_ruled(path, {"": spec}, EvaluationOptions(period=Fraction(1, 10)), columns)
    assert isinstance(trace, Trace)
    known = trace.known(spec.variables).columns
    assert {name: values.tolist() for name, values in known.items()} == {"speed": [0.5], "v": [1.0]}
    assert trace.notes[-1].endswith("more than 1 s (speed: a hole of 2 s after 0 s)")


def test_topic_is_unknown_after_last_message(folder: Path, capsys: Output) -> None:
    said = [twist(START + i * 10**8, 0.5) for i in range(20)]
    said.append(Said(START + 5 * 10**9, "/name", "std_msgs/String", {}))
    path = str(write_bag(folder / "ends.bag", said))
    words = [path, "--signal", "speed=/robot0/cmd_vel.linear.x", "--max-gap", "1s"]
    for time in (["--dense"], ["--period", "0.1"]):
        assert main(["monitor", "always(speed < 1)", *words, *time]) == 3
        assert "(a hole of 3.1 s after 1.9 s)" in " ".join(capsys.readouterr().out.split())
        assert main(["monitor", "always[0:1](speed < 1)", *words, *time]) == 0
        assert main(["monitor", "always(speed < 1)", *words[:3], *time]) == 0
        capsys.readouterr()


@pytest.mark.parametrize(
    ("times", "most"),
    [
        ("0 0.1 0.2 0.3 0.4 1.1", "0.7"),
        ("1000.1 1000.2 1000.3 1000.6 1000.7", "300ms"),
        ("1700000000.1 1700000000.2 1700000000.3 1700000000.6", "0.3"),
    ],
)
@pytest.mark.parametrize("dense", [(), ("--dense",)])
def test_gap_of_exactly_the_maximum_is_no_hole(
    folder: Path, capsys: Output, times: str, most: str, dense: tuple[str, ...]
) -> None:
    rows = "".join(f"{time},1\n" for time in times.split())
    (folder / "exact.csv").write_text(f"time,x\n{rows}")
    assert main(["monitor", "always(x > 0)", "exact.csv", "--max-gap", most, *dense]) == 0
    assert "a hole of" not in capsys.readouterr().out
    less = f"{float(most.removesuffix('ms')) * 0.999:.9g}{'ms' * most.endswith('ms')}"
    assert main(["monitor", "always(x > 0)", "exact.csv", "--max-gap", less, *dense]) == 3


def test_hold_of_exactly_the_maximum_is_no_hole(folder: Path) -> None:
    (folder / "exact.csv").write_text("time,x\n0,1\n0.1,1\n0.2,\n0.3,\n0.4,1\n0.5,1\n")
    options = ["--max-gap", "0.3", "--missing", "hold"]
    assert main(["monitor", "always(x > 0)", "exact.csv", *options]) == 0


@pytest.mark.parametrize("digits", [1, 3, 7])
@pytest.mark.parametrize("dense", [(), ("--dense",)])
def test_rounded_steps_since_1970_are_no_holes(
    folder: Path, capsys: Output, dense: tuple[str, ...], digits: int
) -> None:
    times = [1_700_000_000 + i * 0.1 for i in range(30)]
    (folder / "since.csv").write_text("time,x\n" + "".join(f"{t:.{digits}f},1\n" for t in times))
    options = ["since.csv", "--max-gap", "100ms", *dense]
    assert main(["monitor", "always(x > 0)", *options]) == 0
    assert "unknown" not in capsys.readouterr().out
