"""Messages in several threads: parts of a message stay together, in the order of arrival."""

from __future__ import annotations

import csv
import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from memory_middleware import SECOND, MemoryMiddleware, message

import rtamt
from rtamt_ros.node import MonitorNode, Settings

MS = 1_000_000
PERIOD = 100 * MS
START = 1000 * SECOND


@contextmanager
def publishing(*publish: Callable[[int], None]) -> Iterator[None]:
    """Run threads that publish until the block ends, with the number of the message."""
    done = threading.Event()
    failed: list[BaseException] = []

    def run(send: Callable[[int], None]) -> None:
        number = 0
        try:
            while not done.is_set() or number < 50:
                number += 1
                send(number)
        except BaseException as error:
            failed.append(error)
            raise

    threads = [threading.Thread(target=run, args=(each,)) for each in publish]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        done.set()
        for thread in threads:
            thread.join()
    assert not failed


def test_values_of_a_message_belong_together() -> None:
    ros = MemoryMiddleware(time=START)
    text = """
    from my_msgs.msg import Parts
    input Parts m
    input Parts other
    m.a == m.b and other.a == other.b and m.inner.x == m.a
    """
    node = MonitorNode(ros, [text], Settings(stale=math.inf))
    node.start()

    def sender(topic: str, sign: int) -> Callable[[int], None]:
        def send(number: int) -> None:
            value = float(sign * number)
            ros.send(topic, message("my_msgs", "Parts", a=value, b=value, inner__x=value))

        return send

    topics = ("rtamt/m", "rtamt/other")
    with publishing(*(sender(topic, sign) for topic in topics for sign in (1, -1))):
        for n in range(2000):
            ros.tick(START + n * PERIOD)
    ros.tick(START + 2000 * PERIOD)
    found = ros.data("rtamt/spec")
    assert found
    assert {abs(each) for each in found} == {0.0}


def test_threaded_events_are_judged_in_order(
    tmp_path: Path,
) -> None:
    ros = MemoryMiddleware(time=START)
    text = "always[0:0.5](x > y)"
    settings = Settings(dense=True, stale=math.inf, record=tmp_path / "run.csv")
    node = MonitorNode(ros, [text], settings)
    node.start()

    def sender(name: str) -> Callable[[int], None]:
        def send(number: int) -> None:
            value = float(number * number % 17)
            ros.send(f"rtamt/{name}", message("std_msgs", "Float64", data=value))

        return send

    with publishing(sender("x"), sender("y")):
        for n in range(300):
            ros.tick(START + n * PERIOD)
    ros.tick(ros.time + SECOND)
    node.stop()
    events: dict[str, list[tuple[float, float]]] = {"x": [], "y": []}
    with (tmp_path / "run.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            since = row["time"].removeprefix("1970-01-01T00:").removesuffix("Z")
            minutes, seconds = since.split(":")
            time = round((int(minutes) * 60 + float(seconds)) * 1e9) - START
            events[row["variable"]].append((time / 1e9, float(row["value"])))
    end = (ros.time - 1 - START) / 1e9
    for event in events.values():
        event.append((end, event[-1][1]))
    whole = [each for each in rtamt.dense.evaluate(text, events) if each[0] < end - 0.5]
    assert ros.data("rtamt/spec") == [value for _, value in whole]
    assert node.reports == ()


@pytest.mark.parametrize("dense", [False, True])
def test_replacement_under_load(
    dense: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    ros = MemoryMiddleware(time=START)
    texts = ["low = x < 5", "high = x > 5"]
    node = MonitorNode(ros, texts[:1], Settings(dense=dense))
    node.start()

    def send(number: int) -> None:
        ros.send("rtamt/x", message("std_msgs", "Float64", data=float(number % 10)))

    with publishing(send, send):
        for n in range(200):
            send(n)
            ros.tick(START + n * PERIOD)
            if n % 4 == 3:
                node.replace([rtamt.parse(texts[n // 4 % 2])])
        ros.tick(ros.time + PERIOD)
        ros.tick(ros.time + PERIOD)
    assert [subscription.topic for subscription in ros.subscriptions] == ["rtamt/x"]
    assert len(ros.timers) == 1
    assert len(ros.publishers) == 6
    assert ros.data("rtamt/low")
    assert ros.data("rtamt/high")
