"""Messages and looks in threads of their own, in every order in which they may take turns."""

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
    """A middleware whose clock runs on by two periods at every reading, where threads change."""

    turns: Turns = field(default_factory=Turns)

    def now(self) -> int:
        self.time += 2 * PERIOD
        now = self.time
        self.turns.point()
        return now


def started(
    turns: Turns, monkeypatch: pytest.MonkeyPatch, text: str, **settings: object
) -> tuple[Running, MonitorNode]:
    """A node that runs, whose threads take turns."""
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


def test_threads_that_read_the_clock_in_turns_see_no_clock_that_went_back(
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
