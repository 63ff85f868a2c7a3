"""Numbers, times and tables as text for a terminal of 80 columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

__all__ = ["counted", "number", "sample_text", "shorten", "table", "time_text"]


def counted(count: int, what: str) -> str:
    """Writes how many there are of something whose plural ends in s.

    Example:
        >>> counted(1, "trace"), counted(0, "trace")
        ('1 trace', '0 traces')
    """
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def number(value: float) -> str:
    """Writes a number in six digits at most.

    Example:
        >>> number(2.0), number(-1 / 3), number(float("inf"))
        ('2', '-0.333333', 'inf')
    """
    return f"{value:.6g}"


def time_text(time: float, step: float | None) -> str:
    """Writes a time in seconds, with enough digits to tell it from the time a step later.

    Without a step, the time is the number of a sample.

    Example:
        >>> time_text(1 / 3, 0.1), time_text(1.7e9 + 0.1, 0.1), time_text(3, None)
        ('0.333333 s', '1700000000.1 s', 'sample 3')
    """
    if step is None:
        return f"sample {time:.0f}"
    digits = int(math.log10(max(abs(time) / step, 1.0))) + 3
    return f"{time:.{max(digits, 6)}g} s"


def sample_text(sample: int, period: Fraction | None, start: float = 0.0) -> str:
    """Writes the time of a sample in seconds, or its number if there is no period.

    Example:
        >>> sample_text(3, Fraction(1, 2)), sample_text(3, None)
        ('1.5 s', 'sample 3')
    """
    if period is None:
        return time_text(sample, None)
    return time_text(start + float(sample * period), float(period))


def shorten(text: str, width: int) -> str:
    """Cuts a text to a width, with three dots in place of what is cut off.

    Example:
        >>> shorten("always(x > 0)", 9)
        'always...'
    """
    return text if len(text) <= width else text[: width - 3] + "..."


def table(rows: Sequence[Sequence[str]], align: str) -> list[str]:
    r"""Arranges cells in columns, two blanks apart; a column with empty cells alone is left out.

    Args:
        rows: The cells; the first row holds the names of the columns.
        align: ``<`` or ``>`` for every column.

    Example:
        >>> cells = [("ep", "spec", "steps"), ("", "upright", "50")]
        >>> print(*table(cells, "><>"), sep="\n")
        spec     steps
        upright     50
    """
    columns = [
        [f"{cell:{side}{max(map(len, column))}}" for cell in column]
        for column, side in zip(zip(*rows, strict=True), align, strict=True)
        if any(column[1:])
    ]
    return ["  ".join(cells).rstrip() for cells in zip(*columns, strict=True)]
