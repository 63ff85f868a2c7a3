"""Helpers of the tests of `EpisodeMonitor`."""

import math

from strategies import Trace, sample

from rtamt import EpisodeMonitor, Verdict


def offered(monitor: EpisodeMonitor) -> tuple[float, float, float]:
    """Return robustness, lower and upper bound."""
    return monitor.robustness, monitor.lower, monitor.upper


def feed(monitor: EpisodeMonitor, trace: Trace, i: int) -> float:
    """Update the monitor with sample i of a trace; return the robustness."""
    return monitor.update(sample(trace, i, monitor.variables))


def verdict(lower: float, upper: float) -> Verdict:
    """Return the verdict that follows from the bounds."""
    if math.copysign(1, upper) < 0:
        return Verdict.VIOLATED
    return Verdict.SATISFIED if math.copysign(1, lower) > 0 else Verdict.UNDECIDED
