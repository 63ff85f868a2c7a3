"""The tutorial of a robot on a real ROS: its exact commands, and their output."""

from __future__ import annotations

import os
import re
import shlex
import signal
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from paths import ROOT
from ros_messages import probe
from ros_processes import Process, patiently, ros
from tutorial_page import block

from rtamt_gym.__main__ import main

__all__ = ["LiveTutorial", "Played", "play_tutorial"]

NEAR, VERDICT = "rtamt/near", "rtamt/follows/verdict"
TOPICS = {NEAR: "std_msgs/Float64", VERDICT: "std_msgs/Int8"}


@dataclass(frozen=True)
class Played:
    """The results of the commands of the tutorial.

    Attributes:
        folder: Their folder.
        said: The output of the monitor.
        watched: The output of the page's program that shows a topic; on ROS 2.
        heard: The numbers on each of `TOPICS`.
        codes: Exit codes of the processes that Ctrl-C ended, by name.
        again: The output of the monitor after the second start of the robot.
    """

    folder: Path
    said: str
    watched: str
    heard: Mapping[str, list[float]]
    codes: Mapping[str, int]
    again: str


def words(command: str) -> list[str]:
    """Return the words of a command of the page, without the program."""
    return shlex.split(block(command)[0].removeprefix("$ "))[1:]


def play_tutorial(generation: int, folder: Path) -> Played:
    """Run the tutorial."""
    (folder / "examples").symlink_to(ROOT / "examples")
    script = Path(sys.executable).with_name("ros_stl_monitor.py")
    program = [script] if script.exists() else ["-m", "rtamt_ros"]
    with ros(generation, folder) as network, probe(network, TOPICS) as ears:
        started = {"monitor": network.start(*program, *words("ros_stl_monitor.py"), name="monitor")}
        if generation == 2:
            watch = folder / "watch.py"
            watch.write_text("\n".join(block("from contextlib import suppress")))
            started["watch"] = network.start(watch, name="watch")
        patiently(lambda: started["monitor"].output.count("nobody publishes") == 2)
        if generation == 1:
            line = block("rosbag record")[0]
            command = shlex.split(line, comments=True)
            started["bag"] = Process(command, network.environment, folder / "bag.log")
            network.processes.append(started["bag"])
            patiently((folder / "run.bag.active").exists)  # it prints at its end
        simulator = words("python -m rtamt_ros.simulator")
        started["robot"] = network.start(*simulator, name="robot")

        def numbers(topic: str) -> list[float]:
            return [each.message.data for each in ears.heard(topic)]

        ears.wait(lambda: min(numbers(NEAR), default=0.0) < -0.5, "a wheel that blocks")
        ears.wait(lambda: numbers(NEAR)[-1] > 0, "a robot that goes on")
        codes = {}
        monitor = started["monitor"]
        known = "follows: robustness not known yet"

        def stop(name: str) -> None:
            os.kill(started[name].pid, signal.SIGINT)
            codes[name] = started[name].ended()

        stop("robot")
        stale = re.compile("(cmd|odom) stale")  # the inputs may be stale one sample apart
        patiently(lambda: stale.search(monitor.output) is not None)
        if generation == 1:
            stop("bag")
        said = monitor.output
        started["again"] = network.start(*simulator, name="again")
        patiently(lambda: known in monitor.output[len(said) :])
        for name in [name for name in ("again", "monitor", "watch") if name in started]:
            stop(name)
        watched = (folder / "watch.log").read_text() if generation == 2 else ""
        heard = {topic: numbers(topic) for topic in TOPICS}
        return Played(folder, said, watched, heard, codes, monitor.output[len(said) :])


def lines(said: str) -> list[tuple[str, str]]:
    """Return levels and texts of a log, with ``#`` for numbers; a busy machine delays samples."""
    found = re.findall(r"^\[(\w+)\] .*?\]: (.*)$", said, re.MULTILINE)
    texts = [re.sub(r"; \d+ (samples? late|messages? taken late)", "", text) for _, text in found]
    return [
        (level, re.sub(r"-?\d+(\.\d+)?(?![\w/])", "#", text))
        for (level, _), text in zip(found, texts, strict=True)
    ]


class LiveTutorial:
    """The properties; a subclass has a fixture `played`."""

    def test_the_monitor_says_what_the_page_shows(self, played: Played) -> None:
        shown, said = lines("\n".join(block("ros_stl_monitor.py"))), lines(played.said)
        assert said[: len(shown) - 1] == shown[:-1]
        level, text = said[len(shown) - 1]  # the inputs may be stale one sample apart
        assert level == shown[-1][0]
        assert re.fullmatch(r"follows: (cmd stale # s; )?(odom stale # s; )?violated .*", text)
        assert text.endswith(shown[-1][1].rpartition("; ")[2])

    def test_the_violation_is_as_deep_as_on_the_page(self, played: Played) -> None:
        depth = re.compile(r"violated, robustness (-[\d.]+)")
        shown, said = (
            depth.search(text) for text in ("\n".join(block("ros_stl_monitor.py")), played.said)
        )
        assert shown is not None
        assert said is not None
        assert float(said[1]) == pytest.approx(float(shown[1]), abs=0.05)
        assert min(played.heard[NEAR]) == pytest.approx(float(shown[1]), abs=0.05)
        assert -1 in played.heard[VERDICT]

    def test_the_record_is_judged_as_the_page_says(self, played: Played) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(played.folder)
            assert main(["monitor", "examples/follows.stl", "run.csv"]) == 1
        rows = np.genfromtxt(played.folder / "run.csv", delimiter=",", names=True, dtype=None)
        assert np.nanmin(rows["robustness"]) == pytest.approx(min(played.heard[NEAR]), abs=0.05)

    def test_a_second_start_is_a_new_run(self, played: Played) -> None:
        reason = r"restarted 1 time because (cmd, odom were|cmd was|odom was) stale"
        level, text = lines(played.again)[0]
        assert level == "WARN"
        assert re.fullmatch(
            rf"follows: robustness not known yet; violated # time since start, .*; {reason}",
            text.replace("restarted # time", "restarted 1 time"),
        )

    def test_ctrl_c_ends_all_in_good_order(self, played: Played) -> None:
        assert set(played.codes.values()) == {0}
        assert "Traceback" not in played.said
