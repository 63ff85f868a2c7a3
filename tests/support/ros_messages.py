"""The messages of a probe, as objects, as a trace, and as bags."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Any

from ros_processes import PATIENCE, Ros
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_JAZZY)}
for _store in STORES.values():
    _store.register(
        get_types_from_msg("std_msgs/Header header\nfloat64 value", "rtamt_msgs/msg/FloatStamped")
    )


@dataclass(frozen=True)
class Heard:
    """A received message.

    Attributes:
        topic: The topic in the probe's arguments.
        kind: The type: ``nav_msgs/Odometry``.
        time: The time of arrival, in nanoseconds of the ROS clock.
        data: The bytes.
        md5: The hash of the type on ROS 1.
        generation: 1 or 2.
    """

    topic: str
    kind: str
    time: int
    data: bytes
    md5: str | None
    generation: int

    @property
    def type_name(self) -> str:
        """The type in the notation of `rosbags`."""
        return self.kind.replace("/", "/msg/")

    @cached_property
    def message(self) -> Any:  # noqa: ANN401 - its class is made by rosbags
        """The message, read without ROS."""
        store = STORES[self.generation]
        read = store.deserialize_ros1 if self.generation == 1 else store.deserialize_cdr
        return read(self.data, self.type_name)


class Probe:
    """A process that listens to topics; see `ros_probe`.

    Attributes:
        pid: Its process id.
    """

    def __init__(self, ros: Ros, process: subprocess.Popen[str]) -> None:
        self._generation = ros.generation
        self._process = process
        self.pid = process.pid
        self._heard: list[Heard] = []
        self._changed = threading.Condition()
        assert process.stdout is not None
        assert process.stdout.readline() == "null\n"
        self._reader = threading.Thread(target=self._read, args=(process.stdout,))
        self._reader.start()

    def _read(self, lines: IO[str]) -> None:
        with lines:
            for line in lines:
                said = json.loads(line)
                data = bytes.fromhex(said.pop("data"))
                with self._changed:
                    self._heard.append(Heard(data=data, generation=self._generation, **said))
                    self._changed.notify_all()

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait(PATIENCE)
        self._reader.join()

    def heard(self, topic: str) -> list[Heard]:
        """Return the messages of a topic so far."""
        with self._changed:
            return [each for each in self._heard if each.topic == topic]

    def wait(self, met: Callable[[], bool], what: str) -> None:
        """Wait until the received messages satisfy a condition, checked at every message."""
        with self._changed:
            assert self._changed.wait_for(met, PATIENCE), f"expected {what} within {PATIENCE:g} s"


@contextmanager
def probe(ros: Ros, topics: Mapping[str, str], *, last: bool = False) -> Iterator[Probe]:
    """Listen until the end of the block.

    Args:
        ros: The master or domain.
        topics: The types of topics: ``{"odom": "nav_msgs/Odometry"}``.
        last: Whether to receive latched messages too; ROS 1 always delivers them.
    """
    wanted = [f"{'+' if last else ''}{topic}={kind}" for topic, kind in topics.items()]
    process = subprocess.Popen(
        [sys.executable, Path(__file__).with_name("ros_probe.py"), str(ros.generation), *wanted],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        env=ros.environment,
        cwd=ros.folder,
    )
    found = Probe(ros, process)
    try:
        yield found
    finally:
        found.end()


def write_mcap(heard: list[Heard], folder: Path) -> Path:
    """Write messages as an MCAP bag of ROS 2; return its folder."""
    with Writer2(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connections = {
            each.topic: bag.add_connection(f"/{each.topic}", each.type_name, typestore=STORES[2])
            for each in {each.topic: each for each in heard}.values()
        }
        for each in heard:
            data = STORES[2].serialize_cdr(each.message, each.type_name)
            bag.write(connections[each.topic], each.time, data)
    return folder


def write_bag(heard: list[Heard], path: Path) -> Path:
    """Write messages of ROS 1 as a bag of ROS 1."""
    with Writer1(path) as bag:
        connections = {
            each.topic: bag.add_connection(f"/{each.topic}", each.type_name, typestore=STORES[1])
            for each in {each.topic: each for each in heard}.values()
        }
        for each in heard:
            bag.write(connections[each.topic], each.time, each.data)
    return path
