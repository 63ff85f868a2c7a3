"""Paths to values in messages, as ``--signal`` writes them: ``/robot0/scan.ranges[0]``."""

from __future__ import annotations

import re

from rtamt import InputError

__all__ = ["FieldPath", "path_text", "read_source"]

FieldPath = tuple[str | int, ...]
"""The fields and elements that lead to a value in a message."""

_STEP = re.compile(r"\.([A-Za-z]\w*)|\[(\d+)\]", re.ASCII)


def path_text(path: FieldPath) -> str:
    """A path as it is written.

    Example:
        >>> path_text(("ranges", 0))
        'ranges[0]'
    """
    steps = (f".{step}" if isinstance(step, str) else f"[{step}]" for step in path)
    return "".join(steps).removeprefix(".")


def read_source(text: str) -> tuple[str, FieldPath]:
    """The topic, whose name has no dots, and the path behind it, which may be empty.

    Raises:
        InputError: If it is written otherwise.

    Example:
        >>> read_source("/robot0/scan.ranges[0]"), read_source("/speed")
        (('/robot0/scan', ('ranges', 0)), ('/speed', ()))
    """
    topic, dot, rest = text.partition(".")
    if not dot:
        return topic, ()
    steps = _STEP.findall(f".{rest}")
    path = tuple(int(element) if element else field for field, element in steps)
    if not (topic.strip("/") and path) or path_text(path) != rest:
        raise InputError(
            "--signal: expected TOPIC.FIELD, such as /robot0/odom.twist.twist.linear.x, "
            f"got {text!r}"
        )
    return topic, path
