"""The judged values of a bag equal its messages at each time, by an independent definition."""

from __future__ import annotations

import json
import re
import tempfile
from fractions import Fraction
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from bags import START, Said, twist, write_bag
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

import rtamt
from rtamt_gym import EvaluationOptions, mine
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import judge
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled

SPEC = rtamt.parse("""
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import Odometry
    input Twist cmd
    input Odometry odom
    @ topic(cmd, robot0/cmd_vel)
    @ topic(odom, /robot0/odom)
    follows = always(cmd.linear.x > 0.5 implies eventually[0:2](odom.twist.twist.linear.x > 0.4))
""")
SPEED = "odom.twist.twist.linear.x"

Events = list[tuple[int, float]]


def odometry(time: int, speed: float, stamp: int) -> Said:
    header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}
    fields = {"header": header, "twist": {"twist": {"linear": {"x": speed}}}}
    return Said(time, "/robot0/odom", "nav_msgs/Odometry", fields)


def events() -> st.SearchStrategy[Events]:
    """Times of recording in nanoseconds since the start, which rise, and values."""
    gaps = st.lists(st.integers(1, 2_000_000_000), min_size=1, max_size=12)
    return gaps.flatmap(
        lambda steps: st.lists(st.floats(-2, 2), min_size=len(steps), max_size=len(steps)).map(
            lambda values: list(zip(np.cumsum(steps).tolist(), values, strict=True))
        )
    )


def held(found: Events, time: Fraction) -> float:
    """Return the value of the last event at a time or before."""
    return [value for at, value in found if at <= time][-1]


def written(folder: str, extension: str, commands: Events, speeds: Events, delay: int = 0) -> str:
    """Write a bag; the odometry was measured `delay` before it was recorded."""
    said = [twist(START + t, x) for t, x in commands]
    said += [odometry(START + t, x, START + t - delay) for t, x in speeds]
    path = Path(folder) / f"run{extension}"
    return str(write_bag(path, sorted(said, key=lambda each: each.time)))


@pytest.mark.parametrize("extension", [".mcap", ".db3", ".bag", ""])
@settings(max_examples=examples(6), deadline=None)
@given(commands=events(), speeds=events(), period=st.sampled_from(["1/10", "1/3", "7/10"]))
def test_samples_hold_last_message(
    extension: str, commands: Events, speeds: Events, period: str
) -> None:
    step = Fraction(period)
    begin = min(commands[0][0], speeds[0][0])
    first, end = max(commands[0][0], speeds[0][0]), max(commands[-1][0], speeds[-1][0])
    places, place = [], Fraction(begin)
    while place <= end:
        places.append(place)
        place += step * 10**9
    known = [place for place in places if place >= first]
    with tempfile.TemporaryDirectory() as folder:
        path = written(folder, extension, commands, speeds)
        known_columns = Columns(start="known")
        trace, used = read_ruled(path, {"": SPEC}, EvaluationOptions(period=step), known_columns)
    assert isinstance(trace, Trace)
    if not known:
        with pytest.raises(rtamt.InputError, match="expected a sample with a value of"):
            judge(SPEC, trace, used, EvaluationOptions(period=step, align="nearest"))
        return
    expected = {
        "cmd.linear.x": [held(commands, place) for place in known],
        SPEED: [held(speeds, place) for place in known],
    }
    columns = {name: column[-len(known) :] for name, column in trace.columns.items()}
    assert {name: column.tolist() for name, column in columns.items()} == expected
    assert trace.samples == len(places)
    assert (used, trace.period()) == (step, step if len(places) > 1 else None)
    assert (trace.start, trace.epoch) == (0.0, START + begin)
    found = judge(SPEC, trace, used, EvaluationOptions(period=step, align="nearest"))
    judged = rtamt.judge(SPEC, expected, step, "cut", align="nearest")
    assert (found.verdict, found.found.robustness) == (judged.verdict, judged.robustness)
    robustness = rtamt.evaluate(SPEC, expected, step, align="nearest")
    assert found.series["follows"].values.tolist() == robustness.tolist()


