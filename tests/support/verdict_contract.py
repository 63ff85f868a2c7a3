"""Verdicts and records of a monitor on real processes of ROS 1 and ROS 2, also if it is killed.

The tests of a generation subclass `VerdictContract` and have a fixture `world`. Verdicts are
compared with their definition on the samples that the node publishes, without `rtamt`.
"""

from __future__ import annotations

import csv
import threading
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ros_contract import FLOAT
from ros_messages import Heard, probe
from ros_processes import PATIENCE, Process
from ros_world import World

from rtamt_gym.__main__ import main

__all__ = ["VerdictContract"]

MS = 1_000_000
PERIOD = 50 * MS
ANSWER = 4
"""The number of samples until an answer is due."""

ANSWERED = """
from geometry_msgs.msg import PointStamped, Twist
input Twist cmd
output PointStamped a
output PointStamped b
@ topic(cmd, {0}/cmd)
@ topic(a, {0}/a)
@ topic(b, {0}/b)
@ topic(fast, {0}/fast)
@ topic(answer, {0}/answer)
a.point.x = cmd.linear.x >= 0
b.point.x = cmd.angular.z >= 0
fast = always(cmd.linear.x <= 0.9)
answer = always(cmd.linear.x >= 0.5 implies eventually[0:0.2s](cmd.angular.z >= 0.5))
"""
"""The robustness of `a` and `b` are the values of a sample."""

ABOVE = """
input float64 x
@ topic(x, {0}/x)
@ topic(out, {0}/out)
out = always(x > 0)
"""


def upper_fast(x: np.ndarray[Any, Any], _: object) -> np.ndarray[Any, Any]:
    """Return the upper bound of `fast` at each sample."""
    return np.minimum.accumulate(0.9 - x)


