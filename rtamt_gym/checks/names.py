"""Names in messages."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

__all__ = ["listing"]


def listing(names: Iterable[Any]) -> str:
    """The names, quoted.

    Example:
        >>> listing(["level", "inflow"]), listing([])
        ("'level', 'inflow'", 'none')
    """
    return ", ".join(repr(name) for name in names) or "none"