@pytest.mark.parametrize("extension", [".mcap", ".bag"])
@settings(max_examples=examples(6), deadline=None)
@given(commands=events(), speeds=events())
def test_events_hold_to_bag_end(extension: str, commands: Events, speeds: Events) -> None:
    rules = EvaluationOptions(dense=True)
    with tempfile.TemporaryDirectory() as folder:
        path = written(folder, extension, commands, speeds)
        trace, _ = read_ruled(path, {"": SPEC}, rules, Columns(start="known"))
    assert isinstance(trace, EventTrace)
    begin = min(commands[0][0], speeds[0][0])
    end = max(commands[-1][0], speeds[-1][0])
    signals = {}
    for name, found in (("cmd.linear.x", commands), (SPEED, speeds)):
        rows = found + ([(end, found[-1][1])] if found[-1][0] < end else [])
        signals[name] = [((at - begin) / 1e9, value) for at, value in rows]
    assert {
        n: list(zip(*map(np.ndarray.tolist, e), strict=True)) for n, e in trace.signals.items()
    } == signals
    whole = judge(SPEC, trace, None, rules)
    expected = rtamt.dense.judge(SPEC, signals, "cut")
    assert (whole.verdict, whole.found.robustness) == (expected.verdict, expected.robustness)


@settings(max_examples=examples(6), deadline=None)
@given(commands=events(), speeds=events(), delay=st.integers(0, 3_000_000_000))
def test_header_stamps_option(commands: Events, speeds: Events, delay: int) -> None:
    columns = Columns(time="header")
    with tempfile.TemporaryDirectory() as folder:
        path = written(folder, ".mcap", commands, speeds, delay)
        trace, _ = read_ruled(path, {"": SPEC}, EvaluationOptions(dense=True), columns)
    assert isinstance(trace, EventTrace)
    earlier = [(at - delay, value) for at, value in speeds]
    begin = min(commands[0][0], earlier[0][0])
    end = max(commands[-1][0], earlier[-1][0])
    times = [(at - begin) / 1e9 for at, _ in earlier]
    times += [(end - begin) / 1e9] * (earlier[-1][0] < end)
    assert trace.signals[SPEED][0].tolist() == times
    assert trace.notes[0] == "/robot0/cmd_vel has no stamps: its times are when it was recorded"


def test_requirements_start_with_their_topics(tmp_path: Path) -> None:
    said = [twist(START + i * 10**8, 1.0 if i else 3.0) for i in range(40)]
    said += [odometry(START + i * 10**8 + 7, 2.0, START) for i in range(20, 40)]
    path = str(write_bag(tmp_path / "run.mcap", sorted(said, key=lambda each: each.time)))
    text = SPEC.text.rpartition("follows")[0]
    specs = {
        "early": rtamt.parse(f"{text} always(cmd.linear.x < 2)"),
        "late": rtamt.parse(f"{text} always({SPEED} > cmd.linear.x)"),
        "never": rtamt.parse(f"{text} always({SPEED} > 0)"),
    }
    rules = EvaluationOptions(period=Fraction(1, 10))
    trace, period = read_ruled(path, specs, rules, Columns())
    assert isinstance(trace, Trace)
    assert (trace.samples, trace.start, trace.known_from) == (40, 0.0, {SPEED: 21})
    found = {name: judge(spec, trace, period, rules) for name, spec in specs.items()}
    assert {name: each.verdict.name for name, each in found.items()} == {
        "early": "VIOLATED",  # by its first sample, before the start of the odometry
        "late": "UNDECIDED",  # the odometry is unknown before
        "never": "SATISFIED",
    }
    assert [each.start for each in found.values()] == [0.0, 0.0, 2.1]
    assert [len(each.series["(result)"].values) for each in found.values()] == [40, 19, 19]
    alone, _ = read_ruled(path, {"late": specs["late"]}, rules, Columns())
    assert isinstance(alone, Trace)
    assert (alone.start, alone.samples, alone.known_from) == (0.0, 40, {SPEED: 21})
    dense, _ = read_ruled(path, specs, EvaluationOptions(dense=True), Columns())
    assert isinstance(dense, EventTrace)
    events = {name: judge(spec, dense, None, rules).verdict for name, spec in specs.items()}
    assert events == {name: each.verdict for name, each in found.items()}
    coarse = EvaluationOptions(period=Fraction(3))
    trace, period = read_ruled(path, specs, coarse, Columns())
    assert isinstance(trace, Trace)
    assert trace.samples == 2
    coarse = EvaluationOptions(period=Fraction(5))
    trace, period = read_ruled(path, specs, coarse, Columns())
    assert isinstance(trace, Trace)
    with pytest.raises(rtamt.InputError) as caught:
        judge(specs["late"], trace, period, coarse)
    assert str(caught.value) == (
        f"{path}: expected a sample with a value of '{SPEED}', got none: its first comes after "
        "the last sample"
    )


