"""A robot, its controller and two monitors as processes, and the results of their run.

The monitors wait; the robot drives; the controller drives backwards for a time, later the wheels
block for a time; the robot is killed. `ros_live` checks the results.

On a busy machine, two processes may discover a third one seconds apart. The faults therefore start
after all have had the time, and assertions on the probe wait for the probe.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import isnan
from pathlib import Path
from typing import Any

from ros_messages import Heard, Probe, probe
from ros_processes import Process, ros
from ros_sockets import Address, listening

PERIOD = 100_000_000
"""Nanoseconds between the samples of the sampled monitor."""
ODOM, CMD, DIAGNOSTICS = "robot0/odom", "robot0/cmd_vel", "/diagnostics"
ALL = "monitor/all"
FOLLOWS, KEEPS, MOVES, EVENTS = "rtamt/follows", "rtamt/keeps", "rtamt/moves", "rtamt/events"
STAMPED = {
    1: ("rtamt_msgs", "FloatStamped", "value"),
    2: ("sensor_msgs", "Temperature", "temperature"),
}
"""A message with a header and a number: the message of the paper needs a workspace on ROS 2."""

INPUTS = f"""
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
input Twist cmd
input Odometry odom
@ topic(cmd, {CMD})
@ topic(odom, /{ODOM})
"""
GAP = "abs(cmd.linear.x - odom.twist.twist.linear.x) <= 0.5"
MOVED = "odom.pose.pose.position.y > 1.25"
WHOLE = f"""{INPUTS}
keeps = always({GAP})
moves = eventually({MOVED})
"""
"""Requirements on the whole run: the faults violate one, the other is soon satisfied."""
DENSE = f"{INPUTS} events = historically[0:0.3]({GAP})"


def stamped(generation: int) -> str:
    """The paper's requirement on its first robot, over the last 0.3 s, as a stamped message."""
    package, kind, field = STAMPED[generation]
    return f"""
from {package}.msg import {kind}
{INPUTS}
output {kind} follows
@ topic(follows, {FOLLOWS})
follows.{field} = historically[0:0.3]({GAP})
"""


def numbers(heard: Sequence[Heard]) -> list[float]:
    """Return the numbers in Float64 or stamped messages."""
    fields = {"std_msgs/Float64": "data", **{f"{p}/{k}": field for p, k, field in STAMPED.values()}}
    return [getattr(each.message, fields[each.kind]) for each in heard]


def dips(values: Sequence[float]) -> int:
    """Return how often values fell below 0 and rose again."""
    below = [sign for sign, _ in groupby(value < 0 for value in values if not isnan(value))]
    return sum(below[:-1])


def statuses(heard: Sequence[Heard]) -> list[Any]:
    """Return every status in diagnostics."""
    return [status for each in heard for status in each.message.status]


SAMPLED = (
    f"--stl follows.stl --stl whole.stl --combined {ALL}",
    f"--period {PERIOD // 1_000_000} --unit ms --stale 1 --record sampled.csv",
)
DRIVER = ("--surge 3:0.3:-0.5",)
ROBOT = ("--lag 0.2 --start-x 0.6 --start-y 0.6 --start-heading 2", "--stuck 4.7:0.5")


@dataclass(frozen=True)
class Run:
    """The results of a run of the scenario.

    Attributes:
        folder: The folder with specifications, records and logs.
        heard: The messages of each topic, in order.
        early: The messages from before the start of the controller.
        late: The messages that a subscriber received after the end of the robot.
        addresses: The listening addresses of the processes while all ran.
        codes: Exit codes of the processes that ended on request, by name.
    """

    folder: Path
    heard: Mapping[str, list[Heard]]
    early: Mapping[str, list[Heard]]
    late: Mapping[str, list[Heard]]
    addresses: list[Address]
    codes: Mapping[str, int]


def topics_of(generation: int) -> dict[str, str]:
    """Return the topics of a run and their types."""
    topics = {
        ODOM: "nav_msgs/Odometry",
        CMD: "geometry_msgs/Twist",
        DIAGNOSTICS: "diagnostic_msgs/DiagnosticArray",
        ALL: "diagnostic_msgs/DiagnosticArray",
        FOLLOWS: "/".join(STAMPED[generation][:2]),
    }
    for name in (KEEPS, MOVES, EVENTS):
        topics |= {name: "std_msgs/Float64", f"{name}/verdict": "std_msgs/Int8"}
    return topics


def says(ears: Probe, text: str, name: str) -> None:
    """Wait until diagnostics contain a text for a requirement."""
    ears.wait(
        lambda: any(
            text in each.message and name in each.name for each in statuses(ears.heard(DIAGNOSTICS))
        ),
        f"{text!r} of {name}",
    )


def until(ears: Probe, topic: str, met: Callable[[list[float]], bool], what: str) -> None:
    """Wait until the numbers on a topic satisfy a condition."""
    ears.wait(lambda: met(numbers(ears.heard(topic))), f"{what} on {topic}")


def play(generation: int, folder: Path) -> Run:
    """Play the scenario."""
    for name, text in (("follows", stamped(generation)), ("whole", WHOLE), ("dense", DENSE)):
        (folder / f"{name}.stl").write_text(text, encoding="utf-8")
    topics = topics_of(generation)
    with ros(generation, folder) as world, probe(world, topics) as ears:

        def start(name: str, *line: str) -> Process:
            return world.start("-m", *" ".join(line).split(), "--ros", str(generation), name=name)

        asked = {
            "sampled": start("sampled", "rtamt_ros", *SAMPLED),
            "dense": start(
                "dense", "rtamt_ros --stl dense.stl --dense --stale 1 --record dense.csv"
            ),
        }
        for name in ("follows", "events"):
            says(ears, "waiting for", name)
        robot = start("robot", "rtamt_ros.simulator --only robot", *ROBOT)
        until(ears, MOVES, bool, "a number")  # it reads only the odometry
        ears.wait(lambda: bool(ears.heard(ODOM)), "odometry")
        early = {topic: ears.heard(topic) for topic in topics}
        asked["controller"] = start("controller", "rtamt_ros.simulator --only controller", *DRIVER)
        for topic in (FOLLOWS, EVENTS):
            until(ears, topic, lambda values: dips(values) == 2, "two faults")
        addresses = listening([ears.pid, *(each.pid for each in world.processes)])
        robot.kill()
        for topic in (FOLLOWS, KEEPS, EVENTS):
            until(ears, topic, lambda values: any(map(isnan, values)), "nan")
        for name in ("follows", "events"):
            says(ears, "odom stale", name)
        last = {topic: topics[topic] for topic in (FOLLOWS, KEEPS)}
        with probe(world, last, last=True) as late:
            late.wait(lambda: all(map(late.heard, last)), "what is latched")
            after = {topic: late.heard(topic) for topic in last}
        for process in asked.values():
            process.ask_to_end()
        codes = {name: process.ended() for name, process in asked.items()}
        heard = {topic: ears.heard(topic) for topic in topics}
        return Run(folder, heard, early, after, addresses, codes)
