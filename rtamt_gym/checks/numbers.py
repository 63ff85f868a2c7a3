"""Numbers that are written as text: plain decimal text of ASCII, ``inf`` and ``nan``."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["read_floats"]


def read_floats(texts: Sequence[str]) -> list[float] | None:
    """The numbers in texts; None if one of them is no number.

    `float` alone would read more: ``1_0`` as 10, and the digits of every script.

    Example:
        >>> read_floats(["1e3", " -inf"]), read_floats(["1_0"])
        ([1000.0, -inf], None)
    """
    together = "".join(texts)
    if "_" in together or not together.isascii():
        return None
    try:
        return list(map(float, texts))
    except ValueError:
        return None
