"""Bags are traces of the command line like any other."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from bags import START, Said, twist, write_bag

import rtamt
from rtamt_gym import mine
from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]

SPEC = """
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
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a specification and bags of every kind."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.stl").write_text(SPEC)
    (tmp_path / "bags").mkdir()
    drive(tmp_path / "bags" / "a.mcap", 0.5)
    drive(tmp_path / "bags" / "b.bag", 1.5)
    drive(tmp_path / "bags" / "c", 0.9)
    drive(tmp_path / "bags" / "d.db3", 0.1)
    return tmp_path


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
    text = SPEC.partition("slow")[0] + "always(cmd.linear.x < ?v)"
    traces = [folder / "bags" / "b.bag", folder / "bags" / "c"]
    assert 1.5 < mine(text, traces, {"v": (0, 9)}, period=0.1).value < 1.501
    with pytest.raises(
        rtamt.InputError, match=r"b\.bag: expected --period, such as 100ms, to sample"
    ):
        mine(text, traces, {"v": (0, 9)})


def test_different_topics_error_before_reading(folder: Path, capsys: Output) -> None:
    (folder / "other.stl").write_text(SPEC.replace("robot0", "robot1").replace("slow", "calm"))
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
