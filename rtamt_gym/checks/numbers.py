"""Numbers from text, and the fractions that floats stand for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache


@lru_cache(maxsize=1024)
def exact(seconds: float | Fraction) -> Fraction:
    """Return the fraction that a float stands for, such as 3/10 for ``0.1 + 0.2``.

    This is the nearest fraction with a denominator of at most 10**6 if it differs by rounding only;
    otherwise, the shortest decimal number of the float.

    Example:
        >>> exact(0.1), exact(0.1 + 0.2), exact(1 / 3), exact(1e-9)
        (Fraction(1, 10), Fraction(3, 10), Fraction(1, 3), Fraction(1, 1000000000))
    """
    simple = Fraction(seconds).limit_denominator(10**6)
    if abs(simple - Fraction(seconds)) <= 4 * Fraction(math.ulp(seconds)):
        return simple
    return seconds if isinstance(seconds, Fraction) else Fraction(repr(float(seconds)))


def read_floats(texts: Sequence[str]) -> list[float] | None:
    """Return the numbers in texts of plain decimal ASCII, ``inf`` or ``nan``, or None.

    `float` alone would also read ``1_0`` as 10, and digits of other scripts.

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
