"""Whose line a warning shows."""

from __future__ import annotations

import inspect

__all__ = ["caller_level"]

_PASSED = frozenset({"rtamt_gym", "gymnasium"})
"""Packages whose lines a user has not written: wrappers call each other, across both."""


def caller_level() -> int:
    """Counts the frames up to the code that uses wrappers: the ``stacklevel`` of a warning.

    It is meant for a `warnings.warn` in the function that calls this one.
    """
    frame, level = inspect.currentframe(), 0
    while frame is not None and frame.f_back is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] not in _PASSED:
            break
        frame, level = frame.f_back, level + 1
    return level
