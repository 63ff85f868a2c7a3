"""Nodes as processes on a middleware of their own: a master or a domain on the loopback interface.

Everything ends with its block: a process gets a signal, and is killed if it continues.
"""

from __future__ import annotations

import importlib.util
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import xmlrpc.client
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path

ROSMASTER = Path("/usr/bin/rosmaster")
INSTALL = {
    1: "expected rospy and rosmaster, which are not installed; on Debian, bash .ci/run ros ros1 "
    "installs both and runs these tests",
    2: "expected rclpy, which is not installed; bash .ci/run ros ros2 makes an environment that "
    "has it and runs these tests there",
}

PROFILE = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors>
    <transport_descriptor>
      <transport_id>loopback</transport_id>
      <type>UDPv4</type>
      <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
    </transport_descriptor>
  </transport_descriptors>
  <participant profile_name="loopback" is_default_profile="true">
    <rtps>
      <useBuiltinTransports>false</useBuiltinTransports>
      <userTransports><transport_id>loopback</transport_id></userTransports>
      <builtin>
        <discovery_config>
          <leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
          <initialAnnouncements>
            <count>20</count>
            <period><sec>0</sec><nanosec>50000000</nanosec></period>
          </initialAnnouncements>
        </discovery_config>
      </builtin>
    </rtps>
  </participant>
</profiles>
"""
"""Fast DDS on the loopback interface only: no shared memory, no other addresses.

Participants announce themselves often: on a busy machine, one that misses an announcement would
wait 3 s for the next.
"""

PATIENCE = 30.0
"""Seconds; only a broken program takes this long."""

STEP = 0.02
"""Seconds between checks of a condition without an event."""

BOOTSTRAP = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
"""Variables that the wheels of ROS 2 set for their own environment, removed for other environments.
"""


def missing(generation: int) -> str | None:
    """Return how to install a generation; None if it is installed."""
    library = importlib.util.find_spec({1: "rospy", 2: "rclpy"}[generation])
    there = library is not None and (generation == 2 or ROSMASTER.exists())
    return None if there else INSTALL[generation]


def patiently(met: Callable[[], bool]) -> None:
    """Wait for a condition that has no event."""
    for _ in range(round(PATIENCE / STEP)):
        if met():
            return
        threading.Event().wait(STEP)
    raise AssertionError("it does not come to hold")


def free_port() -> int:
    """Return a free TCP port."""
    with closing(socket.socket()) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def ports_of(domain: int) -> range:
    """Return the UDP ports of a domain of DDS."""
    return range(7400 + 250 * domain, 7400 + 250 * (domain + 1))


def free_domain() -> int:
    """Return an unused domain; domains above 100 share ports with ephemeral ports of the kernel."""
    while True:
        domain = random.randrange(1, 101)
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as found:
            try:
                found.bind(("127.0.0.1", ports_of(domain)[0]))
            except OSError:
                continue
            return domain


class Process:
    """A process with its output in a file; it ends with its `Ros` at the latest.

    Attributes:
        name: The name of the file.
        pid: Its process id.
    """

    def __init__(self, command: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        self._log = log
        self.name = log.stem
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                cwd=log.parent,
            )
        self.pid = self._process.pid

    @property
    def output(self) -> str:
        """Its output so far."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def runs(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def kill(self) -> None:
        """Kill it, as a crash does."""
        self._process.kill()
        self._process.wait(PATIENCE)

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self._process.send_signal(number)

    def ask_to_end(self) -> None:
        """Request its end, as a service manager does."""
        self._process.terminate()

    def ended(self) -> int:
        """Wait for its end, and kill it after a time limit; return its exit code."""
        try:
            return self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.kill()
            return self._process.returncode


class Ros:
    """A private master of ROS 1 or domain of ROS 2, with its processes.

    Attributes:
        generation: 1 or 2.
        folder: The folder of logs and records.
        environment: The environment variables of its processes.
        processes: The started processes, the master first.
        domain: The domain of ROS 2.
    """

    def __init__(self, generation: int, folder: Path) -> None:
        self.generation = generation
        self.folder = folder
        self.processes: list[Process] = []
        self.domain = free_domain()
        self._port = free_port()
        self.environment = {
            **{name: value for name, value in os.environ.items() if name not in BOOTSTRAP},
            "PYTHONUNBUFFERED": "1",
            "ROS_HOME": str(folder / "home"),
            "ROS_LOG_DIR": str(folder / "home"),
        }
        if generation == 1:
            self.environment |= {
                "ROS_MASTER_URI": f"http://127.0.0.1:{self._port}",
                "ROS_IP": "127.0.0.1",
            }
        else:
            profile = folder / "loopback.xml"
            profile.write_text(PROFILE, encoding="utf-8")
            self.environment |= {
                "ROS_DOMAIN_ID": str(self.domain),
                "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
                "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
            }

    def start(self, *arguments: str | Path, name: str) -> Process:
        """Start Python with these arguments; its output goes to ``NAME.log``."""
        command = [sys.executable, *map(str, arguments)]
        process = Process(command, self.environment, self.folder / f"{name}.log")
        self.processes.append(process)
        return process

    def start_master(self) -> None:
        """Start a master and wait until it answers."""
        command = [str(ROSMASTER), "--core", "-p", str(self._port)]
        master = Process(command, self.environment, self.folder / "master.log")
        self.processes.insert(0, master)
        with xmlrpc.client.ServerProxy(self.environment["ROS_MASTER_URI"]) as asked:

            def answers() -> bool:
                assert master.runs(), master.output
                with suppress(ConnectionError):
                    return bool(asked.getPid("/tests"))
                return False

            patiently(answers)

    def kill_master(self) -> None:
        """Kill the master, as a crash does."""
        self.processes.pop(0).kill()

    def end(self) -> None:
        """End every process, the master last."""
        for process in reversed(self.processes):
            process.ask_to_end()
        for process in reversed(self.processes):
            process.ended()


@contextmanager
def ros(generation: int, folder: Path) -> Iterator[Ros]:
    """Run a private master or domain until the end of the block."""
    found = Ros(generation, folder)
    try:
        if generation == 1:
            found.start_master()
        yield found
    except BaseException as error:
        for process in found.processes:
            error.add_note(f"{process.name}:\n{process.output[-2000:]}")
        raise
    finally:
        found.end()
