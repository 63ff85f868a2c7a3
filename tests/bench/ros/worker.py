"""A process around the measured node: a source, a sink, an evaluator, a relay or an hour.

Arguments are JSON, and figures go to a NumPy file. The line "ready" reports the start; SIGTERM ends
a sink or a relay.
"""

from __future__ import annotations

import functools
import json
import operator
import re
import signal
import struct
import sys
import threading
import time
from collections.abc import Callable

import bare
import numpy as np

CONNECTED = 30.0
"""Seconds that a process waits for its neighbours."""

ANSWER = 1.0
"""Seconds after which the answer of a node to a step is abandoned."""


def wait(condition: Callable[[], bool], purpose: str) -> None:
    """Wait for a condition."""
    end = time.monotonic() + CONNECTED
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"{purpose} did not come within {CONNECTED:.0f} s")
        time.sleep(0.01)


def until_told() -> None:
    """Report that all is ready, and wait for SIGTERM."""
    signal.signal(signal.SIGTERM, lambda *_: None)
    print("ready", flush=True)
    signal.pause()


def source(ros: int, topic: str, rate: float, count: int, file: str) -> None:
    """Publish Twists with a count from 1 in `linear.x`; save the time of each publication."""
    node = bare.node(ros, "source")
    twist = bare.message_class("geometry_msgs", "Twist")()
    publisher = node.publisher(topic, type(twist))
    wait(lambda: node.readers(publisher) > 0, f"a reader of {topic}")
    time.sleep(1.0)
    print("ready", flush=True)
    times = np.zeros(count, np.int64)
    start = time.monotonic_ns()
    for number in range(count):
        due = start + int(number * 1e9 / rate)
        while (remaining := due - time.monotonic_ns()) > 0:
            time.sleep(remaining * 1e-9)
        twist.linear.x = number + 1.0
        times[number] = time.monotonic_ns()
        publisher.publish(twist)
    time.sleep(0.5)
    np.save(file, times)
    node.close()


def sink(ros: int, topic: str, message: str, field: str, file: str) -> None:
    """Save the value of every message, its arrival and its age by its stamp."""
    node = bare.node(ros, "sink")
    read, rows = operator.attrgetter(field), []
    clock, wall = time.monotonic_ns, time.time_ns

    def receive(arrived: object) -> None:
        now = clock()
        rows.append((read(arrived), now, wall() - bare.stamp(arrived)))

    node.subscribe(topic, bare.message_class(*message.split("/")), receive)
    until_told()
    np.save(file, np.array(rows, np.float64).reshape(-1, 3))
    node.close()


def noise(ros: int, topic: str, rate: float, count: int, readers: int, file: str) -> None:
    """Publish Twists of random numbers at random times, equal in every run; save their number."""
    node = bare.node(ros, "noise")
    twist = bare.message_class("geometry_msgs", "Twist")()
    publisher = node.publisher(topic, type(twist))
    wait(lambda: node.readers(publisher) >= readers, f"{readers} readers of {topic}")
    time.sleep(1.0)
    print("ready", flush=True)
    random = np.random.default_rng(0)
    dues = np.cumsum(random.uniform(0.2, 1.8, count) * 1e9 / rate).astype(np.int64).tolist()
    values = random.random((count, 2)).tolist()
    start = time.monotonic_ns()
    for due, (x, z) in zip(dues, values, strict=True):
        while (remaining := start + due - time.monotonic_ns()) > 0:
            time.sleep(remaining * 1e-9)
        twist.linear.x, twist.angular.z = x, z
        publisher.publish(twist)
    time.sleep(0.3)  # shorter than the time until an input is stale
    np.save(file, count)
    node.close()


def listener(ros: int, topic: str, file: str) -> None:
    """Save the arrival of every Twist, and its `x` and `z` as the bits of floats."""
    node = bare.node(ros, "listener")
    wall, bits = time.time_ns, struct.Struct("<dd")
    rows: list[tuple[int, bytes]] = []

    def receive(twist: object) -> None:
        rows.append((wall(), bits.pack(twist.linear.x, twist.angular.z)))

    node.subscribe(topic, bare.message_class("geometry_msgs", "Twist"), receive)
    until_told()
    of_numbers = struct.Struct("<qq")
    np.save(file, np.array([(came, *of_numbers.unpack(row)) for came, row in rows], np.int64))
    node.close()


def evaluator(ros: int, topic: str, outputs: dict[str, str], file: str) -> None:
    """Save messages of the input and of outputs, and their arrivals; see `agree.compare`."""
    node = bare.node(ros, "evaluator")
    wall, bits = time.time_ns, struct.Struct("<d")
    of_number = struct.Struct("<q")

    def as_bits(number: float) -> int:
        return int(of_number.unpack(bits.pack(number))[0])

    messages: list[tuple[int, int, int]] = []
    rows: dict[str, list[tuple[int, int, int]]] = {name: [] for name in outputs}

    def receive(twist: object) -> None:
        messages.append((wall(), as_bits(twist.linear.x), as_bits(twist.angular.z)))

    def hear(name: str, point: object) -> None:
        rows[name].append((bare.stamp(point), wall(), as_bits(point.point.x)))

    for name, output in outputs.items():
        kind = bare.message_class("geometry_msgs", "PointStamped")
        node.subscribe(output, kind, functools.partial(hear, name))
    node.subscribe(topic, bare.message_class("geometry_msgs", "Twist"), receive)
    until_told()
    tables = {"messages": messages, **rows}
    arrays = {name: np.array(rows, np.int64).reshape(-1, 3) for name, rows in tables.items()}
    np.savez(file.replace(".npy", ".npz"), **arrays)
    node.close()


