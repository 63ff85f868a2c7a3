"""Numbers, shares and names as the page writes them."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Sequence

__all__ = ["PageIds", "aligned", "number", "percent", "time"]

_MINUS = "\N{MINUS SIGN}"
_INFINITY = "\N{INFINITY}"


def number(value: float | None, digits: int = 4) -> str:
    """Writes a number in a few digits, with a true minus sign; nothing for None.

    Example:
        >>> number(-0.25), number(math.inf), number(12345.6), number(None)
        ('−0.25', '∞', '12350', '')
    """  # noqa: RUF002 - the minus sign is meant
    if value is None:
        return ""
    if math.isinf(value):
        return _MINUS + _INFINITY if value < 0 else _INFINITY
    text = f"{value:.{digits}g}"
    if "e+" in text:
        text = f"{float(text):.0f}" if abs(value) < 1e9 else text
    return text.replace("-", _MINUS)


def aligned(values: Sequence[float | None]) -> list[str]:
    """Writes the numbers of a column with equally many decimals, so that their points align.

    A number that these decimals would change by a twentieth is written in digits of its own.

    Example:
        >>> aligned([-0.25, 3.0, 0.0, 1e-6, math.inf, None])
        ['−0.25', '3.00', '0.00', '1e−06', '∞', '']
    """  # noqa: RUF002 - the minus sign is meant
    sizes = [abs(value) for value in values if value is not None and math.isfinite(value)]
    largest = max(sizes, default=0.0)
    if largest >= 1e6 or (largest and largest < 1e-4):
        return [number(value) for value in values]
    decimals = min(max(3 - math.floor(math.log10(largest)), 0), 6) if largest else 0
    written = [f"{size:.{decimals}f}" for size in sizes]
    while decimals and all(text.endswith("0") for text in written):
        written, decimals = [text[:-1] for text in written], decimals - 1
    return [_fixed(value, decimals) for value in values]


def _fixed(value: float | None, decimals: int) -> str:
    if value is None or not math.isfinite(value):
        return number(value)
    text = f"{value:.{decimals}f}"
    if abs(float(text) - value) > 0.05 * abs(value):
        return number(value, 2)
    return text.replace("-", _MINUS)


def percent(share: float) -> str:
    """Writes a share as a percentage, in full percents but near 0 and 1.

    Example:
        >>> percent(0.85), percent(0.9965), percent(1), percent(0.0004)
        ('85', '99.7', '100', '0.04')
    """
    value = 100 * share
    if value in {0.0, 100.0}:
        return f"{value:.0f}"
    if 1 <= abs(value) <= 99:
        return f"{value:.0f}".replace("-", _MINUS)
    far = 100 - abs(value) if abs(value) > 99 else abs(value)
    decimals = min(max(1, -math.floor(math.log10(far))), 6) if far else 0
    return f"{value:.{decimals}f}".rstrip("0").rstrip(".").replace("-", _MINUS)


def time(value: float | None, unit: str) -> str:
    """Writes a time with its unit.

    Example:
        >>> time(1.5, "s"), time(3, "steps"), time(None, "s")
        ('1.5 s', 'step 3', '')
    """
    if value is None:
        return ""
    return f"{number(value)} s" if unit == "s" else f"step {number(value)}"


class PageIds:
    """Makes the ids of a page out of names: short, safe in an address, and each given once.

    Example:
        >>> names = PageIds()
        >>> names.add("Höhe < 3"), names.add("hohe 3"), names.add("高度")
        ('hohe-3', 'hohe-3-2', 'x')
    """

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)

    def add(self, *parts: str) -> str:
        """Returns an id of the parts that nothing else on the page has."""
        plain = "-".join(_slug(part) for part in parts)
        found, i = plain, 2
        while found in self._taken:
            found, i = f"{plain}-{i}", i + 1
        self._taken.add(found)
        return found


def _slug(text: str) -> str:
    letters = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", letters).strip("-")[:60].rstrip("-") or "x"
