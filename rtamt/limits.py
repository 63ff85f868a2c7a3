"""Limits that a program may set: ``rtamt.limits.window_bytes = 4 * 2**30``."""

__all__ = ["window_bytes"]

window_bytes: float = 2**30
"""The most bytes that the windows of one monitor may come to take; ``math.inf`` is no limit.

`Monitor`, `EpisodeMonitor` and their vector twins (all lanes together) refuse a formula that needs
more when they are made. An episode with samples that are not known takes twice as much, which
counts when a monitor with ``nan="unknown"`` is made, else at the first such sample; predicates that
count 0 double it too. Evaluations of whole traces are not limited: there a window is cut to the
trace. `judge` refuses a past window inside a future one that goes on so far behind the trace.
"""