def test_of_messages_at_one_time_the_last_counts(tmp_path: Path) -> None:
    said = [twist(START, 1.0), twist(START + 10**9, 2.0), twist(START + 10**9, 3.0)]
    path = str(write_bag(tmp_path / "run.mcap", [*said, twist(START + 2 * 10**9, 4.0)]))
    spec = rtamt.parse(
        "from geometry_msgs.msg import Twist; input Twist cmd; @ topic(cmd, robot0/cmd_vel);"
        "cmd.linear.x > 0"
    )
    trace, _ = read_ruled(path, {"": spec}, EvaluationOptions(period=Fraction(1)), Columns())
    assert isinstance(trace, Trace)
    assert trace.columns["cmd.linear.x"].tolist() == [1.0, 3.0, 4.0]
    dense, _ = read_ruled(path, {"": spec}, EvaluationOptions(dense=True), Columns())
    assert isinstance(dense, EventTrace)
    assert dense.tables["cmd.linear.x"].tolist() == [[0.0, 1.0], [1.0, 3.0], [2.0, 4.0]]


def stamped(tmp_path: Path, stamps: list[float], since: int = START) -> str:
    """Write a bag of odometry with speeds 0, 1, 2 ... and these stamps in seconds."""
    said = [
        odometry(START + i * 10**8, float(i), since + round(stamp * 1e9))
        for i, stamp in enumerate(stamps)
    ]
    return str(write_bag(tmp_path / "run.mcap", said))


ODOM = rtamt.parse(
    "from nav_msgs.msg import Odometry; input Odometry odom; @ topic(odom, /robot0/odom);"
    "odom.twist.twist.linear.x >= 0"
)


def test_late_messages_are_counted(tmp_path: Path) -> None:
    path = stamped(tmp_path, [0.0, 0.2, 0.1, 0.3, 0.25, 0.4])
    trace, _ = read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    assert isinstance(trace, EventTrace)
    assert trace.tables[SPEED].tolist() == [[0.0, 0.0], [0.2, 1.0], [0.3, 3.0], [0.4, 5.0]]
    assert [*trace.notes] == ["/robot0/odom: 2 messages older than the one before left out"]


def test_a_clock_that_begins_anew_is_refused(tmp_path: Path) -> None:
    path = stamped(tmp_path, [5.0, 5.1, 5.2, 0.0, 0.1])
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    assert str(caught.value) == (
        f"{path}: expected stamps of /robot0/odom that increase, got one that is 5.2 s older than "
        "the one before it, in message 4 of 5: the clock restarted; cut the bag there, or give "
        "--time log"
    )


def test_a_stray_stamp_is_left_out_with_a_note(tmp_path: Path) -> None:
    for stray in (7.0, 3600.0, -5.0):
        path = stamped(tmp_path, [0.0, 0.1, stray, 0.3, 0.4])
        columns = Columns(time="header")
        trace, _ = read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), columns)
        assert isinstance(trace, EventTrace)
        assert trace.tables[SPEED].tolist() == [[0.0, 0.0], [0.1, 1.0], [0.3, 3.0], [0.4, 4.0]]
        (note,) = trace.notes
        assert note.startswith("/robot0/odom: 1 message left out, more than 1 s out of line")
        Path(path).unlink()


