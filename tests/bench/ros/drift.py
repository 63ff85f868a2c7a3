"""How well a node that samples keeps its period over minutes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from bench import INPUT, PATIENCE, Subject, bench


@dataclass(frozen=True)
class Drift:
    """The course of a run; times in nanoseconds.

    Attributes:
        periods: Periods from the first value to the last, by the clock.
        values: Values that came in them.
        drift: How much later than so many periods the last minute came than the first, by the
            medians of both.
        late: Of each value, the time behind the regular course that the median of all follows.
        missed: Periods that passed without a value before the next, by the times of arrival.
    """

    periods: int
    values: int
    drift: float
    late: np.ndarray
    missed: int


def measure(generation: int, subject: Subject, rate: float, seconds: float) -> Drift:
    """The drift of a subject that samples at a rate in Hz."""
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
    """What times of arrival say of the clock behind them."""
    times = arrivals - arrivals[0]
    slots = np.round(times / period)
    behind = times - slots * period
    part = max(1, len(times) // 10)
    drift = float(np.median(behind[-part:]) - np.median(behind[:part]))
    missed = int(np.maximum(np.diff(slots) - 1, 0).sum())
    late = behind - np.median(behind)
    return Drift(int(slots[-1]), len(times) - 1, drift, late, missed)
