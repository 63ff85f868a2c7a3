"""How well a sampling node keeps its period over minutes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from bench import INPUT, PATIENCE, Subject, bench


@dataclass(frozen=True)
class Drift:
    """The drift of a run; times in nanoseconds.

    Attributes:
        periods: The number of periods from the first value to the last, by the clock.
        values: The number of values in them.
        drift: The delay of the last minute compared with the first, by the medians of both.
        late: The delay of each value after the regular times that the median of all follows.
        missed: The periods without a value before the next, by arrival.
    """

    periods: int
    values: int
    drift: float
    late: np.ndarray
    missed: int


def measure(generation: int, subject: Subject, rate: float, seconds: float) -> Drift:
    """Return the drift of a subject that samples at a rate in Hz."""
    with bench(generation) as running:
        running.start(subject, 1e3 / rate)
        sink = running.worker("sink", subject, topic=subject.topic)
        count = round(seconds * rate * 0.97)
        source = running.worker("source", topic=INPUT, rate=rate * 0.97, count=count)
        running.wait(lambda: not source.runs(), source, seconds + PATIENCE)
        sink.ask_to_end()
        sink.ended()
        sent, rows = running.load("source"), running.load("sink")
    return course(rows[(rows[:, 1] >= sent[0]) & (rows[:, 1] <= sent[-1]), 1], 1e9 / rate)


def course(arrivals: np.ndarray, period: float) -> Drift:
    """Return the clock that times of arrival imply."""
    times = arrivals - arrivals[0]
    slots = np.round(times / period)
    behind = times - slots * period
    part = max(1, len(times) // 10)
    drift = float(np.median(behind[-part:]) - np.median(behind[:part]))
    missed = int(np.maximum(np.diff(slots) - 1, 0).sum())
    late = behind - np.median(behind)
    return Drift(int(slots[-1]), len(times) - 1, drift, late, missed)
