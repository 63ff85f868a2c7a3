"""The names of variables: plain, a field of a message, or an element of a list in one."""

from __future__ import annotations

import re
from collections.abc import Iterator

__all__ = ["Step", "is_field", "joined", "owner", "owners", "steps"]

Step = str | int
"""The name of a field, or the number of an element, from 0."""

_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


def steps(name: str) -> tuple[Step, ...]:
    """The fields and elements that a name leads through, from the outermost.

    Example:
        >>> steps("scan.ranges[0]")
        ('scan', 'ranges', 0)
    """
    if "[" not in name:
        return tuple(name.split("."))
    return tuple(field or int(element) for field, element in _STEP.findall(name))


def joined(path: Iterator[Step] | tuple[Step, ...]) -> str:
    """The name of which these are the `steps`."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.removeprefix(".")


def owner(name: str) -> str:
    """What a field or element belongs to, ``scan.ranges`` for ``scan.ranges[0]``; else ``""``."""
    return name[: max(name.rfind("."), name.rfind("["), 0)]


def owners(name: str) -> Iterator[str]:
    """What a name belongs to, innermost first."""
    while name := owner(name):
        yield name


def is_field(name: str) -> bool:
    """Whether a name is that of a field or an element, rather than plain."""
    return "." in name or "[" in name
