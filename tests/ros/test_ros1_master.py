"""A monitor when the master ends, returns, refuses it, or knows another one."""

import os
import signal
import threading
import xmlrpc.client
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from ros_messages import Probe, probe
from ros_processes import Process, Ros, patiently, ros
from ros_scenario import statuses
from ros_world import World

SPEC = "input float64 x\n@ topic(x, x)\nout = x > 1"
OUT, DIAGNOSTICS = "rtamt/out", "/diagnostics"
TOPICS = {OUT: "std_msgs/Float64", DIAGNOSTICS: "diagnostic_msgs/DiagnosticArray"}


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Ros]:
    with ros(1, tmp_path) as found:
        yield found


def monitor(network: Ros, name: str = "monitor") -> Process:
    """Start a monitor with the name ``/watch``."""
    options = "--period 50 --unit ms --stale inf __name:=watch"
    return network.start("-m", "rtamt_ros", "--spec", SPEC, *options.split(), name=name)


def known(network: Ros) -> list[set[str]]:
    """Return the published and subscribed topics of ``/watch``, and its services."""
    with xmlrpc.client.ServerProxy(network.environment["ROS_MASTER_URI"]) as master:
        state: Any = master.getSystemState("/tests")[2]  # type: ignore[index]
    return [{what for what, nodes in kind if "/watch" in nodes} for kind in state]


def data(ears: Probe) -> list[float]:
    """Return the received robustness."""
    return [each.message.data for each in ears.heard(OUT)]


def told(ears: Probe) -> list[tuple[int, str]]:
    """Return the diagnostics of the node."""
    found = statuses(ears.heard(DIAGNOSTICS))
    return [(each.level, each.message) for each in found if each.name == "watch: ROS"]


def test_a_monitor_is_found_again_at_a_master_that_came_back(network: Ros) -> None:
    uri = network.environment["ROS_MASTER_URI"]
    gone = f"no master answers at {uri}: nodes that start now do not find this node"
    again = f"registered again (1): the master at {uri} did not know this node"
    watch = monitor(network)
    with World(network, network) as world, probe(network, TOPICS) as before:
        first = world.peer("first")
        first.ask("publisher", "x", "/x", "std_msgs", "Float64")
        patiently(lambda: first.ask("publish", "x", {"data": 3.0}) or 2.0 in data(before))
        knew = known(network)
        assert {"/rtamt/out", "/diagnostics"} < knew[0]
        assert "/x" in knew[1]
        assert "/watch/get_loggers" in knew[2]
        network.kill_master()
        patiently(lambda: f"[WARN] {gone}" in plain(watch))
        before.wait(lambda: (1, gone) in told(before), "the state of the node")
        first.ask("publish", "x", {"data": 4.0})  # existing connections need no master
        before.wait(lambda: 3.0 in data(before), "robustness without a master")
        network.start_master()
        patiently(lambda: f"[INFO] {again}" in plain(watch))
        assert known(network) == knew
        before.wait(lambda: (0, again) in told(before), "the state of the node")
        with probe(network, TOPICS) as after:  # new subscribers are connected
            second = world.peer("second")
            second.ask("publisher", "x", "/x", "std_msgs", "Float64")
            patiently(lambda: second.ask("publish", "x", {"data": 5.0}) or 4.0 in data(after))
        watch.ask_to_end()
        assert watch.ended() == 0, watch.output
        assert known(network) == [set(), set(), set()]
    assert "Traceback" not in watch.output


def plain(process: Process) -> str:
    """Return the log of a process without times."""
    words = (line.split(": ", 1) for line in process.output.splitlines())
    return "\n".join(f"{head.split(' ')[0]} {text}" for head, *texts in words for text in texts)


@contextmanager
def refusing(uri: str) -> Iterator[None]:
    """Run a master that knows no node, and accepts none."""
    port = int(uri.rpartition(":")[2])
    with SimpleXMLRPCServer(("127.0.0.1", port), logRequests=False) as server:
        answers: dict[str, Sequence[Any]] = {
            "getPid": (1, "", 4711),
            "lookupNode": (-1, "unknown node", ""),
            "registerPublisher": (-1, "no room", 0),
        }
        for name, answer in answers.items():
            server.register_function(lambda *_, given=answer: given, name)
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield
        finally:
            server.shutdown()
            thread.join()


def test_a_monitor_that_a_master_refuses_ends_with_code_5(network: Ros) -> None:
    watch = monitor(network)
    patiently(lambda: "waiting for x" in watch.output)
    network.kill_master()
    with refusing(network.environment["ROS_MASTER_URI"]):
        assert watch.ended() == 5, watch.output
    assert "[ERROR] the master refuses this node: no room" in plain(watch)
    assert "Traceback" not in watch.output


def test_of_two_monitors_with_one_name_the_first_ends_with_code_4(network: Ros) -> None:
    first = monitor(network, "first")
    patiently(lambda: "waiting for x" in first.output)
    second = monitor(network, "second")
    assert first.ended() == 4, first.output
    said = "[ERROR] another node has the name /watch; give each node its own name: __name:=NAME"
    assert said in plain(first)
    assert "Traceback" not in first.output
    patiently(lambda: "waiting for x" in second.output)
    second.ask_to_end()
    assert second.ended() == 0


def test_a_monitor_whose_name_another_has_at_a_new_master_leaves_it_alone(network: Ros) -> None:
    first = monitor(network, "first")
    patiently(lambda: "waiting for x" in first.output)
    os.kill(first.pid, signal.SIGSTOP)  # it receives nothing from now on
    network.kill_master()
    network.start_master()
    second = monitor(network, "second")
    patiently(lambda: "waiting for x" in second.output)
    os.kill(first.pid, signal.SIGCONT)
    assert first.ended() == 4, first.output
    assert second.runs()
    assert "/x" in known(network)[1]
    second.ask_to_end()
    assert second.ended() == 0
