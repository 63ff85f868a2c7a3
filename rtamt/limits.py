"""Limits that a program may set: ``rtamt.limits.window_bytes = 4 * 2**30``."""

__all__ = ["window_bytes"]

window_bytes: float = 2**30
"""The maximum bytes for the windows of one monitor; ``math.inf``: unlimited.

The constructors of `Monitor`, `EpisodeMonitor` and their vector forms (all entries together) refuse
a formula that needs more. Unknown samples need as much again: with ``nan="unknown"`` this counts in
the constructor, otherwise at the first unknown sample. Predicates that count 0 need as much again,
too. Evaluations of complete traces have no limit, because a window is cut to the trace. `judge`
refuses a past window inside a future one that reaches so far beyond the trace.
"""
