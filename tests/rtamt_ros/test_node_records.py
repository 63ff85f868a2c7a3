"""Records of a node, which rtamt reads and no restart overwrites."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest
from memory_middleware import SECOND, MemoryMiddleware, message
from memory_nodes import MS, send, started

from rtamt import EpisodeMonitor, InputError, evaluate
from rtamt_gym.__main__ import main
from rtamt_ros.middleware import Level
from rtamt_ros.node import MonitorNode, Settings


def rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_record_equals_evaluate(tmp_path: Path) -> None:
    text = "ok = always[0:0.2](x - y > 1)"
    begin = 1_700_000_000 * SECOND + 123_456_789
    ros, node = started(text, begin=begin, record=tmp_path / "run.csv")
    for n in range(12):
        send(ros, "x", 0.1 * n + 1 / 3)
        send(ros, "y", -0.7)
        ros.tick()
        ros.time += (100 + 170 * (n == 5)) * MS  # one sample is late
    node.stop()
    table = rows(tmp_path / "run.csv")
    assert table[0]["time"] == "2023-11-14T22:13:20.123456789Z"
    assert table[12]["time"] == "2023-11-14T22:13:21.323456789Z"
    assert len(table) == 13
    trace = {name: [float(row[name]) for row in table] for name in ("x", "y")}
    offline = evaluate(text, trace, period=0.1)
    assert [float(row["robustness"]) for row in table[2:]] == offline[:-2].tolist()
    assert ros.latched("rtamt/ok") == offline[-3]
    assert math.isnan(float(table[1]["robustness"]))


@pytest.mark.parametrize("dense", [False, True])
def test_rtamt_monitor_reads_records(
    tmp_path: Path,
    dense: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    text = "ok = always[0:0.2](x - y > 1)"
    ros, node = started(text, record=tmp_path / "run.csv", dense=dense)
    ros.time = 1_700_000_000 * SECOND + 123_456_789
    for n in range(30):
        send(ros, "x", 0.1 * (n % 7) + 1 / 3)
        ros.time += 3 * MS
        send(ros, "y", -0.7 + 0.05 * (n % 4))
        ros.time += 97 * MS
        ros.tick()
    node.stop()
    out = tmp_path / "robustness.csv"
    # The node waits for a value of every variable, as with --start known.
    options = ["--dense", "--start", "known"] if dense else []
    assert main(["monitor", text, str(tmp_path / "run.csv"), "--out", str(out), *options]) < 2
    table = rows(out)
    if dense:
        found = [float(row["value"]) for row in table if row["variable"] == "ok"]
        settled = len([value for value in ros.data("rtamt/ok") if value == value])  # noqa: PLR0124
        assert settled > 20
        assert found[: settled - 3] == ros.data("rtamt/ok")[: settled - 3]
    else:
        assert [float(row["ok"]) for row in table][:-2] == ros.data("rtamt/ok")


def test_record_has_bounds_and_verdict_of_every_sample(tmp_path: Path) -> None:
    text = "ok = always(x > 0 or eventually[0:0.3](y > 1))"
    ros, node = started(text, record=tmp_path / "run.csv")
    for n in range(30):
        send(ros, "x", 1.0 - n % 5)
        send(ros, "y", 2.0 if n % 7 == 0 and n < 20 else 0.0)
        ros.tick()
        ros.time += 100 * MS
    node.stop()
    oracle = EpisodeMonitor(text, period=0.1)
    for row in rows(tmp_path / "run.csv"):
        oracle.update(**{name: float(row[name]) for name in ("x", "y")})
        assert (float(row["lower"]), float(row["upper"])) == oracle.bounds()
        assert int(row["verdict"]) == oracle.verdict
    assert oracle.verdict == -1


def test_dense_record_has_a_file_of_verdicts(tmp_path: Path) -> None:
    (tmp_path / "run-verdicts.csv").write_text("precious")
    ros, node = started("always(x > 0)", dense=True, record=tmp_path / "run.csv")
    for x in (3.0, 1.0, -1.0, 2.0):
        send(ros, "x", x)
        ros.time += 100 * MS
        ros.tick()
    node.stop()
    found = rows(tmp_path / "run-2-verdicts.csv")
    assert [(row["lower"], row["upper"], row["verdict"]) for row in found] == [
        ("-inf", "3.0", "0"),
        ("-inf", "1.0", "0"),
        ("-inf", "-1.0", "-1"),
    ]
    assert {path.name for path in tmp_path.iterdir()} == {
        *("run-verdicts.csv", "run-2.csv", "run-2-verdicts.csv")
    }
    assert (tmp_path / "run-verdicts.csv").read_text() == "precious"


@pytest.mark.parametrize("name", ["robustness", "lower", "upper", "verdict"])
def test_variable_with_the_name_of_a_column_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"record: the variable '{name}' has the name of a col"):
        started(f"out = {name} > 0", record=tmp_path / "run.csv")
    started(f"out = {name} > 0")
    started(f"out = {name} > 0", dense=True, record=tmp_path / "run.csv")


def test_runs_and_requirements_have_files(tmp_path: Path) -> None:
    ros, node = started("slow = x < 3; near = y < 3", record=tmp_path / "run.csv")
    for time, what in [(0, "xy"), (100, "xy"), (200, "x"), (700, "x"), (800, "xy"), (900, "xy")]:
        ros.time = 1000 * SECOND + time * MS
        for name in what:
            send(ros, name, 1.0)
        ros.tick()
    node.stop()
    counts = {path.name: len(rows(path)) for path in tmp_path.iterdir()}
    assert counts == {"run-slow.csv": 10, "run-near.csv": 7, "run-near-2.csv": 2}


def test_dense_record_holds_events(tmp_path: Path) -> None:
    ros, node = started("x > y", dense=True, record=tmp_path / "run.csv")
    for time, name, value in [(0, "x", 1.0), (50, "y", 2.0), (70, "x", 3.0), (90, "y", 0.5)]:
        ros.time = 1000 * SECOND + time * MS
        send(ros, name, value)
    node.stop()
    assert [tuple(row.values()) for row in rows(tmp_path / "run.csv")] == [
        ("1970-01-01T00:16:40.000000000Z", "x", "1.0"),
        ("1970-01-01T00:16:40.050000000Z", "y", "2.0"),
        ("1970-01-01T00:16:40.070000000Z", "x", "3.0"),
        ("1970-01-01T00:16:40.090000000Z", "y", "0.5"),
    ]


def test_record_folder_errors(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        started("x > 0", record=tmp_path / "no" / "run.csv")
    assert str(error.value) == f"record: there is no folder {tmp_path / 'no'}"
    with pytest.raises(InputError) as error:
        started("x > 0", record=tmp_path)
    assert str(error.value) == f"record: expected a file, {tmp_path} is a folder"


def test_full_disk_ends_the_record_only() -> None:
    ros, node = started("always(x > 0)", record=Path("/dev/full"))
    for n in range(25):
        send(ros, "x", 5.0 - n % 4)
        ros.tick(1000 * SECOND + n * 100 * MS)
    said = "the record has ended: /dev/full: No space left on device"
    texts = [text for _, text in ros.lines if said in text]
    assert texts == [f"spec: holds so far, robustness 4; {said}"]
    last = ros.on("/diagnostics")[-1].status[0].message
    assert last == f"holds so far, robustness 2; {said}"
    assert len(ros.data("rtamt/spec")) == 25
    assert node.reports[0].level is Level.WARN
    node.stop()


def test_removed_folder_ends_the_record(tmp_path: Path) -> None:
    folder = tmp_path / "records"
    folder.mkdir()
    ros, node = started("x > 0", record=folder / "run.csv")
    for time in (0, 900, 1000, 1100):
        ros.time = 1000 * SECOND + time * MS
        send(ros, "x", 1.0)
        ros.tick()
        if not time:
            (folder / "run.csv").unlink()
            folder.rmdir()
    assert ros.data("rtamt/spec") == [1.0] * 4
    assert node.reports[0].unrecorded == f"{folder / 'run.csv'}: No such file or directory"
    node.stop()


def test_records_are_not_overwritten(tmp_path: Path) -> None:
    ros = MemoryMiddleware()
    settings = Settings(record=tmp_path / "run.csv")
    node = MonitorNode(ros, ["x > 1"], settings)

    def sample(value: float) -> None:
        ros.send("rtamt/x", message("std_msgs", "Float64", data=value))
        ros.tick()

    node.start()
    sample(3.0)
    node.stop()
    node.start()
    sample(4.0)
    node.replace(["x < 1"])
    sample(5.0)
    node.stop()
    found = {path.name: path.read_text().split()[1:] for path in tmp_path.iterdir()}
    last = {name: [row.split(",", 1)[1] for row in rows] for name, rows in found.items()}
    assert last == {
        "run.csv": ["3.0,2.0,2.0,2.0,1"],
        "run-2.csv": ["4.0,3.0,3.0,3.0,1"],
        "run-3.csv": ["5.0,-4.0,-4.0,-4.0,-1"],
    }


def test_log_names_the_new_record(
    tmp_path: Path,
) -> None:
    for name in ("run.csv", "run-2.csv"):
        (tmp_path / name).write_text("precious")
    ros = MemoryMiddleware()
    node = MonitorNode(ros, ["x > 1"], Settings(record=tmp_path / "run.csv"))
    node.start()
    assert ros.lines[-1] == (Level.OK, f"records {tmp_path}/run-3.csv")
    ros.send("rtamt/x", message("std_msgs", "Float64", data=3.0))
    ros.tick()
    node.stop()
    kept = {path.name: path.read_text().split(",")[-1] for path in tmp_path.iterdir()}
    assert kept == {"run.csv": "precious", "run-2.csv": "precious", "run-3.csv": "1\n"}


def test_node_before_its_clock_reports() -> None:
    node = MonitorNode(MemoryMiddleware(time=0), ["x > 1"])
    node.start()
    assert [report.text for report in node.reports] == ["waiting for the clock"]
