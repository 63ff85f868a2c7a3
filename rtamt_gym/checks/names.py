"""Names in messages: the known ones, and the nearest to one that is not known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

__all__ = ["listing", "nearest"]


def listing(names: Iterable[Any]) -> str:
    """The names, quoted.

    Example:
        >>> listing(["level", "inflow"]), listing([])
        ("'level', 'inflow'", 'none')
    """
    return ", ".join(repr(name) for name in names) or "none"


def nearest(name: object, names: Iterable[Any]) -> str:
    """Asks whether the most similar name was meant; an empty string if none is similar.

    Example:
        >>> nearest("levle", ["level", "inflow", 3]), nearest("x", ["level"]), nearest(3, ["level"])
        ("; did you mean 'level'?", '', '')
    """
    if not isinstance(name, str):
        return ""
    close = difflib.get_close_matches(name, [each for each in names if isinstance(each, str)], 1)
    return f"; did you mean {close[0]!r}?" if close else ""