def upper_answer(x: np.ndarray[Any, Any], z: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return the upper bound of `answer` at each sample: only old triggers are decided."""
    upper = np.full(len(x), np.inf)
    for now in range(len(x)):
        for at in range(now - ANSWER + 1):
            answer = max(0.5 - x[at], *(z[at : at + ANSWER + 1] - 0.5))
            upper[now] = min(upper[now], answer)
    return upper


def stamp_of(heard: Heard) -> int:
    """Return the nanoseconds in the header of a message."""
    stamp = heard.message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


class VerdictContract:
    """The properties; a subclass has a fixture `world`."""

    @pytest.fixture
    def topic(self, request: pytest.FixtureRequest) -> str:
        """Return a namespace for this test only."""
        return f"/verdicts/{request.node.originalname}"

    @pytest.fixture
    def processes(self) -> Iterator[list[Process]]:
        """Return a list of processes that end with the test."""
        processes: list[Process] = []
        yield processes
        for process in processes:
            process.ask_to_end()
            process.ended()

    def test_live_verdicts_equal_their_definition(
        self, world: World, topic: str, processes: list[Process]
    ) -> None:
        names = {"fast": upper_fast, "answer": upper_answer}
        topics = {f"{topic}/{name}": "geometry_msgs/PointStamped" for name in "ab"}
        topics |= {f"{topic}/{name}/state": "diagnostic_msgs/DiagnosticArray" for name in names}
        topics |= {f"{topic}/{name}/verdict": "std_msgs/Int8" for name in names}
        world.talker.ask("publisher", topic, f"{topic}/cmd", "geometry_msgs", "Twist")
        random = np.random.default_rng(7)
        with probe(world.ros, topics) as ears:
            options = ["--spec", ANSWERED.format(topic), "--period", "50", "--stale", "inf"]
            processes.append(world.ros.start("-m", "rtamt_ros", *options, name="verdicts"))

            def violated(name: str) -> bool:
                return -1 in [each.message.data for each in ears.heard(f"{topic}/{name}/verdict")]

            for number in range(round(PATIENCE * 20)):
                # Odd sixteenths, so that no robustness is 0; commands are slow at first.
                x, z = (2 * random.integers(8, size=2) + 1) / 16
                values = {"linear.x": x * min(1.0, number / 80), "angular.z": z}
                world.talker.ask("publish", topic, values)
                threading.Event().wait(0.05)
                if all(map(violated, names)) and number > 160:
                    break
            assert all(map(violated, names)), processes[0].output
            last = stamp_of(ears.heard(f"{topic}/fast/state")[-1])
            ears.wait(
                lambda: stamp_of(ears.heard(f"{topic}/answer/state")[-1]) > last, "another state"
            )
            heard = {name: ears.heard(name) for name in topics}
        held = [
            {stamp_of(each): each.message.point.x for each in heard[f"{topic}/{name}"]}
            for name in "ab"
        ]
        for name, definition in names.items():
            compared = self.compare(heard[f"{topic}/{name}/state"], held, definition)
            assert compared["VIOLATED"] > 5
            assert compared["UNDECIDED"] > 5
            sent = [each.message.data for each in heard[f"{topic}/{name}/verdict"]]
            assert [verdict for verdict, _ in groupby(sent)][-2:] == [0, -1]

    def compare(
        self,
        states: list[Heard],
        held: list[dict[int, float]],
        definition: Any,  # noqa: ANN401
    ) -> dict[str, int]:
        """Compare the states with a definition; return how many had each verdict."""
        counts = {"VIOLATED": 0, "UNDECIDED": 0}
        samples = sorted(held[0].keys() & held[1].keys())
        values = {}
        for state in states:
            (status,) = state.message.status
            values[stamp_of(state)] = {pair.key: pair.value for pair in status.values}
        assert set(np.diff(samples)) == {PERIOD}, "a suspension"
        begin = samples[0]
        x, z = (np.array([each[time] for time in samples]) for each in held)
        upper = definition(x, z)
        for time, said in values.items():
            at = (time - begin) // PERIOD
            if not said["verdict"] or not 0 <= at < len(samples):
                continue
            assert said["verdict"] == ("VIOLATED" if upper[at] < 0 else "UNDECIDED"), at
            assert float(said["upper"]) == pytest.approx(upper[at], rel=1e-5), at
            counts[said["verdict"]] += 1
        return counts

    def test_a_killed_node_starts_again(
        self,
        world: World,
        topic: str,
        processes: list[Process],
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        """`kill -9` loses no sample older than a second, and the name is free again."""
        world.talker.ask("publisher", topic, f"{topic}/x", *FLOAT)
        world.listener.ask("subscribe", topic, f"{topic}/out", *FLOAT, ["data"])
        record = world.ros.folder / "killed.csv"
        spec = world.ros.folder / "above.stl"
        spec.write_text(ABOVE.format(topic), encoding="utf-8")
        name = ["__name:=killed"]
        if world.ros.generation == 2:
            name = ["--ros-args", "-r", "__node:=killed"]
        options: list[str | Path] = ["--stl", spec, "--record", record]
        options += ["--period", "50", "--stale", "inf", *name]

        def publish(x: float, count: int) -> None:
            for _ in range(count):
                world.talker.ask("publish", topic, {"data": x})
                threading.Event().wait(0.05)

        def start() -> Process:
            """Start the node, and publish until it has judged thirty samples."""
            before = len(world.listener.ask("kept", topic))
            node = world.ros.start("-m", "rtamt_ros", *options, name=f"killed{len(processes)}")
            processes.append(node)
            for _ in range(round(PATIENCE * 20)):
                publish(1.0, 1)
                if len(world.listener.ask("kept", topic)) > before + 30:
                    return node
            raise AssertionError(node.output)

        node = start()
        publish(-2.0, 30)
        judged = [value for _, value in world.listener.ask("kept", topic)].count(-2.0)
        node.kill()
        rows = self.rows(record)
        assert [row["robustness"] for row in rows].count("-2.0") >= judged - 20
        assert main(["monitor", str(spec), str(record), "--json"]) == 1
        assert '"robustness": -2.0' in capsys.readouterr().out
        node = start()
        values = {value for _, value in world.listener.ask("kept", topic)[-20:]}
        assert values == {1.0}, node.output
        node.ask_to_end()
        assert node.ended() == 0, node.output
        assert "another node" not in node.output
        assert {row["verdict"] for row in self.rows(record.with_stem("killed-2"))} == {"0"}

    def rows(self, path: Path) -> list[dict[str, str]]:
        """Return the rows of a record."""
        with path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))
