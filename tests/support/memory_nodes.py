"""Nodes on a middleware in memory."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, cast

from memory_middleware import CLASSES, SECOND, MemoryMiddleware, message

from rtamt_ros.node import MonitorNode, Settings

__all__ = ["MS", "let_defaults_count", "send", "started", "topics", "until"]

MS = 1_000_000


def started(
    *texts: str, begin: int = 1000 * SECOND, **settings: object
) -> tuple[MemoryMiddleware, MonitorNode]:
    """Return a running node; the grid of its timer starts at a time."""
    ros = MemoryMiddleware(time=begin)
    node = MonitorNode(ros, list(texts), Settings(**cast("Any", settings)))
    node.start()
    return ros, node


def let_defaults_count(ros: MemoryMiddleware) -> None:
    """Let two seconds of the steady clock pass, after which defaults count."""
    ros.later += 2 * SECOND
    ros.tick()


def send(ros: MemoryMiddleware, name: str, value: float) -> None:
    """Publish a number on a topic."""
    ros.send(f"rtamt/{name}", message("std_msgs", "Float64", data=value))


def topics(ros: MemoryMiddleware) -> dict[str, str]:
    """Return the published topics, with the packages of their messages."""
    packages = {kind: package for (package, _), kind in CLASSES.items()}
    return {each.topic: packages[each.message] for each in ros.publishers}


def until(condition: Callable[[], bool]) -> None:
    """Wait until another thread has made a condition true."""
    for _ in range(1000):
        if condition():
            return
        threading.Event().wait(0.01)
    raise AssertionError("expected the condition within 10 s")
