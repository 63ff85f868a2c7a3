"""Limits that a program may set: ``rtamt.limits.window_bytes = 4 * 2**30``."""

__all__ = ["window_bytes"]

window_bytes: float = 2**30
"""The most bytes that the windows of one monitor may come to take; ``math.inf`` is no limit.

`Monitor`, `EpisodeMonitor` and their vector twins (all lanes together) refuse a formula that needs
more when they are made. Samples that are not known need as much again, which counts when a monitor
with ``nan="unknown"`` is made, otherwise at the first such sample; so do predicates that count 0.
Evaluations of whole traces are not limited: there a window is cut to the
trace. `judge` refuses a past window inside a future one that goes on so far behind the trace.
"""
