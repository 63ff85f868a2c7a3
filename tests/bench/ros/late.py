"""Samples that a node evaluates late, and delays of messages, next to busy processes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bare
import numpy as np
from bench import HOP, INPUT, PATIENCE, Subject, bench


@dataclass(frozen=True)
class Late:
    """The figures of a subject.

    Attributes:
        samples: The number of samples of its requirements, by the clock.
        late: The number of samples that the node evaluated late, by its diagnostics.
        after_stamp: Nanoseconds from the stamps of the last requirement's samples to their arrival.
        load: The processor time of the node as a share of one processor.
    """

    samples: int
    late: int
    after_stamp: np.ndarray
    load: float


def measure(
    generation: int, subject: Subject, rate: float, seconds: float, *, count: int, busy: int
) -> Late:
    """Measure late samples of a subject with several requirements, next to busy processes."""
    with bench(generation) as running:
        running.start(subject, 1e3 / rate)
        sink = running.worker("sink", subject, topic=subject.topic)
        counts = running.worker("told")
        source = running.worker("source", topic=INPUT, rate=rate, count=round(seconds * rate))
        assert running.node is not None
        used = bare.processor(running.node.pid)
        with others(busy):
            running.wait(lambda: not source.runs(), source, seconds + PATIENCE)
        used = bare.processor(running.node.pid) - used
        for worker in (sink, counts):
            worker.ask_to_end()
            worker.ended()
        rows, late = running.load("sink"), running.load("told")
    return Late(round(seconds * rate) * count, int(late[:, 0].sum()), rows[:, 2], used / seconds)


def floor(generation: int, rate: float, seconds: float, *, count: int, busy: int) -> Late:
    """Measure the same for a bare publisher of as many topics, which evaluates nothing."""
    topics = [f"bench/out{number}" for number in range(count)]
    with bench(generation) as running:
        last = replace(HOP, topic=topics[-1], message="geometry_msgs/PointStamped", field="point.x")
        sink = running.worker("sink", last, topic=last.topic)
        ticks = running.worker("ticks", topics=topics, rate=rate, seconds=seconds)
        with others(busy):
            running.wait(lambda: not ticks.runs(), ticks, seconds + PATIENCE)
        sink.ask_to_end()
        sink.ended()
        (samples, late, used), rows = running.load("ticks"), running.load("sink")
    return Late(int(samples) * count, int(late) * count, rows[:, 2], used / seconds)


@contextmanager
def others(count: int) -> Iterator[None]:
    """Run busy processes until the end of the block."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()
