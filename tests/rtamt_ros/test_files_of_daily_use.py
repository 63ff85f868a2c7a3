"""The shipped files that start and show a monitor match its node."""

from __future__ import annotations

import ast
import configparser
import json
import re
import shlex
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from memory_middleware import MemoryMiddleware
from paths import ROOT
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

from rtamt import load
from rtamt_gym.__main__ import main
from rtamt_ros.command import _parser
from rtamt_ros.generation import split_arguments
from rtamt_ros.node import MonitorNode
from rtamt_ros.parameters import PARAMETERS, read

FOLDER = ROOT / "ros" / "rtamt_ros"
FOLLOWS = FOLDER / "config" / "follows.stl"
DEFAULTS = {name: default for name, (default, _) in PARAMETERS.items()}


@pytest.fixture(scope="module")
def published() -> set[str]:
    """Return the topics of numbers that a monitor of `FOLLOWS` publishes."""
    ros = MemoryMiddleware()
    node = MonitorNode(ros, [load(FOLLOWS)])
    node.start()
    found = {ros.resolve(each.topic) for each in ros.publishers if each.lease is None}
    node.stop()
    return found


def given(words: str) -> dict[str, Any]:
    """Return the options in the words of the command, with which a monitor starts."""
    options, _ = split_arguments(_parser(), shlex.split(words))
    found = vars(options)
    found["spec_file"] = found.pop("stl")
    specifications, _ = read({**DEFAULTS, **{k: v for k, v in found.items() if k != "ros"}})
    assert specifications
    return found


def test_ros_1_launch_file_starts_the_command() -> None:
    launch = ET.parse(FOLDER / "ros1/stl_monitor.launch").getroot()  # noqa: S314 - our own file
    assert launch.tag == "launch"
    arguments = {each.attrib["name"]: each.attrib["default"] for each in launch.iter("arg")}
    (node,) = launch.iter("node")
    asked = set(re.findall(r"\$\(arg (\w+)\)", ET.tostring(launch, "unicode")))
    assert asked == set(arguments)
    assert (node.attrib["pkg"], node.attrib["type"]) == ("rtamt_ros", "ros_stl_monitor.py")
    script = FOLDER / "ros1" / node.attrib["type"]
    assert script.stat().st_mode & 0o111
    assert script.read_text().splitlines()[0] == "#!/usr/bin/env python3"
    names = [
        each.name for each in ast.walk(ast.parse(script.read_text())) if isinstance(each, ast.alias)
    ]
    assert names == ["sys", "main"]

    words = node.attrib["args"]
    for name, value in {**arguments, "options": "--combined rtamt/all"}.items():
        words = words.replace(f"$(arg {name})", value)
    found = given(words.replace("$(find rtamt_ros)", str(FOLDER)))
    assert found["spec_file"] == [str(FOLLOWS)]
    assert (found["ros"], found["period"], found["unit"]) == (1, 100.0, "ms")
    assert found["combined"] == "rtamt/all"


def test_ros_2_launch_file_sets_known_parameters() -> None:
    tree = ast.parse((FOLDER / "launch/stl_monitor.launch.py").read_text())
    calls = [each for each in ast.walk(tree) if isinstance(each, ast.Call)]

    def first_of(name: str) -> set[str]:
        return {
            str(call.args[0].value)
            for call in calls
            if isinstance(call.func, ast.Name)
            and call.func.id == name
            and isinstance(call.args[0], ast.Constant)
        }

    (parameters,) = (each for each in ast.walk(tree) if isinstance(each, ast.Dict))
    names = {ast.literal_eval(key) for key in parameters.keys if key is not None}
    assert names == {"spec_file", "combined", "use_sim_time"}
    assert names - {"use_sim_time"} <= set(PARAMETERS)
    assert first_of("LaunchConfiguration") == first_of("DeclareLaunchArgument")
    assert names < first_of("DeclareLaunchArgument")


def test_aggregator_files_group_the_states_of_monitors() -> None:
    """The aggregator of ROS 1 reads its file in ``tests/ros/test_ros1_launch.py``."""
    (of_ros1,) = read_yaml("ros1/aggregator.yaml")["analyzers"].values()
    node = read_yaml("config/aggregator.yaml")["analyzers"]["ros__parameters"]
    (group,) = (each for each in node.values() if isinstance(each, dict))
    assert node["path"] == group["path"] == "Requirements"
    assert group == of_ros1
    assert set(group) == {"type", "path", "regex", "timeout"}
    assert group["type"] == "diagnostic_aggregator/GenericAnalyzer"
    ros = MemoryMiddleware(name="/robot3/stl_monitor_4711")
    monitor = MonitorNode(ros, [load(FOLLOWS)])
    monitor.start()
    ros.tick()
    states = [state for message in ros.on("/diagnostics") for state in message.status]
    assert [state.name for state in states] == ["robot3/stl_monitor_4711: follows"]
    (pattern,) = group["regex"]
    assert re.fullmatch(pattern, states[0].name)


def read_yaml(name: str) -> Any:  # noqa: ANN401
    """Return the values in a file of the package."""
    return YAML(typ="safe").load((FOLDER / name).read_text(encoding="utf-8"))


def settings_of(text: str) -> dict[str, str]:
    """Return the settings in a file of an environment."""
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return dict(line.split("=", 1) for line in lines)