def test_clock_jump_error_and_ahead_note(tmp_path: Path) -> None:
    path = stamped(tmp_path, [0.0, 0.1, 7.2, 7.3, 7.4])
    with pytest.raises(rtamt.InputError, match="jumps ahead of the recording by 7 s, in message 3"):
        read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    Path(path).unlink()
    path = stamped(tmp_path, [0.3, 0.4, 0.5])
    trace, _ = read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    assert [*trace.notes] == ["/robot0/odom: 3 stamps up to 0.3 s ahead of the recording"]


def test_stamps_of_a_faster_clock_are_refused(tmp_path: Path) -> None:
    path = stamped(tmp_path, [2.0 * n for n in range(8)])
    with pytest.raises(rtamt.InputError, match="7 messages of 8 out of line; give --time log"):
        read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))


def test_simulated_stamps_do_not_mix_with_log_times(
    tmp_path: Path,
) -> None:
    path = stamped(tmp_path, [i / 8 for i in range(9)], since=0)
    trace, _ = read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    assert isinstance(trace, EventTrace)
    assert trace.tables[SPEED].tolist()[:3] == [[0.0, 0.0], [0.125, 1.0], [0.25, 2.0]]
    assert abs(trace.epoch - START) < 10**9
    both = write_bag(
        tmp_path / "both.mcap",
        [twist(START, 1.0), odometry(START + 1, 1.0, 10**9), odometry(START + 2, 1.0, 2 * 10**9)],
    )
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(str(both), {"": SPEC}, EvaluationOptions(dense=True), Columns(time="header"))
    assert str(caught.value) == (
        f"{both}: expected times of one clock, got /robot0/cmd_vel and /robot0/odom, which are "
        "1.7e+09 s apart; give --time log"
    )


def test_what_was_held_for_long_is_said(tmp_path: Path) -> None:
    said = [twist(START + i * 10**8, 1.0) for i in range(10, 100)]
    said += [odometry(START + i * 10**8, 1.0, START) for i in [*range(20), *range(50, 60)]]
    path = str(write_bag(tmp_path / "run.bag", sorted(said, key=lambda each: each.time)))
    trace, _ = read_ruled(path, {"": SPEC}, EvaluationOptions(period=Fraction(1, 10)), Columns())
    assert [*trace.notes] == [
        "/robot0/odom: the message at 5.9 s is held for 4 s, to the end",
    ]
    path = str(write_bag(tmp_path / "gap.bag", [*said[:90], odometry(START + 10**9, 1.0, START)]))
    trace, _ = read_ruled(path, {"": SPEC}, EvaluationOptions(period=Fraction(1, 10)), Columns())
    assert [*trace.notes] == ["/robot0/odom: the message at 0 s is held for 8.9 s, to the end"]


# Bags are traces of the command line like any other. ---------------------------------------------


Output = pytest.CaptureFixture[str]

LIMIT = """
from geometry_msgs.msg import Twist
input Twist cmd
@ topic(cmd, robot0/cmd_vel)
slow = always(cmd.linear.x < 1)
moves = eventually[0:0.5](cmd.linear.x > 0.2)
"""


def drive(path: Path, fastest: float) -> Path:
    """A second of commands every 0.1 s, up to a speed in the middle."""
    speeds = [fastest * min(i, 10 - i) / 5 for i in range(11)]
    return write_bag(path, [twist(START + i * 10**8, speed) for i, speed in enumerate(speeds)])


@pytest.fixture
def folder(folder: Path) -> Path:
    """A folder with a specification and bags of every kind."""
    (folder / "spec.stl").write_text(LIMIT)
    (folder / "bags").mkdir()
    drive(folder / "bags" / "a.mcap", 0.5)
    drive(folder / "bags" / "b.bag", 1.5)
    drive(folder / "bags" / "c", 0.9)
    drive(folder / "bags" / "d.db3", 0.1)
    return folder


