"""Limits that a program may set: ``rtamt.limits.window_bytes = 4 * 2**30``."""

__all__ = ["window_bytes"]

window_bytes: float = 2**30
"""The most bytes that the windows of one monitor may come to take; ``math.inf`` is no limit.

`Monitor`, `EpisodeMonitor` and their vector forms (all entries together) refuse a formula that
needs more when they are made. Unknown samples need as much again, which counts when a monitor with
``nan="unknown"`` is made, otherwise at the first such sample; so do predicates that count 0.
Evaluations of whole traces have no limit: a window is cut to the trace. `judge` refuses a past
window inside a future one that reaches so far beyond the trace.
"""
