"""The code that calls a wrapper: the line that a warning shows, and the wrappers around it."""

from __future__ import annotations

import inspect

_PASSED = frozenset({"rtamt_gym", "gymnasium"})
"""Packages with frames that are not the user's: wrappers of both call each other."""


def caller_level() -> int:
    """Return the ``stacklevel`` for a warning of the caller that shows the user's line."""
    frame, level = inspect.currentframe(), 0
    while frame is not None and frame.f_back is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] not in _PASSED:
            break
        frame, level = frame.f_back, level + 1
    return level


def wrappers_around(env: object) -> list[object]:
    """Return the wrappers that are calling a method of an environment, the innermost first.

    An environment has no reference to the wrappers around it, but the frames of the call do.
    """
    frame, wrappers = inspect.currentframe(), []
    while frame is not None:
        code = frame.f_code
        if code.co_argcount and code.co_varnames[0] == "self":
            caller = frame.f_locals.get("self")
            if getattr(caller, "__dict__", {}).get("env") is env:
                wrappers.append(caller)
                env = caller
        frame = frame.f_back
    return wrappers