def test_bag_verdicts_match_table(folder: Path, capsys: Output) -> None:
    rows = [f"{i / 10},{1.5 * min(i, 10 - i) / 5}" for i in range(11)]
    (folder / "b.csv").write_text("\n".join(["time,cmd.linear.x", *rows]))
    assert main(["monitor", "spec.stl", "b.csv"]) == 1
    expected = capsys.readouterr().out.replace("b.csv", "bags/b.bag")
    assert main(["monitor", "spec.stl", "--period", "100ms", "bags/b.bag"]) == 1
    assert capsys.readouterr().out == expected
    assert main(["monitor", "spec.stl", "--dense", "b.csv"]) == 1
    expected = capsys.readouterr().out.replace("b.csv", "bags/b.bag")
    assert main(["monitor", "spec.stl", "--dense", "bags/b.bag"]) == 1
    assert capsys.readouterr().out == expected
    assert main(["explain", "spec.stl", "b.csv"]) == 1
    expected = capsys.readouterr().out.replace("b.csv", "bags/b.bag")
    assert main(["explain", "spec.stl", "--period", "0.1", "bags/b.bag"]) == 1
    assert capsys.readouterr().out == expected
    for source, out in (("bags/b.bag", "bag.csv"), ("b.csv", "table.csv")):
        main(["monitor", "spec.stl", "--period", "0.1", source, "--out", out])
    assert (folder / "bag.csv").read_text() == (folder / "table.csv").read_text()
    assert main(["monitor", "spec.stl", "--period", "0.1", "bags/c", "--plot", "c.png"]) == 0
    assert (folder / "c.png").stat().st_size > 10_000


def test_rosbag2_folder_is_one_trace(folder: Path, capsys: Output) -> None:
    command = ["monitor", "spec.stl", "--period", "100ms", "--junit", "out.xml"]
    assert main([*command, "--markdown", "out.md", "--", "bags"]) == 1
    found = capsys.readouterr().out
    assert found.splitlines()[:6] == [
        "trace        length  period  verdict    slow    moves",
        "bags/a.mcap     1 s   0.1 s  SATISFIED   0.5      0.3",
        "bags/b.bag      1 s   0.1 s  VIOLATED   -0.5 V    1.3",
        "bags/c          1 s   0.1 s  SATISFIED   0.1      0.7",
        "bags/d.db3      1 s   0.1 s  VIOLATED    0.9     -0.1 V",
        "",
    ]
    assert "bags/c" in (folder / "out.md").read_text()
    suites = ET.parse(folder / "out.xml").getroot()  # noqa: S314 - our own file
    counts = [(each.get("name"), each.get("failures")) for each in suites.iter("testsuite")]
    assert counts == [
        ("bags/a.mcap", "0"),
        ("bags/b.bag", "1"),
        ("bags/c", "0"),
        ("bags/d.db3", "1"),
    ]
    named = ["bags/a.mcap", "bags/b.bag", "bags/c", "bags/d.db3"]
    for traces in (["--", "bags/*"], ["--", *named]):
        assert main(["monitor", "spec.stl", "--period", "0.1", *traces]) == 1
        assert capsys.readouterr().out.splitlines() == [
            line for line in found.splitlines() if not line.startswith("outcomes: ")
        ]
    assert main(["monitor", "spec.stl", "--period", "0.1", "bags/a.mcap"]) == 0
    assert main(["monitor", "slow = spec.stl", "bags/c", "bags/d.db3"]) == 2