def told(ros: int, file: str) -> None:
    """Save the counts of every requirement in the last diagnostics.

    The columns are late samples, restarts, violations, late arrivals, and lost messages, which are
    -1 if unknown.
    """
    node = bare.node(ros, "told")
    late: dict[str, tuple[int, ...]] = {}
    counts = ("late samples", "restarts", "violations", "late arrivals")

    def total(text: str) -> int:  # "x: 12, y: 3" or "x: loss unknown: no numbers"
        return -1 if "unknown" in text else sum(map(int, re.findall(r": (\d+)", text)))

    def receive(array: object) -> None:
        for status in array.status:
            pairs = {pair.key: pair.value for pair in status.values}
            if counts[0] in pairs:  # a requirement
                late[status.name] = (
                    *(int(pairs[name]) for name in counts),
                    total(pairs["lost messages"]),
                )

    node.subscribe(
        "/diagnostics", bare.message_class("diagnostic_msgs", "DiagnosticArray"), receive
    )
    until_told()
    np.save(file, np.array(list(late.values()), np.int64).reshape(-1, 5))
    node.close()


def ticks(ros: int, topics: list[str], rate: float, seconds: float, file: str) -> None:
    """Publish a stamped number on every topic once a period, without any evaluation.

    Save the number of periods, the number of late ones, which end after the next was due, and the
    processor time in seconds.
    """
    node = bare.node(ros, "ticks")
    kind = bare.message_class("geometry_msgs", "PointStamped")
    publishers = [node.publisher(topic, kind) for topic in topics]
    wait(lambda: node.readers(publishers[-1]) > 0, f"a reader of {topics[-1]}")
    time.sleep(1.0)
    print("ready", flush=True)
    period, late = round(1e9 / rate), 0
    used, start = time.process_time(), time.time_ns()
    count = round(seconds * rate)
    for number in range(1, count + 1):
        due = start + number * period
        while (remaining := due - time.time_ns()) > 0:
            time.sleep(remaining * 1e-9)
        late += time.time_ns() >= due + period
        for publisher in publishers:
            message = kind()
            message.point.x = float(number)
            bare.set_stamp(message, due)
            publisher.publish(message)
    np.save(file, (count, late, time.process_time() - used))
    time.sleep(0.5)
    node.close()


def relay(ros: int, topic: str, to: str) -> None:
    """Publish the number of a Twist as a Float64, the minimum work of a monitor."""
    node = bare.node(ros, "relay")
    value = bare.message_class("std_msgs", "Float64")()
    publisher = node.publisher(to, type(value))

    def pass_on(twist: object) -> None:
        value.data = twist.linear.x
        publisher.publish(value)

    node.subscribe(topic, bare.message_class("geometry_msgs", "Twist"), pass_on)
    until_told()
    node.close()


def hour(
    *,
    ros: int,
    topic: str,
    out: str,
    message: str,
    field: str,
    every: bool,
    steps: int,
    pid: int,
    file: str,
) -> None:
    """Publish ten Twists and 0.1 s of ``/clock`` per step, at the speed of the node's answers.

    The answer is the value of the last Twist if the node answers every one. Otherwise it is any
    value, because a tick may arrive before a Twist that was sent earlier. Save the time of each
    answer, 0 without an answer, and the memory of the node then.
    """
    node = bare.node(ros, "hour")
    twist = bare.message_class("geometry_msgs", "Twist")()
    publisher = node.publisher(topic, type(twist))
    clock = node.publisher("/clock", bare.message_class("rosgraph_msgs", "Clock"))
    answered, least = threading.Event(), 0.0
    read = operator.attrgetter(field)

    def receive(arrived: object) -> None:
        if not every or read(arrived) >= least:
            answered.set()

    node.subscribe(out, bare.message_class(*message.split("/")), receive)
    wait(lambda: node.readers(publisher) > 0 and node.readers(clock) > 0, "the node")
    time.sleep(1.0)
    print("ready", flush=True)
    rows = np.zeros((steps, 2), np.int64)
    begin = 10**9
    for step in range(steps):
        answered.clear()
        for part in range(10):
            twist.linear.x = least = step * 10.0 + part + 1
            publisher.publish(twist)
        node.tick(clock, begin + (step + 1) * 10**8)
        if answered.wait(ANSWER):
            rows[step, 0] = time.monotonic_ns()
        rows[step, 1] = bare.resident(pid)
    np.save(file, rows)
    node.close()


if __name__ == "__main__":
    roles = (source, noise, sink, told, listener, evaluator, ticks, relay, hour)
    {role.__name__: role for role in roles}[sys.argv[1]](**json.loads(sys.argv[2]))
