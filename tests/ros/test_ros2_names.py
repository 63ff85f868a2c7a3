"""Two monitors of one name report it, and parameters of ROS equal those of the command."""

from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from ros2_client import Client, Heard
from std_msgs.msg import Float64

ABOVE = "input float64 x\n@ topic(x, x)\nout = x > 1"

pytest_plugins = ["ros2_client"]


def test_two_monitors_of_one_name_say_so_until_one_ends(tools: Client, tmp_path: Path) -> None:
    diagnostics = tools.hear("/diagnostics", DiagnosticArray)
    file = tmp_path / "above.stl"
    file.write_text(ABOVE)
    words = f"-m rtamt_ros --stl {file} --ros-args -r __ns:=/twin".split()
    first, second = (tools.ros.start(*words, name=name) for name in ("first", "second"))
    said = (
        "2 nodes have the name /twin/stl_monitor, so a request may reach another node; give each "
        "node its own name: --ros-args -r __node:=NAME"
    )
    for each in (first, second):
        tools.until(lambda each=each: f"[twin.stl_monitor]: {said}\n" in each.output)  # type: ignore[misc]
    assert state(diagnostics) == (b"\x01", said)
    second.ask_to_end()
    assert second.ended() == 0
    well = "no other node has the name /twin/stl_monitor any more"
    tools.until(lambda: f"[twin.stl_monitor]: {well}\n" in first.output)
    assert state(diagnostics) == (b"\x00", well)
    first.ask_to_end()
    assert first.ended() == 0


def state(diagnostics: Heard) -> tuple[bytes, str]:
    """Return the next state of a node itself."""
    found = diagnostics.next(lambda each: each.status[-1].name == "twin/stl_monitor: ROS")
    return found.status[-1].level, found.status[-1].message


def test_the_command_takes_what_to_monitor_from_the_parameters_of_ros(
    tools: Client, tmp_path: Path
) -> None:
    heard = tools.hear("parameters/rtamt/out", Float64)
    tools.source("parameters/x", 3.0)
    file = tmp_path / "above.stl"
    file.write_text(ABOVE)
    words = f"-m rtamt_ros --period 20 --ros-args -r __ns:=/parameters -p spec_file:={file}"
    command = tools.ros.start(*words.split(), name="command")
    assert heard.next(bool).data == 2.0
    command.ask_to_end()
    assert command.ended() == 0


def test_the_command_without_anything_to_monitor_ends_with_code_2(tools: Client) -> None:
    command = tools.ros.start(
        *["-m", "rtamt_ros", "--ros-args", "-r", "__ns:=/empty", "-p", "period:=20"], name="empty"
    )
    assert command.ended() == 2
    assert "nothing to monitor: set the parameter spec or spec_file" in command.output
    assert "Traceback" not in command.output
