"""The values that a variable can have: by its type, and by its declaration."""

from __future__ import annotations

import math
from typing import Final

from rtamt.language.printing import number_text

__all__ = ["is_whole", "range_of_type", "range_text"]

_WHOLE: Final = ("bool", "int", "uint", "long")


def is_whole(kind: str) -> bool:
    """Whether the values of a type are whole numbers.

    Example:
        >>> is_whole("uint8"), is_whole("float")
        (True, False)
    """
    return kind.rstrip("0123456789") in _WHOLE


def range_of_type(kind: str) -> tuple[float, float] | None:
    """The least and the greatest value of a type; None if it has any.

    ``int`` and ``long`` have as many bits as their system likes, so that nobody knows.

    Example:
        >>> range_of_type("uint8"), range_of_type("int16"), range_of_type("uint")
        ((0.0, 255.0), (-32768.0, 32767.0), (0.0, inf))
        >>> range_of_type("bool"), range_of_type("int"), range_of_type("float")
        ((0.0, 1.0), None, None)
    """
    if kind == "bool":
        return 0.0, 1.0
    bits = kind.removeprefix("u").removeprefix("int")
    if kind.startswith("uint"):
        return 0.0, float(2 ** int(bits) - 1) if bits else math.inf
    if kind.startswith("int") and bits:
        return -(2.0 ** (int(bits) - 1)), float(2 ** (int(bits) - 1) - 1)
    return None


def range_text(values: tuple[float, float]) -> str:
    """A range as text: ``[0, 120]``."""
    return f"[{number_text(values[0])}, {number_text(values[1])}]"
