"""The command line of a node: its errors, its choice of ROS, its messages."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware, message
from paths import ROOT

import rtamt
from rtamt_ros import command, generation
from rtamt_ros.command import main
from rtamt_ros.core.settings import Settings
from rtamt_ros.parameters import PARAMETERS, UNITS, read

DEFAULTS = {name: default for name, (default, _) in PARAMETERS.items()}
SPEC = ("--spec", "always(x > 1)")


def installed(monkeypatch: pytest.MonkeyPatch, libraries: Iterable[str]) -> None:
    """Simulate that these of rospy and rclpy are installed."""
    found = set(libraries)
    monkeypatch.setattr(generation, "find_spec", lambda name: name if name in found else None)


ERRORS = {
    "": "nothing to monitor: write --stl FILE or --spec TEXT",
    "--stl absent.stl": "--stl: cannot read absent.stl: No such file or directory",
    "--spec x>": "STL:1:3: expected an operand after '>', got the end of the text\n"
    "  x>\n"
    "    ^\n"
    "  hint: write a variable, a number or '(' there",
    "--spec x>1 --period 0": "--period: expected a number above 0, got 0.0",
    "--spec x>1 --period nan": "--period: expected a number above 0, got nan",
    "--spec x>1 --period 0.1 --unit ns": "expected a whole number of nanoseconds as the period, "
    "got 0",
    "--spec x>1 --period 1h": "argument --period: expected a number, got '1h'; "
    "100 ms is --period 100 --unit ms; see ros_stl_monitor.py --help",
    "--spec x>1 --stale soon": "--stale: expected seconds or TOPIC=SECONDS, got 'soon'",
    "--spec x>1 --stale x=-1": "expected seconds above 0 until an input is stale of x, "
    "got -1.0; inf is never",
    "--spec x>1 --stale rtamt/y=2": "--stale: no specification reads the topic rtamt/y; "
    "did you mean 'rtamt/x'?",
    "--spec eventually[0:0.25](x>1)": "STL:1:11: bound 0.25 s is not a multiple of the period "
    "0.1 s (2.5 steps)\n"
    "  eventually[0:0.25](x>1)\n"
    "            ^\n"
    "  hint: use 0.2 s or 0.3 s, take samples 0.05 s apart, or let --align round it",
    "--spec next(x>1) --dense": "STL:1:1: 'next' reads the next or previous sample, and "
    "dense time has events only\n"
    "  next(x>1)\n"
    "  ^\n"
    "  hint: look a time d away with eventually[0:d], or leave out --dense",
    "--spec x>1 --align up": "argument --align: invalid choice: 'up' (choose from 'outward', "
    "'inward', 'nearest'); see ros_stl_monitor.py --help",
    "--spec x>1 --dense --align inward": "--align cannot be set in dense time, which has no "
    "samples to round to",
    "--spec x>1 --perod 3": "unrecognized arguments: --perod 3; did you mean '--period'? see "
    "ros_stl_monitor.py --help",
    "follows.stl --period 1": "unrecognized arguments: follows.stl; write --stl follows.stl; see "
    "ros_stl_monitor.py --help",
}


@pytest.mark.parametrize("arguments", ERRORS)
def test_wrong_arguments_exit_with_2(arguments: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments.split()) == 2
    said = capsys.readouterr()
    assert said.err == f"ros_stl_monitor.py: error: {ERRORS[arguments]}\n"
    assert said.out == ""


def test_an_error_in_a_file_names_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = tmp_path / "good.stl", tmp_path / "bad.stl"
    good.write_text("y > 1")
    errors = {
        "x >": "STL:1:4: expected an operand",
        "once[0:0.25](x > 1)": "STL:1:5: bound 0.25 s is not a multiple of the period 0.1 s",
        "m.a > 1": "The message 'm' has no class. Declare one: ",
    }
    for text, error in errors.items():
        bad.write_text(text)
        assert main(["--stl", str(good), "--stl", str(bad)]) == 2
        assert f"in {bad}: {error}" in capsys.readouterr().err


def test_align_rounds_bounds(played: Played) -> None:
    given = ["--period", "0.5", "--unit", "s", "--align", "outward"]
    assert main(["--spec", "out = once[0:0.25](x > 1)", *given]) == 0
    assert played.data("rtamt/out") == [1.0, 1.0]


REMAPPED = ("--ros-args", "-r", "odom:=wheels")
UNSEEN = "; a virtual environment needs --system-site-packages to import it"
CHOICES = {
    ("rospy", ()): 1,
    ("rclpy", ()): 2,
    ("rospy rclpy", ("--ros", "1")): 1,
    ("rospy rclpy", ("--ros", "2")): 2,
    ("rospy rclpy", ()): "ROS 1 and ROS 2 are both installed: write --ros 1 or --ros 2",
    ("rclpy", ("--ros", "1")): "ROS 1 needs rospy, which is not installed: apt-get install "
    "python3-rospy python3-diagnostic-msgs (Debian), or source the setup.bash of ROS 1" + UNSEEN,
    ("rospy", ("--ros", "2")): "ROS 2 needs rclpy, which is not installed: "
    "source the setup.bash of ROS 2" + UNSEEN,
    ("", ()): "expected rospy of ROS 1 or rclpy of ROS 2, found neither. ROS 1: apt-get install "
    "python3-rospy python3-diagnostic-msgs (Debian), or source the setup.bash of ROS 1. "
    "ROS 2: source the setup.bash of ROS 2" + UNSEEN,
    (
        "rospy",
        REMAPPED,
    ): "ROS 1 does not accept --ros-args -r odom:=wheels: write remappings as they "
    "are, odom:=robot1/odom",
    (
        "rospy",
        ("--ros-args", "-p", "period:=50"),
    ): "ROS 1 does not accept --ros-args -p period:=50: "
    "write parameters as options, which --help lists, and remappings as they are, "
    "odom:=robot1/odom",
    ("rclpy", ("odom:=wheels", "_x:=1")): "ROS 2 does not accept odom:=wheels _x:=1: "
    "write --ros-args -r odom:=wheels",
}


@pytest.mark.parametrize(("libraries", "arguments"), CHOICES)
def test_installed_or_requested_ros_runs(
    libraries: str,
    arguments: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    installed(monkeypatch, libraries.split())
    monkeypatch.delenv("ROS_VERSION", raising=False)
    expected = CHOICES[libraries, arguments]
    if isinstance(expected, int):
        asked = int(arguments[1]) if arguments else None
        assert generation.choose_generation(asked) == expected
    else:
        assert main([*SPEC, *arguments]) == 2
        assert capsys.readouterr().err == f"ros_stl_monitor.py: error: {expected}\n"


@pytest.mark.parametrize("version", [1, 2])
def test_ros_version_decides_between_both(version: int, monkeypatch: pytest.MonkeyPatch) -> None:
    installed(monkeypatch, ["rospy", "rclpy"])
    monkeypatch.setenv("ROS_VERSION", str(version))
    assert generation.choose_generation(None) == version
    assert generation.choose_generation(3 - version) == 3 - version


def test_ros_is_imported_late(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("rospy", "rclpy"):
        (tmp_path / f"{name}.py").write_text("raise AssertionError('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    assert main([*SPEC, "--ros", "1", *REMAPPED]) == 2
    assert not {"rospy", "rclpy"} & set(sys.modules)


def test_the_help_fits_a_terminal_of_80_columns(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    options = {word for line in lines for word in line.split() if word.startswith("--")}
    of_ros_2 = {"depth", "autostart", "spec_file"}
    named = {name.replace("_", "-") for name in PARAMETERS if name not in of_ros_2}
    assert options >= {f"--{name}" for name in named} | {"--stl"}


@given(st.integers(1, 10**12), st.sampled_from(sorted(UNITS)))
def test_period_is_exact_to_the_nanosecond(number: int, unit: str) -> None:
    for value in (number, number / 1024):
        exact = Fraction(value) * UNITS[unit]
        if exact >= 1:
            _, settings = read({**DEFAULTS, "period": value, "unit": unit})
            assert abs(settings.period - exact) <= max(Fraction(1, 2), exact / 2**52)


def test_parameters_become_settings() -> None:
    plain = Settings()
    assert read(DEFAULTS) == ([], plain)
    stale = replace(plain, stale=0.25, stale_of={"/odom": 2.0})
    assert read({**DEFAULTS, "stale": ["/odom=2", "0.25"]})[1] == stale
    assert read({**DEFAULTS, "stale": 0.25})[1] == replace(plain, stale=0.25)
    settings = read({**DEFAULTS, "dense": True, "stamps": True, "record": "a.csv"})[1]
    assert settings == replace(plain, dense=True, stamps=True, record=Path("a.csv"))
    assert read({**DEFAULTS, "align": "nearest"})[1] == replace(plain, align="nearest")


def test_files_and_texts_are_monitored_together() -> None:
    path = str(ROOT / "examples" / "ros" / "spec.stl")
    specifications, _ = read({**DEFAULTS, "spec_file": path, "spec": ["x > 1", "y > 2"]})
    assert [spec.title for spec in specifications] == ["follows", None, None]
    assert list(map(str, specifications)) == [str(rtamt.load(path)), "x > 1", "y > 2"]


class Played(MemoryMiddleware):
    """Sends x = 2 and then ticks twice instead of waiting; records whether it was closed."""

    closed = False

    code = 0

    def spin(self) -> int:
        self.opened = (
            [subscription.topic for subscription in self.subscriptions],
            self.timers[0].period,
        )
        for value in (2.0, 1.25):
            self.send("rtamt/x", message("std_msgs", "Float64", data=value))
            self.tick(self.time + self.timers[0].period)
        return self.code

    def close(self) -> None:
        assert not [*self.subscriptions, *self.publishers, *self.timers], "the node runs on"
        self.closed = True


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Played:
    """Replaces ROS 1 for the command."""
    ros = Played()
    installed(monkeypatch, ["rospy"])
    monkeypatch.setattr(command, "open_node", lambda *_: ros)
    return ros


def test_command_runs_a_node(played: Played, tmp_path: Path) -> None:
    record = tmp_path / "record.csv"
    given = ["--period", "0.5", "--unit", "s", "--record", str(record)]
    assert main(["--spec", "out = x > 1", *given]) == 0
    assert played.closed
    assert played.opened == (["rtamt/x"], SECOND // 2)
    assert played.data("rtamt/out") == [1.0, 0.25]
    assert [line.split(",")[1:] for line in record.read_text().splitlines()] == [
        ["x", "robustness", "lower", "upper", "verdict"],
        ["2.0", "1.0", "1.0", "1.0", "1"],
        ["1.25", "0.25", "1.0", "1.0", "1"],  # bounds and verdict of the first sample
    ]


def test_exit_code_of_the_node(played: Played) -> None:
    played.code = 4
    assert main([*SPEC]) == 4
    assert played.closed


REFUSED = {
    "from geometry_msgs.msg import Twist\ninput Twist cmd\nx = cmd.linaer.x > 1": "STL:3:9: "
    "geometry_msgs/Twist has no field 'linaer'\n  x = cmd.linaer.x > 1\n          ^\n"
    "  hint: did you mean 'linear'?",
    "from absent_msgs.msg import Thing; input Thing it; x = it.y > 1": "absent_msgs is not "
    "installed",
}


@pytest.mark.parametrize("text", REFUSED)
def test_refused_specifications_exit_with_2(
    text: str, played: Played, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--spec", text]) == 2
    assert capsys.readouterr().err == f"ros_stl_monitor.py: error: {REFUSED[text]}\n"
    assert played.closed


def test_field_errors_name_the_file(
    tmp_path: Path, played: Played, capsys: pytest.CaptureFixture[str]
) -> None:
    text, path = next(iter(REFUSED)), tmp_path / "bad.stl"
    whole = (
        "STL:3:5: expected a field of the message 'cmd', got 'cmd' as a number\n"
        "  x = cmd > 1\n      ^\n"
        "  hint: write a field, such as cmd.x: a geometry_msgs/Twist is not a number"
    )
    for line, wrong in ((REFUSED[text], text), (whole, text.replace(".linaer.x", ""))):
        path.write_text(wrong, encoding="utf-8")
        assert main(["--stl", str(path)]) == 2
        assert capsys.readouterr().err == f"ros_stl_monitor.py: error: in {path}: {line}\n"
    assert played.closed


def test_options_become_ros_2_parameters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    installed(monkeypatch, ["rclpy"])
    runs: list[tuple[object, ...]] = []

    def run(*given: object) -> int:
        runs.append(given)
        return 7

    monkeypatch.setitem(sys.modules, "rtamt_ros.ros2_lifecycle", SimpleNamespace(run=run))
    spec = str(ROOT / "examples" / "ros" / "spec.stl")
    options = "--period 50 --stale 2 --stale robot0/cmd_vel=inf --stamps --qos reliable --ros 2"
    assert main(["--stl", spec, *options.split(), *REMAPPED]) == 7
    ((name, arguments, parameters),) = runs
    assert (name, arguments) == ("stl_monitor", [*REMAPPED])
    assert parameters == {
        "spec_file": [spec],
        "period": 50.0,
        "stale": ["2", "robot0/cmd_vel=inf"],
        "stamps": True,
        "qos": "reliable",
    }


@pytest.mark.parametrize(
    "words", ["-p spec_file:=a.stl", "--param spec:=x", "--params-file a.yaml"]
)
def test_ros_2_parameters_set_specifications(
    words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rtamt_ros.ros2_lifecycle", SimpleNamespace(run=lambda *_: 7))
    installed(monkeypatch, ["rclpy"])
    arguments = ["--period", "50", "--ros-args", *words.split()]
    assert main(arguments) == 7
    assert main(["--ros-args", "-r", "spec_file:=a"]) == 2
    assert "nothing to monitor: write --stl FILE" in capsys.readouterr().err
    installed(monkeypatch, ["rospy"])
    assert main(arguments) == 2
    assert "write parameters as options, which --help lists" in capsys.readouterr().err
