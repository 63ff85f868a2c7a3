"""In dense time a value holds to its next event or to the end of the recording."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal
from bags import START, Said, twist, write_bag
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.io import savemat
from ulogs import Topic, Ulog

import rtamt
from rtamt import InputError, Verdict
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import TraceJudgement, judge, noticed
from rtamt_gym.recorded.times import one_record, same_as_before
from rtamt_gym.recorded.trace import EventTrace, Trace, held
from rtamt_gym.recorded.trace_files import read_ruled

Table = Mapping[str, NDArray[np.float64]]
Write = Callable[[Path, Table], object]
Lines = Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]

T = np.arange(100) / 10
LINES: Lines = {
    "z": (T, np.where(T == 6, -500.0, -10.0)),
    "home": (T[:1], np.zeros(1)),
    "a": (T, np.where(T == 1, -5.0, 1.0)),
    "b": (T[20:], np.full(80, 5.0)),
    "tail": (np.array([0.0, 12.0]), np.ones(2)),
}
"""home is recorded once, b starts at 2 s, and tail, which nothing reads, lasts to 12 s."""


def table(lines: Lines) -> dict[str, NDArray[np.float64]]:
    """Return the columns of lines as a table; a cell without an event is nan."""
    times = np.unique(np.concatenate([line for line, _ in lines.values()]))
    columns = {name: np.full(len(times), np.nan) for name in lines}
    for name, (line, values) in lines.items():
        columns[name][np.searchsorted(times, line)] = values
    return {"time": times, **columns}


def write_csv(path: Path, columns: Table) -> None:
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    cells = (",".join("" if np.isnan(cell) else repr(cell) for cell in row) for row in rows)
    path.write_text("\n".join([",".join(columns), *cells, ""]))


def write_lines(path: Path, columns: Table) -> None:
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    given = ({n: c for n, c in zip(columns, row, strict=True) if not np.isnan(c)} for row in rows)
    path.write_text("\n".join(map(json.dumps, given)))


def write_parquet(path: Path, columns: Table) -> None:
    arrays = {name: pa.array(column, from_pandas=True) for name, column in columns.items()}
    pq.write_table(pa.table(arrays), path)


TABLES: Mapping[str, Write] = {
    ".csv": write_csv,
    ".jsonl": write_lines,
    ".parquet": write_parquet,
    ".npz": lambda path, columns: np.savez(path, allow_pickle=False, **columns),
    ".mat": lambda path, columns: savemat(path, dict(columns)),
}


def write_mdf(path: Path, lines: Lines) -> None:
    with MDF(version="3.30" if path.suffix == ".mdf" else "4.10") as file:
        for name, (times, values) in lines.items():
            file.append(Signal(values, times, name=name))
        file.save(path, overwrite=True)


def write_log(path: Path, lines: Lines) -> None:
    log = Ulog()
    events = [(t, name, v) for name, line in lines.items() for t, v in zip(*line, strict=True)]
    for time, name, value in sorted(events):
        log.data(Topic(name, (("double", "v"),)), 1_000_000 + round(time * 1e6), [value])
    log.save(path)


def write_topics(path: Path, lines: Lines) -> None:
    said = [
        Said(round(t * 1e9), f"/rtamt/{name}", "std_msgs/Float64", {"data": float(v)})
        for name, line in lines.items()
        for t, v in zip(*line, strict=True)
    ]
    write_bag(path, sorted(said, key=lambda each: each.time))


def write(path: Path, lines: Lines) -> None:
    if path.suffix in (".mf4", ".mdf"):
        write_mdf(path, lines)
    elif path.suffix == ".ulg":
        write_log(path, lines)
    elif path.suffix in (".mcap", ".bag"):
        write_topics(path, lines)
    else:
        TABLES[path.suffix](path, table(lines))


def read(path: Path, spec: rtamt.Specification, columns: Columns) -> EventTrace:
    fields = {v: f"{v}.v" for v in spec.variables} if path.suffix == ".ulg" else {}
    columns = Columns(fields, max_gap=columns.max_gap, start=columns.start)
    trace, _ = read_ruled(str(path), {"": spec}, EvaluationOptions(dense=True), columns)
    assert isinstance(trace, EventTrace)
    return trace


def judged(path: Path, text: str, columns: Columns | None = None) -> TraceJudgement:
    spec = rtamt.parse(text)
    return judge(spec, read(path, spec, columns or Columns()), None, EvaluationOptions(dense=True))


@pytest.mark.parametrize(
    "ending",
    [".csv", ".jsonl", ".parquet", ".npz", ".mat", ".mf4", ".mdf", ".ulg", ".mcap", ".bag"],
)
def test_formats_share_the_extent_of_a_recording(ending: str, tmp_path: Path) -> None:
    path, start = tmp_path / f"run{ending}", 1.0 if ending == ".ulg" else 0.0
    write(path, LINES)
    silent = judged(path, "always(z - home > -100)")
    assert (silent.verdict, silent.found.robustness) == (Verdict.VIOLATED, -400.0)
    assert silent.found.decided_at == pytest.approx(start + 6)
    last = judged(path, "eventually[11:11](z < 0)")
    assert last.verdict is Verdict.SATISFIED
    unknown = judged(path, "eventually[11:11](z < 0)", Columns(max_gap=Fraction(1)))
    assert (unknown.verdict, unknown.found.unknown) == (Verdict.UNDECIDED, ("z",))
    late = judged(path, "always(a > 0 and b > 0)")
    assert late.late_start is not None
    assert (late.verdict, late.late_start.of, late.late_start.before) == (-1, ("b",), 20)
    known = judged(path, "always(a > 0 and b > 0)", Columns(start="known"))
    assert known.late_start is not None
    assert (known.verdict, known.late_start.left_out) == (Verdict.SATISFIED, 20)
    alone = judged(path, "always(b > 0)")
    assert alone.late_start is not None
    assert alone.verdict is Verdict.SATISFIED
    assert alone.late_start.time == pytest.approx(start + 2)
    trace = read(path, rtamt.parse("always(b > 0)"), Columns())
    assert trace.span == pytest.approx((start, start + 12))
    assert trace.events == 80


def csv(path: Path, **lines: list[tuple[float, float]]) -> Path:
    series = {name: (np.array(line)[:, 0], np.array(line)[:, 1]) for name, line in lines.items()}
    write_csv(path, table(series))
    return path


B = [(2.0, 5.0), (3.0, 5.0), (4.0, 5.0)]


@pytest.mark.parametrize(
    ("text", "a", "verdicts"),
    [
        ("always(a > 0 and b > 0)", [(0, 1), (1, -5), (2, 1)], "VIOLATED SATISFIED"),
        ("always(a > 0 and b > 0)", [(0, 1), (1, 1), (2, 1)], "UNDECIDED SATISFIED"),
        ("eventually(a > 0 and b > 0)", [(0, 1), (1, -5), (2, 1)], "SATISFIED SATISFIED"),
        ("always(a > 0 or b > 0)", [(0, 1), (1, 1), (2, -1)], "SATISFIED SATISFIED"),
        ("always(a > 0 or b > 0)", [(0, 1), (1, -1), (2, -1)], "UNDECIDED SATISFIED"),
        ("always(b < 0 or historically(a > 0))", [(0, -1), (1, 1)], "VIOLATED SATISFIED"),
        ("always(b > 0 implies once(a > 0))", [(0, 1), (1, -1)], "VIOLATED VIOLATED"),
        ("always(b > 9 and a > 0)", [(0, 1), (1, 1)], "VIOLATED VIOLATED"),
        ("eventually[0:2](a > 0 and b > 0)", [(0, -1), (3, 1)], "VIOLATED SATISFIED"),
    ],
)
def test_late_start_reports_the_worse_verdict(
    text: str, a: list[tuple[float, float]], verdicts: str, tmp_path: Path
) -> None:
    path = csv(tmp_path / "late.csv", a=a, b=B)
    found = judged(path, text), judged(path, text, Columns(start="known"))
    assert " ".join(each.verdict.name for each in found) == verdicts
    # The definition of the library, on the same events.
    before = {"a": [*a, (4, a[-1][1])], "b": B}
    assert found[1].verdict is rtamt.dense.judge(text, before).verdict
    unknown = {**before, "b": [(0.0, np.nan), *B]}
    with_beginning = rtamt.dense.judge(text, unknown, nan="unknown").verdict
    assert found[0].verdict is min(found[1].verdict, with_beginning)


def test_other_requirements_keep_their_own_start(tmp_path: Path) -> None:
    path = csv(tmp_path / "late.csv", a=[(0, 1), (1, -5), (3, 1)], b=B)
    specs = {"a": rtamt.parse("always(a > -9)"), "b": rtamt.parse("always(b > 0)")}
    trace, _ = read_ruled(str(path), specs, EvaluationOptions(dense=True), Columns())
    assert isinstance(trace, EventTrace)
    found = {
        name: judge(spec, trace, None, EvaluationOptions(dense=True))
        for name, spec in specs.items()
    }
    assert [each.late_start and each.late_start.text for each in found.values()] == [
        None,
        "evaluated from 2 s on, with its first event",
    ]


def test_event_at_start_is_kept(tmp_path: Path) -> None:
    path = csv(tmp_path / "late.csv", a=[(0, 1), (0.5, 1), (1, -5), (3, 1)], b=B)
    found = judged(path, "always(a > 0 and b > 0)", Columns(start="known"))
    assert found.late_start is not None
    assert (found.verdict, found.late_start.left_out) == (Verdict.VIOLATED, 2)


def test_held_values_count_gaps_by_their_decimal_text() -> None:
    lines = {"x": (np.array([1.0]), np.array([5.0]))}
    assert held(lines, 1.1, Fraction(1, 10))["x"][1].tolist() == [5.0, 5.0]
    assert np.isnan(held(lines, 1.1, Fraction(99, 1000))["x"][1][-1])
    assert held(lines, 1.1, Fraction(1, 1000), {"x"})["x"][1].tolist() == [5.0, 5.0]
    assert held(lines, 1.0, None) == lines


def test_defaults_hold_for_any_time(tmp_path: Path) -> None:
    path = csv(tmp_path / "x.csv", x=[(0, 1), (1, 1), (2, 1)])
    text = "input float x\ninput float limit = 3\nalways(x < limit)"
    found = judged(path, text, Columns(max_gap=Fraction(3, 2)))
    assert (found.verdict, found.found.unknown) == (Verdict.SATISFIED, ())


def test_mutants_use_requirement_extent(tmp_path: Path) -> None:
    path = csv(tmp_path / "late.csv", a=[(0, 1), (1, -5), (2, 1)], b=B)
    spec = rtamt.parse("always(a > 0 and b > 0)")
    (mutant,) = [
        mutant
        for mutant in rtamt.mutants(spec)
        if mutant.specification.variables == ("a",) and "not" not in str(mutant.specification)
    ]
    for columns in (Columns(start="known"), Columns()):
        trace = read(path, spec, columns)
        # Without b, the trace of the mutant would start at 0 s and violate it.
        assert noticed([mutant], trace, None, EvaluationOptions(dense=True)) == (False,)


def test_samples_of_a_bag_start_late_too(tmp_path: Path) -> None:
    write_topics(tmp_path / "run.mcap", LINES)
    spec, period = rtamt.parse("always(a > 0 and b > 0)"), Fraction(1, 10)
    found = []
    for columns in (Columns(), Columns(start="known")):
        reading = EvaluationOptions(period=period)
        trace, used = read_ruled(str(tmp_path / "run.mcap"), {"": spec}, reading, columns)
        assert isinstance(trace, Trace)
        found.append(judge(spec, trace, used, reading))
    assert [each.verdict.name for each in found] == ["VIOLATED", "SATISFIED"]
    assert [each.late_start and each.late_start.left_out for each in found] == [0, 20]
    assert [each.decided and each.decided.time for each in found] == [1.0, None]


def test_outputs_state_what_a_verdict_leaves_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, xml = csv(tmp_path / "late.csv", a=[(0, 1), (1, 1), (2, 1)], b=B), tmp_path / "j.xml"
    call = ["monitor", "always(a > 0 and b > 0)", str(path), "--dense"]
    assert main(call) == 3
    text = " ".join(capsys.readouterr().out.split())
    assert (
        "SATISFIED if evaluated from 2 s on, where 'b' has its first event; the 2 s before it, "
        "with 2 events, count with 'b' unknown; --start known leaves them out"
    ) in text
    assert "late.csv: 6 events, 0 s to 4 s" in text
    assert main([*call, "--start", "known", "--junit", str(xml)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    said = (
        "evaluated from 2 s on, where 'b' has its first event: the 2 s before it are left out, "
        "with 2"
    )
    assert said in text
    root = ET.parse(xml)  # noqa: S314 - our own
    properties = {each.get("name"): each.get("value") for each in root.iter("property")}
    assert properties["left_out"] == "2"
    assert str(properties["late_start"]).startswith(said)
    assert main([*call, "--start", "known", "--json"]) == 0
    outcome = json.loads(capsys.readouterr().out)["trials"][0]["outcomes"]["spec"]
    assert outcome["late_start"]["left_out"] == 2
    assert outcome["late_start"]["of"] == ["b"]
    assert main([*call, "--min-duration", "3s", "--start", "known"]) == 3
    assert "shorter than 3 s" in capsys.readouterr().out


def test_start_known_without_events_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = csv(tmp_path / "x.csv", x=[(0, 1), (1, 1)])
    assert main(["monitor", "always(x > 0)", str(path), "--start", "known"]) == 2
    assert "expected --start known with --dense or with a bag" in capsys.readouterr().err


@pytest.mark.parametrize("ending", [".mcap", ".bag"])
def test_stamps_of_unread_topics_extend_a_recording(ending: str, tmp_path: Path) -> None:
    def odometry(time: int, speed: float, topic: str, since: int) -> Said:
        stamp = {"sec": (time - since) // 10**9, "nanosec": (time - since) % 10**9}
        fields = {"header": {"stamp": stamp}, "twist": {"twist": {"linear": {"x": speed}}}}
        return Said(time, topic, "nav_msgs/Odometry", fields)

    spec = rtamt.parse(
        "from nav_msgs.msg import Odometry\ninput Odometry odom\n@ topic(odom, read)\n"
        "always[0:4](odom.twist.twist.linear.x > 0)"
    )
    for since, end in ((START - 10**12, 5.0), (START + 10**10, 1.0)):
        said = [odometry(START + k * 10**9, 1.0, "/read", START - 10**12) for k in range(2)]
        said += [odometry(START + k * 10**9, 1.0, "/other", since) for k in range(6)]
        path = str(write_bag(tmp_path / f"{end}{ending}", sorted(said, key=lambda s: s.time)))
        rules = EvaluationOptions(dense=True)
        trace, _ = read_ruled(path, {"": spec}, rules, Columns(time="header"))
        assert isinstance(trace, EventTrace)
        # The other clock, 1,010 s behind, is ignored.
        assert trace.span == (0.0, end)
        expected = Verdict.SATISFIED if end > 4 else Verdict.UNDECIDED
        assert judge(spec, trace, None, rules).verdict is expected


# Records of one variable at one instant, times that go back, and topics subscribed twice. --------


Output = pytest.CaptureFixture[str]
Rows = list[tuple[float, float]]
TOPIC = Topic("pos", (("double", "z"),))


def write_channels(path: Path, *channels: tuple[str, Rows]) -> str:
    """A measurement with a group for each channel."""
    with MDF(version="4.10") as file:
        for name, rows in channels:
            times, values = zip(*rows, strict=True)
            file.append(Signal(np.array(values, float), np.array(times, float), name=name))
        file.save(path, overwrite=True)
    return str(path)


def mdf(folder: Path, rows: Rows) -> tuple[str, list[str]]:
    return write_channels(folder / "t.mf4", ("v", rows)), []


def ulog(folder: Path, rows: Rows) -> tuple[str, list[str]]:
    log = Ulog()
    log.records(TOPIC, [(round((1 + time) * 1e6), [value]) for time, value in rows])
    return str(log.save(folder / "t.ulg")), ["--signal", "v=pos.z"]


def bag(folder: Path, rows: Rows) -> tuple[str, list[str]]:
    said = [twist(START + round(time * 1e9), value) for time, value in rows]
    write_bag(folder / "bag", said)
    return str(folder / "bag"), ["--signal", "v=/robot0/cmd_vel.linear.x"]


Writer = Callable[[Path, Rows], tuple[str, list[str]]]
DOUBLE: Rows = [(0, 1), (1, -3), (1, 2), (2, 1)]


@pytest.mark.parametrize("write", [mdf, ulog, bag])
@pytest.mark.parametrize("choice", [None, "first", "last"])
def test_different_records_at_one_time(
    write: Writer, choice: str | None, tmp_path: Path, capsys: Output
) -> None:
    path, options = write(tmp_path, DOUBLE)
    words = ["monitor", "always(v >= 0)", path, "--dense", *options]
    words += [] if choice is None else ["--same-time", choice]
    code = main(words)
    out, err = capsys.readouterr()
    if choice is None and write is mdf:
        assert code == 2
        assert "expected one value at 1 s, got -3 and 2; choose with --same-time first or" in err
        return
    assert code == (1 if choice == "first" else 0)
    note = " ".join(out.split())
    assert f"the {choice or 'last'} of 2 different records at" in note


@pytest.mark.parametrize("write", [mdf, ulog, bag])
def test_equal_records_at_one_time_are_one(write: Writer, tmp_path: Path, capsys: Output) -> None:
    path, options = write(tmp_path, [(0, 1), (1, 2), (1, 2), (1, 2), (2, 1)])
    assert main(["monitor", "always(v >= 1)", path, "--dense", *options]) == 0
    assert "different records" not in capsys.readouterr().out


@pytest.mark.parametrize("write", [mdf, ulog])
def test_times_that_go_back_are_refused(write: Writer, tmp_path: Path, capsys: Output) -> None:
    path, options = write(tmp_path, [(0, 1), (2, 1), (1, -1), (3, 1)])
    assert main(["monitor", "always(v >= 0)", path, "--dense", *options]) == 2
    assert "expected times that increase, got" in capsys.readouterr().err


def test_column_in_place_of_record_times(tmp_path: Path, capsys: Output) -> None:
    path = write_channels(
        tmp_path / "t.mf4", ("v", [(0, 1), (1, 2)]), ("clock", [(0, 10), (1, 20)])
    )
    log, topic = Ulog(), Topic("pos", (("double", "z"), ("double", "clock")))
    log.records(topic, [(1_000_000, [1, 10]), (2_000_000, [2, 20])])
    fields = ["--signal", "v=pos.z", "--time", "pos.clock"]
    log_path = str(log.save(tmp_path / "t.ulg"))
    for words in ([path, "--time", "clock"], [log_path, *fields]):
        assert main(["monitor", "always(v >= 0)", *words]) == 0
        assert "2 samples, one every 10 s, 10 s to 20 s" in capsys.readouterr().out


def test_last_bit_differences_are_one_clock(tmp_path: Path, capsys: Output) -> None:
    fast: Rows = [
        (float(time), 1 - 2 * (index == 150)) for index, time in enumerate(np.arange(0, 2, 0.01))
    ]
    slow: Rows = [(float(time), 1) for time in np.arange(0, 2, 0.1)]
    assert {time for time, _ in slow} - {time for time, _ in fast}  # some differ
    path = write_channels(tmp_path / "t.mf4", ("a", fast), ("b", slow))
    words = ["monitor", "always(a > 0 and b > 0)", path, "--missing", "hold"]
    assert main(words) == 1
    assert "200 samples, one every 0.01 s" in capsys.readouterr().out


def test_channel_in_two_groups_can_be_chosen(tmp_path: Path, capsys: Output) -> None:
    path = write_channels(tmp_path / "t.mf4", ("v", [(0, 1), (1, 1)]), ("v", [(0, -1), (1, -1)]))
    assert main(["monitor", "always(v > 0)", path]) == 2
    assert "expected one column 'v', got 2; choose one with --signal, such as v=group0.v" in (
        capsys.readouterr().err
    )
    for group, code in ((0, 0), (1, 1)):
        assert main(["monitor", "always(v > 0)", path, "--signal", f"v=group{group}.v"]) == code


def test_names_of_values_are_read_as_numbers(tmp_path: Path, capsys: Output) -> None:
    conversion = {"val_0": 0, "text_0": "off", "val_1": 3, "text_1": "on"}
    signal = Signal(
        np.array([0, 3, 0], np.uint8), np.arange(3.0), name="state", conversion=conversion
    )
    with MDF(version="4.10") as file:
        file.append(signal)
        file.save(tmp_path / "t.mf4", overwrite=True)
    path = str(tmp_path / "t.mf4")
    assert main(["monitor", "eventually(state == 3) and always(state <= 3)", path]) == 0
    assert "'state' names its values: the numbers behind the names are read" in " ".join(
        capsys.readouterr().out.split()
    )


def test_log_may_start_at_zero(tmp_path: Path, capsys: Output) -> None:
    log = Ulog()
    log.records(TOPIC, [(100_000 * i, [1.0 - 2 * (i == 0)]) for i in range(40)])
    path = str(log.save(tmp_path / "t.ulg"))
    assert main(["monitor", "always(v > 0)", path, "--signal", "v=pos.z"]) == 1
    assert "40 samples, one every 0.1 s, 0 s to 3.9 s" in capsys.readouterr().out


@pytest.mark.parametrize("instance", [0, 1])
def test_topic_subscribed_twice_is_read_whole(
    instance: int, tmp_path: Path, capsys: Output
) -> None:
    first, log = replace(TOPIC, instance=instance), Ulog()
    log.records(first, [(1_000_000 + 50_000 * i, [1.0]) for i in range(20)])
    again = replace(first, subscription=1)
    log.records(again, [(2_000_000 + 50_000 * i, [1.0 - (i == 15)]) for i in range(20)])
    path = str(log.save(tmp_path / "t.ulg"))
    assert main(["monitor", "always(v > 0)", path, "--signal", "v=pos.z"]) == 1
    assert "40 samples, one every 0.05 s, 1 s to 2.95 s" in capsys.readouterr().out


def test_instant_is_one_unit_in_the_last_place() -> None:
    times = np.array([0.3, np.nextafter(0.3, 1), 0.3 + 3 * np.spacing(0.3), 1e9, 1e9 + 1.2e-7])
    assert same_as_before(times).tolist() == [True, False, False, True]
    assert same_as_before(np.array([5, 5, 6])).tolist() == [True, False]


@given(
    st.lists(st.tuples(st.integers(0, 4), st.sampled_from([1.0, 2.0, np.nan])), min_size=1),
    st.sampled_from([None, "first", "last"]),
)
def test_one_record_keeps_the_chosen_one(rows: Rows, choice: str | None) -> None:
    rows = sorted(rows, key=lambda row: row[0])
    times, values = (np.array(column, float) for column in zip(*rows, strict=True))
    groups = {time: [str(v) for t, v in rows if t == time] for time in times}
    if choice is None and any(len({*group}) > 1 for group in groups.values()):
        with pytest.raises(InputError, match="--same-time first or --same-time last"):
            one_record(times, values, None, "t", [])
        return
    notes: list[str] = []
    kept = one_record(times, values, choice, "t", notes)  # type: ignore[arg-type]
    assert times[kept].tolist() == [*groups]
    place = -1 if choice == "last" else 0
    assert [str(v) for v in values[kept]] == [group[place] for group in groups.values()]
    assert bool(notes) == any(len({*group}) > 1 for group in groups.values())


def _csv(rows: Rows) -> str:
    return "time,v\n" + "".join(f"{time},{value}\n" for time, value in rows)


def _long(rows: Rows) -> str:
    return "time,variable,value\n" + "".join(f"{time},v,{value}\n" for time, value in rows)


def _lines(rows: Rows) -> str:
    return "".join(f'{{"time": {time}, "v": {value}}}\n' for time, value in rows)


READERS = [
    (".csv", _csv, []),
    (".csv", _csv, ["--dense"]),
    (".csv", _long, ["--dense"]),
    (".jsonl", _lines, []),
    (".jsonl", _lines, ["--dense"]),
]


@pytest.mark.parametrize(("suffix", "text", "dense"), READERS)
def test_different_values_need_a_choice(
    suffix: str, text: Callable[[Rows], str], dense: list[str], tmp_path: Path, capsys: Output
) -> None:
    path = tmp_path / f"t{suffix}"
    path.write_text(text(DOUBLE))
    words = ["monitor", "always(v >= 0)", str(path), *dense]
    assert main(words) == 2
    assert "expected one value at 1 s, got -3 and 2; choose with --same-time first or" in (
        capsys.readouterr().err
    )
    for choice, code in (("first", 1), ("last", 0)):
        assert main([*words, "--same-time", choice]) == code
        assert f"the {choice} of 2 different records at 1 s counts" in (
            " ".join(capsys.readouterr().out.split())
        )
    path.write_text(text([(0, 1), (1, 2), (1, 2), (2, 1)]))
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "different records" not in out
    assert dense or "3 samples, one every 1 s" in out
    path.write_text(text([(0, 1), (2, 1), (1, -1), (3, 1)]))
    assert main([*words, "--same-time", "last"]) == 2
    assert "expected times" in capsys.readouterr().err


def test_rows_at_one_time_are_one_sample(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "t.csv"
    path.write_text("time,a,b\n0,1,\n0,,1\n1,2,\n1,,-2\n2,3,\n2,,3\n")
    words = ["monitor", "always(a > 0 and b > 0)", str(path)]
    assert main([*words, "--missing", "hold"]) == 1
    assert "3 samples, one every 1 s" in capsys.readouterr().out
    assert main([*words, "--dense"]) == 1
