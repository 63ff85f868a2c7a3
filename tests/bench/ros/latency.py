"""Latency from the publication of an input to the robustness on its topic.

Inputs are counted, and the robustness equals the count, which matches the two. A sampling node
publishes the value that it held at a tick, so its latency is the wait for the tick, at most a
period, and the time from the tick to the value. The source is 3 % slower than the ticks, so that
its messages have every phase. A repeated number counts once, at its first arrival. Times are from
CLOCK_MONOTONIC, which all processes of a host share; ages by stamp, which is the time of the tick,
are from the wall clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import bare
import numpy as np
from bench import INPUT, PATIENCE, Subject, bench


@dataclass(frozen=True)
class Latency:
    """The figures of a subject at one rate.

    Attributes:
        whole: Nanoseconds from the publication of an input to the arrival of its robustness.
        after_tick: Nanoseconds from a tick to the arrival of its value, by the stamps.
        unseen: The share of inputs without a robustness: lost, or replaced before the next tick.
        load: The processor time of the node as a share of one processor.
    """

    whole: np.ndarray
    after_tick: np.ndarray
    unseen: float
    load: float


def measure(generation: int, subject: Subject, rate: float, seconds: float) -> Latency:
    """Return latencies of a subject, for the rates in Hz of its inputs and samples."""
    sampled = subject.name.startswith(("sampled", "2020"))
    sending = rate * 0.97 if sampled else rate
    with bench(generation) as running:
        running.start(subject, 1e3 / rate)
        sink = running.worker("sink", subject, topic=subject.topic)
        count = round(seconds * sending)
        source = running.worker("source", topic=INPUT, rate=sending, count=count)
        used = bare.processor(running.node.pid) if running.node else 0.0
        running.wait(lambda: not source.runs(), source, seconds + PATIENCE)
        used = bare.processor(running.node.pid) - used if running.node else 0.0
        sink.ask_to_end()
        sink.ended()
        sent, rows = running.load("source"), running.load("sink")
        output = running.node.output if running.node else ""
    rows = rows[rows[:, 0] >= 1]
    if not len(rows):
        raise RuntimeError(f"nothing came of {count} messages\n{output[-2000:]}")
    numbers, first = np.unique(rows[:, 0].astype(np.int64), return_index=True)
    whole = rows[first, 1] - sent[numbers - 1]
    return Latency(whole, rows[:, 2], 1 - len(numbers) / count, used / seconds)


def quantiles(times: np.ndarray) -> tuple[float, float, float]:
    """Return median, 99th percentile and maximum of nanoseconds, in microseconds."""
    p50, p99, greatest = np.percentile(times, [50, 99, 100]) / 1e3
    return float(p50), float(p99), float(greatest)