def test_systemd_unit_starts_the_command() -> None:
    text = (FOLDER / "systemd/rtamt-monitor@.service").read_text()
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string(text)
    assert unit.sections() == ["Unit", "Service", "Install"]
    service = unit["Service"]
    environment = settings_of((FOLDER / "systemd/follows.env").read_text())
    shell, option, command = shlex.split(service["ExecStart"])
    assert (shell, option) == ("/bin/bash", "-c")
    used = set(re.findall(r"\$(\w+)", command))
    assert used <= set(environment)
    _, _, words = command.partition('exec "$PROGRAM" ')
    for name in used:
        words = words.replace(f"${name}", environment[name])
    words = words.replace(environment["SPEC"], str(FOLLOWS))
    assert given(words.replace('"', ""))["combined"] == "rtamt/all"
    assert environment["PROGRAM"].endswith("/ros_stl_monitor.py")
    assert service["Restart"] == "on-failure"
    assert service["RestartPreventExitStatus"].split() == ["2", "4"]


def panels(layout: Any) -> Iterator[str]:  # noqa: ANN401 - a tree of JSON
    """Return the panels of a layout of Foxglove; a branch has two and a direction."""
    if isinstance(layout, str):
        yield layout
        return
    assert set(layout) == {"direction", "first", "second", "splitPercentage"}
    assert layout["direction"] in ("row", "column")
    assert 0 < layout["splitPercentage"] < 100
    for part in ("first", "second"):
        yield from panels(layout[part])


def test_the_layout_of_foxglove_shows_the_topics(published: set[str]) -> None:
    layout = json.loads((FOLDER / "layouts/foxglove.json").read_text())
    assert set(layout) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    configs = layout["configById"]
    assert sorted(panels(layout["layout"])) == sorted(configs)
    assert {each.partition("!")[0] for each in configs} == {
        "Plot",
        "StateTransitions",
        "DiagnosticSummary",
    }
    shown = set()
    for name, config in configs.items():
        if "topicToRender" in config:
            shown.add(config["topicToRender"])
            assert set(config) >= {"minLevel", "pinnedIds", "hardwareIdFilter", "sortByLevel"}
            continue
        for path in config["paths"]:
            topic, _, field = path["value"].partition(".")
            assert field == "data"
            assert path["timestampMethod"] in ("receiveTime", "headerStamp")
            assert path.get("enabled", name.startswith("StateTransitions"))
            shown.add(topic)
    assert shown == published


def test_the_layout_of_plotjuggler_shows_the_topics(published: set[str]) -> None:
    root = ET.parse(FOLDER / "layouts/plotjuggler.xml").getroot()  # noqa: S314 - our own file
    assert root.tag == "root"
    (tab,) = root.findall("tabbed_widget/Tab")
    assert tab.attrib["containers"] == str(len(tab.findall("Container")))
    areas = 0
    for splitter in tab.iter("DockSplitter"):
        sizes = [float(each) for each in splitter.attrib["sizes"].split(";")]
        assert len(sizes) == len(splitter) == int(splitter.attrib["count"])
        assert sum(sizes) == pytest.approx(1)
        assert splitter.attrib["orientation"] in "-|"
        areas += len(splitter.findall("DockArea"))
    plots = tab.findall("Container//DockArea/plot")
    assert areas == len(plots) == 2
    assert {each.attrib["mode"] for each in plots} == {"TimeSeries"}
    for plot in plots:
        (span,) = plot.findall("range")
        assert set(span.attrib) == {"left", "right", "top", "bottom"}
    curves = [each.attrib["name"] for plot in plots for each in plot.findall("curve")]
    topics = {name.removesuffix("/data") for name in curves}
    assert topics == published - {"/diagnostics"}
    assert all(re.fullmatch("#[0-9a-f]{6}", each.attrib["color"]) for each in root.iter("curve"))
    streamer = root.find("previouslyLoaded_Streamer")
    plugin = root.find("Plugins/plugin")
    assert streamer is not None
    assert plugin is not None
    assert streamer.attrib["name"] == plugin.attrib["ID"] == "ROS2 Topic Subscriber"
    # PlotJuggler reads a missing element as false, or as arrays of at most 0 elements.
    settings = {each.tag: each.attrib["value"] for each in plugin if each.tag != "selected_topics"}
    assert settings == {
        "use_header_stamp": "false",
        "discard_large_arrays": "true",
        "max_array_size": "100",
        "boolean_strings_to_number": "true",
        "remove_suffix_from_strings": "true",
    }
    selected = plugin.find("selected_topics")
    assert selected is not None
    assert set(selected.attrib["value"].split(";")) == topics


def test_a_recording_has_the_topics_of_the_layouts_but_bounds(
    published: set[str], tmp_path: Path
) -> None:
    output = tmp_path / "judged.mcap"
    arguments = [str(FOLLOWS), str(ROOT / "examples/drive.mcap"), "--period", "100ms"]
    assert main(["monitor", *arguments, "--write-mcap", str(output)]) in (0, 1)
    with AnyReader([output]) as reader:
        written = {
            connection.topic: reader.typestore.fielddefs[connection.msgtype][1]
            for connection in reader.connections
            if connection.topic.startswith("/rtamt/")
        }
    bounds = {"/rtamt/follows/lower", "/rtamt/follows/upper"}
    assert set(written) == published - bounds - {"/diagnostics"}
    assert all("data" in [name for name, _ in fields] for fields in written.values())
