"""Names in messages."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any, Final

from rtamt.errors import alike

_MOST: Final = 20
"""So many names are listed whole."""

_FEW: Final = 5
"""So many of more names."""


def listed(names: Collection[str], wanted: str = "") -> str:
    """The names; of more than 20 the five that are most like the wanted one, and how many more.

    Example:
        >>> listed(["level", "inflow"]), listed([f"x{i}" for i in range(99)], "x42")
        ('level, inflow', 'x42, x2, x4, x12, x22 and 94 more')
    """
    if len(names) <= _MOST:
        return ", ".join(names)
    few = alike(wanted, names, _FEW)
    return f"{', '.join(few)} and {len(names) - _FEW} more"


def listing(names: Iterable[Any]) -> str:
    """The names, quoted.

    Example:
        >>> listing(["level", "inflow"]), listing([])
        ("'level', 'inflow'", 'none')
    """
    return ", ".join(repr(name) for name in names) or "none"
