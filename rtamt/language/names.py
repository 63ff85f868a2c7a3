"""The names of variables: plain, a field of a message, or an element of a list in one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

__all__ = ["PathStep", "is_field", "is_name", "joined", "lineage", "steps"]

PathStep = str | int
"""The name of a field, or the number of an element, from 0."""

_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*|\[(0|[1-9]\d*)\])*", re.ASCII)
_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


def is_name(text: str) -> bool:
    """Whether a text is the name of a variable, but for the words of the language."""
    return _NAME.fullmatch(text) is not None


def steps(name: str) -> tuple[PathStep, ...]:
    """The fields and elements that a name leads through, from the outermost.

    Example:
        >>> steps("scan.ranges[0]")
        ('scan', 'ranges', 0)
    """
    if "[" not in name:
        return tuple(name.split("."))
    return tuple(field or int(element) for field, element in _STEP.findall(name))


def joined(path: Iterable[PathStep]) -> str:
    """The name of which these are the `steps`."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.removeprefix(".")


def lineage(name: str) -> Iterator[str]:
    """A name and what it belongs to, innermost first: ``a.b[0]``, ``a.b``, ``a``."""
    while name:
        yield name
        name = name[: max(name.rfind("."), name.rfind("["), 0)]


def is_field(name: str) -> bool:
    """Whether a name leads into a message, to a field or an element."""
    return "." in name or "[" in name
