"""What the tests of `EpisodeMonitor` ask of it."""

from strategies import Trace, sample

from rtamt import EpisodeMonitor, Verdict


def offered(monitor: EpisodeMonitor) -> tuple[float, float, float]:
    """Robustness and bounds."""
    return monitor.robustness, monitor.lower, monitor.upper


def feed(monitor: EpisodeMonitor, trace: Trace, i: int) -> float:
    """What update gives at one sample of a trace."""
    return monitor.update(sample(trace, i, monitor.variables))


def verdict(lower: float, upper: float) -> Verdict:
    """The verdict that bounds decide."""
    if upper < 0:
        return Verdict.VIOLATED
    return Verdict.SATISFIED if lower > 0 else Verdict.UNDECIDED
