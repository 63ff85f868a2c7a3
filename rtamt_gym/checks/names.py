"""Names in messages."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any, Final

from rtamt.errors import alike

_MOST: Final = 20
"""The maximum number of names in a complete list."""

_FEW: Final = 5
"""The number of names in a shortened list."""


def listed(names: Collection[str], wanted: str = "") -> str:
    """Return up to 20 names as a list; of more, the five that are most similar to ``wanted``.

    Example:
        >>> listed(["level", "inflow"]), listed([f"x{i}" for i in range(99)], "x42")
        ('level, inflow', 'x42, x2, x4, x12, x22 and 94 more')
    """
    if len(names) <= _MOST:
        return ", ".join(names)
    few = alike(wanted, names, _FEW)
    return f"{', '.join(few)} and {len(names) - _FEW} more"


def listing(names: Iterable[Any]) -> str:
    """Return the names in quotes.

    Example:
        >>> listing(["level", "inflow"]), listing([])
        ("'level', 'inflow'", 'none')
    """
    return ", ".join(repr(name) for name in names) or "none"
