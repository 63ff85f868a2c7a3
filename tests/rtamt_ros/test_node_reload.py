"""A node says what its start waits for, and no start overwrites what was recorded."""

from pathlib import Path

from memory_middleware import MemoryMiddleware, message

from rtamt_ros.middleware import Level
from rtamt_ros.node import MonitorNode, Settings


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
        "run.csv": ["3.0,2.0"],
        "run-2.csv": ["4.0,3.0"],
        "run-3.csv": ["5.0,-4.0"],
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
    assert kept == {"run.csv": "precious", "run-2.csv": "precious", "run-3.csv": "2.0\n"}


def test_node_before_its_clock_reports() -> None:
    node = MonitorNode(MemoryMiddleware(time=0), ["x > 1"])
    node.start()
    assert [report.text for report in node.reports] == ["waiting for the clock"]
