"""Messages and looks in threads of their own, in every possible order of turns."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from functools import partial

import pytest
from interleaving import Lock, Turns, every_order
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import send

from rtamt import Verdict
from rtamt_ros.node import MonitorNode, Settings

START = 1000 * SECOND
PERIOD = 3_333_333
"""Nanoseconds of 300 Hz."""


@dataclass
class Running(MemoryMiddleware):
    """A middleware whose clock advances two periods per reading, at which threads change."""

    turns: Turns = field(default_factory=Turns)
    readings: dict[int, int] = field(default_factory=dict)

    def now(self) -> int:
        self.time += 2 * PERIOD
        now = self.readings[threading.get_ident()] = self.time
        self.turns.point()
        return now


def started(
    turns: Turns, monkeypatch: pytest.MonkeyPatch, text: str, **settings: object
) -> tuple[Running, MonitorNode]:
    """Return a running node with threads that take turns."""
    ros = Running(time=START, turns=turns)
    options = {"period": PERIOD, "stale": math.inf, **settings}
    node = MonitorNode(ros, [text], Settings(**options))  # type: ignore[arg-type]
    with monkeypatch.context() as patch:
        patch.setattr(threading, "RLock", turns.lock)
        node.start()
    return ros, node


def test_every_order_is_played_once() -> None:
    orders = []
    for turns in every_order():
        turns.run(a=turns.point, b=turns.point)
        orders.append("".join(turns.order))
    assert sorted(orders) == ["aabb", "abab", "abba", "baab", "baba", "bbaa"]


def test_a_lock_is_held_by_one_thread_at_a_time() -> None:
    def work(lock: Lock, turns: Turns, inside: list[str], name: str) -> None:
        with lock, lock:
            inside.append(name)
            turns.point()
            inside.append(name)

    for turns in every_order():
        inside: list[str] = []
        task = partial(work, turns.lock(), turns, inside)
        turns.run(a=partial(task, "a"), b=partial(task, "b"))
        assert inside in (list("aabb"), list("bbaa"))


def test_interleaved_clock_never_goes_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    orders = 0
    for turns in every_order():
        ros, node = started(turns, monkeypatch, "always(x > 0 and y > 0)", dense=True)
        send(ros, "x", 2.0)
        send(ros, "y", -1.0)
        ros.tick()
        turns.run(message=partial(send, ros, "x", 3.0), look=ros.tick)
        (report,) = node.reports
        assert (report.restarts, report.restarted_because) == (0, ""), turns.order
        assert (report.verdict, report.violations) == (Verdict.VIOLATED, 1), turns.order
        assert ros.data("rtamt/spec/verdict")[-1] == Verdict.VIOLATED
        orders += 1
    assert orders > 5


def test_interleaved_samples_hold_last_values(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = """
    from rtamt_msgs.msg import FloatMessage
    output FloatMessage out
    float64 x
    out.value = x >= 0
    """

    def publish(ros: Running, came: dict[float, int], value: float) -> None:
        send(ros, "x", value)
        came[value] = ros.readings[threading.get_ident()]

    late = 0
    for turns in every_order():
        ros, node = started(turns, monkeypatch, text)
        came: dict[float, int] = {}
        publish(ros, came, 1.0)
        ros.tick()
        turns.run(message=partial(publish, ros, came, 2.0), look=ros.tick)
        publish(ros, came, 3.0)
        ros.tick()
        for sample in ros.on("rtamt/out"):
            by_then = {
                time: value for value, time in came.items() if time <= sample.header.stamp.ns
            }
            assert sample.value == by_then[max(by_then)], turns.order
        (report,) = node.reports
        assert (report.restarts, report.time) == (0, ros.time - 2 * PERIOD), turns.order
        late += report.missed
    assert late
