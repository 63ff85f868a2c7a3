"""Measure the node against the bare middleware, and against the public node of 2020 if it exists.

    python tests/bench/ros/run.py [latency drift memory late agree restarts] [--quick] [--seconds N]
        [--json FILE]

This command measures late samples of 1 and 20 specifications, on free and on busy processors,
against a bare publisher and with raised priority. It takes twelve minutes on an idle machine:

    python tests/bench/ros/run.py late

The interpreter must have rospy or rclpy, which selects the generation, and rtamt installed: the
checkout has no native machines. Each figure comes from processes of its own on the loopback
interface of one host. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import agree
import drift
import late
import latency
import memory
import restarts
from bench import HOP, Subject, first, of_2020, ours, relay

from rtamt import BACKEND

Row = dict[str, Any]
SECONDS = {10.0: 30.0, 100.0: 20.0, 1000.0: 10.0}
"""Seconds of measured latencies, by the rate in Hz."""


def latencies(generation: int, peers: list[Subject], *, quick: bool) -> Iterator[Row]:
    """Return rows of latencies; the first one is the middleware alone."""
    nodes = [ours(count=n, dense=dense) for dense in (False, True) for n in (1, 20)]
    for subject in (HOP, relay(generation), *nodes, *peers):
        for rate, seconds in SECONDS.items():
            result = latency.measure(generation, subject, rate, 3.0 if quick else seconds)
            row: Row = {"what": subject.name, "Hz": rate}
            row["p50"], row["p99"], row["max"] = latency.quantiles(result.whole)
            if subject.message.endswith("Stamped") and not subject.name.startswith("dense"):
                tick = latency.quantiles(result.after_tick)
                row["tick p50"], row["tick p99"], row["tick max"] = tick
            yield row | {"unseen %": 100 * result.unseen, "CPU %": 100 * result.load}


def drifts(generation: int, peers: list[Subject], *, quick: bool) -> Iterator[Row]:
    """Return rows of drifts at 100 Hz."""
    seconds = 10.0 if quick else 600.0
    for subject in (ours(), *peers):
        result = drift.measure(generation, subject, 100.0, seconds)
        p50, p99, greatest = latency.quantiles(abs(result.late))
        yield {
            "what": subject.name,
            "s": seconds,
            "periods": result.periods,
            "values": result.values,
            "missed": result.missed,
            "drift us": result.drift / 1e3,
            "off p50": p50,
            "off p99": p99,
            "off max": greatest,
        }


def memories(generation: int, peers: list[Subject], *, quick: bool) -> Iterator[Row]:
    """Return rows of the memory in MB over an hour of simulated time."""
    steps = 1_000 if quick else memory.STEPS
    simulated = () if generation == 1 else ("--ros-args", "-p", "use_sim_time:=true")
    nodes = [ours(dense=dense, ros_arguments=simulated) for dense in (False, True)]
    for subject in (*nodes, *peers):
        result = memory.measure(generation, subject, steps)
        yield {
            "what": subject.name,
            "steps": steps,
            "MB at 10 %": result.early / 1e6,
            "50 %": result.half / 1e6,
            "100 %": result.whole / 1e6,
            "unanswered": result.unanswered,
            "steps/s": result.speed,
        }


def lates(
    generation: int, _peers: list[Subject], *, quick: bool, seconds: float | None = None
) -> Iterator[Row]:
    """Return rows of late samples at 200 Hz, with all processors free and with all busy.

    The first row is the bare publisher of as many topics, then follows the node with normal
    priority, and then with ``chrt -f 10``, if that is permitted.
    """
    seconds = seconds or (6.0 if quick else 60.0)
    for busy in (0, os.cpu_count() or 1):
        for count in (1, 20):
            bare = late.floor(generation, 200.0, seconds, count=count, busy=busy)
            yield _late_row(f"bare, {count} topic{'s' * (count > 1)}", busy, bare)
            for subject in (ours(count=count), *first(ours(count=count))):
                result = late.measure(generation, subject, 200.0, seconds, count=count, busy=busy)
                yield _late_row(subject.name, busy, result)


def _late_row(title: str, busy: int, result: late.Late) -> Row:
    row: Row = {"what": title, "busy": busy, "samples": result.samples, "late": result.late}
    row["late %"] = 100 * result.late / result.samples
    row["p50"], row["p99"], row["max"] = latency.quantiles(result.after_stamp)
    return row | {"CPU %": 100 * result.load}


def agreements(
    generation: int, _peers: list[Subject], *, quick: bool, seconds: float | None = None
) -> Iterator[Row]:
    """Return rows of the comparison with an independent evaluator, processors free and busy.

    With ``seconds``, return one row for the machine as it is.
    """
    for busy in (0, *(() if seconds else (os.cpu_count() or 1,))):
        seconds = seconds or (20.0 if quick else 600.0)
        result = agree.measure(generation, seconds, busy=busy)
        yield {"what": "sampled", "s": seconds, "busy": busy} | vars(result)


def beginnings(
    generation: int, _peers: list[Subject], *, quick: bool, seconds: float | None = None
) -> Iterator[Row]:
    """Return rows of restarts in dense time at 300 Hz, processors free and busy."""
    for busy in (0, os.cpu_count() or 1):
        seconds = seconds or (20.0 if quick else 600.0)
        result = restarts.measure(generation, seconds, busy=busy)
        yield {"what": "dense", "s": seconds, "busy": busy} | vars(result)


SECTIONS: dict[str, tuple[Callable[..., Iterator[Row]], str]] = {
    "latency": (latencies, "publish of the input to arrival of the robustness [us]"),
    "drift": (drifts, "drift at 100 Hz, and times of arrival off a regular course [us]"),
    "late": (lates, "late samples at 200 Hz, and stamp to arrival [us]"),
    "agree": (agreements, "a node at 100 Hz and an evaluator of its own"),
    "restarts": (beginnings, "a node in dense time at 300 Hz, violated from message 1,000 on"),
    "memory": (memories, "memory over an hour of messages at full speed"),
}

LASTING = ("agree", "restarts", "late")
"""The sections with a duration as an option."""


def cell(value: object) -> str:
    """Return a figure in few characters."""
    if isinstance(value, float):
        return f"{value:.1f}" if abs(value) < 100 else f"{value:.0f}"
    return str(value)


def table(rows: list[Row], title: str) -> str:
    """Return a table of rows with their names above."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    lines = [names] + [[cell(row.get(name, "")) for name in names] for row in rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    first, *others = widths
    text = [title]
    for line in lines:
        cells = [c.rjust(width) for c, width in zip(line[1:], others, strict=True)]
        text.append("  ".join([line[0].ljust(first), *cells]))
    return "\n".join(text)