def test_bags_without_separator(folder: Path, capsys: Output) -> None:
    assert main(["monitor", "spec.stl", "bags/c", "bags/a.mcap"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: expected a specification, got the trace bags/c; for several traces write "
        "spec.stl -- bags/c bags/a.mcap\n"
    )
    assert (folder / "bags" / "c").is_dir()


def test_json_keeps_bag_options(folder: Path, capsys: Output) -> None:
    command = ["monitor", "spec.stl", "--period", "100ms", "--json", "--", "bags"]
    assert main(command) == 1
    text = capsys.readouterr().out
    reading, outcomes = json.loads(text)["reading"], json.loads(text)
    assert reading["period"] == "1/10"
    assert reading["columns"] == {"signals": {"cmd.linear.x": "robot0/cmd_vel.linear.x"}}
    assert [each["verdict"] for each in outcomes["trials"]] == [
        "SATISFIED",
        "VIOLATED",
        "SATISFIED",
        "VIOLATED",
    ]
    assert outcomes["trials"][1]["outcomes"]["slow"]["decided_at"]["seconds"] == 0.4
    (folder / "outcomes.json").write_text(text)
    assert main(["report", "outcomes.json", "-o", "page.html"]) == 0
    assert "not shown in full" not in (folder / "page.html").read_text()
    assert "is not shown" not in capsys.readouterr().out


def test_bag_with_missing_topic(folder: Path, capsys: Output) -> None:
    command = ["monitor", "spec.stl", "warm = always(temperature > 3)", "--period", "0.1"]
    assert main([*command, "bags/a.mcap"]) == 2
    said = capsys.readouterr()
    assert said.out.startswith("slow: SATISFIED, robustness 0.5, at the end of the trace\n")
    assert said.err == (
        "rtamt: error: bags/a.mcap: no topic 'rtamt/temperature', which 'temperature' reads; the "
        "topics are /robot0/cmd_vel; give --signal temperature=TOPIC.FIELD\n"
    )
    (folder / "bags" / "d.db3").write_bytes(b"SQLite format 3\0" + bytes(200))
    assert main(["monitor", "spec.stl", "--period", "0.1", "--", "bags"]) == 2
    said = capsys.readouterr()
    assert re.search("bags/d.db3 +ERROR", said.out)
    assert said.err.startswith("rtamt: error: bags/d.db3: expected a whole bag of rosbag2, got ")


FIELDS = """
from geometry_msgs.msg import Twist
input Twist cmd
@ topic(cmd, robot0/cmd_vel)
wrong = always(cmd.{field} < 1)
slow = always(cmd.linear.x < 0.9)
"""


@pytest.mark.parametrize(
    ("field", "error"),
    [
        ("linaer.x", "has no field 'linaer'"),
        ("linear.w", "has no field 'w'"),
        ("linear.x.y", "is no message, got field 'y'"),
        ("linear", "expected a number for 'cmd.linear'"),
    ],
)
@pytest.mark.parametrize("option", ["--dense", "--period=0.1"])
def test_wrong_field_fails_only_its_requirement(
    field: str, error: str, option: str, folder: Path, capsys: Output
) -> None:
    (folder / "fields.stl").write_text(FIELDS.format(field=field))
    (folder / "right.stl").write_text(FIELDS.format(field="linear.x"))
    command = [option, "--json", "--", "bags"]
    assert main(["monitor", "fields.stl", *command]) == 2
    wrong = json.loads(capsys.readouterr().out)["trials"]
    assert main(["monitor", "right.stl", *command]) == 1
    right = json.loads(capsys.readouterr().out)["trials"]
    for one, other in zip(wrong, right, strict=True):
        assert one["outcomes"]["slow"] == other["outcomes"]["slow"]
        assert one["outcomes"]["wrong"]["verdict"] == "ERROR"
        assert error in one["outcomes"]["wrong"]["error"]
    assert main(["monitor", "fields.stl", "--only", "wrong", *command]) == 2


def test_held_values_are_reported(folder: Path, capsys: Output) -> None:
    said = [twist(START + i * 10**8, 0.5 + i / 100) for i in range(20)]
    said.append(Said(START + 10**10, "/name", "std_msgs/String", {}))
    path = str(write_bag(folder / "quiet.bag", said))
    assert main(["monitor", "spec.stl", "--period", "0.1", "--only", "slow", path]) == 0
    assert "\n".join(capsys.readouterr().out.splitlines()[2:6]) == (
        f"{path}: 101 samples, one every 0.1 s, 0 s to 10 s\n"
        "  10 s long, longest gap 8.1 s\n"
        "note: /robot0/cmd_vel: the message at 1.9 s is held for 8.1 s, to the end\n"
    )
    command = ["monitor", "spec.stl", "--period", "0.1", "--stale"]
    assert main([*command, "8.1", path]) == 0
    capsys.readouterr()
    assert main([*command, "8", path]) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: {path}: expected a message of /robot0/cmd_vel every 8 s at least, got none "
        "for 8.1 s after 1.9 s; a longer --stale lets it hold so long\n"
    )
    (folder / "table.csv").write_text("time,cmd.linear.x\n0,0.5\n0.1,0.5\n")
    for options, message in (
        (
            ["--stale", "1", "table.csv"],
            "table.csv: expected --stale for a bag, got it for a table",
        ),
        (["--stale", "0", path], "--stale: expected seconds, such as 0.5, got 0"),
    ):
        assert main(["monitor", "spec.stl", *options]) == 2
        assert capsys.readouterr().err == f"rtamt: error: {message}\n"
    assert main(["monitor", "spec.stl", "--period", "0.1", "--json", path]) == 0
    (trace,) = json.loads(capsys.readouterr().out)["trials"]
    assert trace["notes"] == ["/robot0/cmd_vel: the message at 1.9 s is held for 8.1 s, to the end"]


