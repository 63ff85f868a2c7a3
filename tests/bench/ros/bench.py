"""The subjects: our node, the node of 2020 or the middleware, and the processes around them."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
sys.path.append(str(ROOT / "tests" / "support"))

from ros_processes import Process, Ros, ros  # noqa: E402 - found on the path above

INPUT = "bench/cmd"
PATIENCE = 30.0
"""Seconds for a process to start or to end."""


@dataclass(frozen=True)
class Subject:
    """A node that takes Twists on `INPUT` and publishes their `linear.x` as a robustness.

    Attributes:
        name: Its name in the tables.
        topic: The topic of the robustness that is measured.
        message: The class of its messages.
        field: The field with the robustness.
        command: Writes its files into a folder and returns the command that starts it, for a period
            in milliseconds; None if there is no node and the sink reads the source.
        environment: Variables of its environment.
    """

    name: str
    topic: str
    message: str
    field: str
    command: Callable[[Path, float], list[str]] | None
    environment: tuple[tuple[str, str], ...] = ()


HOP = Subject("one hop", INPUT, "geometry_msgs/Twist", "linear.x", None)
"""A publisher and a subscriber."""


def relay(generation: int) -> Subject:
    """Return two hops: a process that subscribes and publishes each message again."""
    arguments = {"ros": generation, "topic": INPUT, "to": "bench/relayed"}
    command = [sys.executable, str(HERE / "worker.py"), "relay", json.dumps(arguments)]
    return Subject("two hops", "bench/relayed", "std_msgs/Float64", "data", lambda *_: command)


def ours(*, dense: bool = False, count: int = 1, ros_arguments: tuple[str, ...] = ()) -> Subject:
    """Return the node of this project with several specifications; the last one is measured."""
    last = f"bench/out{count - 1}"

    def command(folder: Path, period: float) -> list[str]:
        files = [folder / f"bench{number}.stl" for number in range(count)]
        for number, file in enumerate(files):
            file.write_text(
                f"""specification bench{number}
                from geometry_msgs.msg import Twist
                from geometry_msgs.msg import PointStamped
                input Twist cmd
                output PointStamped out
                @ topic(cmd, {INPUT})
                @ topic(out, bench/out{number})
                out.point.x = once[0:1s](cmd.linear.x >= 0)
                """
            )
        options = [option for file in files for option in ("--stl", str(file))]
        options += ["--dense"] if dense else ["--period", f"{period:g}", "--unit", "ms"]
        return [sys.executable, "-m", "rtamt_ros", *options, *ros_arguments]

    name = f"{'dense' if dense else 'sampled'}, {count} spec{'s' * (count > 1)}"
    return Subject(name, last, "geometry_msgs/PointStamped", "point.x", command)


def first(subject: Subject) -> list[Subject]:
    """Return the same subject with real-time priority; nothing if that is not permitted."""
    before = ["chrt", "-f", "10"]
    try:
        subprocess.run([*before, "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        return []
    make, name = subject.command, f"{subject.name}, first"
    assert make is not None
    return [replace(subject, name=name, command=lambda *arguments: [*before, *make(*arguments)])]


def of_2020(python: str, script: str, messages: str) -> Subject:
    """Return the public node of 2020 from its interpreter, script and folder of `rtamt_msgs`."""

    def command(folder: Path, period: float) -> list[str]:
        file = folder / "bench2020.stl"
        file.write_text(
            f"""specification bench
            from geometry_msgs.msg import Twist
            from rtamt_msgs.msg import FloatStamped
            input Twist cmd
            output FloatStamped out
            @ topic(cmd, {INPUT})
            @ topic(out, bench/old)
            out.value = once[0:1s](cmd.linear.x >= 0)
            """
        )
        return [python, script, "--stl", str(file), "--period", f"{period:g}", "--unit", "ms"]

    path = (("PYTHONPATH", messages),)
    return Subject("2020", "bench/old", "rtamt_msgs/FloatStamped", "value", command, path)


class Bench:
    """Processes on a network of their own, and the figures that they save.

    Attributes:
        ros: The network.
        node: The process of the subject, once started.
    """

    def __init__(self, network: Ros) -> None:
        self.ros = network
        self.node: Process | None = None

    def start(self, subject: Subject, period: float) -> None:
        """Start the node of a subject, if it has one."""
        if subject.command is None:
            return
        command = subject.command(self.ros.folder, period)
        environment = self.ros.environment | dict(subject.environment)
        self.node = Process(command, environment, self.ros.folder / "node.log")
        self.ros.processes.append(self.node)

    def worker(self, role: str, subject: Subject | None = None, **arguments: object) -> Process:
        """Start a process of `worker.py`, and wait until it is ready."""
        arguments |= {"ros": self.ros.generation, "file": str(self.ros.folder / f"{role}.npy")}
        if subject is not None:
            arguments |= {"message": subject.message, "field": subject.field}
        environment = dict(self.ros.environment) | dict(subject.environment if subject else ())
        command = [sys.executable, str(HERE / "worker.py"), role, json.dumps(arguments)]
        process = Process(command, environment, self.ros.folder / f"{role}.log")
        self.ros.processes.append(process)
        self.wait(lambda: "ready" in process.output, process, PATIENCE)
        return process

    def wait(self, condition: Callable[[], bool], process: Process, seconds: float) -> None:
        """Wait for a condition on a process; raise its output if it ends or takes too long."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end or not process.runs():
                if condition():
                    return
                output = self.node.output[-2000:] if self.node else ""
                raise RuntimeError(f"{process.output[-2000:]}\n{output}")
            time.sleep(0.02)

    def load(self, role: str) -> np.ndarray:
        """Return the figures that a worker saved."""
        return np.load(self.ros.folder / f"{role}.npy")


@contextmanager
def bench(generation: int) -> Iterator[Bench]:
    """Run a network of its own until the end of the block."""
    with tempfile.TemporaryDirectory() as folder, ros(generation, Path(folder)) as network:
        yield Bench(network)
