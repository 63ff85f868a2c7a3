"""Plain text that reads well on a terminal of 80 columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

__all__ = ["instant", "moment", "number", "shorten", "table"]


def number(value: float) -> str:
    """Six digits, without what says nothing.

    Example:
        >>> number(2.0), number(-1 / 3), number(float("inf"))
        ('2', '-0.333333', 'inf')
    """
    return f"{value:.6g}"


def instant(time: float, step: float | None) -> str:
    """A time in seconds, in the digits that tell it from one a step later; or a sample's number.

    Example:
        >>> instant(1 / 3, 0.1), instant(1.7e9 + 0.1, 0.1), instant(3, None)
        ('0.333333 s', '1700000000.1 s', 'sample 3')
    """
    if step is None:
        return f"sample {time:.0f}"
    digits = int(math.log10(max(abs(time) / step, 1.0))) + 3
    return f"{time:.{max(digits, 6)}g} s"


def moment(sample: int, period: Fraction | None, start: float = 0.0) -> str:
    """When a sample was taken: in seconds where the period is known.

    Example:
        >>> moment(3, Fraction(1, 2)), moment(3, None)
        ('1.5 s', 'sample 3')
    """
    if period is None:
        return instant(sample, None)
    return instant(start + float(sample * period), float(period))


def shorten(text: str, width: int) -> str:
    """The text, cut to a width.

    Example:
        >>> shorten("always(x > 0)", 9)
        'always...'
    """
    return text if len(text) <= width else text[: width - 3] + "..."


def table(rows: Sequence[Sequence[str]], align: str) -> list[str]:
    r"""Lines of columns, two blanks apart.

    Args:
        rows: Cells; the first row names the columns.
        align: ``<`` or ``>`` for every column.

    Example:
        >>> print(*table([("spec", "steps"), ("upright", "50")], "<>"), sep="\n")
        spec     steps
        upright     50
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            f"{cell:{side}{width}}" for cell, side, width in zip(row, align, widths, strict=True)
        ).rstrip()
        for row in rows
    ]