def test_options_of_tables_are_refused_for_bags(folder: Path, capsys: Output) -> None:
    period = (
        "expected --period, such as 100ms, to sample the messages of a bag, or --dense to read "
        "them as events"
    )
    clock = "expected --time log, the times of recording of a bag, or --time header, got 'stamp'"
    for options, message in (
        (["--dense", "--jitter", "5%"], "expected --jitter for a table, got it for a bag"),
        (["--period", "1", "--jitter", "5%"], "expected --jitter for a table, got it for a bag"),
        (["--dense", "--time-unit", "ms"], "expected --time-unit for a table, got it for a bag"),
        (["--dense", "--time", "stamp"], clock),
        ([], period),
    ):
        assert main(["monitor", "spec.stl", *options, "bags/a.mcap"]) == 2
        assert capsys.readouterr().err == f"rtamt: error: bags/a.mcap: {message}\n"
    assert main(["monitor", "spec.stl", "--signal", "dmc=/x", "bags/a.mcap"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: --signal: no specification reads 'dmc'; they read 'cmd.linear.x'\n"
    )
    assert (folder / "bags").is_dir()


def test_constants_are_mined_from_bags(folder: Path, capsys: Output) -> None:
    signal = "x=/robot0/cmd_vel.linear.x"
    bags = ["bags/a.mcap", "bags/b.bag"]
    command = ["mine", "always(x < ?v)", "--range", "v=0:9", "--signal", signal]
    assert main([*command, "--period", "0.1", "--", *bags]) == 0
    assert capsys.readouterr().out.startswith("v = 1.500")
    text = LIMIT.partition("slow")[0] + "always(cmd.linear.x < ?v)"
    traces = [folder / "bags" / "b.bag", folder / "bags" / "c"]
    assert 1.5 < mine(text, traces, {"v": (0, 9)}, period=0.1).value < 1.501
    with pytest.raises(
        rtamt.InputError, match=r"b\.bag: expected --period, such as 100ms, to sample"
    ):
        mine(text, traces, {"v": (0, 9)})


def test_different_topics_error_before_reading(folder: Path, capsys: Output) -> None:
    (folder / "other.stl").write_text(LIMIT.replace("robot0", "robot1").replace("slow", "calm"))
    assert main(["monitor", "spec.stl", "o=other.stl", "--dense", "--json", "bags/a.mcap"]) == 2
    said = capsys.readouterr()
    assert not said.out
    assert said.err == (
        "rtamt: error: expected one topic for 'cmd', which two specifications read, got "
        "robot0/cmd_vel and robot1/cmd_vel; rename one variable, or judge the specifications "
        "separately\n"
    )
    spec = "always(cmd.linear.x < 9)"
    assert main(["monitor", spec, "--signal", "cmd.linear=/x", "bags/a.mcap"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: --signal: no specification reads 'cmd.linear'; did you mean "
        "'cmd.linear.x'?\n"
    )