def main() -> None:
    """Run sections and print their tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--quick", action="store_true", help="seconds instead of minutes")
    parser.add_argument(
        "--seconds",
        type=float,
        help=f"how long each run of {', '.join(LASTING)} takes (600, late 60)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures there")
    parser.add_argument(
        "--peer",
        nargs=3,
        metavar=("PYTHON", "SCRIPT", "MESSAGES"),
        help="the node of 2020, on ROS 1: an interpreter with its rtamt and rospy, its "
        "ros_stl_monitor.py, and the folder of the package rtamt_msgs",
    )
    arguments = parser.parse_args()
    if unknown := set(arguments.sections) - set(SECTIONS):
        parser.error(f"expected sections out of {', '.join(SECTIONS)}, got {unknown.pop()!r}")

    generation = 1 if importlib.util.find_spec("rospy") else 2
    peers = [of_2020(*arguments.peer)] if arguments.peer else []
    tables = {}
    python, processors = platform.python_version(), os.cpu_count()
    print(f"ROS {generation}, Python {python}, {BACKEND} machines, {processors} processors")
    for name in arguments.sections or SECTIONS:
        measure, title = SECTIONS[name]
        begin, load = time.monotonic(), os.getloadavg()[0]
        rows = []
        lasting = {"seconds": arguments.seconds} if name in LASTING else {}
        for row in measure(generation, peers, quick=arguments.quick, **lasting):
            rows.append(row)
            print("  ".join(map(cell, row.values())), flush=True)
        tables[name] = rows
        print(f"\n{table(rows, title)}")
        print(f"({name}: {time.monotonic() - begin:.0f} s, load {load:.1f} before)\n")
    if arguments.json:
        arguments.json.write_text(json.dumps(tables, indent=1))


if __name__ == "__main__":
    main()
