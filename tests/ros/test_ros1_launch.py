"""The launch files of ROS 1, run by roslaunch, and the states that the aggregator groups."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
from paths import ROOT
from ros_messages import probe
from ros_processes import Process, patiently, ros

TOPICS = {
    "rtamt/all": "diagnostic_msgs/DiagnosticArray",
    "diagnostics_agg": "diagnostic_msgs/DiagnosticArray",
}
LAUNCH = ["/usr/bin/roslaunch", "rtamt_ros"]
ARGUMENTS = ["name:=stl_monitor_left", "period:=50", "options:=--combined rtamt/all"]
ERROR = 2
"""The level of a status."""


def test_launch_files_start_a_monitor_and_its_aggregator(tmp_path: Path) -> None:
    with ros(1, tmp_path) as network, probe(network, TOPICS) as ears:
        environment = {
            **network.environment,
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "ROS_PACKAGE_PATH": f"{ROOT / 'ros'}:/usr/share",
        }

        def launch(name: str, *arguments: str) -> Process:
            command = [*LAUNCH, f"{name}.launch", *arguments]
            process = Process(command, environment, tmp_path / f"{name}.log")
            network.processes.append(process)
            patiently(lambda: "started with pid" in process.output)  # the first one sets /run_id
            return process

        def states(topic: str, name: str) -> list[Any]:
            arrays = [each.message for each in ears.heard(topic)]
            return [state for array in arrays for state in array.status if state.name == name]

        launched = [launch("stl_monitor", *ARGUMENTS), launch("aggregator")]
        name = "/Requirements/stl_monitor_left: follows"
        ears.wait(
            lambda: any("waiting for" in each.message for each in states("diagnostics_agg", name)),
            "a group",
        )
        network.start("-m", "rtamt_ros.simulator", "--stuck", "2:2", name="robot")
        ears.wait(
            lambda: any(each.level == ERROR for each in states("diagnostics_agg", name)),
            "a violation among the groups",
        )
        violated = [each for each in states("diagnostics_agg", name) if each.level == ERROR]
        assert violated[0].message.startswith("violated, robustness -0.")
        assert states("diagnostics_agg", "/Requirements")[-1].message == "Error"
        stamps = [each.message.header.stamp for each in ears.heard("rtamt/all")]
        times = np.array([stamp.sec * 10**9 + stamp.nanosec for stamp in stamps])
        assert set(np.diff(times) % 50_000_000) == {0}
        assert np.median(np.diff(times)) == 50_000_000
        for process in launched:
            process.signal(signal.SIGINT)
        assert [process.ended() for process in launched] == [0, 0]
        assert "Traceback" not in "".join(process.output for process in launched)
